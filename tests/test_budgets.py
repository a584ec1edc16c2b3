"""Budgets of the suite: its size, tests of refusals, and clocks."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
FILES = sorted(TESTS.rglob("*.py"))
# 48,000, and 30 formats of files with their neighbours (units, axes, writers, damage), borders,
# scales, scripts, forks, sockets, random pairs of scenes that must give one picture; settings of
# the viewer by writers, and random walks through them.
MAX_LINES = 52_700
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


def test_few_functions_test_refusals():
    sources = [*functions()]
    assert sum(bool(REFUSAL.search(source)) for source in sources) <= MAX_REFUSALS * len(sources)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_verdict_depends_on_a_clock(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    clocks = [line for line in lines if CLOCK.search(line)]
    assert path.relative_to(TESTS).as_posix() in CLOCKS or clocks == []
