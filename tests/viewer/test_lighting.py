"""Light sources in the picture: their light, groups and spectra, directions, handles; quality."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.viewer import (
    assert_same_picture,
    assert_same_tables,
    opened,
    read_scene,
    run_command,
)
from tests.support.window import small_engine
from tests.viewer._edits import drawn
from volspec.camera.projection import Projection
from volspec.raycast import Ambient, Directional, LightGroup, Point, RaycastSpec, Spot
from volspec.raycast.lights import as_tuple
from volspec.spectra import light
from volspec.viewer.model import lighting, lighting_aim, lights, measure, quality
from volspec.viewer.model.cuts import CutHandle
from volspec.viewer.model.light_rows import Rows, light_rig
from volspec.viewer.model.lighting_aim import list_sources
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import lighting as lighting_panel
from volspec.viewer.ui import quality as quality_panel
from volspec.viewer.ui.form import FormField

KINDS = pytest.mark.parametrize("kind", ["directional light", "point light", "spot"])
WITH_CAMERA = pytest.mark.parametrize("camera", [False, True])
AREA = (10, 20, 400, 300)


def added(state: ViewState, *kinds: str) -> ViewState:
    for kind in kinds:
        state = lighting.add_source(state, kind).state
    return state


def groups_of(rows: Rows) -> list[tuple[str, ...]]:
    return [row.rig.groups for row in rows]


def with_lamp(state: ViewState, kind: str, camera: bool = False) -> ViewState:
    """Return the state with a lamp, perhaps one that moves with the camera, as source 2."""
    state = added(state, kind)
    return lighting.toggle_frame(state, 2) if camera else state


def projection(state: ViewState) -> Projection:
    return Projection(state.view.camera(state.document.volume), AREA)


def handle_of(state: ViewState) -> CutHandle:
    """Return the handle of the only lamp."""
    (handle,) = lighting_aim.list_handles(state, projection(state))
    return handle


def test_a_source_that_is_added_or_removed_leaves_the_exposure(state):
    def exposure() -> float:
        return sum(state.shading.strengths().values())

    before = exposure()
    for kind in lighting.KINDS:
        state = added(state, kind)
        assert state.shading.groups[-1].name == kind
        assert lighting.chosen_source(state) == len(list_sources(state.shading)) - 1
        assert exposure() == pytest.approx(before, rel=5e-3)  # intensities have 3 digits
    while len(list_sources(state.shading)) > 1:
        state = lighting.remove_source(state, 0).state
        assert exposure() == pytest.approx(before, rel=2e-2)


def test_lights_follow_the_groups(tmp_path):
    """A row without groups lights all; one with groups gets a spectrum for a new group."""
    state = opened(tmp_path)
    both = added(state, "directional light", "sky")
    assert groups_of(both.lights) == groups_of(state.lights)
    own = lighting.set_spectrum(both, 1, "tungsten").state
    row = own.lights[0]
    assert row.rig.groups == ("light", "directional light", "sky")
    assert row.texts == ("D65", "A", "D65") and row.name == "day"  # the scene's name stays
    plain = lights.add(both, "sodium").state
    for name, title in (("tungsten", "HP1 + A"), ("FL2", "HP1 + FL2")):
        plain = lighting.set_spectrum(plain, 1, name).state
        assert plain.lights[-1].name == title
    assert [lighting.group_text(own, g) for g in range(3)] == ["D65", "A", "D65"]
    assert np.array_equal(lighting.group_spectrum(own, 1).values, light("A").values)
    compared = run_command(own, "compare").state
    for changed, names in (
        (lighting.rename_group(compared, 1, "lamp").state, ("light", "lamp", "sky")),
        (lighting.rename_group(compared, 1, "light").state, ("light", "light (2)", "sky")),
        (lighting.remove_source(compared, 2).state, ("light", "sky")),
        (added(compared, "point light"), (*row.rig.groups, "point light")),
    ):
        assert tuple(group.name for group in changed.shading.groups) == names
        for rows in (changed.lights, changed.other):
            assert rows[0].rig.groups == names
            assert groups_of(rows[1:]) == groups_of(state.lights[1:])


def test_a_light_whose_only_group_is_removed_shines_from_the_others(state):
    state = lighting.set_spectrum(added(state, "sky"), 1, "FL2").state
    state = run_command(state, "keep-mix").state
    only_sky = replace(state.lights[0], rig=replace(state.lights[0].rig, weights=(0.0, 1.0)))
    state = replace(state, lights=(only_sky,))
    new = lighting.remove_source(state, 2).state
    assert new.lights[0].texts == ("FL2",) and new.lights[0].rig.groups == ("",)


def test_sources_move_between_groups(state):
    apart = lighting.move_source(state, 1, 1).state
    assert [group.name for group in apart.shading.groups] == ["light", "headlight"]
    assert lighting.chosen_source(apart) == 1
    joined = lighting.move_source(apart, 0, 1).state
    assert [len(group.sources) for group in joined.shading.groups] == [2]
    assert lighting.move_source(joined, 5, 0).state is joined


@pytest.mark.not_quick
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(drawn(("sky", "point light", "FL2", "a name", "draft"), lighting), max_size=8))
def test_lights_fit_the_groups_whatever_is_edited(state, edits):
    state = added(state, "directional light", "point light")
    for each in edits:
        state = each(state)
        shares = state.shading.shares()
        for row in state.lights:
            assert row.rig.facing(shares).total_lux is None  # raises for a group that is gone
    assert light_rig(state.lights) is not None


def test_shadows_and_occlusion_are_one_command_each(state):
    def blocked(state: ViewState) -> list[bool]:
        return [lighting.is_blocked(each.source) for each in list_sources(state.shading)]

    lit = run_command(state, "shadows").state
    assert isinstance(list_sources(lit.shading)[-1].source, Directional)
    off = run_command(lit, "shadows").state
    assert not any(blocked(off))
    assert blocked(run_command(off, "occlusion").state) == [True, False, False]


@KINDS
@WITH_CAMERA
def test_lamps_are_aimed_by_two_angles(state, kind, camera):
    far = lighting.set_distance(with_lamp(state, kind, camera), 2, 20.0)
    for azimuth, elevation in [(0, 0), (30, 40), (-120, -70), (180, 10), (90, 90)]:
        new = lighting.aim(far, 2, azimuth, elevation)
        source = list_sources(new.shading)[2].source
        angles = lighting_aim.angles_deg(new, source)
        assert angles[1] == pytest.approx(elevation, abs=1e-6)
        if elevation < 90:
            assert math.remainder(angles[0] - azimuth, 360) == pytest.approx(0, abs=1e-6)
        if isinstance(source, Point):
            assert lighting_aim.distance_mm(new, source) == pytest.approx(20)


def test_a_lamp_at_the_cameras_angles_shines_like_a_headlight(state):
    state = replace(state, view=replace(state.view, azimuth_deg=50, elevation_deg=-20))
    new = lighting.aim(added(state, "directional light"), 2, 50, -20)
    source = list_sources(new.shading)[2].source
    assert lighting_aim.camera_axes(new)[2] == pytest.approx(source.towards, abs=1e-9)


@KINDS
def test_another_frame_moves_nothing_until_the_camera_moves(state, kind):
    state = with_lamp(state, kind)
    with_camera = lighting.toggle_frame(state, 2)
    place = pytest.approx(handle_of(state).place, abs=1e-6)
    turned = replace(with_camera, view=replace(with_camera.view, azimuth_deg=77))
    for each in (with_camera, lighting.toggle_frame(with_camera, 2), turned):
        assert handle_of(each).place == place


@KINDS
@WITH_CAMERA
@pytest.mark.parametrize("place", [(210.0, 170.0), (230.0, 140.0), (120.0, 200.0), (200.0, 290.0)])
def test_a_handle_follows_the_mouse(state, kind, camera, place):
    state = with_lamp(state, kind, camera)
    shown = projection(state)
    new = lighting.drag_handle(state, state, handle_of(state), place, shown)
    assert handle_of(new).place == pytest.approx(place, abs=1e-6)
    # Beyond the ring a directional light shines from behind.
    centre, radius = lighting_aim.ring(shown)
    if kind == "directional light":
        source = list_sources(new.shading)[2].source
        assert lighting_aim.is_behind(new, source) == (math.dist(place, centre) > radius)


@pytest.mark.parametrize("zoom", [0.3, 1.0, 8.0])
@pytest.mark.parametrize("orthographic", [False, True])
def test_handles_stay_in_the_picture_until_they_are_hidden(state, zoom, orthographic):
    view = replace(state.view, zoom=zoom, orthographic=orthographic)
    state = added(replace(state, view=view), "point light")
    aside = lighting.aim(state, 2, view.azimuth_deg + 90, 0)
    for each in (state, lighting.set_distance(aside, 2, 60.0)):
        left, top = np.subtract(handle_of(each).place, AREA[:2])
        assert 0 < left < AREA[2] and 0 < top < AREA[3]
    # A new one is seen where it is.
    assert handle_of(state).place == handle_of(state).anchor
    hidden = run_command(state, "lights").state
    assert not lighting_aim.list_handles(hidden, projection(hidden))


@pytest.mark.slow
def test_sources_and_quality_are_saved_in_scenes(tmp_path):
    state = added(opened(tmp_path), "directional light", "point light", "sky")
    state = lighting.set_spectrum(state, 1, "A").state
    state = lighting.set_source(state, "falloff_mm", 30.0, 3)
    state = lighting.set_source(lighting.toggle_frame(state, 2), "radius_mm", 5.0, 4)
    for name, value in (("specular", 0.5), ("shininess", 60), ("jitter", 0.4)):
        state = quality.set_cast(quality.set_step(state, 0.3), name, value)
    again = assert_same_picture(state, tmp_path).shading
    assert [group.name for group in again.groups] == [g.name for g in state.shading.groups]
    assert again.jitter == 0.4 and again.shininess == 60


def test_projections_leave_out_what_they_cannot(state):
    fine = quality.toggle_preintegration(state).state
    assert fine.shading.preintegrated
    mip, _, hint = run_command(fine, "projection-maximum")
    assert hint and quality.wants_greys(mip)
    grey = run_command(run_command(fine, "preset-grey").state, "projection-maximum")
    assert not grey.hint and not quality.wants_greys(grey.state)
    assert mip.shading.mode == "maximum" and not mip.shading.preintegrated
    back = quality.toggle_preintegration(mip).state
    assert back.shading.mode == "composite" and back.shading.preintegrated


@pytest.mark.parametrize("kind", ["points", "gradients", "regions", "labels", "surfaces"])
def test_settings_that_a_transfer_function_forbids_wait(tmp_path, kind):
    state = opened(tmp_path, kind)
    state = replace(state, shading=replace(state.shading, preintegrated=True, adaptive=0.02))
    assert_same_tables(read_scene(export_scene(state, tmp_path / "again.toml")), state)
    shown = quality.cast_spec(state)
    assert (shown.preintegrated, shown.adaptive > 0) == (kind == "points", kind != "surfaces")


def test_steps_are_counted_in_voxels(state):
    assert quality.step_voxels(state) == 0.5 and quality.quality_name(state) == "balanced"
    assert quality.quality_name(quality.set_step(state, 0.5)) == ""
    assert quality.set_step(state, 0.25).shading.step_mm == 0.25
    for name in quality.QUALITIES:
        assert quality.quality_name(quality.set_quality(state, name)) == name


def test_every_setting_of_a_cast_can_be_edited():
    """All but the device's, layers, and those that have a panel of their own."""
    others = {"groups", "crop_voxels", "clip_planes", "tile_ms", "layers", "opacities"}
    others |= {"add_fields", "mode", "step_mm", "preintegrated", "quality", "level"}
    panels = (*vars(quality_panel).values(), *vars(lighting_panel).values())
    shown = {
        each.name for value in panels for each in as_tuple(value) if isinstance(each, FormField)
    }
    assert set(RaycastSpec.__dataclass_fields__) - others <= shown | {"physical_light"}
    sources = {field for kind in (Ambient, Directional, Point) for field in kind.__slots__}
    changes = "radius_mm occlusion shadows towards position_mm falloff_mm frame intensity"
    assert sources == set(changes.split())
    assert set(LightGroup.__slots__) == {"name", "sources"}


@pytest.mark.slow
def test_a_lamp_is_added_and_aimed_with_mouse_and_keys(window, tmp_path):
    before = window.open(small_engine(tmp_path))
    window.command("shadow")
    assert window.since(before, "cast")
    x, y = window.middle("light 2")
    window.drag([(x, y), (x + 10, y + 5), (x + 30, y + 12), (x + 60, y + 20)])
    after = window.rest()
    assert window.middle("light 2") == pytest.approx((x + 60, y + 20), abs=3)
    window.keys("ctrl+z")
    assert window.middle("light 2") == pytest.approx((x, y), abs=3)
    assert window.since(after, "cast")
    window.front("lighting")
    window.click("remove source 2")
    window.rest()
    assert window.since(-1.0, "error") == []


def test_the_mouse_carries_a_flashlight(tmp_path):
    """Its target is seen under the mouse, whether it moves with the camera or not."""
    state, place = opened(tmp_path), (40.0, 90.0)
    carried = lighting.toggle_flashlight(state).state
    assert carried.interface.tool == lighting.FLASHLIGHT
    window = projection(carried)
    carried = lighting.carry(carried, place, window)
    index = lighting.chosen_source(carried)
    torch = list_sources(carried.shading)[index].source
    assert isinstance(torch, Spot) and torch.frame == "camera"
    still = lighting.toggle_frame(carried, index)
    target = list_sources(still.shading)[index].source.target_mm
    assert window.to_window(np.asarray(target))[:2] == pytest.approx(place, abs=1e-3)
    back = list_sources(lighting.toggle_frame(still, index).shading)[index].source
    assert back.target_mm == pytest.approx(torch.target_mm, rel=1e-9)
    assert back.position_mm == pytest.approx(torch.position_mm, rel=1e-9)
    assert lighting.carry(still, place, window) is still  # it lies
    assert lighting.toggle_flashlight(carried).state.interface.tool == ""
    assert "carries the flashlight" in measure.hint(carried)
