"""Budgets of the suite: its size, tests of refusals, clocks; and of the package's code."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.source_metrics import PRIVATE, bound_names, code_lines, mutable_attributes

TESTS = Path(__file__).resolve().parent
FILES = sorted(TESTS.rglob("*.py"))
# 48,000, and 30 formats of files with their neighbours (units, axes, writers, damage), borders,
# scales, scripts, forks, sockets, random pairs of scenes that must give one picture; settings of
# the viewer by writers, and random walks through them; doors of packages.
MAX_LINES = 53_470
MAX_PACKAGE_LINES, MAX_FILES = 103_330, 449  # of volspec/, with the doors of divided packages
# Refusals are gathered in one table a module.
REFUSAL, MAX_REFUSALS = re.compile(r"\b(raises|refuses)\(|refus"), 0.12
# A clock, a pause, or a limit in seconds. Waits that only end a hang take PATIENCE_S.
CLOCK = re.compile(
    r"\b(sleep|perf_counter|monotonic|process_time|time\.time)\(|timeout(_s)?=[\d.]+[,)]"
    r"|(?<!casts)\.(wait|join|result)\(\d"
)
# Files with one for another reason than a verdict.
CLOCKS = {
    "export/test_files_whole.py": "times of files",
    "fuzz/test_fuzz.py": "a clock that the test turns",
    "support/costs.py": "measures tests",
    "support/headless.py": "lets threads work",
    "support/patience.py": "ends hangs",
    "support/window.py": "the present as a time of the viewer's trace",
    "test_budgets.py": "names them",
    "viewer/test_background.py": "a cast that ends when it is cancelled",
    "viewer/test_screen.py": "a wait that ends when it is superseded",
    "viewer/test_session.py": "times of files",
    "volume/test_reader_process.py": "a child that hangs",
}


def functions() -> Iterator[str]:
    """Yield the source of each test function."""
    for path in FILES:
        lines = path.read_text(encoding="utf-8").splitlines()
        for node in ast.parse("\n".join(lines)).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
                yield "\n".join(lines[node.lineno - 1 : node.end_lineno])


def test_the_suite_is_no_larger_than_its_budget():
    assert sum(len(path.read_bytes().splitlines()) for path in FILES) <= MAX_LINES


def test_the_package_is_no_larger_than_its_budget():
    package = [*(TESTS.parent / "volspec").rglob("*.py")]
    assert len(package) <= MAX_FILES
    assert sum(len(path.read_bytes().splitlines()) for path in package) <= MAX_PACKAGE_LINES


MAX_DOOR = 40  # names that a package gives to others


def test_doors_are_narrow():
    doors = {path.parent: path for path in (TESTS.parent / "volspec").rglob("__init__.pyi")}
    sizes = {
        package.name: len(re.findall(r"\bas (\w+)", path.read_text("utf-8")))
        for package, path in doors.items()
        if package.name != "volspec"  # the names of the library itself
    }
    assert {name: size for name, size in sizes.items() if size > MAX_DOOR} == {}


@pytest.mark.parametrize("setting", ["Y_A", "fog_white", "alpha_stop"])
def test_few_files_carry_a_setting(setting):
    """A setting of viewing, of depth, and of casts: options, panels and pages follow from it."""
    files = (TESTS.parent / "volspec").rglob("*.py")
    assert (
        sum(re.search(rf"\b{setting}\b", path.read_text("utf-8")) is not None for path in files)
        <= 6
    )


def test_few_functions_test_refusals():
    sources = [*functions()]
    assert sum(bool(REFUSAL.search(source)) for source in sources) <= MAX_REFUSALS * len(sources)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_verdict_depends_on_a_clock(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    clocks = [line for line in lines if CLOCK.search(line)]
    assert path.relative_to(TESTS).as_posix() in CLOCKS or clocks == []


MAX_ATTRIBUTES, MAX_CODE_LINES = 15, 60  # of a class, of a function
LONG_FUNCTIONS = {  # those with more, whose numbers may only shrink
    "cli/appearance.py:appearance": 66,
    "cli/export.py:export": 99,
    "cli/export.py:export_frames": 75,
    "cli/export.py:page": 67,
    "cli/light.py:light": 74,
    "cli/room.py:room": 81,
    "export/demo.py:run_demo": 75,
    "export/exporter.py:export": 80,
    "export/page/build.py:page_html": 72,
    "large/conversion.py:convert": 63,
    "pipeline.py:raycast": 62,
    "raycast/gpu.py:cast": 98,
    "raycast/launch/programs.py:cast_kernel": 63,
    "room/file.py:build_room": 70,
    "scene/tables/export.py:__post_init__": 88,
    "viewer/ui/commands.py:_entries": 63,
    "volume/files/raw.py:read_raw": 76,
}


def test_classes_and_long_functions_only_shrink():
    long = dict[str, int]()
    for path in sorted((TESTS.parent / "volspec").rglob("*.py")):
        text, place = path.read_text(encoding="utf-8"), path.relative_to(TESTS.parent / "volspec")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ClassDef):
                assert mutable_attributes(node) <= MAX_ATTRIBUTES, f"{place}:{node.name}"
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                name, lines = f"{place}:{node.name}", code_lines(node, text.splitlines())
                long[name] = max(lines, long.get(name, 0))
    grown = {name: n for name, n in long.items() if n > LONG_FUNCTIONS.get(name, MAX_CODE_LINES)}
    assert grown == {} and all(long.get(name, 0) > MAX_CODE_LINES for name in LONG_FUNCTIONS)


MAX_VAGUE = 2.5  # of 1000 names that code binds


def test_few_names_do_not_say_what_they_hold():
    files = (TESTS.parent / "volspec").rglob("*.py")
    names = [name for path in files for name in bound_names(ast.parse(path.read_text("utf-8")))]
    vague = [name for name in names if PRIVATE.fullmatch(name)]
    assert 1000 * len(vague) <= MAX_VAGUE * len(names)
