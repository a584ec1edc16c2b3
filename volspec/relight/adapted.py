"""What an eye before the picture is adapted to, measured anew under every light.

    coefficient image, illumination -> [adapted] -> host | gpu

`Viewing.adapting` asks for it. Measured is the luminance factor Y of what is lit, before exposure
and level, which are the camera's: Y = 100 is a perfect diffuser that faces every source, of E_v/π
cd/m². What lies outside of the picture counts as the lit backdrop.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.field import PassageField
from volspec.appearance.net import AdaptingNet, between, refined
from volspec.appearance.spec import Viewing
from volspec.errors import ViewingError
from volspec.relight.illumination import Illumination
from volspec.relight.packed import bounded

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

Array = NDArray[np.float64]

# Cells along the picture's longer side, and samples across each. One line of sight can have many; a
# net's cost grows with the fourth power.
_CELLS = {"picture": 128, "pixel": 32}
_SAMPLES = {"picture": 2, "pixel": 4}
# Passages for each gap of that net: in the dark they bend more than the conditions do. Against
# conditions of every pixel CIEDE2000 0.12 at most with 2, where 1 leaves 0.32 (test_relight_field).
_PASSAGES = 2
# A pixel counts as ten white diffusers at most, as a glint does not blind; and the models'
# powers stay finite.
_BRIGHTEST = 1000.0


class Adapting:
    """Measures pictures; keeps the geometry of the last, as lights change more often than it."""

    def __init__(self) -> None:
        self._net: tuple[object, AdaptingNet] | None = None

    def measured(
        self, image: CoefficientImage, light: Illumination
    ) -> tuple[Viewing, PassageField | None]:
        """Return the light's viewing with what it asks to be measured, as the engines take it.

        Parameters
        ----------
        image : CoefficientImage
        light : Illumination
            What lights it, and how that is viewed.

        Returns
        -------
        Viewing
            With what was measured as given; the one that came in where nothing is to be measured,
            or where it is for each pixel:
        PassageField or None
            The passages of each pixel.

        Raises
        ------
        ViewingError
            If neither viewing nor image knows the picture's field of view, or a white has no
            lightness.
        """
        viewing = light.viewing
        if viewing.adapting == "given":
            return viewing, None
        Y_b, L_A = self._conditions(image, light)
        if viewing.adapting == "pixel":
            nodes = refined(Y_b, _PASSAGES), refined(L_A, _PASSAGES)
            return viewing, PassageField.of(viewing, light.white_XYZ, *nodes)
        return replace(viewing, adapting="given", Y_b=Y_b.item(), L_A=L_A.item()), None

    def maps(self, image: CoefficientImage, light: Illumination) -> tuple[Array, Array]:
        """Y_b, percent of the white, and L_A, cd/m², of every pixel: (H, W) each.

        Parameters and errors are those of `measured`.
        """
        height, width = image.alpha.shape
        Y_b, L_A = (
            between(field.shape[0], height) @ field @ between(field.shape[1], width).T
            for field in self._conditions(image, light)
        )
        return Y_b, L_A

    def _conditions(self, image: CoefficientImage, light: Illumination) -> tuple[Array, Array]:
        """Y_b and L_A at the nodes of the net; (R, C) each."""
        viewing = light.viewing
        net = self._net_of(image, viewing)
        rows, columns = net.samples(_SAMPLES[viewing.adapting])
        there = np.ix_(rows, columns)
        coefficients = bounded(np.asarray(image.coefficients[there], np.float32))
        Y = light.luminance_factors(coefficients, bounded(image.alpha[there]))
        outside = min(float(light.backdrop_XYZ[1]) / light.gain, _BRIGHTEST)
        Y_b, Y_A = net.measured(net.of_samples(np.clip(Y, 0.0, _BRIGHTEST)), outside)
        if viewing.L_A is not None:
            return Y_b, np.full_like(Y_A, viewing.L_A)
        # Of a white of E_v/π.
        per_Y = replace(viewing, adapting="given", Y_b=100.0)
        return Y_b, Y_A / light.white_XYZ[1] * per_Y.adapting_luminance

    def _net_of(self, image: CoefficientImage, viewing: Viewing) -> AdaptingNet:
        fov_deg = image.fov_deg if viewing.fov_deg is None else viewing.fov_deg
        if fov_deg is None:
            raise ViewingError(
                f"relight: Viewing.adapting is {viewing.adapting!r}, and the image has no field of "
                "view to measure with, as a camera with perspective leaves; give Viewing.fov_deg, "
                "the picture's height as an angle"
            )
        shape = image.alpha.shape[0], image.alpha.shape[1]
        key = shape, fov_deg, viewing.adapting
        if self._net is None or self._net[0] != key:
            cells, middle = _CELLS[viewing.adapting], viewing.adapting == "picture"
            self._net = key, AdaptingNet.of(shape, fov_deg, cells, middle=middle)
        return self._net[1]
