"""What panels say, without a window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from volspec.pipeline import raycast
from volspec.relight import LightRig, RelightSpec
from volspec.viewer.model import viewing
from volspec.viewer.model.document import Document
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.viewing import with_viewing
from volspec.viewer.ui.context import Results, UiContext
from volspec.viewer.ui.lights_rows import row_tip
from volspec.viewer.ui.viewing import white_text
from volspec.viewer.ui.widgets import pack_colour


def test_a_search_finds_every_word_and_what_starts_with_it_first() -> None:
    from volspec.viewer.ui.lights_library import matching

    assert matching("d65")[0] == "D65"
    found = matching("fl")
    assert found[0].startswith("FL") and all("fl" in name.casefold() for name in found)
    assert matching("no such light") == []


def test_swatches_show_tungsten_orange_and_what_adapts_to_it_nearly_white(
    state: ViewState,
) -> None:
    from volspec.viewer.ui.light_look import adapted_colour, raw_colour

    tungsten = state.lights[1].rig
    raw, adapted = raw_colour(tungsten), adapted_colour(tungsten, state.relight)
    assert raw[0] == pytest.approx(1.0) and raw[2] < 0.5
    assert min(adapted) > 0.85


def test_swatches_are_kept(state: ViewState) -> None:
    from volspec.viewer.ui.light_look import adapted_colour

    first = adapted_colour(state.lights[0].rig, state.relight)
    assert adapted_colour(state.lights[0].rig, state.relight) is first


def test_a_colour_is_packed_with_its_own_opacity_and_one_more() -> None:
    """imgui packs alpha, blue, green, red, the highest byte first."""

    assert pack_colour((1.0, 0.0, 0.2)) == 0xFF3300FF
    assert pack_colour((1.0, 0.0, 0.2, 0.4), 0.5) == 0x333300FF


def test_settings_that_do_not_go_together_are_left_as_they_are(state: ViewState) -> None:
    from volspec.viewer.model.viewing import with_model

    seen = with_viewing(RelightSpec(), adapting="pixel")
    assert with_model(seen, "Hunt").viewing.adapting == "picture"
    assert with_viewing(seen, model="Hunt") is seen
    assert with_viewing(seen, discount=True).viewing.discount
    assert viewing.set_white(state, -1.0) is state


def test_luminance_follows_the_light_until_it_is_given(state: ViewState) -> None:
    assert viewing.set_luminance(state, 5.0) is state
    own = viewing.toggle_own_luminance(state)
    np.testing.assert_allclose(own.relight.viewing.L_A, 1000 / np.pi * 0.2)
    assert viewing.set_luminance(own, 5.0).relight.viewing.L_A == 5.0
    assert viewing.toggle_own_luminance(own).relight.viewing == state.relight.viewing


def test_a_brighter_display_is_adapted_to(state: ViewState) -> None:
    display = state.relight.viewing.display
    brighter = viewing.set_white(state, 3 * display.white_cd_m2).relight.viewing.display
    np.testing.assert_allclose(brighter.L_A, 3 * display.L_A)


def test_settings_as_they_are_or_of_no_such_name_change_nothing(state: ViewState) -> None:
    now = state.relight.viewing
    assert viewing.set_model(state, now.model) is state
    assert viewing.set_gamut(state, now.display.gamut) is state
    assert viewing.set_exposure(state, now.exposure) is state
    for name in ("model", "adapting", "surround", "room", "space", "gamut", "mode", "level"):
        assert getattr(viewing, f"set_{name}")(state, "no such") is state


def test_a_room_is_named_until_its_numbers_change() -> None:
    from volspec.appearance.presets import PRESETS
    from volspec.viewer.ui.viewing import preset_of

    for name, each in PRESETS.items():
        display = replace(each.display("Display P3", "reduce"), mark=True)
        assert preset_of(display) == name
        assert preset_of(replace(display, Y_b=33.0)) == "own numbers"


def test_the_lights_own_lux_come_before_the_viewings(state: ViewState) -> None:
    """L_A is E_v/π · Y_b/100."""
    from volspec.viewer.model.viewing import luminance

    viewing, plain = state.relight.viewing, state.lights[0].rig
    assert luminance(plain, viewing) == pytest.approx(1000 / np.pi * 0.2)
    lit = LightRig(plain.lights, illuminance_lux=(50.0,))
    assert luminance(lit, viewing) == pytest.approx(50 / np.pi * 0.2)
    # D65 of CIE 15:2004; bands of 10 nm lose the fourth digit.
    assert white_text(state.lights).startswith("Adopted white: x 0.312")


def test_values_far_from_zero_are_counted_as_those_near_it() -> None:
    """Steps of 1/64 are exact in float32 up to 2^18."""
    from volspec.viewer.model.document import histogram
    from volspec.volume import Volume

    near = np.arange(64, dtype=np.float32).reshape(4, 4, 4) / 64
    counts = histogram(Volume(near))
    assert counts.sum() == 64
    np.testing.assert_array_equal(histogram(Volume(near + np.float32(2**17))), counts)
    assert histogram(Volume(1e6 + near)).sum() == 64


@pytest.mark.parametrize("logarithmic", [False, True])
def test_histogram_bars_stay_within_the_plot(logarithmic: bool) -> None:
    from volspec.viewer.ui.transfer_plot import bars

    for counts in (np.zeros(256), np.r_[1e9, np.ones(255)]):
        heights = bars(counts, logarithmic)
        assert np.isfinite(heights).all() and heights.min() >= 0 and heights.max() <= 1


def test_the_status_line_tells_coarse_from_whole(state: ViewState, document: Document) -> None:
    from volspec.viewer.ui.menus import sizes, timings

    here = UiContext()
    assert sizes(state, here) == "casting …"
    camera = state.view.camera(document.volume)
    coarse = Results(raycast(document.volume, document.transfer, camera, (40, 30)))
    here.results = coarse
    assert sizes(state, here) == "160 × 120, refining (1/4)"
    here.results = replace(coarse, whole=True, fps=59.9, ms={"cast": 12.3})
    assert sizes(state, here) == "160 × 120" and timings(here) == "60 fps   cast 12 ms"


def test_names_and_titles_are_told_in_one_line(state: ViewState) -> None:
    from volspec.viewer.ui.commands import commands_of

    name = "north\nwindow\t\x07\u202e"
    row = replace(state.lights[0], name=name, label="of\r\nglass")
    assert row_tip(row) == "north window\nof glass"
    lights = replace(state, lights=(row, *state.lights[1:]))
    titles = [command.title for command in commands_of(lights, ())]
    assert "north window alone, of glass" in titles
    assert lights.lights[0].name == name
