"""Stereo pairs of exports: from layers of one cast, or cast for each eye."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.export.conftest import SCENE
from tests.export.test_export_depth import DEEP, made
from tests.support.errors import raises
from tests.support.images import read_codes
from volspec.errors import InputError
from volspec.export.frames import read_frame_text
from volspec.relight import relight
from volspec.relight.stereo import Stereo, expected_depth_mm

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
