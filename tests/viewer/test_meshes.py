"""Meshes in the viewer: the list's edits, files, sessions, and meshes dropped on the window."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import pyvista

from tests.support.gltf import write_glb
from tests.support.viewer import read_scene
from tests.viewer._states import frame_of, restored, save_ball
from volspec.errors import VolspecWarning
from volspec.scene.meshes import MeshCache
from volspec.scene.tables.specs import MeshSpec
from volspec.viewer.model import materials, meshes
from volspec.viewer.model.history import History
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.documents import read_meshes

pytestmark = pytest.mark.not_quick

SCENE = """
version = 2
volume.file = "ball.npy"
basis.name = "general-5"
material = [
    { name = "bone", reflectance = "grey:0.7" },
    { name = "wax", reflectance = "ColorChecker/red" },
]
light = [{ name = "day", spectrum = "D65" }]
transfer.points = [
    { value = 0.2, opacity = 0.0, material = "bone" },
    { value = 0.9, opacity = 0.4, material = "bone" },
]
[[mesh]]
file = "parts/pin.stl"  # it is in front
material = "wax"
move_mm = [5.5, 0, 5.5]
[[mesh]]
shape = "triad"
"""


@pytest.fixture
def opened(tmp_path: Path) -> ViewState:
    return read(write_scene(tmp_path))


def write_scene(folder: Path) -> Path:
    save_ball(folder, 12)
    (folder / "parts").mkdir()
    pyvista.Cube(x_length=6, y_length=2, z_length=9).save(folder / "parts" / "pin.stl")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    return folder / "scene.toml"


def read(path: Path) -> ViewState:
    return replace(read_scene(path), size=(48, 36))


@pytest.mark.slow
def test_edits_change_the_picture_and_are_undone(opened):
    first = frame_of(opened)
    edits = (
        meshes.set_mesh(opened, "shown", False, 0),
        meshes.set_material(opened, 0, "bone"),
        meshes.set_mesh(opened, "opacity", 0.3, 0),
        meshes.remove(opened, 0),
        meshes.set_mesh(opened, "move_mm", (5.5, 0.0, 8.0), 0),
        meshes.set_mesh(opened, "turn_deg", (0.0, 90.0, 0.0), 0),
        meshes.set_mesh(opened, "unit_mm", 1.5, 0),
    )
    pictures = [*map(frame_of, edits)]
    assert all(np.abs(picture - first).max() > 20 for picture in pictures)
    np.testing.assert_array_equal(pictures[0], pictures[3])  # a hidden mesh casts no shadow
    history = History(opened).then(edits[2], 1)
    assert (history.difference.stage, history.difference.name) == ("cast", "meshes")
    np.testing.assert_array_equal(frame_of(history.undo().present), first)


@pytest.mark.slow
def test_the_file_is_read_once(opened, tmp_path):
    (tmp_path / "parts" / "pin.stl").unlink()
    hidden = meshes.set_mesh(opened, "shown", False, 0)
    frame_of(hidden)
    again = meshes.set_mesh(hidden, "shown", True, 0)
    np.testing.assert_array_equal(frame_of(again), frame_of(opened))
    assert np.abs(frame_of(meshes.set_material(opened, 0, "bone")) - frame_of(opened)).max() > 20


@pytest.mark.slow
def test_other_looks_use_what_is_known_of_a_surface(opened):
    """Pictures are those of a scene that begins with them."""
    placed = meshes.set_mesh(opened, "turn_deg", (0.0, 0.0, 400.0), 1)
    for change in (
        meshes.set_mesh(opened, "opacity", 0.5, 0),
        meshes.set_mesh(opened, "opacity", 0.4, 0),
        meshes.set_material(opened, 0, "bone"),
        meshes.set_mesh(opened, "shown", False, 1),
        meshes.set_mesh(meshes.set_mesh(placed, "move_mm", (5.0, 0.0, 0.0), 1), "size_mm", 4.0, 1),
        opened,
    ):
        cache = MeshCache(Path(opened.document.folder))
        fresh = replace(change, document=replace(opened.document, meshes=cache))
        np.testing.assert_array_equal(frame_of(change), frame_of(fresh))


@pytest.mark.slow
def test_a_saved_scene_and_a_session_keep_the_list(opened, tmp_path):
    new = meshes.set_mesh(opened, "opacity", np.float32(0.3).item(), 0)
    new = meshes.set_mesh(new, "shown", False, 1)
    path = export_scene(new, tmp_path / "sub.toml")
    text = path.read_text(encoding="utf-8")
    for line in ('file = "parts/pin.stl"  # it is in front', "opacity = 0.3\n", "shown = false"):
        assert line in text
    (tmp_path / "other").mkdir()
    again = read(export_scene(new, tmp_path / "other" / "it.toml"))
    assert again.meshes[0].file == "../parts/pin.stl"
    session = restored(new, tmp_path)
    assert session.meshes == new.meshes
    for state in (read(path), again, session):
        assert np.abs(frame_of(state) - frame_of(new)).max() <= 1
    # Without an edit, the file's own words stay.
    whole = export_scene(opened, tmp_path / "same.toml").read_text(encoding="utf-8")
    assert "move_mm = [5.5, 0, 5.5]" in whole


@pytest.mark.slow
def test_a_material_replaces_a_texture(opened):
    textured = MeshSpec(shape="disc", texture="maps/wood.png", materials=("bone", "wax"))
    state = replace(opened, meshes=(textured, MeshSpec(shape="triad")))
    assert [meshes.look_text(row) for row in state.meshes] == ["wood.png", "axes"]
    new = meshes.set_material(meshes.set_material(state, 0, "wax"), 1, "bone")
    waxen, bony = MeshSpec(shape="disc", material="wax"), MeshSpec(shape="triad", material="bone")
    assert new.meshes == (waxen, bony)
    assert meshes.set_material(state, 0, "no such") is state


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_meshes_are_added_from_files(opened, tmp_path):
    write_glb(tmp_path / "tile.glb", 8.0)
    for name in ("empty.ply", "noise.obj", "noise.glb"):
        (tmp_path / name).write_text("no mesh" * name.startswith("noise"), encoding="utf-8")
    names = ("tile.glb", "empty.ply", "noise.obj", "noise.glb", "gone.stl")
    read = read_meshes(opened, tuple(str(tmp_path / name) for name in names))
    assert read.rows == (MeshSpec(file="tile.glb", material="wax", own_colours=True),)
    for name, error in zip(names[1:], read.errors, strict=True):
        assert error.startswith(str(tmp_path / name)) and "\n" not in error
    new = meshes.add(opened, read.rows)
    corners = new.document.meshes.mesh(new.meshes[2]).points_mm
    assert corners.min(axis=0) == pytest.approx([1.5, 1.5, 12.0])
    assert np.abs(frame_of(new) - frame_of(opened)).max() > 20
    write_glb(tmp_path / "metres.glb", 8000.0)
    with pytest.warns(VolspecWarning, match="unit_mm"):
        assert read_meshes(opened, (str(tmp_path / "metres.glb"),)).rows


@pytest.mark.slow
def test_meshes_are_added_in_their_own_colours(opened, tmp_path):
    tile = pyvista.Plane(center=(4, 4, 12), i_size=5, j_size=5, i_resolution=1, j_resolution=1)
    tile.point_data["RGB"] = np.array([[250, 20, 20]] * 4, np.uint8)
    tile.save(tmp_path / "tile.ply", texture="RGB")
    read = read_meshes(opened, (str(tmp_path / "tile.ply"),))
    assert read.rows == (MeshSpec(file="tile.ply", material="wax", own_colours=True),)
    new = meshes.add(opened, read.rows)
    assert meshes.look_text(new.meshes[2]) == "own colours"
    waxen = meshes.set_material(new, 2, "wax")
    assert waxen.meshes[2] == MeshSpec(file="tile.ply", material="wax")
    assert np.abs(frame_of(new) - frame_of(waxen)).max() > 20
    assert np.array_equal(frame_of(meshes.remove(waxen, 2)), frame_of(opened))


@pytest.mark.slow
def test_other_transfer_functions_keep_the_meshes_materials(opened):
    assert materials.remove_material(opened, "wax") is opened
    bare = materials.without_material(opened.transfer, "wax")
    new = meshes.with_own_materials(opened, replace(opened, transfer=bare)).state
    assert list(new.transfer.materials) == ["bone", "wax"]
    np.testing.assert_array_equal(frame_of(new), frame_of(opened))
    free = meshes.remove(opened, 0)
    assert list(materials.remove_material(free, "wax").transfer.materials) == ["bone"]


@pytest.mark.slow
def test_the_list_in_the_window(window, tmp_path):
    scene = write_scene(tmp_path)
    write_glb(tmp_path / "tile.glb", 8.0)
    write_glb(tmp_path / "metres.glb", 8000.0)
    (tmp_path / "broken.stl").write_bytes(b"solid")
    window.resize((1000, 700))
    before = window.open(scene)
    window.drop(*((tmp_path / name).as_uri() for name in ("broken.stl", "metres.glb")))
    window.rest()
    told = [row["message"] for row in window.since(before, "error", "warning")]
    assert all(any(word in text for text in told) for word in ("broken.stl", "unit_mm"))
    before = window.keys("ctrl+z")
    window.drop((tmp_path / "tile.glb").as_uri())
    window.rest()
    assert window.since(before, "cast")
    window.click("mesh shown 1", "mesh material 2")
    window.keys("Down", "Up", "Return")
    window.steps([window.at("mesh opacity 0", share) for share in (0.98, 0.7, 0.5)], "cast")
    window.click("mesh name 2")
    window.rest()
    window.steps([window.at("mesh unit", share) for share in (0.25, 0.4, 0.5)], "cast")
    window.click("remove mesh 1")
    window.keys("ctrl+z", "ctrl+s", "Return")
    saved = Path(window.event("export-scene", before)["path"])
    assert saved == tmp_path / "scene-view.toml"
    pin, triad, tile = tomllib.loads(saved.read_text(encoding="utf-8"))["mesh"]
    assert 0.3 < pin["opacity"] < 0.9
    assert triad == {"shape": "triad", "shown": False}
    assert tile.pop("unit_mm") > 1.2
    assert tile == {"file": "tile.glb", "material": "bone"}
    window.click(*["remove mesh 0"] * 3)
    window.rest()
