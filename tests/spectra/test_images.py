"""Spectral images in OpenEXR: the layout of Fichet, Pacanowski and Wilkie (2021)."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.errors import raises
from volspec.errors import SpectrumError, VolspecWarning
from volspec.spectra import SpectralGrid, SpectralImage, light, read_spectrum, reflectance

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
def test_save_and_load_keep_every_sample_and_note(tmp_path: Path, kind: Any) -> None:
    image = SpectralImage(ramp(), W + 0.25, kind, {"instrument": "camera", "designed": "yes"})
    image.save(tmp_path / "a.exr")
    back = SpectralImage.load(tmp_path / "a.exr")
    assert np.array_equal(back.values, image.values) and not back.values.flags.writeable
    assert np.array_equal(back.wavelengths_nm, image.wavelengths_nm)
    assert back.kind == kind
    assert back.notes.items() >= image.notes.items()
    assert np.array_equal(pickle.loads(pickle.dumps(back)).values, back.values)


def test_saved_files_follow_the_published_layout(tmp_path: Path) -> None:
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
def test_wavelengths_may_be_in_any_unit_and_order(tmp_path: Path, names: tuple[str, ...]) -> None:
    levels = dict(zip(names, (0.4, 0.55, 0.7), strict=True))
    path = write_exr(tmp_path / "a.exr", {f"T.{n}": levels[n] for n in reversed(names)})
    image = SpectralImage.load(path)
    assert image.wavelengths_nm == pytest.approx([400, 550, 700], abs=1e-5)
    assert image.mean().values == pytest.approx([0.4, 0.55, 0.7], rel=1e-6)


def test_half_floats_are_read_and_previews_left_out(tmp_path: Path) -> None:
    half = np.full((2, 3), 0.25, np.float16)
    channels = {"R": half, "G": half, "B": half, "A": half, "S0.400nm": half, "S0.700nm": half}
    image = SpectralImage.load(write_exr(tmp_path / "a.exr", channels, emissiveUnits="W.m^-2"))
    assert (image.kind, image.values.dtype) == ("emissive", "float32")
    assert image.values.shape == (2, 3, 2)
    assert "W.m^-2" in image.notes.values()
    assert image.mean().values.tolist() == [0.25, 0.25]


def test_a_file_with_both_kinds_is_taken_as_what_is_wanted(tmp_path: Path) -> None:
    channels = {"T.380nm": 0.5, "T.780nm": 0.5, "S0.380nm": 7.0, "S0.780nm": 7.0}
    path = write_exr(tmp_path / "both.exr", channels)
    image = SpectralImage.load(path)
    assert image.kind == "reflective" and "emissive" in image.notes.values()
    assert SpectralImage.load(path, "emissive").mean().values.tolist() == [7, 7]
    assert reflectance(str(path)).values == pytest.approx(0.5)
    assert light(str(path)).values == pytest.approx(1.0)


def test_polarisation_and_fluorescence_are_left_out_with_a_warning(tmp_path: Path) -> None:
    stokes = {f"S{k}.{w}nm": 1.0 / (k + 1) for k in range(4) for w in (400, 700)}
    with pytest.warns(VolspecWarning) as caught:
        image = SpectralImage.load(write_exr(tmp_path / "p.exr", stokes))
    assert caught[0].filename == __file__
    assert image.values.shape == (2, 3, 2)
    assert (image.values == 1).all()
    glow = {"T.400nm": 0.5, "T.400nm.700nm": 0.2, "T.700nm": 0.5}
    with pytest.warns(VolspecWarning):
        assert SpectralImage.load(write_exr(tmp_path / "f.exr", glow)).values.shape == (2, 3, 2)


def test_addresses_choose_the_mean_a_pixel_or_a_box(tmp_path: Path) -> None:
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
    for code, selectors in (("range", ("#3,0", "#-1,0", "#1,1,1,2")), ("syntax", ("#1", "#a,b"))):
        for selector in selectors:
            with raises(SpectrumError, code):
                read_spectrum(f"{path}{selector}")


def test_images_stand_for_lights_and_reflectances_by_kind(tmp_path: Path) -> None:
    SpectralImage(ramp(), W, "reflective", {"designed": "yes"}).save(tmp_path / "paint.exr")
    SpectralImage(ramp(), W, "emissive").save(tmp_path / "sky.exr")
    assert reflectance("paint.exr#0,0", folder=tmp_path).designed
    mix = light("sky.exr#1,1*0.5+E*0.5", folder=tmp_path)
    assert mix.name == "sky.exr#1,1*0.5+E*0.5"
    with raises(SpectrumError, "missing"):
        light("paint.exr", folder=tmp_path)
    with raises(SpectrumError, "missing"):
        reflectance("sky.exr", folder=tmp_path)


def test_every_pixel_is_resampled_like_a_single_spectrum() -> None:
    image = SpectralImage(ramp(), W, "reflective", {"lab": "L"})
    grid = SpectralGrid()
    on = image.on(grid)
    assert (on.values.shape, on.notes) == ((2, 3, grid.size), image.notes)
    expected = image.mean((2, 1, 3, 2)).on(grid).values
    assert on.values[1, 2] == pytest.approx(expected, rel=1e-6)
    narrow = SpectralImage(ramp(), np.linspace(450.0, 650.0, len(W)), "reflective")
    with raises(SpectrumError, "range"):
        narrow.on(grid)


def test_damaged_and_foreign_files_are_one_clear_line(tmp_path: Path) -> None:
    rgb = write_exr(tmp_path / "rgb.exr", {"R": 1.0, "G": 1.0, "B": 1.0})
    with raises(SpectrumError, "missing"):
        SpectralImage.load(rgb)
    (tmp_path / "text.exr").write_text("no image")
    with raises(SpectrumError, "damaged"):
        SpectralImage.load(tmp_path / "text.exr")
    SpectralImage(np.ones((64, 64, 9)), np.arange(400.0, 409), "reflective").save(
        tmp_path / "cut.exr"
    )
    whole = (tmp_path / "cut.exr").read_bytes()
    (tmp_path / "cut.exr").write_bytes(whole[: len(whole) // 2])
    with raises(SpectrumError, "damaged"):
        SpectralImage.load(tmp_path / "cut.exr")
    one = write_exr(tmp_path / "one.exr", {"T.550nm": 0.5})
    with raises(SpectrumError, "shape"):
        SpectralImage.load(one)
    twice = write_exr(tmp_path / "twice.exr", {"T.550nm": 0.5, "T.0,55um": 0.5})
    with raises(SpectrumError, "range"):
        SpectralImage.load(twice)


@pytest.mark.parametrize(
    ("values", "w", "kind", "code"),
    [
        (np.ones((2, 3)), W, "reflective", "shape"),
        (np.ones((2, 3, 4)), W, "reflective", "shape"),
        (np.ones((0, 3, 3)), W, "reflective", "shape"),
        (np.ones((2, 3, 3)), W[::-1], "reflective", "range"),
        (np.ones((2, 3, 3)), W, "absorbing", "unknown"),
        (np.where(np.arange(18) == 13, np.nan, 1).reshape(2, 3, 3), W, "emissive", "range"),
        ([[["x"]]], W, "emissive", "type"),
    ],
)
def test_bad_images_say_what_is_wrong(values: Any, w: Any, kind: Any, code: str) -> None:
    with raises(SpectrumError, code):
        SpectralImage(values, w, kind)


@pytest.mark.parametrize(
    ("name", "kind", "count"), [("D65.exr", "emissive", 97), ("Ohta1997.exr", "reflective", 16)]
)
def test_files_of_colour_science_are_read(name: str, kind: str, count: int) -> None:
    import colour

    path = Path(colour.__file__).parent / "io" / "tests" / "resources" / name
    if not path.is_file():
        pytest.skip("colour-science was installed without its test files")
    image = SpectralImage.load(path)
    assert (image.kind, image.wavelengths_nm.size) == (kind, count)
    if kind == "emissive":
        # Half floats hold three digits.
        assert light(str(path)).values == pytest.approx(light("D65").values, rel=2e-3)
