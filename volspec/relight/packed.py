"""Coefficients as the engines hold them: bounded, and four channels to a texture's layer.

    coefficient image -> [packed] -> host | gpu

``kernels/layers.cl`` packs the same on an OpenCL device.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from volspec.errors import ShapeError
from volspec.relight.checks import arrays_of

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

Pixels32 = NDArray[np.float32]

# Far beyond any light; three channels of it, times a matrix, still fit the shader's float32.
LIMIT = 1e9


def bounded(values: Pixels32) -> Pixels32:
    """A copy within ±1e9, NaN as 0, so that no frame can hold a NaN; any shape."""
    return _without_nan(np.clip(values, -LIMIT, LIMIT))


def layer_count(channels: int) -> int:
    """RGBA layers that hold the channels and alpha."""
    return math.ceil((channels + 1) / 4)


def pack_layers(coefficients: Pixels32, alpha: Pixels32) -> Pixels32:
    """(layers, H, W, 4): the channels, then alpha, then zeros, four to a layer; `bounded`."""
    height, width, channels = coefficients.shape
    layers = np.zeros((layer_count(channels), height, width, 4), dtype=np.float32)
    for i in range(channels):
        # Channel by channel: NumPy moves single numbers at a stride faster than short rows.
        np.clip(coefficients[..., i], -LIMIT, LIMIT, out=layers[i // 4, ..., i % 4])
    np.clip(alpha, -LIMIT, LIMIT, out=layers[channels // 4, ..., channels % 4])
    return _without_nan(layers)


@dataclass(frozen=True, slots=True, eq=False)
class PackedLayers:
    """An image's channels as its textures hold them: packed on one thread, uploaded on another.

    Parameters
    ----------
    layers : (layers, H, W, 4) float32
        As `pack_layers` makes them.
    """

    layers: Pixels32

    @classmethod
    def of(cls, image: CoefficientImage) -> Self:
        """Pack an image; what takes most of its `Relighter.update`.

        Raises
        ------
        ShapeError
            If the image's arrays do not fit together.
        """
        return cls(pack_layers(*arrays_of(image)))

    def require(self, height: int, width: int, channels: int) -> None:
        """Refuse an image of another shape.

        Raises
        ------
        ShapeError
            If the layers are not those of (H, W, L·M).
        """
        expected = layer_count(channels), height, width, 4
        if self.layers.shape != expected:
            raise ShapeError(
                f"relight: the packed layers have shape {self.layers.shape}, the image needs "
                f"{expected}; give PackedLayers.of(image)"
            )


def _without_nan(values: Pixels32) -> Pixels32:
    # The minimum is NaN if anything is, and ten times quicker than looking at each.
    if np.isnan(values.min()):
        np.nan_to_num(values, copy=False, nan=0.0)
    return values
