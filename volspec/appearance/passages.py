"""Passages: XYZ seen under one condition to the XYZ that look the same under another.

    adaptation, models -> [passages] -> host | shaders/relight.frag

Whatever a model is made of, what a pixel goes through has one of few forms, and the shader draws
each of them: a matrix, or a curve per response between two matrices. (The opponent models,
CIECAM02 and CAM16, have a form of their own.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import ShapeError, ViewingError

Array = NDArray[np.float64]


@runtime_checkable
class Passage(Protocol):
    """What takes colours from one condition to another."""

    def apply(self, XYZ: ArrayLike) -> Array:
        """(..., 3) XYZ to those of equal appearance; total on finite input."""


@runtime_checkable
class ClosedPassage(Passage, Protocol):
    """One in closed form, which shaders draw and which can be undone."""

    def undo(self, XYZ: ArrayLike) -> Array:
        """(..., 3) XYZ back to those it was applied to."""


def triples(name: str, values: ArrayLike) -> Array:
    """float64 triples.

    Raises
    ------
    ShapeError
        If they are no numbers, or the last axis is not 3.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ShapeError.refused(name, values, "expected numbers, (..., 3)") from None
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ShapeError(f"{name} has shape {array.shape}; expected (..., 3)")
    return array


def signed_power(values: ArrayLike, exponent: ArrayLike) -> Array:
    """|x|^p with the sign of x."""
    x = np.asarray(values, dtype=np.float64)
    p = np.asarray(exponent, dtype=np.float64)
    return np.asarray(np.copysign(np.abs(x) ** p, x), dtype=np.float64)


def _inverted(matrix: Array) -> Array:
    try:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise ViewingError(
            f"adaptation: the matrix {matrix.round(4).tolist()} cannot be inverted; use another "
            "white or D"
        ) from error


@dataclass(frozen=True, slots=True, eq=False)
class LinearPassage:
    """XYZ' = matrix · XYZ, as all adaptations of the von Kries kind.

    Parameters
    ----------
    matrix : (3, 3)
    """

    matrix: Array

    def apply(self, XYZ: ArrayLike) -> Array:
        """(..., 3) to (..., 3)."""
        return triples("adaptation: XYZ", XYZ) @ self.matrix.T

    def undo(self, XYZ: ArrayLike) -> Array:
        """(..., 3) to (..., 3)."""
        return triples("adaptation: XYZ", XYZ) @ _inverted(self.matrix).T


@dataclass(frozen=True, slots=True, eq=False)
class CurvePassage:
    """A curve per response, between two matrices.

        r   = response_from_XYZ · XYZ
        r'  = (gain · (r + shift)^power + offset)^outer        powers with the sign of their base
        XYZ' = XYZ_from_response · r'

    Parameters
    ----------
    response_from_XYZ, XYZ_from_response : (3, 3)
    gain, power, shift, offset, outer : (3,)
    """

    response_from_XYZ: Array
    XYZ_from_response: Array
    gain: Array
    power: Array
    shift: Array
    offset: Array
    outer: Array

    def apply(self, XYZ: ArrayLike) -> Array:
        """(..., 3) to (..., 3)."""
        r = triples("adaptation: XYZ", XYZ) @ self.response_from_XYZ.T
        inner = self.gain * signed_power(r + self.shift, self.power) + self.offset
        return signed_power(inner, self.outer) @ self.XYZ_from_response.T

    def undo(self, XYZ: ArrayLike) -> Array:
        """(..., 3) to (..., 3)."""
        r = triples("adaptation: XYZ", XYZ) @ _inverted(self.XYZ_from_response).T
        inner = (signed_power(r, 1.0 / self.outer) - self.offset) / self.gain
        r = signed_power(inner, 1.0 / self.power) - self.shift
        return r @ _inverted(self.response_from_XYZ).T
