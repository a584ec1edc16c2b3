"""Pytest plug-in: the tiers of the suite, tests that a machine cannot run, and what was not run.

    make quick      --quick       values only: no OpenCL device, child process or window
    make test       -m "not slow" all that the README promises, on every stage
    make test-more  -m slow       further cases of the same

A test of the folders of `QUICK` that needs more than values, or a second, is marked `not_quick`.
With ``--quick`` whatever opens a device, a child process or a window fails, so that none is missed.
"""

import gc
import subprocess
from collections import Counter
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from volspec._gpu.opencl import Compute
from volspec._gpu.opengl import headless_context
from volspec.errors import DeviceError

TESTS = Path(__file__).resolve().parents[1]
QUICK = ("appearance", "basis", "palette", "scene", "spectra", "transfer", "viewer")
# Fixtures of a device, a browser or a window.
MACHINE_FIXTURES = {"backend", "browser", "context", "needs_gl", "needs_opencl", "screen"}
_FORBIDDEN = "`make quick` opens no device, child process or window; mark the test `not_quick`"
DESELECTED = pytest.StashKey[int]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--quick", action="store_true", help="tests of values only; see tests/support/tiers.py"
    )


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out all folders with no quick test, as collecting them takes as long as the rest."""
    inside = collection_path.is_relative_to(TESTS)
    folders = collection_path.relative_to(TESTS).parts[:1] if inside else ("",)
    return True if config.option.quick and folders and folders[0] not in QUICK else None


def _is_quick(item: pytest.Item) -> bool:
    """Return True if a test is of values only, and takes less than a second."""
    return not (item.get_closest_marker("not_quick") or MACHINE_FIXTURES & {*item.fixturenames})


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collect without looking for garbage: what is collected stays, and need not be visited."""
    gc.disable()
    collected = yield
    gc.freeze()
    gc.enable()
    return collected


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.option.quick:
        others = [item for item in items if not _is_quick(item)]
        items[:] = [item for item in items if _is_quick(item)]
        config.hook.pytest_deselected(items=others)


@pytest.fixture(autouse=True, scope="session")
def _only_values(request: pytest.FixtureRequest) -> Iterator[None]:
    """Let whatever opens a device, a child process or a window fail with ``--quick``."""

    def forbidden(*_: object, **__: object) -> None:
        raise AssertionError(_FORBIDDEN)

    with pytest.MonkeyPatch.context() as patched:
        if request.config.option.quick:
            patched.setattr(Compute, "open", forbidden)
            patched.setattr(subprocess.Popen, "__init__", forbidden)
            patched.setattr("moderngl.create_standalone_context", forbidden)
        yield


@cache
def missing_devices() -> tuple[str, ...]:
    """Return the error, with its remedy, of each kind of device that this machine lacks."""
    errors = []
    for opened in (Compute.open, headless_context):
        try:
            device = opened()
        except DeviceError as error:
            errors.append(str(error))
        else:
            if opened is headless_context:
                device.release()
    return tuple(errors)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Turn a failure for want of a device into a skip that has the remedy.

    The test, a command that it ran or a child process has said so.
    """
    report = yield
    if report.failed and not item.config.option.quick:
        text = " ".join([report.longreprtext, *(content for _, content in report.sections)])
        words = " ".join(text.split())
        for error in missing_devices():
            if error.partition("; ")[0] in words:
                report.outcome = "skipped"
                report.longrepr = str(item.path), item.location[1] or 0, f"Skipped: {error}"
    return report


def pytest_deselected(items: list[pytest.Item]) -> None:
    if items:
        stash = items[0].config.stash
        stash[DESELECTED] = stash.get(DESELECTED, 0) + len(items)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["deselected"] = session.config.stash.get(DESELECTED, 0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    node.config.stash[DESELECTED] = getattr(node, "workeroutput", {}).get("deselected", 0)


def pytest_unconfigure(config: pytest.Config) -> None:
    """Print what was not run, and why, as the last line."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None or hasattr(config, "workeroutput"):
        return
    reasons = Counter(
        report.longrepr[2].removeprefix("Skipped: ")
        for report in reporter.stats.get("skipped", ())
        if isinstance(report.longrepr, tuple)
    )
    parts = [f"{count} tests ({reason})" for reason, count in reasons.most_common()]
    if cases := config.stash.get(DESELECTED, 0):
        quick, more = config.option.quick, config.option.markexpr == "not slow"
        has = "`make test` has them" if quick else "`make test-more` has them" if more else "by -m"
        parts.append(f"{cases} cases ({has})")
    reporter.write_line(f"Not run: {'; '.join(parts) or 'nothing'}.")
