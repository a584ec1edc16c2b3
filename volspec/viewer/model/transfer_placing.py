"""Places of a transfer function's parts: between their neighbours, and new ones.

transfer_edits -> [transfer_placing] -> Transfer -> raycast
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from volspec.transfer import (
    MAX_LABEL,
    Isosurfaces,
    LabelFunction,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.transfer.mixes import Point
from volspec.viewer.model.transfer_parts import MOST_PARTS, rows_of, with_parts

# Values nearer than this fraction of the parts' span would make a table too fine.
_GAP = 1e-3
# The size of a new region, as a fraction of either axis.
_NEW = 0.15
# Labels are listed one by one.
MOST_LABELS = 256


def value_gap(rows: Sequence[Point]) -> float:
    """Return the least distance between the values of points or surfaces."""
    return _GAP * max(rows[-1][0] - rows[0][0], 1e-6)


def limit_between(places: Sequence[float], index: int, to: float, gap: float) -> float:
    """Limit a new place to the room that the neighbours leave; without room it stays."""
    if to == places[index]:
        return to
    low = places[index - 1] + gap if index > 0 else -math.inf
    high = places[index + 1] - gap if index < len(places) - 1 else math.inf
    return min(max(to, low), high) if low <= high else places[index]


def gradient_top(curve: TransferFunction, top: float) -> float:
    """Return the end of the axis of a curve's factors; ``top`` is the greatest gradient."""
    return max(top, curve.gradient_opacity[-1][0]) if curve.gradient_opacity else top


def add_label(labels: LabelFunction, value: float, opacity: float) -> Transfer:
    """Add a label, of the material of the last."""
    label = round(min(max(value, 0), MAX_LABEL))
    if label in labels.labels or len(labels.labels) >= MOST_LABELS:
        return labels
    mix = list(labels.labels.values())[-1][1]
    return with_parts(labels, {**labels.labels, label: (opacity, mix)})


def add_row(transfer: TransferFunction | Isosurfaces, value: float, opacity: float) -> Transfer:
    """Add a point or a surface, of the material of the nearest."""
    rows = rows_of(transfer)
    if len(rows) >= MOST_PARTS[type(transfer)]:
        return transfer
    nearest, _, mix = min(rows, key=lambda row: abs(row[0] - value))
    if isinstance(transfer, Isosurfaces) and abs(value - nearest) <= value_gap(rows):
        return transfer
    new = sorted([*rows, (value, opacity, mix)], key=lambda row: row[0])
    return with_parts(transfer, new)


def add_region(
    transfer: TransferFunction2D, place: tuple[float, float], span: tuple[float, float], top: float
) -> Transfer:
    """Add a region around a (value, gradient), of the opacity and material of the last.

    ``span`` is the range of the volume's values, ``top`` its greatest gradient.
    """
    if len(transfer.regions) >= MOST_PARTS[TransferFunction2D]:
        return transfer
    value, gradient = place
    width, height = _NEW * (span[1] - span[0]), _NEW * top
    bottom = max(gradient - height, 0.0)
    like = transfer.regions[-1]
    region = Region(
        (value - width / 2, value + width / 2),
        (bottom, bottom + 2 * height),
        max(like.opacity, 0.05),
        like.material,
        like.softness,
    )
    return with_parts(transfer, [*transfer.regions, region])
