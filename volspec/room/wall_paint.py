"""Appearance of a painted wall in its room, and the paint that is seen as wanted.

    cube, brick -> [wall_paint]

A wall's light depends on its own paint: a change of paint changes the irradiance E, with it the
white and the level to which the eye adapts, and so the appearance of the wall. White and level are
those of a perfect diffuser on the wall (eq. 8, 9 and 6, rho_w = 1): XYZ of E, and L_A = E_v/π.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    eq. 4-9 and 13-16, section 4.4; the inversion is left to future work in its section 6.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance import Viewing
from volspec.appearance.models import Appearance, ciecam02, opponents
from volspec.errors import RoomError
from volspec.palette import EquationBlock, Term, solve
from volspec.room.cube import FORM_FACTOR, WALLS
from volspec.room.quantities import (
    Array,
    Reflectances,
    require_emission,
    require_reflectance,
    require_spectrum,
    require_walls,
)
from volspec.spectra import (
    DEFAULT_GRID,
    LUMINOUS_EFFICACY,
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    stack,
    white_XYZ,
)
from volspec.spectra.construct import colour_XYZ
from volspec.spectra.library import light

# Conditions in which a colour is chosen from an atlas, besides D65 [1, section 4.4].
_ATLAS_LUX, _ATLAS_Y_B = 2000.0, 20.0
# Range of a paint's reflectance: no black and no white is better.
_MIN, _MAX = 1e-4, 0.999
# Weight of a distance in J, a and b against the root mean square of the second derivative per
# (10 nm)²: so large that it holds as a condition wherever a paint looks as wanted.
_WEIGHT = 100.0
# A larger distance in J, a, b is not the wanted appearance.
_REACHED = 1e-2
# Gauss-Newton: most iterations, fractions of a step, the change that ends it, and flat starts.
_ITERATIONS, _FRACTIONS, _SETTLED, _GREYS = 60, 0.5 ** np.arange(8), 1e-8, (0.05, 0.8)
# Steps of difference quotients: of a reflectance, and relative ones of tristimulus values.
_PAINT_STEP, _COLOUR_STEP = 1e-6, 1e-5
# X, Y and Z below this fraction of the white's Y count as this; as in `Viewing.conditions`.
_MIN_XYZ = 1e-6


def cube_paint_for_radiosity(
    wanted: ArrayLike,
    reflectance: Reflectances,
    emission: ArrayLike,
    walls: Sequence[int] = (0,),
    grid: SpectralGrid = DEFAULT_GRID,
) -> Array:
    """Return the paint with which a wall of the cube has a wanted radiosity, in closed form.

    With q = 0.2 rho for all n painted walls, the sums s of S_j / (1 + 0.2 rho_j) and r of
    0.2 rho_j / (1 + 0.2 rho_j) over the others, and B_i and S_i of the first painted wall i,

        a q² + (a + c - b) q - b = 0,    a = (n B_i + s) / (1 - r) - B_i,    b = B_i - S_i,
                                         c = (sum of painted S_j - n S_i) / (1 - r)

    has one root of 0 or more. For a single wall it is q = b / a: the others' radiosities are
    linear in B_i.

    Parameters
    ----------
    wanted : (B,) array
        Radiosity B_i of the first of ``walls``, W/m² per band.
    reflectance, emission, grid
        The room, as in `cube_radiosity`; reflectances of the painted walls have no effect.
    walls : sequence of int
        The walls with this paint, 0 to 5.

    Returns
    -------
    (B,) float64
        The paint's reflectance; 0 in bands where the wall has its own emission only.

    Raises
    ------
    RoomError
        As `cube_radiosity`; or if there is no such wall, or the reflectance would be below 0, or 1
        or more, in a band.
    SpectrumError
        As `cube_radiosity`.
    """
    rho = require_reflectance(reflectance, WALLS, grid)
    S = require_emission(emission, WALLS, grid)
    B = require_spectrum("wanted", wanted, grid)
    numbers = require_walls(walls, len(WALLS))
    painted = np.isin(np.arange(len(WALLS)), numbers)
    damping = 1.0 / (1.0 + FORM_FACTOR * rho[~painted])
    s, r = (damping * S[~painted]).sum(0), FORM_FACTOR * (damping * rho[~painted]).sum(0)
    count, S_i = painted.sum(), S[numbers[0]]
    a = (count * B + s) / (1.0 - r) - B
    b = B - S_i
    c = (S[painted].sum(0) - count * S_i) / (1.0 - r)
    half = 0.5 * (a + c - b)
    root = np.sqrt(np.maximum(half**2 + a * b, 0.0))
    # Of the two forms of the root, the one without cancellation.
    with np.errstate(divide="ignore", invalid="ignore"):
        q = np.where(half > 0.0, b / (half + root), (root - half) / a)
    paint = np.where(b == 0.0, 0.0, q / FORM_FACTOR)
    wrong = (b < 0.0) | ~(paint < 1.0)
    if wrong.any():
        band = int(wrong.argmax())
        place = f"{grid.wavelengths_nm[band]:g} nm"
        if b[band] < 0.0:
            problem = f"{B[band]:g} at {place} is less than the wall's emission, {S_i[band]:g} W/m²"
        else:
            problem = f"{B[band]:g} at {place} needs a reflectance of {paint[band]:g}"
        remedy = "want a reflectance of 0 to below 1: change the radiosity or the light"
        raise RoomError(problem, remedy, code="impossible", field="wanted", given=float(B[band]))
    return paint


def wall_appearance(
    reflectance: Spectrum | ArrayLike,
    irradiance: ArrayLike,
    grid: SpectralGrid = DEFAULT_GRID,
    *,
    Y_b: float | None = None,
    white: Array | None = None,
) -> Appearance:
    """Return the CIECAM02 appearance of a wall to an eye adapted to the light on it.

    Parameters
    ----------
    reflectance : Spectrum or (B,) array
    irradiance : (B,) array
        E, W/m² per band; the white is that of a perfect diffuser, L_A = E_v/π, cd/m².
    grid : SpectralGrid
        B bands within 360-830 nm.
    Y_b : float, optional
        Luminance factor of the background, percent of white; if left out, the wall's own Y: a wall
        is its own background [1, section 4.4].
    white : (B,) array, optional
        Reflectance of a white surface (eq. 6 and 8); ``irradiance`` then is (2, B), on the wall and
        on that. If left out, a perfect diffuser on the wall.

    Returns
    -------
    Appearance
        J, C and h; the surround is average.

    Raises
    ------
    RoomError
        If no visible light falls on the wall, or a shape differs.
    """
    paint = require_spectrum("reflectance", reflectance, grid)
    E = irradiance if white is not None else require_spectrum("irradiance", irradiance, grid)
    return _appearance(_wall_and_white(paint, E, grid, white), Y_b)


def irradiance_slopes(
    paint: Array, irradiance: Array, grid: SpectralGrid = DEFAULT_GRID, white: Array | None = None
) -> Array:
    """Return the derivatives (3, B) of `wall_appearance`'s J, a_C and b_C by the irradiance (B,).

    All are as there, and with a ``white`` (3, 2 B); a wall is its own background.
    """
    Q = LUMINOUS_EFFICACY * colour_matching_functions(grid)
    slopes = _colour_slopes(_wall_and_white(paint, irradiance, grid, white), None)
    rho = 1.0 if white is None else white
    wall = slopes[:, :4] @ np.vstack([Q * paint, Q[1:2]])
    on_white = slopes[:, 4:] @ np.vstack([Q * rho, Q[1:2]])
    return wall + on_white if white is None else np.hstack([wall, on_white])


def atlas_appearance(
    colour: Spectrum | str | ArrayLike, grid: SpectralGrid = DEFAULT_GRID
) -> Appearance:
    """Return the CIECAM02 appearance of a colour in an atlas: D65, 2000 lx, Y_b = 20 [1, 4.4].

    ``colour`` is a reflectance, X Y Z under D65 with Y = 100 for white, or a word of `colour_XYZ`,
    such as ``"#ffd9b3"``; ``grid`` is that on which D65 is taken. Raises SpectrumError as
    `colour_XYZ`.
    """
    D65 = light("D65", grid)
    white = white_XYZ(D65)
    if isinstance(colour, Spectrum):
        XYZ = XYZ_from_spectra(D65, colour)
    else:
        XYZ = colour_XYZ(colour, white)
    colours = np.concatenate([XYZ, [100.0], white, [100.0]])
    return _appearance(colours * (_ATLAS_LUX / 100.0), _ATLAS_Y_B)


def appearance_distance(one: Appearance, other: Appearance) -> Array:
    """Return the distances (...) in J, a_C = C cos h and b_C = C sin h [1, section 4.4]."""
    return np.asarray(np.linalg.norm(_coordinates(one) - _coordinates(other), axis=-1))


@dataclass(frozen=True, slots=True, eq=False)
class WallPaint:
    """A paint found for a wall, and its look there."""

    reflectance: Spectrum
    """Smooth, between 0 and 1."""
    appearance: Appearance
    """CIECAM02 appearance of the wall in its room."""
    distance: float
    """Distance from the wanted appearance in J, a_C, b_C; below 0.01."""


def paint_for_appearance(
    wanted: Appearance,
    irradiance: Callable[[Array], ArrayLike],
    grid: SpectralGrid = DEFAULT_GRID,
    *,
    Y_b: float | None = None,
) -> WallPaint:
    """Return the smoothest paint with which a wall looks as wanted in its room.

    Minimises the squared second differences of the reflectance, between 0 and 1, under the
    condition that J, a_C and b_C are the wanted ones. Each iteration linearises them, including the
    change of the light by the paint, and solves a quadratic program (Gauss-Newton).

    Parameters
    ----------
    wanted : Appearance
        Under conditions of its own, such as `atlas_appearance`.
    irradiance : function
        Takes the paint (B,), solves the room, and returns the irradiance (B,) of the wall, W/m² per
        band. Bands are independent; other walls may have the same paint.
    grid : SpectralGrid
        B bands within 360-830 nm.
    Y_b : float, optional
        As in `wall_appearance`.

    Raises
    ------
    RoomError
        If no paint looks as wanted in this room; ``given`` is the smallest distance found. Or if no
        light falls on the wall.

    Examples
    --------
    A cube with an emitting wall of grey 0.5, whose other walls get the paint:

    >>> from volspec.room import cube_irradiance, cube_radiosity, irradiance_from_lux, with_paint
    >>> walls = range(1, 6)
    >>> emission = np.zeros((6, 81))
    >>> emission[0] = irradiance_from_lux(light("A"), 3000.0)
    >>> def irradiance(paint):
    ...     reflectance = with_paint(np.full((6, 81), 0.5), paint, walls)
    ...     return cube_irradiance(cube_radiosity(reflectance, emission))[1]
    >>> found = paint_for_appearance(atlas_appearance("#ffd9b3"), irradiance)
    >>> bool(found.distance < 1e-3)
    True
    """
    target = _coordinates(wanted)
    if target.shape != (3,) or not np.isfinite(target).all():
        raise RoomError.refused("wanted", wanted, "give one appearance, finite J, C and h", "shape")
    wall = _PaintedWall(irradiance, grid, Y_b)
    bend = _second_derivatives(grid)

    def cost(paint: Array) -> float:
        miss = _coordinates(wall.appearance(paint)) - target
        return float(_WEIGHT**2 * (miss @ miss) + np.sum((bend @ paint) ** 2))

    paint = np.full(grid.size, np.clip((target[0] / 100.0) ** 2, *_GREYS))
    for _ in range(_ITERATIONS):
        move, before = _linearised_optimum(wall, bend, paint, target) - paint, cost(paint)
        moves = (fraction * move for fraction in _FRACTIONS)
        move = next((step for step in moves if cost(paint + step) < before), np.zeros(grid.size))
        paint = paint + move
        if np.abs(move).max() < _SETTLED:
            break
    look = wall.appearance(paint)
    distance = float(appearance_distance(look, wanted))
    if not distance <= _REACHED:
        raise RoomError(
            f"no paint looks so in this room; the nearest found is {distance:.2g} away in J, a, b",
            "want less chroma or another lightness, or change the light",
            code="impossible",
            field="wanted",
            given=distance,
        )
    spectrum = Spectrum(grid.wavelengths_nm, paint, "paint", {"designed": "yes"})
    return WallPaint(spectrum, look, distance)


@dataclass(frozen=True, slots=True, eq=False)
class _PaintedWall:
    """A wall whose light depends on its paint; see `paint_for_appearance`."""

    irradiance: Callable[[Array], ArrayLike]
    grid: SpectralGrid
    Y_b: float | None

    def appearance(self, paint: Array) -> Appearance:
        """Return the appearance with a paint (B,)."""
        return wall_appearance(paint, self.irradiance(paint), self.grid, Y_b=self.Y_b)

    def slopes(self, paint: Array) -> Array:
        """Return the derivatives (3, B) of J, a_C and b_C by the paint (B,)."""
        E = require_spectrum("irradiance", self.irradiance(paint), self.grid)
        step = np.where(paint < 0.5, _PAINT_STEP, -_PAINT_STEP)
        E_slope = (stack(self.irradiance(paint + step), self.grid) - E) / step
        Q = LUMINOUS_EFFICACY * colour_matching_functions(self.grid)
        light_slope = Q[1:2] * E_slope
        by_paint = np.vstack([Q * (E + paint * E_slope), light_slope, Q * E_slope, light_slope])
        return _colour_slopes(_wall_and_white(paint, E, self.grid), self.Y_b) @ by_paint


def _linearised_optimum(wall: _PaintedWall, bend: Array, paint: Array, target: Array) -> Array:
    """Return the smoothest paint (B,) whose J, a_C and b_C, linearised at a paint, are wanted."""
    slopes, size = wall.slopes(paint), len(paint)
    offset = target - _coordinates(wall.appearance(paint)) + slopes @ paint
    blocks = {
        "paint": EquationBlock(size, np.full(size, _MIN), np.full(size, _MAX)),
        "miss": EquationBlock(3, np.full(3, -np.inf), np.full(3, np.inf)),
    }
    terms = [
        Term({"paint": slopes, "miss": -np.eye(3)}, offset, np.inf, "appearance"),
        Term({"miss": np.eye(3)}, np.zeros(3), _WEIGHT, "distance"),
        Term({"paint": bend}, np.zeros(len(bend)), 1.0, "smoothness"),
    ]
    return solve(blocks, terms).values["paint"]


def _second_derivatives(grid: SpectralGrid) -> Array:
    """Return the matrix (B - 2, B) of second derivatives per (10 nm)², over the root of B - 2."""
    differences = np.diff(np.eye(grid.size), 2, axis=0)
    return differences * (10.0 / grid.step_nm) ** 2 / np.sqrt(len(differences))


def _coordinates(appearance: Appearance) -> Array:
    """Return J, a_C and b_C, (..., 3)."""
    return opponents("wall_paint", appearance.J, appearance.C, appearance.h)


def _wall_and_white(
    paint: Array, irradiance: ArrayLike, grid: SpectralGrid, white: Array | None = None
) -> Array:
    """Return (8,) X, Y, Z of a wall's radiosity and lux on it; the same of the white."""
    Q, E = LUMINOUS_EFFICACY * colour_matching_functions(grid), np.atleast_2d(irradiance)
    on_white = E[-1] if white is None else white * E[-1]
    return np.concatenate([Q @ (paint * E[0]), Q[1:2] @ E[0], Q @ on_white, Q[1:2] @ E[-1]])


def _appearance(wall_and_white: Array, Y_b: float | None) -> Appearance:
    """Return the appearance of a wall: eq. 4-6 and 9, from `_wall_and_white`."""
    wall, white = np.split(wall_and_white, 2)
    lux = float(wall[3])
    if not min(lux, float(white[1])) > 0.0:
        thing = "wall" if white[1] > 0.0 else "white"
        raise RoomError(f"no visible light on the {thing}", "let a patch emit", code="missing")
    wall, white = (rho[:3] * (100.0 / rho[3]) for rho in (wall, white))
    viewing = Viewing(L_A=lux / np.pi, Y_b=float(wall[1]) if Y_b is None else Y_b)
    return ciecam02.forward(wall, viewing.conditions(white))


def _colour_slopes(wall_and_white: Array, Y_b: float | None) -> Array:
    """Return the derivatives (3, 8) of `_appearance`'s J, a_C and b_C, by central differences."""
    columns = []
    # A red light may have no Z at all.
    sizes = np.maximum(wall_and_white, _MIN_XYZ * wall_and_white[3])
    for step in np.diag(_COLOUR_STEP * sizes):
        # A black wall is at the end of the range.
        ends = [np.maximum(wall_and_white + sign * step, 0.0) for sign in (1, -1)]
        ends = [_coordinates(_appearance(end, Y_b)) for end in ends]
        columns.append((ends[0] - ends[1]) / (2.0 * step.sum()))
    return np.stack(columns, axis=1)
