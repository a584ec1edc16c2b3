"""View transforms: XYZ under one viewing condition to the XYZ of equal appearance under another.

    adaptation, models -> [transforms] -> cpu | shaders/relight.frag

In any model a pixel's arithmetic has one of a few forms, each of which the shader implements: a
matrix, or a curve per response between two matrices. (The opponent models, CIECAM02 and CAM16,
have a form of their own, `volspec.appearance.models.cam.CamTransform`.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import ShapeError, ViewingError

Array = NDArray[np.float64]


class ViewTransform(Protocol):
    """A map of colours from one viewing condition to another."""

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ of equal appearance; defined for all finite input."""


@runtime_checkable
class ClosedTransform(ViewTransform, Protocol):
    """A view transform in closed form, which shaders can evaluate and which has an inverse."""

    def undo(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ that `apply` maps to the given XYZ."""


def triples(name: str, values: ArrayLike) -> Array:
    """Return values as float64 triples (..., 3); raise ShapeError if they are not."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ShapeError(f"has shape {array.shape}", "expected (..., 3)", field=name)
    return array


def signed_power(values: ArrayLike, exponent: ArrayLike) -> Array:
    """Return |x|^p with the sign of x."""
    x = np.asarray(values, dtype=np.float64)
    p = np.asarray(exponent, dtype=np.float64)
    return np.asarray(np.copysign(np.abs(x) ** p, x), dtype=np.float64)


def _invert_matrix(matrix: Array) -> Array:
    try:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    except np.linalg.LinAlgError as error:
        raise ViewingError(
            f"adaptation: the matrix {matrix.round(4).tolist()} cannot be inverted",
            "use another white or D",
            code="impossible",
        ) from error


@dataclass(frozen=True, slots=True, eq=False)
class LinearTransform:
    """XYZ' = matrix · XYZ, the form of all von Kries adaptations."""

    matrix: Array

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ of equal appearance."""
        return triples("adaptation.XYZ", XYZ) @ self.matrix.T

    def undo(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ that `apply` maps to the given XYZ."""
        return triples("adaptation.XYZ", XYZ) @ _invert_matrix(self.matrix).T


@dataclass(frozen=True, slots=True, eq=False)
class CurveTransform:
    """A curve per response, between two matrices.

    r   = response_from_XYZ · XYZ
    r'  = (gain · (r + shift)^power + offset)^outer        powers keep the sign of their base
    XYZ' = XYZ_from_response · r'
    """

    response_from_XYZ: Array
    XYZ_from_response: Array
    gain: Array
    power: Array
    shift: Array
    offset: Array
    outer: Array

    def apply(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ of equal appearance."""
        r = triples("adaptation.XYZ", XYZ) @ self.response_from_XYZ.T
        inner = self.gain * signed_power(r + self.shift, self.power) + self.offset
        return signed_power(inner, self.outer) @ self.XYZ_from_response.T

    def undo(self, XYZ: ArrayLike) -> Array:
        """Return the (..., 3) XYZ that `apply` maps to the given XYZ."""
        r = triples("adaptation.XYZ", XYZ) @ _invert_matrix(self.XYZ_from_response).T
        inner = (signed_power(r, 1.0 / self.outer) - self.offset) / self.gain
        r = signed_power(inner, 1.0 / self.power) - self.shift
        return r @ _invert_matrix(self.response_from_XYZ).T
