"""Saved light states and the fades between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from volspec.appearance import Viewing
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import DEFAULT_GRID, light
from volspec.viewer.model import camera, light_rows, light_states, lights
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import (
    LightRow,
    Rows,
    at_kelvin,
    draw_stroke,
    effective_weights,
    rig_of,
    with_changes,
)
from volspec.viewer.model.light_states import interpolate_lights, recalled_rows
from volspec.viewer.model.state import ViewState

_SHARE = st.floats(0.001, 0.999)
DIM, BRIGHT = RelightSpec(), RelightSpec(Viewing(illuminance_lux=10.0, Y_b=40.0), backdrop=0.6)


def row(text: str, weight: float, lux: float | None = None) -> LightRow:
    rig = LightRig((light(text),), illuminance_lux=None if lux is None else (lux,))
    return LightRow(text, text, rig, weight, texts=(text,), kelvin=light_rows.kelvin_of(text))


START: Rows = (row("D65", 1.0, 100.0), row("A", 0.5, 200.0), row("planck:2000", 0.2, 50.0))


def after(rows: Rows) -> Rows:
    """D65 muted, A solo and drawn, the radiator hotter, and one light more."""
    pen = draw_stroke(rows[1].rig.lights[0].values, (0.1, 3.0), (0.4, 3.0))
    drawn = replace(rows[1].rig, lights=(replace(rows[1].rig.lights[0], values=pen),))
    rows = with_changes(rows, 0, muted=True)
    rows = with_changes(rows, 1, name="A edited", rig=drawn, texts=(None,), before=rows[1])
    return (*rows[:2], replace(at_kelvin(rows[2], 8000.0), name="8000 K"), row("FL2", 0.8, 400.0))


END = after(START)


def test_a_fade_begins_and_ends_exactly_at_its_ends() -> None:
    start, end = (START, DIM), (END, BRIGHT)
    assert (
        interpolate_lights(start, end, 0.0) is start
        and interpolate_lights(start, end, -1.0) is start
    )
    assert interpolate_lights(start, end, 1.0) is end and interpolate_lights(start, end, 2.0) is end


@given(share=_SHARE)
def test_weights_spectra_and_temperatures_lie_between(share: float) -> None:
    rows, seen = interpolate_lights((START, DIM), (END, BRIGHT), share)
    assert len(rows) == 4 and not any(each.solo or each.muted for each in rows)
    a, b = effective_weights((*START, replace(END[3], weight=0.0))), effective_weights(END)
    expected = [(1 - share) * p + share * q for p, q in zip(a, b, strict=True)]
    np.testing.assert_allclose([each.weight for each in rows], expected)
    values = [of.rig.lights[0].values for of in (START[1], rows[1], END[1])]
    np.testing.assert_allclose(values[1], (1 - share) * values[0] + share * values[2])
    # A temperature is set in whole kelvins, by equal steps of its reciprocal.
    kelvin = rows[2].kelvin
    assert kelvin is not None
    assert kelvin == pytest.approx(1 / ((1 - share) / 2000 + share / 8000), abs=0.51)
    np.testing.assert_array_equal(rows[2].rig.lights[0].values, light(f"planck:{kelvin}").values)
    viewing = seen.viewing
    assert viewing.illuminance_lux == pytest.approx(1000 ** (1 - share) * 10**share)
    assert viewing.Y_b == pytest.approx(20 + 20 * share)
    assert seen.backdrop == pytest.approx(0.2 + 0.4 * share)


def test_a_fade_moves_without_jumps_from_end_to_end() -> None:
    """A hundredth of the way changes no band by more than its part of the whole difference."""
    mixes = []
    for share in np.linspace(0, 1, 101):
        rig = rig_of(interpolate_lights((START, DIM), (END, DIM), float(share))[0])
        assert rig is not None
        mixes.append(rig.mixed(DEFAULT_GRID).values)
    steps = np.abs(np.diff(mixes, axis=0)).max(axis=1)
    assert steps.max() < 6 * np.abs(mixes[-1] - mixes[0]).max() / 100


@given(share=_SHARE)
def test_lux_of_a_light_lie_between(share: float) -> None:
    brighter = (replace(START[0], rig=replace(START[0].rig, illuminance_lux=(500.0,))), *START[1:])
    rows, _ = interpolate_lights((START, DIM), (brighter, DIM), share)
    lux = rows[0].rig.illuminance_lux
    assert lux is not None and lux[0] == pytest.approx(100 + 400 * share)


def test_a_fade_of_words_that_do_not_go_together_takes_those_of_its_end() -> None:
    pixel = RelightSpec(Viewing(adapting="pixel"))
    hunt = RelightSpec(Viewing(model="Hunt", illuminance_lux=20.0))
    for start, end in ((pixel, hunt), (hunt, pixel)):
        _, seen = interpolate_lights((START, start), (START, end), 0.5)
        assert seen.viewing.model == end.viewing.model


def test_recalling_keeps_lights_that_the_state_does_not_know() -> None:
    now = after(START)
    back = recalled_rows(now, START)
    assert back[:3] == START and back[3].name == "FL2" and back[3].weight == 0.0
    assert recalled_rows(back, START) == back


def test_states_are_saved_recalled_renamed_and_deleted(state: ViewState) -> None:
    one = light_states.save(state).state
    two = light_states.save(lights.set_weight(one, 2, 0.3)).state
    assert [kept.name for kept in two.saved_lights] == ["State 1", "State 2"]
    assert light_states.rename(two, 0, "  Day\n light ").saved_lights[0].name == "Day light"
    assert light_states.rename(two, 0, "State 2") is two
    assert light_states.rename(two, 0, " ") is two
    over = light_states.save_over(two, 0)
    assert over.saved_lights[0].lights is two.lights and over.saved_lights[0].name == "State 1"
    back = light_states.recall(two, 0)
    assert back.lights == state.lights and back.relight == state.relight and back.fade is not None
    gone = light_states.delete(two, 0)
    again = light_states.save(gone).state
    assert [kept.name for kept in again.saved_lights] == ["State 2", "State 1"]
    for index in (-1, 2, 99):
        assert light_states.recall(two, index) is two
        assert light_states.delete(two, index) is two
        assert light_states.save_over(two, index) is two


def test_saving_and_deleting_a_state_can_be_undone(state: ViewState) -> None:
    history = History(state).then(light_states.save(state).state, 1)
    history = history.then(light_states.delete(history.present, 0), 2)
    assert history.present.saved_lights == () and len(history.undone().present.saved_lights) == 1


def recalling(state: ViewState, seconds: float) -> ViewState:
    """A state on its way from A alone to D65 alone."""
    kept = light_states.save(light_states.set_fade(state, seconds)).state
    other = replace(kept, lights=light_rows.only_row(kept.lights, 1))
    return light_states.recall(other, 0)


def test_a_fade_shows_the_way_and_ends_at_the_state_itself(state: ViewState) -> None:
    new = recalling(state, 2.0)
    first = light_states.during_fade(new, 0.0)
    assert effective_weights(first.lights)[:2] == (0.0, 1.0)
    half = light_states.during_fade(new, 1.0)
    assert effective_weights(half.lights)[:2] == (0.5, 0.5)
    assert light_states.during_fade(new, 2.0) is new
    assert new.lights == state.lights
    assert Difference.between(first, half).stage == "relight"


def test_a_fade_is_one_step_of_undo_whatever_the_view_does_meanwhile(state: ViewState) -> None:
    before = replace(state, lights=light_rows.only_row(state.lights, 1))
    before = replace(before, saved_lights=light_states.save(state).state.saved_lights)
    history = History(before).then(light_states.recall(before, 0), 1)
    for i in range(1, 4):
        present = history.present
        shown = light_states.during_fade(present, (i - 1) / 10)
        assert shown is not present
        turned = camera.orbit(shown, 0.1, 0.0)
        history = history.then(light_states.after_fade(present, shown, turned), 1 + i)
    assert history.present.lights == state.lights
    for _ in range(4):
        history = history.undone()
    assert history.present.lights == before.lights
    assert light_states.during_fade(history.present, 0.0) is history.present
    # Redone, its end is there at once.
    again = history.redone().present
    assert again.lights == state.lights and again.fade is None


def test_a_hand_on_a_light_stops_the_fade_where_it_is(state: ViewState) -> None:
    new = recalling(state, 1.0)
    shown = light_states.during_fade(new, 0.5)
    stopped = light_states.after_fade(new, shown, lights.set_weight(shown, 2, 0.9))
    assert stopped.fade is None and effective_weights(stopped.lights)[:3] == (0.5, 0.5, 0.9)


def test_a_state_recalled_on_the_way_starts_from_there(state: ViewState) -> None:
    new = recalling(state, 1.0)
    shown = light_states.during_fade(new, 0.5)
    again = light_states.after_fade(new, shown, light_states.recall(shown, 0))
    assert again.fade is not None and effective_weights(again.fade.lights)[:2] == (0.5, 0.5)
    at_first = light_states.during_fade(again, 0.0)
    assert effective_weights(at_first.lights)[:2] == (0.5, 0.5)


def test_a_fade_of_no_time_is_a_cut(state: ViewState) -> None:
    new = recalling(state, 0.0)
    assert light_states.during_fade(new, 0.0) is new
    assert light_states.set_fade(state, 99.0).interface.fade_s == 10.0
