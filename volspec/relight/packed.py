"""Coefficients as the engines hold them: bounded, and four channels to a texture's layer.

    coefficient image -> [packed] -> host | gpu

``kernels/layers.cl`` packs the same on an OpenCL device.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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


def _without_nan(values: Pixels32) -> Pixels32:
    # The minimum is NaN if anything is, and ten times quicker than looking at each.
    if np.isnan(values.min()):
        np.nan_to_num(values, copy=False, nan=0.0)
    return values
