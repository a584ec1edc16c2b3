"""Spectral images in OpenEXR as Fichet, Pacanowski and Wilkie (2021); pictures relit like casts."""

import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.spectra._files import fails, saved
from volspec import _exr as exr
from volspec.basis import SpectralBasis
from volspec.errors import ImageError, SpectrumError, VolspecWarning
from volspec.image import CoefficientImage
from volspec.relight import relight
from volspec.spectra import (
    SpectralGrid,
    SpectralImage,
    light,
    read_spectrum,
    reflectance,
    reflectance_set,
)

W = np.array([380.0, 500.0, 780.0])


def write_exr(path: Path, channels: dict[str, Any], **header: str) -> Path:
    import OpenEXR

    base = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    images = {
        name: level if isinstance(level, np.ndarray) else np.full((2, 3), level, np.float32)
        for name, level in channels.items()
    }
    OpenEXR.File(base | header, images).write(str(path))
    return path


def ramp() -> NDArray[np.float32]:
    return np.linspace(0.1, 0.9, 2 * 3 * 3, dtype=np.float32).reshape(2, 3, 3)


@pytest.mark.parametrize("kind", ["reflective", "emissive"])
def test_save_and_load_keep_every_sample_and_note(tmp_path, kind):
    image = SpectralImage(ramp(), W + 0.25, kind, {"instrument": "camera", "designed": "yes"})
    image.save(tmp_path / "a.exr")
    back = SpectralImage.load(tmp_path / "a.exr")
    assert np.array_equal(back.values, image.values) and not back.values.flags.writeable
    assert np.array_equal(back.wavelengths_nm, image.wavelengths_nm)
    assert back.kind == kind
    assert back.notes.items() >= image.notes.items()
    assert np.array_equal(pickle.loads(pickle.dumps(back)).values, back.values)


def test_saved_files_follow_the_published_layout(tmp_path):
    import OpenEXR

    for kind, name in (("reflective", "T.380,000000nm"), ("emissive", "S0.380,000000nm")):
        SpectralImage(ramp(), W, kind).save(tmp_path / "a.exr")
        with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
            assert name in file.channels()
            assert file.header()["spectralLayoutVersion"] == "1.0"
            assert ("emissiveUnits" in file.header()) == (kind == "emissive")


@pytest.mark.parametrize(
    "names",
    [
        ("400,0nm", "550nm", "700,00nm"),
        ("4E-7m", "5,5e-7m", "0,0000007m"),
        ("0,4um", ",55um", "700000pm"),
        # c / 400 nm and so on.
        ("749,481145THz", "545,0771963636363THz", "4,28274940E14Hz"),
    ],
)
def test_wavelengths_may_be_in_any_unit_and_order(tmp_path, names):
    levels = dict(zip(names, (0.4, 0.55, 0.7), strict=True))
    path = write_exr(tmp_path / "a.exr", {f"T.{n}": levels[n] for n in reversed(names)})
    image = SpectralImage.load(path)
    assert image.wavelengths_nm == pytest.approx([400, 550, 700], abs=1e-5)
    assert image.mean().values == pytest.approx([0.4, 0.55, 0.7], rel=1e-6)


def test_half_floats_are_read_and_previews_left_out(tmp_path):
    half = np.full((2, 3), 0.25, np.float16)
    channels = {"R": half, "G": half, "B": half, "A": half, "S0.400nm": half, "S0.700nm": half}
    image = SpectralImage.load(write_exr(tmp_path / "a.exr", channels, emissiveUnits="W.m^-2"))
    assert (image.kind, image.values.dtype) == ("emissive", "float32")
    assert image.values.shape == (2, 3, 2)
    assert "W.m^-2" in image.notes.values()
    assert image.mean().values.tolist() == [0.25, 0.25]


def test_a_file_with_both_kinds_is_taken_as_what_is_wanted(tmp_path):
    channels = {"T.380nm": 0.5, "T.780nm": 0.5, "S0.380nm": 7.0, "S0.780nm": 7.0}
    path = write_exr(tmp_path / "both.exr", channels)
    image = SpectralImage.load(path)
    assert image.kind == "reflective" and "emissive" in image.notes.values()
    assert SpectralImage.load(path, "emissive").mean().values.tolist() == [7, 7]
    assert reflectance(str(path)).values == pytest.approx(0.5)
    assert light(str(path)).values == pytest.approx(1.0)


def test_polarisation_and_fluorescence_are_left_out_with_a_warning(tmp_path):
    stokes = {f"S{k}.{w}nm": 1.0 / (k + 1) for k in range(4) for w in (400, 700)}
    with pytest.warns(VolspecWarning) as caught:
        image = SpectralImage.load(write_exr(tmp_path / "p.exr", stokes))
    assert caught[0].filename == __file__
    assert image.values.shape == (2, 3, 2)
    assert (image.values == 1).all()
    glow = {"T.400nm": 0.5, "T.400nm.700nm": 0.2, "T.700nm": 0.5}
    with pytest.warns(VolspecWarning):
        assert SpectralImage.load(write_exr(tmp_path / "f.exr", glow)).values.shape == (2, 3, 2)


def test_addresses_choose_the_mean_a_pixel_or_a_box(tmp_path):
    path = tmp_path / "chart.exr"
    SpectralImage(ramp(), W, "reflective").save(path)
    for selector, expected in (
        ("", ramp().mean((0, 1), dtype=np.float64)),
        ("#2,1", ramp()[1, 2]),
        ("#0,0,2,1", ramp()[0, :2].mean(0)),
    ):
        s = read_spectrum(f"{path}{selector}")
        assert s.values == pytest.approx(expected, rel=1e-6)
        assert s.name == f"chart{selector}"
        assert "reflectance" in s.notes.values()


def test_images_stand_for_lights_and_reflectances_by_kind(tmp_path):
    SpectralImage(ramp(), W, "reflective", {"designed": "yes"}).save(tmp_path / "paint.exr")
    SpectralImage(ramp(), W, "emissive").save(tmp_path / "sky.exr")
    assert reflectance("paint.exr#0,0", folder=tmp_path).designed
    mix = light("sky.exr#1,1*0.5+E*0.5", folder=tmp_path)
    assert mix.name == "sky.exr#1,1*0.5+E*0.5"


def test_every_pixel_is_resampled_like_a_single_spectrum():
    image = SpectralImage(ramp(), W, "reflective", {"lab": "L"})
    grid = SpectralGrid()
    on = image.on(grid)
    assert (on.values.shape, on.notes) == ((2, 3, grid.size), image.notes)
    assert on.values[1, 2] == pytest.approx(image.mean((2, 1, 3, 2)).on(grid).values, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "kind", "count"), [("D65.exr", "emissive", 97), ("Ohta1997.exr", "reflective", 16)]
)
def test_files_of_colour_science_are_read(name, kind, count):
    import colour

    path = Path(colour.__file__).parent / "io" / "tests" / "resources" / name
    if not path.is_file():
        pytest.skip("colour-science was installed without its test files")
    image = SpectralImage.load(path)
    assert (image.kind, image.wavelengths_nm.size) == (kind, count)
    if kind == "emissive":
        # Half floats hold three digits.
        assert light(str(path)).values == pytest.approx(light("D65").values, rel=2e-3)


def test_exr_files_keep_header_and_channels(tmp_path):
    path = tmp_path / "a.exr"
    depth = np.arange(6.0).reshape(2, 3)
    exr.write_exr(path, {"volspec:format": 1}, {"Z": depth}, ImageError)
    header, channels = exr.read_exr(path, ImageError)
    assert header["volspec:format"] == 1
    assert (list(channels), channels["Z"].dtype) == (["Z"], np.float32)
    assert np.array_equal(channels["Z"], depth)


IMAGE = SpectralImage(ramp(), W, "reflective")
NARROW = SpectralImage(ramp(), np.linspace(450.0, 650.0, len(W)), "reflective")
NO_NUMBER = np.where(np.arange(18) == 13, np.nan, 1).reshape(2, 3, 3)


def chart(folder: Path, selector: str) -> Any:
    IMAGE.save(folder / "chart.exr")
    return read_spectrum(f"{folder / 'chart.exr'}{selector}")


def one_kind(folder: Path, kind: Any, read: Callable[..., Any]) -> Any:
    SpectralImage(ramp(), W, kind).save(folder / "a.exr")
    return read("a.exr", folder=folder)


def loaded(folder: Path, channels: dict[str, float]) -> SpectralImage:
    return SpectralImage.load(write_exr(folder / "a.exr", channels))


def cut(folder: Path) -> SpectralImage:
    path = folder / "cut.exr"
    SpectralImage(np.ones((64, 64, 9)), np.arange(400.0, 409), "reflective").save(path)
    whole = path.read_bytes()
    return SpectralImage.load(saved(folder, "cut.exr", whole[: len(whole) // 2]))


def in_two_parts(folder: Path) -> Any:
    import OpenEXR

    image = np.ones((2, 3), np.float32)
    parts = [OpenEXR.Part({"name": name}, {"T.500nm": image}) for name in ("left", "right")]
    OpenEXR.File(parts).write(str(folder / "two.exr"))
    return read_spectrum(folder / "two.exr")


BASIS = SpectralBasis.load("general-7")
CHART = reflectance_set("test").reshape(7, 12, -1)
NM = BASIS.grid.wavelengths_nm


def test_a_chart_of_reflectances_is_analysed_pixel_by_pixel():
    image = CoefficientImage.from_spectral_image(SpectralImage(CHART, NM, "reflective"), BASIS)
    assert np.allclose(image.coefficients, BASIS.analyse(CHART), atol=1e-6)
    assert image.alpha.min() == 1
    assert relight(image, light("A"), backend="numpy").std() > 30


def test_radiances_are_divided_by_the_light_they_were_taken_under():
    """The scale of radiances is free: the chart comes back up to one factor."""
    lamp = light("A")
    radiance = SpectralImage(3.7 * CHART * lamp.values, NM, "emissive")
    image = CoefficientImage.from_spectral_image(radiance, BASIS, taken_under=lamp)
    wanted = BASIS.analyse(CHART)
    factor = image.coefficients.mean() / wanted.mean()
    assert np.allclose(image.coefficients, factor * wanted, atol=1e-5)
    assert 1 <= factor < 1.3, "the brightest patch, which reflects 0.9, counts as white"


def test_a_hot_pixel_does_not_become_the_white():
    """The brightest of a thousand is taken; here every patch covers 20 of 1680 pixels."""
    lamp = light("A")
    large = np.tile(CHART, (4, 5, 1)) * lamp.values

    def taken(radiances: np.ndarray) -> np.ndarray:
        picture = SpectralImage(radiances, NM, "emissive")
        return CoefficientImage.from_spectral_image(picture, BASIS, lamp).coefficients

    plain, hot = taken(large), large.copy()
    y, x = np.unravel_index(large.sum(axis=-1).argmax(), large.shape[:2])
    hot[y, x] *= 5
    found = taken(hot)
    assert np.allclose(found[y, x], 5 * plain[y, x], rtol=1e-5)
    found[y, x] = plain[y, x]
    assert np.array_equal(found, plain)
    wanted = BASIS.analyse(np.tile(CHART, (4, 5, 1))) / CHART.mean(axis=-1).max()
    assert np.allclose(plain, wanted, atol=1e-5), "the brightest patch is the white"


REFLECTIVE, RADIANCE = (SpectralImage(CHART, NM, kind) for kind in ("reflective", "emissive"))
BLUE_ONLY = SpectralImage(CHART[..., :20], NM[:20], "reflective")
TOO_BRIGHT = SpectralImage(100 * CHART, NM, "reflective")
NEGATIVE = SpectralImage(-CHART, NM, "reflective")
UNEQUAL = {"Z": np.ones((2, 3)), "A": np.ones((3, 2))}


def analysed(picture: SpectralImage, lamp: str = "") -> CoefficientImage:
    taken_under = light(lamp) if lamp else None
    return CoefficientImage.from_spectral_image(picture, BASIS, taken_under=taken_under)


# With a `SpectrumError`.
REFUSED: list[tuple[str, Callable[[Path], object]]] = [
    ("range", lambda f: chart(f, "#3,0")),
    ("range", lambda f: chart(f, "#1,1,1,2")),
    ("syntax", lambda f: chart(f, "#a,b")),
    ("syntax", lambda f: chart(f, "#0_0,1")),
    ("missing", lambda f: one_kind(f, "reflective", light)),
    ("missing", lambda f: one_kind(f, "emissive", reflectance)),
    ("missing", lambda f: loaded(f, {"R": 1.0, "G": 1.0, "B": 1.0})),
    ("shape", lambda f: loaded(f, {"T.550nm": 0.5})),
    ("range", lambda f: loaded(f, {"T.550nm": 0.5, "T.0,55um": 0.5})),
    ("duplicate", in_two_parts),
    ("damaged", lambda f: SpectralImage.load(saved(f, "text.exr", "no image"))),
    ("damaged", cut),
    ("shape", lambda f: SpectralImage(np.ones((2, 3, 4)), W, "reflective")),
    ("shape", lambda f: SpectralImage(np.ones((0, 3, 3)), W, "reflective")),
    ("range", lambda f: SpectralImage(ramp(), W[::-1], "reflective")),
    ("unknown", lambda f: SpectralImage(ramp(), W, "absorbing")),
    ("range", lambda f: SpectralImage(NO_NUMBER, W, "emissive")),
    ("range", lambda f: NARROW.on(SpectralGrid())),
    ("unsupported", lambda f: IMAGE.save("a.tif")),
    ("syntax", lambda f: IMAGE.save("a\0.exr")),
    ("unknown", lambda f: SpectralImage.load("a.exr", "foo")),
    ("type", lambda f: IMAGE.mean("abc")),
    ("type", lambda f: IMAGE.mean((0.5, 0, 2, 2))),
    ("range", lambda f: analysed(BLUE_ONLY)),
]
OTHERS = [
    # Of the caller.
    ("not-found", lambda f: exr.read_exr(f / "a.exr", ImageError, missing="gone")),
    ("damaged", lambda f: exr.read_exr(Path(saved(f, "a.exr", "no image")), ImageError)),
    ("type", lambda f: exr.read_exr(f, ImageError)),
    ("unwritable", lambda f: exr.write_exr(f / "b.exr", {}, UNEQUAL, ImageError)),
    ("conflict", lambda f: analysed(RADIANCE)),
    ("conflict", lambda f: analysed(REFLECTIVE, "A")),
    # It has no blue to divide by.
    ("impossible", lambda f: analysed(RADIANCE, "LPS")),
    ("range", lambda f: analysed(TOO_BRIGHT)),
    ("range", lambda f: analysed(NEGATIVE)),
]


@pytest.mark.parametrize(
    ("error", "fault", "call"),
    [*((SpectrumError, *row) for row in REFUSED), *((ImageError, *row) for row in OTHERS)],
)
def test_bad_images_are_refused(tmp_path, error, fault, call):
    fails(call, tmp_path, fault, error)
    assert not (tmp_path / "b.exr").exists()
