"""Child processes: command lines that import this process's modules, and forks."""

from __future__ import annotations

import json
import os
import signal
import sys
from contextlib import suppress
from functools import cache

from volspec.errors import DeviceError

_PATHS = "import json, sys; sys.path[:] = json.loads(sys.argv[1])\n"


def child_command(code: str) -> list[str]:
    """Return the command that runs ``code``; appended arguments become ``sys.argv[2:]``.

    The child has this process's module path, regardless of working folder and environment. If
    Python has no interpreter path, ``subprocess`` raises a TypeError.
    """
    searched = [entry for entry in sys.path if isinstance(entry, str)]
    return [sys.executable, "-I", "-c", _PATHS + code, json.dumps(searched)]


def exit_cause(returncode: int) -> str:
    """Return a process's signal or exit code: ``SIGSEGV``, or ``exit code 0xc0000005``."""
    with suppress(ValueError):
        return signal.Signals(-returncode).name
    return f"exit code {returncode:#x}"


@cache
def _first_process(_library: str) -> int:
    """Return the process that was the first to use a library, which forked ones inherit."""
    return os.getpid()


def require_own_process(library: str, error: type[DeviceError]) -> None:
    """Raise an error if a library is in use since before a fork: its threads are not here."""
    if _first_process(library) != os.getpid():
        raise error(
            f"{library}: this process was forked from one that uses it, whose threads it lacks",
            "start processes by multiprocessing.get_context('spawn'), an executor's mp_context",
            code="state",
        )
