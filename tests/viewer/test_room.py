"""Scenes with a room: its lamps as the lights, paints without a cast, files and sessions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.viewer import read_scene, run_command, take_until
from tests.viewer._states import casts_of, frame_of, job_of, restored, save_ball
from volspec.raycast.progressive import WHOLE
from volspec.relight import LightRig
from volspec.scene import Scene
from volspec.scene.tables.specs import ROOM_LIGHT
from volspec.viewer.model import light_parts, lighting, lights, quality, viewing
from volspec.viewer.model import room as edits
from volspec.viewer.model.history import History
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.materials import with_material_basis
from volspec.viewer.model.scene_file import export_scene, scene_from_state
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.room import RoomJob, RoomWorker

pytestmark = pytest.mark.not_quick

SIZE = 48, 36
ROOM = """
size_m = [3.0, 3.0, 2.5]
surface = [
    { name = "walls", reflectance = "grey:0.6" },
    { name = "floor", reflectance = "#a08060" },
    { name = "ceiling", reflectance = "grey:0.8" },
]
light = [
    { name = "panel", spectrum = "A", on = "ceiling", place_m = [1, 1, 0.6, 0.6], lumen = 1500 },
    { name = "bulb", spectrum = "D65", position_m = [0.4, 0.5, 2.0], lumen = 200 },
]
"""
SCENE = """
version = 2
volume.file = "ball.npy"
material = [{ name = "copper", reflectance = "copper" }]
transfer.points = [
    { value = 0.2, opacity = 0.0, material = "copper" },
    { value = 0.9, opacity = 0.4, material = "copper" },
]
camera = { azimuth_deg = 30, elevation_deg = 10 }
light = [
    { name = "evening", spectrum = "room" },
    { name = "day", label = "daylight", spectrum = "D65" },
]
[room]
file = "room.toml"
position_m = [1.5, 1.5, 1.0]
scale = 20
patches = 200
shadows = false
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_scene(tmp_path_factory.mktemp("room"))


def write_scene(folder: Path) -> Path:
    save_ball(folder, 12)
    (folder / "room.toml").write_text(ROOM, encoding="utf-8")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def opened(folder: Path) -> ViewState:
    return replace(read_scene(folder / "scene.toml"), size=SIZE)


def frame(state: ViewState) -> NDArray[np.int_]:
    return frame_of(edits.solve_radiosity(state))


def painted(state: ViewState, surface: str, text: str) -> ViewState:
    new, message, _ = edits.paint(state, surface, text)
    assert not message
    return new


def test_its_lights_are_the_lamps(opened):
    evening, day = opened.lights
    assert (evening.texts, evening.rig.groups) == ((ROOM_LIGHT, ROOM_LIGHT), ("panel", "bulb"))
    assert (day.texts, day.rig.groups, day.label) == (("D65",), ("",), "daylight")
    assert edits.light_names(opened) == ("panel", "bulb")
    for row, light in zip(opened.lights, Scene.load(opened.document.path).lights, strict=True):
        rig = light_rig((replace(row, weight=1.0),), opened.room)
        assert rig.groups == light.rig.groups
        assert rig.illuminance_lux == pytest.approx(light.rig.illuminance_lux)


def test_every_way_to_change_a_light_goes_through_the_room(opened):
    day = lights.only(opened, 1)
    own = lights.add(opened, ROOM_LIGHT).state
    assert _rig(own).illuminance_lux == pytest.approx(_rig(opened).illuminance_lux)
    spelt = light_parts.respell(day, 1, 0, ROOM_LIGHT).state.lights[1]
    assert (spelt.texts, spelt.rig.groups) == ((ROOM_LIGHT,) * 2, ("panel", "bulb"))
    planck = light_parts.respell(day, 1, 0, "planck:3000").state
    warmer = lights.set_kelvin(planck, 1, 2000.0)
    assert _red(day) < _red(planck) < _red(warmer)
    assert _red(day) < _red(light_parts.draw(day, 1, 0, (0.8, 3.0), (1.0, 3.0)))
    assert light_parts.set_lux(day, 1, 100.0) is day  # the room's file has it
    alone = light_parts.regroup(day, 1, 0, "bulb")
    assert sum(_rig(alone).illuminance_lux) < sum(_rig(day).illuminance_lux)


def _rig(state: ViewState) -> LightRig:
    return light_rig(state.lights, state.room)


def _red(state: ViewState) -> float:
    values = _rig(state).mixed(state.document.grid).values
    return float(values[-8:].sum() / values.sum())


def test_conditions_follow_the_view_unless_they_are_given(opened):
    here = edits.shown_spec(opened)
    assert here.viewing == Scene.load(opened.document.path).relight.viewing
    assert here is edits.shown_spec(replace(opened, size=(9, 9)))
    turned = replace(opened, view=replace(opened.view, azimuth_deg=-150))
    assert edits.shown_spec(turned).viewing.Y_b != here.viewing.Y_b
    assert edits.shown_spec(viewing.set_viewing(turned, "Y_b", 55.0)).viewing.Y_b == 55.0


@pytest.mark.slow
def test_paint_needs_no_cast(opened):
    room = painted(painted(opened, "walls", "#c04030"), "floor", "grey:0.2").room
    assert not room.is_solved
    assert room.estimated_from is opened.room
    (cast,) = casts_of(job_of(opened, SIZE, WHOLE, room=opened.room))
    assert cast.image.alpha.min() == 1.0
    painter = RoomWorker(lambda: None)
    painter.request(RoomJob(room, cast.image, cast.walls))
    (done,) = take_until(painter.take, len)
    painter.close()
    assert done.room.is_solved
    (again,) = casts_of(job_of(opened, SIZE, WHOLE, room=done.room))
    np.testing.assert_allclose(done.image.coefficients, again.image.coefficients, atol=1e-6)
    # An estimate is near: by how much, tests of the room say.
    estimate = cast.walls.repaint(cast.image, room)
    change = np.abs(again.image.coefficients - cast.image.coefficients).max()
    left = np.abs(again.image.coefficients - estimate.coefficients).max()
    assert left < 0.1 * change


def test_the_four_walls_are_one_until_their_paints_differ(opened):
    assert edits.paintable(opened.room) == ("walls", "floor", "ceiling")
    assert edits.paint_codes(opened.room, "walls") == pytest.approx((0.797,) * 3, abs=2e-3)
    left = painted(opened, "left", "grey:0.1")
    assert edits.paintable(left.room)[:4] == ("left", "right", "front", "back")
    assert painted(left, "walls", "grey:0.3").room.spec.paint == {"walls": "grey:0.3"}
    assert edits.paint(opened, "walls", "no such paint").message
    assert edits.paint(opened, "panel", "grey:0.1").message
    white = edits.pick(opened, "walls", (1.0, 1.0, 1.0)).room  # no paint reflects everything
    assert white.spec.paint == {"walls": "#fefefe"}


def test_the_panel_shows_paints_as_the_picture_does(opened):
    white = painted(opened, "walls", "grey:0.9").room
    before, after = (edits.seen_XYZ(room, opened.lights) for room in (opened.room, white))
    assert (after[:, 1] > before[:, 1]).all()
    assert edits.seen_XYZ(opened.room, (replace(opened.lights[0], muted=True),)) is None


def test_undo_and_reset(opened):
    new = painted(opened, "walls", "#c04030")
    history = History(opened).then(new, 1).amend(edits.solve_radiosity(new))
    assert (history.difference.stage, history.difference.name) == ("relight", "paint")
    assert history.undo().present.room is opened.room
    assert history.undo().redo().present.room is history.present.room
    assert run_command(new, "reset-paints").state.room is opened.room


def test_a_saved_scene_opens_to_the_same_picture(opened, folder):
    new = painted(painted(opened, "walls", "#c04030"), "floor", "grey:0.2")
    new = light_parts.draw(new, 1, 0, (0.2, 2.0), (0.4, 0.0))
    new = lights.set_weight(new, 1, 0.4)  # a mix of both
    new = replace(new, view=replace(new.view, azimuth_deg=-40.0))
    file = scene_from_state(new)
    assert file.room.paint == {"walls": "#c04030", "floor": "grey:0.2"}
    assert not file.group
    assert file.viewing == new.document.saved()[0].viewing
    assert [light.illuminance_lux for light in file.light] == [None] * len(file.light)
    again = replace(read_scene(export_scene(new, folder / "saved.toml")), size=SIZE)
    assert np.abs(frame(again) - frame(new)).max() <= 1
    assert again.lights[1].texts == new.lights[0].texts


def test_a_session_keeps_paints(opened, folder):
    new = edits.solve_radiosity(painted(opened, "ceiling", "ColorChecker/blue"))
    again = restored(new, folder)
    assert again.room.spec.paint == {"ceiling": "ColorChecker/blue"}
    assert again.document.room.spec.paint == {}
    assert np.abs(frame(again) - frame(new)).max() <= 1
    assert again.lights[0].texts == (ROOM_LIGHT, ROOM_LIGHT)


@pytest.mark.slow
def test_what_a_room_cannot_do(opened, state):
    assert not edits.has_walls(state)
    # Light sources are the room's.
    for change in (run_command(opened, "shadows"), lighting.add_source(opened, "sky")):
        assert change.state.shading.groups != opened.shading.groups
        kept = edits.with_room_light(opened, change.state).state
        assert kept.shading == opened.shading
        assert kept.lights == opened.lights
    glossy = quality.set_cast(opened, "specular", 0.4)
    assert edits.with_room_light(opened, glossy).state is glossy
    # A basis of materials has no channels for walls: the volume is shown in the room's light.
    exact = replace(opened, transfer=with_material_basis(opened.transfer))
    assert not edits.has_walls(exact)
    assert not scene_from_state(exact).room.walls
    assert frame(exact).std() > 1


@pytest.mark.slow
def test_walls_are_painted_in_the_window_without_a_cast(window, tmp_path):
    window.open(write_scene(tmp_path) / "scene.toml")
    window.click("paint walls")
    before = window.rest()
    places = [window.at("paint picker", *place) for place in ((0.1, 0.1), (0.4, 0.3), (0.7, 0.4))]
    window.steps(places, "relight")
    # The last picture is whole: the room was solved.
    assert window.since(before, "relight")[-1]["whole"]
    assert window.since(before, "cast", "error") == []
    window.click("paint name")
    window.keys("ctrl+a")
    window.enter("grey:0.5")
    window.keys("Escape", "Escape", "ctrl+s", "Return")
    saved = Path(window.event("export-scene", before)["path"])
    text = saved.read_text(encoding="utf-8")
    assert saved.parent == tmp_path
    assert 'walls = "grey:0.5"' in text and "Y_b" not in text
