"""Palettes that tests build: free surfaces, lamps of the library, wanted colours."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance import Viewing
from volspec.palette import Cell, Design, Palette, PaletteSpectrum
from volspec.spectra import DEFAULT_GRID, Spectrum, colour_matching_functions, light

Q = colour_matching_functions(DEFAULT_GRID)
NM = DEFAULT_GRID.wavelengths_nm
GREY = (0.5, 0.5, 0.5)


def surface(name: str, **more: Any) -> PaletteSpectrum:
    """Return a free reflectance."""
    return PaletteSpectrum(name, **{"free": True, "upper": 1.0, **more})


def lamp(name: str) -> PaletteSpectrum:
    """Return a light of the library."""
    return PaletteSpectrum(name, light(name))


def free_light(name: str = "L", **more: Any) -> PaletteSpectrum:
    """Return a light to be designed."""
    return PaletteSpectrum(name, free=True, **more)


def given(name: str, values: ArrayLike) -> PaletteSpectrum:
    """Return a given spectrum on the default bands."""
    return PaletteSpectrum(name, Spectrum(NM, np.broadcast_to(values, NM.shape), name))


def power(name: str) -> np.ndarray:
    """Return a light of the library on the default bands, Y = 100."""
    values = light(name).on(DEFAULT_GRID).values
    return np.asarray(100.0 * values / (Q[1] @ values))


def linear(codes: ArrayLike) -> np.ndarray:
    """Return linear RGB of display codes."""
    return np.asarray(Viewing("none").display.colours.decode(codes))


def must(*colour: float) -> Cell:
    """Return a cell that is to be met exactly."""
    return Cell(colour=colour, weight=math.inf)


def shown_codes(made: Design) -> np.ndarray:
    """Return (R, L, 3) display codes of a design."""
    models = made.state.colour_models()
    return np.asarray(models[0].space.encode(made.state.RGB(models)))


def palette_of(
    cells: dict[tuple[str, str], Cell], *spectra: PaletteSpectrum, **more: Any
) -> Palette:
    """Return the palette of cells; other names are free surfaces, and lamps of the library."""
    own = {spectrum.name: spectrum for spectrum in spectra}
    rows, columns = (dict.fromkeys(place[side] for place in cells) for side in (0, 1))
    return Palette(
        tuple(own.get(name) or surface(name) for name in rows),
        tuple(own.get(name) or lamp(name) for name in columns),
        cells,
        **more,
    )
