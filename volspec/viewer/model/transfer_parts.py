"""Changes that every kind of transfer function knows: of points, regions, surfaces or labels.

    transfer_edits -> [transfer_parts] -> Transfer -> raycast

A part has an opacity and a mix of materials, whatever it is a part of.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from volspec.transfer import (
    MAX_SURFACES,
    Isosurfaces,
    LabelFunction,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.transfer.mixes import Mix, shares_of

# Of an opacity that is made thinner: what is wholly opaque would never let anything through.
_MOST_OPAQUE = 0.999
# Of a mix, what one material can take.
_PUREST = 0.999
# Beyond its range a volume has no values; so many ranges further nothing may be moved.
_BEYOND = 1.0
# What values may be squeezed or stretched to, as a share of the range.
_WIDTHS = (1e-3, 4.0)
MOST_PARTS = {TransferFunction: 64, TransferFunction2D: 24, Isosurfaces: MAX_SURFACES}


@dataclass(frozen=True, slots=True)
class Part:
    """One of the parts of a transfer function.

    Parameters
    ----------
    values : tuple of float
        The point's or the surface's, the two ends of a region, a label.
    opacity : float
    mix : {name: share}
    """

    values: tuple[float, ...]
    opacity: float
    mix: Mapping[str, float]


def parts_of(transfer: Transfer) -> tuple[Part, ...]:
    """All of them, in their order."""
    if isinstance(transfer, TransferFunction2D):
        regions = transfer.regions
        return tuple(Part(r.values, r.opacity, shares_of(r.material)) for r in regions)
    if isinstance(transfer, LabelFunction):
        labels = transfer.labels.items()
        return tuple(Part((label,), opacity, shares_of(mix)) for label, (opacity, mix) in labels)
    points = transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces
    return tuple(Part((value,), opacity, shares_of(mix)) for value, opacity, mix in points)


def with_opacity(transfer: Transfer, index: int, opacity: float) -> Transfer:
    """One part with another opacity, kept within 0 to 1."""
    if not 0 <= index < len(parts_of(transfer)):
        return transfer
    opacity = min(max(opacity, 0.0), 1.0)
    return _changed(transfer, lambda i, own, mix: (opacity if i == index else own, mix))


def with_mix(transfer: Transfer, index: int, mix: Mix) -> Transfer:
    """One part of another material or mix."""
    if not 0 <= index < len(parts_of(transfer)):
        return transfer
    return _changed(transfer, lambda i, opacity, own: (opacity, mix if i == index else own))


def with_share(transfer: Transfer, index: int, material: str, share: float) -> Transfer:
    """One part with another share of a material; the others make room or fill up."""
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
    """All opacities as if the matter were denser by a factor: 1 - (1 - opacity)^factor.

    Small ones are multiplied by it, great ones near 1. What is rounded to 1 has no way back: to
    slide to and fro, start from the same transfer function each time. A factor of 1 returns it as
    it is.
    """
    if math.isclose(factor, 1.0):
        return transfer
    most = _MOST_OPAQUE if factor < 1 else 1.0

    def denser(_: int, opacity: float, mix: Mix) -> tuple[float, Mix]:
        return 1 - (1 - min(opacity, most)) ** factor, mix

    return _changed(transfer, denser)


def undo_thickening(transfer: Transfer, thick: Transfer, thin: Transfer, factor: float) -> Transfer:
    """A transfer function that was edited while it was thick, as it is without that.

    Parts whose opacity the edit has left alone get back that which they had, also where thickening
    has rounded it to 1; others are thinned by the factor.

    Parameters
    ----------
    transfer, thick, thin : Transfer
        As edited, as it was before, and what that was thickened from.
    factor : float
        By which ``thin`` was thickened.
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

    return _changed(transfer, thinner)


def without_part(transfer: Transfer, index: int) -> Transfer:
    """Without one part; of a curve two stay, of others one."""
    count = len(parts_of(transfer))
    least = 2 if isinstance(transfer, TransferFunction) else 1
    if count <= least or not 0 <= index < count:
        return transfer
    if isinstance(transfer, LabelFunction):
        gone = list(transfer.labels)[index]
        return replace(transfer, labels={k: v for k, v in transfer.labels.items() if k != gone})
    name = _FIELDS[type(transfer)]
    kept = list(getattr(transfer, name))
    del kept[index]
    changes: dict[str, Any] = {name: kept}
    return replace(transfer, **changes)


def shift_values(transfer: Transfer, by: float, span: tuple[float, float]) -> Transfer:
    """All values moved; as they are where some would end far beyond a volume's range."""
    return _mapped(transfer, lambda value: value + by, span)


def stretch_values(transfer: Transfer, factor: float, span: tuple[float, float]) -> Transfer:
    """All values further from their middle, or nearer to it."""
    values = [value for part in parts_of(transfer) for value in part.values]
    low, high = min(values), max(values)
    least, most = (share * (span[1] - span[0]) for share in _WIDTHS)
    width = high - low
    if not width > 0 or not min(least, width) <= width * factor <= max(most, width):
        return transfer
    middle = (low + high) / 2
    return _mapped(transfer, lambda value: middle + factor * (value - middle), span)


def _mapped(
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
        return replace(transfer, regions=regions)
    points = transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces
    changes: dict[str, Any] = {
        _FIELDS[type(transfer)]: [(to(value), opacity, mix) for value, opacity, mix in points]
    }
    return replace(transfer, **changes)


_FIELDS: dict[type, str] = {
    TransferFunction: "points",
    TransferFunction2D: "regions",
    Isosurfaces: "surfaces",
}


def _changed(
    transfer: Transfer, change: Callable[[int, float, Mix], tuple[float, Mix]]
) -> Transfer:
    """Every part with the opacity and the mix that are made of its number and its own."""
    if isinstance(transfer, TransferFunction2D):
        regions = []
        for i, region in enumerate(transfer.regions):
            opacity, mix = change(i, region.opacity, region.material)
            regions.append(replace(region, opacity=opacity, material=mix))
        return replace(transfer, regions=regions)
    if isinstance(transfer, LabelFunction):
        looks = enumerate(transfer.labels.items())
        labels = {label: change(i, opacity, mix) for i, (label, (opacity, mix)) in looks}
        return replace(transfer, labels=labels)
    points = transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces
    rows = [(value, *change(i, own, mix)) for i, (value, own, mix) in enumerate(points)]
    changes: dict[str, Any] = {_FIELDS[type(transfer)]: rows}
    return replace(transfer, **changes)
