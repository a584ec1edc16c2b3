"""One kind of transfer function made from another: points, regions, surfaces.

    Transfer -> [transfer_convert] -> Transfer

Between them are bands: ranges of values that look alike. From a curve a band is a run of points
of one material whose opacities are near to each other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from volspec.transfer import (
    MAX_SURFACES,
    Isosurfaces,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.transfer.mixes import Point, shares_of
from volspec.viewer.model.transfer_parts import MOST_PARTS

Kind = Literal["points", "regions", "surfaces", "labels"]
KINDS: dict[type, Kind] = {
    TransferFunction: "points",
    TransferFunction2D: "regions",
    Isosurfaces: "surfaces",
}
# What bands are of a kind that is made into another.
_BANDS = {"points": "ranges of the curve", "regions": "regions", "surfaces": "surfaces"}
# Points of one band differ by no more than this factor.
_ALIKE = 4.0
# Of the range: half a surface's band, and how far one that never ends reaches beyond it.
_THIN, _OVER = 0.01, 0.12
# Of the range: over so much a hard side rises, as points of one value would only follow it.
_EDGE = 1e-3
# A surface is as opaque as so many steps of what lies behind it.
_DEPTH = 8
_SOFTEST = 0.02
# Where opacity rises as gradients do, boundaries begin here.
_HALF = 0.5
_ANY_GRADIENT = 0.0, math.inf


@dataclass(frozen=True, slots=True)
class Band:
    """Values that look alike: opacity rises over ``ramp`` from either end."""

    low: float
    high: float
    ramp: float
    opacity: float
    mix: Mapping[str, float]
    gradients: tuple[float, float] = _ANY_GRADIENT


def kind_of(transfer: Transfer) -> Kind:
    """What a transfer function is made of."""
    return KINDS.get(type(transfer), "labels")


def convert(transfer: Transfer, kind: Kind, span: tuple[float, float]) -> Transfer:
    """The transfer function of another kind that looks most like one.

    Parameters
    ----------
    transfer : Transfer
    kind : str
    span : (low, high)
        Of the volume's values.

    Returns
    -------
    Transfer
        Itself where it is of this kind already, or of labels, which are no values.
    """
    if "labels" in (kind, kind_of(transfer)) or kind == kind_of(transfer):
        return transfer
    bands = _bands(transfer, span)
    step_mm = getattr(transfer, "reference_step_mm", None)
    if kind == "regions":
        shown = _most_seen(bands, MOST_PARTS[TransferFunction2D])
        regions = [_region(band) for band in shown]
        return TransferFunction2D(regions, transfer.materials, transfer.basis, step_mm)
    if kind == "surfaces":
        return Isosurfaces(_surfaces(bands), transfer.materials, transfer.basis)
    points = _points(bands)
    return TransferFunction(points, transfer.materials, transfer.basis, step_mm)


def conversion_losses(transfer: Transfer, kind: Kind, span: tuple[float, float]) -> str:
    """What of a transfer function another kind has no room for, in words; empty where nothing.

    Parameters
    ----------
    transfer : Transfer
        As it is before it is `convert`.
    kind : str
    span : (low, high)
    """
    own = kind_of(transfer)
    if "labels" in (kind, own) or kind == own:
        return ""
    said = []
    if isinstance(transfer, TransferFunction):
        if transfer.filters:
            said.append(f"the filters of {', '.join(transfer.filters)}")
        if transfer.gradient_opacity and kind == "surfaces":
            said.append("opacity by gradient")
    regions = transfer.regions if isinstance(transfer, TransferFunction2D) else ()
    if any(region.gradients != _ANY_GRADIENT for region in regions):
        said.append("the regions' gradients")
    if kind != "points":
        bands = _bands(transfer, span)
        room = MOST_PARTS[TransferFunction2D]
        kept = min(len(bands), room) if kind == "regions" else len(_surfaces(bands))
        if gone := len(bands) - kept:
            said.append(f"{gone} of {len(bands)} {_BANDS[own]}, which show least")
    return f"Left out: {'; '.join(said)}. Ctrl+Z brings all back" if said else ""


def _bands(transfer: Transfer, span: tuple[float, float]) -> list[Band]:
    if isinstance(transfer, TransferFunction2D):
        found = []
        for region in transfer.regions:
            low, high = region.values
            half, edge = (high - low) / 2, _EDGE * (span[1] - span[0])
            ramp = max(region.softness * half, min(edge, half))
            found.append(Band(low, high, ramp, region.opacity, shares_of(region.material)))
        return found
    if isinstance(transfer, Isosurfaces):
        half = _THIN * (span[1] - span[0])
        return [
            Band(
                value - half, value + half, half, 1 - (1 - opacity) ** (1 / _DEPTH), shares_of(mix)
            )
            for value, opacity, mix in transfer.surfaces
        ]
    assert isinstance(transfer, TransferFunction)
    return _bands_of_curve(transfer, span)


def _bands_of_curve(curve: TransferFunction, span: tuple[float, float]) -> list[Band]:
    runs = _runs(curve.points)
    if not runs:  # nothing is seen, and something must be there
        runs = [range(len(curve.points))]
    reach = _OVER * (span[1] - span[0])
    # Beyond its ends a curve goes on as it is.
    values = [value for value, _, _ in curve.points]
    before, after = min(values[0], span[0]) - reach, max(values[-1], span[1]) + reach
    bands = []
    for run in runs:
        left = _end(curve.points, run[0], run[0] - 1, before)
        right = _end(curve.points, run[-1], run[-1] + 1, after)
        right = max(right, left + _THIN * (span[1] - span[0]))
        ramp = values[run[0]] - left if run[0] else 0.0
        opacity, mix = _mean([curve.points[i] for i in run])
        bands.append(Band(left, right, ramp, opacity, mix, _gradients(curve)))
    return bands


def _end(points: Sequence[Point], of: int, beside: int, beyond: float) -> float:
    """Where a run that ends at one point ends: on the way to the one beside it.

    It takes the whole of a slope to nothing, and half of one to another run.
    """
    if not 0 <= beside < len(points):
        return beyond
    value, opacity, _ = points[beside]
    return value if opacity <= 0 else (points[of][0] + value) / 2


def _runs(points: Sequence[Point]) -> list[range]:
    """Runs of visible points of one main material and of like opacity."""
    runs: list[range] = []
    for i, (_, opacity, mix) in enumerate(points):
        if opacity <= 0:
            continue
        if runs and runs[-1].stop == i:
            _, first, own = points[runs[-1][0]]
            alike = max(first, opacity) <= _ALIKE * min(first, opacity)
            if alike and _main(mix) == _main(own):
                runs[-1] = range(runs[-1].start, i + 1)
                continue
        runs.append(range(i, i + 1))
    return runs


def _main(mix: Mapping[str, float] | str) -> str:
    shares = shares_of(mix)
    return max(shares, key=lambda name: shares[name])


def _mean(points: Sequence[Point]) -> tuple[float, dict[str, float]]:
    """Mean opacity, and the mix weighted by it."""
    opacities = np.array([opacity for _, opacity, _ in points])
    weights = opacities / opacities.sum() if opacities.any() else np.ones(len(points)) / len(points)
    mix: dict[str, float] = {}
    for weight, (_, _, own) in zip(weights, points, strict=True):
        for name, share in shares_of(own).items():
            mix[name] = mix.get(name, 0.0) + float(weight) * share
    return float(opacities.mean()), _whole(mix)


def _whole(mix: dict[str, float]) -> dict[str, float]:
    """Shares that sum to no more than 1, whatever rounding did."""
    total = max(sum(mix.values()), 1.0)
    return {name: share / total for name, share in mix.items()}


def _gradients(curve: TransferFunction) -> tuple[float, float]:
    if not curve.gradient_opacity:
        return _ANY_GRADIENT
    at, factors = np.array(curve.gradient_opacity).T
    over = np.flatnonzero(factors >= _HALF)
    if factors[0] >= _HALF or not len(over):
        return _ANY_GRADIENT
    return float(np.interp(_HALF, factors[: over[0] + 1], at[: over[0] + 1])), math.inf


def _region(band: Band) -> Region:
    softness = min(max(2 * band.ramp / (band.high - band.low), _SOFTEST), 1.0)
    return Region((band.low, band.high), band.gradients, band.opacity, dict(band.mix), softness)


def _surfaces(bands: Sequence[Band]) -> list[Point]:
    found: dict[float, Point] = {}
    for band in _most_seen(bands, MAX_SURFACES):
        at = min(band.low + band.ramp / 2, band.high)
        found.setdefault(at, (at, 1 - (1 - band.opacity) ** _DEPTH, dict(band.mix)))
    return list(found.values())


def _most_seen(bands: Sequence[Band], most: int) -> list[Band]:
    """Those that show most, in their order, where there are too many."""

    def shown(i: int) -> float:
        return bands[i].opacity * (bands[i].high - bands[i].low)

    return [bands[i] for i in sorted(sorted(range(len(bands)), key=shown, reverse=True)[:most])]


def _points(bands: Sequence[Band]) -> list[Point]:
    """A curve through the bands' corners; where bands overlap they add up as regions do."""
    corners = sorted({at for b in bands for at in (b.low, b.low + b.ramp, b.high - b.ramp, b.high)})
    points: list[Point] = []
    for at in corners:
        heights = [(band, _height(band, at)) for band in bands]
        total = sum(height for _, height in heights)
        if total > 0:
            mix: dict[str, float] = {}
            for band, height in heights:
                for name, share in band.mix.items():
                    mix[name] = mix.get(name, 0.0) + share * height / total
            points.append((at, float(1 - np.prod([1 - h for _, h in heights])), _whole(mix)))
        else:
            nearest = min(bands, key=lambda b: max(b.low - at, at - b.high, 0.0))
            points.append((at, 0.0, dict(nearest.mix)))
    return _simplified(points, MOST_PARTS[TransferFunction])


def _simplified(points: list[Point], most: int) -> list[Point]:
    """So many points that leave the curve most like it was; its ends stay.

    References
    ----------
    Visvalingam & Whyatt (1993), "Line generalisation by repeated elimination of points",
    The Cartographic Journal 30(1), 46-51.
    """
    points = list(points)

    def area(i: int) -> float:
        """Of the triangle that goes with a point, by its opacity: faint bands count as well."""
        (x0, y0, _), (x1, y1, _), (x2, y2, _) = points[i - 1 : i + 2]
        return abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / (max(y0, y1, y2) or 1.0)

    while len(points) > most:
        del points[min(range(1, len(points) - 1), key=area)]
    return points


def _height(band: Band, at: float) -> float:
    inside = min(at - band.low, band.high - at)
    if inside <= 0:
        return 0.0
    return band.opacity * (min(inside / band.ramp, 1.0) if band.ramp > 0 else 1.0)
