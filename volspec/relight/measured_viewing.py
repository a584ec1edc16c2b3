"""Measure the adapting luminance and background of a relit picture, for every light.

    coefficient image, illumination -> [measured_viewing] -> cpu | gpu

`Viewing.adapting` enables this. It measures the luminance factor Y of the lit scene before exposure
and level, which belong to the camera: Y = 100 is a perfect diffuser that faces every source, with
E_v/π cd/m². Everything outside of the picture counts as the lit backdrop.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.adaptation_grid import (
    AdaptationGrid,
    ViewTransformGrid,
    pixels_from_nodes,
    subdivide,
)
from volspec.appearance.spec import Viewing
from volspec.errors import ViewingError
from volspec.relight.illumination import Illumination
from volspec.relight.layers import clamp_finite

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

Array = NDArray[np.float64]

# Cells along the picture's longer side, and samples across each. One line of sight can afford many
# cells; the cost of a grid of them grows with the fourth power.
_CELLS = {"picture": 128, "pixel": 32}
_SAMPLES = {"picture": 2, "pixel": 4}
# Transforms per cell and axis: in the dark they vary less linearly than the conditions. Against
# conditions for every pixel, CIEDE2000 is at most 0.12 with 2, 0.32 with 1 (test_relight_field).
_SUBDIVISIONS = 2
# A pixel counts as at most ten white diffusers: a glint does not blind, and the models' powers stay
# finite.
_BRIGHTEST = 1000.0


class ViewingMeter:
    """Measurement of pictures; caches the latest geometry, because lights change more often."""

    def __init__(self) -> None:
        self._cached: tuple[object, AdaptationGrid] | None = None

    def measure_viewing(
        self, image: CoefficientImage, light: Illumination
    ) -> tuple[Viewing, ViewTransformGrid | None]:
        """Return the light's viewing with all conditions given, and the pixels' transforms or None.

        The viewing is unchanged if nothing is measured or conditions are measured for each pixel.
        Raises ViewingError if neither viewing nor image has the picture's field of view, or a white
        has no lightness.
        """
        viewing = light.viewing
        if viewing.adapting == "given":
            return viewing, None
        Y_b, L_A = self._conditions(image, light)
        if viewing.adapting == "pixel":
            nodes = subdivide(Y_b, _SUBDIVISIONS), subdivide(L_A, _SUBDIVISIONS)
            return viewing, ViewTransformGrid.of(viewing, light.white_XYZ, *nodes)
        return replace(viewing, adapting="given", Y_b=Y_b.item(), L_A=L_A.item()), None

    def maps(self, image: CoefficientImage, light: Illumination) -> tuple[Array, Array]:
        """Return Y_b, percent of the white, and L_A, cd/m², for every pixel: (H, W) each.

        Parameters and errors are as in `measure_viewing`.
        """
        height, width = image.alpha.shape
        Y_b, L_A = (
            pixels_from_nodes(field.shape[0], height)
            @ field
            @ pixels_from_nodes(field.shape[1], width).T
            for field in self._conditions(image, light)
        )
        return Y_b, L_A

    def _conditions(self, image: CoefficientImage, light: Illumination) -> tuple[Array, Array]:
        """Return Y_b and L_A at the nodes of the grid; (R, C) each."""
        viewing = light.viewing
        grid = self._grid(image, viewing)
        rows, columns = grid.samples(_SAMPLES[viewing.adapting])
        there = np.ix_(rows, columns)
        coefficients = clamp_finite(np.asarray(image.coefficients[there], np.float32))
        Y = light.luminance_factors(coefficients, clamp_finite(image.alpha[there]))
        outside = min(float(light.backdrop_XYZ[1]) / light.gain, _BRIGHTEST)
        Y_b, Y_A = grid.measure(grid.means_from_samples(np.clip(Y, 0.0, _BRIGHTEST)), outside)
        if viewing.L_A is not None:
            return Y_b, np.full_like(Y_A, viewing.L_A)
        # The luminance of a white: E_v/π.
        per_Y = replace(viewing, adapting="given", Y_b=100.0)
        return Y_b, Y_A / light.white_XYZ[1] * per_Y.adapting_luminance

    def _grid(self, image: CoefficientImage, viewing: Viewing) -> AdaptationGrid:
        fov_deg = image.fov_deg if viewing.fov_deg is None else viewing.fov_deg
        if fov_deg is None:
            raise ViewingError(
                f"Viewing.adapting is {viewing.adapting!r}, but the image has no field of view, "
                "because its camera has no perspective",
                "give Viewing.fov_deg, the picture's height as an angle",
                code="missing",
                field="Viewing.fov_deg",
            )
        shape = image.alpha.shape[0], image.alpha.shape[1]
        key = shape, fov_deg, viewing.adapting
        if self._cached is None or self._cached[0] != key:
            cells, centre_only = _CELLS[viewing.adapting], viewing.adapting == "picture"
            grid = AdaptationGrid.of(shape, fov_deg, cells, centre_only=centre_only)
            self._cached = key, grid
        return self._cached[1]
