"""Conversion of a transfer function to another kind: points, regions, surfaces.

    Transfer -> [transfer_convert] -> Transfer

The conversion goes through bands: ranges of values that look alike. A band of a curve is a run
of points with the same main material and similar opacity.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from volspec.transfer import (
    MAX_SURFACES,
    Isosurfaces,
    Mix,
    Point,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
    mix_weights,
)
from volspec.viewer.model.transfer_parts import KINDS, MAX_PARTS, Kind
from volspec.viewer.model.view import clamp

# Names of bands in messages, by the kind that is converted.
_BANDS = {"points": "ranges of the curve", "regions": "regions", "surfaces": "surfaces"}
# Opacities of one band differ by no more than this factor.
_ALIKE = 4.0
# Fractions of the range: half a surface's band, and how far an endless band reaches beyond it.
_THIN, _OVER = 0.01, 0.12
# Fraction of the range over which a hard side of a region rises.
_EDGE = 1e-3
# A surface is as opaque as this many steps of what lies behind it.
_DEPTH = 8
_SOFTEST = 0.02
# The factor over gradients at which boundaries begin.
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


def transfer_kind(transfer: Transfer) -> Kind:
    """Return the kind of a transfer function."""
    return KINDS[type(transfer)]


def convert(transfer: Transfer, kind: Kind, span: tuple[float, float]) -> Transfer:
    """Return the most similar transfer function of another kind, for values within a span.

    It is returned unchanged if it has this kind, or if either kind is labels, which are not values.
    """
    if not _is_convertible(transfer, kind):
        return transfer
    bands = _bands(transfer, span)
    step_mm = getattr(transfer, "reference_step_mm", None)
    if kind == "regions":
        regions = [_region(band) for band in _most_visible(bands, MAX_PARTS[TransferFunction2D])]
        return TransferFunction2D(regions, transfer.materials, transfer.basis, step_mm)
    if kind == "surfaces":
        return Isosurfaces(_surfaces(bands), transfer.materials, transfer.basis)
    return TransferFunction(_points(bands), transfer.materials, transfer.basis, step_mm)


def conversion_losses(transfer: Transfer, kind: Kind, span: tuple[float, float]) -> str:
    """Return a message on the parts that `convert` leaves out; empty if there are none."""
    if not _is_convertible(transfer, kind):
        return ""
    losses = []
    if isinstance(transfer, TransferFunction):
        if transfer.filters:
            losses.append(f"the filters of {', '.join(transfer.filters)}")
        if transfer.gradient_opacity and kind == "surfaces":
            losses.append("opacity by gradient")
    regions = transfer.regions if isinstance(transfer, TransferFunction2D) else ()
    if any(region.gradients != _ANY_GRADIENT for region in regions):
        losses.append("the regions' gradients")
    if kind != "points":
        bands = _bands(transfer, span)
        room = MAX_PARTS[TransferFunction2D]
        left = min(len(bands), room) if kind == "regions" else len(_surfaces(bands))
        if gone := len(bands) - left:
            name = _BANDS[transfer_kind(transfer)]
            losses.append(f"{gone} of {len(bands)} {name}, the least visible ones")
    return f"Left out: {'; '.join(losses)}. Ctrl+Z restores the transfer function" if losses else ""


def _is_convertible(transfer: Transfer, kind: Kind) -> bool:
    current = transfer_kind(transfer)
    return kind != current and "labels" not in (kind, current)


def _bands(transfer: Transfer, span: tuple[float, float]) -> list[Band]:
    if isinstance(transfer, TransferFunction2D):
        bands = []
        for region in transfer.regions:
            low, high = region.values
            half, edge = (high - low) / 2, _EDGE * (span[1] - span[0])
            ramp = max(region.softness * half, min(edge, half))
            bands.append(Band(low, high, ramp, region.opacity, mix_weights(region.material)))
        return bands
    if isinstance(transfer, Isosurfaces):
        half = _THIN * (span[1] - span[0])
        return [
            Band(
                value - half,
                value + half,
                half,
                1 - (1 - opacity) ** (1 / _DEPTH),
                mix_weights(mix),
            )
            for value, opacity, mix in transfer.surfaces
        ]
    assert isinstance(transfer, TransferFunction)
    return _bands_of_curve(transfer, span)


def _bands_of_curve(curve: TransferFunction, span: tuple[float, float]) -> list[Band]:
    runs = _runs(curve.points)
    if not runs:  # nothing is visible, but a transfer function needs a part
        runs = [range(len(curve.points))]
    reach = _OVER * (span[1] - span[0])
    # Beyond its ends a curve is constant.
    values = [value for value, _, _ in curve.points]
    before, after = min(values[0], span[0]) - reach, max(values[-1], span[1]) + reach
    bands = []
    for run in runs:
        left = _end(curve.points, run[0], run[0] - 1, before)
        right = _end(curve.points, run[-1], run[-1] + 1, after)
        right = max(right, left + _THIN * (span[1] - span[0]))
        ramp = values[run[0]] - left if run[0] else 0.0
        opacities = [curve.points[i][1] for i in run]
        weights = opacities if any(opacities) else [1.0] * len(run)
        mix = _mean_mix(weights, [curve.points[i][2] for i in run])
        bands.append(Band(left, right, ramp, float(np.mean(opacities)), mix, _gradients(curve)))
    return bands


def _end(points: Sequence[Point], last: int, following: int, beyond: float) -> float:
    """Return the value at which a run ends, between its last point and the one that follows.

    A run includes the whole of a slope to opacity 0, and half of one to another run.
    """
    if not 0 <= following < len(points):
        return beyond
    value, opacity, _ = points[following]
    return value if opacity <= 0 else (points[last][0] + value) / 2


def _runs(points: Sequence[Point]) -> list[range]:
    """Return runs of visible points with the same main material and similar opacity."""
    runs: list[range] = []
    for i, (_, opacity, mix) in enumerate(points):
        if opacity <= 0:
            continue
        if runs and runs[-1].stop == i:
            _, first, first_mix = points[runs[-1][0]]
            alike = max(first, opacity) <= _ALIKE * min(first, opacity)
            if alike and _main(mix) == _main(first_mix):
                runs[-1] = range(runs[-1].start, i + 1)
                continue
        runs.append(range(i, i + 1))
    return runs


def _main(mix: Mix) -> str:
    weights = mix_weights(mix)
    return max(weights, key=lambda name: weights[name])


def _mean_mix(weights: Sequence[float], mixes: Iterable[Mix]) -> dict[str, float]:
    """Return the weighted mean of mixes; its shares sum to at most 1 despite rounding."""
    mix: dict[str, float] = {}
    for weight, part in zip(weights, mixes, strict=True):
        for name, fraction in mix_weights(part).items():
            mix[name] = mix.get(name, 0.0) + weight * fraction
    total = max(sum(mix.values()), sum(weights))
    return {name: fraction / total for name, fraction in mix.items()}


def _gradients(curve: TransferFunction) -> tuple[float, float]:
    if not curve.gradient_opacity:
        return _ANY_GRADIENT
    gradients, factors = np.array(curve.gradient_opacity).T
    over = np.flatnonzero(factors >= _HALF)
    if factors[0] >= _HALF or not len(over):
        return _ANY_GRADIENT
    return float(np.interp(_HALF, factors[: over[0] + 1], gradients[: over[0] + 1])), math.inf


def _region(band: Band) -> Region:
    softness = clamp(2 * band.ramp / (band.high - band.low), _SOFTEST, 1.0)
    return Region((band.low, band.high), band.gradients, band.opacity, dict(band.mix), softness)


def _surfaces(bands: Sequence[Band]) -> list[Point]:
    by_value: dict[float, Point] = {}
    for band in _most_visible(bands, MAX_SURFACES):
        value = min(band.low + band.ramp / 2, band.high)
        by_value.setdefault(value, (value, 1 - (1 - band.opacity) ** _DEPTH, dict(band.mix)))
    return list(by_value.values())


def _most_visible(bands: Sequence[Band], count: int) -> list[Band]:
    """Return the bands of greatest opacity times width, in their order."""

    def area(i: int) -> float:
        return bands[i].opacity * (bands[i].high - bands[i].low)

    return [bands[i] for i in sorted(sorted(range(len(bands)), key=area, reverse=True)[:count])]


def _points(bands: Sequence[Band]) -> list[Point]:
    """Return a curve through the bands' corners; overlapping bands add up as regions do."""
    corners = sorted({x for b in bands for x in (b.low, b.low + b.ramp, b.high - b.ramp, b.high)})
    points: list[Point] = []
    for x in corners:
        heights = [_height(band, x) for band in bands]
        if any(heights):
            mix = _mean_mix(heights, [band.mix for band in bands])
            points.append((x, float(1 - np.prod([1 - height for height in heights])), mix))
        else:
            nearest = min(bands, key=lambda b: max(b.low - x, x - b.high, 0.0))
            points.append((x, 0.0, dict(nearest.mix)))
    return _simplify(points, MAX_PARTS[TransferFunction])


def _simplify(points: list[Point], max_points: int) -> list[Point]:
    """Reduce a curve to at most ``max_points`` points with the least change; its ends stay.

    By Visvalingam & Whyatt (1993), "Line generalisation by repeated elimination of points",
    The Cartographic Journal 30(1), 46-51.
    """

    def area(i: int) -> float:
        """Return the area that a point adds, relative to opacity, so that faint bands count."""
        (x0, y0, _), (x1, y1, _), (x2, y2, _) = points[i - 1 : i + 2]
        return abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)) / (max(y0, y1, y2) or 1.0)

    while len(points) > max_points:
        del points[min(range(1, len(points) - 1), key=area)]
    return points


def _height(band: Band, value: float) -> float:
    inside = min(value - band.low, band.high - value)
    if inside <= 0:
        return 0.0
    return band.opacity * (min(inside / band.ramp, 1.0) if band.ramp > 0 else 1.0)
