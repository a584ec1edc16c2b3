"""Checks of numbers and vectors: finite and in range, or an error that names them."""

from __future__ import annotations

import math
import operator
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from volspec import settings
from volspec.errors import InputError, RaycastError

Vector = tuple[float, float, float]
# Keeps products of weights and intensities far within float32.
MAX_WEIGHT = 1e6
MAX_SIDE = 16384
Weight = Annotated[float, Field(ge=0, le=MAX_WEIGHT, allow_inf_nan=False)]


def number(field: str, value: Any, error: type[InputError] = RaycastError) -> float:
    """Return a finite number.

    >>> number("raycast: jitter", "much")
    Traceback (most recent call last):
    volspec.errors.RaycastError: raycast: jitter is 'much'; give a number
    """
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise error.refused(field, value, "give a number", "type")
    if not math.isfinite(value):
        raise error.refused(field, value, "give a finite number", "range")
    return float(value)


def whole(field: str, value: int, low: int, high: int) -> int:
    """Return a whole number from ``low`` to ``high``."""
    if not low <= value <= high:
        remedy = f"give a whole number from {low} to {high}"
        raise RaycastError.refused(field, value, remedy, "range")
    return value


def _direction(towards: Vector) -> Vector:
    if not any(towards):
        raise InputError("", "give a vector of a length above 0", code="range", given=towards)
    return unit(towards)


Direction = Annotated[settings.Vector, AfterValidator(_direction)]
"""Three numbers, of any length but 0, stored as a unit vector."""


def unit(towards: Any) -> Vector:
    """Return a vector's direction; a vector of length 1 is returned unchanged to the last bit.

    A direction that is written to a file and read again is therefore equal.

    >>> unit((3e200, 0, 4e200))
    (0.6, 0.0, 0.8)
    """
    x, y, z = (float(v) for v in towards)
    if abs(math.hypot(x, y, z) - 1) < 1e-15:
        return x, y, z
    # Scaled first: the squares of tiny or huge components underflow or overflow.
    scale = max(abs(x), abs(y), abs(z))
    x, y, z = x / scale, y / scale, z / scale
    length = math.hypot(x, y, z)
    return x / length, y / length, z / length


def checked_size(size: Any, who: str = "raycast") -> tuple[int, int]:
    """Return a picture's width and height in pixels, 1 to `MAX_SIDE`."""
    try:
        width, height = (operator.index(n) for n in size)
    except (TypeError, ValueError):
        remedy = "give (width, height) in whole pixels"
        raise RaycastError.refused(f"{who}: size", size, remedy, "type") from None
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise RaycastError(
            f"{who}: the picture is {width}x{height}",
            f"give 1x1 to {MAX_SIDE}x{MAX_SIDE}",
            code="range",
            given=size,
        )
    return width, height
