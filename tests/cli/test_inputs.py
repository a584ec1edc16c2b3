"""Volumes, folders and patterns as inputs of render, export, page and scene new."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import call
from tests.support.errors import raises
from tests.support.fixtures import Patch
from volspec.cli.inputs import InputJob, jobs, open_scene
from volspec.errors import InputError
from volspec.export.frames import read_frame_text
from volspec.image import CoefficientImage
from volspec.scene import Scene
from volspec.volume import phantom

SIZE = "--size", "24x16"


@pytest.fixture
def scans(tmp_path: Path, monkeypatch: Patch) -> Path:
    monkeypatch.chdir(tmp_path)
    folder = Path("scans")
    folder.mkdir()
    for name, size in {"a": 8, "b": 10}.items():
        np.save(folder / f"{name}.npy", phantom.ball(size).values)
    return folder


def new_scene(volume: Path | str, path: str, *options: str) -> Scene:
    assert call("scene", "new", volume, "-o", path, *options) == 0
    return Scene.load(path)


def test_a_volume_is_rendered_as_its_new_scene_is(scans):
    options = "--preset", "skin", "--camera", "left", "-l", "A"
    assert call("render", scans / "a.npy", "-o", "a.exr", *options, *SIZE) == 0
    scene = new_scene(scans / "a.npy", "other/a.toml", *options)
    assert call("render", "other/a.toml", "-o", "again.exr", *SIZE) == 0
    one, other = map(CoefficientImage.load, ("a.exr", "again.exr"))
    np.testing.assert_array_equal(one.coefficients, other.coefficients)
    assert scene.file.volume.file == "../scans/a.npy"
    assert scene.file.camera.azimuth_deg == -90 and [each.name for each in scene.lights] == ["A"]


@pytest.mark.slow
def test_everyday_names_of_lights_are_told(scans, capsys):
    """Lights of a volume's new scene, and those added to a page."""
    lights = "-l", "LED", "-l", "a"
    assert call("scene", "new", scans / "a.npy", "-o", "a.toml", *lights) == 0
    assert call("page", "a.toml", "-o", "a.html", "-l", "sodium", *SIZE) == 0
    notes = [line for line in capsys.readouterr().err.splitlines() if "note" in line]
    assert notes == ["volspec: note: LED is LED-B3", "volspec: note: sodium is HP1"]


def test_left_is_the_patients_left(scans):
    """The patient's left is at +x in LPS, an azimuth of 90 degrees."""
    import SimpleITK as sitk

    image = sitk.GetImageFromArray(phantom.ball(8).values)
    image.SetDirection((-1, 0, 0, 0, -1, 0, 0, 0, 1))
    sitk.WriteImage(image, "head.nrrd")
    for side, azimuth in (("left", 90), ("right", -90), ("back", 180), ("posterior", 180)):
        made = new_scene("head.nrrd", f"{side}.toml", "--camera", side)
        opened, _ = open_scene("left.toml", camera=side)
        assert made.file.camera.azimuth_deg == opened.file.camera.azimuth_deg == azimuth
    with raises(InputError, "conflict"):  # whose sides have no such names
        open_scene(str(scans / "a.npy"), camera="superior")


def test_a_scene_takes_a_camera_too(scans):
    scene = new_scene(scans / "a.npy", "a.toml")
    assert call("render", "a.toml", "-o", "turned.exr", "--camera", "90,0", *SIZE) == 0
    camera = Scene.from_volume(scans / "a.npy").file.camera
    assert scene.file.camera == camera and (camera.azimuth_deg, camera.elevation_deg) == (30, 20)


@pytest.mark.parametrize(
    "inputs",
    [
        *(["scans"], ["scans/*.npy"], ["scans/a.npy", "scans/b.npy"], ["scans/?.npy"]),
        *(["scans/[ab].npy?spacing=1,1,2"], ["scans/?.npy?spacing=1,1,2"]),
    ],
    ids=repr,
)
def test_a_batch_has_an_output_for_each_input(scans, inputs, capsys):
    assert call("render", *inputs, "-o", "out", *SIZE) == 0
    assert sorted(path.name for path in Path("out").iterdir()) == ["a.exr", "b.exr"]
    assert capsys.readouterr().out.splitlines()[-1] == "2 of 2 inputs done"


def test_a_question_mark_begins_options_of_what_there_is(scans):
    out = Path("out")
    for address in ("scans/a.npy?size=3", "engine?level", "https://host/[v].zarr?time=2"):
        assert jobs([address], out) == [InputJob(address, out)]
    for address in ("scans/z?.npy", "scans/*.nrrd?spacing=1,1,2"):
        with raises(InputError, "not-found"):
            jobs([address], out)


def test_a_pattern_names_the_outputs_of_a_batch(scans):
    words = ("-o", "films/{name}-A", "--light", "A", "--stereo", "anaglyph", *SIZE)
    assert call("export", "scans", *words) == 0
    assert "anaglyph" in read_frame_text("films/b-A/A.png")["stereo"]
    assert call("page", "scans", "-o", "pages", *SIZE) == 0
    assert (Path("films/a-A/A.png")).is_file() and (Path("pages/b.html")).is_file()


@pytest.mark.usefixtures("needs_opencl")
def test_a_batch_goes_on_after_an_input_that_cannot_be_read(scans, capsys):
    (scans / "aa.nrrd").write_text("not a volume")
    assert call("export", "scans", "-o", "out", "--light", "A", "--json", *SIZE) == 1
    printed = capsys.readouterr()
    assert [Path(each["output"]).name for each in json.loads(printed.out)] == ["a", "b"]
    assert "aa.nrrd" in printed.err


def test_inputs_of_one_name_keep_their_endings(scans):
    shutil.copy(scans / "a.npy", "a.npy")
    call("scene", "new", "a.npy", "-o", "a.toml")
    assert call("render", "a.npy", "a.toml", "-o", "out", *SIZE) == 0
    assert sorted(path.name for path in Path("out").iterdir()) == ["a.npy.exr", "a.toml.exr"]


def test_a_folder_of_slices_is_one_volume(scans):
    from imageio.v3 import imwrite

    folder = Path("slices")
    folder.mkdir()
    for i, layer in enumerate((255 * phantom.ball(8).values).astype(np.uint8)):
        imwrite(folder / f"{i}.png", layer)
    scene = new_scene(f"{folder}?spacing=1,1,1", "slices.toml")
    assert scene.volume().values.shape == (8, 8, 8)


def test_nothing_that_is_there_is_replaced_by_a_new_scene(scans):
    Path("a.toml").write_text("# mine")
    assert call("scene", "new", scans / "a.npy", "-o", "a.toml") == 1
    assert Path("a.toml").read_text() == "# mine"
    new_scene(scans / "a.npy", "a.toml", "--overwrite")
