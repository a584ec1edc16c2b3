"""Steps chosen by the error that they leave in a picture, as casts of few rays measure it.

    volume, table, RaycastSpec.quality -> [quality] -> step_mm -> cast

Rays meet the kinks of cells and of the transfer function at random places of their steps: the error
falls about with the square of the step, and two casts of which one has half the step differ by the
error of the longer. Steps are halved until that is below the target, and the one that meets it is
interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Quality = Literal["fast", "balanced", "exact"]
"""Names of `RaycastSpec.quality`."""


class Picture(NamedTuple):
    """Result of a cast with a step."""

    coefficients: NDArray[np.floating]  # (H, W, C), times alpha
    alpha: NDArray[np.float32]  # (H, W)


class Target(NamedTuple):
    """Error that casts may have, and their longest step.

    Attributes
    ----------
    error : float
        RMS over channels and the pixels that see something; 1 is a white surface.
    longest : float
        In smallest spacings. What few rays miss, such as a thin wall, is not skipped for that.
    """

    error: float
    longest: float


# Next codes of a display of 8 bits differ by 0.004 at middle grey and by 0.009 near white.
TARGETS: dict[Quality, Target] = {
    "fast": Target(0.02, 2.0),
    "balanced": Target(0.005, 1.0),
    "exact": Target(0.0005, 0.5),
}
SHORTEST = 1 / 16
"""Shortest step that is chosen, in smallest spacings."""
# Chosen steps are a power of 2 by this fraction, so that all devices choose the same.
_PARTS = 4
# Opacity from which a pixel counts.
_SEEN = 0.01


class Chosen(NamedTuple):
    """A step in smallest spacings, and the error that it leaves about."""

    step: float
    error: float


def target_of(quality: Quality | float) -> Target:
    """Return the target of a name, or of an error."""
    if isinstance(quality, str):
        return TARGETS[quality]
    return Target(quality, TARGETS["balanced"].longest)


def choose_step(
    probe: Callable[[float], Picture], target: Target, shortest: float = SHORTEST
) -> Chosen:
    """Return the longest step that leaves no more than an error, or else the shortest.

    Parameters
    ----------
    probe : callable
        Casts with a step in smallest spacings.
    target : Target
    shortest : float
        In smallest spacings.
    """
    step = target.longest
    last = probe(step)
    longer: Chosen | None = None
    while True:
        finer = probe(0.5 * step)
        now = Chosen(step, _difference(last, finer))
        if now.error <= target.error:
            return now if longer is None else _between(now, longer, target.error)
        if step < 2.0 * shortest:
            return now
        longer, step, last = now, 0.5 * step, finer


def _difference(one: Picture, other: Picture) -> float:
    """Return the RMS of the differences where the second sees something."""
    seen = other.alpha > _SEEN
    if not seen.any():
        return 0.0
    apart = one.coefficients[seen] - other.coefficients[seen]
    return float(np.sqrt(np.mean(apart**2, dtype=np.float64)))


def _between(now: Chosen, longer: Chosen, error: float) -> Chosen:
    """Return the step between two that leaves an error, by a power law."""
    order = math.log(longer.error / max(now.error, 1e-12), longer.step / now.step)
    step = now.step * (error / max(now.error, 1e-12)) ** (1.0 / order)
    step = 2.0 ** (math.floor(_PARTS * math.log2(step) + 1e-9) / _PARTS)
    return Chosen(step, longer.error * (step / longer.step) ** order)
