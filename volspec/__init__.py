"""Swap the light on a volume: cast once, relight for ever.

Nothing heavy is loaded here; a name's module is imported when the name is first used.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

from volspec._deprecated import renamed

__version__ = "0.1.0"

_HOMES = {
    "volspec.appearance": ("Display", "Viewing"),
    "volspec.basis": ("MaterialBasis", "SpectralBasis", "load_basis"),
    "volspec.export": ("write_frame",),
    "volspec.export.exporter": ("Exported", "export"),
    "volspec.export.notebook": ("notebook",),
    "volspec.errors": (
        *("CastCancelled", "DeviceError", "InputError", "VolspecError", "VolspecWarning"),
    ),
    "volspec.palette": (
        *("Cell", "Criteria", "Design", "DesignReport", "Palette", "PaletteSpectrum", "design"),
        *("fitted_exposure", "load_palette", "save_palette", "suggestions"),
    ),
    "volspec.pipeline": (
        "Raycaster",
        "Relighter",
        "absorption_error",
        "raycast",
        "refine",
        "relight",
    ),
    "volspec.raycast": (
        *("Ambient", "Camera", "ClipPlane", "CoefficientImage", "Directional", "Headlight"),
        *("LightGroup", "Point", "RaycastSpec"),
    ),
    "volspec.raycast.adapt": ("from_plotter",),
    "volspec.relight": ("LightRig", "RelightSpec"),
    "volspec.relight.adapt": ("picture_plane", "to_texture"),
    "volspec.scene": ("Scene",),
    "volspec.spectra": (
        *("SpectralGrid", "SpectralImage", "Spectrum", "light", "light_names"),
        *("read_spectrum", "reflectance", "reflectance_names", "reflectance_from_colour"),
        "reflectances_from_colours",
    ),
    "volspec.transfer": (
        *("Isosurfaces", "LabelFunction", "Region", "TransferFunction", "TransferFunction2D"),
    ),
    "volspec.wizard": ("Redesigned", "hide", "keep", "merge", "reveal"),
    "volspec.volume": ("Volume", "load_volume", "phantom"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = ["__version__", *sorted(_HOME_OF)]


class _Package(ModuleType):
    """``raycast``, ``relight`` and ``export`` are subpackages; as attributes they are functions.

    Importing a subpackage sets it as an attribute of its parent, which would hide the function.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME_OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def _import_name(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module 'volspec' has no attribute {name!r}")
    return getattr(import_module(_HOME_OF[name]), name)


__getattr__ = renamed(
    __name__,
    {
        "reflectance_of": "reflectance_from_colour",
        "reflectances_of": "reflectances_from_colours",
    },
    otherwise=_import_name,
)


def __dir__() -> list[str]:
    return list(__all__)
