"""Changes that some transfer functions know: points, surfaces and regions placed and added.

transfer_edits -> [transfer_placing] -> Transfer -> raycast
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

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
from volspec.viewer.model.transfer_parts import MOST_PARTS

# Values nearer than this share of the span would make a table too fine.
_GAP = 1e-3
# Of a region: the narrowest, and one that is added, as shares of both axes.
_NARROWEST, _NEW = 0.01, 0.15
# Labels are listed one by one.
MOST_LABELS = 256
# Of a curve's factors over gradients: the most, and their least distance as a share of the axis;
# a table has too few rows for nearer ones.
MOST_FACTORS = 16
_FACTOR_GAP = 1 / 128
# Of the axis of gradients: where factors that are new rise from 0 to 1, so that boundaries stay.
_RISE = 0.05, 0.4


def move_point(
    curve: TransferFunction, index: int, value: float, opacity: float
) -> TransferFunction:
    """A point elsewhere: between its neighbours where they leave room, opacity 0 to 1."""
    points = list(curve.points)
    if not 0 <= index < len(points):
        return curve
    points[index] = _moved(points, index, value, opacity)
    return _sorted(curve, points)


def move_surface(surfaces: Isosurfaces, index: int, value: float, opacity: float) -> Isosurfaces:
    """A surface of another value, between its neighbours."""
    rows = list(surfaces.surfaces)
    if not 0 <= index < len(rows):
        return surfaces
    rows[index] = _moved(rows, index, value, opacity)
    return replace(surfaces, surfaces=rows)


def _moved(rows: list[Point], index: int, value: float, opacity: float) -> Point:
    """One of the rows between its neighbours."""
    gap = _GAP * max(rows[-1][0] - rows[0][0], 1e-6)
    value = _between([row[0] for row in rows], index, value, gap)
    return value, min(max(opacity, 0.0), 1.0), rows[index][2]


def _between(places: Sequence[float], index: int, to: float, gap: float) -> float:
    """Where one of some rising places ends that is moved: it stays where others leave no room."""
    if to == places[index]:
        return to
    low = places[index - 1] + gap if index > 0 else -math.inf
    high = places[index + 1] - gap if index < len(places) - 1 else math.inf
    return min(max(to, low), high) if low <= high else places[index]


def add_part(transfer: Transfer, value: float, opacity: float) -> Transfer:
    """One more point or surface, of the material of the nearest; or one more label."""
    opacity = min(max(opacity, 0.0), 1.0)
    if isinstance(transfer, LabelFunction):
        label = round(min(max(value, 0), MAX_LABEL))
        if label in transfer.labels or len(transfer.labels) >= MOST_LABELS:
            return transfer
        mix = list(transfer.labels.values())[-1][1]
        return replace(transfer, labels={**transfer.labels, label: (opacity, mix)})
    if isinstance(transfer, TransferFunction2D):
        return transfer
    rows = list(transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces)
    if len(rows) >= MOST_PARTS[type(transfer)]:
        return transfer
    nearest = min(rows, key=lambda row: abs(row[0] - value))
    row = (value, opacity, nearest[2])
    if isinstance(transfer, TransferFunction):
        return _sorted(transfer, [*rows, row])
    if abs(value - nearest[0]) <= _GAP * max(rows[-1][0] - rows[0][0], 1e-6):
        return transfer
    return replace(transfer, surfaces=[*rows, row])


def add_region(
    transfer: TransferFunction2D,
    value: float,
    gradient: float,
    span: tuple[float, float],
    top: float,
) -> TransferFunction2D:
    """One more region around a place, of the opacity and material of the last.

    Parameters
    ----------
    span : (low, high)
        Of the volume's values.
    top : float
        Where the axis of gradients ends.
    """
    if len(transfer.regions) >= MOST_PARTS[TransferFunction2D]:
        return transfer
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
    return replace(transfer, regions=[*transfer.regions, region])


def place_region(
    transfer: TransferFunction2D,
    index: int,
    values: tuple[float, float] | None,
    gradients: tuple[float, float] | None,
    span: tuple[float, float],
    top: float,
) -> TransferFunction2D:
    """A region with other bounds: kept in order, and no narrower than can be seen.

    An upper gradient at the axis' end or above is without end.
    """
    if not 0 <= index < len(transfer.regions):
        return transfer
    region = transfer.regions[index]
    if values is not None:
        room = span[1] - span[0]
        low, high = (min(max(v, span[0] - room), span[1] + room) for v in sorted(values))
        region = replace(region, values=(low, max(high, low + _NARROWEST * room)))
    if gradients is not None:
        least = _NARROWEST * top
        bottom, end = sorted(gradients)
        bottom = min(max(bottom, 0.0), top - least)
        end = max(end, bottom + least)
        region = replace(region, gradients=(bottom, end if end < top else math.inf))
    return _with_region(transfer, index, region)


def set_region_softness(
    transfer: TransferFunction2D, index: int, softness: float
) -> TransferFunction2D:
    """A region whose sides fall otherwise, 0 to 1."""
    if not 0 <= index < len(transfer.regions):
        return transfer
    region = replace(transfer.regions[index], softness=min(max(softness, 0.0), 1.0))
    return _with_region(transfer, index, region)


def _with_region(transfer: TransferFunction2D, index: int, region: Region) -> TransferFunction2D:
    regions = [*transfer.regions[:index], region, *transfer.regions[index + 1 :]]
    return replace(transfer, regions=regions)


def _sorted(curve: TransferFunction, points: list[Point]) -> TransferFunction:
    return replace(curve, points=sorted(points, key=lambda point: point[0]))


def with_gradient_factors(curve: TransferFunction, top: float) -> TransferFunction:
    """A curve whose opacity is multiplied by factors that rise with the gradient."""
    return replace(curve, gradient_opacity=((_RISE[0] * top, 0.0), (_RISE[1] * top, 1.0)))


def gradient_top(curve: TransferFunction, top: float) -> float:
    """Where the axis of a curve's factors ends: as the volume's gradients do, or at the last."""
    return max(top, curve.gradient_opacity[-1][0]) if curve.gradient_opacity else top


def move_factor(
    curve: TransferFunction, index: int, gradient: float, factor: float, top: float
) -> TransferFunction:
    """One of the factors elsewhere, between its neighbours.

    Parameters
    ----------
    top : float
        Where the volume's gradients end.
    """
    factors = list(curve.gradient_opacity or ())
    if not 0 <= index < len(factors):
        return curve
    end = gradient_top(curve, top)
    gap = _FACTOR_GAP * end
    # The last is above 0, or there would be no axis.
    least = gap if index == len(factors) - 1 else 0.0
    places = [place for place, _ in factors]
    gradient = _between(places, index, min(max(gradient, least), end), gap)
    factors[index] = gradient, min(max(factor, 0.0), 1.0)
    return replace(curve, gradient_opacity=factors)


def add_factor(
    curve: TransferFunction, gradient: float, factor: float, top: float
) -> TransferFunction:
    """One more factor, where others leave it room."""
    factors = list(curve.gradient_opacity or ())
    end = gradient_top(curve, top)
    gradient = min(max(gradient, 0.0), end)
    near = min((abs(place - gradient) for place, _ in factors), default=0.0)
    if near < _FACTOR_GAP * end or len(factors) >= MOST_FACTORS:
        return curve
    factors.append((gradient, min(max(factor, 0.0), 1.0)))
    return replace(curve, gradient_opacity=sorted(factors))


def remove_factor(curve: TransferFunction, index: int) -> TransferFunction:
    """Without one of the factors; two stay."""
    factors = list(curve.gradient_opacity or ())
    if len(factors) <= 2 or not 0 <= index < len(factors):
        return curve
    del factors[index]
    return replace(curve, gradient_opacity=factors)
