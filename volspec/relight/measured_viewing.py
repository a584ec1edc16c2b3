"""Measure adapting luminance, background, surround and white of a relit picture, for every light.

    coefficient image, illumination -> [measured_viewing] -> cpu | gpu

`Viewing.adapting`, ``surround`` and ``adopted_white`` enable this. It measures the luminance factor
Y of the lit scene before exposure and level, which belong to the camera: Y = 100 is a perfect
diffuser that faces every source, with E_v/π cd/m². Everything outside of the picture counts as the
lit backdrop.

    S_R = L_A / L_w                       the surround's ratio, at most 1 [1, eq. 17]
    XYZ_w ~ Σ_g K_g XYZ_g                 the white: K_g is the light of a group in the picture

K_g is the mean, over background and adapting field alike, of what the group's flat light makes of
the picture: white surfaces count most, and so does what is near the line of sight [1, 3.6].

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    sections 2.4, 3.6 and 7.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import (
    AdaptationGrid,
    AdoptedWhite,
    Viewing,
    ViewTransformGrid,
    pixels_from_nodes,
    subdivide,
)
from volspec.errors import ViewingError
from volspec.image import CoefficientImage
from volspec.relight.illumination import Illumination
from volspec.relight.texture_planes import clamp_finite

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
# Least X and Z of a white, as in `Viewing.conditions`.
_MIN_WHITE = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class _Conditions:
    """Conditions at the nodes of a grid, (R, C) each."""

    Y_b: Array
    L_A: Array
    S_R: Array  # ratio of the surround


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """An image at the samples of a grid."""

    grid: AdaptationGrid
    coefficients: NDArray[np.float32]
    alpha: NDArray[np.float32]

    def conditions(self, light: Illumination) -> _Conditions:
        """Return the conditions at the nodes of the grid."""
        viewing = light.viewing
        Y = np.clip(light.luminance_factors(self.coefficients, self.alpha), 0.0, _BRIGHTEST)
        outside = min(float(light.backdrop_XYZ[1]) / light.gain, _BRIGHTEST)
        Y_b, Y_A = self.grid.measure(self.grid.means_from_samples(Y), outside)
        S_R = np.minimum(Y_A / light.white_XYZ[1], 1.0)
        if viewing.L_A is not None:
            return _Conditions(Y_b, np.full_like(Y_A, viewing.L_A), S_R)
        # The luminance of a white: E_v/π.
        per_Y = replace(viewing.unmeasured(), Y_A=100.0)
        return _Conditions(Y_b, Y_A / light.white_XYZ[1] * per_Y.adapting_luminance, S_R)

    def white(self, light: Illumination) -> AdoptedWhite:
        """Return the white of the light that the picture shows, for all lines of sight."""
        groups = light.groups
        assert groups is not None  # made if the white is the scene's
        Y = np.clip(groups.luminance_factors(self.coefficients, self.alpha), 0.0, _BRIGHTEST)
        means = []
        for number, outside in enumerate(groups.backdrop_Y.tolist()):
            cells = self.grid.means_from_samples(Y[..., number])
            means.append(np.mean(self.grid.measure(cells, min(outside, _BRIGHTEST))))
        white = groups.white(np.array(means))
        if white is None:
            return "light"
        X, Y_w, Z = np.maximum(white, _MIN_WHITE).tolist()
        return X, Y_w, Z


def _lines_of_sight(viewing: Viewing) -> str:
    return "pixel" if viewing.adapting == "pixel" else "picture"


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
        if not viewing.is_measured:
            return viewing, None
        samples = self._samples(image, viewing)
        if viewing.adopted_white == "scene":
            viewing = replace(viewing, adopted_white=samples.white(light))
        if viewing.adapting == "given" and viewing.surround != "measured":
            return viewing, None
        maps = samples.conditions(light)
        if viewing.adapting == "pixel":
            nodes = (subdivide(array, _SUBDIVISIONS) for array in (maps.Y_b, maps.L_A, maps.S_R))
            return viewing, ViewTransformGrid.of(viewing, light.white_XYZ, *nodes)
        if viewing.surround == "measured":
            viewing = replace(viewing, surround=maps.S_R.item())
        if viewing.adapting == "given":
            return viewing, None
        Y_b, L_A = maps.Y_b.item(), maps.L_A.item()
        return replace(viewing, adapting="given", Y_b=Y_b, L_A=L_A), None

    def maps(self, image: CoefficientImage, light: Illumination) -> tuple[Array, Array]:
        """Return Y_b, percent of the white, and L_A, cd/m², for every pixel: (H, W) each.

        Parameters and errors are as in `measure_viewing`.
        """
        height, width = image.alpha.shape
        maps = self._samples(image, light.viewing).conditions(light)
        Y_b, L_A = (
            pixels_from_nodes(field.shape[0], height)
            @ field
            @ pixels_from_nodes(field.shape[1], width).T
            for field in (maps.Y_b, maps.L_A)
        )
        return Y_b, L_A

    def _samples(self, image: CoefficientImage, viewing: Viewing) -> _Samples:
        """Return the image at the samples of the viewing's grid."""
        grid = self._grid(image, viewing)
        sampled = np.ix_(*grid.samples(_SAMPLES[_lines_of_sight(viewing)]))
        coefficients = clamp_finite(np.asarray(image.coefficients[sampled], np.float32))
        return _Samples(grid, coefficients, clamp_finite(image.alpha[sampled]))

    def _grid(self, image: CoefficientImage, viewing: Viewing) -> AdaptationGrid:
        fov_deg = image.fov_deg if viewing.fov_deg is None else viewing.fov_deg
        if fov_deg is None:
            raise ViewingError(
                "Viewing is to be measured in the picture, but the image has no field of view, "
                "because its camera has no perspective",
                "give Viewing.fov_deg, the picture's height as an angle",
                code="missing",
                field="Viewing.fov_deg",
            )
        shape = image.alpha.shape[0], image.alpha.shape[1]
        lines = _lines_of_sight(viewing)
        key = shape, fov_deg, lines
        if self._cached is None or self._cached[0] != key:
            centre_only = lines == "picture"
            grid = AdaptationGrid.of(shape, fov_deg, _CELLS[lines], centre_only=centre_only)
            self._cached = key, grid
        return self._cached[1]
