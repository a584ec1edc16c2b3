"""Resampling keeps energy: band means times the step have the integral of the table."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from volspec.spectra import SpectralGrid

GRIDS = [SpectralGrid(400, 700, 10), SpectralGrid(360, 830, 5), SpectralGrid(360, 830, 1)]
# The order of the sums differs: 500 float64 terms bound the relative error near 1e-13.
REL = 1e-12


def integral(w: NDArray, v: NDArray, low: float, high: float) -> float:
    """Trapezoids between low and high, exact for the piecewise-linear interpolant."""
    inner = w[(w > low) & (w < high)]
    at = np.concatenate([[low], inner, [high]])
    return float(np.trapezoid(np.interp(at, w, v), at))


def energies(grid: SpectralGrid, w: NDArray, v: NDArray) -> tuple[float, float]:
    half = grid.step_nm / 2
    after = float(grid.band_means(w, v).sum() * grid.step_nm)
    return after, integral(w, v, grid.start_nm - half, grid.stop_nm + half)


# Half a nanometre off, so that no table lies on a grid: those are band values already.
@pytest.mark.parametrize("grid", GRIDS, ids=str)
@pytest.mark.parametrize("step", [1.0, 5.0])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_regular_tables_keep_their_integral(grid: SpectralGrid, step: float, seed: int) -> None:
    w = np.arange(350.5, 845, step)
    after, before = energies(grid, w, np.random.default_rng(seed).random(w.size))
    assert after == pytest.approx(before, rel=REL)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@given(
    inner=st.lists(st.floats(351, 839), max_size=60, unique_by=lambda w: round(w, 3)),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=50, deadline=None)
def test_irregular_tables_keep_their_integral(
    grid: SpectralGrid, inner: list[float], seed: int
) -> None:
    w = np.array([350.0, *sorted(inner), 840.0])
    after, before = energies(grid, w, np.random.default_rng(seed).random(w.size))
    assert after == pytest.approx(before, rel=REL)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
@given(
    centre=st.floats(405, 695, allow_nan=False),
    width=st.floats(0.01, 2, allow_nan=False),
    power=st.floats(0.1, 1000),
)
@settings(max_examples=50, deadline=None)
def test_a_narrow_line_keeps_its_energy(
    grid: SpectralGrid, centre: float, width: float, power: float
) -> None:
    w = np.array([350, centre - width, centre, centre + width, 840])
    v = np.array([0, 0, power / width, 0, 0])
    means = grid.band_means(w, v)
    # A line 0.01 nm wide is a difference of wavelengths near 700: 1e-11 of it is rounding.
    assert means.sum() * grid.step_nm == pytest.approx(power, rel=1e-9)
    reach = np.abs(grid.wavelengths_nm - centre) > width + grid.step_nm / 2 + 1e-6
    assert means[reach] == pytest.approx(0.0, abs=1e-9 * power)


@pytest.mark.parametrize("grid", GRIDS, ids=str)
def test_tables_on_the_grid_keep_their_sum(grid: SpectralGrid) -> None:
    v = np.random.default_rng(3).random(grid.size)
    assert grid.band_means(grid.wavelengths_nm, v).sum() == v.sum()
