"""Worked examples printed in the papers, as ``papers/README.md`` confirms them."""

import numpy as np
import pytest

from volspec.appearance.constants import HPE_FROM_CAT02
from volspec.appearance.models.cam import CamConditions, CamTransform, forward, inverse
from volspec.appearance.models.cielab import XYZ_from_cielab, cielab

# Neumann et al. (2004), table 2: T (K), L_A (cd/m²), white XYZ, stimulus XYZ; Y_b = 18.
NEUMANN = {
    7500: (954.93, (87.12, 90.00, 112.95), (61.34, 59.94, 50.07)),
    6000: (636.62, (87.38, 90.00, 93.91), (62.586, 60.407, 41.622)),
    4500: (318.31, (89.32, 90.00, 68.24), (65.421, 61.100, 30.243)),
}


def neumann(temperature: int) -> CamConditions:
    L_A, white, _ = NEUMANN[temperature]
    return CamConditions.of(white, L_A, Y_b=18.0)


def test_pastel_of_neumann_table_2_has_the_printed_appearance():
    seen = forward(NEUMANN[7500][2], neumann(7500))
    # Four decimals of the errata file's recomputation; the paper prints two.
    np.testing.assert_allclose([seen.J, seen.C, seen.h], [81.5925, 21.5576, 59.4027], atol=5e-5)


@pytest.mark.parametrize("temperature", [6000, 4500])
def test_pastel_of_neumann_table_2_keeps_its_appearance_under_another_planck_radiator(temperature):
    expected = NEUMANN[temperature][2]
    seen = forward(NEUMANN[7500][2], neumann(7500))
    there = inverse(seen.J, seen.C, seen.h, neumann(temperature))
    at_once = CamTransform.between(neumann(7500), neumann(temperature)).apply(NEUMANN[7500][2])
    # Half a unit of the third decimal.
    np.testing.assert_allclose(there, expected, atol=6e-4)
    np.testing.assert_allclose(at_once, there, rtol=1e-12)


def test_matrix_of_neumann_equation_26_has_the_corrected_entries():
    assert HPE_FROM_CAT02[0, 2] == pytest.approx(0.0410057, abs=5e-8)
    assert HPE_FROM_CAT02[1, 2] == pytest.approx(0.0904451, abs=5e-8)
    assert HPE_FROM_CAT02[2, 2] == pytest.approx(1.0153256, abs=5e-8)


# The survey's CIELAB table: XYZ, white, then L*, a*, b*, C*, h.
CIELAB_CASES = [
    ((19.01, 20.00, 21.78), (95.05, 100.0, 108.88), (51.84, 0.00, -0.01, 0.01, 270.0)),
    ((57.06, 43.06, 31.96), (95.05, 100.0, 108.88), (71.60, 44.22, 18.11, 47.79, 22.3)),
    ((3.53, 6.56, 2.14), (109.85, 100.0, 35.58), (30.78, -42.69, 2.30, 42.75, 176.9)),
    ((19.01, 20.00, 21.78), (109.85, 100.0, 35.58), (51.84, -13.77, -52.86, 54.62, 255.4)),
]


@pytest.mark.parametrize("XYZ, white, expected", CIELAB_CASES)
def test_cielab_table_of_the_survey_is_reproduced(XYZ, white, expected):
    L, a, b = cielab(XYZ, white)
    # Two decimals are printed.
    np.testing.assert_allclose([L, a, b, np.hypot(a, b)], expected[:4], atol=6e-3)
    # The first case's chroma is 0.01: its hue is known to some ten degrees only.
    hue = np.degrees(np.arctan2(b, a)) % 360.0
    assert hue == pytest.approx(expected[4], abs=0.06 if expected[3] > 1.0 else 20.0)
    np.testing.assert_allclose(XYZ_from_cielab([L, a, b], white), XYZ, rtol=1e-12)
