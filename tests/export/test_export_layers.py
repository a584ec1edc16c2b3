"""Exports that are taken apart later: spectral frames, coefficient images for compositors."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.export._layers import HALF, opened
from tests.export.conftest import Make
from tests.support.commands import call
from tests.support.fixtures import Patch
from volspec.export import tiles
from volspec.export.compositing import Recipe
from volspec.export.spectral import write_spectral_frame
from volspec.raycast import CoefficientImage
from volspec.relight import RelightSpec

COEFFICIENTS = {"format": "coefficients", "sheet": False}
SPECTRAL = {"format": "exr", "spectral": True}


def test_spectral_frames_are_those_that_relight_writes(scene: Make, tmp_path: Path) -> None:
    made = scene("[viewing]\nbackdrop = 0.3\nexposure = 1.5\n")
    done = made.export(tmp_path / "out", **SPECTRAL, turntable={"frames": 2}, lights=["tube"])
    assert done.files == ("tube/0000.exr", "tube/0001.exr", "sheet.png")
    lamp = made.lights[2].rig
    spec = RelightSpec(made.relight.viewing, mode="exact", backdrop=0.3)
    write_spectral_frame(tmp_path / "own.exr", made.render(), lamp, spec, {})
    header, channels = opened(tmp_path / "out" / "tube" / "0000.exr")
    own_header, own = opened(tmp_path / "own.exr")
    assert channels.keys() == own.keys() and "S0.700,000000nm" in own
    for name in own:
        assert np.array_equal(channels[name], own[name]), name
    assert header["emissiveUnits"] == own_header["emissiveUnits"]
    assert header["volspec:relight"].startswith("mode exact")


def test_spectral_frames_grow_strip_by_strip_and_need_no_eye(
    scene: Make, tmp_path: Path, monkeypatch: Patch
) -> None:
    made = scene('[viewing]\nadapting = "pixel"\n')
    settings = {**SPECTRAL, "lights": ["day", "lamp"], "size": (8, 160), "sheet": False}
    made.export(tmp_path / "whole", **settings)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    done = made.export(tmp_path / "strips", **settings)
    assert (done.made, done.casts) == (2, 1)
    whole, strips = (opened(tmp_path / name / "lamp.exr")[1] for name in ("whole", "strips"))
    for name in whole:
        # BLAS may add in another order; a half float may then be the neighbour.
        assert np.allclose(whole[name], strips[name], rtol=2 * HALF, atol=2.0**-24), name


def test_coefficients_are_the_image_that_render_writes_once_a_camera(
    scene: Make, tmp_path: Path
) -> None:
    made = scene()
    done = made.export(tmp_path / "one", format="coefficients")
    assert done.files == ("cast.exr", "sheet.png") and (done.made, done.casts) == (1, 1)
    assert call("render", made.path, "-o", tmp_path / "own.exr") == 0
    assert (tmp_path / "one" / "cast.exr").read_bytes() == (tmp_path / "own.exr").read_bytes()
    words = ("--format", "coefficients", "--turntable", "3", "--light", "tube", "--light", "day")
    assert call("export", made.path, "-o", tmp_path / "turn", *words) == 0
    turned = sorted((tmp_path / "turn" / "cast").iterdir())
    assert [path.name for path in turned] == ["0000.exr", "0001.exr", "0002.exr"]
    assert list(Recipe.load(turned[1]).lights) == ["tube", "day"]
    notes = [CoefficientImage.load(path).notes["camera"] for path in turned]
    assert len(set(notes)) == 3


def test_coefficients_of_keyframes_keep_the_numbers_of_its_frames(
    scene: Make, tmp_path: Path
) -> None:
    """Frames of a look that holds still share a cast, and each has its file and exposure."""
    keys = "".join(
        f"[[keyframe]]\ntime_s = {time}\nlights = {{ day = {day}, lamp = {1 - day} }}\n"
        f"viewing = {{ exposure = {exposure} }}\n"
        for time, day, exposure in ((0, 1, 1), (2, 0, 4))
    )
    done = scene(f"{keys}[export]\nfps = 1\n").export(tmp_path, **COEFFICIENTS)
    assert done.files == ("cast/0000.exr", "cast/0001.exr", "cast/0002.exr") and done.casts == 1
    first, _, last = (Recipe.load(tmp_path / name) for name in done.files)
    assert list(first.lights) == ["day", "lamp", "tube"]
    dark, bright = (recipe.lights["lamp"].matrices["light"] for recipe in (first, last))
    assert np.allclose(bright, 4 * dark, rtol=1e-7)


def test_large_coefficients_are_put_together_of_windows_with_their_depth(
    scene: Make, tmp_path: Path, monkeypatch: Patch
) -> None:
    made = scene()
    own = made.render(size=(200, 150))
    monkeypatch.setattr(tiles, "CAST_BYTES", 4 * 7 * 64 * 100)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    made.export(tmp_path / "1", **COEFFICIENTS, size=(200, 150))
    image = CoefficientImage.load(tmp_path / "1" / "cast.exr")
    for name in ("coefficients", "alpha", "depth_mm", "first_mm"):
        assert np.array_equal(getattr(image, name), getattr(own, name)), name
    assert image.notes == own.notes and image.fov_deg == own.fov_deg
    made.export(tmp_path / "2", **COEFFICIENTS, size=(100, 75), samples=2)
    small = CoefficientImage.load(tmp_path / "2" / "cast.exr")
    mean = own.coefficients.reshape(75, 2, 100, 2, 7).mean(axis=(1, 3))
    # The rays are the same, of a picture twice as large; float32 sums of four.
    assert np.allclose(small.coefficients, mean, rtol=1e-5, atol=1e-6)
    assert np.isinf(small.depth_mm).all() and small.first_mm is None


def test_the_command_writes_spectra(scene: Make, tmp_path: Path) -> None:
    words = ("--format", "exr", "--spectral", "--light", "lamp", "--size", "8x6")
    assert call("export", scene().path, "-o", tmp_path, *words) == 0
    assert "S0.550,000000nm" in opened(tmp_path / "lamp.exr")[1]
