"""Command lines of child processes that import this process's modules."""

from __future__ import annotations

import json
import signal
import sys
from contextlib import suppress

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
