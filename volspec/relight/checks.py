"""What relighting asks of an image, in one line that names what does not fit."""

from __future__ import annotations

import math
from collections.abc import Sized
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import RelightError, ShapeError

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

Shape = tuple[int, ...]


def shape_of(image: CoefficientImage) -> Shape:
    """(H, W, L·M), where an image's arrays, basis and groups fit together."""
    if not hasattr(image, "coefficients"):
        raise RelightError.refused(
            "Relighter: the image",
            image,
            "expected a CoefficientImage, from volspec.raycast or CoefficientImage.load",
            "type",
        )
    coefficients, alpha = np.shape(image.coefficients), np.shape(image.alpha)
    size = image.basis.size * len(image.groups)
    if len(coefficients) != 3 or coefficients != alpha + (size,) or not math.prod(alpha):
        raise ShapeError(
            f"relight: coefficients have shape {coefficients}, alpha {alpha}, the "
            f"basis and groups {size} channels; expected (H, W, L·M), (H, W) and L·M"
        )
    return coefficients


def pixel_type(dtype: Any) -> type:
    """numpy.uint8 or numpy.float32, of which frames are."""
    try:
        kind = np.dtype(dtype).type
    except TypeError:
        kind = np.void
    if kind not in (np.uint8, np.float32):
        raise RelightError.refused("relight.dtype", dtype, "expected numpy.uint8 or numpy.float32")
    return kind


def require_fit(shape: Shape, groups: Sized, old: CoefficientImage) -> None:
    """Refuse another shape or number of light groups than a Relighter was made for."""
    if shape != old.coefficients.shape:
        raise ShapeError(
            f"relight: the image has shape {shape}, this Relighter was made for "
            f"{old.coefficients.shape}; make another Relighter"
        )
    if len(groups) != len(old.groups):
        raise ShapeError(
            f"relight: the image has {len(groups)} light groups, this Relighter was made "
            f"for {len(old.groups)}; make another Relighter"
        )


def arrays_of(image: CoefficientImage) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Coefficients (H, W, L·M) and alpha (H, W) as the engines read them; `shape_of` first."""
    shape_of(image)
    coefficients = np.ascontiguousarray(image.coefficients, dtype=np.float32)
    return coefficients, np.ascontiguousarray(image.alpha, dtype=np.float32)
