"""A figure in a document: its words, and what computes it."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display.spaces import SPACES, ColourSpace
from volspec.appearance.models.lab import cielab, delta_E_2000

Array = NDArray[np.float64]
Figures = Sequence[float]

ROOT = Path(__file__).resolve().parent.parent.parent
_NUMBER = r"\**(\d*\.?\d+(?:e-?\d+)?)(?!\.?\d)\**"


@dataclass(frozen=True, slots=True)
class Claim:
    """Figures in a page's text, and what computes them.

    Parameters
    ----------
    name : str
    page : str
        ``README.md``, or a file of ``docs``.
    text : str
        Words of the page, with ``{}`` for each figure.
    compute : callable
        Returns the figures in their order, in the page's units.
    slow : bool
        True if it takes more than three seconds.
    rounding : bool
        True if the figures bound errors of rounding, which differ between processors.
    """

    name: str
    page: str
    text: str
    compute: Callable[[], Figures]
    slow: bool = False
    rounding: bool = False

    @property
    def printed(self) -> tuple[str, ...]:
        """Figures as the page prints them; ValueError if it has the text not once."""
        pattern = re.escape(self.text).replace(r"\{\}", _NUMBER)
        found = re.findall(pattern, page_text(self.page))
        if len(found) != 1:
            raise ValueError(f"{self.page} has this {len(found)} times: {self.text}")
        return found[0] if isinstance(found[0], tuple) else (found[0],)

    def misses(self) -> list[str]:
        """Return a line for each figure that is off by more than one unit of its last digit."""
        return [
            f"{self.page}: {figure}, now {value:.6g} ({self.name}: {self.text})"
            for figure, value in zip(self.printed, self.compute(), strict=True)
            if not holds(figure, value, self.rounding)
        ]


def holds(figure: str, value: float, rounding: bool = False) -> bool:
    """Return True if a figure is a value to one unit of its last digit, or bounds its rounding."""
    if rounding:
        return value <= 2.0 * float(figure)
    decimals = len(figure.partition(".")[2])
    return abs(value - float(figure)) <= 10.0**-decimals * (1.0 + 1e-9)


@dataclass(frozen=True, slots=True)
class Printed:
    """Figures that a command prints, and a test checks."""

    page: str
    text: str
    command: str
    test: str


CLAIMS: list[Claim] = []
Compute = Callable[[], Figures]


def claim(
    page: str, text: str, *, slow: bool = False, rounding: bool = False
) -> Callable[[Compute], Compute]:
    """Return a decorator that adds a claim under its function's name."""

    def add(compute: Compute) -> Compute:
        CLAIMS.append(Claim(compute.__name__, page, text, compute, slow, rounding))
        return compute

    return add


@cache
def page_text(page: str) -> str:
    """Return a page's text with single blanks between words."""
    path = ROOT / page if page == "README.md" else ROOT / "docs" / page
    return " ".join(path.read_text(encoding="utf-8").split())


def difference(one: Array, other: Array, white: Array) -> Array:
    """Return CIEDE2000 between XYZ under a white."""
    return delta_E_2000(cielab(one, white), cielab(other, white))


def shown_difference(one: Array, other: Array, space: ColourSpace = SPACES["sRGB"]) -> Array:
    """Return CIEDE2000 between linear RGB of a display, cut to 0 to 1."""
    XYZ = [np.clip(RGB, 0.0, 1.0) @ space.XYZ_from_RGB.T for RGB in (one, other)]
    return difference(*XYZ, space.white_XYZ)


def mean_and_most(errors: Array) -> tuple[float, float]:
    """Return the mean and the maximum."""
    return float(errors.mean()), float(errors.max())
