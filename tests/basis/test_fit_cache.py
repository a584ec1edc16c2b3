"""A basis fitted again from the same input is read from the cache, equal to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises
from volspec import _cache
from volspec.basis import SpectralBasis, fit_cache
from volspec.errors import BasisError
from volspec.spectra import DEFAULT_GRID, SpectralGrid, Spectrum, light, reflectance

LIGHTS = [light("D65"), light("A"), light("FL2")]
PAINTS = [reflectance("ColorChecker/orange"), reflectance("copper"), reflectance("CES/4")]
OPTIONS: dict[str, Any] = {
    "size": 5,
    "method": "virtual-sensors",
    "positive": False,
    "grid": DEFAULT_GRID,
    "observer_deg": 2,
    "light_weights": [1.0, 0.5, 0.25],
    "reflectance_weights": [1.0, 1.0, 0.5],
    "name": "paints",
    "trained_on": "three paints",
}


@pytest.fixture
def fits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """One entry a fit; in an empty cache folder."""
    done: list[int] = []
    fit = SpectralBasis.fit

    def counted(*given: Any, **named: Any) -> SpectralBasis:
        done.append(1)
        return fit(*given, **named)

    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(SpectralBasis, "fit", counted)
    return done


@pytest.fixture
def quick(fits: list[int], monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Same as `fits`, with a fit that takes no time."""

    def fit(*given: Any, grid: SpectralGrid, **named: Any) -> SpectralBasis:
        fits.append(1)
        return SpectralBasis.bands(grid)

    monkeypatch.setattr(SpectralBasis, "fit", fit)
    return fits


def test_a_basis_read_is_the_basis_fitted_to_the_last_bit(fits: list[int]) -> None:
    plain = SpectralBasis.fit(LIGHTS, PAINTS, **OPTIONS)
    first, second = (fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS) for _ in range(2))
    assert len(fits) == 2, "the plain one, and the first"
    for basis in (first, second):
        for matrix in ("analysis", "synthesis", "XYZ_from_channels"):
            assert np.array_equal(getattr(basis, matrix), getattr(plain, matrix))
        for name in ("name", "method", "trained_on", "grid", "observer_deg"):
            assert getattr(basis, name) == OPTIONS[name]


def test_a_name_is_no_reason_to_fit_again(quick: list[int]) -> None:
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    assert fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS | {"name": "other"}).name == "other"
    assert len(quick) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"size": 4},
        {"method": "pca"},
        {"positive": True},
        {"observer_deg": 10},
        {"light_weights": [1.0, 0.5, 0.2500001]},
        {"reflectance_weights": [1.0, 0.5, 1.0]},
    ],
    ids=lambda change: next(iter(change)),
)
def test_another_option_is_fitted_again(change: dict[str, Any], quick: list[int]) -> None:
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS | change)
    assert len(quick) == 2


def test_other_spectra_are_fitted_again(quick: list[int]) -> None:
    values = PAINTS[0].values.copy()
    values[7] = np.nextafter(values[7], 1.0)
    near = Spectrum(PAINTS[0].wavelengths_nm, values)
    wide = SpectralGrid(380, 780, 10)
    for lights, paints, options in (
        (LIGHTS, PAINTS, {}),
        (LIGHTS, [near, *PAINTS[1:]], {}),
        (LIGHTS[::-1], PAINTS, {}),
        (
            [light(each.name, wide) for each in LIGHTS],
            [reflectance(each.name, wide) for each in PAINTS],
            {"grid": wide},
        ),
    ):
        fit_cache.fit_cached(lights, paints, **OPTIONS | options)
    assert len(quick) == 4


def test_other_code_fits_anew(quick: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    monkeypatch.setattr(fit_cache, "_code", lambda: "edited")
    fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS)
    assert len(quick) == 2


def test_a_fit_that_fails_fails_each_time(fits: list[int]) -> None:
    for _ in range(2):
        with raises(BasisError, "impossible"):
            fit_cache.fit_cached(LIGHTS, PAINTS, **OPTIONS | {"method": "pca", "size": 31})
    assert len(fits) == 2
