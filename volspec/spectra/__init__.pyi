# What other packages use of this one; lazy_loader and type checkers read it.
from .construct.base import MadeReflectances as MadeReflectances
from .construct.upsampling import (
    reflectance_from_colour as reflectance_from_colour,
    reflectances_from_colours as reflectances_from_colours,
)
from .datasets import (
    Observer as Observer,
    check_observer as check_observer,
    colour_matching_functions as colour_matching_functions,
    colour_science as colour_science,
    reflectances as reflectances,
)
from .files.reading import read_spectrum as read_spectrum
from .files.spectral_image import SpectralImage as SpectralImage
from .files.tables import write_spectrum as write_spectrum
from .fluorescence import Fluorescence as Fluorescence
from .grid import (
    DEFAULT_GRID as DEFAULT_GRID,
    PAPERS_GRID as PAPERS_GRID,
    SpectralGrid as SpectralGrid,
    grid_of_values as grid_of_values,
)
from .library.catalogue import light_names as light_names
from .library.lights import light as light, light_set as light_set
from .library.reflectances import (
    reflectance as reflectance,
    reflectance_names as reflectance_names,
    reflectance_set as reflectance_set,
)
from .observers import population as population
from .photometry import (
    LUMINOUS_EFFICACY as LUMINOUS_EFFICACY,
    Temperature as Temperature,
    XYZ_from_spectra as XYZ_from_spectra,
    correlated_temperature as correlated_temperature,
    illuminance_lux as illuminance_lux,
    light_level as light_level,
    luminous_mean as luminous_mean,
    white_XYZ as white_XYZ,
)
from .spectrum import (
    Spectrum as Spectrum,
    extended_band_means as extended_band_means,
    light_leaving as light_leaving,
    light_power as light_power,
    real_array as real_array,
    reflectance_values as reflectance_values,
    require_no_emission as require_no_emission,
    stack as stack,
)
