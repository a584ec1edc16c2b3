"""What a light of the list is made of: lux, groups, notation, drawn spectra, kept mixes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from volspec.errors import SpectrumError, ViewingError
from volspec.raycast import Ambient, Headlight, LightGroup
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene
from volspec.scene.lights import rows_by_name
from volspec.spectra import DEFAULT_GRID, light
from volspec.viewer.model import light_parts, light_rows, lights
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.edit import after
from volspec.viewer.model.light_mixes import mix_row
from volspec.viewer.model.light_rows import LightRow, Rows, draw_stroke, rig_of
from volspec.viewer.model.state import ViewState

_SCENES = Path(__file__).resolve().parents[2] / "data" / "scenes"
_SHARES = {"lamp": 0.75, "sky": 0.25}
_POWER = st.floats(-5, 50)
_PLACE = st.tuples(st.floats(-0.5, 1.5), _POWER)


def row(text: str, weight: float = 0.0, lux: float | None = None) -> LightRow:
    rig = LightRig((light(text),), illuminance_lux=None if lux is None else (lux,))
    return LightRow(text, text, rig, weight, texts=(text,), kelvin=light_rows.kelvin_of(text))


def grouped() -> LightRow:
    rig = LightRig((light("A"), light("D65")), (1.0, 0.5), None, ("lamp", "sky"))
    return LightRow("evening", "", rig, texts=("A", "D65"))


ROWS: Rows = (row("D65", 1.0), row("A"), row("planck:3000"), grouped())


@pytest.fixture(scope="session")
def lit(state: ViewState) -> ViewState:
    """Four lights, the last one of two groups, over a cast with both groups."""
    groups = LightGroup("lamp", (Headlight(),)), LightGroup("sky", (Ambient(),))
    return replace(state, lights=ROWS, shading=replace(state.shading, groups=groups))


def reset(state: ViewState, index: int) -> ViewState:
    """Undo the drawing of a light."""
    change = BY_NAME["reset-spectrum"].change
    assert change is not None
    return after(change, lights.choose(state, index)).state


# Drawing


@given(start=_PLACE, end=_PLACE, values=st.lists(st.floats(0, 10), min_size=31, max_size=31))
def test_a_stroke_touches_only_bands_under_the_pen_and_leaves_none_below_zero(
    start: tuple[float, float], end: tuple[float, float], values: list[float]
) -> None:
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


def test_a_quick_stroke_leaves_no_band_out() -> None:
    """Two samples of the mouse far apart: every band between lies on the line."""
    new = draw_stroke(np.zeros(31), (0.0, 1.0), (1.0, 4.0))
    np.testing.assert_allclose(new, np.linspace(1, 4, 31))


def test_two_strokes_meet_where_the_pen_was() -> None:
    once = draw_stroke(draw_stroke(np.zeros(31), (0.1, 1.0), (0.5, 3.0)), (0.5, 3.0), (0.9, 1.0))
    assert np.abs(np.diff(once[3:28])).max() < 0.5 and once[15] == 3.0


def test_a_drawn_light_is_one_of_its_own_until_it_is_reset(lit: ViewState) -> None:
    dimmed = lights.set_weight(lit, 2, 0.4)
    edited = light_parts.draw(dimmed, 2, 0, (0.2, 1.0), (0.4, 2.0))
    again = light_parts.draw(edited, 2, 0, (0.6, 1.0), (0.7, 2.0))
    rows = again.lights
    assert rows[2].name == "planck:3000 edited" and rows[2].texts == (None,)
    assert rows[2].kelvin is None and rows[2].weight == 0.4
    assert rows[:2] == dimmed.lights[:2] and rows[3] == dimmed.lights[3]
    back = reset(again, 2)
    assert back.lights[2] == dimmed.lights[2]
    assert reset(back, 2).lights is back.lights


def test_a_pen_cannot_put_a_light_out(lit: ViewState) -> None:
    assert light_parts.draw(lit, 0, 0, (-0.1, 0.0), (1.1, 0.0)) is lit
    assert light_parts.draw(lit, 0, 0, (0.1, math.nan), (0.2, 1.0)) is lit
    assert light_parts.draw(lit, 9, 0, (0.1, 1.0), (0.2, 1.0)) is lit
    assert light_parts.draw(lit, 0, 3, (0.1, 1.0), (0.2, 1.0)) is lit


def test_a_light_of_two_groups_is_drawn_one_spectrum_at_a_time(lit: ViewState) -> None:
    edited = light_parts.draw(lit, 3, 1, (0.0, 0.0), (0.3, 0.0)).lights[3]
    assert edited.rig.lights[0] is ROWS[3].rig.lights[0]
    assert edited.texts == ("A", None) and edited.rig.groups == ("lamp", "sky")


# Lux


def test_lux_count_where_all_that_shines_has_them(lit: ViewState) -> None:
    bright = light_parts.set_lux(lit, 0, 500.0)
    rows = bright.lights
    rig = rig_of(rows)
    assert rig is not None and rig.total_lux == 500.0
    assert light_rows.lux_note(rows, _SHARES, RelightSpec()).startswith("Together 500 lx")
    both = lights.set_weight(bright, 1, 1.0).lights
    rig = rig_of(both)
    assert rig is not None and rig.total_lux is None
    assert (
        light_rows.lux_note(both, _SHARES, RelightSpec())
        == "As A has no lux, Viewing's 1000 lx count for all"
    )
    assert (
        light_rows.lux_note(ROWS, _SHARES, RelightSpec()) == "No lux given: Viewing's 1000 lx count"
    )
    absolute = RelightSpec(level="absolute")
    assert "needs lux, and A has none" in light_rows.lux_note(both, _SHARES, absolute)
    assert light_parts.set_lux(bright, 0, 0.0).lights[0].rig.illuminance_lux is None


def test_lux_of_groups_are_told_for_what_faces_them_all(lit: ViewState) -> None:
    """500 lx from a group with three quarters of the light, half of 100 from the rest."""
    rig = light_parts.set_lux(light_parts.set_lux(lit, 3, 500.0), 3, 100.0, part=1).lights[3].rig
    assert rig.illuminance_lux == (500.0, 100.0)
    assert light_rows.facing_lux(rig, _SHARES) == pytest.approx(0.75 * 500 + 0.25 * 0.5 * 100)
    assert light_rows.facing_lux(rig, {"other": 1.0}) is None


def test_a_light_added_among_lights_with_lux_has_as_many(lit: ViewState) -> None:
    bright = replace(lit, lights=(row("D65", 0.5, 400.0), row("A", 0.0, 50.0)))
    assert lights.add(bright, "FL2").state.lights[-1].rig.illuminance_lux == (200.0,)
    assert lights.add(lit, "FL2").state.lights[-1].rig.illuminance_lux is None


# Groups


def test_a_spectrum_for_all_groups_is_parted_and_joined_again(lit: ViewState) -> None:
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


def test_a_group_cannot_be_weighted_until_all_is_dark(lit: ViewState) -> None:
    new = light_parts.set_part_weight(lit, 3, 0, 0.0)
    assert new.lights[3].rig.weights == (0.0, 0.5)
    assert light_parts.set_part_weight(new, 3, 1, 0.0) is new
    brighter = light_parts.set_part_weight(new, 3, 1, 99.0)
    assert brighter.lights[3].rig.weights[1] == light_rows.MOST_WEIGHT


def test_a_spectrum_is_respelled_or_refused_with_the_name(lit: ViewState) -> None:
    new = light_parts.respell(lit, 0, 0, "planck:2700").state.lights[0]
    assert new.name == "2700 K" and new.kelvin == 2700.0 and new.weight == 1.0
    sky = light_parts.respell(lit, 3, 1, "daylight:7500").state.lights[3]
    assert sky.name == "evening" and sky.texts == ("A", "daylight:7500")
    assert light_parts.respell(lit, 0, 0, " D65 ").state is lit
    refused = light_parts.respell(lit, 0, 0, "D6")
    assert refused.state is lit and "D6" in refused.message


def edit(state: ViewState, what: int, index: int, part: int, x: float) -> ViewState:
    """One of all edits."""
    if what == 0:
        return light_parts.set_lux(state, index, x, part)
    if what == 1:
        return light_parts.set_part_weight(state, index, part, x)
    if what == 2:
        return light_parts.regroup(state, index, part, ("", "lamp", "sky")[part % 3])
    if what == 3:
        return light_parts.add_part(state, index, "sky")
    if what == 4:
        return light_parts.remove_part(state, index, part)
    return light_parts.split_part(state, index)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(
    steps=st.lists(
        st.tuples(st.sampled_from(range(6)), st.integers(-2, 5), st.integers(-1, 3), _POWER),
        max_size=30,
    )
)
def test_no_edit_of_parts_makes_a_row_that_gives_no_light(
    lit: ViewState,
    steps: list[tuple[int, int, int, float]],
) -> None:
    for step in steps:
        lit = edit(lit, *step)
    for each in lit.lights:
        each.rig.mixed(DEFAULT_GRID)
        assert len(each.texts) == len(each.rig.lights)
    rig_of(lit.lights)


# Notation


def test_scenes_keep_the_notation_of_their_lights() -> None:
    for name in ("engine.toml", "engine-groups.toml"):
        scene = Scene.load(_SCENES / name)
        rows = light_rows.rows_of(scene.lights, rows_by_name(scene.file.light))
        texts = [text for each in rows for text in each.texts]
        assert texts == [table.spectrum for table in scene.file.light]


def test_a_row_has_one_text_for_each_spectrum() -> None:
    with pytest.raises(ViewingError, match="2 texts for 1"):
        replace(ROWS[0], texts=("D65", "A"))
    assert LightRow("x", "", ROWS[3].rig).texts == (None, None)


def test_a_file_is_found_beside_the_scene_and_else_where_the_program_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, here = tmp_path / "scene", tmp_path / "here"
    for folder in (scene, here):
        folder.mkdir()
        lines = [f"{nm},{1 + nm / 1000}" for nm in range(380, 741, 10)]
        (folder / f"{folder.name}.csv").write_text("nm,lamp\n" + "\n".join(lines))
    monkeypatch.chdir(here)
    assert light_rows.spectrum_of("scene.csv", DEFAULT_GRID, str(scene))[1] == "scene.csv"
    assert light_rows.spectrum_of("here.csv", DEFAULT_GRID, str(scene))[1] == str(here / "here.csv")
    with pytest.raises(SpectrumError, match=r"nosuch\.csv"):
        light_rows.spectrum_of("nosuch.csv", DEFAULT_GRID, str(scene))


def test_names_stay_apart_as_rows_of_one_name_are_one_setting(lit: ViewState) -> None:
    for _ in range(3):
        lit = lights.add(lit, "d65").state
    added = lit.lights[4:]
    assert [each.name for each in added] == ["D65 (2)", "D65 (3)", "D65 (4)"]
    assert {each.texts for each in added} == {("D65",)}


def test_forty_lights_have_room_and_more_are_refused_in_words(lit: ViewState) -> None:
    for _ in range(light_rows.MOST_ROWS - len(lit.lights)):
        lit = lights.add(lit, "A").state
    assert len(lit.lights) >= 64
    refused = lights.add(lit, "A")
    assert refused.state is lit and "remove one first" in refused.message


# Mixes


def mixed(rows: Rows) -> LightRow:
    kept = mix_row(rows, DEFAULT_GRID)
    assert kept is not None
    return kept


def test_a_kept_mix_is_the_light_that_shines_and_says_how_it_was_mixed(lit: ViewState) -> None:
    state = lights.set_weight(lights.set_weight(replace(lit, lights=ROWS[:3]), 0, 0.7), 1, 0.3)
    before, kept = rig_of(state.lights), lights.keep_mix(state).state.lights
    assert before is not None and kept[-1].texts == ("D65*0.7+A*0.3",)
    assert light_rows.effective_weights(kept) == (0, 0, 0, 1)
    # The text has four digits.
    expected = before.mixed(DEFAULT_GRID).values
    np.testing.assert_allclose(kept[-1].rig.lights[0].values, expected, rtol=1e-3)
    np.testing.assert_allclose(light("D65*0.7+A*0.3").values, expected, rtol=1e-3)


def test_a_kept_mix_of_mixes_names_each_lamp_once() -> None:
    rows = (row("D65*0.5+A*0.5", 0.5), row("A", 0.25))
    assert mixed(rows).texts == ("D65*0.25+A*0.5",)


def test_a_kept_mix_with_lux_has_their_sum_and_shares_of_it() -> None:
    rows = (row("D65", 0.5, 400.0), row("A*2", 1.0, 600.0))
    kept = mixed(rows)
    assert kept.rig.illuminance_lux == (800.0,) and kept.texts == ("D65*0.25+A*0.75",)


def test_a_kept_mix_keeps_its_groups_apart_and_drawn_spectra_as_they_are(lit: ViewState) -> None:
    edited = lights.set_weight(light_parts.draw(lit, 0, 0, (0.1, 0.0), (0.3, 0.0)), 3, 1.0)
    kept = mixed(edited.lights)
    assert kept.rig.groups == ("", "lamp", "sky") and kept.texts == (None, "A", "D65*0.5")
    dark = lights.toggle_mute(lights.set_weight(edited, 0, 0.0), 3)
    assert mix_row(dark.lights, DEFAULT_GRID) is None


# Edits


def test_a_stroke_of_many_samples_is_one_step_of_undo(state: ViewState) -> None:
    from volspec.viewer.model.history import History

    history = History(state)
    pen = None
    for x in np.linspace(0.2, 0.8, 9):
        end = float(x), 2.0
        history = history.then(light_parts.draw(history.present, 1, 0, pen or end, end), 5)
        pen = end
    assert history.present.lights[1].name == "A edited"
    assert history.undone().present.lights == state.lights


@pytest.mark.parametrize("start", [(0.1, 0.2), (math.nan, 1.0), (math.inf, -math.inf)])
def test_edits_of_lights_take_any_index_and_number(
    state: ViewState, start: tuple[float, float]
) -> None:
    for index in (-1, 0, 3, 99):
        for part in (-1, 0, 5):
            for x in (-1e300, 0.0, 1e300):
                for new in (
                    light_parts.set_lux(state, index, x, part),
                    light_parts.set_part_weight(state, index, part, x),
                    light_parts.draw(state, index, part, start, (x, x)),
                ):
                    rig = rig_of(new.lights)
                    assert rig is not None and np.isfinite(rig.mixed(DEFAULT_GRID).values).all()
