"""Correlated colour temperature against colour-science's locus and lines across it."""

from __future__ import annotations

import numpy as np
import pytest
from colour import MSDS_CMFS
from colour.temperature import CCT_to_uv_Ohno2013

from volspec.spectra.photometry import C2_NM_K, correlated_temperature

OBSERVER = "CIE 1931 2 Degree Standard Observer"
# colour-science's second radiation constant is that of ITS-90.
_KELVIN_OF_THEIRS = C2_NM_K / 1.4388e7


def white(kelvin: float, Duv: float) -> list[float]:
    # Given by itself the observer is not cut at 780 nm, which moves 1000 K by 0.2 K.
    u, v = CCT_to_uv_Ohno2013(np.array([kelvin, Duv]), MSDS_CMFS[OBSERVER])
    return [1.5 * u / v, 1.0, (4.0 - u - 10.0 * v) / (2.0 * v)]


@pytest.mark.parametrize("Duv", [-0.045, -0.003, -1e-5, 0.001, 0.02, 0.045])
def test_what_lies_beside_a_temperature_has_it(Duv: float) -> None:
    for kelvin in np.geomspace(1010, 99_000, 25):
        found = correlated_temperature(white(kelvin, Duv))
        assert found is not None
        # A parabola through rows 0.2 % apart; measured 2e-5 and 5e-8.
        assert found.kelvin == pytest.approx(kelvin * _KELVIN_OF_THEIRS, rel=5e-5)
        assert found.Duv == pytest.approx(Duv, abs=1e-6)


def test_there_is_none_beyond_the_table_or_far_from_the_locus() -> None:
    for kelvin, Duv in ((990, 0), (102_000, 0), (5000, 0.051), (5000, -0.051), (600, 0.01)):
        assert correlated_temperature(white(kelvin, Duv)) is None, (kelvin, Duv)
