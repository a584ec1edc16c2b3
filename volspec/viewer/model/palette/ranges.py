"""Which material stands for which values: ranges of a transfer function's points.

panel -> [ranges] -> TransferFunction -> raycast
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from volspec.transfer import TransferFunction
from volspec.transfer.mixes import Mix, Point
from volspec.viewer.model.transfer.parts import MOST_PARTS


@dataclass(frozen=True, slots=True)
class Range:
    """Points in a row that have one material.

    Parameters
    ----------
    low, high : float
        Values of the first and the last.
    material : str
        Or several, as a mix is written.
    first, last : int
        Numbers of the points.
    """

    low: float
    high: float
    material: str
    first: int
    last: int


def ranges(curve: TransferFunction) -> tuple[Range, ...]:
    """The materials in the order of their values."""
    found: list[Range] = []
    for number, (value, _, mix) in enumerate(curve.points):
        name = _named(mix)
        if found and found[-1].material == name:
            found[-1] = replace(found[-1], high=value, last=number)
        else:
            found.append(Range(value, value, name, number, number))
    return tuple(found)


def assigned(curve: TransferFunction, low: float, high: float, material: str) -> TransferFunction:
    """A material for all values from ``low`` to ``high``; opacities stay.

    At both ends stand two points of one value, so that the material begins and ends there at once.
    As it is where the material is unknown, the range is empty, or there are too many points.
    """
    if material not in curve.materials or not low < high:
        return curve
    points = list(curve.points)
    before = [point for point in points if point[0] < low]
    after = [point for point in points if point[0] > high]
    inside = [(v, o, material) for v, o, _ in points if low < v < high]
    # At a step there are several points of one value: what holds below it, and above.
    start = [point for point in points if point[0] == low] or [_at(points, low)]
    end = [point for point in points if point[0] == high] or [_at(points, high)]
    first, last = (low, start[-1][1], material), (high, end[0][1], material)
    left = [start[0]] if before and _named(start[0][2]) != material else []
    right = [end[-1]] if after and _named(end[-1][2]) != material else []
    made = [*before, *left, first, *inside, last, *right, *after]
    return curve if len(made) > MOST_PARTS[TransferFunction] else replace(curve, points=made)


def recast(curve: TransferFunction, number: int, material: str) -> TransferFunction:
    """Another material for one of the `ranges`; its points keep value and opacity."""
    own = ranges(curve)
    if material not in curve.materials or not 0 <= number < len(own):
        return curve
    first, last = own[number].first, own[number].last
    points = [
        (v, o, material if first <= i <= last else mix)
        for i, (v, o, mix) in enumerate(curve.points)
    ]
    return replace(curve, points=points)


def _named(mix: Mix) -> str:
    if isinstance(mix, str):
        return mix
    shares = [(name, share) for name, share in mix.items() if share > 0]
    if len(shares) == 1 and shares[0][1] == 1.0:
        return shares[0][0]
    return " + ".join(f"{share:.0%} {name}" for name, share in shares)


def _at(points: list[Point], value: float) -> Point:
    """The curve at a value, as a point: opacity and mix run linearly between points."""
    values = [point[0] for point in points]
    opacity = float(np.interp(value, values, [point[1] for point in points]))
    after = int(np.searchsorted(values, value))
    one, two = points[max(after - 1, 0)], points[min(after, len(points) - 1)]
    if _named(one[2]) == _named(two[2]) or two[0] <= one[0]:
        return value, opacity, two[2]
    share = (value - one[0]) / (two[0] - one[0])
    mixed: dict[str, float] = {}
    for mix, part in ((one[2], 1.0 - share), (two[2], share)):
        for name, own in ({mix: 1.0} if isinstance(mix, str) else mix).items():
            mixed[name] = mixed.get(name, 0.0) + part * own
    return value, opacity, {name: min(own, 1.0) for name, own in mixed.items() if own > 0}
