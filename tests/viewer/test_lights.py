"""Lights of the list: lux, groups, notation, drawn spectra, mixes, saved states and fades."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.errors import refuses
from tests.support.viewer import run_command
from tests.viewer._states import under
from volspec.appearance import Viewing
from volspec.errors import ViewingError
from volspec.raycast import Ambient, Headlight, LightGroup
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene
from volspec.scene.tables.lights import rows_by_name
from volspec.spectra import DEFAULT_GRID, light
from volspec.viewer.model import camera, light_parts, light_rows, light_states, lights
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import (
    LightRow,
    Rows,
    at_kelvin,
    draw_stroke,
    effective_weights,
    light_rig,
    with_changes,
)
from volspec.viewer.model.state import ViewState

_SCENES = Path(__file__).resolve().parents[2] / "data" / "scenes"
_SHARES = {"lamp": 0.75, "sky": 0.25}
_POWER = st.floats(-5, 50)
_PLACE = st.tuples(st.floats(-0.5, 1.5), _POWER)


def row(text: str, weight: float = 0.0, lux: float | None = None) -> LightRow:
    rig = LightRig((light(text),), illuminance_lux=None if lux is None else (lux,))
    return LightRow(
        text, text, rig, weight, texts=(text,), kelvin=light_rows.kelvin_from_text(text)
    )


_PAIR = LightRig((light("A"), light("D65")), (1.0, 0.5), None, ("lamp", "sky"))
EVENING = LightRow("evening", "", _PAIR, texts=("A", "D65"))
ROWS: Rows = (row("D65", 1.0), row("A"), row("planck:3000"), EVENING)


@pytest.fixture(scope="session")
def lit(state: ViewState) -> ViewState:
    """Four lights, the last one of two groups, over a cast with both groups."""
    groups = LightGroup("lamp", (Headlight(),)), LightGroup("sky", (Ambient(),))
    return replace(state, lights=ROWS, shading=replace(state.shading, groups=groups))


def reset(state: ViewState, index: int) -> ViewState:
    """Undo the drawing of a light."""
    return run_command(lights.choose(state, index), "reset-spectrum").state


@given(start=_PLACE, end=_PLACE, values=st.lists(st.floats(0, 10), min_size=31, max_size=31))
def test_a_stroke_touches_only_bands_under_the_pen_and_leaves_none_below_zero(start, end, values):
    old = np.array(values)
    new = draw_stroke(old, start, end)
    assert new.min() >= 0
    left, right = sorted((start[0] * 30, end[0] * 30))
    bands = np.arange(31)
    outside = (bands + 0.5 < left) | (bands - 0.5 > right)
    np.testing.assert_array_equal(new[outside], old[outside])
    # Between the ends' powers, as a straight line is.
    low, high = sorted((start[1], end[1]))
    assert np.all(new[~outside] >= max(low, 0) - 1e-9)
    assert np.all(new[~outside] <= max(high, 0) + 1e-9)


def test_a_drawn_light_is_one_of_its_own_until_it_is_reset(lit):
    dimmed = lights.set_weight(lit, 2, 0.4)
    edited = light_parts.draw(dimmed, 2, 0, (0.2, 1.0), (0.4, 2.0))
    edited = light_parts.draw(edited, 2, 0, (0.6, 1.0), (0.7, 2.0))
    drawn = edited.lights[2]
    assert (drawn.name, drawn.texts) == ("planck:3000 edited", (None,))
    assert (drawn.kelvin, drawn.weight) == (None, 0.4)
    assert edited.lights[:2] == dimmed.lights[:2] and edited.lights[3] == dimmed.lights[3]
    back = reset(edited, 2)
    assert back.lights[2] == dimmed.lights[2]
    assert reset(back, 2).lights is back.lights


def test_a_pen_cannot_put_a_light_out(lit):
    assert light_parts.draw(lit, 0, 0, (-0.1, 0.0), (1.1, 0.0)) is lit
    for index, part, power in ((0, 0, math.nan), (9, 0, 1.0), (0, 3, 1.0)):
        assert light_parts.draw(lit, index, part, (0.1, power), (0.2, 1.0)) is lit


def test_a_light_of_two_groups_is_drawn_one_spectrum_at_a_time(lit):
    edited = light_parts.draw(lit, 3, 1, (0.0, 0.0), (0.3, 0.0)).lights[3]
    assert edited.rig.lights[0] is EVENING.rig.lights[0]
    assert edited.texts == ("A", None) and edited.rig.groups == ("lamp", "sky")


def test_lux_count_where_all_that_shines_has_them(lit):
    bright = light_parts.set_lux(lit, 0, 500.0)
    assert light_rig(bright.lights).total_lux == 500.0
    assert light_rig(lights.set_weight(bright, 1, 1.0).lights).total_lux is None
    assert light_parts.set_lux(bright, 0, 0.0).lights[0].rig.illuminance_lux is None
    # A light added among lights with lux has as many.
    both = replace(lit, lights=(row("D65", 0.5, 400.0), row("A", 0.0, 50.0)))
    assert lights.add(both, "FL2").state.lights[-1].rig.illuminance_lux == (200.0,)
    assert lights.add(lit, "FL2").state.lights[-1].rig.illuminance_lux is None


def test_lux_of_groups_are_told_for_what_faces_them_all(lit):
    """500 lx from a group with three quarters of the light, half of 100 from the rest."""
    rig = light_parts.set_lux(light_parts.set_lux(lit, 3, 500.0), 3, 100.0, part=1).lights[3].rig
    assert rig.illuminance_lux == (500.0, 100.0)
    assert light_rows.facing_lux(rig, _SHARES) == pytest.approx(0.75 * 500 + 0.25 * 0.5 * 100)
    assert light_rows.facing_lux(rig, {"other": 1.0}) is None


def test_a_spectrum_for_all_groups_is_parted_and_joined_again(lit):
    parted = light_parts.split_part(light_parts.set_lux(lit, 0, 300.0), 0)
    split = parted.lights[0]
    assert split.rig.groups == ("lamp", "sky") and split.texts == ("D65", "D65")
    assert split.rig.illuminance_lux == (300.0, 300.0)
    # All groups at 300 lx, and each at 300 lx times its share, are the same light.
    assert light_rows.facing_lux(split.rig, _SHARES) == pytest.approx(300.0)
    less = light_parts.remove_part(parted, 0, 1)
    assert less.lights[0].rig.groups == ("lamp",) and less.lights[0].texts == ("D65",)
    assert light_parts.remove_part(less, 0, 0) is less
    assert light_parts.regroup(less, 0, 0, "").lights[0].rig.groups == ("",)
    assert light_parts.add_part(less, 0, "sky").lights[0].rig.groups == ("lamp", "sky")


def test_a_group_cannot_be_weighted_until_all_is_dark(lit):
    new = light_parts.set_part_weight(lit, 3, 0, 0.0)
    assert new.lights[3].rig.weights == (0.0, 0.5)
    assert light_parts.set_part_weight(new, 3, 1, 0.0) is new
    brighter = light_parts.set_part_weight(new, 3, 1, 99.0)
    assert brighter.lights[3].rig.weights[1] == light_rows.MAX_WEIGHT


def test_a_spectrum_is_respelled(lit):
    new = light_parts.respell(lit, 0, 0, "planck:2700").state.lights[0]
    assert new.name == "2700 K" and new.kelvin == 2700.0 and new.weight == 1.0
    sky = light_parts.respell(lit, 3, 1, "daylight:7500").state.lights[3]
    assert sky.name == "evening" and sky.texts == ("A", "daylight:7500")
    assert light_parts.respell(lit, 0, 0, " D65 ").state is lit


def test_scenes_keep_the_notation_of_their_lights():
    for name in ("engine.toml", "engine-groups.toml"):
        scene = Scene.load(_SCENES / name)
        rows = light_rows.rows_from_scene(scene.lights, rows_by_name(scene.file.light))
        texts = [text for each in rows for text in each.texts]
        assert texts == [table.spectrum for table in scene.file.light]


def test_a_row_has_one_text_for_each_spectrum():
    refuses(lambda: replace(ROWS[0], texts=("D65", "A")), "shape LightRow.texts", ViewingError)
    assert LightRow("x", "", ROWS[3].rig).texts == (None, None)


def test_a_file_is_found_in_the_scene_s_folder_first(tmp_path, monkeypatch):
    scene, here = tmp_path / "scene", tmp_path / "here"
    for folder in (scene, here):
        folder.mkdir()
        lines = [f"{nm},{1 + nm / 1000}" for nm in range(380, 741, 10)]
        (folder / f"{folder.name}.csv").write_text("nm,lamp\n" + "\n".join(lines))
    monkeypatch.chdir(here)
    for file, named in (("scene.csv", "scene.csv"), ("here.csv", str(here / "here.csv"))):
        assert light_rows.light_from_text(file, DEFAULT_GRID, str(scene))[1] == named


def test_a_kept_mix_is_the_light_that_shines_and_says_how_it_was_mixed(lit):
    state = lights.set_weight(lights.set_weight(replace(lit, lights=ROWS[:3]), 0, 0.7), 1, 0.3)
    before, kept = light_rig(state.lights), lights.keep_mix(state).state.lights
    assert kept[-1].texts == ("D65*0.7+A*0.3",)
    assert effective_weights(kept) == (0, 0, 0, 1)
    # The text has four digits.
    expected = before.mixed(DEFAULT_GRID).values
    np.testing.assert_allclose(kept[-1].rig.lights[0].values, expected, rtol=1e-3)
    np.testing.assert_allclose(light("D65*0.7+A*0.3").values, expected, rtol=1e-3)


def test_a_kept_mix_names_each_lamp_once_in_each_group(lit):
    rows = (row("D65*0.5+A*0.5", 0.5), row("A", 0.25))
    assert lights.mix_row(rows, DEFAULT_GRID).texts == ("D65*0.25+A*0.5",)
    # With lux it has their sum, and shares of it.
    rows = (row("D65", 0.5, 400.0), row("A*2", 1.0, 600.0))
    bright = lights.mix_row(rows, DEFAULT_GRID)
    assert bright.rig.illuminance_lux == (800.0,) and bright.texts == ("D65*0.25+A*0.75",)
    # Drawn spectra stay as they are.
    edited = lights.set_weight(light_parts.draw(lit, 0, 0, (0.1, 0.0), (0.3, 0.0)), 3, 1.0)
    kept = lights.mix_row(edited.lights, DEFAULT_GRID)
    assert kept.rig.groups == ("", "lamp", "sky") and kept.texts == (None, "A", "D65*0.5")
    dark = lights.toggle_mute(lights.set_weight(edited, 0, 0.0), 3)
    assert lights.mix_row(dark.lights, DEFAULT_GRID) is None


_SHARE = st.floats(0.001, 0.999)
DIM, BRIGHT = RelightSpec(), RelightSpec(Viewing(illuminance_lux=10.0, Y_b=40.0), backdrop=0.6)


START: Rows = (row("D65", 1.0, 100.0), row("A", 0.5, 200.0), row("planck:2000", 0.2, 50.0))


def changed(rows: Rows) -> Rows:
    """D65 muted, A solo and drawn, the radiator hotter, and one light more."""
    pen = draw_stroke(rows[1].rig.lights[0].values, (0.1, 3.0), (0.4, 3.0))
    drawn = replace(rows[1].rig, lights=(replace(rows[1].rig.lights[0], values=pen),))
    rows = with_changes(rows, 0, muted=True)
    rows = with_changes(rows, 1, name="A edited", rig=drawn, texts=(None,), before=rows[1])
    return (*rows[:2], replace(at_kelvin(rows[2], 8000.0), name="8000 K"), row("FL2", 0.8, 400.0))


END = changed(START)


def test_a_fade_begins_and_ends_exactly_at_its_ends():
    start, end = (START, DIM), (END, BRIGHT)
    for share, there in ((-1.0, start), (0.0, start), (1.0, end), (2.0, end)):
        assert light_states.interpolate_lights(start, end, share) is there
    # Words that do not go together are those of its end.
    pixel = RelightSpec(Viewing(adapting="pixel"))
    hunt = RelightSpec(Viewing(model="Hunt", illuminance_lux=20.0))
    for start, end in ((pixel, hunt), (hunt, pixel)):
        _, seen = light_states.interpolate_lights((START, start), (START, end), 0.5)
        assert seen.viewing.model == end.viewing.model


@given(share=_SHARE)
def test_weights_spectra_and_temperatures_lie_between(share):
    brighter = (replace(END[0], rig=replace(END[0].rig, illuminance_lux=(500.0,))), *END[1:])
    rows, seen = light_states.interpolate_lights((START, DIM), (brighter, BRIGHT), share)
    assert rows[0].rig.illuminance_lux[0] == pytest.approx(100 + 400 * share)
    assert len(rows) == 4 and not any(each.solo or each.muted for each in rows)
    a, b = effective_weights((*START, replace(END[3], weight=0.0))), effective_weights(END)
    expected = [(1 - share) * p + share * q for p, q in zip(a, b, strict=True)]
    np.testing.assert_allclose([each.weight for each in rows], expected)
    values = [of.rig.lights[0].values for of in (START[1], rows[1], END[1])]
    np.testing.assert_allclose(values[1], (1 - share) * values[0] + share * values[2])
    # A temperature is set in whole kelvins, by equal steps of its reciprocal.
    kelvin = rows[2].kelvin
    assert kelvin == pytest.approx(1 / ((1 - share) / 2000 + share / 8000), abs=0.51)
    np.testing.assert_array_equal(rows[2].rig.lights[0].values, light(f"planck:{kelvin}").values)
    viewing = seen.viewing
    assert viewing.illuminance_lux == pytest.approx(1000 ** (1 - share) * 10**share)
    assert viewing.Y_b == pytest.approx(20 + 20 * share)
    assert seen.backdrop == pytest.approx(0.2 + 0.4 * share)


def test_recalling_keeps_lights_that_the_state_does_not_know():
    back = light_states.recalled_rows(changed(START), START)
    assert back[:3] == START and back[3].name == "FL2" and back[3].weight == 0.0
    assert light_states.recalled_rows(back, START) == back


def test_states_are_saved_recalled_renamed_and_deleted(state):
    one = light_states.save(state).state
    two = light_states.save(lights.set_weight(one, 2, 0.3)).state
    assert [saved.name for saved in two.saved_lights] == ["State 1", "State 2"]
    assert light_states.rename(two, 0, "\n Day ").saved_lights[0].name == "Day"
    over = light_states.save_over(two, 0)
    assert over.saved_lights[0].lights is two.lights and over.saved_lights[0].name == "State 1"
    back = light_states.recall(two, 0)
    assert back.lights == state.lights and back.relight == state.relight and back.fade is not None
    again = light_states.save(light_states.delete(two, 0)).state
    assert [saved.name for saved in again.saved_lights] == ["State 2", "State 1"]
    for edit in (light_states.recall, light_states.delete, light_states.save_over):
        assert all(edit(two, index) is two for index in (-1, 2, 99))
    for name in ("State 2", " "):
        assert light_states.rename(two, 0, name) is two
    # Both can be undone.
    history = History(state).then(one, 1).then(light_states.delete(one, 0), 2)
    assert history.present.saved_lights == () and len(history.undo().present.saved_lights) == 1


def recalling(state: ViewState, seconds: float) -> ViewState:
    """A state on its way from A alone to D65 alone."""
    kept = light_states.save(light_states.set_fade(state, seconds)).state
    return light_states.recall(under(kept, 1), 0)


def test_a_fade_shows_the_way_and_ends_at_the_state_itself(state):
    new = recalling(state, 2.0)
    first = light_states.during_fade(new, 0.0)
    assert effective_weights(first.lights)[:2] == (0.0, 1.0)
    half = light_states.during_fade(new, 1.0)
    assert effective_weights(half.lights)[:2] == (0.5, 0.5)
    assert light_states.during_fade(new, 2.0) is new and new.lights == state.lights
    cut = recalling(state, 0.0)
    assert light_states.during_fade(cut, 0.0) is cut
    assert light_states.set_fade(state, 99.0).interface.fade_s == light_states.MAX_SECONDS
    assert Difference.between(first, half).stage == "relight"


def test_a_fade_is_one_step_of_undo_whatever_the_view_does_meanwhile(state):
    before = under(light_states.save(state).state, 1)
    history = History(before).then(light_states.recall(before, 0), 1)
    for i in range(3):
        present = history.present
        shown = light_states.during_fade(present, i / 10)
        assert shown is not present
        turned = camera.orbit(shown, 0.1, 0.0)
        history = history.then(light_states.after_fade(present, shown, turned), 2 + i)
    assert history.present.lights == state.lights
    for _ in range(4):
        history = history.undo()
    assert history.present.lights == before.lights
    assert light_states.during_fade(history.present, 0.0) is history.present
    # Redone, its end is there at once.
    again = history.redo().present
    assert again.lights == state.lights and again.fade is None


def test_a_fade_stops_or_starts_again_where_it_is(state):
    new = recalling(state, 1.0)
    shown = light_states.during_fade(new, 0.5)
    # A hand on a light stops it, another recall starts from there.
    stopped = light_states.after_fade(new, shown, lights.set_weight(shown, 2, 0.9))
    assert stopped.fade is None and effective_weights(stopped.lights)[:3] == (0.5, 0.5, 0.9)
    again = light_states.after_fade(new, shown, light_states.recall(shown, 0))
    for rows in (again.fade.lights, light_states.during_fade(again, 0.0).lights):
        assert effective_weights(rows)[:2] == (0.5, 0.5)


@given(
    count=st.integers(1, 12),
    x=st.floats(-2, 2, allow_subnormal=False),
    y=st.floats(-2, 2, allow_subnormal=False),
)
def test_dial_weights_sum_to_one_and_return_to_their_place(count, x, y):
    weights = lights.dial_weights(count, x, y)
    assert min(weights) >= 0 and sum(weights) == pytest.approx(1.0)
    # Weights on the dial are those of its place, which is where they are drawn.
    again = lights.dial_weights(count, *lights.dial_place(weights))
    np.testing.assert_allclose(again, weights, atol=1e-9)


def test_solo_and_mute_decide_who_shines(state):
    lit = state
    for i in range(3):
        lit = lights.set_weight(lit, i, 0.5)
    solo = lights.toggle_solo(lit, 1)
    dark = lights.toggle_mute(solo, 1)
    assert effective_weights(lit.lights) == (0.5, 0.5, 0.5, 0.0)
    assert effective_weights(solo.lights) == (0.0, 0.5, 0.0, 0.0)
    assert effective_weights(dark.lights) == (0.0,) * 4 and light_rig(dark.lights) is None


def test_a_light_is_added_alone_and_heated(state):
    added = lights.add(state, "planck:2700").state
    assert effective_weights(added.lights) == (0.0, 0.0, 0.0, 0.0, 1.0)
    assert added.lights[-1].kelvin == 2700
    hotter = lights.set_kelvin(added, 4, 5000.4).lights
    assert hotter[4].name == "5000 K" and hotter[4].rig is not added.lights[4].rig


def test_lights_kept_beside_stay_while_others_change(state):
    changed = run_command(run_command(state, "b").state, "space").state
    assert changed.other == state.lights != changed.lights
    assert lights.set_divide(changed, 7.0).divide == 0.98
    assert run_command(changed, "b").state.other is None


def test_space_goes_round_all_lights(state):
    for index in (0, 1, 2, 3, 0):
        assert light_rows.brightest_row(state.lights) == index
        state = run_command(state, "space").state
