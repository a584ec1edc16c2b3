"""Radiosity in a cube, in closed form: six walls, each of which sees the others equally.

    quantities -> [cube] -> wall_paint

All form factors between two walls are 0.2; the exact ones are 0.199825 and 0.200044.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    eq. 13-16.
"""

from __future__ import annotations

from numpy.typing import ArrayLike

from volspec.room.quantities import Array, Reflectances, require_emission, require_reflectance
from volspec.spectra import DEFAULT_GRID, SpectralGrid, stack

WALLS = tuple(f"wall {number}" for number in range(1, 7))
"""Names for messages; all walls are alike."""
FORM_FACTOR = 0.2
"""Form factor between any two walls."""


def cube_radiosity(
    reflectance: Reflectances, emission: ArrayLike, grid: SpectralGrid = DEFAULT_GRID
) -> Array:
    """Return the radiosity of the six walls of a closed cube (eq. 15-16).

    Parameters
    ----------
    reflectance : (6, B) array, six spectra, or one (B,) for all walls
        From 0 to below 1.
    emission : (6, B) array
        Self-emission S, W/m² per band; see `irradiance_from_lux`.
    grid : SpectralGrid
        B bands.

    Returns
    -------
    (6, B) float64
        B_i = (S_i + 0.2 rho_i B) / (1 + 0.2 rho_i), W/m² per band; B is the sum over all walls.

    Raises
    ------
    RoomError, SpectrumError
        As `require_reflectance` and `require_emission`.

    Examples
    --------
    The introduction of [1]: walls in a direct light of 1 W/m², after all reflections.

    >>> paint = [0.95, 0.90, 0.80]
    >>> first_shot = [paint] * 6
    >>> cube_radiosity(paint, first_shot, SpectralGrid(450, 650, 100))[0].round(9).tolist()
    [19.0, 9.0, 4.0]
    """
    rho = require_reflectance(reflectance, WALLS, grid)
    S = require_emission(emission, WALLS, grid)
    damping = 1.0 / (1.0 + FORM_FACTOR * rho)
    total = (damping * S).sum(0) / (1.0 - FORM_FACTOR * (damping * rho).sum(0))
    return damping * (S + FORM_FACTOR * rho * total)


def cube_irradiance(radiosity: ArrayLike, grid: SpectralGrid = DEFAULT_GRID) -> Array:
    """Return the irradiance (6, B) of the walls at their radiosity (6, B), W/m² per band.

    Equals (B_i - S_i) / rho_i (eq. 8), and is also defined for black walls.
    """
    B = stack(radiosity, grid)
    return FORM_FACTOR * (B.sum(0) - B)
