"""What the panels of lights work out, without a window."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from volspec.relight import LightRig
from volspec.spectra import DEFAULT_GRID, light
from volspec.viewer.model import light_parts, lights
from volspec.viewer.model.state import ViewState

AREA = (0, 20, 900, 600)


@given(at=st.floats(0, 900), left=st.floats(20, 400), right=st.floats(20, 400))
def test_names_of_both_sides_stay_in_the_picture_and_apart(
    at: float, left: float, right: float
) -> None:
    from volspec.viewer.ui.compare import label_boxes

    a, b = label_boxes(AREA, at, (left, right), 20.0, 16.0, 12.0)
    for x, y, width, height in (a, b):
        assert x >= 12 and x + width <= 888 and y >= 20 and height == 20
    side_by_side = a[0] + a[2] <= b[0] or b[0] + b[2] <= a[0]
    assert side_by_side or abs(a[1] - b[1]) >= 20
    # In the upper line they are on their own sides.
    assert a[1] > 36 or a[0] + a[2] <= at
    assert b[1] > 36 or b[0] >= at


def test_the_library_says_what_a_notation_is_or_what_is_wrong_with_it() -> None:
    from volspec.viewer.ui.lights_library import class_of, library_names, matching, verdict

    rig, wrong = verdict("D65*0.7+planck:2700*0.3", DEFAULT_GRID, ".")
    assert rig is not None and wrong == ""
    rig, wrong = verdict("D65*0.7+Q*0.3", DEFAULT_GRID, ".")
    assert rig is None and "'Q' in the mix" in wrong
    assert verdict("daylight:62", DEFAULT_GRID, ".")[1].endswith("choose one inside")
    assert verdict("lamp.csv", DEFAULT_GRID, ".") == (None, "Enter reads the file")
    assert "lamp:candle-1900" in matching("candle") and matching("sodium")[0] == "HP1"
    assert all(class_of(name) for name in library_names())
    for name in library_names():
        assert verdict(name, DEFAULT_GRID, ".")[0] is not None, name


def test_a_notation_that_is_no_light_changes_nothing_and_says_why(state: ViewState) -> None:
    for edit in (lights.add, partial(light_parts.respell, index=0, part=0)):
        new, refusal = edit(state, text="D65*0.7+Q*0.3")
        assert new is state and "'Q' in the mix" in refusal and "\n" not in refusal
        assert "there.csv" in edit(state, text="not/there.csv").message
        assert edit(state, text="FL11").message == ""


def test_a_light_without_its_colour_to_the_display_has_one_all_the_same() -> None:
    """Sodium lies outside of sRGB; a swatch is within it, its strongest channel at 1."""
    from volspec.viewer.ui.light_look import raw_colour

    for name in ("HP1", "LPS", "D65", "LED-B1"):
        colour = raw_colour(LightRig((light(name),)))
        assert min(colour) >= 0.0 and max(colour) == pytest.approx(1.0)


def test_columns_of_a_plot_lie_on_the_bands() -> None:
    from volspec.viewer.ui.light_look import column_heights
    from volspec.viewer.ui.lights_spectrum import pen_place, wavelength_share

    values = np.arange(31.0)
    np.testing.assert_allclose(column_heights(values, 31), values)
    # 15 columns a band: the middle one is the band's.
    np.testing.assert_allclose(column_heights(values, 31 * 15)[7::15], values)
    # The pen on a wavelength's tick is on its band: 550 nm is the 16th of 31.
    share = wavelength_share(550.0, DEFAULT_GRID)
    place = pen_place((share * 310.0, 0.0), (0.0, 0.0, 310.0, 50.0), 31, 2.0)
    assert place == pytest.approx((15 / 30, 2.0))
