"""Individual observers: colour-matching functions of a population of healthy eyes.

    cone fundamentals, grid -> [observers] -> palette report

Ages, the densities of lens, macula and photopigments, and the peaks of the photopigments differ
from eye to eye: what matches to the standard observer need not match to others.

References
----------
[1] CIE 170-1:2006, "Fundamental chromaticity diagram with physiological axes - Part 1": cone
    fundamentals of an age and a field size.
[2] Asano, Fairchild & Blondé (2016), "Individual Colorimetric Observer Model", PLoS ONE 11(2),
    e0145671: deviations of eight parameters, table 5, step 2.
[3] CIE 170-2:2015: from cone fundamentals to XYZ.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import asset
from volspec.errors import SpectrumError
from volspec.spectra.datasets import Observer, colour_matching_functions
from volspec.spectra.files.tables import read_table
from volspec.spectra.grid import SpectralGrid

Array = NDArray[np.float64]

POPULATION = 1000
"""Observers of a population."""
AGES = (20, 70)
"""Range of their ages, years; all are equally frequent."""
_STANDARD_AGE = 32.0
# [3], by field size in degrees: rows X, Y, Z; columns L, M, S with peaks of 1.
_XYZ_FROM_LMS = {
    2: np.array(
        [
            [1.94735469, -1.41445123, 0.36476327],
            [0.68990272, 0.34832189, 0.0],
            [0.0, 0.0, 1.93485343],
        ]
    ),
    10: np.array(
        [
            [1.93986443, -1.34664359, 0.43044935],
            [0.69283932, 0.34967567, 0.0],
            [0.0, 0.0, 2.14687945],
        ]
    ),
}


@dataclass(frozen=True, slots=True)
class Eyes:
    """Parameters of observers, an array (n,) each; the average of a standard observer is 0.

    Parameters
    ----------
    age : years
    lens, macula, L, M, S : relative deviation of the peak density
    shift_L, shift_M, shift_S : shift of the photopigment's absorbance, nm
    """

    age: Array
    lens: Array
    macula: Array
    L: Array
    M: Array
    S: Array
    shift_L: Array
    shift_M: Array
    shift_S: Array


# Standard deviations of [2].
_DEVIATIONS = {
    "lens": 0.187,
    "macula": 0.365,
    "L": 0.09,
    "M": 0.09,
    "S": 0.074,
    "shift_L": 2.0,
    "shift_M": 1.5,
    "shift_S": 1.3,
}


def random_eyes(count: int = POPULATION, seed: int = 0) -> Eyes:
    """Draw observers: ages evenly from `AGES`, the rest normally with the deviations of [2]."""
    random = np.random.default_rng(seed)
    age = random.uniform(*AGES, count)
    drawn = {name: sigma * random.standard_normal(count) for name, sigma in _DEVIATIONS.items()}
    # No density is below 0.
    limits = {name: -np.inf if name.startswith("shift") else -1.0 for name in drawn}
    return Eyes(age, **{name: np.maximum(values, limits[name]) for name, values in drawn.items()})


def standard_eye(age: float = _STANDARD_AGE) -> Eyes:
    """Return the observer of [1] of an age."""
    return Eyes(np.array([age]), *np.zeros((len(fields(Eyes)) - 1, 1)))


def cone_fundamentals(eyes: Eyes, field_deg: int = 2) -> tuple[Array, Array]:
    """Return wavelengths (79,), 390 to 780 nm, and L, M, S (n, 3, 79) of observers [1, 2].

    Energy-based; each cone has the same area for all, that of the standard observer [3], so that
    all see equal energy as white, as [2] scales them.
    """
    if field_deg not in _XYZ_FROM_LMS:
        raise SpectrumError.refused("field_deg", field_deg, "give 2 or 10")
    LMS, nm = _fundamentals(eyes, field_deg), _components()[0]
    standard: Observer = "CIE 2015 2" if field_deg == 2 else "CIE 2015 10"
    grid = SpectralGrid(nm[0], nm[-1], nm[1] - nm[0])
    area_XYZ = colour_matching_functions(grid, standard).sum(axis=1)
    area = np.linalg.solve(_XYZ_FROM_LMS[field_deg], area_XYZ)
    return nm, LMS * (area[:, None] / LMS.sum(axis=2, keepdims=True))


def _fundamentals(eyes: Eyes, field_deg: int) -> Array:
    from scipy.interpolate import CubicSpline

    nm, absorbance, macular, ageing, constant = _components()
    # [1], equations for the field size: peak densities of macula and photopigments.
    macula = 0.485 * np.exp(-field_deg / 6.132) * (1.0 + eyes.macula)
    narrow = np.exp(-field_deg / 1.333)
    peaks = (0.38 + 0.54 * narrow) * (1.0 + np.stack([eyes.L, eyes.M]))
    peaks = np.vstack([peaks, (0.30 + 0.45 * narrow) * (1.0 + eyes.S)])
    # [1]: the lens grows denser with age, faster from 60 on.
    older = np.where(
        eyes.age <= 60.0, 1.0 + 0.02 * (eyes.age - 32.0), 1.56 + 0.0667 * (eyes.age - 60.0)
    )
    media = (older[:, None] * ageing + constant) * (1.0 + eyes.lens)[:, None]
    transmitted = 10.0 ** -(media + macula[:, None] * macular) * nm
    cones = []
    shifts = eyes.shift_L, eyes.shift_M, eyes.shift_S
    for row, peak, shift in zip(absorbance, peaks, shifts, strict=True):
        finite = np.isfinite(row)
        shifted_nm = nm - shift[:, None]
        dense = 10.0 ** CubicSpline(nm[finite], row[finite])(shifted_nm)
        # S has no table beyond 615 nm, where it is below a millionth.
        dense = dense if finite.all() else np.where(shifted_nm <= nm[finite][-1], dense, 0.0)
        cones.append((1.0 - 10.0 ** (-peak[:, None] * dense)) * transmitted)
    return np.stack(cones, axis=1)


@cache
def _components() -> tuple[Array, Array, Array, Array, Array]:
    """Return wavelengths, log absorbances (3, N), macular pigment, ageing and constant media."""
    table = read_table(asset("data/spectra/cone-fundamentals.csv"))
    return table.wavelengths_nm, table.columns.T[:3], *table.columns.T[3:]


@lru_cache(maxsize=4)
def population(grid: SpectralGrid, field_deg: int = 2) -> Array:
    """Return colour-matching functions (n, 3, N) of `random_eyes` on a grid; always the same.

    They are 0 beyond 390 to 780 nm, as the tables of [1].

    >>> population(SpectralGrid(400, 700, 10)).shape
    (1000, 3, 31)
    """
    nm, LMS = cone_fundamentals(random_eyes(), field_deg)
    XYZ = np.einsum("ij,njk->nik", _XYZ_FROM_LMS[field_deg], LMS)
    full_nm = np.arange(360.0, 831.0, 5.0)
    values = np.zeros((full_nm.size, XYZ.shape[0] * 3))
    first = int(np.searchsorted(full_nm, nm[0]))
    values[first : first + nm.size] = XYZ.reshape(-1, nm.size).T
    Q = grid.band_means(full_nm, values).T.reshape(-1, 3, grid.size)
    Q.flags.writeable = False
    return Q
