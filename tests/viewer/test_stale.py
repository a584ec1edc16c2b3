"""What a change costs: the whole table, and that no light can reach the raycaster."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import pytest

from tests.viewer._edits import MODULES, edits_of
from volspec.raycast import ClipPlane
from volspec.relight import RelightSpec
from volspec.spectra import reflectance
from volspec.viewer.model import camera, light_parts, lights, slices, transfer_edits
from volspec.viewer.model.commands import BY_NAME, COMMANDS
from volspec.viewer.model.document import Document
from volspec.viewer.model.edit import Edited, after
from volspec.viewer.model.history import MOST_STEPS, STAGES, Difference, History
from volspec.viewer.model.light_rows import Fade, LightState
from volspec.viewer.model.palette_targets import PaletteState
from volspec.viewer.model.state import Interface, ViewState


def test_every_field_of_the_state_has_its_stage() -> None:
    assert set(STAGES) == {field.name for field in fields(ViewState)}
    assert {STAGES[name] for name in ("lights", "relight", "other", "divide")} == {"relight"}


def test_nothing_to_do_where_nothing_changed_and_everything_at_first(state: ViewState) -> None:
    assert Difference.between(None, state).stage == "cast"
    assert Difference.between(state, state).stage is None
    assert Difference.between(state, replace(state, view=replace(state.view))).stage is None


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
        "relight": RelightSpec(backdrop=0.5),
        "other": state.lights,
        "divide": 0.25,
        "interface": Interface(dark=False),
        "saved_lights": (LightState("State 1", state.lights, state.relight),),
        "fade": Fade(state.lights, state.relight, 1.0),
        "palette": PaletteState(),
        "thickness": 2.0,
        "unthickened": (state.transfer, 1.0, state.transfer),
    }
    changed = replace(state, **{name: others[name]})
    assert Difference.between(state, changed).stage == STAGES[name]
    # The picture that is shown until the cast is there need not be drawn again.
    assert Difference.between(state, changed).relights == (STAGES[name] == "relight")


def test_other_reflectances_are_lit_anew(state: ViewState) -> None:
    other = replace(state.transfer, basis=replace(state.transfer.basis))
    assert (
        Difference.between(state, replace(state, transfer=other)).relights
        and Difference.between(None, state).relights
    )


def test_the_first_of_several_stages_is_named(state: ViewState) -> None:
    both = replace(state, lights=state.lights[:-1], interface=Interface(keys=True))
    assert Difference.between(state, both).stage == "relight"
    assert Difference.between(state, replace(both, size=(8, 8))).stage == "cast"


# What each edit does at most, and its arguments, with which it does something if it can.
_COSTS: dict[str, tuple[Any, ...]] = {
    "camera.orbit": ("cast", 0.3, 0.4),
    "camera.pan": ("cast", 0.3, 0.4),
    "camera.zoom": ("cast", 0.3, 0.4),
    "camera.roll": ("cast", 0.3),
    "camera.zoom_notches": ("cast", 0.4),
    "camera.roll_notches": ("cast", 0.4),
    "camera.widen_notches": ("cast", 0.4),
    "camera.look_at_face": ("cast", 1),
    "cuts.move_crop": ("cast", 1, 0.3),
    "cuts.shift_plane": ("cast", 1, 0.3),
    "cuts.tilt_plane": ("cast", 1, 0.3, 0.4),
    "cuts.flip_plane": ("cast", 1),
    "cuts.remove_plane": ("cast", 1),
    "cuts.choose_plane": ("frame", 1),
    "cuts.add_plane": ("cast", (0.0, 0.6, 0.8)),
    "slices.move_slice": ("frame", 1, 0.3),
    "slices.step_slice": ("frame", 1, 0.3),
    "slices.point_at": ("frame", 1, 0.3, 0.4),
    "slices.set_greys": ("frame", 0.3, 0.4),
    "lights.set_weight": ("relight", 1, 0.3),
    "lights.set_kelvin": ("relight", 3, 0.3),
    "light_parts.set_lux": ("relight", 1, 0.3),
    "light_parts.set_part_weight": ("relight", 1, 0, 0.3),
    "light_parts.draw": ("relight", 1, 0, (0.3, 0.4), (0.3, 0.4)),
    "lights.blend": ("relight", 0.3, 0.4),
    "lights.toggle_solo": ("relight", 1),
    "lights.toggle_mute": ("relight", 1),
    "lights.remove": ("relight", 1),
    "lights.choose": ("frame", 1),
    "lights.set_divide": ("relight", 0.3),
    "lights.only": ("relight", 1),
    "lights.rename": ("relight", 1, "gold"),
    "lights.keep_mix": ("relight",),
    "lights.add": ("relight", "HP1"),
    "light_parts.respell": ("relight", 1, 0, "FL2"),
    "lights.show_alone": ("relight", 1),
    # What mends or parts a light of one spectrum: of parts, there is one and no group.
    "light_parts.regroup": ("relight", 1, 0, "gold"),
    "light_parts.add_part": ("relight", 1, "gold"),
    "light_parts.remove_part": (None, 1, 0),
    "light_parts.split_part": (None, 1),
    "light_states.save": ("frame",),
    "light_states.save_over": ("frame", 1),
    "light_states.rename": ("frame", 1, "gold"),
    "light_states.delete": ("frame", 1),
    "light_states.recall": ("relight", 1),
    "light_states.set_fade": ("frame", 0.3),
    "viewing.set_model": ("relight", "CAM16"),
    "viewing.set_adapting": ("relight", "picture"),
    "viewing.set_illuminance": ("relight", 0.3),
    "viewing.toggle_own_luminance": ("relight",),
    # It follows from the light until it is given.
    "viewing.set_luminance": (None, 0.3),
    "viewing.set_background": ("relight", 0.3),
    "viewing.set_surround": ("relight", "dim"),
    "viewing.set_adaptation": ("relight", 0.3),
    "viewing.toggle_discount": ("relight",),
    "viewing.set_room": ("relight", "dim room"),
    "viewing.set_space": ("relight", "Display P3"),
    "viewing.set_white": ("relight", 0.3),
    "viewing.set_display_surround": ("relight", "dim"),
    "viewing.set_gamut": ("relight", "reduce"),
    "viewing.set_exposure": ("relight", 0.3),
    "viewing.set_backdrop": ("relight", 0.3),
    "viewing.set_mode": ("relight", "exact"),
    "viewing.set_level": ("relight", "absolute"),
    "transfer_edits.move_point": ("cast", 1, 0.3, 0.4),
    "transfer_edits.add_point": ("cast", 0.3, 0.4),
    "transfer_edits.remove_point": ("cast", 1),
    "transfer_edits.choose_part": ("frame", 1),
    "transfer_edits.set_opacity": ("cast", 1, 0.3),
    "transfer_edits.set_material": ("cast", 1, "gold"),
    "transfer_edits.set_material_weight": ("cast", 1, "gold", 0.3),
    # Of regions only, which the curve here has none of.
    "transfer_edits.set_region_values": (None, 1, 0.3, 0.4),
    "transfer_edits.set_region_gradients": (None, 1, 0.3, 0.4),
    "transfer_edits.set_softness": (None, 1, 0.3),
    "transfer_edits.toggle_gradient_opacity": ("cast",),
    # Of opacity by gradient, which the curve here does not have.
    "transfer_edits.move_gradient_point": (None, 1, 0.3, 0.4),
    "transfer_edits.add_gradient_point": (None, 0.3, 0.4),
    "transfer_edits.remove_gradient_point": (None, 1),
    "transfer_edits.shift": ("cast", 0.3),
    "transfer_edits.thicken": ("cast", 0.3),
    "transfer_edits.window": ("cast", 0.3, 0.4),
    "transfer_edits.thicken_by": ("cast", 0.3, 0.4),
    "materials.add_material": ("cast", 1, "gold"),
    "materials.remove_material": ("cast", "silver"),
    "palette_edits.choose_cell": ("relight", 1),
    # The first target makes the materials channels, which is the one cast; later ones relight.
    "palette_edits.set_target": ("cast", 1, "#804020"),
    "palette_edits.set_target_kind": ("cast", 1, "colour", 0),
    # Of a target that is not there.
    "palette_edits.set_target_weight": (None, 1, 0.3),
    "palette_edits.set_target_group": (None, 1, "gold"),
    "palette_edits.set_target_distance": (None, 1, 0.3),
    "palette_edits.toggle_free": ("cast", "light", 1),
    "palette_edits.toggle_constant": ("cast", 1),
    "palette_edits.toggle_lamp": ("cast", 1, "A"),
    "palette_edits.set_smoothness": ("relight", 0.3),
    "palette_edits.set_metric": ("relight", "RGB"),
    "palette_edits.set_iterations": ("relight", 0.3),
    "palette_edits.assign": ("cast", 0.3, 0.4, "gold"),
    "palette_edits.recast_range": ("cast", 1, "copper"),
    # The panel is open.
    "commands.open_viewing": (None,),
    "palette_edits.pick_material": ("frame", "gold"),
    "palette_edits.pick_light": ("frame", "A"),
    "palette_edits.pick_like": ("frame", "gold"),
    "palette_edits.pick_within": ("frame", "gold"),
    "palette_edits.pick_black": ("frame",),
    "palette_edits.pick_distance": ("frame", 0.3),
    "palette_edits.toggle_merged": ("frame", "gold"),
    "palette_edits.pick_values": ("frame", 0.3, 0.4),
    "palette_edits.pick_use": ("frame", "gold"),
}


@pytest.fixture
def cut(state: ViewState) -> ViewState:
    """Something to reset and remove: a crop, two planes, two saved states, a material too many."""
    planes = (ClipPlane((3.0, 3.0, 3.0), (1.0, 0.0, 0.0)),) * 2
    shading = replace(state.shading, crop_voxels=((1, 6), (0, 7), (0, 7)), clip_planes=planes)
    kept = tuple(LightState(name, state.lights[1:], state.relight) for name in "ab")
    metals = {**state.transfer.materials, "silver": reflectance("silver")}
    transfer = replace(state.transfer, materials=metals)
    return replace(state, shading=shading, saved_lights=kept, transfer=transfer)


def test_edits_cost_what_their_names_say(cut: ViewState) -> None:
    assert set(_COSTS) == set(edits_of(*MODULES))
    for name, (cost, *given) in _COSTS.items():
        found = edits_of(*MODULES)[name](cut, *given)
        new = found.state if isinstance(found, Edited) else found
        assert Difference.between(cut, new).stage == cost, name


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
    state = slices.set_greys(slices.move_slice(cut, 1, 0.3), 0.2, 0.4)
    old = transfer_edits.shift(replace(state, view=replace(state.view, zoom=3.0)), 0.1)
    states = [LightState(str(i), state.lights[1:], state.relight) for i in range(9)]
    drawn = light_parts.draw(old, 2, 0, (0.5, 2.0), (0.5, 2.0))
    old = replace(drawn, other=state.lights, saved_lights=tuple(states))
    old = replace(old, interface=replace(old.interface, light=2))
    for action in COMMANDS:
        if action.change is not None:
            cost = _ODD.get(action.name, _MENUS.get(action.menu))
            new = after(action.change, old).state
            assert Difference.between(old, new).stage == cost, action.name


def done(state: ViewState, name: str) -> ViewState:
    change = BY_NAME[name].change
    assert change is not None
    return after(change, state).state


def test_a_drag_is_one_step_of_undo_and_the_window_is_none(state: ViewState) -> None:
    history = History(state)
    for weight in (0.2, 0.5, 0.8):
        history = history.then(lights.set_weight(history.present, 1, weight), 1)
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
        history = history.then(camera.orbit(history.present, 0.01, 0.0), gesture)
    assert len(history.past) == MOST_STEPS
    other = history.undone().then(replace(state, document=replace(document)), 10**6)
    assert other.future == ()
