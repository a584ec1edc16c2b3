"""Focus, fog, cuts and stereo pairs in exports, from layers of one cast or cast for each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.export.conftest import SCENE
from tests.support.commands import call
from tests.support.errors import raises
from tests.support.fixtures import Capture
from tests.support.images import read_codes
from volspec.errors import InputError, SceneError, VolspecWarning
from volspec.export.frames import read_frame_text
from volspec.export.plan import check_scene
from volspec.raycast import CoefficientImage, DepthEffects
from volspec.relight import relight
from volspec.relight.stereo import Stereo, expected_depth_mm
from volspec.scene import Scene, stored_depth, stored_relight_spec
from volspec.spectra import light

DEEP = SCENE.replace('name = "general-7"', 'method = "materials"') + "[raycast]\nlayers = 4\n"
PULL = """
[depth]
aperture_mm = 12
[[keyframe]]
time_s = 0
depth = { focus_mm = 30 }
[[keyframe]]
time_s = 1
depth = { focus_mm = 120, near_mm = 1 }
[export]
fps = 2
lights = ["day"]
"""


def made(folder: Path, more: str, text: str = DEEP) -> Scene:
    path = folder / "deep.toml"
    path.write_text(text + more, encoding="utf-8")
    return Scene.load(path)


def test_a_focus_pull_is_cast_once(ball_folder: Path, tmp_path: Path) -> None:
    """You should see a ball that is blurred, then less, then more."""
    scene = made(ball_folder, PULL.replace("[depth]", "[depth]\nfog_mm = 500"))
    exported = scene.export(tmp_path / "pull")
    assert (exported.frames, exported.casts) == (3, 1)
    frames = [read_codes(tmp_path / "pull" / name) for name in exported.files if "/" in name]
    assert len({frame.tobytes() for frame in frames}) == 3


def test_frames_and_pictures_have_the_scene_s_depth(ball_folder: Path, tmp_path: Path) -> None:
    scene = made(ball_folder, '[depth]\nnear_mm = 50\n[export]\nlights = ["day"]\n')
    exported = scene.export(tmp_path / "cut")
    (name,) = (each for each in exported.files if each.startswith("day"))
    image = scene.render()
    own = relight(image.recompose({}, scene.file.depth), scene.lights[0].rig, scene.relight)
    frame = read_codes(tmp_path / "cut" / name).astype(int)
    assert np.abs(frame - own.astype(int)).max() <= 1
    plain = relight(image, scene.lights[0].rig, scene.relight)
    assert np.abs(frame - plain.astype(int)).max() > 10


def test_frames_of_which_a_cut_leaves_nothing_are_named_in_one_warning(
    ball_folder: Path, tmp_path: Path
) -> None:
    away = "depth = { near_mm = 0, far_mm = 1 }"
    text = PULL.replace("depth = { focus_mm = 30 }", away).replace('["day"]', '["day", "lamp"]')
    text = text.replace("focus_mm = 120, near_mm = 1", "near_mm = 0, far_mm = 1.5")
    scene = made(ball_folder, text)
    with pytest.warns(VolspecWarning, match="leave nothing to be seen in .*, and 5 more;") as told:
        scene.export(tmp_path / "away")
    assert len(told) == 1
    scene = made(ball_folder, '[depth]\nnear_mm = 50\n[export]\nlights = ["day"]\n')
    scene.export(tmp_path / "cut")


def test_coefficient_images_have_it_as_well(ball_folder: Path, tmp_path: Path) -> None:
    scene = made(ball_folder, '[depth]\nfar_mm = 1\n[export]\nformat = "coefficients"\n')
    exported = scene.export(tmp_path / "images")
    image = CoefficientImage.load(tmp_path / "images" / exported.files[0])  # all of it is cut
    assert not image.alpha.any() and image.opacity_layers is None


def test_coefficient_images_without_it_are_those_of_render(
    ball_folder: Path, tmp_path: Path
) -> None:
    scene = made(ball_folder, '[export]\nformat = "coefficients"\n')
    (name,) = (each for each in scene.export(tmp_path / "images").files if "cast" in each)
    assert call("render", ball_folder / "deep.toml", "-o", tmp_path / "ball.exr") == 0
    exported, rendered = (tmp_path / "images" / name, tmp_path / "ball.exr")
    assert exported.read_bytes() == rendered.read_bytes()
    assert CoefficientImage.load(exported).opacity_layers is not None


def test_an_image_is_relit_with_the_depth_of_its_scene(
    ball_folder: Path, tmp_path: Path, capsys: Capture
) -> None:
    scene = made(ball_folder, "[depth]\nnear_mm = 50\n")
    image, frame = tmp_path / "ball.exr", tmp_path / "ball.png"
    assert call("render", ball_folder / "deep.toml", "-o", image) == 0
    cast = CoefficientImage.load(image)
    spec = stored_relight_spec(cast)
    assert stored_depth(cast) == scene.file.depth
    for options, effects in (
        ((), DepthEffects(near_mm=50)),
        (("--near", "0"), DepthEffects()),
        (("--far", "60"), DepthEffects(near_mm=50, far_mm=60)),
        (("--far", "off", "--fog", "off"), DepthEffects(near_mm=50)),
        (("--stereo", "anaglyph", "--focus", "off", "--near", "0"), None),
    ):
        assert call("relight", image, "--light", "A", "-o", frame, *options) == 0
        if effects is None:
            continue
        wanted = relight(cast.recompose({}, effects), light("A"), spec)
        assert np.abs(read_codes(frame).astype(int) - wanted.astype(int)).max() <= 1
    replace(cast, notes={"depth": '{"near_mm": "x"}'}).save(image)
    capsys.readouterr()
    assert call("relight", image, "--light", "A", "-o", frame) == 1
    assert f"{image}: the image's depth note" in "".join(capsys.readouterr().err.split("\n"))


def test_scene_check_finds_what_layers_cannot_show(ball_folder: Path) -> None:
    path = ball_folder / "deep.toml"
    made(ball_folder, "")
    assert check_scene(path).errors == ()
    spectral = SCENE + "[raycast]\nlayers = 4\n"
    path.write_text(spectral, encoding="utf-8")
    (fault,) = check_scene(path).errors
    assert "[raycast]" in fault and "not materials" in fault


FLAT = DEEP.replace("layers = 4", "layers = 0")
KEY = "[[keyframe]]\ntime_s = 0\ndepth = {{ {} }}".format


@pytest.mark.parametrize(
    ("more", "text", "code", "field"),
    [
        ("[depth]\nnear_mm = 3\nfar_mm = 2", DEEP, "range", "depth.near_mm"),
        (KEY("fog_mm = -1"), DEEP, "range", "keyframe[0].depth.fog_mm"),
        ("[depth]\nfocus_mm = 30", FLAT, "missing", "depth"),
        (KEY("focus_mm = 9"), FLAT, "missing", "keyframe[0].depth"),
        # Those that an export alone cannot have.
        ("[depth]\nfocus_mm = 30\n[camera]\northographic = true", DEEP, "conflict", None),
        ("[depth]\nfocus_mm = 30\n[export]\nsamples = 2", DEEP, "conflict", None),
        (PULL.replace("near_mm = 1", "near_mm = 9, far_mm = 8"), DEEP, "range", None),
    ],
)
def test_a_depth_that_cannot_be_is_refused(
    ball_folder: Path, tmp_path: Path, more: str, text: str, code: str, field: str | None
) -> None:
    with raises(SceneError, code, field):
        made(ball_folder, more, text).export(tmp_path / "none")


EYES = '[export]\nlights = ["day"]\nstereo = { layout = "side-by-side", eyes_deg = 4 }\n'
WIDE, SIZE = EYES.replace("eyes_deg = 4", "eyes_deg = 4, convergence_mm = 60"), (96, 72)


def frame(folder: Path, name: str = "day.png") -> NDArray[np.int_]:
    return read_codes(folder / name).astype(int)


def test_eyes_of_one_cast_are_near_those_of_two(ball_folder: Path, tmp_path: Path) -> None:
    """Measured: a tenth of what the eyes differ by."""
    assert made(ball_folder, WIDE).export(tmp_path / "one", size=SIZE).casts == 1
    flat = DEEP.replace("layers = 4", "layers = 0")
    assert made(ball_folder, WIDE, flat).export(tmp_path / "two", size=SIZE).casts == 2
    one, two = frame(tmp_path / "one"), frame(tmp_path / "two")
    assert one.shape == two.shape == (72, 192, 3)
    left, right = np.hsplit(two, 2)
    apart = np.abs(left - right).mean()
    assert np.abs(one - two).mean() < 0.2 * apart
    assert "side-by-side" in read_frame_text(tmp_path / "one" / "day.png")["stereo"]


def test_frames_are_those_of_the_library(ball_folder: Path, tmp_path: Path) -> None:
    fading = EYES.replace("side-by-side", "anaglyph") + (
        "[depth]\nfog_mm = 400\nnear_mm = 50\n"
        "[[keyframe]]\ntime_s = 0\n[[keyframe]]\ntime_s = 0.04\nopacities = { gold = 0.3 }\n"
    )
    scene = made(ball_folder, fading)
    exported = scene.export(tmp_path / "fading")
    assert (exported.frames, exported.casts) == (2, 1)
    stereo, image = scene.file.export.stereo, scene.render()
    assert stereo == Stereo("anaglyph", eyes_deg=4)
    views = stereo.views(image, {"gold": 0.3}, scene.file.depth)
    own = stereo.combine(*(relight(v, scene.lights[0].rig, scene.relight) for v in views))
    assert np.abs(frame(tmp_path / "fading" / "day", "0001.png") - own.astype(int)).max() <= 2


def test_cast_eyes_may_have_several_rays_a_pixel_16_bits_and_marks(
    ball_folder: Path, tmp_path: Path
) -> None:
    more = 'samples = 2\nbits = 16\nannotate = ["title"]\nsheet = false\n'
    scene = made(ball_folder, EYES.replace("[export]\n", f"[export]\n{more}"), SCENE)
    scene.export(tmp_path / "fine", size=(96, 72))
    coarse = made(ball_folder, EYES, SCENE)
    coarse.export(tmp_path / "coarse", size=(96, 72))
    fine, plain = read_codes(tmp_path / "fine" / "day.png"), frame(tmp_path / "coarse")
    assert fine.shape == plain.shape
    off = np.abs((fine >> 8 if fine.dtype == np.uint16 else fine).astype(int) - plain)
    assert off[32:].mean() < 0.5 and off[:32].max() > 60  # the title of each eye
    assert np.array_equal(*np.hsplit(off[:32].max(axis=(0, 2)) > 60, 2))


def test_a_turntable_converges_where_it_is_told(ball_folder: Path, tmp_path: Path) -> None:
    table = EYES.replace("eyes_deg = 4", "eyes_deg = 4, convergence_mm = 70")
    scene = made(ball_folder, table + "turntable = { frames = 2 }\n", SCENE)
    exported = scene.export(tmp_path / "turn.gif")
    assert (exported.frames, exported.casts) == (2, 4)
    image = scene.render()
    assert image.camera is not None and abs(expected_depth_mm(image) - 70) > 1
    left, right = scene.file.export.stereo.eyes(image.camera, 70.0)
    apart = np.linalg.norm(np.subtract(left.position_mm, right.position_mm))
    assert apart == pytest.approx(2 * 70 * np.tan(np.radians(2)))


@pytest.mark.parametrize(
    ("more", "size", "code"),
    [
        ('format = "exr"', None, "conflict"),
        ('format = "coefficients"', None, "conflict"),
        ("transparent = true", None, "conflict"),
        ('hdr = { transfer = "PQ" }', None, "conflict"),
        ("[depth]\nfocus_mm = 30", None, "conflict"),
        ("", (40000, 30000), "size"),
    ],
)
def test_files_and_sizes_without_a_pair_are_refused(
    ball_folder: Path, tmp_path: Path, more: str, size: Any, code: str
) -> None:
    with raises(InputError, code):
        made(ball_folder, f"{EYES}{more}\n").export(tmp_path / "none", size=size)
