"""Measure the source: ``python -m tools.source_metrics [TREE...]`` prints a column for each tree.

Sizes, the openings and words of docstrings, lines that carry settings from one form to another,
and tests that pin English sentences.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.table import Table

OPENINGS = re.compile(
    r"(What|Which|Where|Whether|How|When|Who|Whose|That|Those|It|Of|As|By|For|In|To|From|With"
    r"|Beside|Between|Under|Within)\b"
)
"""First words of a summary that is neither an imperative nor a noun phrase."""
WORDS = re.compile(
    r"\b(anew|beside|whoever|under way|told|tells?|stand(s|ing)?(?! out))\b", re.IGNORECASE
)
"""Words of the style guide's list."""
SETTINGS = (
    *("settings.py", "scene/**/*.py", "cli/viewing.py", "cli/options.py"),
    *("palette/tables.py", "palette/file.py", "palette/storage.py", "viewer/*/scene_file.py"),
    *("viewer/*/script.py", "viewer/*/session.py"),
)
"""Files that carry settings from one form to another; every `__post_init__` counts as well."""

Definition = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def definitions(tree: ast.Module) -> Iterator[Definition]:
    """Yield the module and every class and function in it."""
    for node in ast.walk(tree):
        if isinstance(node, Definition):
            yield node


def docstrings(tree: ast.Module) -> list[str]:
    """Return the docstrings of a module's definitions."""
    return [text for node in definitions(tree) if (text := ast.get_docstring(node))]


def setting_lines(package: Path, trees: dict[Path, ast.Module]) -> int:
    """Count lines that carry settings."""
    files = {path for pattern in SETTINGS for path in package.glob(pattern)}
    lines = sum(len(path.read_text().splitlines()) for path in files)
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name == "__post_init__":
                lines += 0 if path in files else (node.end_lineno or 0) - node.lineno + 1
    return lines


def is_phrase(node: ast.AST) -> bool:
    """Return True for a literal with two words in a row, except file names."""
    return any(
        isinstance(part, ast.Constant)
        and isinstance(part.value, str)
        and re.search(r"[A-Za-z]{2,}[,;:.]? [A-Za-z]{2,}", part.value) is not None
        for part in ast.walk(node)
    )


def pins_english(test: ast.FunctionDef) -> bool:
    """Return True if a test compares a message or an output with a phrase."""
    for node in ast.walk(test):
        if isinstance(node, ast.keyword) and node.arg == "match":
            return True
        if isinstance(node, ast.Assert) and any(
            isinstance(part, ast.Compare) and is_phrase(part) for part in ast.walk(node.test)
        ):
            return True
    return False


def measure(root: Path) -> dict[str, str]:
    """Return the figures of a tree by name."""
    package = root / "volspec"
    texts = {path: path.read_text() for path in package.rglob("*.py")}
    trees = {path: ast.parse(text) for path, text in texts.items()}
    sizes = [len(text.splitlines()) for text in texts.values()]
    documents = [text for tree in trees.values() for text in docstrings(tree)]
    words = sum(len(text.split()) for text in documents)
    tests = [path.read_text() for path in (root / "tests").rglob("*.py")]
    functions = [
        node
        for text in tests
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    ]
    opened = sum(OPENINGS.match(text) is not None for text in documents)
    private = sum(len(WORDS.findall(text)) for text in documents)
    pinned = sum(pins_english(test) for test in functions)
    return {
        "volspec/ files": f"{len(sizes)}",
        "volspec/ lines": f"{sum(sizes):,}",
        "lines of a file, median": f"{median(sizes):.0f}",
        "docstrings that open with a question word or a fragment": f"{opened / len(documents):.1%}",
        "words of the style's list per 1000 words of docstrings": f"{1000 * private / words:.2f}",
        "lines that carry settings": f"{setting_lines(package, trees):,}",
        "tests/ lines": f"{sum(len(text.splitlines()) for text in tests):,}",
        "test functions": f"{len(functions):,}",
        "test functions that assert an English phrase": f"{pinned / len(functions):.1%}",
    }


def main(roots: list[str]) -> None:
    """Print the table."""
    columns = [measure(Path(root)) for root in roots or ["."]]
    table = Table("", *(roots or ["here"]))
    for name in columns[0]:
        table.add_row(name, *(column[name] for column in columns))
    Console().print(table)


if __name__ == "__main__":
    main(sys.argv[1:])
