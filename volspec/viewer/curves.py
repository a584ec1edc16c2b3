"""Edits of a transfer function's points: dragged, added, removed, shifted.

mouse -> [curves] -> TransferFunction -> raycast
"""

from __future__ import annotations

from dataclasses import replace

from volspec.transfer import TransferFunction
from volspec.transfer.mixes import Point

# Values nearer than this share of the span would make a table too fine.
_GAP = 1e-3
MOST_POINTS = 64


def moved(curve: TransferFunction, index: int, value: float, opacity: float) -> TransferFunction:
    """A point elsewhere: between its neighbours, opacity 0 to 1."""
    points = list(curve.points)
    if not 0 <= index < len(points):
        return curve
    gap = _GAP * max(points[-1][0] - points[0][0], 1e-6)
    if index > 0:
        value = max(value, points[index - 1][0] + gap)
    if index < len(points) - 1:
        value = min(value, points[index + 1][0] - gap)
    points[index] = (value, min(max(opacity, 0.0), 1.0), points[index][2])
    return _sorted(curve, points)


def added(curve: TransferFunction, value: float, opacity: float) -> TransferFunction:
    """One more point, of the material of the nearest."""
    points = list(curve.points)
    if len(points) >= MOST_POINTS:
        return curve
    nearest = min(points, key=lambda point: abs(point[0] - value))
    return _sorted(curve, [*points, (value, min(max(opacity, 0.0), 1.0), nearest[2])])


def removed(curve: TransferFunction, index: int) -> TransferFunction:
    """One point less; two stay."""
    points = list(curve.points)
    if len(points) < 3 or not 0 <= index < len(points):
        return curve
    del points[index]
    return replace(curve, points=points)


def shifted(curve: TransferFunction, by: float) -> TransferFunction:
    """All points at other values."""
    points = [(value + by, opacity, mix) for value, opacity, mix in curve.points]
    return replace(curve, points=points)


def _sorted(curve: TransferFunction, points: list[Point]) -> TransferFunction:
    return replace(curve, points=sorted(points, key=lambda point: point[0]))
