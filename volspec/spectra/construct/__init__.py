"""A plausible reflectance for any colour: mixed from measured ones, extended smoothly beyond.

    colours, base -> search -> [construct] -> scenes, command line

References
----------
[1] Wang, Xu & Sun (2004), "Practical Construction of Reflectances for Spectral Rendering",
    WSCG 2004 Posters, 193-196.
"""

from volspec.spectra.construct.base import (
    POWERS,
    ROUTES,
    BaseSpectra,
    MadeReflectances,
    base_spectra,
    bouguer,
)
from volspec.spectra.construct.colours import XYZ_from_sRGB, colour_XYZ
from volspec.spectra.construct.construct import (
    METHODS,
    reflectance_from_colour,
    reflectances_from_colours,
)

__all__ = [
    "METHODS",
    "POWERS",
    "ROUTES",
    "BaseSpectra",
    "MadeReflectances",
    "XYZ_from_sRGB",
    "base_spectra",
    "bouguer",
    "colour_XYZ",
    "reflectance_from_colour",
    "reflectances_from_colours",
]
