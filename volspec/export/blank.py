"""Frames that show nothing: all black, or clipped all over.

pixels -> [blank] -> one warning
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecWarning

# The share of what is covered, by opacity, from which on a frame shows nothing.
ALL = 0.999
# Rows and columns of a frame that are looked at, at least.
_SAMPLED = 128
# Linear light that an 8-bit code cannot tell from black, and from white.
_LEAST, _MOST = 1.5e-4, 0.995
_SAYS = {"black": "is all black", "clipped": "is clipped all over"}
_REMEDY = {
    "black": "too little light, or materials that reflect none of it: raise",
    "clipped": "too much light: lower",
}


@dataclass(slots=True)
class _Seen:
    """Opacity looked at, and how much of it is blank in which way."""

    light: str
    covered: float = 0.0
    blank: dict[str, float] = field(default_factory=lambda: dict.fromkeys(_SAYS, 0.0))


class Blanks:
    """Looks at frames as they are made, and tells of those that show nothing.

    Parameters
    ----------
    remedy : str
        What sets how bright frames are, for the message.
    """

    def __init__(self, remedy: str) -> None:
        self._remedy = remedy
        self._frames: dict[str, _Seen] = {}

    def look(
        self, name: str, light: str, pixels: NDArray[Any], alpha: NDArray[np.float32], side: int = 0
    ) -> None:
        """Look at a frame, or at the next rows of one.

        Parameters
        ----------
        name : str
            The frame's; rows of one name are one frame.
        light : str
            What lights it, for the message.
        pixels : (H, W, 3 or 4) uint8, uint16 or float
            Codes of a display; or linear light of 0 to 1, multiplied by the opacity that is fourth.
        alpha : (H, W)
            Opacity as cast: the backdrop alone is no picture.
        side : int
            The shorter of the whole frame, where these are some rows.
        """
        every = max(1, (side or min(alpha.shape)) // _SAMPLED)
        colours, cover = pixels[::every, ::every, :3], alpha[::every, ::every]
        if pixels.dtype.kind == "u":
            dark, bright = colours == 0, colours == np.iinfo(pixels.dtype).max
        else:
            scale = cover[..., None] if pixels.shape[2] == 4 else 1.0
            dark, bright = colours <= _LEAST * scale, colours >= _MOST * scale
        black = dark.all(axis=-1)
        seen = self._frames.setdefault(name, _Seen(light))
        seen.covered += float(cover.sum())
        seen.blank["black"] += float(cover[black].sum())
        seen.blank["clipped"] += float(cover[(dark | bright).all(axis=-1) & ~black].sum())

    def warn(self) -> None:
        """One warning for those that are black, one for those that are clipped, if there are."""
        for way, says in _SAYS.items():
            found = {
                name: seen.light
                for name, seen in self._frames.items()
                if seen.covered > 0.0 and seen.blank[way] >= ALL * seen.covered
            }
            if not found:
                continue
            name, light = next(iter(found.items()))
            rest = f", and {len(found) - 1} more" if len(found) > 1 else ""
            warnings.warn(
                f"{name} {says} under {light}{rest}; {_REMEDY[way]} {self._remedy}",
                VolspecWarning,
                stacklevel=2,
            )
