"""Focus, fog, cuts and stereo pairs in exports, from layers of one cast or cast for each."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.export.conftest import METALS, SCENE, Make
from tests.support.commands import call
from tests.support.errors import raises
from tests.support.images import read_codes
from volspec.errors import InputError, SceneError, VolspecWarning
from volspec.export.exporter import export
from volspec.export.frames import read_frame_text
from volspec.export.plan import check_scene
from volspec.image import CoefficientImage, DepthEffects
from volspec.relight import relight
from volspec.relight.look import Look
from volspec.relight.stereo import Stereo, expected_depth_mm
from volspec.scene import stored_look
from volspec.spectra import light

DEEP = METALS + "[raycast]\nlayers = 4\n"
FLAT = METALS + "[raycast]\nlayers = 0\n"
CUT = '[depth]\nnear_mm = 50\n[export]\nlights = ["day"]\n'
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


@pytest.fixture
def deep(scene: Make) -> Make:
    """The scene in layers, or another text, with more at its end."""
    return partial(scene, text=DEEP)


def frame(folder: Path, name: str = "day.png") -> NDArray[np.int_]:
    return read_codes(folder / name).astype(int)


def test_a_focus_pull_is_cast_once(deep, tmp_path):
    """You should see a ball that is blurred, then less, then more."""
    exported = export(deep(PULL.replace("[depth]", "[depth]\nfog_mm = 500")), tmp_path)
    assert (exported.frames, exported.casts) == (3, 1)
    frames = {frame(tmp_path, name).tobytes() for name in exported.files if "/" in name}
    assert len(frames) == 3


def test_frames_and_pictures_have_the_scene_s_depth(deep, tmp_path):
    scene = deep(CUT)
    export(scene, tmp_path)
    image, lamp, shown = scene.render(), scene.lights[0].rig, frame(tmp_path)
    own = relight(image.recompose({}, scene.file.depth), lamp, scene.relight)
    assert np.abs(shown - own).max() <= 1
    assert np.abs(shown - relight(image, lamp, scene.relight)).max() > 10


def test_frames_of_which_a_cut_leaves_nothing_are_named_in_one_warning(deep, tmp_path):
    away = "depth = { near_mm = 0, far_mm = 1 }"
    text = PULL.replace("depth = { focus_mm = 30 }", away).replace('["day"]', '["day", "lamp"]')
    text = text.replace("focus_mm = 120, near_mm = 1", "near_mm = 0, far_mm = 1.5")
    with pytest.warns(VolspecWarning, match="leave nothing to be seen in .*, and 5 more;") as told:
        export(deep(text), tmp_path / "away")
    assert len(told) == 1


def test_coefficient_images_have_it_as_well(deep, tmp_path):
    scene = deep('[depth]\nfar_mm = 1\n[export]\nformat = "coefficients"\n')
    image = CoefficientImage.load(tmp_path / export(scene, tmp_path).files[0])  # all of it is cut
    assert not image.alpha.any() and image.opacity_layers is None


def test_coefficient_images_without_it_are_those_of_render(deep, tmp_path):
    scene = deep('[export]\nformat = "coefficients"\n')
    export(scene, tmp_path)
    assert call("render", scene.path, "-o", tmp_path / "ball.exr") == 0
    assert (tmp_path / "cast.exr").read_bytes() == (tmp_path / "ball.exr").read_bytes()
    assert CoefficientImage.load(tmp_path / "cast.exr").opacity_layers is not None


def test_an_image_is_relit_with_the_depth_of_its_scene(deep, tmp_path, capsys):
    scene, image = deep("[depth]\nnear_mm = 50\n"), tmp_path / "ball.exr"
    assert call("render", scene.path, "-o", image) == 0
    cast, words = CoefficientImage.load(image), ("relight", image, "--light", "A", "-o")
    assert stored_look(cast).depth == scene.file.depth
    for options, effects in (
        ((), DepthEffects(near_mm=50)),
        (("--near", "0"), DepthEffects()),
        (("--far", "60"), DepthEffects(near_mm=50, far_mm=60)),
        (("--far", "off", "--fog", "off"), DepthEffects(near_mm=50)),
    ):
        assert call(*words, tmp_path / "ball.png", *options) == 0
        wanted = relight(cast.recompose({}, effects), light("A"), stored_look(cast).relight)
        assert np.abs(frame(tmp_path, "ball.png") - wanted).max() <= 1
    eyes = ("--stereo", "anaglyph", "--focus", "off", "--near", "0")
    assert call(*words, tmp_path / "eyes.png", *eyes) == 0
    replace(cast, notes={"depth": '{"near_mm": "x"}'}).save(image)
    capsys.readouterr()
    assert call(*words, tmp_path / "ball.png") == 1
    assert f"{image}: the image's depth note" in "".join(capsys.readouterr().err.split("\n"))


def test_scene_check_finds_what_layers_cannot_show(deep):
    path = deep().path
    assert check_scene(path).errors == ()
    path.write_text(SCENE + "[raycast]\nlayers = 4\n", encoding="utf-8")
    (fault,) = check_scene(path).errors
    assert "[raycast]" in fault and "not materials" in fault


KEY = "[[keyframe]]\ntime_s = 0\ndepth = {{ {} }}".format


@pytest.mark.parametrize(
    ("said", "more", "text"),
    [
        ("range depth.near_mm", "[depth]\nnear_mm = 3\nfar_mm = 2", DEEP),
        ("range keyframe[0].depth.fog_mm", KEY("fog_mm = -1"), DEEP),
        ("missing depth", "[depth]\nfocus_mm = 30", FLAT),
        ("missing keyframe[0].depth", KEY("focus_mm = 9"), FLAT),
        # Those that an export alone cannot have.
        ("conflict", "[depth]\nfocus_mm = 30\n[camera]\northographic = true", DEEP),
        ("conflict", "[depth]\nfocus_mm = 30\n[export]\nsamples = 2", DEEP),
        ("range", PULL.replace("near_mm = 1", "near_mm = 9, far_mm = 8"), DEEP),
    ],
)
def test_a_depth_that_cannot_be_is_refused(scene, tmp_path, said, more, text):
    with raises(SceneError, *said.split()):
        export(scene(more, text=text), tmp_path / "none")


EYES = '[export]\nlights = ["day"]\nstereo = { layout = "side-by-side", eyes_deg = 4 }\n'
WIDE, SIZE = EYES.replace("eyes_deg = 4", "eyes_deg = 4, convergence_mm = 60"), (96, 72)


def test_eyes_of_one_cast_are_near_those_of_two(deep, tmp_path):
    """Measured: a tenth of what the eyes differ by."""
    assert export(deep(WIDE), tmp_path / "one", size=SIZE).casts == 1
    assert export(deep(WIDE, text=FLAT), tmp_path / "two", size=SIZE).casts == 2
    one, two = frame(tmp_path / "one"), frame(tmp_path / "two")
    assert one.shape == two.shape == (72, 192, 3)
    left, right = np.hsplit(two, 2)
    assert np.abs(one - two).mean() < 0.2 * np.abs(left - right).mean()
    assert "side-by-side" in read_frame_text(tmp_path / "one" / "day.png")["stereo"]


def test_frames_are_those_of_the_library(deep, tmp_path):
    scene = deep(
        EYES.replace("side-by-side", "anaglyph") + "[depth]\nfog_mm = 400\nnear_mm = 50\n"
        "[[keyframe]]\ntime_s = 0\n[[keyframe]]\ntime_s = 0.04\nopacities = { gold = 0.3 }\n"
    )
    exported = export(scene, tmp_path)
    assert (exported.frames, exported.casts) == (2, 1)
    assert scene.file.export.stereo == Stereo("anaglyph", eyes_deg=4)
    # No frame has another opacity, so that the layers are cast with it.
    look = Look(scene.relight, depth=scene.file.depth, stereo=scene.file.export.stereo)
    own = relight(scene.casting(opacities={"gold": 0.3}).render(), scene.lights[0].rig, look)
    assert np.abs(frame(tmp_path, "day/0001.png") - own).max() <= 2


def test_cast_eyes_may_have_several_rays_a_pixel_16_bits_and_marks(scene, tmp_path):
    settings = {"samples": 2, "bits": 16, "annotate": ["title"], "sheet": False}
    export(scene(EYES), tmp_path / "fine", size=SIZE, **settings)
    export(scene(EYES), tmp_path / "coarse", size=SIZE)
    fine, plain = read_codes(tmp_path / "fine" / "day.png"), frame(tmp_path / "coarse")
    assert fine.shape == plain.shape
    off = np.abs((fine >> 8 if fine.dtype == np.uint16 else fine).astype(int) - plain)
    assert off[32:].mean() < 0.5 and off[:32].max() > 60  # the title of each eye
    assert np.array_equal(*np.hsplit(off[:32].max(axis=(0, 2)) > 60, 2))


def test_a_turntable_converges_where_it_is_told(scene, tmp_path):
    made = scene(WIDE.replace("= 60", "= 70") + "turntable = { frames = 2 }\n")
    exported = export(made, tmp_path / "turn.gif")
    assert (exported.frames, exported.casts) == (2, 4)
    image = made.render()
    assert image.camera is not None and abs(expected_depth_mm(image) - 70) > 1
    left, right = made.file.export.stereo.eyes(image.camera, 70.0)
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
def test_files_and_sizes_without_a_pair_are_refused(deep, tmp_path, more, size, code):
    with raises(InputError, code):
        export(deep(f"{EYES}{more}\n"), tmp_path / "none", size=size)
