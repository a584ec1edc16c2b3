"""PQ and HLG against BT.2100 and colour-science; what is brighter than white."""

import colour
import numpy as np
import pytest

from volspec.appearance import Display
from volspec.appearance.display.hdr import (
    PQ_PEAK,
    Hdr,
    hlg_decode,
    hlg_encode,
    pq_decode,
    pq_encode,
)
from volspec.appearance.display.spaces import SPACES

SPACE = SPACES["Rec. 2020"]


@pytest.mark.parametrize(
    ("luminance", "code"),
    # BT.2408, tables 1 and 4; BT.2100: 10 000 cd/m² is 1.
    [(0.0, 0.0), (100.0, 0.5081), (203.0, 0.5807), (1000.0, 0.7518), (4000.0, 0.9026), (1e4, 1.0)],
)
def test_pq_has_the_code_values_of_bt_2100(luminance, code):
    assert float(pq_encode(luminance / PQ_PEAK)) == pytest.approx(code, abs=5e-5)
    grey = luminance / 203.0 * SPACE.white_XYZ
    assert Hdr(peak_cd_m2=1e4).codes(grey) == pytest.approx(code, abs=5e-5)


def test_hlg_shows_reference_white_at_75_percent_and_the_peak_at_100():
    """BT.2408, table 1: HLG on a display of 1000 cd/m²."""
    hdr = Hdr("HLG")
    assert hdr.codes(SPACE.white_XYZ) == pytest.approx(0.75, abs=5e-4)
    assert hdr.codes(1000.0 / 203.0 * SPACE.white_XYZ) == pytest.approx(1.0, abs=1e-7)
    assert hdr.codes(0.0 * SPACE.white_XYZ) == pytest.approx(0.0)


def test_curves_are_those_of_colour_science():
    luminances = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 400)])
    ours = pq_encode(luminances / PQ_PEAK)
    # BT.2100's formula leaves 7.3e-7 at 0: a twentieth of a step of 16 bits.
    np.testing.assert_allclose(ours, colour.models.eotf_inverse_BT2100_PQ(luminances), atol=8e-7)
    scene = np.linspace(0.0, 1.0, 400)
    with np.errstate(invalid="ignore"):
        theirs = colour.models.oetf_BT2100_HLG(scene)
    np.testing.assert_allclose(hlg_encode(scene), theirs, atol=1e-8)
    # Less saturated than what HLG must dim.
    RGB = (0.4 + 0.4 * np.random.default_rng(2).random((200, 3))) * 1000.0
    for peak in (400.0, 1000.0, 2000.0):
        hdr = Hdr("HLG", peak_cd_m2=peak)
        shown = RGB * (peak / 1000.0)
        with np.errstate(invalid="ignore"):
            theirs = np.minimum(colour.models.eotf_inverse_BT2100_HLG(shown, L_W=peak), 1.0)
        XYZ = shown / 203.0 @ SPACE.XYZ_from_RGB.T
        np.testing.assert_allclose(hdr.codes(XYZ), theirs, atol=1e-5)


@pytest.mark.parametrize("hdr", [Hdr(), Hdr("PQ", 100.0, 4000.0), Hdr("HLG"), Hdr("HLG", 300.0)])
def test_luminances_undo_codes(hdr):
    RGB = np.random.default_rng(1).random((500, 3)) ** 3 * hdr.headroom
    if hdr.transfer == "HLG":  # which cannot show a blue as bright as white
        RGB *= 0.5
    codes = hdr.codes(RGB @ SPACE.XYZ_from_RGB.T)
    assert codes.min() >= 0.0 and codes.max() <= 1.0
    np.testing.assert_allclose(hdr.luminances(codes), RGB * hdr.white_cd_m2, rtol=1e-6, atol=1e-4)
    codes = np.linspace(0.0, 1.0, 300)
    np.testing.assert_allclose(pq_encode(pq_decode(codes)), codes, atol=1e-12)
    np.testing.assert_allclose(hlg_encode(hlg_decode(codes)), codes, atol=1e-12)


def test_highlights_survive_up_to_the_peak_and_keep_their_colour():
    hdr = Hdr()
    # White, twice white, a bright orange, and it four times as bright, beyond the peak.
    RGB = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [4.0, 2.0, 1.0], [16.0, 8.0, 4.0]])
    shown = hdr.luminances(hdr.codes(RGB @ SPACE.XYZ_from_RGB.T))
    np.testing.assert_allclose(shown[:3], 203.0 * RGB[:3], rtol=1e-9)
    np.testing.assert_allclose(shown[3], [1000.0, 500.0, 250.0], rtol=1e-9)
    # Outside of the gamut a channel is clipped at 0; what is no number is black.
    odd = np.array([[-0.5, 1.0, 1.0], [np.nan, np.nan, np.nan]]) @ SPACE.XYZ_from_RGB.T
    np.testing.assert_allclose(
        hdr.luminances(hdr.codes(odd)), [[0.0, 203.0, 203.0], [0.0, 0.0, 0.0]], atol=1e-6
    )


def test_a_display_keeps_its_room():
    seen = Hdr(white_cd_m2=300.0).display(Display(L_A=None, Y_b=10.0, surround="dim"))
    assert (seen.space, seen.white_cd_m2, seen.surround) == ("Rec. 2020", 300.0, "dim")
    assert seen.adapting_luminance == pytest.approx(30.0)
