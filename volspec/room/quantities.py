"""Reflectances, emissions and irradiances of a room's patches: checks and conversions.

    spectra -> [quantities] -> cube, brick, wall_paint

One convention for all rooms: arrays are (P, B), P patches on a `SpectralGrid` of B bands.
Reflectances are band means, from 0 to below 1, or anything that `volspec.spectra.spectrum.stack`
takes. Emission S, radiosity B and irradiance are arrays in W/m² per band, the power of the whole
band, as in [1]: a spectrum in W/(m² nm) times the grid's step.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    eq. 3 and 11-12.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import RoomError
from volspec.spectra import (
    DEFAULT_GRID,
    LUMINOUS_EFFICACY,
    SpectralGrid,
    Spectrum,
    colour_matching_functions,
    light_power,
    require_no_emission,
    stack,
)

Array = NDArray[np.float64]
Reflectances = Spectrum | Sequence[Spectrum] | ArrayLike
"""(P, B) reflectances, P spectra, or one spectrum (B,) for all patches."""


def require_reflectance(
    reflectance: Reflectances, names: Sequence[str], grid: SpectralGrid
) -> Array:
    """Return reflectances (P, B) of the named patches; one (B,) counts for all of them.

    Raises RoomError if their number is not P, or a reflectance is below 0, or 1 or more: light in a
    closed room would grow without end.
    """
    require_no_emission(reflectance, "a room's paint")
    rho = _by_patch("reflectance", stack(reflectance, grid), names)
    wrong = ~((rho >= 0.0) & (rho < 1.0))
    _refuse_bands("reflectance", "reflects", rho, wrong, "give 0 to below 1", names, grid)
    return rho


def require_emission(emission: ArrayLike, names: Sequence[str], grid: SpectralGrid) -> Array:
    """Return emissions (P, B), W/m² per band, of the named patches.

    Raises RoomError if their number is not P, one is negative, or none emits.
    """
    S = _by_patch("emission", stack(emission, grid), names)
    _refuse_bands("emission", "emits", S, S < 0.0, "give 0 W/m² or more", names, grid)
    if not S.any():
        raise RoomError("no light", "let a patch emit", code="missing", field="emission")
    return S


def with_paint(
    reflectance: Sequence[Spectrum] | ArrayLike,
    paint: Spectrum | ArrayLike,
    walls: Sequence[int],
    grid: SpectralGrid = DEFAULT_GRID,
) -> Array:
    """Return reflectances (P, B) in which the given walls have one paint (B,).

    Raises RoomError if there is no such wall, or a shape differs; SpectrumError as `stack`.

    >>> with_paint([[0.1, 0.1], [0.2, 0.2]], [0.7, 0.8], [1], SpectralGrid(500, 600, 100)).tolist()
    [[0.1, 0.1], [0.7, 0.8]]
    """
    for spectra in (reflectance, paint):
        require_no_emission(spectra, "a room's paint")
    painted = stack(reflectance, grid).copy()
    if painted.ndim != 2:
        raise _wrong_shape("reflectance", painted, "give a spectrum for each patch")
    painted[require_walls(walls, len(painted))] = require_spectrum("paint", paint, grid)
    return painted


def require_walls(walls: Sequence[int], count: int) -> list[int]:
    """Return the numbers of painted walls; raise RoomError if there are none, or none so many."""
    numbers = list(walls)
    if not numbers or any(number not in range(count) for number in numbers):
        raise RoomError.refused("walls", walls, f"give numbers from 0 to {count - 1}")
    return numbers


def require_spectrum(field: str, values: Spectrum | ArrayLike, grid: SpectralGrid) -> Array:
    """Return one spectrum (B,); raise RoomError if there are several, SpectrumError as `stack`."""
    spectrum = stack(values, grid)
    if spectrum.ndim != 1:
        raise _wrong_shape(field, spectrum, f"give one spectrum, ({grid.size},)")
    return spectrum


def irradiance_from_lux(light: Spectrum, lux: float, grid: SpectralGrid = DEFAULT_GRID) -> Array:
    """Return the (B,) irradiance, W/m² per band, of a light at an illuminance, lux (eq. 11-12).

    Times a reflectance, it is the emission of a patch in that light ("first shot"); for a window
    or a lamp, lux are its luminous exitance, lm/m². Raises RoomError unless lux are above 0,
    SpectrumError as `light_power`.

    >>> from volspec.spectra import light
    >>> float(lux_from_irradiance(irradiance_from_lux(light("D65"), 500.0)).round(9))
    500.0
    """
    if not (np.isfinite(lux) and lux > 0.0):
        raise RoomError.refused("lux", lux, "give a number above 0 (lux)")
    power = light_power(light, grid)
    return power * (lux / lux_from_irradiance(power, grid))


def lux_from_irradiance(irradiance: ArrayLike, grid: SpectralGrid = DEFAULT_GRID) -> Array:
    """Return the illuminance (...), lux, of irradiances (..., B) in W/m² per band (eq. 3)."""
    V = colour_matching_functions(grid)[1]
    return np.asarray(LUMINOUS_EFFICACY * (stack(irradiance, grid) @ V))


def _by_patch(field: str, values: Array, names: Sequence[str]) -> Array:
    if values.ndim == 1 and field == "reflectance":
        return np.broadcast_to(values, (len(names), values.size))
    if values.ndim != 2 or len(values) != len(names):
        raise _wrong_shape(field, values, f"give {len(names)} spectra: {', '.join(names)}")
    return values


def _wrong_shape(field: str, values: Array, remedy: str) -> RoomError:
    return RoomError(f"has shape {values.shape}", remedy, code="shape", field=field)


def _refuse_bands(
    field: str,
    verb: str,
    values: Array,
    wrong: NDArray[np.bool_],
    remedy: str,
    names: Sequence[str],
    grid: SpectralGrid,
) -> None:
    """Raise RoomError for the first of the wrong values, naming its patch and band."""
    if wrong.any():
        patch, band = divmod(int(wrong.argmax()), grid.size)
        value = float(values[patch, band])
        problem = f"{names[patch]} {verb} {value:.9g} at {grid.wavelengths_nm[band]:g} nm"
        raise RoomError(problem, remedy, field=field, given=value)
