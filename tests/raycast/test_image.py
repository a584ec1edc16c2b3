"""Coefficient images on disk: the same numbers back, or refused."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from urllib.parse import quote

import numpy as np
import OpenEXR
import pytest

from tests.support.errors import raises
from volspec._exr import write_exr
from volspec._files import write_whole
from volspec.basis import SpectralBasis
from volspec.errors import ImageError, InputError, ShapeError
from volspec.raycast import CoefficientImage
from volspec.scene import stored_relight_spec


@pytest.fixture(scope="module")
def image() -> CoefficientImage:
    rng = np.random.default_rng(4)
    basis = SpectralBasis.load("general-7")
    coefficients = rng.normal(size=(12, 9, 7)).astype(np.float32)
    alpha = rng.uniform(size=(12, 9)).astype(np.float32)
    depth = np.where(alpha > 0.5, alpha * 100, np.inf).astype(np.float32)
    return CoefficientImage(coefficients, alpha, depth, basis, {"volume": "noise"})


def test_save_and_load_give_the_same_numbers(image: CoefficientImage, tmp_path: Path) -> None:
    path = tmp_path / "deep" / "image.exr"
    image.save(path)
    again = CoefficientImage.load(path)
    assert np.array_equal(again.coefficients, image.coefficients)
    assert np.array_equal(again.alpha, image.alpha)
    assert np.array_equal(again.depth_mm, image.depth_mm)
    assert again.basis.fingerprint == image.basis.fingerprint and again.notes == image.notes
    assert list(path.parent.iterdir()) == [path]


def test_channels_are_named_and_the_basis_is_in_the_header(
    image: CoefficientImage, tmp_path: Path
) -> None:
    image.save(tmp_path / "image.exr")
    with OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True) as file:
        assert set(file.channels()) == {f"light.c{k:02d}.V" for k in range(7)} | {"A", "Z"}
        assert json.loads(file.header()["volspec:basis"])["name"] == image.basis.name


def edited(path: Path, change: object) -> None:
    """Rewrite a file's header after ``change(header)``."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        header = dict(file.header())
        channels = {name: np.array(channel.pixels) for name, channel in file.channels().items()}
    header.pop("channels")
    change(header, channels)
    OpenEXR.File(header, channels).write(str(path))


def other_basis_version(header: dict, channels: dict) -> None:
    basis = json.loads(header["volspec:basis"])
    basis["version"] = 99
    header["volspec:basis"] = json.dumps(basis)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (other_basis_version, "basis"),
        (lambda h, c: h.update({"volspec:format": 4}), "format 4"),
        (lambda h, c: h.pop("volspec:basis"), "--basis"),
        (lambda h, c: h.update({"volspec:basis": "{"}), "basis"),
        (lambda h, c: c.pop("light.c03.V"), "'light.c03.V'"),
        (lambda h, c: h.update({"volspec:fov_deg": "wide"}), "fov_deg"),
        (lambda h, c: h.update({"volspec:notes": "5"}), "basis"),
        (lambda h, c: h.pop("volspec:groups"), "light groups"),
        (lambda h, c: h.update({"volspec:groups": '{"key": 2}'}), "groups['key']"),
        (lambda h, c: h.update({"volspec:groups": '["key"]'}), "light groups"),
        (lambda h, c: h.update({"volspec:groups": '{"key": 0.5, "fill": 0.5}'}), "'key.c00.V'"),
        (lambda h, c: c["A"].__isub__(0.5), "'A' runs from -0.4"),
        (lambda h, c: c["A"].__imul__(3), "'A' runs from 0"),
        (
            lambda h, c: c.update({k: v.astype(np.uint32) for k, v in c.items() if "." in k}),
            "uint32",
        ),
    ],
)
def test_images_of_another_making_are_refused(
    image: CoefficientImage, tmp_path: Path, change: object, part: str
) -> None:
    path = tmp_path / "image.exr"
    image.save(path)
    edited(path, change)
    code = "unsupported" if part in ("format 4", "--basis") else "damaged"
    with raises(ImageError, code) as caught:
        CoefficientImage.load(path)
    assert path.name in str(caught.value) and part in str(caught.value)


ODD = {
    "key.left": 0.5,
    'fill "light" ~ 50 %': 0.25,
    "%2E": 0.125,
    "Lücke": 0.0625,
    "a-b_c" * 40: 0.03125,
    "KEY LEFT": 0.015625,
    "光": 0.0078125,
    "3": 0.0078125,
}
# Nuke keeps letters, digits and _ of a name; Blender truncates it to 63.
LAYERS = (*("key_left", "fill_light_50", "g2E", "Lucke", "a_b_c" * 8), *("KEY_LEFT_2", "g", "g3"))


def grouped(image: CoefficientImage, kind: type = np.float32) -> CoefficientImage:
    """Light groups with names that OpenEXR or a layer's name could trip over."""
    layers = np.concatenate([share * image.coefficients for share in ODD.values()], axis=-1)
    first = np.where(image.alpha > 0.7, image.depth_mm / 2, np.inf).astype(np.float32)
    return dataclasses.replace(image, coefficients=layers.astype(kind), groups=ODD, first_mm=first)


@pytest.mark.parametrize("kind", [np.float32, np.float16])
def test_light_groups_come_back_under_their_own_names(
    image: CoefficientImage, tmp_path: Path, kind: type
) -> None:
    made = grouped(image, kind)
    made.save(tmp_path / "image.exr")
    again = CoefficientImage.load(tmp_path / "image.exr")
    assert type(again.groups) is dict and list(again.groups.items()) == list(ODD.items())
    assert again.coefficients.dtype == kind
    assert np.array_equal(again.coefficients, made.coefficients)
    assert again.alpha.dtype == again.depth_mm.dtype == np.float32
    assert np.array_equal(again.first_mm, made.first_mm)
    for name in ODD:
        assert np.array_equal(again.layer(name), made.layer(name))


def test_light_groups_are_layers_of_the_file(image: CoefficientImage, tmp_path: Path) -> None:
    grouped(image, np.float16).save(tmp_path / "image.exr")
    with OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels.dtype for name, channel in file.channels().items()}
        assert json.loads(file.header()["volspec:groups"]) == ODD
    halves = {f"{layer}.c{k:02d}.V": np.float16 for layer in LAYERS for k in range(7)}
    assert channels == halves | dict.fromkeys(("A", "Z", "first.Z"), np.float32)
    assert max(map(len, channels)) < 64


def old_file(image: CoefficientImage, path: Path, header: dict, layers: list[str]) -> None:
    """Write an image as before format 3."""
    names = [f"{layer}coefficients.{k:02d}" for layer in layers for k in range(7)]
    channels = {name: image.coefficients[..., k] for k, name in enumerate(names)}
    channels |= {"A": image.alpha, "Z": image.depth_mm}
    if image.first_mm is not None:
        channels["ZFirst"] = image.first_mm
    header = {"volspec:basis": json.dumps(image.basis.to_dict()), **header}
    write_exr(path, header, channels, ImageError)


def test_images_of_format_1_have_one_light_group(image: CoefficientImage, tmp_path: Path) -> None:
    old_file(image, tmp_path / "old.exr", {"volspec:format": 1}, [""])
    again = CoefficientImage.load(tmp_path / "old.exr")
    assert again.groups == {"light": 1.0} and again.first_mm is None
    assert np.array_equal(again.coefficients, image.coefficients)
    assert np.array_equal(again.layer("light"), image.coefficients)


def test_images_of_format_2_load_with_their_groups(image: CoefficientImage, tmp_path: Path) -> None:
    made = grouped(image)
    header = {"volspec:format": 2, "volspec:groups": json.dumps(ODD), "volspec:fov_deg": "30.0"}
    encoded = [quote(name, safe="").replace(".", "%2E").replace("~", "%7E") for name in ODD]
    old_file(made, tmp_path / "old.exr", header, [f"{layer}." for layer in encoded])
    again = CoefficientImage.load(tmp_path / "old.exr")
    assert list(again.groups.items()) == list(ODD.items()) and again.fov_deg == 30
    assert np.array_equal(again.coefficients, made.coefficients)
    assert np.array_equal(again.first_mm, made.first_mm)
    one = {"volspec:format": 2, "volspec:groups": '{"key": 1.0}'}
    old_file(image, tmp_path / "one.exr", one, [""])
    assert CoefficientImage.load(tmp_path / "one.exr").groups == {"key": 1.0}


def test_a_preview_and_texts_are_saved_for_others(image: CoefficientImage, tmp_path: Path) -> None:
    preview = np.full((12, 9, 3), (0.25, -0.5, np.nan))
    path, hint = tmp_path / "image.exr", "paste me"
    image.save(path, preview, {"hint": hint})
    # Without separate_channels R, G, B and A are joined, if they are of one type.
    with OpenEXR.File(str(path)) as file:
        pixels = file.channels()["RGBA"].pixels
        header = dict(file.header())
    assert header["volspec:hint"] == hint and "chromaticities" in header
    assert pixels[0, 0, :3].tolist() == [0.25, -0.5, 0], "NaN is black"
    assert np.array_equal(pixels[..., 3], image.alpha)
    assert np.array_equal(CoefficientImage.load(path).coefficients, image.coefficients)
    with raises(ShapeError, "shape"):
        image.save(path, preview.swapaxes(0, 1))
    before = path.read_bytes()
    for own in ("basis", "fov_deg"):  # which would no longer be read, or be another's
        with raises(ImageError, "duplicate"):
            image.save(path, texts={own: "mine"})
    assert path.read_bytes() == before


def test_a_compositor_s_rounding_of_opacity_is_clipped(
    image: CoefficientImage, tmp_path: Path
) -> None:
    alpha = image.alpha.copy()
    alpha[0, :2] = -5e-4, 1 + 5e-4
    dataclasses.replace(image, alpha=alpha).save(tmp_path / "image.exr")
    again = CoefficientImage.load(tmp_path / "image.exr").alpha
    assert again[0, :2].tolist() == [0, 1]
    assert np.array_equal(again[1:], alpha[1:])


def test_a_layer_is_a_view_of_its_group_s_channels(image: CoefficientImage) -> None:
    made = grouped(image)
    for k, name in enumerate(ODD):
        layer = made.layer(name)
        assert layer.shape == (12, 9, 7) and np.shares_memory(layer, made.coefficients)
        assert np.array_equal(layer, made.coefficients[..., 7 * k : 7 * k + 7])
    assert "9x12" in repr(image) and ", ".join(ODD) in repr(made)
    with raises(ImageError, "unknown"):
        made.layer("key")


@pytest.mark.parametrize(
    ("change", "code", "field"),
    [
        ({"groups": {"key": 0.5, "fill": 0.4}}, "range", "groups"),
        ({"groups": {"key": 1.5, "fill": -0.5}}, "range", "groups['key']"),
        ({"groups": {"fill": -0.5, "key": 1.5}}, "range", "groups['fill']"),
        ({"groups": {"key": float("nan")}}, "range", "groups['key']"),
        ({"groups": {"key": "much"}}, "range", "groups['key']"),
        ({"groups": {"key": True}}, "range", "groups['key']"),
        ({"groups": {}}, "missing", "groups"),
        ({"groups": ("key",)}, "missing", "groups"),
        ({"groups": {" ": 1.0}}, "type", "name of a group"),
        ({"groups": {3: 1.0}}, "type", "name of a group"),
        ({"groups": {"a": 0.5, "b": 0.5}}, "shape", "coefficients"),
        ({"coefficients": np.zeros((12, 9, 5), np.float32)}, "shape", "coefficients"),
        ({"coefficients": np.zeros((12, 9, 7))}, "type", "coefficients"),
        ({"coefficients": np.zeros((12, 9, 7)).tolist()}, "type", "coefficients"),
        ({"first_mm": np.zeros((9, 12), np.float32)}, "shape", "first_mm"),
        ({"alpha": np.zeros((3, 9), np.float32)}, "shape", "alpha"),
    ],
)
def test_groups_and_arrays_that_no_cast_leaves_are_refused(
    image: CoefficientImage, change: dict, code: str, field: str
) -> None:
    expected = ShapeError if code == "shape" else ImageError
    with raises(expected, code, f"coefficient image: {field}"):
        dataclasses.replace(image, **change)


@pytest.mark.parametrize("note", ["garbage", '{"model": 3}', '{"newkey": 3}', "[1]"])
def test_a_viewing_note_that_cannot_be_read_is_refused(image: CoefficientImage, note: str) -> None:
    noted = dataclasses.replace(image, notes={"viewing": note})
    with raises(ImageError):
        stored_relight_spec(noted)


def test_missing_truncated_and_foreign_files_are_refused(
    image: CoefficientImage, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "image.exr"
    with raises(ImageError):
        CoefficientImage.load(path)
    image.save(path)
    content = path.read_bytes()
    for broken in (b"", b"hello" * 50, content[:200], content[: len(content) * 3 // 4]):
        path.write_bytes(broken)
        with raises(ImageError) as caught:
            CoefficientImage.load(path)
        assert path.name in str(caught.value)
    assert capfd.readouterr().err == ""


def test_a_failed_write_leaves_what_was_there(image: CoefficientImage, tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    path.write_text("precious")
    with pytest.raises(RuntimeError), write_whole(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError("disk full")
    assert path.read_text() == "precious" and list(tmp_path.iterdir()) == [path]
    with raises(ImageError, "unsupported"):
        image.save(tmp_path / "image.tif")
    (tmp_path / "folder.exr").mkdir()
    for wrong in (tmp_path / "folder.exr", path / "below" / "image.exr"):
        with raises(InputError, "unwritable"):
            image.save(wrong)


def test_links_are_followed_and_devices_left_alone(tmp_path: Path) -> None:
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    link.symlink_to(target)
    with write_whole(link) as temporary:
        temporary.write_text("here")
    assert link.is_symlink() and target.read_text() == "here"
    for path, code in (("/dev/null", "unwritable"), (tmp_path, "unwritable"), (None, "type")):
        with raises(InputError, code), write_whole(path):
            raise AssertionError("nothing may be written")
    assert Path("/dev/null").is_char_device()
