"""A state written as a scene's file is the same picture when it is opened."""

from dataclasses import astuple, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.viewer import (
    SCENES,
    assert_same_picture,
    assert_same_tables,
    opened,
    read_scene,
    run_command,
)
from tests.viewer._states import frame_of, restored, under
from volspec.basis import SpectralBasis
from volspec.errors import InputError, SceneError
from volspec.raycast import ClipPlane, Directional, LightGroup, Point
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene
from volspec.spectra import Spectrum, light
from volspec.viewer.model import camera, depth, fields, light_rows, lights, transfer_edits
from volspec.viewer.model.scene_file import (
    export_python,
    export_scene,
    left_out,
    scene_from_state,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts
from volspec.viewer.work.session import (
    SUFFIX,
    SessionError,
    read_session,
    restore_state,
    save_session,
)
from volspec.volume import phantom


@pytest.fixture
def state(tmp_path: Path) -> ViewState:
    """A small scene on disk."""
    return opened(tmp_path)


@pytest.mark.parametrize("kind", SCENES)
def test_every_kind_of_transfer_function_comes_back(tmp_path, kind):
    state = opened(tmp_path, kind)
    # The tables are made again, not taken from the file.
    other = replace(state, transfer=replace(state.transfer))
    assert scene_from_state(other).transfer == scene_from_state(state).transfer
    assert_same_tables(read_scene(export_scene(other, tmp_path / "again.toml")), other)


@pytest.mark.parametrize(("span", "offset"), [(1e-40, 0.0), (1e-9, 0.0), (1.0, 1e6), (1e30, 0.0)])
def test_points_move_and_come_back_at_any_range_of_values(tmp_path, span, offset):
    """Also in a volume far from the origin: nothing is rounded to a number of digits."""
    np.save(tmp_path / "ball.npy", phantom.ball(16).values * np.float32(span) + np.float32(offset))
    scene = Scene.from_volume(tmp_path / "ball.npy")
    state = read_scene(scene.save(tmp_path / "ball.toml"))
    low, high = state.document.volume.range
    assert state.document.data[""].joint.counts[:, 1:].any()
    opaque = (low + high) / 2 + 0.0123456789 * (high - low)
    moved = transfer_edits.set_limits(state, low + 0.1 * (high - low), opaque)
    moved = transfer_edits.move_point(moved, 1, low + 0.12 * (high - low), 0.3)
    target = 1e9 + np.array(state.document.volume.corners_mm.mean(axis=0)) / 3
    moved = replace(moved, view=replace(moved.view, target_mm=tuple(target.tolist())))
    again = read_scene(export_scene(moved, tmp_path / "again.toml"))
    assert again.transfer.points == moved.transfer.points != state.transfer.points
    assert list_parts(moved.transfer)[1].values == (low + 0.12 * (high - low),)
    assert again.view.target_mm == moved.view.target_mm
    saved = read_session(save_session(moved, tmp_path / f"moved{SUFFIX}"))
    assert restore_state(saved, cast=False).transfer.points == moved.transfer.points


@pytest.mark.not_quick
def test_what_mouse_and_sliders_change_comes_back(state, tmp_path):
    state = camera.zoom(camera.pan(camera.orbit(state, 0.2, 0.1), 0.05, 0.02), 0.0, -0.1)
    state = transfer_edits.move_point(transfer_edits.shift(state, 0.05), 1, 0.8, 0.7)
    state = lights.set_weight(lights.set_weight(state, 0, 0.6), 1, 0.9)
    again = assert_same_picture(state, tmp_path)
    assert [row.name for row in again.lights] == ["mix", "day", "tungsten"]
    for one, other in zip(astuple(again.view), astuple(state.view), strict=True):
        assert one == pytest.approx(other, rel=1e-6)


@pytest.mark.slow
def test_cuts_groups_and_their_lights_come_back(state, tmp_path):
    key = LightGroup("key", (Directional((1, 1, 1), frame="camera", shadows=True),))
    fill = LightGroup("fill", (Point((0, 0, 30), falloff_mm=20.0),))
    shading = replace(
        state.shading,
        groups=(key, fill),
        crop_voxels=((1, 11), (0, 11), (2, 11)),
        clip_planes=(ClipPlane((6, 6, 6), (0, 1, 0)),),
        preintegrated=True,
    )
    rig = LightRig((light("A"), light("D65")), (0.5, 1.0), groups=("key", "fill"))
    rows = (
        light_rows.LightRow("two", "warm key", rig, 1.0),
        light_rows.LightRow("D50", "D50", LightRig((light("D50"),)), 0.5),
    )
    again = assert_same_picture(replace(state, shading=shading, lights=rows), tmp_path)
    assert again.shading == replace(shading, tile_ms=again.shading.tile_ms)
    # Both rows shine from the same groups: they are one light from each group in the file.
    assert again.lights[0].rig.groups == ("key", "fill", "")


@pytest.mark.not_quick
def test_edited_spectra_come_back_as_numbers(state, tmp_path):
    nm = state.document.grid.wavelengths_nm
    ramp = Spectrum(nm, np.linspace(0.0, 5.0, nm.size), "edited", {"designed": "yes"})
    blue = Spectrum(nm, np.linspace(0.9, 0.1, nm.size), "blue")
    materials = {**state.transfer.materials, "copper": blue}
    basis = state.transfer.basis.with_samples(materials.values())
    transfer = replace(state.transfer, materials=materials, basis=basis)
    drawn = light_rows.LightRow("edited", "mine", LightRig((ramp,)), 0.0)
    state = replace(state, transfer=transfer, lights=(*state.lights, drawn))
    again = assert_same_picture(under(state, 2), tmp_path)
    assert again.lights[0].name == "edited" and again.lights[0].label == "mine"
    text = (tmp_path / "again.toml").read_text(encoding="utf-8")
    assert 'reflectance = "grey:0.5"' in text and "# A remark" in text


@pytest.mark.not_quick
def test_lux_stay_with_their_lights(state, tmp_path):
    rows = tuple(
        light_rows.LightRow(name, name, LightRig((light(name),), illuminance_lux=(lux,)), 0.7)
        for name, lux in (("D65", 300.0), ("A", 40.0))
    )
    seen = replace(state.relight, level="absolute")
    again = assert_same_picture(replace(state, lights=rows, relight=seen), tmp_path)
    assert light_rows.light_rig(again.lights).total_lux == pytest.approx(0.7 * 340.0)


@pytest.mark.not_quick
@pytest.mark.slow
def test_a_basis_that_a_scene_trains_is_kept_if_lights_would_change_it(tmp_path):
    state = opened(tmp_path, basis='train = "scene"\nsize = 4')
    assert_same_picture(state, tmp_path)
    assert not (tmp_path / "again.basis.json").exists()
    assert_same_picture(lights.add(state, "HP1").state, tmp_path)
    assert (tmp_path / "again.basis.json").exists()


@pytest.mark.not_quick
def test_materials_as_channels_and_another_folder(tmp_path):
    state = opened(tmp_path, basis='method = "materials"')
    (tmp_path / "there").mkdir()
    again = assert_same_picture(camera.orbit(state, 0.1, 0.0), tmp_path / "there")
    assert Path(again.document.file.volume.file).parent == Path("..")


def dark(state: ViewState) -> ViewState:
    return replace(state, lights=tuple(replace(row, weight=0.0) for row in state.lights))


def backdrop(state: ViewState) -> ViewState:
    return replace(state, relight=RelightSpec(backdrop=Spectrum([400, 700], [0.1, 0.2])))


def of_image(state: ViewState) -> ViewState:
    return replace(state, document=replace(state.document, image=cast(Any, object())))


def nameless(state: ViewState) -> ViewState:
    return replace(state, document=replace(state.document, path=None, file=None))


@pytest.mark.parametrize(
    ("kind", "expected", "write"),
    [
        (SceneError, "missing", lambda s: scene_from_state(nameless(s))),
        (SceneError, "unsupported", lambda s: scene_from_state(of_image(s))),
        (SceneError, "unsupported viewing.backdrop", lambda s: scene_from_state(backdrop(s))),
        (SceneError, "missing", lambda s: scene_from_state(dark(s))),  # it would open lit
        (InputError, "unsupported", lambda s: export_scene(s, "x.json")),
        (InputError, "unwritable", lambda s: export_scene(s, "/proc/nothing/x.toml")),
        (
            SceneError,
            "missing",
            lambda s: export_python(dark(s), s.document.path.with_suffix(".py")),
        ),
        (InputError, "unsupported", lambda s: export_python(s, "x.txt")),
        (SceneError, "missing", lambda s: save_session(nameless(s), f"x{SUFFIX}")),
        (SessionError, "unsupported", lambda s: save_session(s, "x.toml")),
    ],
)
def test_what_no_file_can_say_is_refused(state, tmp_path, kind, expected, write):
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    refuses(lambda: write(state), expected, kind)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.not_quick
def test_a_basis_of_another_scene_is_shown_by_its_name(state, tmp_path):
    other = replace(state.transfer, basis=SpectralBasis.load("general-7"))
    again = assert_same_picture(replace(state, transfer=other), tmp_path)
    assert again.document.file.basis.name == "general-7"


MASK = """
mask = "halves"
[[transfer.label]]
label = 1
points = [
    { value = 0.1, opacity = 0.0, material = "grey" },
    { value = 0.9, opacity = 0.7, material = "grey" },
]
[[transfer.label]]
label = 2
shown = false
[[field]]
name = "halves"
file = "halves.npy"
"""


@pytest.mark.not_quick
@pytest.mark.slow
def test_masks_stay_through_edits_of_other_things(tmp_path):
    path = opened(tmp_path).document.path
    halves = np.zeros((12, 12, 12), np.uint8)
    halves[:, :6], halves[:, 6:, :6] = 1, 2
    np.save(tmp_path / "halves.npy", halves)
    path.write_text(path.read_text().replace("[basis]", MASK + "[basis]", 1))
    state = read_scene(path)
    before = fields.shown_transfer(state).masks[""]
    edited = transfer_edits.move_point(state, 1, 0.8, 0.7)
    edited = camera.orbit(fields.set_look(edited, "weight", 0.5, 0), 0.2, 0.1)
    again = assert_same_picture(edited, tmp_path)
    after = fields.shown_transfer(again).masks[""]
    assert again.fields[0].weight == 0.5
    assert after.field == before.field == "halves" and list(after.functions) == [1, 2]
    assert after.functions[1].points == before.functions[1].points
    # A material that the mask alone uses stays when the transfer function no longer has it.
    bare = replace(state.transfer, points=[(0.2, 0.0, "copper"), (0.9, 0.4, "copper")])
    fewer = replace(bare, materials={"copper": bare.materials["copper"]})
    kept, why, _ = fields.with_all_fields(state, replace(state, transfer=fewer))
    assert not why and set(kept.transfer.materials) == {"copper", "grey"}


@pytest.mark.parametrize(
    ("command", "lost"),
    [
        ("projection-maximum", "cut by distance, focus"),
        ("preintegration", "cut by distance, focus"),
        ("transfer-surfaces", "cut by distance, focus"),
        ("projection", "focus"),
    ],
)
def test_effects_that_a_picture_cannot_have_wait(state, tmp_path, command, lost):
    least, most = depth.limits_mm(state)
    middle = (least + most) / 2
    own = depth.set_focus(depth.set_cut(replace(state, size=(48, 36)), middle, most), least)
    layered = read_scene(export_scene(own, tmp_path / "layered.toml"))
    own = replace(own, document=layered.document, shading=layered.shading)
    changed = run_command(own, command).state
    assert (depth.left_out(own), depth.left_out(changed)) == ("", lost)
    again = read_scene(export_scene(changed, tmp_path / "again.toml"))
    shown = frame_of(changed)
    assert np.abs(frame_of(again, changed.size) - shown).max() <= 1
    assert np.abs(frame_of(own) - shown).max() > 1
    assert depth.left_out(again) == ""
    both = replace(again, other=under(again, 1).lights)
    assert left_out(both) == f"{both.lights[1].name} right of the divide"
    kept = restored(changed, tmp_path)
    assert kept.depth == own.depth
    if command != "transfer-surfaces":
        back = run_command(kept, command.replace("maximum", "composite")).state
        assert back.shading == own.shading and depth.focused_depth(back) == own.depth
