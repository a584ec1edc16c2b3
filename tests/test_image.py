"""Coefficient images on disk: the same numbers back, or refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from volspec._files import write_whole
from volspec.basis import SpectralBasis
from volspec.errors import ImageError, InputError, ShapeError
from volspec.raycast import CoefficientImage
from volspec.scene import viewing_of


@pytest.fixture(scope="module")
def image() -> CoefficientImage:
    rng = np.random.default_rng(4)
    basis = SpectralBasis.load("general-7")
    coefficients = rng.normal(size=(12, 9, 7)).astype(np.float32)
    alpha = rng.uniform(size=(12, 9)).astype(np.float32)
    depth = np.where(alpha > 0.5, alpha * 100, np.inf).astype(np.float32)
    return CoefficientImage(coefficients, alpha, depth, basis, {"volume": "noise"})


def test_save_and_load_give_the_same_numbers(image: CoefficientImage, tmp_path: Path) -> None:
    image.save(tmp_path / "deep" / "image.exr")
    again = CoefficientImage.load(tmp_path / "deep" / "image.exr")
    assert np.array_equal(again.coefficients, image.coefficients)
    assert np.array_equal(again.alpha, image.alpha)
    assert np.array_equal(again.depth_mm, image.depth_mm)
    assert again.basis.fingerprint == image.basis.fingerprint and again.notes == image.notes
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["image.exr"]


def test_channels_are_named_and_the_basis_is_in_the_header(
    image: CoefficientImage, tmp_path: Path
) -> None:
    image.save(tmp_path / "image.exr")
    with OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {f"coefficients.{k:02d}" for k in range(7)} | {"A", "Z"}
        assert json.loads(file.header()["volspec:basis"])["name"] == "general-7"


def edited(path: Path, change: object) -> None:
    """Rewrite a file's header after ``change(header)``."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    header.pop("channels")
    change(header, channels)  # type: ignore[operator]
    OpenEXR.File(header, channels).write(str(path))


def other_basis_version(header: dict, channels: dict) -> None:
    basis = json.loads(header["volspec:basis"])
    basis["version"] = 99
    header["volspec:basis"] = json.dumps(basis)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (other_basis_version, "basis is refused.*version.*render again"),
        (lambda h, c: h.update({"volspec:format": 2}), "format 2, this volspec reads 1"),
        (lambda h, c: h.pop("volspec:basis"), "not a coefficient image"),
        (lambda h, c: h.update({"volspec:basis": "{"}), "basis is refused"),
        (lambda h, c: c.pop("coefficients.03"), "'coefficients.03' is missing"),
    ],
)
def test_images_of_another_making_are_refused(
    image: CoefficientImage, tmp_path: Path, change: object, message: str
) -> None:
    path = tmp_path / "image.exr"
    image.save(path)
    edited(path, change)
    with pytest.raises(ImageError, match=message) as caught:
        CoefficientImage.load(path)
    assert "image.exr" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("note", ["garbage", '{"model": 3}', '{"newkey": 3}', "[1]"])
def test_a_viewing_note_that_cannot_be_read_is_told_in_one_line(
    image: CoefficientImage, note: str
) -> None:
    noted = dataclasses.replace(image, notes={"viewing": note})
    with pytest.raises(ImageError, match="viewing note cannot be read") as caught:
        viewing_of(noted)
    assert "\n" not in str(caught.value)


def test_notes_that_are_no_table_are_refused(image: CoefficientImage, tmp_path: Path) -> None:
    image.save(tmp_path / "image.exr")
    edited(tmp_path / "image.exr", lambda h, c: h.update({"volspec:notes": "5"}))
    with pytest.raises(ImageError, match=r"image\.exr"):
        CoefficientImage.load(tmp_path / "image.exr")


def test_missing_truncated_and_foreign_files_are_refused(
    image: CoefficientImage, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "image.exr"
    with pytest.raises(ImageError, match="no such file"):
        CoefficientImage.load(path)
    image.save(path)
    content = path.read_bytes()
    for broken in (b"", b"hello" * 50, content[:200], content[: len(content) * 3 // 4]):
        path.write_bytes(broken)
        with pytest.raises(ImageError, match=r"image\.exr"):
            CoefficientImage.load(path)
    assert capfd.readouterr().err == ""


def test_arrays_must_belong_together(image: CoefficientImage) -> None:
    with pytest.raises(ShapeError, match="7 channels; expected"):
        CoefficientImage(image.coefficients[..., :5], image.alpha, image.depth_mm, image.basis)
    with pytest.raises(ShapeError, match="alpha has shape"):
        CoefficientImage(image.coefficients, image.alpha[:3], image.depth_mm, image.basis)


def test_a_failed_write_leaves_what_was_there(image: CoefficientImage, tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    path.write_text("precious")
    with pytest.raises(RuntimeError), write_whole(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError("disk full")
    assert path.read_text() == "precious" and [p.name for p in tmp_path.iterdir()] == ["image.exr"]
    with pytest.raises(ImageError, match=r"name it \.exr"):
        image.save(tmp_path / "image.tif")
    (tmp_path / "folder.exr").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        image.save(tmp_path / "folder.exr")
    with pytest.raises(InputError, match="cannot write there"):
        image.save(path / "below" / "image.exr")


def test_links_are_followed_and_devices_left_alone(tmp_path: Path) -> None:
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    link.symlink_to(target)
    with write_whole(link) as temporary:
        temporary.write_text("here")
    assert link.is_symlink() and target.read_text() == "here"
    wrong = (("/dev/null", "is not a file"), (tmp_path, "is a folder"), (None, "is no path"))
    for path, message in wrong:
        with pytest.raises(InputError, match=message), write_whole(path):  # type: ignore[arg-type]
            raise AssertionError("nothing may be written")
    assert Path("/dev/null").is_char_device()
