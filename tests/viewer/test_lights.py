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
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene
from volspec.scene.lights import rows_by_name
from volspec.spectra import DEFAULT_GRID, light
from volspec.viewer.model import light_mixes, light_parts, light_rows, lights
from volspec.viewer.model.light_parts import draw_stroke, with_stroke
from volspec.viewer.model.light_rows import LightRow, Rows, rig_of
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


def test_a_drawn_light_is_one_of_its_own_until_it_is_reset() -> None:
    rows = light_rows.with_weight(ROWS, 2, 0.4)
    edited = with_stroke(rows, 2, 0, (0.2, 1.0), (0.4, 2.0))
    again = with_stroke(edited, 2, 0, (0.6, 1.0), (0.7, 2.0))
    assert again[2].name == "planck:3000 edited" and again[2].text is None
    assert again[2].kelvin is None and again[2].weight == 0.4
    assert again[:2] == rows[:2] and again[3] == rows[3]
    back = light_parts.without_strokes(again, 2)
    assert back[2] == rows[2]
    assert light_parts.without_strokes(back, 2) is back


def test_a_pen_cannot_put_a_light_out() -> None:
    rows = with_stroke(ROWS, 0, 0, (-0.1, 0.0), (1.1, 0.0))
    assert rows is ROWS
    assert with_stroke(ROWS, 0, 0, (0.1, math.nan), (0.2, 1.0)) is ROWS
    assert with_stroke(ROWS, 9, 0, (0.1, 1.0), (0.2, 1.0)) is ROWS
    assert with_stroke(ROWS, 0, 3, (0.1, 1.0), (0.2, 1.0)) is ROWS


def test_a_light_of_two_groups_is_drawn_one_spectrum_at_a_time() -> None:
    edited = with_stroke(ROWS, 3, 1, (0.0, 0.0), (0.3, 0.0))[3]
    assert edited.rig.lights[0] is ROWS[3].rig.lights[0]
    assert edited.texts == ("A", None) and edited.rig.groups == ("lamp", "sky")


# Lux


def test_lux_count_where_all_that_shines_has_them() -> None:
    rows = light_parts.with_lux(ROWS, 0, 500.0)
    rig = rig_of(rows)
    assert rig is not None and rig.total_lux == 500.0
    assert light_parts.lux_note(rows, _SHARES, RelightSpec()).startswith("Together 500 lx")
    both = light_rows.with_weight(rows, 1, 1.0)
    rig = rig_of(both)
    assert rig is not None and rig.total_lux is None
    assert (
        light_parts.lux_note(both, _SHARES, RelightSpec())
        == "As A has no lux, Viewing's 1000 lx count for all"
    )
    assert (
        light_parts.lux_note(ROWS, _SHARES, RelightSpec())
        == "No lux given: Viewing's 1000 lx count"
    )
    absolute = RelightSpec(level="absolute")
    assert "needs lux, and A has none" in light_parts.lux_note(both, _SHARES, absolute)
    assert light_parts.with_lux(rows, 0, 0.0)[0].rig.illuminance_lux is None


def test_lux_of_groups_are_told_for_what_faces_them_all() -> None:
    """500 lx from a group with three quarters of the light, half of 100 from the rest."""
    rows = light_parts.with_lux(light_parts.with_lux(ROWS, 3, 500.0), 3, 100.0, part=1)
    assert rows[3].rig.illuminance_lux == (500.0, 100.0)
    assert light_parts.facing_lux(rows[3].rig, _SHARES) == pytest.approx(
        0.75 * 500 + 0.25 * 0.5 * 100
    )
    assert light_parts.facing_lux(rows[3].rig, {"other": 1.0}) is None


def test_a_light_added_among_lights_with_lux_has_as_many() -> None:
    lit = (row("D65", 0.5, 400.0), row("A", 0.0, 50.0))
    assert light_rows.with_new_light(lit, "FL2", DEFAULT_GRID)[-1].rig.illuminance_lux == (200.0,)
    assert light_rows.with_new_light(ROWS, "FL2", DEFAULT_GRID)[-1].rig.illuminance_lux is None


# Groups


def test_a_spectrum_for_all_groups_is_parted_and_joined_again() -> None:
    split = light_parts.split_by_group(light_parts.with_lux(ROWS, 0, 300.0), 0, ("lamp", "sky"))[0]
    assert split.rig.groups == ("lamp", "sky") and split.texts == ("D65", "D65")
    assert split.rig.illuminance_lux == (300.0, 300.0)
    # All groups at 300 lx, and each at 300 lx times its share, are the same light.
    assert light_parts.facing_lux(split.rig, _SHARES) == pytest.approx(300.0)
    less = light_parts.without_part((split,), 0, 1)
    assert less[0].rig.groups == ("lamp",) and less[0].text == "D65"
    assert light_parts.without_part(less, 0, 0) is less
    assert light_parts.with_part_group(less, 0, 0, "")[0].rig.groups == ("",)
    assert light_parts.with_part(less, 0, "sky")[0].rig.groups == ("lamp", "sky")


def test_a_group_cannot_be_weighted_until_all_is_dark() -> None:
    rows = light_parts.with_part_weight(ROWS, 3, 0, 0.0)
    assert rows[3].rig.weights == (0.0, 0.5)
    assert light_parts.with_part_weight(rows, 3, 1, 0.0) is rows
    assert (
        light_parts.with_part_weight(rows, 3, 1, 99.0)[3].rig.weights[1] == light_parts.MOST_WEIGHT
    )


def test_a_spectrum_is_respelled_or_refused_with_the_name() -> None:
    rows = light_parts.with_part_spectrum(ROWS, 0, 0, "planck:2700", DEFAULT_GRID)
    assert rows[0].name == "2700 K" and rows[0].kelvin == 2700.0 and rows[0].weight == 1.0
    sky = light_parts.with_part_spectrum(ROWS, 3, 1, "daylight:7500", DEFAULT_GRID)
    assert sky[3].name == "evening" and sky[3].texts == ("A", "daylight:7500")
    assert light_parts.with_part_spectrum(ROWS, 0, 0, " D65 ", DEFAULT_GRID) is ROWS
    with pytest.raises(SpectrumError, match="D6"):
        light_parts.with_part_spectrum(ROWS, 0, 0, "D6", DEFAULT_GRID)


def edit(rows: Rows, what: int, index: int, part: int, x: float) -> Rows:
    """One of all edits."""
    if what == 0:
        return light_parts.with_lux(rows, index, x, part)
    if what == 1:
        return light_parts.with_part_weight(rows, index, part, x)
    if what == 2:
        return light_parts.with_part_group(rows, index, part, ("", "lamp", "sky")[part % 3])
    if what == 3:
        return light_parts.with_part(rows, index, "sky")
    if what == 4:
        return light_parts.without_part(rows, index, part)
    return light_parts.split_by_group(rows, index, ("lamp", "sky"))


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(
    steps=st.lists(
        st.tuples(st.sampled_from(range(6)), st.integers(-2, 5), st.integers(-1, 3), _POWER),
        max_size=30,
    )
)
def test_no_edit_of_parts_makes_a_row_that_gives_no_light(
    steps: list[tuple[int, int, int, float]],
) -> None:
    rows = ROWS
    for step in steps:
        rows = edit(rows, *step)
    for each in rows:
        each.rig.mixed(DEFAULT_GRID)
        assert len(each.texts) == len(each.rig.lights)
    rig_of(rows)


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
        light_rows.with_new_light(ROWS, "nosuch.csv", DEFAULT_GRID, str(scene))


def test_names_stay_apart_as_rows_of_one_name_are_one_setting() -> None:
    rows = ROWS
    for _ in range(3):
        rows = light_rows.with_new_light(rows, "d65", DEFAULT_GRID)
    assert [each.name for each in rows[4:]] == ["D65 (2)", "D65 (3)", "D65 (4)"]
    assert {each.text for each in rows[4:]} == {"D65"}


def test_forty_lights_have_room_and_more_are_refused_in_words() -> None:
    rows = ROWS
    for _ in range(light_rows.MOST_ROWS - len(rows)):
        rows = light_rows.with_new_light(rows, "A", DEFAULT_GRID)
    assert len(rows) >= 64
    with pytest.raises(SpectrumError, match="remove one first"):
        light_rows.with_new_light(rows, "A", DEFAULT_GRID)


# Mixes


def test_a_kept_mix_is_the_light_that_shines_and_says_how_it_was_mixed() -> None:
    rows = light_rows.with_weight(light_rows.with_weight(ROWS[:3], 0, 0.7), 1, 0.3)
    before, kept = rig_of(rows), light_mixes.with_mix(rows, DEFAULT_GRID)
    assert before is not None
    assert kept[-1].text == "D65*0.7+A*0.3" and light_rows.effective_weights(kept) == (0, 0, 0, 1)
    # The text has four digits.
    expected = before.mixed(DEFAULT_GRID).values
    np.testing.assert_allclose(kept[-1].rig.lights[0].values, expected, rtol=1e-3)
    np.testing.assert_allclose(light("D65*0.7+A*0.3").values, expected, rtol=1e-3)


def test_a_kept_mix_of_mixes_names_each_lamp_once() -> None:
    rows = (row("D65*0.5+A*0.5", 0.5), row("A", 0.25))
    assert light_mixes.with_mix(rows, DEFAULT_GRID)[-1].text == "D65*0.25+A*0.5"


def test_a_kept_mix_with_lux_has_their_sum_and_shares_of_it() -> None:
    rows = (row("D65", 0.5, 400.0), row("A*2", 1.0, 600.0))
    kept = light_mixes.with_mix(rows, DEFAULT_GRID)[-1]
    assert kept.rig.illuminance_lux == (800.0,) and kept.text == "D65*0.25+A*0.75"


def test_a_kept_mix_keeps_its_groups_apart_and_drawn_spectra_as_they_are() -> None:
    edited = light_rows.with_weight(with_stroke(ROWS, 0, 0, (0.1, 0.0), (0.3, 0.0)), 3, 1.0)
    kept = light_mixes.with_mix(edited, DEFAULT_GRID)[-1]
    assert kept.rig.groups == ("", "lamp", "sky") and kept.texts == (None, "A", "D65*0.5")
    dark = light_rows.with_changes(light_rows.with_changes(edited, 0, weight=0.0), 3, muted=True)
    assert light_mixes.with_mix(dark, DEFAULT_GRID) is dark


# Edits


def test_a_stroke_of_many_samples_is_one_step_of_undo(state: ViewState) -> None:
    from volspec.viewer.model.history import History

    history = History(state)
    pen = None
    for x in np.linspace(0.2, 0.8, 9):
        end = float(x), 2.0
        history = history.then(lights.draw(history.present, 1, 0, pen or end, end), 5)
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
                    lights.set_lux(state, index, x, part),
                    lights.set_part_weight(state, index, part, x),
                    lights.draw(state, index, part, start, (x, x)),
                ):
                    rig = rig_of(new.lights)
                    assert rig is not None and np.isfinite(rig.mixed(DEFAULT_GRID).values).all()
