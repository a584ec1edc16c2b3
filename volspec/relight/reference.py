"""The reference that every renderer is tested against: float64 and colour-science's CIECAM02.

    illumination -> [reference] -> encoded float64

Slow and independent on purpose: it shares nothing of the appearance model with
`volspec.appearance.models` or the shader. The light's matrix is shared by all; a test
compares it with 31 bands (`test_relight_is_method_4_in_31_bands`).

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
[2] colour-science 0.4: ``colour.XYZ_to_CIECAM02``, ``colour.CIECAM02_to_XYZ``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.spec import Viewing, surround_at
from volspec.errors import ViewingError
from volspec.relight.illumination import Illumination
from volspec.relight.measured_viewing import ViewingMeter
from volspec.relight.spec import LightRig, RelightSpec
from volspec.spectra.datasets import colour_science
from volspec.spectra.spectrum import Spectrum

if TYPE_CHECKING:
    from volspec.raycast.image import CoefficientImage

Array = NDArray[np.float64]


def display_XYZ(
    XYZ: ArrayLike,
    white_XYZ: ArrayLike,
    viewing: Viewing,
    adapted: tuple[Array, Array] | None = None,
) -> Array:
    """Return the display XYZ of equal appearance, by colour-science.

    Colours without lightness are black. ``adapted`` are Y_b and L_A of each colour instead of the
    viewing's.
    """
    scene = np.asarray(XYZ, dtype=np.float64)
    if viewing.model == "none":
        return scene
    colour = colour_science()
    InductionFactors = colour.appearance.InductionFactors_CIECAM02
    F: float | Array
    F, c, N_c = surround_at(viewing.surround)
    Y_b, L_A = adapted or (viewing.Y_b, viewing.adapting_luminance)
    if viewing.D is not None:
        # colour-science takes no D; F enters D alone, so this F gives that D.
        F = viewing.D / (1.0 - np.exp(-(L_A + 42.0) / 92.0) / 3.6)
    display = viewing.display
    with np.errstate(all="ignore"):
        look = colour.XYZ_to_CIECAM02(
            scene,
            np.asarray(white_XYZ, dtype=np.float64),
            L_A,
            Y_b,
            InductionFactors(F, c, N_c),
            compute_H=False,
        )
        J = np.asarray(look.J, dtype=np.float64)
        lit = J > 0.0
        shown = colour.CIECAM02_to_XYZ(
            colour.CAM_Specification_CIECAM02(
                J=np.where(lit, J, 1.0), C=np.where(lit, look.C, 0.0), h=look.h
            ),
            _Space(display.colours.name).whitepoint_XYZ,
            display.adapting_luminance,
            display.Y_b,
            InductionFactors(*surround_at(display.surround)),
        )
    return np.where(lit[..., None], shown, 0.0)


# colour-science's name of a space, and the γ of its curve; sRGB's is none. (colour-science's own
# curves of BT.709 and BT.2020 are a camera's.)
_SPACES = {
    "sRGB": ("sRGB", None),
    "Display P3": ("Display P3", None),
    "DCI-P3": ("DCI-P3", 2.6),
    "Rec. 709": ("ITU-R BT.709", 2.4),
    "Rec. 2020": ("ITU-R BT.2020", 2.4),
    "Adobe RGB (1998)": ("Adobe RGB (1998)", 563 / 256),
}


class _Space:
    """colour-science's space with the matrix derived from its primaries in double precision."""

    def __init__(self, name: str) -> None:
        if name not in _SPACES:
            raise ViewingError(
                f"colour-science has no space {name!r}",
                f"known: {', '.join(_SPACES)}",
                code="unknown",
                field="reference",
            )
        colour = colour_science()
        theirs, self._gamma = _SPACES[name]
        space = colour.RGB_COLOURSPACES[theirs].copy()
        space.use_derived_transformation_matrices(True)
        self.matrix: Array = np.asarray(space.matrix_XYZ_to_RGB) / 100.0
        self.whitepoint_XYZ: Array = 100.0 * np.asarray(colour.xy_to_XYZ(space.whitepoint))

    def encode(self, linear: Array) -> Array:
        """Return code values of linear RGB, 0 to 1."""
        colour = colour_science()
        if self._gamma is None:
            return np.asarray(colour.models.eotf_inverse_sRGB(linear), dtype=np.float64)
        return np.asarray(colour.gamma_function(linear, 1.0 / self._gamma), dtype=np.float64)


def encoded_frame(
    coefficients: ArrayLike,
    alpha: ArrayLike,
    light: Illumination,
    viewing: Viewing,
    adapted: tuple[Array, Array] | None = None,
) -> Array:
    """Relight coefficients (H, W, L·M) in float64: codes of the display, 0 to 1, before rounding.

    ``adapted`` as `display_XYZ`. Raises ViewingError if the display reduces chroma or marks, which
    has no independent reference, or its space is unknown to colour-science.
    """
    display = viewing.display
    if display.gamut != "clip" or display.mark:
        raise ViewingError(
            f"Display(gamut={display.gamut!r}, mark={display.mark}) has no reference",
            "expected gamut='clip' and mark=False",
            code="unsupported",
            field="reference",
        )
    scene = light.scene_XYZ(coefficients, alpha)
    XYZ = display_XYZ(scene, light.white_XYZ, viewing, adapted)
    space = _Space(display.colours.name)
    return space.encode(np.clip(XYZ @ space.matrix.T, 0.0, 1.0))


def relight_reference(
    image: CoefficientImage, light: Spectrum | LightRig, spec: RelightSpec | None = None
) -> Array:
    """Return the reference picture (H, W, 3) of a coefficient image: codes before rounding."""
    spec = spec or RelightSpec()
    lit = Illumination.of(image.basis, light, spec, image.groups)
    meter, viewing, adapted = ViewingMeter(), lit.viewing, None
    if viewing.adapting == "pixel":
        adapted = meter.maps(image, lit)
    else:
        viewing, _ = meter.measure_viewing(image, lit)
    return encoded_frame(image.coefficients, image.alpha, lit, viewing, adapted)
