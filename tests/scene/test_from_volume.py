"""Scenes for volumes alone: what they show, and that they are found again wherever they are."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import raises
from volspec.errors import InputError, SceneError, VolumeError
from volspec.raycast.camera import Orbit
from volspec.scene import Scene
from volspec.volume import phantom

LAYOUT = "?shape=16x16x16&dtype=float32&spacing=1,1,4"


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    folder = tmp_path / "scans"
    folder.mkdir()
    np.save(folder / "ball.npy", phantom.ball(16).values)
    phantom.ball(16).values.tofile(folder / "ball.raw")
    return folder / "ball.npy"


def test_a_volume_s_scene_frames_what_it_shows(ball: Path) -> None:
    scene = Scene.from_volume(f"{ball.with_suffix('.raw')}{LAYOUT}")
    volume = scene.volume()
    assert volume.spacing_mm == (1, 1, 4)
    alpha = scene.render(size=(64, 64)).alpha > 0.05
    rows, columns = np.nonzero(alpha.any(axis=1))[0], np.nonzero(alpha.any(axis=0))[0]
    # 85 % of the longer side, centred.
    assert 46 <= max(np.ptp(rows), np.ptp(columns)) <= 58
    assert abs(rows.mean() - 31.5) < 2 and abs(columns.mean() - 31.5) < 2


def test_a_volume_s_scene_has_the_given_preset_lights_and_camera(ball: Path) -> None:
    camera = Orbit(azimuth_deg=90, elevation_deg=0, orthographic=True)
    scene = Scene.from_volume(ball, preset="surface", lights=["A", "planck:3000"], camera=camera)
    assert scene.file.transfer.kind == "surfaces"
    assert [light.name for light in scene.lights] == ["A", "planck:3000"]
    assert scene.file.camera.azimuth_deg == 90 and scene.file.camera.orthographic


def test_a_saved_scene_moves_with_its_volume(ball: Path, tmp_path: Path) -> None:
    scene = Scene.from_volume(ball)
    expected = scene.render(size=(32, 32))
    scene.save(ball.parent / "ball.toml")
    assert 'file = "ball.npy"' in (ball.parent / "ball.toml").read_text()
    elsewhere = shutil.move(ball.parent, tmp_path / "moved")
    again = Scene.load(Path(elsewhere) / "ball.toml").render(size=(32, 32))
    np.testing.assert_array_equal(again.coefficients, expected.coefficients)


def test_a_saved_scene_s_numbers_are_short(ball: Path) -> None:
    path = Scene.from_volume(ball).save(ball.parent / "ball.toml")
    numbers = [word.strip("[],") for word in path.read_text().split() if word[:1].isdigit()]
    assert max(map(len, numbers)) <= 8


def test_paths_are_relative_to_the_volume_s_folder(
    ball: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ball.parent)
    assert Scene.from_volume("ball.npy").file.volume.file == "ball.npy"
    assert Scene.from_volume(f"./ball.raw{LAYOUT}").path == ball.with_suffix(".raw")


def test_bad_input_is_refused_by_its_name(ball: Path) -> None:
    with raises(InputError, "unknown", "preset"):
        Scene.from_volume(ball, preset="bones")
    with raises(SceneError, "unknown", "light[0]"):
        Scene.from_volume(ball, lights=["no such light"])
    with raises(VolumeError, "not-found"):
        Scene.from_volume(ball.parent / "none.npy")
