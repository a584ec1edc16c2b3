"""The library of named spectra: one import for lights and reflectances.

lights, reflectances -> [library] -> basis, scene, command line
"""

from volspec.spectra.lights import light, light_names, light_set
from volspec.spectra.reflectances import (
    reflectance,
    reflectance_names,
    reflectance_set,
    reflectance_set_names,
)

__all__ = [
    "light",
    "light_names",
    "light_set",
    "reflectance",
    "reflectance_names",
    "reflectance_set",
    "reflectance_set_names",
]
