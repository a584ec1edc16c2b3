"""Light and matter as functions of wavelength: grid, spectrum, photometry, files, library."""

from volspec.spectra.construct import reflectance_from_colour, reflectances_from_colours
from volspec.spectra.construct.base import BaseSpectra, MadeReflectances, base_spectra
from volspec.spectra.datasets import colour_matching_functions
from volspec.spectra.files import read_spectrum
from volspec.spectra.fluorescence import Fluorescence
from volspec.spectra.grid import DEFAULT_GRID, PAPERS_GRID, SpectralGrid
from volspec.spectra.library import light_names
from volspec.spectra.lights import light, light_set
from volspec.spectra.photometry import XYZ_from_spectra, illuminance_lux, luminance, white_XYZ
from volspec.spectra.reflectances import (
    reflectance,
    reflectance_names,
    reflectance_set,
    reflectance_set_names,
)
from volspec.spectra.spectral_image import SpectralImage
from volspec.spectra.spectrum import Spectrum
from volspec.spectra.tables import write_spectrum

__all__ = [
    "DEFAULT_GRID",
    "PAPERS_GRID",
    "BaseSpectra",
    "Fluorescence",
    "MadeReflectances",
    "SpectralGrid",
    "SpectralImage",
    "Spectrum",
    "XYZ_from_spectra",
    "base_spectra",
    "colour_matching_functions",
    "illuminance_lux",
    "light",
    "light_names",
    "light_set",
    "luminance",
    "read_spectrum",
    "reflectance",
    "reflectance_from_colour",
    "reflectance_names",
    "reflectance_set",
    "reflectance_set_names",
    "reflectances_from_colours",
    "white_XYZ",
    "write_spectrum",
]
