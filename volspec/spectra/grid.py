"""Equidistant wavelength grid, and band means of spectra on it.

    [grid] -> spectrum -> photometry, library -> basis

A value on a grid is the mean over its band (lambda_k +- step/2), so a narrow emission line keeps
its energy at any step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import SpectrumError

# Wavelengths closer than this count as equal; far below any table's precision.
_SAME_NM = 1e-6


@dataclass(frozen=True)
class SpectralGrid:
    """Equidistant band centres in nanometres.

    Parameters
    ----------
    start_nm, stop_nm : float
        First and last band centre; the last one is included.
    step_nm : float
        Distance between centres and width of each band.

    Raises
    ------
    SpectrumError
        If a number is not finite, the step is not positive, fewer than two bands result,
        or the range is not a whole number of steps.

    Examples
    --------
    >>> SpectralGrid().size
    81
    """

    start_nm: float = 380.0
    stop_nm: float = 780.0
    step_nm: float = 5.0

    def __post_init__(self) -> None:
        for field in ("start_nm", "stop_nm", "step_nm"):
            # One float type, so that grids made from 400 and 400.0 have equal hashes.
            object.__setattr__(self, field, float(getattr(self, field)))
        text = f"{self.start_nm:g}-{self.stop_nm:g}/{self.step_nm:g} nm"
        if not all(math.isfinite(v) for v in (self.start_nm, self.stop_nm, self.step_nm)):
            raise SpectrumError(
                f"{text}: not finite; give finite start, stop and step", field="grid"
            )
        if self.step_nm <= 0 or self.start_nm <= 0 or self.stop_nm <= self.start_nm:
            raise SpectrumError(
                f"{text}: not a grid; expected 0 < start < stop and a positive step", field="grid"
            )
        steps = (self.stop_nm - self.start_nm) / self.step_nm
        if not math.isfinite(steps):
            raise SpectrumError(
                f"{text}: too many steps to count; give a longer step", code="size", field="grid"
            )
        if abs(steps - round(steps)) * self.step_nm > _SAME_NM:
            raise SpectrumError(
                f"{text}: the range is {steps:g} steps, expected a whole number; "
                f"use stop_nm={self.start_nm + math.floor(steps) * self.step_nm:g}",
                field="grid",
            )

    @property
    def size(self) -> int:
        """Number of bands, N."""
        return round((self.stop_nm - self.start_nm) / self.step_nm) + 1

    @property
    def wavelengths_nm(self) -> NDArray[np.float64]:
        """(N,) band centres, nm."""
        return self.start_nm + self.step_nm * np.arange(self.size, dtype=np.float64)

    def __str__(self) -> str:
        return f"{self.start_nm:g}-{self.stop_nm:g} nm every {self.step_nm:g} nm"

    def band_means(self, wavelengths_nm: ArrayLike, values: ArrayLike) -> NDArray[np.float64]:
        """Return the mean of the piecewise-linear interpolant over every band, integrated exactly.

        Samples that already lie on this grid (same step and phase) are band values and are
        returned unchanged. The first and last band may be covered only partly, as long as their
        centres are covered: their means are over the covered part.

        Parameters
        ----------
        wavelengths_nm : (L,) array
            Strictly increasing, nm.
        values : (L,) or (L, K) array
            One or K spectra.

        Returns
        -------
        (N,) or (N, K) float64

        Raises
        ------
        SpectrumError
            If shapes differ, wavelengths do not increase, or a band's centre is not covered.

        Examples
        --------
        >>> SpectralGrid(400, 420, 10).band_means([390, 430], [0, 40]).tolist()
        [10.0, 20.0, 30.0]
        """
        w = np.asarray(wavelengths_nm, dtype=np.float64)
        v = np.asarray(values, dtype=np.float64)
        if w.ndim != 1 or w.size < 2 or v.ndim not in (1, 2) or v.shape[0] != w.size:
            raise SpectrumError(
                f"band_means: wavelengths have shape {w.shape}, values {v.shape}; "
                "expected (L,) with L >= 2 and (L,) or (L, K)",
                code="shape",
            )
        if not np.all(np.diff(w) > 0):
            raise SpectrumError("band_means: wavelengths must increase strictly; sort them")
        centres = self.wavelengths_nm
        self._check_coverage(w)
        first = int(np.argmin(np.abs(w - centres[0])))
        samples = w[first : first + self.size]
        if samples.size == self.size and np.abs(samples - centres).max() <= _SAME_NM:
            # Consecutive samples are at consecutive centres: the table has our step and phase.
            return v[first : first + self.size].copy()
        low = np.maximum(centres - self.step_nm / 2, w[0])
        high = np.minimum(centres + self.step_nm / 2, w[-1])
        width = (high - low).reshape((-1,) + (1,) * (v.ndim - 1))
        return (_integral(w, v, high) - _integral(w, v, low)) / width

    def _check_coverage(self, wavelengths_nm: NDArray[np.float64]) -> None:
        missing = []
        if wavelengths_nm[0] > self.start_nm + _SAME_NM:
            missing.append(f"{self.start_nm:g}-{min(wavelengths_nm[0], self.stop_nm):g} nm")
        if wavelengths_nm[-1] < self.stop_nm - _SAME_NM:
            missing.append(f"{max(wavelengths_nm[-1], self.start_nm):g}-{self.stop_nm:g} nm")
        if missing:
            raise SpectrumError(
                f"spectrum covers {wavelengths_nm[0]:g}-{wavelengths_nm[-1]:g} nm, but the grid is "
                f"{self}; {' and '.join(missing)} missing: give data there or use a smaller grid"
            )


def _integral(
    w: NDArray[np.float64], v: NDArray[np.float64], x: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the integral of the interpolant from w[0] to each x."""
    tail = (1,) * (v.ndim - 1)
    step = np.diff(w).reshape((-1,) + tail)
    cumulative = np.concatenate(
        [np.zeros((1,) + v.shape[1:]), np.cumsum(step * (v[1:] + v[:-1]) / 2, axis=0)]
    )
    i = np.clip(np.searchsorted(w, x, side="right") - 1, 0, w.size - 2)
    dx = (x - w[i]).reshape((-1,) + tail)
    slope = (v[i + 1] - v[i]) / step[i]
    return cumulative[i] + dx * (v[i] + slope * dx / 2)


DEFAULT_GRID = SpectralGrid()
"""380-780 nm every 5 nm: 81 bands."""
PAPERS_GRID = SpectralGrid(400.0, 700.0, 10.0)
"""400-700 nm every 10 nm: 31 bands, the papers' sampling and the default of the first version."""


def grid_of_values(count: int) -> SpectralGrid:
    """Return the grid of values in a file that names none: 31 are from the first version."""
    return PAPERS_GRID if count == PAPERS_GRID.size else DEFAULT_GRID
