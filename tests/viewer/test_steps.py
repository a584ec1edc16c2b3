"""Steps of undo, and which light is chosen after them."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from volspec.errors import InputError
from volspec.palette import Cell
from volspec.relight import LightRig
from volspec.spectra import light
from volspec.viewer.model import cuts, light_parts, light_rows, light_states, lights, transfer_edits
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.edit import after
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import LightRow, effective_weights
from volspec.viewer.model.palette_targets import LIGHT, DesignTargets, PaletteState
from volspec.viewer.model.state import Interface, ViewState
from volspec.viewer.ui.inputs import Input
from volspec.viewer.ui.mouse import RUN_S, Gestures
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.documents import DocumentService, Opened
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.session_store import RecentFiles


def done(state: ViewState, name: str) -> ViewState:
    change = BY_NAME[name].change
    assert change is not None
    return after(change, state).state


def test_a_state_always_has_a_chosen_light(state: ViewState) -> None:
    for wrong, right in ((7, 3), (-2, 0)):
        assert replace(state, interface=Interface(light=wrong)).interface.light == right
    last = replace(state, interface=Interface(light=3))
    assert replace(last, lights=state.lights[:2]).interface.light == 1
    assert done(last, "remove-light").interface.light == 2


def test_undo_of_a_kept_mix_chooses_the_light_that_was_chosen(state: ViewState) -> None:
    start = lights.choose(state, 1)
    history = History(start).then(done(start, "keep-mix"), 1)
    assert history.present.interface.light == 4
    back = history.undone()
    assert len(back.present.lights) == 4 and back.present.interface.light == 1
    assert back.redone().present.interface.light == 4
    # What is chosen is no step, and a step of the view leaves it.
    looked = History(start).then(done(start, "view-right"), 1)
    looked = looked.then(lights.choose(looked.present, 3), 2)
    assert looked.undone().present.interface.light == 3


def test_a_light_shown_alone_is_chosen(state: ViewState) -> None:
    from volspec.viewer.ui import commands

    for search, chosen in (("light FL2 alone", 2), ("next light alone", 1), ("add light HP1", 4)):
        row = commands.commands_of(state, (), search)[0]
        new = after(row.change, state).state
        assert new.interface.light == chosen
        assert [i for i, weight in enumerate(effective_weights(new.lights)) if weight] == [chosen]


def test_another_file_chooses_its_shining_light_and_keeps_the_window(state: ViewState) -> None:
    before = replace(state, size=(40, 30), interface=Interface(dark=False, light=3))
    lit = replace(state, lights=light_rows.only_row(state.lights, 2))
    new = Opened(lit).after(before).state
    assert new.interface.light == 2 and not new.interface.dark and new.size == (40, 30)
    session = Opened(lights.choose(state, 1), session=Path("x")).after(before)
    assert session.state.interface.light == 1 and session.state.interface.dark


def steps(given: Sequence[tuple[float, Input]]) -> int:
    """How many steps of undo inputs at their times are."""
    gestures = Gestures()
    numbers = set()
    for now, each in given:
        gestures.take(each, now)
        numbers.add(gestures.number)
    return len(numbers)


def test_a_run_of_notches_or_steps_is_one_gesture() -> None:
    def run(each: Input, apart: float) -> int:
        return steps([(10.0 + i * apart, each) for i in range(6)])

    wheel, roll = Input("wheel", y=1.0), Input("wheel", y=1.0, modifiers="shift")
    left, plus = Input("key", key="shift+left"), Input("key", key="+")
    for each in (wheel, left, plus):
        assert run(each, 0.9 * RUN_S) == 1 and run(each, 1.1 * RUN_S) == 6
    # Each press of a key that makes no steps is one, however quick; held down it comes once.
    assert run(Input("key", key="b"), 0.1) == 6
    assert run(replace(left, repeated=True), 2 * RUN_S) == 1
    assert steps([(0.0, wheel), (0.1, roll), (0.2, wheel)]) == 3
    assert steps([(0.0, wheel), (0.1, Input("move")), (0.2, wheel)]) == 1
    assert steps([(0.0, wheel), (0.1, Input("press", button="left")), (0.2, wheel)]) == 3


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("view", lambda s: done(s, "view-right")),
        ("lights", lambda s: done(s, "next-light")),
        ("lights", lambda s: done(s, "compare")),
        ("light states", lambda s: light_states.save(s).state),
        ("transfer function", lambda s: transfer_edits.shift(s, 0.1)),
        ("viewing", lambda s: done(s, "mark")),
        ("cuts", lambda s: cuts.move_crop(s, 0, 0.3)),
        ("shading", lambda s: replace(s, shading=replace(s.shading, ambient=0.7))),
        (
            "palette",
            lambda s: replace(s, palette=PaletteState(DesignTargets(constant=frozenset(["gold"])))),
        ),
    ],
)
def test_what_is_undone_has_a_name(state: ViewState, what: str, change: Any) -> None:
    assert Difference.between(state, change(state)).name == what


def test_lights_have_names_of_their_own_by_hand(state: ViewState) -> None:
    new = lights.rename(state, 1, "  my\n lamp ")
    assert new.lights[1].name == "my lamp" and new.lights[1].rig is state.lights[1].rig
    assert lights.rename(new, 2, "my lamp").lights[2].name == "my lamp (2)"
    for index, name in ((1, "my lamp"), (1, " "), (9, "x"), (-1, "x")):
        assert lights.rename(new, index, name) is new


def test_a_name_given_by_hand_stays_whatever_the_light_becomes(state: ViewState) -> None:
    new = lights.choose(lights.rename(state, 3, "lamp"), 3)
    assert lights.set_kelvin(new, 3, 5000.0).lights[3].name == "lamp"
    assert light_parts.respell(new, 3, 0, "D50").state.lights[3].name == "lamp"
    pen = light_parts.draw(new, 3, 0, (0.1, 2.0), (0.5, 2.0))
    assert pen.lights[3].name == "lamp" == done(pen, "reset-spectrum").lights[3].name
    # Also where it was given after the drawing.
    later = lights.rename(light_parts.draw(state, 1, 0, (0.1, 2.0), (0.5, 2.0)), 1, "mine")
    assert light_parts.draw(later, 1, 0, (0.6, 2.0), (0.9, 2.0)).lights[1].name == "mine"


def test_a_renamed_light_is_the_one_of_the_saved_state(state: ViewState) -> None:
    kept = light_states.save(state).state
    back = light_states.recall(lights.rename(kept, 0, "x"), 0)
    assert back.lights == state.lights


def test_the_palette_follows_a_light_to_its_new_name(state: ViewState) -> None:
    cell = Cell("same", other=("gold", "A"))
    targets = DesignTargets({("gold", "A"): cell}, frozenset({(LIGHT, "A")}), lamps={"A": ("FL2",)})
    board = lights.rename(replace(state, palette=PaletteState(targets, targets)), 1, "lamp").palette
    assert list(board.targets.cells) == [("gold", "lamp")]
    assert board.targets.cells["gold", "lamp"].other == ("gold", "lamp")
    assert board.targets.open == {(LIGHT, "lamp")} and dict(board.targets.lamps) == {
        "lamp": ("FL2",)
    }
    assert not board.is_pending
    other = replace(state, palette=PaletteState(targets))
    assert lights.rename(other, 2, "lamp").palette == other.palette


def test_a_drawn_light_says_from_what(state: ViewState) -> None:
    from volspec.viewer.ui import lights_rows as rows

    lamp = LightRow("day", "D65 at noon", LightRig((light("D65"),)), 1.0, texts=("D65",))
    assert rows.row_tip(lamp) == "day\nD65 at noon"
    pen = light_parts.draw(replace(state, lights=(lamp,)), 0, 0, (0.1, 2.0), (0.5, 2.0))
    again = light_parts.draw(pen, 0, 0, (0.6, 2.0), (0.9, 2.0))
    assert rows.row_tip(again.lights[0]) == "day edited\nDrawn by hand, from D65"


def test_a_complaint_goes_when_the_lights_are_edited(state: ViewState) -> None:
    from volspec.viewer.ui.context import LightsPanelState

    panel = LightsPanelState()
    panel.complain("'Q': no such light", (1, 0), state.lights)
    assert panel.complaint_at((1, 0), state.lights) == "'Q': no such light"
    assert panel.complaint_at((0, 0), state.lights) == ""
    edited = lights.set_weight(state, 2, 0.4).lights
    assert panel.complaint_at((1, 0), edited) == ""


def test_without_a_session_the_last_file_is_opened_and_then_the_demo(
    state: ViewState, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VOLSPEC_STATE", str(tmp_path))
    begun: list[str | None] = []
    monkeypatch.setattr(
        DocumentService, "open", lambda _, path, say=True: begun.append(path), raising=True
    )

    def resumed(path: str | None) -> tuple[Any, Notice]:
        begun.clear()
        notice = Notice()
        made = DocumentService(Tasks(lambda: None), notice, Trace(), None)
        made.resume_last(path)
        return made, notice

    _, notice = resumed(None)
    assert begun == [None] and notice.text == "There is no session to restore; this is the demo"
    scene = tmp_path / "mine.toml"
    scene.touch()
    RecentFiles(tmp_path).add(str(scene))
    made, notice = resumed(None)
    assert begun == [str(scene)] and notice.text.endswith("; this is mine.toml")
    made._open_fallback("mine.toml is broken")
    assert begun == [str(scene), None]
    with pytest.raises(InputError, match="no demo"):
        made._open_fallback("no demo")
    # What was named comes before what was opened last; what is gone is no file.
    assert resumed("named.toml") and begun == ["named.toml"]
    scene.unlink()
    assert resumed(None) and begun == [None]
    shutil.rmtree(tmp_path)


def test_a_frame_takes_one_gesture_where_a_busy_window_hears_of_several(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A press is where the mouse was then, and a key after a drag is no part of it."""
    from volspec.viewer.ui import inputs as module

    heard: dict[str, Any] = {}
    for name in [name for name in dir(module.glfw) if name.endswith("_callback")]:
        monkeypatch.setattr(
            module.glfw, name, lambda _, listener, name=name: heard.update({name: listener})
        )
    monkeypatch.setattr(module.glfw, "get_cursor_pos", lambda _: (90.0, 90.0))
    monkeypatch.setattr(module.glfw, "get_key", lambda *_: module.glfw.RELEASE)
    context = module.imgui.create_context()
    try:
        told: list[int] = []
        inputs = module.Inputs(None, lambda _, key, *__: told.append(key))
        heard["set_mouse_button_callback"](None, 0, module.glfw.PRESS, 0)
        heard["set_cursor_pos_callback"](None, 3.0, 4.0)
        heard["set_mouse_button_callback"](None, 0, module.glfw.RELEASE, 0)
        for x in (5.0, 6.0):  # the hand that turns it moves the mouse, too
            heard["set_scroll_callback"](None, 0.0, 1.0)
            heard["set_cursor_pos_callback"](None, x, 4.0)
        for key in (module.glfw.KEY_UP, module.glfw.KEY_ENTER):
            heard["set_key_callback"](None, key, 0, module.glfw.PRESS, 0)
        drag = [(given.name, given.x, given.y) for given in inputs.take()]
        assert drag == [("press", 90.0, 90.0), ("move", 3.0, 4.0), ("release", 3.0, 4.0)]
        assert [given.name for given in inputs.take()] == ["wheel", "move"] * 2
        assert [given.key for given in inputs.take()] == ["up"] and inputs.waiting
        # imgui hears of a key with it, not before.
        assert told == [module.glfw.KEY_UP]
        assert [given.key for given in inputs.take()] == ["enter"] and not inputs.waiting
        assert told == [module.glfw.KEY_UP, module.glfw.KEY_ENTER]
        assert inputs.take() == []
    finally:
        module.imgui.destroy_context(context)
