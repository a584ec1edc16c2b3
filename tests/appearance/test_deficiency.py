"""Simulated colour-vision deficiencies: the papers' matrices, and what a dichromat confuses."""

from dataclasses import replace

import numpy as np
import pytest

from volspec.appearance import Display, Viewing
from volspec.appearance.display.deficiency import DEFICIENCIES, severity_steps, simulation
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.gamut_mapping import DisplayOutput, screen_for_viewing
from volspec.appearance.lut3d import LutKey
from volspec.appearance.models.lab import cielab, delta_E_2000

sRGB = SPACES["sRGB"]
KINDS = DEFICIENCIES[1:]
# Brettel's half-planes in linear sRGB as libDaltonLens publishes them: with Smith & Pokorny's cones
# and Judd & Vos's observer, where ours is the CIE 1931 one: 0.0104 apart.
BRETTEL_TRITAN = {
    "above": (1.01277, 0.13548, -0.14826, -0.01243, 0.86812, 0.14431, 0.07589, 0.80500, 0.11911),
    "below": (0.93678, 0.18979, -0.12657, 0.06154, 0.81526, 0.1232, -0.37562, 1.12767, 0.24796),
}
BRETTEL = {  # the half-plane of 575 nm
    "protan": (0.1457, 1.16172, -0.30742, 0.10816, 0.85291, 0.03892, 0.00386, -0.00524, 1.00139),
    "deutan": (0.37298, 0.88166, -0.25464, 0.25954, 0.63506, 0.1054, -0.0198, 0.02784, 0.99196),
}


def colours(count: int = 500) -> np.ndarray:
    return np.random.default_rng(5).random((count, 3))


@pytest.mark.parametrize(
    ("name", "theirs"), [("protan", "Protanomaly"), ("deutan", "Deuteranomaly")]
)
@pytest.mark.parametrize("severity", [0.1, 0.3, 0.8, 1.0])
def test_protan_and_deutan_are_machado_s(name, theirs, severity):
    import colour

    truth = colour.matrix_cvd_Machado2009(theirs, severity)
    made = simulation(name, severity, sRGB)
    # Published with six decimals. Between steps colour-science 0.4.7 goes on from the next two.
    np.testing.assert_allclose(made.apply(colours()), colours() @ truth.T, atol=1e-6)


@pytest.mark.parametrize("name", BRETTEL)
def test_dichromats_of_both_papers_are_alike(name):
    """Their mean difference is far below what the deficiency changes."""
    own = np.clip(simulation(name, 1.0, sRGB).apply(colours()), 0.0, 1.0)
    other = np.clip(colours() @ np.reshape(BRETTEL[name], (3, 3)).T, 0.0, 1.0)

    def apart(one: np.ndarray, two: np.ndarray) -> float:
        labs = (cielab(each @ sRGB.XYZ_from_RGB.T, sRGB.white_XYZ) for each in (one, two))
        return float(np.mean(delta_E_2000(*labs)))

    off, changed = apart(own, other), apart(own, colours())
    print(f"{name}: CIEDE2000 {off:.2f} from Brettel's; the deficiency changes {changed:.2f}")
    assert off < 3.0 < 12.0 < changed


def test_tritan_is_brettel_s_and_continuous():
    made = simulation("tritan", 1.0, sRGB)
    for side, published in BRETTEL_TRITAN.items():
        np.testing.assert_allclose(getattr(made, side).ravel(), published, atol=0.011)
    # The maps agree on the plane between them.
    along = np.linalg.svd(made.plane[None])[2][1:]
    np.testing.assert_allclose(along @ made.above.T, along @ made.below.T, atol=1e-12)
    # Brettel's is a projection: once projected, colours stay.
    seen = made.apply(colours())
    np.testing.assert_allclose(made.apply(seen), seen, atol=1e-9)
    half = simulation("tritan", 0.5, sRGB).apply(colours())
    np.testing.assert_allclose(half, (seen + colours()) / 2.0, atol=1e-12)


@pytest.mark.parametrize("name", KINDS)
def test_a_dichromat_has_two_dimensions_and_confuses_colours_along_the_third(name):
    made = simulation(name, 1.0, sRGB)
    for matrix in (made.above, made.below):
        values = np.linalg.svd(matrix)[1]
        assert values[2] < 1e-5 < 0.5 < values[1]
    confused = np.linalg.svd(made.above)[2][2]
    pair = 0.5 + np.array([[0.1], [-0.1]]) * confused
    if name != "tritan":  # its confused colours may be on both sides of the plane
        np.testing.assert_allclose(*made.apply(pair), atol=2e-6)
    weaker = simulation(name, 0.5, sRGB).apply(pair)
    assert 1e-3 < np.ptp(weaker, axis=0).max() < np.ptp(pair, axis=0).max()


@pytest.mark.parametrize("space", SPACES)
def test_whites_and_greys_of_every_display_stay(space):
    greys = np.linspace(0.0, 1.0, 5)[:, None] * np.ones(3)
    for name in KINDS:
        for severity in (0.3, 1.0):
            seen = simulation(name, severity, SPACES[space]).apply(greys)
            np.testing.assert_allclose(seen, greys, atol=2e-6)  # the tables' rounding


def test_a_colour_is_simulated_alike_on_every_display_of_one_white():
    P3 = SPACES["Display P3"]
    XYZ = colours() @ sRGB.XYZ_from_RGB.T
    for name in KINDS:
        seen = [
            simulation(name, 1.0, space).apply(XYZ @ space.RGB_from_XYZ.T) @ space.XYZ_from_RGB.T
            for space in (sRGB, P3)
        ]
        # Both spaces have D65's white, with four and five digits.
        np.testing.assert_allclose(*seen, atol=1e-3)


def test_the_screen_is_untouched_without_a_deficiency_or_severity():
    XYZ = 100.0 * colours(64).reshape(8, 8, 3) @ sRGB.XYZ_from_RGB.T / 100.0
    plain = DisplayOutput.of(Display()).codes(XYZ)
    for name in DEFICIENCIES:
        zero = screen_for_viewing(Viewing(deficiency=name, severity=0.0))
        assert zero.simulation is None and np.array_equal(zero.codes(XYZ), plain)
    assert screen_for_viewing(Viewing(severity=0.5)).simulation is None
    deutan = screen_for_viewing(Viewing(deficiency="deutan"))
    assert np.abs(deutan.codes(XYZ) - plain).max() > 0.1


def test_no_lut_is_baked_again_for_another_deficiency():
    one = Viewing(model="Hunt")
    white = np.array([95.0, 100.0, 109.0])
    other = replace(one, deficiency="tritan", severity=0.4)
    assert LutKey.of(one, white) == LutKey.of(other, white)


def test_the_steps_cover_zero_to_one():
    for steps in severity_steps(sRGB).values():
        between = steps.at(0.55).above, (steps.at(0.5).above + steps.at(0.6).above) / 2.0
        np.testing.assert_allclose(*between, atol=1e-12)
        np.testing.assert_allclose(steps.at(0.0).above, np.eye(3), atol=1e-15)
        assert np.array_equal(steps.at(1.0).above, steps.above[-1])
