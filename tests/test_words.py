"""The words of the house: docstrings open plainly, and a short list of words is not used."""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.source_metrics import OPENINGS, WORDS, definitions

ROOT = Path(__file__).resolve().parent.parent
MODULES = sorted((ROOT / "volspec").rglob("*.py"))
# The list itself is in one of the tools.
SOURCES = [
    *MODULES,
    *(ROOT / "tests").rglob("*.py"),
    *(ROOT / "benchmarks").rglob("*.py"),
    *(ROOT / "examples").rglob("*.py"),
    *(path for path in (ROOT / "tools").rglob("*.py") if path.name != "source_metrics.py"),
]
SHADERS = sorted(
    path
    for folder in ("kernels", "shaders")
    for path in (ROOT / folder).rglob("*.*")
    if path.suffix in (".cl", ".clh", ".glsl", ".frag", ".vert")
)
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, text) of a module's comments and strings of several words."""
    whole = path.read_text(encoding="utf-8")
    if not WORDS.search(whole):  # as most: to read their tokens takes seconds
        return
    for token in tokenize.generate_tokens(io.StringIO(whole).readline):
        words = token.type == tokenize.STRING and " " in token.string
        if token.type == tokenize.COMMENT or words:
            yield token.start[0], token.string


# Files without it have no such docstring, and need not be parsed.
SUSPECT = re.compile(rf"(\"\"\"|''')\s*{OPENINGS.pattern}")


def test_docstrings_open_with_an_imperative_or_a_noun_phrase():
    found = []
    for path in SOURCES:
        whole = path.read_text(encoding="utf-8")
        for node in definitions(ast.parse(whole if SUSPECT.search(whole) else "")):
            text = ast.get_docstring(node) or ""
            if OPENINGS.match(text):
                line = getattr(node, "lineno", 1)
                found.append(f"{path.relative_to(ROOT)}:{line}: {text.splitlines()[0]}")
    assert not found, "\n".join(found)


def test_no_module_uses_a_word_of_the_list():
    found = [
        f"{path.relative_to(ROOT)}:{line}: {word.group()}"
        for path in SOURCES
        for line, text in prose(path)
        for word in WORDS.finditer(text)
    ]
    assert not found, "\n".join(found)


@pytest.mark.parametrize("path", [*SHADERS, *PAGES], ids=lambda path: path.name)
def test_no_kernel_shader_or_page_uses_a_word_of_the_list(path):
    words = [word.group() for word in WORDS.finditer(path.read_text(encoding="utf-8"))]
    assert not words, f"{path.relative_to(ROOT)}: {', '.join(words)}"


NAMED = re.compile(r"(?<![\w./-])(?:[\w-]+/)+[\w-]+\.(?:py|js|clh?|glsl|frag|vert|md)\b")
FOLDERS = (
    "benchmarks",
    "data",
    "docs",
    "examples",
    "kernels",
    "shaders",
    "tests",
    "tools",
    "volspec",
)


def test_files_that_pages_and_comments_name_are_there():
    """A part of a path is enough, as ``raycast/spec.py``."""
    there = {path for folder in FOLDERS for path in (ROOT / folder).rglob("*.*")}
    there = {path for path in there if "__pycache__" not in path.parts}
    ends = {"/".join(path.parts[-n:]) for path in there for n in range(2, 8)}
    scripts = (ROOT / "volspec").rglob("*.js")
    found = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in (*MODULES, *SHADERS, *PAGES, *scripts, *(ROOT / "docs/decisions").glob("*.md"))
        for name in NAMED.findall(path.read_text(encoding="utf-8"))
        if name not in ends
    ]
    assert not found, "\n".join(found)


# Commands, verbs and nouns with the ending of a participle.
NO_PARTICIPLES = {"confined", "compositing", "ring", "leading", "feed", "led", "rating", "heading"}
NO_PARTICIPLES |= {"sampling", "spacing"}
PARTICIPLE = re.compile(r"_*([a-z]+(?:ed|ing)|seen|made|held|kept|lit|shown|drawn|known|given)")


def test_functions_of_modules_are_no_participles():
    """A function's name says what it does or returns, as `normalise` or `covered_pixels`."""
    found = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {node.name}"
        for path in MODULES
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.FunctionDef) and PARTICIPLE.fullmatch(node.name)
        if node.name.strip("_") not in NO_PARTICIPLES
    ]
    assert not found, "\n".join(found)
