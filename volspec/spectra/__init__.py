"""Light and matter as functions of wavelength: grid, spectrum, photometry, files, library."""

from volspec.spectra.construct import (
    BaseSpectra,
    MadeReflectances,
    base_spectra,
    reflectance_of,
    reflectances_of,
)
from volspec.spectra.files import read_spectrum
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.library import (
    light,
    light_names,
    light_set,
    reflectance,
    reflectance_names,
    reflectance_set,
    reflectance_set_names,
)
from volspec.spectra.observer import color_matching_functions
from volspec.spectra.photometry import XYZ_of, illuminance_lux, luminance, white_XYZ
from volspec.spectra.save import write_spectrum
from volspec.spectra.spectral_image import SpectralImage
from volspec.spectra.spectrum import Spectrum

__all__ = [
    "DEFAULT_GRID",
    "BaseSpectra",
    "MadeReflectances",
    "SpectralGrid",
    "SpectralImage",
    "Spectrum",
    "XYZ_of",
    "base_spectra",
    "color_matching_functions",
    "illuminance_lux",
    "light",
    "light_names",
    "light_set",
    "luminance",
    "read_spectrum",
    "reflectance",
    "reflectance_names",
    "reflectance_of",
    "reflectance_set",
    "reflectance_set_names",
    "reflectances_of",
    "white_XYZ",
    "write_spectrum",
]
