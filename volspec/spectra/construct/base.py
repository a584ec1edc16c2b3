"""Base spectra for mixing reflectances, measured and extended by Bouguer's law; and the result.

    reflectances -> [base] -> construct

References
----------
[1] Wang, Xu & Sun (2004), section 3. Eq. 5 is Bouguer's law for a transmittance,
    T = 10^(-a l). With the absorptivity a = -log10 R, a path of length l reflects R^l, which
    preserves the hue; eq. 6 as printed, 10^(-R l), results in the complementary hue.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.library.reflectances import reflectance, sample_tables
from volspec.spectra.spectrum import real_array, reflectance_values

Array = NDArray[np.float64]

POWERS = (0.5, 2.0, 4.0, 8.0)
"""Path lengths l besides 1: from half as thick (paler) to eight times (more saturated)."""
# All measured sets except the ColorChecker (used for testing) and metals (not paints).
_MEASURED = ("CES/", "TCS/", "TCS 1995/", "PMC/", "VS/", "VS 7.4/", "Vrhel/", "ACES/")
_FLATS = ("black", "white")
# Flat greys, nearly even in lightness and closer to each other than to measured spectra, so that a
# grey ramp stays neutral instead of picking up the casts of different paints.
_GREYS = np.linspace(0.03, 0.99, 120) ** 2.2


@dataclass(frozen=True, slots=True, eq=False)
class BaseSpectra:
    """Reflectances from which others are mixed.

    Parameters
    ----------
    names : K strings
    values : (K, N) array
        Reflectances, 0 to 1; read-only.
    grid : SpectralGrid
        N bands.

    Raises
    ------
    SpectrumError
        If names and values do not fit together, there are fewer than four (a tetrahedron), or
        a value is outside of 0 to 1.
    """

    names: tuple[str, ...]
    values: Array
    grid: SpectralGrid = DEFAULT_GRID

    def __post_init__(self) -> None:
        values = reflectance_values(real_array(self.values, "base spectra"), self.grid, "base")
        if values.ndim != 2 or len(self.names) != len(values) or len(values) < 4:
            raise SpectrumError(
                f"base spectra: {len(self.names)} names, values of shape {values.shape}; give "
                f"(K, {self.grid.size}) and K names, K at least 4",
                code="shape",
            )
        if values.max() > 1:
            row = int(values.max(1).argmax())
            raise SpectrumError(
                f"base spectrum {self.names[row]!r} reflects {values[row].max():.9g}; expected 0 "
                "to 1, clip it"
            )
        values.flags.writeable = False
        object.__setattr__(self, "names", tuple(map(str, self.names)))
        object.__setattr__(self, "values", values)

    def __len__(self) -> int:
        return len(self.names)

    def __reduce__(self) -> tuple[type[BaseSpectra], tuple[object, ...]]:
        return BaseSpectra, (self.names, self.values, self.grid)


def bouguer(reflectances: ArrayLike, length: float, *, complementary: bool = False) -> Array:
    """Return reflectances R, 0 to 1, over another path length l by Bouguer's law [1]: R^l.

    ``complementary`` uses eq. 6 as printed, 10^(-R l): the complementary hue, but still a valid
    spectrum.
    """
    R = real_array(reflectances, "reflectances")
    if not (np.isfinite(R).all() and np.all((R >= 0) & (R <= 1))):
        raise SpectrumError("Bouguer's law: a reflectance is outside of 0 to 1; clip it first")
    if not (np.isfinite(length) and length > 0):
        raise SpectrumError.refused("length", length, "give a number above 0")
    return 10.0 ** (-R * length) if complementary else R**length


def base_spectra(
    grid: SpectralGrid = DEFAULT_GRID,
    powers: Sequence[float] = POWERS,
    *,
    complementary: Sequence[float] = (),
) -> BaseSpectra:
    """Return 533 measured reflectances of the library, extended by Bouguer's law, and greys.

    The measured sets are CES, TCS, PMC, VS, Vrhel and ACES of `reflectance_names`; ColorChecker is
    left out, because constructions are tested on it.

    Parameters
    ----------
    grid : SpectralGrid
    powers : sequence of float
        Lengths l of R^l (`bouguer`).
    complementary : sequence of float
        Lengths l of 10^(-R l), eq. 6 of [1] as printed.

    Returns
    -------
    BaseSpectra
        Black, white, the measured spectra, those for each length, and 120 greys; named ``CES/12``,
        ``CES/12^2``, ``10^(-2 CES/12)`` and ``grey 21.8 %``.

    Examples
    --------
    >>> base = base_spectra(powers=(2,))
    >>> len(base), base.names[2], base.names[-1]
    (1188, 'PMC/Caucasian', 'grey 97.8 %')
    """
    return _base(grid, tuple(map(float, powers)), tuple(map(float, complementary)))


# About 1 MB each.
@lru_cache(maxsize=8)
def _base(
    grid: SpectralGrid, powers: tuple[float, ...], complementary: tuple[float, ...]
) -> BaseSpectra:
    measured = [name for name in sample_tables() if name.startswith(_MEASURED)]
    # Noise and interpolation slightly exceed 0 to 1.
    R = np.clip([reflectance(name, grid).values for name in measured], 0.0, 1.0)
    names = [*_FLATS, *measured]
    rows = [np.array([reflectance(name, grid).values for name in _FLATS]), R]
    for length in powers:
        names += [f"{name}^{length:g}" for name in measured]
        rows.append(bouguer(R, length))
    for length in complementary:
        names += [f"10^(-{length:g} {name})" for name in measured]
        rows.append(bouguer(R, length, complementary=True))
    names += [f"grey {100 * level:.3g} %" for level in _GREYS]
    rows.append(np.repeat(_GREYS[:, None], grid.size, axis=1))
    return BaseSpectra(tuple(names), np.vstack(rows), grid)


ROUTES = ("tetrahedron", "delaunay", "extended", "smoothest", "nearest", "recovered")
"""Origin of a reflectance: mixed in the paper's tetrahedron or in Delaunay's; extended smoothly
from a mixture on the hull of the base colours; the smoothest; one with the nearest possible colour;
or recovered with colour-science, where the colour may be off."""

_MIN_SHARE = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class MadeReflectances:
    """Reflectances for an array of colours; the arrays are read-only.

    Parameters
    ----------
    values : (..., N) float64
        0 to 1.
    route : (...) uint8
        Index into `ROUTES`.
    vertices : (..., 4) int
        Rows of the base spectra that were mixed or extended; -1 if there are none.
    shares : (..., 4) float64
        Weights of these rows, with sum 1; 0 if there are none.
    base : BaseSpectra
    """

    values: NDArray[np.float64]
    route: NDArray[np.uint8]
    vertices: NDArray[np.intp]
    shares: NDArray[np.float64]
    base: BaseSpectra

    def __post_init__(self) -> None:
        shape = self.values.shape[:-1]
        if not (
            self.route.shape == shape
            and self.vertices.shape == self.shares.shape == (*shape, 4)
            and self.values.shape[-1:] == (self.base.grid.size,)
        ):
            raise SpectrumError(
                f"made reflectances: values {self.values.shape}, route {self.route.shape}, "
                f"vertices {self.vertices.shape}, shares {self.shares.shape}; expected (..., "
                f"{self.base.grid.size}), (...), (..., 4) and (..., 4)",
                code="shape",
            )
        for name in ("values", "route", "vertices", "shares"):
            view = getattr(self, name).view()
            view.flags.writeable = False
            object.__setattr__(self, name, view)

    def counts(self) -> dict[str, int]:
        """Count the colours by route, for those of `ROUTES` that occur."""
        numbers = np.bincount(self.route.ravel(), minlength=len(ROUTES)).tolist()
        return {name: n for name, n in zip(ROUTES, numbers, strict=True) if n}

    def mix(self, index: Sequence[int] = ()) -> dict[str, float]:
        """Return the base spectra in one reflectance with their weights, largest first."""
        rows, weights = self.vertices[tuple(index)], self.shares[tuple(index)]
        parts = [
            (self.base.names[row], float(weight))
            for row, weight in zip(rows.tolist(), weights, strict=True)
            if weight > _MIN_SHARE
        ]
        return dict(sorted(parts, key=lambda part: -part[1]))
