"""Colours outside of the display: what stays, what moves, and that nothing breaks."""

import numpy as np
import pytest

from tests.appearance._models import ACES, cube
from volspec.appearance import SURROUNDS
from volspec.appearance.display.spaces import SPACES
from volspec.appearance.gamut_mapping import (
    SHADER_STEPS,
    DisplayGamut,
    opponent_signals,
    reduce_chroma,
    reduce_chroma_opponent,
)
from volspec.appearance.models import cam
from volspec.appearance.models.cam import CamConditions


def knee_J(gamut: DisplayGamut) -> float:
    """Lightness up to which hue is preserved."""
    scale = gamut.conditions.white_achromatic
    return 100.0 * (gamut.knee / scale) ** gamut.conditions.lightness_power


SCENES = {
    "sRGB at its conditions": ("sRGB", 4.07, "average", None, "CIECAM02"),
    "cinema": ("DCI-P3", 9.6, "dark", None, "CIECAM02"),
    "adapted": ("Display P3", 60.0, "average", 1.0, "CIECAM02"),
    "CAM16": ("sRGB", 20.0, "dim", None, "CAM16"),
}


@pytest.fixture(params=SCENES)
def seen(request):
    name, L_A, surround, D, model = SCENES[request.param]
    space = SPACES[name]
    return space, CamConditions.of(space.white_XYZ, L_A, 20.0, SURROUNDS[surround], D, model)


def test_colours_inside_are_not_touched(seen):
    space, conditions = seen
    XYZ = cube() @ space.XYZ_from_RGB.T
    shown, mapped = reduce_chroma(XYZ, conditions, space)
    assert not mapped.any()
    assert np.array_equal(shown, XYZ)


@pytest.mark.parametrize("wide", [SPACES["Rec. 2020"], ACES], ids=["Rec. 2020", "ACES"])
@pytest.mark.parametrize("exposure", [0.3, 1.0, 4.0])
def test_wide_cubes_end_inside_without_NaN(seen, wide, exposure):
    space, conditions = seen
    shown, mapped = reduce_chroma(exposure * cube() @ wide.XYZ_from_RGB.T, conditions, space)
    linear = shown @ space.RGB_from_XYZ.T
    assert np.isfinite(shown).all() and mapped.any()
    assert linear.min() > -1e-6 and linear.max() < 1.0 + 1e-6


def test_lightness_and_hue_stay_up_to_the_knee_and_lightness_above_it(seen):
    space, conditions = seen
    XYZ = cube() @ SPACES["Rec. 2020"].XYZ_from_RGB.T
    shown, mapped = reduce_chroma(XYZ, conditions, space)
    before, after = (cam.forward(colours, conditions) for colours in (XYZ, shown))
    knee = knee_J(DisplayGamut.of(conditions, space))
    lit = mapped & (before.J > 0.0)
    J = np.minimum(before.J, 100.0)
    assert mapped.sum() > 500
    # Exact but for float64; measured 1e-11 for both.
    np.testing.assert_allclose(after.J[lit], J[lit], atol=1e-8)
    hued = lit & (knee > before.J) & (after.C > 1e-3)
    turned = (after.h - before.h + 180.0) % 360.0 - 180.0
    assert hued.sum() > 400
    assert np.abs(turned[hued]).max() < 1e-8
    assert np.all(after.C[hued] < before.C[hued])


def test_it_is_what_lowering_C_in_the_inverse_model_finds(seen):
    """Bisection of C through `cam.inverse`: another road to the same border."""
    space, conditions = seen
    XYZ = cube(9) @ SPACES["Rec. 2020"].XYZ_from_RGB.T
    shown, mapped = reduce_chroma(XYZ, conditions, space)
    look = cam.forward(XYZ, conditions)
    below = mapped & (knee_J(DisplayGamut.of(conditions, space)) > look.J) & (look.J > 1.0)
    J, C, h = look.J[below], look.C[below], look.h[below]
    low, high = np.zeros_like(C), C.copy()
    for _ in range(50):
        tried = 0.5 * (low + high)
        linear = cam.inverse(J, tried, h, conditions) @ space.RGB_from_XYZ.T
        inside = np.all((linear >= -1e-7) & (linear <= 1.0 + 1e-7), axis=-1)
        low, high = np.where(inside, tried, low), np.where(inside, high, tried)
    theirs = cam.inverse(J, low, h, conditions)
    # The border is found to 2^-32 or better by both; a grazing ray widens that. Measured 3e-7.
    off = np.abs(theirs - shown[below]).max(axis=-1)
    assert np.quantile(off, 0.99) < 1e-4, off.max()


def test_too_bright_greys_become_the_displays_white(seen):
    space, conditions = seen
    shown, mapped = reduce_chroma(np.outer([1.0001, 1.5, 20.0], space.white_XYZ), conditions, space)
    assert mapped.all()
    np.testing.assert_allclose(shown @ space.RGB_from_XYZ.T, 1.0, atol=2e-3)


def test_ramps_out_of_the_gamut_are_continuous(seen):
    """Colours from grey through the border to Rec. 2020's corners and far beyond white: no jump.

    A jump would stay as it is on a finer ramp. Eight times as fine, steps become an eighth,
    but near Rec. 2020's red, where a response passes 0 and its power 0.42 has no slope: 0.42.
    """
    space, conditions = seen

    def largest_step(corner, level, count):
        t = np.linspace(0.0, 1.0, count)[:, None]
        linear = level * (0.5 * (1.0 - t) + t * corner)
        shown, _ = reduce_chroma(linear @ SPACES["Rec. 2020"].XYZ_from_RGB.T, conditions, space)
        return np.abs(np.diff(shown @ space.RGB_from_XYZ.T, axis=0)).max()

    for corner in cube(2)[1:-1:2]:
        for level in (0.4, 1.3):
            coarse, fine = (largest_step(corner, level, n) for n in (2001, 16001))
            assert fine < 0.6 * coarse and fine < 0.02, (corner, level, coarse, fine)


def test_the_shaders_twelve_halvings_are_within_one_code(seen):
    space, conditions = seen
    gamut = DisplayGamut.of(conditions, space)
    signals = opponent_signals(cube() @ SPACES["Rec. 2020"].XYZ_from_RGB.T, conditions).T
    exact, mapped = reduce_chroma_opponent(*signals, gamut, steps=45)
    cheap, again = reduce_chroma_opponent(*signals, gamut, steps=SHADER_STEPS)
    assert np.array_equal(mapped, again)
    codes = [SPACES["sRGB"].encode(np.clip(linear, 0.0, 1.0)) * 255.0 for linear in (exact, cheap)]
    assert np.abs(codes[0] - codes[1]).max() < 1.0


def test_black_and_wild_numbers_are_black_or_finite(seen):
    space, conditions = seen
    wild = [[0, 0, 0], [-5, -9, -3], [1e6, 1e6, 1e6], [1e12, 0, 0], [0, 0, 1e9], [-1, 0, 4]]
    shown, mapped = reduce_chroma(np.array(wild), conditions, space)
    linear = shown @ space.RGB_from_XYZ.T
    assert np.isfinite(shown).all() and not mapped[0]
    assert np.array_equal(shown[:2], np.zeros((2, 3)))
    assert linear.min() > -1e-6 and linear.max() < 1.0 + 1e-6
