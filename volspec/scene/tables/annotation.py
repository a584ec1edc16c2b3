"""Annotations of a volume: labels, distances and angles between points of the world.

``[[annotation]]`` -> [annotation] -> window, pictures, films, pages
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from volspec.camera import Place, Projection, length_text
from volspec.errors import SceneError
from volspec.settings import Unit, Vector, settings

# Numbers of points: of a label, of a distance, of an angle at the second point.
LABEL, DISTANCE, ANGLE = 1, 2, 3
MAX_LETTERS = 80


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True)
class Annotation:
    """``[[annotation]]``: a label at one point, a distance of two, or an angle at the second of
    three."""

    points_mm: Annotated[
        tuple[Annotated[Vector, Unit("mm")], ...],
        Field(strict=False, min_length=LABEL, max_length=ANGLE, examples=[[[0, 0, 0], [9, 0, 0]]]),
    ]
    """One to three points of the world."""
    text: Annotated[str, Field(max_length=MAX_LETTERS, examples=["valve"])] = ""
    """A label's text; before the number of a distance or an angle."""

    def __post_init__(self) -> None:
        if len(self.points_mm) == LABEL and not self.text.strip():
            raise SceneError(
                "a label of one point has no text",
                "give one, or a second point to measure to",
                code="missing",
                field="text",
            )

    @property
    def value(self) -> float | None:
        """The distance in mm, or the angle in degrees; None for a label."""
        points = np.asarray(self.points_mm, np.float64)
        if len(points) == LABEL:
            return None
        if len(points) == DISTANCE:
            return float(np.linalg.norm(points[1] - points[0]))
        one, two = points[0] - points[1], points[2] - points[1]
        across = float(np.linalg.norm(np.cross(one, two)))
        return math.degrees(math.atan2(across, float(one @ two)))

    @property
    def caption(self) -> str:
        """The text, and the number with its unit.

        >>> Annotation(points_mm=((0, 0, 0), (3, 4, 0)), text="width").caption
        'width 5 mm'
        >>> Annotation(points_mm=((1, 0, 0), (0, 0, 0), (0, 2, 0))).caption
        '90°'
        """
        value = self.value
        if value is None:
            return self.text
        number = f"{value:.1f}".removesuffix(".0") + "°"
        if len(self.points_mm) == DISTANCE:
            number = measured_length(value)
        return f"{self.text} {number}".strip()


@dataclass(frozen=True, slots=True, eq=False)
class PlacedAnnotation:
    """An annotation in a picture's pixels."""

    dots: NDArray[np.float64]  # (N, 2)
    lines: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]]]
    caption: NDArray[np.float64]  # (2,): where its text begins


def place_annotation(
    points_mm: Sequence[Vector], projection: Projection, leader: Place
) -> PlacedAnnotation | None:
    """Return where one to three points are drawn; None if one is behind the camera.

    The caption is at a line's middle or an angle's second point; of a single point, it is at the
    end of its leader, a line of ``leader`` pixels right and down.
    """
    drawn = projection.to_window(np.asarray(points_mm, np.float64))
    if (drawn[:, 2] <= 0).any():
        return None
    dots = drawn[:, :2]
    if len(dots) == LABEL:
        end = dots[0] + leader
        return PlacedAnnotation(dots, [(dots[0], end)], end)
    caption = dots[1] if len(dots) == ANGLE else dots.mean(axis=0)
    return PlacedAnnotation(dots, list(pairwise(dots)), caption)


def measured_length(mm: float) -> str:
    """Return a measured length in millimetres, or in the unit that suits a small or large one.

    >>> measured_length(123.456), measured_length(0.02345), measured_length(1234.56)
    ('123.5 mm', '23.45 µm', '1235 mm')
    """
    return f"{mm:.4g} mm" if mm == 0 or 0.1 <= mm < 9999 else length_text(mm, 4)
