"""Meshes in the viewer: the list's edits, files, sessions, and meshes dropped on the window."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
from numpy.typing import NDArray

from volspec.scene import Scene
from volspec.scene.specs import MeshSpec
from volspec.viewer.model import meshes
from volspec.viewer.model.document import Document
from volspec.viewer.model.history import History
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.casts import make_caster
from volspec.viewer.work.outputs import Progress
from volspec.viewer.work.screenshot import render_frame
from volspec.viewer.work.session import read_session, restore_state, save_session
from volspec.volume import phantom

SIZE = 48, 36
SCENE = """
[volume]
file = "ball.npy"
[[material]]
name = "bone"
reflectance = "grey:0.7"
[[material]]
name = "wax"
reflectance = "ColorChecker/red"
[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "bone" },
    { value = 0.9, opacity = 0.4, material = "bone" },
]
[basis]
name = "general-7"
[[mesh]]
file = "parts/pin.stl"  # it is in front
material = "wax"
move_mm = [5.5, 0, 5.5]
[[mesh]]
shape = "triad"
[[light]]
name = "day"
spectrum = "D65"
"""


@pytest.fixture
def opened(tmp_path: Path) -> ViewState:
    write_scene(tmp_path)
    return read(tmp_path / "scene.toml")


def write_scene(folder: Path) -> None:
    np.save(folder / "ball.npy", phantom.ball(12).values)
    (folder / "parts").mkdir()
    pyvista.Cube(x_length=6, y_length=2, z_length=9).save(folder / "parts" / "pin.stl")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")


def read(path: Path) -> ViewState:
    scene = Scene.load(path)
    volume = scene.volume()
    document = Document.of(scene, volume, *make_caster(volume, None))
    return replace(ViewState.first(document, SIZE), size=SIZE)


def frame(state: ViewState) -> NDArray[Any]:
    return render_frame(state, SIZE, Progress("picture")).astype(int)


def test_edits_change_the_picture_and_are_undone(opened: ViewState) -> None:
    first = frame(opened)
    edits = (
        meshes.set_shown(opened, 0, False),
        meshes.set_material(opened, 0, "bone"),
        meshes.set_opacity(opened, 0, 0.3),
        meshes.remove(opened, 0),
    )
    pictures = [frame(state) for state in edits]
    assert all(np.abs(picture - first).max() > 20 for picture in pictures)
    np.testing.assert_array_equal(pictures[0], pictures[3])  # a hidden mesh casts no shadow
    history = History(opened).then(edits[2], 1)
    assert history.difference is not None
    assert (history.difference.stage, history.difference.name) == ("cast", "meshes")
    np.testing.assert_array_equal(frame(history.undo().present), first)


def test_the_file_is_read_once(opened: ViewState, tmp_path: Path) -> None:
    (tmp_path / "parts" / "pin.stl").unlink()
    hidden = meshes.set_shown(opened, 0, False)
    assert np.abs(frame(meshes.set_shown(hidden, 0, True)) - frame(opened)).max() == 0
    assert np.abs(frame(meshes.set_material(opened, 0, "bone")) - frame(opened)).max() > 20


def test_a_saved_scene_and_a_session_keep_the_list(opened: ViewState, tmp_path: Path) -> None:
    new = meshes.set_shown(meshes.set_opacity(opened, 0, np.float32(0.3).item()), 1, False)
    path = export_scene(new, tmp_path / "sub.toml")
    text = path.read_text(encoding="utf-8")
    for line in ('file = "parts/pin.stl"  # it is in front', "opacity = 0.3\n", "shown = false"):
        assert line in text
    (tmp_path / "other").mkdir()
    again = read(export_scene(new, tmp_path / "other" / "it.toml"))
    assert again.meshes[0].file == "../parts/pin.stl"
    session = restore_state(read_session(save_session(new, tmp_path / "it.volspec.json")))
    assert session.meshes == new.meshes
    for state in (read(path), again, session):
        assert np.abs(frame(state) - frame(new)).max() <= 1
    # Without an edit, the file's own words stay.
    whole = export_scene(opened, tmp_path / "same.toml").read_text(encoding="utf-8")
    assert "move_mm = [5.5, 0, 5.5]" in whole


def test_a_material_replaces_a_texture(opened: ViewState) -> None:
    textured = MeshSpec(shape="disc", texture="maps/wood.png", materials=("bone", "wax"))
    state = replace(opened, meshes=(textured, MeshSpec(shape="triad")))
    assert [meshes.look_text(row) for row in state.meshes] == ["wood.png", "axes"]
    new = meshes.set_material(meshes.set_material(state, 0, "wax"), 1, "bone")
    assert new.meshes == tuple(
        MeshSpec(shape=row.shape, material=name)
        for row, name in zip(state.meshes, ("wax", "bone"), strict=True)
    )
    assert meshes.set_material(state, 0, "no such") is state
