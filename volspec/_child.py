"""Child processes that run a few lines of Python with this one's modules."""

from __future__ import annotations

import json
import signal
import sys
from contextlib import suppress

_PATHS = "import json, sys; sys.path[:] = json.loads(sys.argv[1])\n"


def child_command(code: str) -> list[str]:
    """Return the command that runs ``code``, to which arguments ``sys.argv[2:]`` may be added.

    Modules are found where this process finds them, and neither the working folder nor variables
    of the environment change that. Without an interpreter's path ``subprocess`` raises a TypeError.
    """
    searched = [entry for entry in sys.path if isinstance(entry, str)]
    return [sys.executable, "-I", "-c", _PATHS + code, json.dumps(searched)]


def exit_cause(returncode: int) -> str:
    """Return how a process ended: ``SIGSEGV``, or ``exit code 0xc0000005``."""
    with suppress(ValueError):
        return signal.Signals(-returncode).name
    return f"exit code {returncode:#x}"
