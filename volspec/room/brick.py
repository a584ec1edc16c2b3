"""Radiosity in a brick-shaped room: a window in one wall, furniture along the other three.

    quantities -> [brick] -> wall_paint

Nine unknowns: floor, ceiling, the wall around the window, and the three other walls, each with an
upper part and a lower one for the furniture. The window emits and reflects nothing. Form factors
are exact: every pair of patches is a sum of pairs of axis-aligned rectangles in closed form.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 4.3.
[2] Ehlert & Smith (1993), "View Factors for Perpendicular and Parallel Rectangular Plates",
    J. Thermophysics and Heat Transfer 7(1), 173-175; Howell, "A Catalog of Radiation Heat
    Transfer Configuration Factors", C-13 and C-15.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from volspec.errors import RoomError
from volspec.room.quantities import (
    Array,
    Reflectances,
    irradiance_from_lux,
    require_emission,
    require_reflectance,
)
from volspec.settings import Finite, Fraction, Hint, Pair, Positive, Unit, settings
from volspec.spectra import DEFAULT_GRID, SpectralGrid, Spectrum, stack

SURFACES = (
    *("floor", "ceiling", "window wall"),
    *("left upper", "right upper", "back upper"),
    *("left lower", "right lower", "back lower"),
)
"""Surfaces with a paint, in the order of reflectances: the nine unknowns."""
PATCHES = (*SURFACES, "window")
"""All patches, in the order of emission, radiosity and irradiance."""
# A window may reach beyond its wall by this fraction of the wall's size, which is rounding.
_ROUNDING = 1e-9

Size = Annotated[Positive, Unit("m")]
Window = Annotated[
    tuple[Finite, Finite, Positive, Positive],
    Field(strict=False),
    Hint("x and y of its lower left corner on the wall, width and height, in m", whole=True),
]


@settings(RoomError)
@dataclass(frozen=True, slots=True)
class Brick:
    """An empty room with axis-aligned walls.

    Raises
    ------
    RoomError
        If a size is not above 0, or the window is not within its wall.

    Examples
    --------
    >>> office = Brick(4.0, 5.0, 2.7, window_m=(1.0, 0.9, 2.0, 1.4), furnished=0.3)
    >>> office.form_factors.sum(axis=1).round(9).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """

    width_m: Size
    """Length of the wall with the window and of the wall opposite."""
    depth_m: Size
    """Length of the two other walls."""
    height_m: Size
    """Height of all walls."""
    window_m: Window | None = None
    """The window, as x, y, width and height: x from one end of its wall, y from the floor."""
    furnished: Fraction = 0.0
    """Fraction of the height up to which furniture covers the three walls without a window."""

    def __post_init__(self) -> None:
        if self.window_m is None:
            return
        for start, size, wall in zip(self.window_m[:2], self.window_m[2:], self._wall, strict=True):
            slack = _ROUNDING * wall
            if start < -slack or start + size > wall + slack:
                width, height = self._wall
                raise RoomError(
                    "",
                    f"keep the window within its wall, {width:g} × {height:g} m",
                    field="window_m",
                    given=self.window_m,
                )

    @property
    def _wall(self) -> tuple[float, float]:
        """Width and height of the wall with the window, m."""
        return self.width_m, self.height_m

    @property
    def areas_m2(self) -> Array:
        """(10,) areas of `PATCHES`, m²; 0 for a patch that the room lacks."""
        return _geometry(self)[0]

    @property
    def form_factors(self) -> Array:
        """(10, 10) form factors F_ij of `PATCHES`; rows sum to 1, or 0 for a patch without area.

        Sums are exact to 1e-9 for patches of 1 mm² or more in rooms of some metres; smaller ones
        lose digits, as differences of large terms.
        """
        return _geometry(self)[1]

    def window_emission(
        self, light: Spectrum, lux: float, grid: SpectralGrid = DEFAULT_GRID
    ) -> Array:
        """Return the emission (10, B), W/m² per band, of the window as a Lambertian sky.

        Parameters
        ----------
        light : Spectrum
            The sky's spectrum, on any scale.
        lux : float
            Luminous exitance of the window, lm/m²: the illuminance of its plane by the sky.
        grid : SpectralGrid
            B bands.

        Raises
        ------
        RoomError
            If there is no window, or lux are not above 0.
        SpectrumError
            As `volspec.spectra.spectrum.light_power`.
        """
        if self.window_m is None:
            raise RoomError("missing", "give the window", code="missing", field="Brick.window_m")
        emission = np.zeros((len(PATCHES), grid.size))
        emission[-1] = irradiance_from_lux(light, lux, grid)
        return emission

    def radiosity(
        self, reflectance: Reflectances, emission: ArrayLike, grid: SpectralGrid = DEFAULT_GRID
    ) -> Array:
        """Return the radiosity of all patches: B = S + rho F B, one 9 x 9 system per band.

        Parameters
        ----------
        reflectance : (9, B) array, nine spectra, or one (B,) for all surfaces
            In the order of `SURFACES`, from 0 to below 1.
        emission : (10, B) array
            In the order of `PATCHES`, W/m² per band; see `window_emission`.
        grid : SpectralGrid
            B bands.

        Returns
        -------
        (10, B) float64
            W/m² per band; the window's is its emission.

        Raises
        ------
        RoomError, SpectrumError
            As `require_reflectance` and `require_emission`.
        """
        rho = require_reflectance(reflectance, SURFACES, grid)
        S = require_emission(emission, PATCHES, grid)
        count = len(SURFACES)
        F = self.form_factors[:count]
        source = S[:count] + rho * np.outer(F[:, count], S[count])
        system = np.eye(count) - rho.T[:, :, None] * F[:, :count]
        return np.vstack([np.linalg.solve(system, source.T[..., None])[..., 0].T, S[count:]])

    def irradiance(self, radiosity: ArrayLike, grid: SpectralGrid = DEFAULT_GRID) -> Array:
        """Return the irradiance (10, B) of all patches at their radiosity (10, B), W/m² per band.

        Equals (B_i - S_i) / rho_i, eq. 8 of [1]; 0 on a patch without area.
        """
        return self.form_factors @ stack(radiosity, grid)


# Axis-aligned rectangles, and the exchange areas between them.


@lru_cache(maxsize=32)
def _geometry(brick: Brick) -> tuple[Array, Array]:
    """Return areas (10,), m², and form factors (10, 10), read-only."""
    patches = _patches(brick)
    areas = np.array([sum(map(_area, parts)) for parts in patches])
    exchange = np.zeros((len(patches), len(patches)))
    for i, j in combinations(range(len(patches)), 2):
        total = sum(exchange_area(a, b) for a in patches[i] for b in patches[j])
        exchange[i, j] = exchange[j, i] = max(total, 0.0)  # below 0 by rounding
    form_factors = exchange / np.where(areas > 0.0, areas, 1.0)[:, None]
    areas.flags.writeable = form_factors.flags.writeable = False
    return areas, form_factors


def _patches(brick: Brick) -> list[list[Array]]:
    """Return the rectangles (3, 2), m, of each of `PATCHES`; x along the window's wall, z up.

    A rectangle's rows are the lowest and highest x, y and z, which are equal along its normal.
    """
    w, d, h = brick.width_m, brick.depth_m, brick.height_m
    furnished = brick.furnished * h
    x = z = (0.0, 0.0)
    if brick.window_m is not None:
        left, bottom, width, height = brick.window_m
        x, z = _snap_range(left, left + width, w), _snap_range(bottom, bottom + height, h)
    left_right_back = ((0, 0), (0, d)), ((w, w), (0, d)), ((0, w), (d, d))
    upper, lower = (furnished, h), (0, furnished)
    patches = [
        [_rectangle((0, w), (0, d), (0, 0))],
        [_rectangle((0, w), (0, d), (h, h))],
        [
            _rectangle((0, w), (0, 0), (0, z[0])),  # below the window
            _rectangle((0, w), (0, 0), (z[1], h)),
            _rectangle((0, x[0]), (0, 0), z),  # on either side
            _rectangle((x[1], w), (0, 0), z),
        ],
        *([_rectangle(a, b, part)] for part in (upper, lower) for a, b in left_right_back),
        [_rectangle(x, (0, 0), z)],
    ]
    return [[part for part in parts if _area(part) > 0.0] for parts in patches]


def _rectangle(x: Pair, y: Pair, z: Pair) -> Array:
    return np.array([x, y, z], dtype=np.float64)


def _snap_range(start: float, end: float, size: float) -> tuple[float, float]:
    """Return a range on a wall, its ends moved to the wall's where only rounding parts them."""
    slack = _ROUNDING * size
    return (0.0 if start < slack else start), (size if end > size - slack else end)


def _area(rectangle: Array) -> float:
    """Return the area, m²; one of the three sizes is 0."""
    a, b, c = np.ptp(rectangle, axis=1)
    return float(a * b + b * c + c * a)


def exchange_area(one: ArrayLike, other: ArrayLike) -> float:
    """Return A_1 F_12 = A_2 F_21, m², of two axis-aligned rectangles that face each other [2].

    Parameters
    ----------
    one, other : (3, 2) arrays
        Lowest and highest x, y and z, m, equal along the normal. Neither reaches behind the plane
        of the other; rectangles in one plane exchange nothing.

    Examples
    --------
    >>> floor, ceiling, wall = (
    ...     [(0, 1), (0, 1), (0, 0)],
    ...     [(0, 1), (0, 1), (1, 1)],
    ...     [(0, 0), (0, 1), (0, 1)],
    ... )
    >>> round(exchange_area(floor, ceiling), 6), round(exchange_area(floor, wall), 6)
    (0.199825, 0.200044)
    """
    a, b = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    normal_a, normal_b = int(np.ptp(a, axis=1).argmin()), int(np.ptp(b, axis=1).argmin())
    if normal_a == normal_b:
        distance = abs(a[normal_a, 0] - b[normal_a, 0])
        if distance == 0.0:
            return 0.0
        u, v = (axis for axis in range(3) if axis != normal_a)
        return _signed_sum(_parallel(distance), a[u], b[u], a[v], b[v])
    edge = 3 - normal_a - normal_b
    # Distances from the line in which the planes meet.
    from_b = np.sort(np.abs(a[normal_b] - b[normal_b, 0]))
    from_a = np.sort(np.abs(b[normal_a] - a[normal_a, 0]))
    return _signed_sum(_perpendicular, from_b, from_a, a[edge], b[edge])


Corner = Callable[[Array, Array, Array, Array], Array]
"""The fourfold antiderivative of the form factor's kernel, at coordinates of two corners."""


def _signed_sum(antiderivative: Corner, *ranges: Array) -> float:
    """Return the fourfold integral over ranges (2,): 16 values with alternating signs."""
    sign = np.array([-1.0, 1.0])
    signs = np.einsum("i,j,k,l->ijkl", sign, sign, sign, sign)
    return float((signs * antiderivative(*np.ix_(*ranges))).sum())


def _parallel(distance: float) -> Corner:
    """Return C-13's function of two rectangles in parallel planes at a distance, m."""

    def corner(x: Array, xi: Array, y: Array, eta: Array) -> Array:
        dx, dy = x - xi, y - eta
        over_x, over_y = np.hypot(dx, distance), np.hypot(dy, distance)
        sides = dy * over_x * np.arctan(dy / over_x) + dx * over_y * np.arctan(dx / over_y)
        squares = dx**2 + dy**2 + distance**2
        return (sides - 0.5 * distance**2 * np.log(squares)) / (2.0 * np.pi)

    return corner


def _perpendicular(x: Array, xi: Array, y: Array, eta: Array) -> Array:
    """Return C-15's function: x and xi are distances from the planes' line, y and eta along it."""
    dy, over = y - eta, np.hypot(x, xi)
    squares = over**2 + dy**2
    # On the line itself the last term is 0, the limit of t log t.
    logarithm = np.log(np.where(squares > 0.0, squares, 1.0))
    side = dy * over * np.arctan2(dy, over)
    return (side - 0.25 * (over**2 - dy**2) * logarithm) / (2.0 * np.pi)
