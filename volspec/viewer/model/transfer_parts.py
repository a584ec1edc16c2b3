"""Parts of a transfer function, whatever its kind: points, regions, surfaces or labels.

transfer_edits -> [transfer_parts] -> Transfer -> raycast
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from volspec.transfer import (
    MAX_SURFACES,
    Isosurfaces,
    LabelFunction,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.transfer.mixes import Mix, Point, shares_of

Kind = Literal["points", "regions", "surfaces", "labels"]
# By type: its kind, which is also the field that holds its parts.
KINDS: dict[type, Kind] = {
    TransferFunction: "points",
    TransferFunction2D: "regions",
    Isosurfaces: "surfaces",
    LabelFunction: "labels",
}
MOST_PARTS = {TransferFunction: 64, TransferFunction2D: 24, Isosurfaces: MAX_SURFACES}
# The greatest opacity before thinning: 1 would let nothing through at any density.
_MOST_OPAQUE = 0.999
# The greatest fraction of a mix that one material can take.
_PUREST = 0.999
# Values may be moved this many ranges of the volume beyond its range.
_BEYOND = 1.0
# The least and greatest width that values may be stretched to, as a fraction of the range.
_WIDTHS = (1e-3, 4.0)


@dataclass(frozen=True, slots=True)
class Part:
    """A point, region, surface or label.

    Parameters
    ----------
    values : tuple of float
        The value of a point or a surface, both ends of a region, or a label.
    mix : {material: share}
    """

    values: tuple[float, ...]
    opacity: float
    mix: Mapping[str, float]


def parts_of(transfer: Transfer) -> tuple[Part, ...]:
    """Return all parts, in their order."""
    if isinstance(transfer, TransferFunction2D):
        regions = transfer.regions
        return tuple(Part(r.values, r.opacity, shares_of(r.material)) for r in regions)
    if isinstance(transfer, LabelFunction):
        labels = transfer.labels.items()
        return tuple(Part((label,), opacity, shares_of(mix)) for label, (opacity, mix) in labels)
    rows = rows_of(transfer)
    return tuple(Part((value,), opacity, shares_of(mix)) for value, opacity, mix in rows)


def rows_of(transfer: TransferFunction | Isosurfaces) -> Sequence[Point]:
    """Return the points of a curve, or the surfaces."""
    return transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces


def with_parts(transfer: Transfer, parts: Any) -> Transfer:
    """Return a transfer function with other points, regions, surfaces or labels."""
    changes: dict[str, Any] = {KINDS[type(transfer)]: parts}
    return replace(transfer, **changes)


def with_opacity(transfer: Transfer, index: int, opacity: float) -> Transfer:
    """Set the opacity of a part, limited to 0 to 1."""
    return _with_look(transfer, index, lambda _, mix: (min(max(opacity, 0.0), 1.0), mix))


def with_mix(transfer: Transfer, index: int, mix: Mix) -> Transfer:
    """Set the material or the mix of a part."""
    return _with_look(transfer, index, lambda opacity, _: (opacity, mix))


def _with_look(
    transfer: Transfer, index: int, change: Callable[[float, Mix], tuple[float, Mix]]
) -> Transfer:
    if not 0 <= index < len(parts_of(transfer)):
        return transfer
    return _with_looks(transfer, lambda i, *look: change(*look) if i == index else look)


def with_share(transfer: Transfer, index: int, material: str, share: float) -> Transfer:
    """Set the share of a material in a part's mix; the others make room or fill up."""
    parts = parts_of(transfer)
    if not 0 <= index < len(parts) or material not in transfer.materials:
        return transfer
    old = parts[index].mix
    rest = {name: own for name, own in old.items() if name != material and own > 0}
    others, total = sum(rest.values()), sum(old.values())
    if not rest:  # what it left would be black
        return transfer
    # A trace of the others stays, so that their proportions are known on the way back.
    share = min(max(share, 0.0), _PUREST * total)
    mix = {name: own * (total - share) / others for name, own in rest.items()}
    return with_mix(transfer, index, {**mix, material: share} if share > 0 else mix)


def thicken_opacities(transfer: Transfer, factor: float) -> Transfer:
    """Return all opacities as of matter denser by a factor: 1 - (1 - opacity)^factor.

    Opacities rounded to 1 cannot be thinned again: a slider starts from the same transfer function
    each time. A factor of 1 returns it itself.
    """
    if math.isclose(factor, 1.0):
        return transfer
    most = _MOST_OPAQUE if factor < 1 else 1.0

    def denser(_: int, opacity: float, mix: Mix) -> tuple[float, Mix]:
        return 1 - (1 - min(opacity, most)) ** factor, mix

    return _with_looks(transfer, denser)


def undo_thickening(transfer: Transfer, thick: Transfer, thin: Transfer, factor: float) -> Transfer:
    """Undo the thickening of a transfer function that was edited since.

    Parts whose opacity the edit left alone get that of ``thin`` back, even if thickening has
    rounded it to 1; others are thinned by the factor.

    Parameters
    ----------
    thick : Transfer
        As it was before it was edited.
    thin : Transfer
        What that was thickened from, by ``factor``.
    """
    before, after = parts_of(thick), parts_of(transfer)
    same = {i: i for i in range(len(after))}
    if len(before) != len(after):  # some were added or removed
        there = {(part.values, part.opacity): i for i, part in enumerate(before)}
        same = {i: there.get((part.values, part.opacity), -1) for i, part in enumerate(after)}
    opacities = [part.opacity for part in parts_of(thin)]

    def thinner(index: int, opacity: float, mix: Mix) -> tuple[float, Mix]:
        old = same[index]
        if old >= 0 and before[old].opacity == opacity:
            return opacities[old], mix
        return 1 - (1 - min(opacity, _MOST_OPAQUE)) ** (1 / factor), mix

    return _with_looks(transfer, thinner)


def without_part(transfer: Transfer, index: int) -> Transfer:
    """Remove a part; a curve keeps at least two, others one."""
    count = len(parts_of(transfer))
    least = 2 if isinstance(transfer, TransferFunction) else 1
    if count <= least or not 0 <= index < count:
        return transfer
    parts = getattr(transfer, KINDS[type(transfer)])
    if isinstance(transfer, LabelFunction):
        parts = list(parts.items())
    left = [part for i, part in enumerate(parts) if i != index]
    return with_parts(transfer, dict(left) if isinstance(transfer, LabelFunction) else left)


def shift_values(transfer: Transfer, by: float, span: tuple[float, float]) -> Transfer:
    """Shift all values, unless some would end far beyond the volume's range ``span``."""
    return _with_values(transfer, lambda value: value + by, span)


def stretch_values(transfer: Transfer, factor: float, span: tuple[float, float]) -> Transfer:
    """Multiply the distance of all values from their middle."""
    values = [value for part in parts_of(transfer) for value in part.values]
    low, high = min(values), max(values)
    least, most = (share * (span[1] - span[0]) for share in _WIDTHS)
    width = high - low
    if not width > 0 or not min(least, width) <= width * factor <= max(most, width):
        return transfer
    middle = (low + high) / 2
    return _with_values(transfer, lambda value: middle + factor * (value - middle), span)


def _with_values(
    transfer: Transfer, to: Callable[[float], float], span: tuple[float, float]
) -> Transfer:
    if isinstance(transfer, LabelFunction):
        return transfer
    old = [value for part in parts_of(transfer) for value in part.values]
    room = _BEYOND * (span[1] - span[0])
    low, high = min(span[0] - room, *old), max(span[1] + room, *old)
    if not all(low <= to(value) <= high for value in old):
        return transfer
    if isinstance(transfer, TransferFunction2D):
        regions = [replace(r, values=(to(r.values[0]), to(r.values[1]))) for r in transfer.regions]
        return with_parts(transfer, regions)
    rows = rows_of(transfer)
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
    rows = enumerate(rows_of(transfer))
    return with_parts(transfer, [(value, *change(i, own, mix)) for i, (value, own, mix) in rows])
