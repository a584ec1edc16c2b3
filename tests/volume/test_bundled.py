"""Bundled volumes: found by name, in Python and in scenes, wherever the scene is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from tests.support.errors import raises
from volspec._gpu.sources import asset
from volspec.errors import VolumeError
from volspec.scene import Scene, write_scene
from volspec.volume import load_volume


@pytest.mark.parametrize(
    ("name", "shape"),
    [("engine", (256, 256, 110)), ("head", (256, 256, 109)), ("frog", (500, 470, 136))],
)
def test_a_name_is_enough(
    name: str, shape: tuple[int, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert load_volume(name).shape_xyz == shape


def test_a_file_of_that_name_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("engine").write_bytes(b"")
    with raises(VolumeError, "damaged"):
        load_volume("engine")


def test_a_scene_of_a_bundled_volume_is_saved_anywhere(tmp_path: Path) -> None:
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume = replace(scene.file.volume, file="engine")
    saved = write_scene(replace(scene.file, volume=volume), tmp_path / "mine.toml", scene)
    loaded = Scene.load(saved)
    assert loaded.file.volume.file == "engine"
    assert loaded.volume().shape_xyz == (256, 256, 110)
