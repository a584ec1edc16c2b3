"""The reference that renderers are tested against: float64 and colour-science's CIECAM02.

Slow and independent on purpose: it shares nothing of the appearance model with
`volspec.appearance.models` or the shader. The light's matrix is shared by all; a test
compares it with 81 bands (`test_relight_is_method_4_in_81_bands`).

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
[2] colour-science 0.4: ``colour.XYZ_to_CIECAM02``, ``colour.CIECAM02_to_XYZ``.
"""

import colour
import numpy as np
from colour.appearance import InductionFactors_CIECAM02
from numpy.typing import NDArray

from volspec.appearance.spec import Viewing, surround_at
from volspec.image.model import CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.relight.measured_viewing import ViewingMeter
from volspec.spectra import Spectrum

Array = NDArray[np.float64]

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


def _space(name: str) -> colour.RGB_Colourspace:
    """A space with the matrix derived from its primaries in double precision."""
    space = colour.RGB_COLOURSPACES[_SPACES[name][0]].copy()
    space.use_derived_transformation_matrices(True)
    return space


def _display_XYZ(
    scene: Array, white_XYZ: Array, viewing: Viewing, adapted: tuple[Array, Array] | None
) -> Array:
    """XYZ (..., 3) of equal appearance on the display; colours without lightness are black."""
    if viewing.model == "none":
        return scene
    F, c, N_c = surround_at(viewing.surround)
    Y_b, L_A = adapted or (viewing.Y_b, viewing.adapting_luminance)
    if viewing.D is not None:
        # colour-science takes no D; F enters D alone, so this F gives that D.
        F = viewing.D / (1.0 - np.exp(-(L_A + 42.0) / 92.0) / 3.6)
    display = viewing.display
    with np.errstate(all="ignore"):
        factors = InductionFactors_CIECAM02(F, c, N_c)
        look = colour.XYZ_to_CIECAM02(scene, white_XYZ, L_A, Y_b, factors, compute_H=False)
        lit = look.J > 0.0
        known = colour.CAM_Specification_CIECAM02(
            J=np.where(lit, look.J, 1.0), C=np.where(lit, look.C, 0.0), h=look.h
        )
        shown = colour.CIECAM02_to_XYZ(
            known,
            100.0 * colour.xy_to_XYZ(_space(display.colours.name).whitepoint),
            display.adapting_luminance,
            display.Y_b,
            InductionFactors_CIECAM02(*surround_at(display.surround)),
        )
    return np.where(lit[..., None], shown, 0.0)


def encoded_frame(
    coefficients: Array,
    alpha: Array,
    light: Illumination,
    viewing: Viewing,
    adapted: tuple[Array, Array] | None = None,
) -> Array:
    """Relight coefficients (H, W, L·M): codes of the display, 0 to 1, before rounding.

    ``adapted`` are Y_b and L_A of each pixel instead of the viewing's.
    """
    scene = light.scene_XYZ(coefficients, alpha)
    XYZ = _display_XYZ(scene, light.white_XYZ, viewing, adapted)
    name = viewing.display.colours.name
    matrix, gamma = _space(name).matrix_XYZ_to_RGB / 100.0, _SPACES[name][1]
    linear = np.clip(XYZ @ matrix.T, 0.0, 1.0)
    if gamma is None:
        return colour.models.eotf_inverse_sRGB(linear)
    return colour.gamma_function(linear, 1.0 / gamma)


def relight_reference(
    image: CoefficientImage, light: Spectrum | LightRig, spec: RelightSpec
) -> Array:
    """The reference picture (H, W, 3) of a coefficient image, before rounding."""
    lit = Illumination.of(image.basis, light, spec, image.groups)
    meter, viewing, adapted = ViewingMeter(), lit.viewing, None
    if viewing.adapting == "pixel":
        adapted = meter.maps(image, lit)
    else:
        viewing, _ = meter.measure_viewing(image, lit)
    return encoded_frame(image.coefficients, image.alpha, lit, viewing, adapted)
