"""Relight without a GPU: the shader's arithmetic in NumPy, float64.

    illumination -> [host] -> frame

Used where no OpenGL context can be made; the twin of ``shaders/relight.frag``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.field import PassageField
from volspec.appearance.live import passage_of
from volspec.appearance.passages import Passage
from volspec.appearance.screen import screen_of
from volspec.appearance.spec import Viewing
from volspec.appearance.srgb import to_uint8
from volspec.relight.illumination import Illumination
from volspec.relight.packed import bounded
from volspec.relight.spec import Pixels

# Rows at a time: a 512-pixel block of temporaries then stays in the second-level cache.
_ROWS = 16


class HostEngine:
    """Draws frames of one coefficient image with NumPy."""

    name = "numpy"

    def __init__(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        self.upload(coefficients, alpha)

    def upload(self, coefficients: NDArray[np.float32], alpha: NDArray[np.float32]) -> None:
        """Take another image, `bounded`; (H, W, L·M) and (H, W)."""
        self._coefficients, self._alpha = bounded(coefficients), bounded(alpha)

    def render(
        self,
        light: Illumination,
        viewing: Viewing,
        dtype: type[np.uint8] | type[np.float32],
        field: PassageField | None = None,
    ) -> Pixels:
        """(H, W, 3) codes of the display: uint8, or float32 0 to 1 before rounding.

        A ``field`` of passages over the picture is taken in place of the viewing's one.
        """
        height, width = self._alpha.shape
        if field is None:
            passage: Passage = passage_of(viewing, light.white_XYZ)
        screen = screen_of(viewing)
        frame = np.empty((height, width, 3), dtype=dtype)
        for row in range(0, height, _ROWS):
            rows = slice(row, row + _ROWS)
            XYZ = light.scene_XYZ(self._coefficients[rows], self._alpha[rows])
            if field is not None:
                passage = field.within((height, width), rows)
            encoded = screen.codes(passage.apply(XYZ), row)
            frame[rows] = to_uint8(encoded) if dtype is np.uint8 else encoded
        return frame

    def close(self) -> None:
        """Nothing to release."""
