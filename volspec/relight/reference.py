"""Relight without a GPU: the shader's arithmetic in NumPy, float64.

    illumination -> [reference] -> frame

A fallback if no OpenGL context can be made, and the twin of ``shaders/relight.frag``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import (
    Viewing,
    ViewTransform,
    ViewTransformGrid,
    screen_for_viewing,
    view_transform,
)
from volspec.appearance.display import to_uint8
from volspec.relight.illumination import Illumination
from volspec.relight.spec import Pixels
from volspec.relight.texture_planes import clamp_finite

# Rows at a time, so that temporaries for a block of 512 pixels fit the L2 cache.
_ROWS = 16


class CpuEngine:
    """NumPy engine that draws frames of one coefficient image."""

    name = "numpy"

    def __init__(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        self.upload(coefficients, alpha)

    def upload(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        """Store another image, as `clamp_finite`; (H, W, L·M) and (H, W)."""
        self._coefficients, self._alpha = clamp_finite(coefficients), clamp_finite(alpha)

    def render(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        grid: ViewTransformGrid | None = None,
    ) -> Pixels:
        """Return (H, W, 3) codes of the display: uint8, or float32 0 to 1 before rounding.

        A ``grid`` of view transforms over the picture replaces the viewing's.
        """
        height, width = self._alpha.shape
        if grid is None:
            transform: ViewTransform = view_transform(viewing, light.white_XYZ)
        screen = screen_for_viewing(viewing)
        frame = np.empty((height, width, 3), dtype=dtype)
        for row in range(0, height, _ROWS):
            rows = slice(row, row + _ROWS)
            XYZ = light.scene_XYZ(self._coefficients[rows], self._alpha[rows])
            if grid is not None:
                transform = grid.interpolate((height, width), rows)
            encoded = screen.codes(transform.apply(XYZ), row)
            frame[rows] = to_uint8(encoded) if dtype is np.uint8 else encoded
        return frame

    def close(self) -> None:
        """Do nothing; there is nothing to release."""
