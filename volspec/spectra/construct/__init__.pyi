# What other packages use of this one; lazy_loader and type checkers read it.
from .colours import (
    XYZ_from_linear_sRGB as XYZ_from_linear_sRGB,
    XYZ_from_sRGB as XYZ_from_sRGB,
    colour_XYZ as colour_XYZ,
    sRGB_from_word as sRGB_from_word,
)
from .upsampling import (
    constructed_spectrum as constructed_spectrum,
    reflectance_from_colour as reflectance_from_colour,
    reflectances_from_colours as reflectances_from_colours,
)
