"""Pytest plug-in: CPU seconds of each test, children included, in a CSV file.

    python -m pytest -p tests.support.costs --costs=costs.csv -n 2
    python -m tests.support.costs before.csv after.csv

The second command prints the dearest tests of two such files as a table. A row a test: its seconds
of CPU time (user and system, of this process, of children that ended and of those that still run),
its seconds of wall time, and its name. What a fixture of a module or of the session takes counts
for the first test that asks for it.
"""

import csv
import os
import sys
import time
from collections.abc import Generator
from pathlib import Path

import psutil
import pytest

DEAREST = 50
COSTS = pytest.StashKey[list[tuple[float, float, str]]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--costs", type=Path, help="write the CPU seconds of each test to this CSV")


def cpu_seconds() -> float:
    """Return the CPU seconds of this process and of its children, ended ones included."""
    total = sum(os.times()[:4])
    for child in psutil.Process().children(recursive=True):
        try:
            times = child.cpu_times()
        except psutil.Error:
            continue
        total += times.user + times.system + times.children_user + times.children_system
    return total


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    if item.config.option.costs is None:
        return (yield)
    item.stash[COSTS] = [(cpu_seconds(), time.perf_counter(), "")]
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if call.when == "teardown" and COSTS in item.stash:
        cpu, wall, _ = item.stash[COSTS][0]
        # A child that is killed and not waited for takes its seconds with it.
        costs = (max(cpu_seconds() - cpu, 0.0), time.perf_counter() - wall)
        report.user_properties.append(("costs", costs))
    return report


def pytest_configure(config: pytest.Config) -> None:
    if config.option.costs is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(Writer(config.option.costs), "costs")


class Writer:
    """Collects the rows of all workers, and writes them at the end, dearest first."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows: list[tuple[float, float, str]] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, costs in report.user_properties:
            if name == "costs" and report.when == "teardown":
                self.rows.append((round(costs[0], 3), round(costs[1], 3), report.nodeid))

    def pytest_sessionfinish(self) -> None:
        with self.path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("cpu_s", "wall_s", "test"))
            writer.writerows(sorted(self.rows, reverse=True))


def table(*paths: Path) -> str:
    """Return the dearest tests of some files as columns of a Markdown table."""
    columns: list[list[str]] = [[] for _ in range(DEAREST + 1)]
    for path in paths:
        with path.open(encoding="utf-8", newline="") as file:
            rows = [(row["test"], float(row["cpu_s"])) for row in csv.DictReader(file)]
        columns[0] += [f"{len(rows)} tests", f"{sum(cost for _, cost in rows):.0f}"]
        for column, (test, cost) in zip(columns[1:], rows, strict=False):
            module, _, name = test.removeprefix("tests/").partition(".py::")
            column += [f"`{module} {name}`".replace("|", " "), f"{cost:.1f}"]
    lines = [f"| {' | '.join(column)} |" for column in columns]
    return "\n".join([lines[0], "|---|--:" * len(paths) + "|", *lines[1:]])


if __name__ == "__main__":
    print(table(*map(Path, sys.argv[1:])))
