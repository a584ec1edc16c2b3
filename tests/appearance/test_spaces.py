"""Display spaces: sRGB as it always was, others against colour-science, curves both ways."""

import colour
import numpy as np
import pytest

from tests.appearance._models import ACES
from volspec.appearance.display.monitors import colour_space
from volspec.appearance.display.spaces import (
    BT_1886,
    SPACES,
    ColourSpace,
    Transfer,
    decode_sRGB,
    encode_sRGB,
    linear_sRGB_from_XYZ,
    sRGB_CURVE,
    sRGB_WHITE_XYZ,
    to_uint8,
)

# Their names in colour-science; its DCI-P3 rounds nothing, its BT.2020 has the camera's curve.
THEIRS = {
    "sRGB": "sRGB",
    "Display P3": "Display P3",
    "DCI-P3": "DCI-P3",
    "Rec. 709": "ITU-R BT.709",
    "Rec. 2020": "ITU-R BT.2020",
    "Adobe RGB (1998)": "Adobe RGB (1998)",
}
CURVES = {space.name: space.transfer for space in SPACES.values()}


def test_srgb_clips_and_encodes_as_its_space_and_as_colour_science():
    x = np.linspace(0.0, 1.0, 4097)
    assert np.array_equal(SPACES["sRGB"].encode(x), encode_sRGB(x))
    assert np.array_equal(SPACES["sRGB"].decode(x), decode_sRGB(x))
    assert encode_sRGB([-1.0, 2.0]).tolist() == [0.0, 1.0]
    # The standard's two branches miss each other by 3e-8 at the toe; both sides are allowed.
    np.testing.assert_allclose(encode_sRGB(x), colour.models.eotf_inverse_sRGB(x), atol=4e-8)
    np.testing.assert_allclose(BT_1886.decode(x), colour.models.eotf_BT1886(x), atol=1e-12)
    np.testing.assert_allclose(linear_sRGB_from_XYZ(sRGB_WHITE_XYZ), 1.0, atol=1e-14)
    assert to_uint8([0.0, 0.5, 1.0]).tolist() == [0, 128, 255]


@pytest.mark.parametrize("name", SPACES)
def test_matrices_agree_with_colour_science(name):
    theirs = colour.RGB_COLOURSPACES[THEIRS[name]]
    derived = colour.normalised_primary_matrix(theirs.primaries, theirs.whitepoint)
    # Two float64 solutions of one system; measured 3e-16.
    np.testing.assert_allclose(SPACES[name].XYZ_from_RGB / 100.0, derived, atol=1e-12)
    np.testing.assert_allclose(SPACES[name].RGB_from_XYZ @ SPACES[name].white_XYZ, 1.0, rtol=1e-13)
    assert SPACES[name].white_XYZ[1] == 100.0


@pytest.mark.parametrize("name", CURVES)
def test_curves_are_odd_monotone_and_undone(name):
    curve = CURVES[name]
    x = np.linspace(-1.5, 1.5, 3001)
    V = curve.encode(x)
    assert np.array_equal(V, -curve.encode(-x))
    assert np.all(np.diff(V) > 0.0)
    # sRGB's two thresholds, 0.0031308 and 0.04045, meet to 1e-8 only.
    np.testing.assert_allclose(curve.decode(V), x, atol=1e-8)
    np.testing.assert_allclose(curve.encode([0.0, 1.0]), [0.0, 1.0], atol=1e-15)
    wild = np.array([0.0, -0.0, 5e-324, -1e60, 1e60])
    assert np.isfinite(curve.encode(wild)).all() and np.isfinite(curve.decode(wild)).all()
    assert curve.encode(np.zeros((2, 0, 3))).shape == (2, 0, 3)


def test_icc_parametric_curves_of_type_0_and_3():
    V = np.linspace(0.0, 1.0, 257)
    np.testing.assert_allclose(Transfer.icc(2.2).decode(V), V**2.2, rtol=1e-14)
    # sRGB as profiles hold it, in s15Fixed16 numbers.
    numbers = 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045
    g, a, b, c, d = (round(v * 65536) / 65536 for v in numbers)
    curve = Transfer.icc(g, a, b, c, d)
    written = np.where(d <= V, (a * V + b) ** g, c * V)
    np.testing.assert_allclose(curve.decode(V), written, atol=5e-5)
    np.testing.assert_allclose(curve.decode(V), sRGB_CURVE.decode(V), atol=5e-5)


def test_a_matrix_and_curve_by_hand_makes_a_space():
    # A panel measured with a photometer.
    primaries = np.array([[0.65, 0.33], [0.31, 0.61], [0.15, 0.05]])
    panel = ColourSpace("my panel", primaries, np.array([0.31, 0.33]), Transfer.icc(2.35))
    XYZ = np.array([0.2, 0.5, 0.7]) @ panel.XYZ_from_RGB.T
    np.testing.assert_allclose(panel.RGB_from_XYZ @ XYZ, [0.2, 0.5, 0.7], rtol=1e-13)
    assert colour_space(panel) is panel and colour_space("sRGB") is SPACES["sRGB"]
    assert hash(panel) == hash(panel)


def test_imaginary_primaries_are_a_space_too():
    # The matrix of the standard for ACES AP0, whose blue has y < 0; four printed digits.
    np.testing.assert_allclose(ACES.XYZ_from_RGB[1] / 100, [0.3440, 0.7282, -0.0721], atol=5e-5)
