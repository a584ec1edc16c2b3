"""Parts of a transfer function, whatever its kind: points, regions, surfaces or labels.

transfer_edits -> [transfer_parts] -> Transfer -> raycast
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

from volspec.transfer import (
    MAX_SURFACES,
    Isosurfaces,
    LabelFunction,
    Mix,
    Point,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
    mix_weights,
)

Kind = Literal["points", "regions", "surfaces", "labels"]
# By type: its kind, which is also the field that holds its parts.
KINDS: dict[type, Kind] = {
    TransferFunction: "points",
    TransferFunction2D: "regions",
    Isosurfaces: "surfaces",
    LabelFunction: "labels",
}
MAX_PARTS = {TransferFunction: 64, TransferFunction2D: 24, Isosurfaces: MAX_SURFACES}
# The greatest opacity before thinning: 1 would let nothing through at any density.
_MAX_OPAQUE = 0.999
# Values may be moved this many ranges of the volume beyond its range.
_BEYOND = 1.0
# The least and greatest width that values may be stretched to, as a fraction of the range.
_WIDTHS = (1e-3, 4.0)
# Values nearer than this fraction of the parts' span would make a table too fine.
_GAP = 1e-3
# The size of a new region, as a fraction of either axis.
_NEW = 0.15


@dataclass(frozen=True, slots=True)
class TransferPart:
    """A point or surface at a value, a region with two ends, or a label; mix: {material: share}."""

    values: tuple[float, ...]
    opacity: float
    mix: Mapping[str, float]


# Called for each row of a list in every frame.
@lru_cache(maxsize=8)
def list_parts(transfer: Transfer) -> tuple[TransferPart, ...]:
    """Return all parts, in their order."""
    if isinstance(transfer, TransferFunction2D):
        regions = transfer.regions
        return tuple(TransferPart(r.values, r.opacity, mix_weights(r.material)) for r in regions)
    if isinstance(transfer, LabelFunction):
        labels = transfer.labels.items()
        return tuple(
            TransferPart((label,), opacity, mix_weights(mix)) for label, (opacity, mix) in labels
        )
    rows = list_points(transfer)
    return tuple(TransferPart((value,), opacity, mix_weights(mix)) for value, opacity, mix in rows)


def list_points(transfer: TransferFunction | Isosurfaces) -> Sequence[Point]:
    """Return the points of a curve, or the surfaces."""
    return transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces


def with_parts(transfer: Transfer, parts: Any) -> Transfer:
    """Return a transfer function with other points, regions, surfaces or labels."""
    changes: dict[str, Any] = {KINDS[type(transfer)]: parts}
    return replace(transfer, **changes)


def with_mix(transfer: Transfer, index: int, mix: Mix) -> Transfer:
    """Set the material or the mix of a part."""
    return with_look(transfer, index, lambda opacity, _: (opacity, mix))


def with_look(
    transfer: Transfer, index: int, change: Callable[[float, Mix], tuple[float, Mix]]
) -> Transfer:
    """Replace opacity and mix of a part by ``change(opacity, mix)``."""
    if not 0 <= index < len(list_parts(transfer)):
        return transfer
    return _with_looks(transfer, lambda i, *look: change(*look) if i == index else look)


def thicken_opacities(transfer: Transfer, factor: float) -> Transfer:
    """Scale the density of all parts by a factor: opacity becomes 1 - (1 - opacity)^factor.

    Opacities rounded to 1 cannot be thinned again, so a slider always starts from the same transfer
    function. A factor of 1 returns the same object.
    """
    if math.isclose(factor, 1.0):
        return transfer
    max_opacity = _MAX_OPAQUE if factor < 1 else 1.0

    def denser(_: int, opacity: float, mix: Mix) -> tuple[float, Mix]:
        return 1 - (1 - min(opacity, max_opacity)) ** factor, mix

    return _with_looks(transfer, denser)


def undo_thickening(transfer: Transfer, thick: Transfer, thin: Transfer, factor: float) -> Transfer:
    """Undo the thickening from ``thin`` to ``thick`` of a transfer function that was edited since.

    Parts whose opacity was not edited regain their opacity in ``thin``, even if thickening has
    rounded it to 1; others are thinned by the factor.
    """
    before, after = list_parts(thick), list_parts(transfer)
    same = {i: i for i in range(len(after))}
    if len(before) != len(after):  # some were added or removed
        indices = {(part.values, part.opacity): i for i, part in enumerate(before)}
        same = {i: indices.get((part.values, part.opacity), -1) for i, part in enumerate(after)}
    opacities = [part.opacity for part in list_parts(thin)]

    def thinner(index: int, opacity: float, mix: Mix) -> tuple[float, Mix]:
        old = same[index]
        if old >= 0 and before[old].opacity == opacity:
            return opacities[old], mix
        return 1 - (1 - min(opacity, _MAX_OPAQUE)) ** (1 / factor), mix

    return _with_looks(transfer, thinner)


def stretch_values(transfer: Transfer, factor: float, span: tuple[float, float]) -> Transfer:
    """Multiply the distance of all values from their middle."""
    low, high = limits(transfer)
    min_width, max_width = (fraction * (span[1] - span[0]) for fraction in _WIDTHS)
    width = high - low
    if not width > 0 or not min(min_width, width) <= width * factor <= max(max_width, width):
        return transfer
    middle = (low + high) / 2
    return map_values(transfer, lambda value: middle + factor * (value - middle), span)


def limits(transfer: Transfer) -> tuple[float, float]:
    """Return the least and the greatest value of a transfer function."""
    values = [value for part in list_parts(transfer) for value in part.values]
    return min(values), max(values)


def place_values(
    transfer: Transfer, low: float, high: float, span: tuple[float, float]
) -> Transfer:
    """Move the least value and the greatest one, and the others in proportion."""
    first, last = limits(transfer)
    if not (last > first and high - low >= _WIDTHS[0] * (span[1] - span[0])):
        return transfer
    scale = (high - low) / (last - first)
    return map_values(transfer, lambda value: low + scale * (value - first), span)


def map_values(
    transfer: Transfer, to: Callable[[float], float], span: tuple[float, float]
) -> Transfer:
    """Convert all values, unless some would end far beyond the volume's range ``span``."""
    if isinstance(transfer, LabelFunction):
        return transfer
    old = [value for part in list_parts(transfer) for value in part.values]
    room = _BEYOND * (span[1] - span[0])
    low, high = min(span[0] - room, *old), max(span[1] + room, *old)
    if not all(low <= to(value) <= high for value in old):
        return transfer
    if isinstance(transfer, TransferFunction2D):
        regions = [replace(r, values=(to(r.values[0]), to(r.values[1]))) for r in transfer.regions]
        return with_parts(transfer, regions)
    rows = list_points(transfer)
    return with_parts(transfer, [(to(value), opacity, mix) for value, opacity, mix in rows])


def _with_looks(
    transfer: Transfer, change: Callable[[int, float, Mix], tuple[float, Mix]]
) -> Transfer:
    """Replace opacity and mix of every part by ``change(index, opacity, mix)``."""
    if isinstance(transfer, TransferFunction2D):
        regions = []
        for i, region in enumerate(transfer.regions):
            opacity, mix = change(i, region.opacity, region.material)
            regions.append(replace(region, opacity=opacity, material=mix))
        return with_parts(transfer, regions)
    if isinstance(transfer, LabelFunction):
        looks = enumerate(transfer.labels.items())
        return with_parts(transfer, {label: change(i, *look) for i, (label, look) in looks})
    rows = enumerate(list_points(transfer))
    return with_parts(transfer, [(value, *change(i, old, mix)) for i, (value, old, mix) in rows])


def value_gap(rows: Sequence[Point]) -> float:
    """Return the least distance between the values of points or surfaces."""
    return _GAP * (rows[-1][0] - rows[0][0])


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
    """Add a label with the material of the last one."""
    label = round(max(value, 0))
    if label in labels.labels:
        return labels
    mix = list(labels.labels.values())[-1][1]
    return with_parts(labels, {**labels.labels, label: (opacity, mix)})


def add_row(transfer: TransferFunction | Isosurfaces, value: float, opacity: float) -> Transfer:
    """Add a point or a surface with the material of the nearest one."""
    rows = list_points(transfer)
    if len(rows) >= MAX_PARTS[type(transfer)]:
        return transfer
    nearest, _, mix = min(rows, key=lambda row: abs(row[0] - value))
    if isinstance(transfer, Isosurfaces) and abs(value - nearest) <= value_gap(rows):
        return transfer
    new = sorted([*rows, (value, opacity, mix)], key=lambda row: row[0])
    return with_parts(transfer, new)


def add_region(
    transfer: TransferFunction2D, place: tuple[float, float], span: tuple[float, float], top: float
) -> Transfer:
    """Add a region around a (value, gradient), with the opacity and material of the last one.

    ``span`` is the range of the volume's values, ``top`` its greatest gradient.
    """
    if len(transfer.regions) >= MAX_PARTS[TransferFunction2D]:
        return transfer
    value, gradient = place
    width, height = _NEW * (span[1] - span[0]), _NEW * top
    bottom = max(gradient - height, 0.0)
    last = transfer.regions[-1]
    region = Region(
        (value - width / 2, value + width / 2),
        (bottom, bottom + 2 * height),
        max(last.opacity, 0.05),
        last.material,
        last.softness,
    )
    return with_parts(transfer, [*transfer.regions, region])
