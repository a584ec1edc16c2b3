"""Individual observers: the average one is CIE's, and the others differ as published."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import SpectrumError
from volspec.spectra import SpectralGrid
from volspec.spectra.datasets import observers
from volspec.spectra.observers import (
    _XYZ_FROM_LMS,
    cone_fundamentals,
    population,
    random_eyes,
    standard_eye,
)


@pytest.mark.parametrize("field", [2, 10])
def test_the_average_observer_is_that_of_cie_2015(field: int) -> None:
    nm, LMS = cone_fundamentals(standard_eye(), field)
    table_nm, xyz = observers()[f"CIE 2015 {field} Degree Standard Observer"]
    samples = xyz[np.isin(table_nm, nm)].T
    # The tables have 5 decimals, and a peak between two samples.
    assert np.abs(_XYZ_FROM_LMS[field] @ LMS[0] - samples).max() < 2e-3 * samples.max()


def test_populations_are_always_the_same_and_vary_as_published() -> None:
    eyes = random_eyes(20_000)
    again = random_eyes(20_000)
    for each in fields(eyes):
        assert np.array_equal(getattr(eyes, each.name), getattr(again, each.name))
    assert eyes.age.min() >= 20 and eyes.age.max() <= 70
    assert eyes.lens.std() == pytest.approx(0.187, rel=0.03)
    # Cut off at no density at all, 2.7 deviations below the mean.
    assert eyes.macula.min() >= -1 and eyes.macula.std() == pytest.approx(0.365, rel=0.03)
    shifts = [each.std() for each in (eyes.shift_L, eyes.shift_M, eyes.shift_S)]
    assert shifts == pytest.approx([2.0, 1.5, 1.3], rel=0.03)


def test_all_observers_see_equal_energy_as_white() -> None:
    Q = population(SpectralGrid(390, 780, 5))
    whites = Q.sum(axis=2)
    assert whites == pytest.approx(np.broadcast_to(whites[0], whites.shape))
    assert whites[0] / whites[0, 1] == pytest.approx([1, 1, 1], abs=2e-3)


def test_lenses_grow_yellow_with_age_and_shifts_move_the_peaks() -> None:
    young, old = (cone_fundamentals(standard_eye(age))[1][0] for age in (20, 70))
    blue, yellow = 10, 36  # 440 and 570 nm
    assert old[2, blue - 6] / old[2, blue + 6] < 0.75 * young[2, blue - 6] / young[2, blue + 6]
    assert old[0, yellow] == pytest.approx(young[0, yellow], rel=0.06)
    for cone, name in enumerate(("shift_L", "shift_M", "shift_S")):
        nm, LMS = cone_fundamentals(replace(standard_eye(), **{name: np.array([4.0])}))
        standard = cone_fundamentals(standard_eye())[1]
        moved = (LMS - standard)[0] @ nm / LMS.sum(axis=2)[0]
        assert 1.5 < moved[cone] < 4.5 and np.abs(np.delete(moved, cone)).max() < 1e-9
    assert (LMS >= 0).all()


def test_other_fields_are_refused() -> None:
    with raises(SpectrumError, "range", "field_deg"):
        cone_fundamentals(standard_eye(), 4)
