"""Further cases of a test, left to `make test-more`."""

from __future__ import annotations

from typing import Any

import pytest


def slow(*values: Any) -> list[Any]:
    """Return values of a parameter, each marked as slow."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]
