"""Short names of what pytest's fixtures and marks are."""

from typing import Any

import pytest

Capture = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch


def slow(*values: object) -> Any:
    """Return a row of parameters for a further case, which `make test` leaves out."""
    return pytest.param(*values, marks=pytest.mark.slow)


def slow_each(*values: object) -> list[Any]:
    """Return values of one parameter, each a further case."""
    return [slow(value) for value in values]
