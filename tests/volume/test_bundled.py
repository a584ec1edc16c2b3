"""Bundled volumes: found by name, in Python and in scenes, wherever the scene is."""

from dataclasses import replace

import pytest

from volspec._gpu.sources import asset
from volspec.scene import Scene, write_scene
from volspec.volume import load_volume

# Shape, range and spacing.
BUNDLED = {
    "engine": ((256, 256, 110), (0, 255), (1, 1, 1)),
    "head": ((256, 256, 109), (0, 255), (1, 1, 1.5)),
    "frog": ((500, 470, 136), (0, 29), (1, 1, 1.5)),
}


@pytest.mark.parametrize("name", BUNDLED)
def test_a_name_is_enough(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    volume = load_volume(name)
    assert (volume.shape_xyz, volume.range, volume.spacing_mm) == BUNDLED[name]


def test_a_scene_of_a_bundled_volume_is_saved_anywhere(tmp_path):
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume = replace(scene.file.volume, file="engine")
    saved = write_scene(replace(scene.file, volume=volume), tmp_path / "mine.toml", scene)
    loaded = Scene.load(saved)
    assert loaded.file.volume.file == "engine" and loaded.volume().shape_xyz == (256, 256, 110)
