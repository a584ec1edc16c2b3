"""Exports that are taken apart later: spectral frames, coefficient images for compositors."""

import dataclasses
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.export._layers import EVENING, HALF, LIGHTS, SHARES, SPEC, made, opened
from tests.support.commands import GENERAL, METALS, call
from tests.support.images import image
from volspec.appearance import Viewing
from volspec.appearance.display.spaces import SPACES
from volspec.basis.display import MODES
from volspec.export import tiles
from volspec.export.compositing import Recipe
from volspec.export.exporter import export
from volspec.export.spectral import SpectralIllumination, write_spectral_frame
from volspec.image import CoefficientImage
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.spectra import SpectralImage, light, reflectance
from volspec.spectra.datasets import colour_matching_functions

COEFFICIENTS = {"format": "coefficients", "sheet": False}
SPECTRAL = {"format": "exr", "spectral": True}


def test_spectral_frames_are_those_that_relight_writes(scene, tmp_path):
    made = scene("[viewing]\nbackdrop = 0.3\nexposure = 1.5\n")
    done = export(made, tmp_path / "out", **SPECTRAL, turntable={"frames": 2}, lights=["tube"])
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


def test_spectral_frames_grow_strip_by_strip_and_need_no_eye(scene, tmp_path, monkeypatch):
    made = scene('[viewing]\nadapting = "pixel"\n')
    settings = {**SPECTRAL, "lights": ["day", "lamp"], "size": (8, 160), "sheet": False}
    export(made, tmp_path / "whole", **settings)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    done = export(made, tmp_path / "strips", **settings)
    assert (done.made, done.casts) == (2, 1)
    whole, strips = (opened(tmp_path / name / "lamp.exr")[1] for name in ("whole", "strips"))
    for name in whole:
        # BLAS may add in another order; a half float may then be the neighbour.
        assert np.allclose(whole[name], strips[name], rtol=2 * HALF, atol=2.0**-24), name


def test_coefficients_are_the_image_that_render_writes_once_a_camera(scene, tmp_path):
    made = scene()
    done = export(made, tmp_path / "one", format="coefficients")
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


def test_coefficients_of_keyframes_keep_the_numbers_of_its_frames(scene, tmp_path):
    """Frames of a look that holds still share a cast, and each has its file and exposure."""
    keys = "".join(
        f"[[keyframe]]\ntime_s = {time}\nlights = {{ day = {day}, lamp = {1 - day} }}\n"
        f"viewing = {{ exposure = {exposure} }}\n"
        for time, day, exposure in ((0, 1, 1), (2, 0, 4))
    )
    done = export(scene(f"{keys}[export]\nfps = 1\n"), tmp_path, **COEFFICIENTS)
    assert done.files == ("cast/0000.exr", "cast/0001.exr", "cast/0002.exr") and done.casts == 1
    first, _, last = (Recipe.load(tmp_path / name) for name in done.files)
    assert list(first.lights) == ["day", "lamp", "tube"]
    dark, bright = (recipe.lights["lamp"].matrices["light"] for recipe in (first, last))
    assert np.allclose(bright, 4 * dark, rtol=1e-7)


def test_large_coefficients_are_put_together_of_windows_with_their_depth(
    scene, tmp_path, monkeypatch
):
    made = scene()
    own = made.render(size=(200, 150))
    monkeypatch.setattr(tiles, "CAST_BYTES", 4 * 7 * 64 * 100)
    monkeypatch.setattr(tiles, "STRIP_SIDE", 128)
    export(made, tmp_path / "1", **COEFFICIENTS, size=(200, 150))
    image = CoefficientImage.load(tmp_path / "1" / "cast.exr")
    for name in ("coefficients", "alpha", "depth_mm", "first_mm"):
        assert np.array_equal(getattr(image, name), getattr(own, name)), name
    assert image.notes == own.notes and image.fov_deg == own.fov_deg
    export(made, tmp_path / "2", **COEFFICIENTS, size=(100, 75), samples=2)
    small = CoefficientImage.load(tmp_path / "2" / "cast.exr")
    mean = own.coefficients.reshape(75, 2, 100, 2, 7).mean(axis=(1, 3))
    # The rays are the same, of a picture twice as large; float32 sums of four.
    assert np.allclose(small.coefficients, mean, rtol=1e-5, atol=1e-6)
    assert np.isinf(small.depth_mm).all() and small.first_mm is None


def test_the_command_writes_spectra(scene, tmp_path):
    words = ("--format", "exr", "--spectral", "--light", "lamp", "--size", "8x6")
    assert call("export", scene().path, "-o", tmp_path, *words) == 0
    assert "S0.550,000000nm" in opened(tmp_path / "lamp.exr")[1]


EYE = colour_matching_functions(GENERAL.grid).T


def spectral(path: Path) -> tuple[dict[str, Any], NDArray[Any], NDArray[Any]]:
    """Header, bands and R, G, B by OpenEXR's own library alone."""
    header, channels = opened(path)
    names = [f"S0.{nm},000000nm" for nm in range(380, 781, 5)]
    assert set(channels) == {*names, *"RGB"}
    assert {pixels.dtype.name for pixels in channels.values()} == {"float16"}
    bands, preview = (np.dstack([channels[k] for k in keys]) for keys in (names, "RGB"))
    return header, bands.astype(np.float64), preview.astype(np.float64)


@pytest.mark.parametrize("basis", [GENERAL, METALS], ids=["spectral", "materials"])
@pytest.mark.parametrize("name", LIGHTS)
def test_colours_of_a_spectral_frame_are_those_of_the_frame_to_half_rounding(basis, name, tmp_path):
    image, spec = made(basis), dataclasses.replace(SPEC, mode="exact")
    write_spectral_frame(tmp_path / "s.exr", image, LIGHTS[name], spec, {"light": name})
    header, bands, preview = spectral(tmp_path / "s.exr")
    shape = colour.SpectralShape(380, 780, 5)
    cmfs = colour.MultiSpectralDistributions(EYE, shape.wavelengths)
    XYZ = colour.msds_to_XYZ(bands, cmfs, colour.sd_ones(shape), method="Integration", shape=shape)
    lit = Illumination.of(basis, LIGHTS[name], spec, image.groups)
    own = lit.scene_XYZ(image.coefficients, image.alpha)
    # Every band is off by its rounding at most, and so is their weighted sum.
    bound = 100 / EYE[:, 1].sum() * (np.maximum(HALF * np.abs(bands), 2.0**-25) @ EYE)
    off = np.abs(XYZ - own)
    assert (off <= bound * (1 + HALF) + 1e-6).all(), (off / bound).max()
    RGB = own @ SPACES["sRGB"].RGB_from_XYZ.T
    assert np.allclose(preview, RGB, rtol=2 * HALF, atol=1e-4)
    assert header["spectralLayoutVersion"] == "1.0" and header["volspec:light"] == name


def test_units_of_a_spectral_frame_are_those_of_white_under_the_viewing_s_lux(tmp_path):
    white = image(np.ones((1, 1, 7)), GENERAL)
    for lamp, lux in ((light("A"), 500.0), (LightRig((light("A"),), (), (80.0,)), 80.0)):
        for exposure in (1.0, 4.0):
            spec = RelightSpec(Viewing(illuminance_lux=500.0, exposure=exposure), mode="exact")
            write_spectral_frame(tmp_path / "s.exr", white, lamp, spec, {})
            header, bands, _ = spectral(tmp_path / "s.exr")
            one, unit = header["emissiveUnits"].split(" ", 1)
            assert unit == "W.m^-2.sr^-1.nm^-1"
            luminance = 683.0 * GENERAL.grid.step_nm * float(one) * (bands[0, 0] @ EYE[:, 1])
            assert luminance == pytest.approx(lux / np.pi, rel=HALF)


@pytest.mark.parametrize("mode", MODES)
def test_a_spectral_frame_is_the_product_of_its_mode(mode):
    """White under flat light is flat in all; under a lamp exact and fitted keep its spectrum."""
    spec = RelightSpec(mode=mode, backdrop=0.0)
    flat = SpectralIllumination.of(GENERAL, light("E"), spec)
    assert np.allclose(flat.pixels(np.ones((1, 7)), np.ones(1))[0, 3:], 1.0)
    E = light("FL2").on(GENERAL.grid).values
    lamp = SpectralIllumination.of(GENERAL, light("FL2"), spec)
    bands = lamp.pixels(np.ones((1, 7)), np.ones(1))[0, 3:]
    off = np.abs(bands - E * EYE[:, 1].sum() / (E @ EYE[:, 1])).max()
    assert off < 1e-12 if mode in ("exact", "fitted") else off > 0.3


def test_large_frames_are_written_in_strips(tmp_path, monkeypatch):
    image = made(kind=np.float16)
    write_spectral_frame(tmp_path / "whole.exr", image, EVENING, SPEC, {})
    monkeypatch.setattr(tiles, "STRIP_NUMBERS", 2 * (GENERAL.grid.size + 3) * 12)
    seen: list[int] = []
    own = SpectralIllumination.pixels
    monkeypatch.setattr(
        SpectralIllumination, "pixels", lambda *a: seen.append(len(a[2])) or own(*a)
    )
    write_spectral_frame(tmp_path / "strips.exr", image, EVENING, SPEC, {})
    assert seen == [2, 2, 2, 1]
    whole, strips = (spectral(tmp_path / f"{name}.exr") for name in ("whole", "strips"))
    # BLAS may add in another order; a half float may then be the neighbour.
    assert np.allclose(whole[1], strips[1], rtol=2 * HALF, atol=0)


def test_relight_writes_spectra_and_reads_them_back_as_a_picture(tmp_path):
    metals, names = made(METALS), ("a-FL2.exr", "a-D65.exr")
    metals.save(tmp_path / "m.exr")
    words = ("--spectral", "--light", "FL2", "--light", "D65", "--reflectance", "rotor=gold")
    assert call("relight", tmp_path / "m.exr", *words, "-o", tmp_path / "a.exr") == 0
    golden = metals.with_reflectances({"rotor": reflectance("gold")})
    spec = dataclasses.replace(SPEC, mode="exact")
    for name, lamp in zip(names, ("FL2", "D65"), strict=True):
        header, bands, _ = spectral(tmp_path / name)
        lit = SpectralIllumination.of(golden.basis, light(lamp), spec, SHARES)
        right = lit.pixels(golden.coefficients, golden.alpha)[..., 3:]
        assert np.allclose(bands, right, rtol=2 * HALF, atol=2.0**-24)
        assert header["volspec:mode"] == "exact"
        assert SpectralImage.load(tmp_path / name).kind == "emissive"
