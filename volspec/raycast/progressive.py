"""Passes from a coarse picture to the whole, and the pace at which coarse ones follow a camera.

times of casts -> [pace] -> Pass -> RaycastSpec, size -> raycast
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

from volspec.raycast.spec import RaycastSpec
from volspec.raycast.step_search import Quality
from volspec.volume import Volume


class Pass(NamedTuple):
    """A cast on the way to the whole picture.

    Attributes
    ----------
    divisor : int
        Of the picture's sides.
    steps : {"own", "fast", "voxel", "none"}
        As the state asks; as quality "fast" does, long where opacities are gentle; or of a voxel,
        for which nothing is estimated first. None if a picture is reprojected from layers.
    layers : int
        Layers of opacity; the picture is as without them.
    baked : bool
        Layers have the opacities of the settings; otherwise the transfer function's own.
    """

    divisor: int
    steps: Literal["own", "fast", "voxel", "none"] = "own"
    layers: int = 0
    baked: bool = False

    def spec(self, base: RaycastSpec, volume: Volume) -> RaycastSpec:
        """Return the pass's settings; of a volume larger than memory, on the way, what is in it."""
        if base.layers != self.layers or (self.layers and base.opacities):
            opacities = {} if self.layers and not self.baked else base.opacities
            base = replace(base, layers=self.layers, opacities=opacities)
        if self.layers:
            base = replace(base, tile_ms=min(base.tile_ms, _LAYERS_TILE_MS))
        if volume.pyramid is not None and self != WHOLE:
            base = replace(base, level=len(volume.pyramid.levels) - 1)
        if self.steps == "own":
            return base
        coarse = replace(base, quality="fast", step_mm=None)
        if self.steps == "fast":
            return coarse
        return replace(coarse, step_mm=max(min(volume.spacing_mm), base.step_mm or 0.0))


WHOLE = Pass(1)


# Few sizes, as a viewer has textures for each.
DIVISORS = (1, 2, 3, 4, 6, 8)
# Coarse casts slower than the first become coarser; they become finer if that stays below the
# second. The gap allows for simultaneous drawing and for work that does not depend on the size.
SLOW_MS, QUICK_MS = 75.0, 45.0
# Of time steps that play, five to ten a second are enough; a mouse that turns the view wants more.
PLAY_SLOW_MS, PLAY_QUICK_MS = 180.0, 90.0
# A whole cast that takes longer gets a pass with longer steps before it.
STEP_MS = 900.0


# Of a pass with layers, which runs when nothing moves: a view that turns then waits for two bands.
_LAYERS_TILE_MS = 6.0


@dataclass(frozen=True, slots=True)
class Pace:
    """Divisor of a moving picture's sides, adapted to the times of casts.

    The time of a whole picture is 0 until it is known.

    >>> Pace().after(Pass(4), 100.0).divisor, Pace().after(Pass(4), 4.0).divisor
    (6, 2)
    """

    divisor: int = 4
    whole_ms: float = 0.0

    def after(self, finished: Pass, ms: float, plays: bool = False) -> Pace:
        """Return the pace after a cast that took this long; ``plays``: of a series that plays."""
        divisor = finished.divisor
        slow, quick = (PLAY_SLOW_MS, PLAY_QUICK_MS) if plays else (SLOW_MS, QUICK_MS)
        if finished == WHOLE:
            paced = replace(self, whole_ms=ms)
            return paced if self.divisor > 1 or ms <= slow else replace(paced, divisor=2)
        if divisor != self.divisor:
            return self
        index = DIVISORS.index(divisor)
        if ms > slow:
            return replace(self, divisor=DIVISORS[min(index + 1, len(DIVISORS) - 1)])
        finer = [n for n in DIVISORS[:index] if ms * (divisor / n) ** 2 < quick]
        return replace(self, divisor=finer[0]) if finer else self

    @property
    def moving(self) -> Pass:
        """The pass of a moving picture."""
        return Pass(self.divisor, "voxel") if self.divisor > 1 else WHOLE

    def to_whole(self, quality: Quality | float) -> tuple[Pass, ...]:
        """Return the passes from a coarse picture to the whole of a quality.

        Full size with long steps looks better than half the size, and takes as long.
        """
        if self.divisor <= 2 or self.whole_ms <= STEP_MS:
            return (WHOLE,)
        return (Pass(2) if quality == "fast" else Pass(1, "fast"), WHOLE)
