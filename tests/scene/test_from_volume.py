"""Scenes for volumes alone: what they show, and that they are found again wherever they are."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tests.support.errors import raises, warns
from volspec.camera.camera import Orbit, slice_view
from volspec.errors import InputError, SceneError, VolumeError
from volspec.export.exporter import export
from volspec.pipeline import raycast, relight
from volspec.scene import Scene
from volspec.spectra import light, write_spectrum
from volspec.volume import Metadata, Series, Volume, phantom
from volspec.volume.metadata import NO_SPACING, ONE_SLICE

LAYOUT = "?shape=16x16x16&dtype=float32&spacing=1,1,4"


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    folder = tmp_path / "scans"
    folder.mkdir()
    np.save(folder / "ball.npy", phantom.ball(16).values)
    phantom.ball(16).values.tofile(folder / "ball.raw")
    return folder / "ball.npy"


def test_a_scene_notes_what_was_assumed_of_its_volume(ball):
    assert Scene.from_volume(ball).file.volume.assumed == (NO_SPACING,)
    stated = Scene.from_volume(f"{ball.with_suffix('.raw')}{LAYOUT}")
    assert stated.file.volume.assumed == ()


@pytest.mark.parametrize("is_patient", [False, True])
@pytest.mark.parametrize(
    ("axis", "right", "up"),
    [(2, (1, 0, 0), (0, -1, 0)), (1, (1, 0, 0), (0, 0, 1)), (0, (0, 1, 0), (0, 0, 1))],
)
def test_a_single_slice_is_looked_at_straight_and_upright(axis, right, up, is_patient):
    values = np.arange(30.0).reshape(np.insert([5, 6], 2 - axis, 1)).repeat(2, 2 - axis)
    flip = np.diag([1.0, -1, 1, 1]) if is_patient else np.eye(4)  # a patient is upright anyhow
    stated = Metadata(assumed=(ONE_SLICE,), is_patient=is_patient)
    volume = Volume(values, world_from_index=flip, metadata=stated)
    across, upwards, _ = slice_view(volume).camera(volume).frame()
    assert np.allclose([across, upwards], [right, up]) and slice_view(phantom.ball(4)) is None


def test_a_scene_of_a_picture_looks_straight_at_it(ball):
    np.save(ball, phantom.ball(16).values[8])
    assert Scene.from_volume(ball).file.camera.up == (0.0, -1.0, 0.0)


def test_a_faint_body_around_a_dense_core_is_in_the_frame(tmp_path):
    """Opacities below a fiftieth of the core's that add up to opaque are no haze."""
    values = np.full((24, 28, 20), -1000, np.int16)
    values[2:-2, 2:-2, 2:-2] = 40
    values[10:14, 12:16, 8:12] = 1000
    np.save(tmp_path / "body.npy", values)
    alpha = Scene.from_volume(tmp_path / "body.npy").render(size=(64, 64)).alpha
    border = np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]])
    assert border.max() < 0.02 and alpha[20:44, 20:44].min() > 0.2


@pytest.mark.parametrize(("value", "mm"), [(2.0**-133, 2.0**-40), (2.0**120, 2.0**40)])
def test_a_volume_s_scene_is_the_same_in_other_units(tmp_path, value, mm):
    """But for the preset's points, which are rounded to three digits, and so the target."""
    pictures, scenes = [], []
    for by, unit in ((1.0, 1.0), (value, mm)):
        (phantom.ball(16).values * np.float32(by)).tofile(tmp_path / "ball.raw")
        spacing = f"{unit!r},{unit!r},{2 * unit!r}"
        raw = f"{tmp_path}/ball.raw?shape=16x16x16&dtype=float32&spacing={spacing}"
        scene = Scene.from_volume(raw)
        points = [point.value / by for point in scene.file.transfer.points]
        scenes.append([*points, *np.divide(scene.file.camera.target_mm, unit)])
        pictures.append(scene.casting(step_mm=unit / 2).render(size=(48, 48)).alpha)
    assert scenes[0] == pytest.approx(scenes[1], abs=2e-3)
    assert pictures[0].max() > 0.9 and np.abs(np.subtract(*pictures)).mean() < 2e-3


@pytest.mark.not_quick
def test_volumes_arrays_and_series_have_scenes_that_need_no_file(ball, tmp_path):
    wanted = Scene.from_volume(ball).render(size=(16, 16)).alpha
    volume = phantom.ball(16)
    for given in (volume, volume.values, volume.to_pyvista(), replace(volume, name="")):
        scene = Scene.from_volume(given)
        assert np.array_equal(scene.render(size=(16, 16)).alpha, wanted)
    with warns("its volume 'volume' is no file"):
        scene.save(tmp_path / "scene.toml")
    twice = Scene.from_volume(Series([volume, volume.values / 2]))
    assert (twice.step_count(), len(twice.opened()[1])) == (2, 2)
    done = export(twice, tmp_path / "out", size=(16, 16), play={"frames": 2}, lights=["D65"])
    assert (done.frames, done.casts) == (2, 2)


@pytest.mark.not_quick
def test_a_volume_s_scene_frames_what_it_shows(ball):
    scene = Scene.from_volume(f"{ball.with_suffix('.raw')}{LAYOUT}")
    assert scene.volume().spacing_mm == (1, 1, 4)
    alpha = scene.render(size=(64, 64)).alpha > 0.05
    rows, columns = np.nonzero(alpha.any(axis=1))[0], np.nonzero(alpha.any(axis=0))[0]
    # 85 % of the longer side, centred.
    assert 46 <= max(np.ptp(rows), np.ptp(columns)) <= 58
    assert abs(rows.mean() - 31.5) < 2 and abs(columns.mean() - 31.5) < 2


def test_a_volume_s_scene_has_the_given_preset_lights_and_camera(ball):
    camera = Orbit(azimuth_deg=90, elevation_deg=0, orthographic=True)
    scene = Scene.from_volume(ball, preset="surface", lights=["A", "planck:3000"], camera=camera)
    assert scene.file.transfer.kind == "surfaces"
    assert [light.name for light in scene.lights] == ["A", "planck:3000"]
    assert scene.file.camera.azimuth_deg == 90 and scene.file.camera.orthographic


def test_files_of_lights_are_relative_to_the_current_folder(ball, tmp_path, monkeypatch):
    write_spectrum(light("A"), tmp_path / "lamp.csv")
    monkeypatch.chdir(tmp_path)
    scene = Scene.from_volume("scans/ball.npy", lights=["lamp.csv", "lamp.csv*0.5+D65*0.5"])
    assert [each.name for each in scene.lights] == ["lamp.csv", "lamp.csv*0.5+D65*0.5"]
    assert scene.file.light[0].spectrum == "../lamp.csv"
    assert scene.lights[0].spectrum.values == pytest.approx(light("A").values)
    again = Scene.load(scene.save(tmp_path / "saved" / "scene.toml"))
    assert again.lights[1].spectrum.values == pytest.approx(scene.lights[1].spectrum.values)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*quality balanced asks for an error of")  # and leaves 0.009
def test_a_steep_preset_shows_no_rings(tmp_path):
    """Errors of a cast against one of fine steps, averaged over rings: a sphere of bone in air."""
    z, y, x = np.ogrid[-24:24, -24:24, -24:24]
    inside = gaussian_filter((np.sqrt(x**2 + y**2 + z**2) < 18).astype(np.float64), 0.7)
    np.save(tmp_path / "bone.npy", (2300 * inside - 1000).astype(np.int16))
    scene = Scene.from_volume(f"{tmp_path}/bone.npy?unit=HU", preset="muscle-bone")
    volume, size = scene.volume(), (120, 120)
    camera = replace(scene.file.camera, zoom=3 * scene.file.camera.zoom).camera(volume)

    def cast(**changes: Any) -> NDArray[np.float64]:
        image = raycast(volume, scene.transfer, camera, size, replace(scene.raycast, **changes))
        return relight(image, light("D65"), dtype=np.float32, backend="numpy").astype(np.float64)

    truth = cast(step_mm=1 / 32, jitter=0.0)

    def rings(picture: NDArray[np.float64]) -> float:
        return float(gaussian_filter(picture - truth, (2, 2, 0)).std())

    assert rings(cast()) < 0.5 * rings(cast(jitter=0.0))


@pytest.mark.not_quick
def test_a_saved_scene_moves_with_its_volume(ball, tmp_path):
    scene = Scene.from_volume(ball)
    expected = scene.render(size=(32, 32))
    scene.save(ball.parent / "ball.toml")
    assert 'file = "ball.npy"' in (ball.parent / "ball.toml").read_text()
    elsewhere = shutil.move(ball.parent, tmp_path / "moved")
    again = Scene.load(Path(elsewhere) / "ball.toml").render(size=(32, 32))
    np.testing.assert_array_equal(again.coefficients, expected.coefficients)


def test_a_saved_scene_s_numbers_are_short(ball):
    path = Scene.from_volume(ball).save(ball.parent / "ball.toml")
    numbers = [word.strip("[],") for word in path.read_text().split() if word[:1].isdigit()]
    assert max(map(len, numbers)) <= 8


def test_labels_beyond_64_bits_are_cast_and_refused_in_a_scene_s_file(tmp_path):
    values = np.zeros((4, 4, 4), np.uint64)
    values[1:3, 1:3, 1:3] = 2**63 + 5
    np.save(tmp_path / "u.npy", values)
    (tmp_path / "t.txt").write_text(f"{2**63 + 5} big 0 255 0\n", encoding="utf-8")
    scene = Scene.from_volume(f"{tmp_path}/u.npy?labels={tmp_path}/t.txt")
    assert scene.volume().by_role[""].labels[2**63 + 5].name == "big"
    with raises(SceneError, "range"):
        scene.save(tmp_path / "u.toml")


def test_paths_are_relative_to_the_volume_s_folder(ball, monkeypatch):
    monkeypatch.chdir(ball.parent)
    assert Scene.from_volume("ball.npy").file.volume.file == "ball.npy"
    assert Scene.from_volume(f"./ball.raw{LAYOUT}").path == ball.with_suffix(".raw")


def test_bad_input_is_refused_by_its_name(ball):
    with raises(InputError, "unknown", "preset"):
        Scene.from_volume(ball, preset="bones")
    with raises(SceneError, "unknown", "light[0]"):
        Scene.from_volume(ball, lights=["no such light"])
    with raises(VolumeError, "not-found"):
        Scene.from_volume(ball.parent / "none.npy")
