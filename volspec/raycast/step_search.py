"""Steps chosen by the error that they leave in a picture, as casts of few of its rays measure it.

    volume, table, camera, RaycastSpec.quality -> [quality] -> step_mm -> cast

A step's error is the difference of its picture and a reference: a cast with half the step, whose
rays are shifted by random parts of it. Unshifted, rays that all meet a flat body at the same part
of a step would agree by chance. What shifts do not even out, such as a greatest value that samples
miss, the reference has itself in part; by that part errors fall when steps are halved. Steps are
halved until the error is below the target; of those between the last two, the longest that meets it
in a cast is taken. Isosurfaces have no such error: no step misses them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Quality = Literal["fast", "balanced", "exact"]
"""Names of `RaycastSpec.quality`."""
Size = tuple[int, int]


class Trial(NamedTuple):
    """Result of a cast with a step."""

    coefficients: NDArray[np.floating]  # (H, W, C), times alpha
    alpha: NDArray[np.float32]  # (H, W)

    @property
    def visible(self) -> int:
        """Number of pixels that see something."""
        return int(np.count_nonzero(self.alpha > _SEEN))


class ErrorTarget(NamedTuple):
    """Error that casts may have, and their longest step.

    Attributes
    ----------
    error : float
        RMS over channels and the pixels that see something, by that of a white surface which faces
        all lights.
    longest : float
        In smallest spacings. What few rays miss, such as a thin wall, is not skipped for that.
    """

    error: float
    longest: float


# Next codes of a display of 8 bits differ by 0.004 at middle grey and by 0.009 near white.
TARGETS: dict[Quality, ErrorTarget] = {
    "fast": ErrorTarget(0.02, 2.0),
    "balanced": ErrorTarget(0.005, 1.0),
    "exact": ErrorTarget(0.0005, 0.5),
}
SHORTEST = 1 / 16
"""Shortest step that is chosen, in smallest spacings."""
# Chosen steps are a power of 2 by this fraction, so that all devices choose the same.
_PARTS = 4
# Opacity from which a pixel counts.
_SEEN = 0.01
# Pixels of a trial cast; more if fewer than these see something, or fewer yet have the error.
_PIXELS, _MANY_SEEN, _MANY_WRONG = 2304, 1000, 20
# Most of an error that is taken to stay when its step is halved; and the part of a target that a
# difference must not pass, to be below it in any case.
_MAX_ALIKE = 0.6
_SURELY = 1.0 - _MAX_ALIKE


class StepChoice(NamedTuple):
    """A step in smallest spacings, the error that it leaves about, and how many pixels have it."""

    step: float
    error: float
    pixels: float


def target_of(quality: Quality | float) -> ErrorTarget:
    """Return the target of a name, or of an error."""
    if isinstance(quality, str):
        return TARGETS[quality]
    return ErrorTarget(quality, TARGETS["balanced"].longest)


def choose_step(
    cast: Callable[[float, Size, bool], Trial],
    size: Size,
    target: ErrorTarget,
    shortest: float = SHORTEST,
) -> StepChoice:
    """Return the longest step that leaves no more than an error, or else the shortest.

    Parameters
    ----------
    cast : callable
        Casts with a step in smallest spacings, in fewer pixels, as a reference if True; a white
        surface has coefficient 1.
    size : (width, height)
        Pixels of the whole picture.
    target : Target
    shortest : float
        In smallest spacings.
    """
    picture, few = cache(cast), _few_of(size, _PIXELS)
    if (visible := picture(0.5 * target.longest, few, True).visible) < _MANY_SEEN:
        few = _few_of(size, _PIXELS * _MANY_SEEN // max(visible, _MANY_SEEN // 64))
    choice = _choose(picture, few, target, shortest)
    if choice.pixels < _MANY_WRONG and few != size:
        choice = _choose(picture, _few_of(size, 4 * math.prod(few)), target, shortest)
    return choice


def _few_of(size: Size, count: int) -> Size:
    """Return the size of a picture alike with about some pixels, no more than it has."""
    scale = min(math.sqrt(count / math.prod(size)), 1.0)
    width, height = (max(round(side * scale), 1) for side in size)
    return width, height


def _choose(
    cast: Callable[[float, Size, bool], Trial], size: Size, target: ErrorTarget, shortest: float
) -> StepChoice:
    def picture(step: float) -> Trial:
        return cast(step, size, False)

    def reference(step: float) -> Trial:
        return cast(step, size, True)

    step = target.longest
    while True:
        error, pixels = _difference(picture(step), reference(0.5 * step))
        alike = 0.0
        if error <= target.error and (step < target.longest or error > _SURELY * target.error):
            top = min(2.0 * step, target.longest)
            alike = _part_alike(picture(top), reference(0.5 * top), reference(0.25 * top))
            error /= 1.0 - alike
        if error <= target.error or step < 2.0 * shortest:
            break
        step *= 0.5
    if error <= target.error and step < target.longest:
        for part in range(_PARTS - 1, 0, -1):
            longer = step * 2.0 ** (part / _PARTS)
            left, count = _difference(picture(longer), reference(0.5 * step))
            left /= 1.0 - alike ** (1.0 + part / _PARTS)
            if left <= target.error:
                return StepChoice(longer, left, count)
    return StepChoice(step, error, pixels)


def _part_alike(longest: Trial, middle: Trial, shortest: Trial) -> float:
    """Return the part of an error that stays when the step is halved, of a step and references."""
    to_middle, more = (_squares(longest, other).mean() for other in (middle, shortest))
    return float(np.clip(math.sqrt(more / max(to_middle, 1e-24)) - 1.0, 0.0, _MAX_ALIKE))


def _difference(one: Trial, other: Trial) -> tuple[float, float]:
    """Return the RMS of the differences, and the number of pixels that have most of it.

    By that number, two deviations more: the picture has such pixels between those of a trial.
    """
    squares = _squares(one, other)
    mean = float(squares.mean())
    if mean == 0.0:
        return 0.0, np.inf
    pixels = squares.size * mean**2 / float(np.mean(squares**2))
    return math.sqrt(mean * (1.0 + 2.0 / math.sqrt(pixels))), pixels


def _squares(one: Trial, other: Trial) -> NDArray[np.float64]:
    """Return the mean squares of the differences where the second sees something; else 0."""
    visible = other.alpha > _SEEN
    if not visible.any():
        return np.zeros(1)
    difference = one.coefficients[visible] - other.coefficients[visible]
    return np.asarray(np.mean(difference**2, axis=-1, dtype=np.float64))
