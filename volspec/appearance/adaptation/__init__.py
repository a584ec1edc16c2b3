"""Chromatic adaptation: XYZ under one white to the XYZ of equal appearance under another.

    ViewingConditions × 2 -> [adaptation] -> ViewTransform -> cpu | shaders/relight.frag

An adaptation is a function of source and target conditions that returns a `ViewTransform`:
``apply`` goes from source to target, ``undo`` goes back, and the shader evaluates it directly.
Equations and measured errors: docs/adaptation.md.

Colours are relative to their white, in percent of Y_w: a white of Y = 50 acts like one of Y = 100.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.adaptation import linear, nonlinear
from volspec.appearance.adaptation.linear import Adaptation
from volspec.appearance.surround import ViewingConditions
from volspec.appearance.transforms import Array, CurveTransform, ViewTransform, triples
from volspec.errors import ViewingError, nearest

__all__ = ["ADAPTATIONS", "Adaptation", "adapt", "adaptation", "outside"]


ADAPTATIONS: Mapping[str, Adaptation] = MappingProxyType(
    {
        **linear.TRANSFORMS,
        **nonlinear.TRANSFORMS,
        "Fairchild 1990": linear.fairchild_transform,
    }
)


def adaptation(name: str) -> Adaptation:
    """Return a chromatic adaptation by name, one of `ADAPTATIONS`.

    Returns
    -------
    function
        Maps source and target `ViewingConditions` to a `ViewTransform`.

    Raises
    ------
    ViewingError
        If the name is unknown.
    """
    if name not in ADAPTATIONS:
        raise ViewingError.refused(
            "adaptation",
            name,
            f"{nearest(name, ADAPTATIONS)}known: {', '.join(ADAPTATIONS)}",
            "unknown",
        )
    return ADAPTATIONS[name]


def adapt(
    XYZ: ArrayLike, source: ViewingConditions, target: ViewingConditions, method: str = "CAT02"
) -> Array:
    """Return corresponding colours: those that look the same under the target's white.

    Parameters
    ----------
    XYZ : (..., 3) array_like
        On the source white's scale.
    source, target : ViewingConditions
    method : str
        One of `ADAPTATIONS`.

    Returns
    -------
    (..., 3) float64
        XYZ on the target white's scale; `outside` marks colours outside of a transform's domain.

    Raises
    ------
    ViewingError
        If the method is unknown, or ``source`` or ``target`` is not a `ViewingConditions`.
    ShapeError
        If XYZ are not numbers, or the last axis is not 3.

    Examples
    --------
    White paper under tungsten, adapted to daylight:

    >>> tungsten = ViewingConditions((109.85, 100, 35.58), D=1)
    >>> daylight = ViewingConditions((95.05, 100, 108.88), D=1)
    >>> adapt([109.85, 100, 35.58], tungsten, daylight).round(2).tolist()
    [95.05, 100.0, 108.88]
    """
    return adaptation(method)(source, target).apply(XYZ)


def outside(XYZ: ArrayLike, transform: ViewTransform) -> NDArray[np.bool_]:
    """Mark colours outside of a transform's domain: powers of negative numbers.

    There `ViewTransform.apply` uses |x|^p with the sign of x, so pictures never contain NaN.

    Parameters
    ----------
    XYZ : (..., 3) array_like
        On the source white's scale.
    transform : ViewTransform

    Returns
    -------
    (...) bool
        True if a response lies below 0 (Nayatani: below -n), or XYZ is not finite. Matrices
        are defined everywhere.

    Raises
    ------
    ShapeError
        If the last axis is not 3.
    """
    colours = triples("adaptation.XYZ", XYZ)
    undefined = ~np.isfinite(colours).all(axis=-1)
    if isinstance(transform, CurveTransform):
        with np.errstate(invalid="ignore"):
            base = colours @ transform.response_from_XYZ.T + transform.shift
        undefined |= (base < 0.0).any(axis=-1)
    return np.asarray(undefined, dtype=np.bool_)
