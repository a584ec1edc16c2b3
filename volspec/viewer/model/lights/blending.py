"""The light dial: where lights stand around a circle, and the weights of a place between them.

place -> [blending] -> rows

References
----------
[1] Bergner, Möller, Tory & Drew (2005), "A practical approach to spectral volume rendering",
    IEEE TVCG 11(2), 207-216: the light dial.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from volspec.viewer.model.lights.lighting import Rows


@cache
def corners(count: int) -> tuple[tuple[float, float], ...]:
    """Where lights stand on the dial's rim, clockwise from the top; y runs down."""
    angles = [2 * math.pi * i / count for i in range(count)]
    return tuple((math.sin(angle), -math.cos(angle)) for angle in angles)


def dial_weights(count: int, x: float, y: float) -> tuple[float, ...]:
    """Weights of a place on the dial, whose rim has radius 1; they sum to 1.

    The polygon of the lights is a fan of triangles around the centre, where all count alike; in
    each triangle weights are linear. Places outside go to its edge.

    >>> dial_weights(4, 0.0, -1.0)
    (1.0, 0.0, 0.0, 0.0)
    >>> dial_weights(3, 0.0, 0.0)
    (0.333..., 0.333..., 0.333...)
    """
    if count < 2:
        return (1.0,) * count
    rim = corners(count)
    if count == 2:
        share = min(max((1.0 - y) / 2, 0.0), 1.0)
        return (share, 1.0 - share)
    sector = int(math.atan2(x, -y) % (2 * math.pi) / (2 * math.pi / count)) % count
    after = (sector + 1) % count
    (ax, ay), (bx, by) = rim[sector], rim[after]
    area = ax * by - bx * ay
    first, second = max((x * by - bx * y) / area, 0.0), max((ax * y - x * ay) / area, 0.0)
    total = first + second
    if total > 1.0:
        first, second, total = first / total, second / total, 1.0
    weights = [(1.0 - total) / count] * count
    weights[sector] += first
    weights[after] += second
    return tuple(weights)


def dial_place(weights: Sequence[float]) -> tuple[float, float]:
    """Where weights are on the dial: `dial_weights` undone, the lights' centre of gravity."""
    total = sum(weights)
    if total <= 0:
        return 0.0, 0.0
    rim = corners(len(weights))
    x, y = (sum(w * p[k] for w, p in zip(weights, rim, strict=True)) / total for k in (0, 1))
    return x, y


def blended(rows: Rows, x: float, y: float) -> Rows:
    """The lights at a place of the dial; the strongest at weight 1, none solo or muted."""
    weights = dial_weights(len(rows), x, y)
    most = max(weights, default=1.0)
    return tuple(
        replace(row, weight=weight / most, solo=False, muted=False)
        for row, weight in zip(rows, weights, strict=True)
    )
