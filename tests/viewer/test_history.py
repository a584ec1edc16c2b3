"""Cost of changes, steps of undo, gestures, and the chosen light."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.viewer import run_command
from tests.viewer._edits import MODULES, drawn, edits_of, with_arguments
from tests.viewer._states import under
from volspec.palette import Cell
from volspec.raycast import Ambient, ClipPlane, Headlight, LightGroup, Point
from volspec.relight import LightRig
from volspec.scene.tables.specs import MeshSpec
from volspec.spectra import DEFAULT_GRID, light, reflectance
from volspec.viewer.model import (
    camera,
    cuts,
    light_parts,
    light_rows,
    light_states,
    lights,
    measure,
    palette_edits,
    room,
    slices,
    transfer_edits,
)
from volspec.viewer.model.commands import COMMANDS
from volspec.viewer.model.edit import after
from volspec.viewer.model.history import MAX_UNDO, STAGES, Difference, History
from volspec.viewer.model.palette_targets import LIGHT, DesignTargets, PaletteState, Pick
from volspec.viewer.model.state import Interface, Slices, ViewState
from volspec.viewer.ui import inputs
from volspec.viewer.ui.context import LightsPanelState
from volspec.viewer.ui.inputs import Input
from volspec.viewer.ui.mouse import RUN_S, Gestures
from volspec.viewer.work.background import Outcome, Tasks
from volspec.viewer.work.casts import CastScheduler, CastWorker
from volspec.viewer.work.documents import DocumentService, OpenResult
from volspec.viewer.work.notify import Notice
from volspec.viewer.work.session_store import RecentFiles


def test_nothing_to_do_where_nothing_changed_and_everything_at_first(state):
    assert Difference.between(None, state).stage == "cast"
    assert Difference.between(state, state).stage is None
    assert Difference.between(state, replace(state, view=replace(state.view))).stage is None
    # The first of several stages counts; other reflectances are lit again while a cast runs.
    turned = replace(state, view=replace(state.view, zoom=2.0))
    assert Difference.between(state, turned).turns
    assert not Difference.between(state, replace(turned, size=(8, 8))).turns
    both = replace(state, lights=state.lights[:-1], interface=Interface(keys=True))
    lit = Difference.between(state, both)
    assert (lit.stage, lit.relights) == ("relight", True)
    assert Difference.between(state, replace(both, size=(8, 8))).stage == "cast"
    other = replace(state.transfer, basis=replace(state.transfer.basis))
    for before in (None, state):
        assert Difference.between(before, replace(state, transfer=other)).relights
    # The picture that is shown until a cast is there need not be drawn again.
    wide = Difference.between(state, replace(state, size=(80, 60)))
    assert (wide.stage, wide.relights) == ("cast", False)


class Read(ViewState):
    """A state that notes which of its fields are read."""

    __slots__ = ()
    names: ClassVar[set[str]] = set()

    def __getattribute__(self, name: str) -> Any:
        Read.names.add(name)
        return super().__getattribute__(name)


def test_a_change_costs_the_stage_that_reads_it(state, monkeypatch):
    monkeypatch.setattr(CastWorker, "request", lambda *_: None)
    assert set(STAGES) == {field.name for field in fields(ViewState)}
    read = Read(**{name: getattr(state, name) for name in STAGES})
    scheduler = CastScheduler(lambda: None)
    seen: dict[str, set[str]] = {}
    for stage, step in (
        ("cast", lambda: scheduler.change(read, 0.0, held=False)),
        ("relight", lambda: (room.shown_spec(read), light_rows.light_rig(read.lights), read.other)),
    ):
        Read.names.clear()
        step()
        seen[stage] = Read.names & set(STAGES)
    # The walls of a room are another's cast, and the other fields' functions have one of a cast.
    assert {STAGES[name] for name in seen["cast"] - {"room", "chosen_field"}} == {"cast"}
    assert {"view", "transfer", "shading", "size", "meshes"} <= seen["cast"]
    assert {STAGES[name] for name in seen["relight"]} <= {"cast", "relight"}


# What edits say with one of these texts; others are names of materials.
TEXTS = (
    *("gold", "copper", "silver", "HP1", "sky", "FL2", "A", "maximum", "fast", "#804020", "dim"),
    *("colour", "light", "RGB", "CAM16", "picture", "scene", "dim room", "Display P3", "reduce"),
    *("exposure", "white_cd_m2", "backdrop", "distance", "intensity", "jitter", "opacity"),
    "rounds",
)
# Their panel is open; a light of one spectrum, a curve without regions,
# labels and opacity by gradient, a lamp, a cell without a target, and no room, measurement, focus,
# flashlight, fields or layers have nothing to edit.
_IDLE = (
    *("commands.open_panel", "light_parts.remove_part"),
    *("transfer_edits.set_region_values", "transfer_edits.set_region_gradients"),
    *("transfer_edits.set_softness", "transfer_edits.move_gradient_point"),
    *("transfer_edits.add_gradient_point", "transfer_edits.remove_gradient_point"),
    *("opacities.reset", "labels.toggle_label"),
    *("labels.show_only", "palette_edits.set_target_weight", "palette_edits.set_target_group"),
    *("depth.reset", "depth.set_aperture", "depth.set_stereo"),
    *("fields.choose", "fields.solo", "fields.set_look"),
    *("palette_edits.set_target_distance", "room.paint", "room.pick", "effects.prepare"),
    "lighting.carry",
    *(f"measure.{name}" for name in ("pick", "rename", "remove", "remove_all", "stop")),
)
_UNCAST = ("lights", "light_parts", "light_states", "viewing", "slices")


@pytest.fixture
def cut(state: ViewState) -> ViewState:
    """Something to remove: a crop, planes, sources, saved states, meshes, a material."""
    planes = (ClipPlane((3.0, 3.0, 3.0), (1.0, 0.0, 0.0)),) * 2
    shading = replace(state.shading, crop_voxels=((1, 6), (0, 7), (0, 7)), clip_planes=planes)
    groups = LightGroup("sky", (Ambient(),)), LightGroup("lamp", (Point((9.0, 0.0, 0.0)),))
    shading = replace(shading, ambient=0.5, groups=groups)
    kept = tuple(light_rows.LightState(name, state.lights[1:], state.relight) for name in "ab")
    metals = {**state.transfer.materials, "silver": reflectance("silver")}
    transfer = replace(state.transfer, materials=metals)
    rows = (MeshSpec(shape="triad"), MeshSpec(shape="disc", material="copper", shown=False))
    return replace(state, shading=shading, saved_lights=kept, transfer=transfer, meshes=rows)


@pytest.mark.not_quick
@pytest.mark.parametrize("name", edits_of(*MODULES))
def test_every_edit_does_something_and_none_of_lights_casts(cut, name):
    indices = (3 if name == "lights.set_kelvin" else 1), 0
    edits = [with_arguments(name, (0.3, 0.4) * 2, indices, text) for text in TEXTS]
    costs = {Difference.between(cut, edit(cut)).stage for edit in edits}
    assert (costs == {None}) == (name in _IDLE)
    assert "cast" not in costs or name.partition(".")[0] not in _UNCAST


# There are no labels, room, measurements and opacities; meshes have no layers; the rest is so.
_DONE = (
    *("transfer-labels", "labels-show", "labels-hide", "labels-invert", "transfer-points"),
    *("projection-composite", "quality-balanced", "measure-remove", "palette-restart"),
    *("panel-room", "reset-paints", "opacities-reset", "stereo-anaglyph", "stereo-side-by-side"),
)


def test_every_action_does_something_and_none_of_lights_or_window_casts(cut):
    state = slices.set_greys(slices.move_slice(cut, 1, 0.3), 0.2, 0.4)
    old = transfer_edits.shift(replace(state, view=replace(state.view, zoom=3.0)), 0.1)
    states = [light_rows.LightState(str(i), state.lights[1:], state.relight) for i in range(9)]
    drawn = light_parts.draw(old, 2, 0, (0.5, 2.0), (0.5, 2.0))
    old = replace(drawn, other=state.lights, saved_lights=tuple(states))
    old = replace(old, interface=replace(old.interface, light=2))
    for action in COMMANDS:
        if action.change is not None:
            cost = Difference.between(old, after(action.change, old).state).stage
            assert (cost is None) == (action.name in _DONE), action.name
            assert cost != "cast" or action.menu not in ("Light", "Window"), action.name


def test_a_drag_is_one_step_of_undo_and_the_window_is_none(state):
    history = History(state)
    for weight in (0.2, 0.5, 0.8):
        history = history.then(lights.set_weight(history.present, 1, weight), 1)
    history = history.then(run_command(history.present, "dark").state, 2)
    history = history.then(run_command(history.present, "view-right").state, 3)
    assert len(history.past) == 2

    back = history.undo().undo()
    assert back.present.lights == state.lights and back.present.view == state.view
    assert not back.present.interface.dark
    assert back.undo() is back
    forth = back.redo().redo()
    assert forth.present == history.present and forth.redo() is forth


def test_history_is_bounded_and_steps_forget_the_future(state):
    history = History(state)
    for gesture in range(MAX_UNDO + 20):
        history = history.then(camera.orbit(history.present, 0.01, 0.0), gesture)
    assert len(history.past) == MAX_UNDO
    assert history.undo().then(replace(state, document=replace(state.document)), 10**6).future == ()


def test_a_state_always_has_a_chosen_light(state):
    for wrong, right in ((7, 3), (-2, 0)):
        assert replace(state, interface=Interface(light=wrong)).interface.light == right
    last = lights.choose(state, 3)
    assert replace(last, lights=state.lights[:2]).interface.light == 1
    assert lights.remove(last, 3).interface.light == 2


def test_undo_of_a_kept_mix_chooses_the_light_that_was_chosen(state):
    start = lights.choose(state, 1)
    history = History(start).then(run_command(start, "keep-mix").state, 1)
    assert history.present.interface.light == 4
    back = history.undo()
    assert len(back.present.lights) == 4 and back.present.interface.light == 1
    assert back.redo().present.interface.light == 4
    # What is chosen is no step, and a step of the view leaves it.
    looked = History(start).then(run_command(start, "view-right").state, 1)
    looked = looked.then(lights.choose(looked.present, 3), 2)
    assert looked.undo().present.interface.light == 3


def test_another_file_chooses_its_shining_light_and_keeps_the_window(state):
    """Places and values of the last volume, such as a distance begun, are gone."""
    own = {"tool": "distance", "tool_points": ((1.0, 2.0, 3.0),), "mesh": 2, "source": 1}
    slices = Slices((0.1, 0.2, 0.3), lit=False, greys=(0.2, 0.4))
    interface = Interface(dark=False, light=3, slices=slices, pick=Pick(use="copper"), **own)
    before = replace(state, size=(40, 30), interface=interface)
    new = OpenResult(under(state, 2)).after(before).state
    assert new.size == (40, 30)
    kept = Interface(dark=False, light=2, slices=Slices(lit=False), tool="distance")
    assert new.interface == kept
    session = OpenResult(lights.choose(state, 1), session=Path("x")).after(before).state
    assert session.interface.light == 1 and session.interface.dark


def steps(given: Sequence[tuple[float, Input]]) -> int:
    """Count the steps of undo that timed inputs make."""
    gestures, numbers = Gestures(), set()
    for now, each in given:
        gestures.take(each, now)
        numbers.add(gestures.number)
    return len(numbers)


def test_a_run_of_notches_or_steps_is_one_gesture():
    def run(each: Input, apart: float) -> int:
        return steps([(10.0 + i * apart, each) for i in range(6)])

    wheel, roll = Input("wheel", y=1.0), Input("wheel", y=1.0, modifiers="shift")
    left, plus = Input("key", key="shift+left"), Input("key", key="+")
    for each in (wheel, left, plus):
        assert run(each, 0.9 * RUN_S) == 1 and run(each, 1.1 * RUN_S) == 6
    # Each press of a key that makes no steps is one, however quick; held down it comes once.
    assert run(Input("key", key="b"), 0.1) == 6
    assert run(replace(left, repeated=True), 2 * RUN_S) == 1
    for between, count in ((roll, 3), (Input("move"), 1), (Input("press", button="left"), 3)):
        assert steps([(0.0, wheel), (0.1, between), (0.2, wheel)]) == count


@pytest.mark.parametrize("tool", measure.TOOLS)
def test_annotations_are_steps_with_the_text_typed_into_them(state, tool):
    gestures, history = Gestures(), History(state)

    def go(change: Any, given: Input, writes: bool = False) -> ViewState:
        nonlocal history
        gestures.take(given, 0.0, writes)
        history = history.then(after(change, history.present).state, gestures.number)
        return history.present

    press, key = Input("press", button="left"), Input("key", key="b")
    turned = go(lambda s: measure.start(camera.orbit(s, 0.1, 0.0), tool), key)
    for number in range(measure.TOOLS[tool]):
        go(lambda s, x=float(number): measure.pick(s, (x, x * x, 0.0)), press)
    for text in ("a", "ab"):
        added = go(lambda s, text=text: measure.rename(s, 0, text), key, writes=True)
    go(lambda s: measure.rename(s, 0, "c"), press)
    removed = go(measure.remove_all, key)
    back = [history := history.undo() for _ in range(4)]
    texts = [[each.text for each in step.present.annotations] for step in back]
    assert not removed.annotations and texts == [["c"], ["ab"], [], []]
    assert [step.present.view == turned.view for step in back] == [True, True, True, False]
    assert history.redo().redo().present.annotations == added.annotations


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("view", "view-right"),
        ("lights", "next-light"),
        ("lights", "compare"),
        ("viewing", "mark"),
        ("light states", light_states.save),
        ("transfer function", lambda s: transfer_edits.shift(s, 0.1)),
        ("cuts", lambda s: cuts.move_crop(s, 0, 0.3)),
        ("annotations", lambda s: measure.pick(measure.start(s, "label"), (0.0, 0.0, 0.0))),
        ("shading", lambda s: replace(s, shading=replace(s.shading, ambient=0.7))),
        ("palette", lambda s: palette_edits.toggle_constant(s, 1)),
    ],
)
def test_what_is_undone_has_a_name(state, what, change):
    new = run_command(state, change) if isinstance(change, str) else after(change, state)
    assert Difference.between(state, new.state).name == what


def test_lights_have_names_of_their_own_by_hand(state):
    new = lights.rename(state, 1, "  my\n lamp ")
    own = new.lights[1].name
    assert own.split(" ") == ["my", "lamp"] and new.lights[1].rig is state.lights[1].rig
    assert lights.rename(new, 2, own).lights[2].name == f"{own} (2)"
    for index, name in ((1, own), (1, " "), (9, "x"), (-1, "x")):
        assert lights.rename(new, index, name) is new
    # Renamed, it is the light of the saved state.
    back = light_states.recall(lights.rename(light_states.save(state).state, 0, "x"), 0)
    assert back.lights == state.lights


def test_a_name_given_by_hand_stays_whatever_the_light_becomes(state):
    new = lights.choose(lights.rename(state, 3, "lamp"), 3)
    pen = light_parts.draw(new, 3, 0, (0.1, 2.0), (0.5, 2.0))
    # Also where it was given after the drawing.
    later = lights.rename(light_parts.draw(state, 3, 0, (0.1, 2.0), (0.5, 2.0)), 3, "lamp")
    for other in (
        lights.set_kelvin(new, 3, 5000.0),
        light_parts.respell(new, 3, 0, "D50").state,
        *(pen, run_command(pen, "reset-spectrum").state),
        light_parts.draw(later, 3, 0, (0.6, 2.0), (0.9, 2.0)),
    ):
        assert other.lights[3].name == "lamp"


def test_the_palette_follows_a_light_to_its_new_name(state):
    cell = Cell("same", other=("gold", "A"))
    targets = DesignTargets({("gold", "A"): cell}, frozenset({(LIGHT, "A")}), lamps={"A": ("FL2",)})
    board = lights.rename(replace(state, palette=PaletteState(targets, targets)), 1, "lamp").palette
    assert board.targets.cells == {("gold", "lamp"): replace(cell, other=("gold", "lamp"))}
    assert board.targets.free == {(LIGHT, "lamp")}
    assert dict(board.targets.lamps) == {"lamp": ("FL2",)}
    assert not board.is_pending
    other = replace(state, palette=PaletteState(targets))
    assert lights.rename(other, 2, "lamp").palette == other.palette


def test_a_complaint_goes_when_the_lights_are_edited(state):
    panel = LightsPanelState()
    panel.complain("unknown", (1, 0), state.lights)
    assert panel.complaint_at((1, 0), state.lights) == "unknown"
    assert panel.complaint_at((0, 0), state.lights) == ""
    assert panel.complaint_at((1, 0), lights.set_weight(state, 2, 0.4).lights) == ""


def test_without_a_session_a_file_is_opened(state, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("VOLSPEC_STATE", str(tmp_path))
    begun: list[str | None] = []
    monkeypatch.setattr(
        DocumentService, "open", lambda _, path, notify=True: begun.append(path), raising=True
    )

    def resumed(path: str | None) -> tuple[Any, Notice]:
        begun.clear()
        notice = Notice()
        made = DocumentService(Tasks(lambda: None), notice, None)
        made.resume_last(path)
        return made, notice

    _, notice = resumed(None)
    assert begun == [None] and notice.text
    scene = tmp_path / "mine.toml"
    scene.touch()
    RecentFiles(tmp_path).add(str(scene))
    made, notice = resumed(None)
    assert begun == [str(scene)] and scene.name in notice.text
    broken = Outcome("open", error="broken")
    assert made.finish_open(broken, first=True) is None and begun == [str(scene), None]
    # Nothing is left to open: the window says why.
    assert made.problem == "" and made.finish_open(broken, first=True) is None
    assert made.problem == "broken" and notice.current.kind == "error"
    assert capsys.readouterr().err == "volspec: broken\n" * 2
    # What was named comes before what was opened last; what is gone is no file.
    resumed("named")
    assert begun == ["named"]
    scene.unlink()
    resumed(None)
    assert begun == [None]


def test_a_frame_takes_one_gesture(monkeypatch):
    """A press is where the mouse was then, and a key after a drag is no part of it."""
    glfw, imgui = inputs.glfw, inputs.imgui
    heard: dict[str, Any] = {}
    for name in [name for name in dir(glfw) if name.endswith("_callback")]:
        monkeypatch.setattr(
            glfw, name, lambda _, listener, name=name: heard.update({name: listener})
        )
    monkeypatch.setattr(glfw._glfw, "glfwSetDropCallback", lambda *_: None)
    monkeypatch.setattr(glfw, "get_cursor_pos", lambda _: (90.0, 90.0))
    monkeypatch.setattr(glfw, "get_key", lambda *_: glfw.RELEASE)
    context = imgui.create_context()
    try:
        keys: list[int] = []
        taken = inputs.Inputs(None, lambda _, key, *__: keys.append(key))
        heard["set_mouse_button_callback"](None, 0, glfw.PRESS, 0)
        heard["set_cursor_pos_callback"](None, 3.0, 4.0)
        heard["set_mouse_button_callback"](None, 0, glfw.RELEASE, 0)
        for x in (5.0, 6.0):  # the hand that turns it moves the mouse, too
            heard["set_scroll_callback"](None, 0.0, 1.0)
            heard["set_cursor_pos_callback"](None, x, 4.0)
        for key in (glfw.KEY_UP, glfw.KEY_ENTER):
            heard["set_key_callback"](None, key, 0, glfw.PRESS, 0)
        drag = [(given.name, given.x, given.y) for given in taken.take()]
        assert drag == [("press", 90.0, 90.0), ("move", 3.0, 4.0), ("release", 3.0, 4.0)]
        assert [given.name for given in taken.take()] == ["wheel", "move"] * 2
        assert [given.key for given in taken.take()] == ["up"] and taken.waiting
        # imgui hears of a key with it, not before.
        assert keys == [glfw.KEY_UP]
        assert [given.key for given in taken.take()] == ["enter"] and not taken.waiting
        assert keys == [glfw.KEY_UP, glfw.KEY_ENTER]
        assert taken.take() == []
    finally:
        imgui.destroy_context(context)


_WORDS_DRAWN = ("", "no such", "gold", "A", "#804020", "CAM16", "dim", "free", "light")
_CHANGES = st.sampled_from([each.change for each in COMMANDS if each.change is not None])


# Points drawn at random may be too close for a table, which a warning says.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*too close for the span")
@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(
    edits=st.lists(drawn(_WORDS_DRAWN, *MODULES) | _CHANGES, min_size=50, max_size=60),
    grouped=st.booleans(),
)
def test_random_edits_never_raise(state, edits, grouped):
    if grouped:  # a light of two groups, over a cast with both
        groups = LightGroup("gold", (Headlight(),)), LightGroup("A", (Ambient(),))
        rig = LightRig((light("A"), light("D65")), (1.0, 0.5), None, ("gold", "A"))
        rows = (*state.lights, light_rows.LightRow("evening", "", rig, texts=("A", "D65")))
        state = replace(state, lights=rows, shading=replace(state.shading, groups=groups))
    for edit in edits:
        state = after(edit, state).state
    state.view.camera(state.document.volume)
    rig_now = light_rows.light_rig(state.lights)
    assert rig_now is None or any(rig_now.weights)
    for row in state.lights:
        assert np.isfinite(row.rig.mixed(DEFAULT_GRID).values).all()
        assert len(row.texts) == len(row.rig.lights)
    assert state.lights and state.transfer.bake(1.0).opacity.max() <= 1
    assert 0 <= state.interface.light < light_rows.MAX_ROWS
