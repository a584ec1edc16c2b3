"""What a change costs: the whole table, and that no light can reach the raycaster."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest

from volspec.raycast import ClipPlane
from volspec.relight import RelightSpec
from volspec.spectra import reflectance
from volspec.viewer.model.commands import ACTIONS, BY_NAME
from volspec.viewer.model.document import Document
from volspec.viewer.model.events import EVENTS, Event, reduced
from volspec.viewer.model.history import MOST_STEPS, STAGES, History, lit_otherwise, stale_stage
from volspec.viewer.model.light_states import Fade, LightState
from volspec.viewer.model.palette_targets import Board
from volspec.viewer.model.state import Interface, ViewState


def test_every_field_of_the_state_has_its_stage() -> None:
    assert set(STAGES) == {field.name for field in fields(ViewState)}
    assert {STAGES[name] for name in ("lights", "seen", "other", "divide")} == {"relight"}


def test_nothing_to_do_where_nothing_changed_and_everything_at_first(state: ViewState) -> None:
    assert stale_stage(None, state) == "cast"
    assert stale_stage(state, state) is None
    assert stale_stage(state, replace(state, view=replace(state.view))) is None


@pytest.mark.parametrize("name", STAGES)
def test_a_change_of_one_field_is_of_its_stage(state: ViewState, name: str) -> None:
    others: dict[str, Any] = {
        "document": replace(state.document),
        "view": replace(state.view, zoom=2.0),
        "transfer": replace(state.transfer),
        "shift": 1.0,
        "shading": replace(state.shading, ambient=0.9),
        "size": (80, 60),
        "lights": state.lights[:-1],
        "seen": RelightSpec(backdrop=0.5),
        "other": state.lights,
        "divide": 0.25,
        "interface": Interface(dark=False),
        "kept": (LightState("State 1", state.lights, state.seen),),
        "fade": Fade(state.lights, state.seen, 1.0),
        "board": Board(),
        "thickness": 2.0,
        "thin": (state.transfer, 1.0, state.transfer),
    }
    changed = replace(state, **{name: others[name]})
    assert stale_stage(state, changed) == STAGES[name]
    # The picture that is shown until the cast is there need not be drawn again.
    assert lit_otherwise(state, changed) == (STAGES[name] == "relight")


def test_other_reflectances_are_lit_anew(state: ViewState) -> None:
    other = replace(state.transfer, basis=replace(state.transfer.basis))
    assert lit_otherwise(state, replace(state, transfer=other)) and lit_otherwise(None, state)


def test_the_first_of_several_stages_is_named(state: ViewState) -> None:
    both = replace(state, lights=state.lights[:-1], interface=Interface(keys=True))
    assert stale_stage(state, both) == "relight"
    assert stale_stage(state, replace(both, size=(8, 8))) == "cast"


# What each event does at most, where it does something.
_COSTS = {
    **dict.fromkeys(("orbit", "pan", "zoom", "wheel"), "cast"),
    **dict.fromkeys(("point", "add-point", "remove-point", "shift"), "cast"),
    **dict.fromkeys(("weight", "kelvin", "dial", "solo", "mute", "divide"), "relight"),
    "select": "frame",
    **dict.fromkeys(("roll", "roll-wheel", "fov", "face"), "cast"),
    **dict.fromkeys(("crop", "plane-shift", "plane-tilt", "plane-flip", "plane-remove"), "cast"),
    **dict.fromkeys(("slice", "slice-step", "slice-point", "slice-greys"), "frame"),
    "plane-select": "frame",
    **dict.fromkeys(("lux", "part-weight", "draw"), "relight"),
    # The first wish makes the materials channels, which is the one cast; later ones relight.
    **dict.fromkeys(("wish", "wish-kind", "open", "constant", "lamp", "assign", "recast"), "cast"),
    **dict.fromkeys(("smoothness", "rounds", "metric", "pick-cell"), "relight"),
    # Of a wish that is not there.
    **dict.fromkeys(("wish-weight", "wish-group", "wish-distance"), None),
    **dict.fromkeys(("opacity", "material", "share", "thicken", "window", "thicken-by"), "cast"),
    # What adds, mends or parts a light of one spectrum: of parts, there is one and no group.
    **dict.fromkeys(("add-light", "show-light", "respell", "regroup", "add-part"), "relight"),
    **dict.fromkeys(("alone", "rename-light", "recall-state"), "relight"),
    **dict.fromkeys(("save-over-state", "rename-state", "delete-state", "fade"), "frame"),
    **dict.fromkeys(("remove-part", "split-part"), None),
    **dict.fromkeys(("model", "adapting", "illuminance", "own-luminance"), "relight"),
    **dict.fromkeys(("background", "surround", "adaptation", "discount"), "relight"),
    **dict.fromkeys(("room", "space", "white", "display-surround", "gamut"), "relight"),
    **dict.fromkeys(("exposure", "backdrop", "mode", "level"), "relight"),
    # It follows from the light until it is given.
    "luminance": None,
    "logarithmic": "frame",
    **dict.fromkeys(("pick-material", "pick-light", "pick-like", "pick-within"), "frame"),
    **dict.fromkeys(("pick-black", "pick-distance", "pick-merged"), "frame"),
    **dict.fromkeys(("pick-values", "pick-use"), "frame"),
    # The panel is open.
    "open-viewing": None,
    # Of regions only, which the curve here has none of.
    **dict.fromkeys(("region-values", "region-gradients", "softness"), None),
    **dict.fromkeys(("by-gradient", "add-material", "remove-material"), "cast"),
    # Of opacity by gradient, which the curve here does not have.
    **dict.fromkeys(("gradient-point", "add-gradient-point", "remove-gradient-point"), None),
    "choose-point": "frame",
}
_KEYS = {
    "wish": "#804020",
    "wish-kind": "colour",
    "open": "light",
    "lamp": "A",
    "metric": "RGB",
    "assign": "gold",
    "recast": "copper",
    "remove-material": "silver",
    "add-light": "HP1",
    "respell": "FL2",
    "pick-light": "A",
    "model": "CAM16",
    "adapting": "picture",
    "surround": "dim",
    "display-surround": "dim",
    "room": "dim room",
    "space": "Display P3",
    "gamut": "reduce",
    "mode": "exact",
    "level": "absolute",
}


@pytest.fixture
def cut(state: ViewState) -> ViewState:
    """Something to reset and remove: a crop, two planes, two saved states, a material too many."""
    planes = (ClipPlane((3.0, 3.0, 3.0), (1.0, 0.0, 0.0)),) * 2
    shading = replace(state.shading, crop_voxels=((1, 6), (0, 7), (0, 7)), clip_planes=planes)
    kept = tuple(LightState(name, state.lights[1:], state.seen) for name in "ab")
    metals = {**state.transfer.materials, "silver": reflectance("silver")}
    transfer = replace(state.transfer, materials=metals)
    return replace(state, shading=shading, kept=kept, transfer=transfer)


def test_events_cost_what_their_names_say(cut: ViewState) -> None:
    state = cut
    assert set(_COSTS) == set(EVENTS)
    for name, cost in _COSTS.items():
        index = 3 if name == "kelvin" else 1
        new = reduced(state, Event(name, 0.3, 0.4, index, _KEYS.get(name, "gold")))
        assert stale_stage(state, new) == cost, name


# What an action does at most, by its menu; others are in `_ODD`.
_MENUS = {"View": "cast", "Light": "relight", "Window": "frame"}
_MENUS |= {"Cut": "cast", "Transfer": "cast", "": "cast"}
_ODD = {"reset-transfer": "cast", "mark": "relight", "save-state": "frame"} | dict.fromkeys(
    ("cube", "scale", "crop", "planes", "error-map")
    + ("axial-down", "axial-up", "coronal-forward", "coronal-backward")
    + ("sagittal-right", "sagittal-left"),
    "frame",
)
# Points are what it has already.
_ODD |= {"transfer-points": None, "palette-light": "cast", "palette-anew": None}
_ODD |= dict.fromkeys(("palette-forget", "palette-own"), "relight")


def test_actions_cost_what_their_menus_say(cut: ViewState) -> None:
    state = reduced(reduced(cut, Event("slice", 0.3, index=1)), Event("slice-greys", 0.2, 0.4))
    old = reduced(replace(state, view=replace(state.view, zoom=3.0)), Event("shift", 0.1))
    states = [LightState(str(i), state.lights[1:], state.seen) for i in range(9)]
    drawn = reduced(old, Event("draw", 0.5, 2.0, index=2))
    old = replace(drawn, other=state.lights, kept=tuple(states))
    old = replace(old, interface=replace(old.interface, light=2))
    for action in ACTIONS:
        if action.change is not None:
            cost = _ODD.get(action.name, _MENUS.get(action.menu))
            assert stale_stage(old, action.change(old)) == cost, action.name


def done(state: ViewState, name: str) -> ViewState:
    change = BY_NAME[name].change
    assert change is not None
    return change(state)


def test_a_drag_is_one_step_of_undo_and_the_window_is_none(state: ViewState) -> None:
    history = History(state)
    for weight in (0.2, 0.5, 0.8):
        history = history.then(reduced(history.present, Event("weight", weight, index=1)), 1)
    history = history.then(done(history.present, "dark"), 2)
    history = history.then(done(history.present, "view-right"), 3)
    assert len(history.past) == 2

    back = history.undone().undone()
    assert back.present.lights == state.lights and back.present.view == state.view
    assert not back.present.interface.dark
    assert back.undone() is back
    forth = back.redone().redone()
    assert forth.present == history.present and forth.redone() is forth


def test_history_is_bounded_and_a_new_step_forgets_the_future(
    state: ViewState, document: Document
) -> None:
    history = History(state)
    for gesture in range(MOST_STEPS + 20):
        history = history.then(reduced(history.present, Event("orbit", 0.01)), gesture)
    assert len(history.past) == MOST_STEPS
    other = history.undone().then(replace(state, document=replace(document)), 10**6)
    assert other.future == ()
