"""Measure the source: ``python -m tools.source_metrics [TREE...]`` prints a column for each tree.

Sizes, imports, the openings and words of docstrings and names, lines that carry settings from one
form to another, the largest classes and three functions, and tests that pin English sentences.
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
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
PRIVATE = re.compile(
    "_*(each|found|own|given|at|shown|wanted|made|whole|seen|known|most|least|shares?|lit|chosen"
    "|others|rest|moved|held|apart|along|lost|there|every|way|remarks|stated|behind|tall|away"
    "|through|plain|like|told|said|what|wide)_*"
)
"""Names that do not say what they hold."""
FUNCTIONS = ("cli/relight.py:relight", "pipeline.py:raycast", "viewer/app.py:_draw")
SETTINGS = (
    *("_tables/*.py", "settings.py", "scene/**/*.py", "cli/viewing.py", "cli/options.py"),
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


def bound_names(tree: ast.AST) -> Iterator[str]:
    """Yield each name that code binds: variables, parameters, functions, classes, attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def mutable_attributes(node: ast.ClassDef) -> int:
    """Count the attributes of self that are assigned outside of ``__init__``."""
    methods = [method for method in node.body if getattr(method, "name", "__init__") != "__init__"]
    parts = (part for method in methods for part in ast.walk(method))
    stored = {ast.unparse(part) for part in parts if isinstance(getattr(part, "ctx", 0), ast.Store)}
    return len([*filter(re.compile(r"self\.\w+").fullmatch, stored)])


def code_lines(node: ast.FunctionDef | ast.AsyncFunctionDef, source: list[str]) -> int:
    """Count a function's lines without blank ones, comments, docstrings and imports."""
    assert node.end_lineno is not None
    lines = {n for n in range(node.lineno, node.end_lineno + 1) if source[n - 1].strip()}
    for part in ast.walk(node):
        docstring = isinstance(part, ast.Expr) and isinstance(part.value, ast.Constant)
        if docstring or isinstance(part, ast.ImportFrom | ast.Import):
            lines -= {*range(part.lineno, (part.end_lineno or 0) + 1)}
    return sum(not source[n - 1].lstrip().startswith("#") for n in lines)


def branches(node: ast.AST) -> int:
    """Count ways through a function: conditions, their parts, loops, handlers."""
    kinds = ast.If | ast.IfExp | ast.For | ast.While | ast.ExceptHandler | ast.comprehension
    return sum(
        len(part.values) - 1 if isinstance(part, ast.BoolOp) else isinstance(part, kinds)
        for part in ast.walk(node)
    )


def imported(package: Path, trees: dict[Path, ast.Module]) -> tuple[int, int, int]:
    """Return (imports of names across packages, those past a door, circles).

    A package's door is its ``__init__``. A circle is of the files and folders of one folder, and
    counts imports inside functions and for types.
    """
    doors = {path.parent for path in trees if path.name == "__init__.py"}
    across = past = 0
    edges: dict[Path, dict[str, set[str]]] = {}
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith(
                "volspec"
            ):
                continue
            place = package.joinpath(*(node.module or "").split(".")[1:])
            for alias in node.names:
                inside = place / alias.name
                is_module = inside.with_suffix(".py") in trees
                to = inside.with_suffix(".py") if is_module else place.with_suffix(".py")
                to = to if to in trees else inside if inside in doors else place
                home, own = to.relative_to(package).parts, path.relative_to(package).parts
                behind_door = stub_target(place, alias.name)
                if home and package / home[0] in doors and home[0] != own[0]:
                    across, past = across + 1, past + (to.suffix == ".py" and behind_door is None)
                to = behind_door or to
                for folder in path.parents:
                    if not folder.is_relative_to(package):
                        break
                    if to.is_relative_to(folder) and to != folder:
                        parts = edges.setdefault(folder, {})
                        one, other = (
                            path.relative_to(folder).parts[0],
                            to.relative_to(folder).parts[0],
                        )
                        if one != other:
                            parts.setdefault(one, set()).add(other)
    return across, past, sum(circles(parts) for parts in edges.values())


def stub_target(place: Path, name: str) -> Path | None:
    """Return the module that a lazy door gives a name from."""
    stub = place / "__init__.pyi"
    if stub.exists():
        for node in ast.parse(stub.read_text()).body:
            if isinstance(node, ast.ImportFrom) and name in {alias.name for alias in node.names}:
                target = place.joinpath(*(node.module or name).split("."))
                module = target.with_suffix(".py")
                return module if module.exists() else target
    return None


def circles(parts: dict[str, set[str]]) -> int:
    """Count the circles that have to be cut until there is none."""
    graph, count = {name: set(to) for name, to in parts.items()}, 0
    while True:
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:
            cycle = error.args[1]
            graph[cycle[1]].discard(cycle[0])
            count += 1
        else:
            return count


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
    names = [name for tree in trees.values() for name in bound_names(tree)]
    across, past, circular = imported(package, trees)
    classes = {
        node.name: mutable_attributes(node)
        for tree in trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    }
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    found = {
        f"{path.relative_to(package).as_posix()}:{node.name}": (path, node)
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
    }
    bodies = {
        name: f"{code_lines(node, texts[path].splitlines())}, {branches(node)}"
        for name, (path, node) in found.items()
        if name in FUNCTIONS
    }
    vague = sum(PRIVATE.fullmatch(name) is not None for name in names)
    return {
        "volspec/ files": f"{len(sizes)}",
        "volspec/ lines": f"{sum(sizes):,}",
        "lines of a file, median": f"{median(sizes):.0f}",
        "docstrings that open with a question word or a fragment": f"{opened / len(documents):.1%}",
        "words of the style's list per 1000 words of docstrings": f"{1000 * private / words:.2f}",
        "lines that carry settings": f"{setting_lines(package, trees):,}",
        "imports across packages, past a door": f"{across:,}, {past:,}",
        "import circles": f"{circular}",
        "mutable attributes of Screen, most of any class": "{}, {}".format(
            classes.get("Screen", 0), max(classes.values())
        ),
        "classes with more than 15": f"{sum(count > 15 for count in classes.values())}",
        **{f"{name}: lines of code, branches": bodies[name] for name in FUNCTIONS},
        "names that do not say what they hold, per 1000": f"{1000 * vague / len(names):.1f}",
        "required dependencies": f"{len(project['dependencies'])}",
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
