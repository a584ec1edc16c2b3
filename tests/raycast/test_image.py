"""Coefficient images on disk: the same numbers back, or refused."""

import dataclasses
import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest

from tests.support.errors import raises, refuses
from tests.support.raycasts import edit_exr
from volspec._files import write_whole
from volspec.basis import SpectralBasis
from volspec.errors import ImageError
from volspec.image import CoefficientImage
from volspec.scene import stored_relight_spec


@pytest.fixture(scope="module")
def image() -> CoefficientImage:
    rng = np.random.default_rng(4)
    basis = SpectralBasis.load("general-7")
    coefficients = rng.normal(size=(12, 9, 7)).astype(np.float32)
    alpha = rng.uniform(size=(12, 9)).astype(np.float32)
    depth = np.where(alpha > 0.5, alpha * 100, np.inf).astype(np.float32)
    return CoefficientImage(coefficients, alpha, depth, basis, {"volume": "noise"})


def test_save_and_load_give_the_same_numbers(image, tmp_path):
    path = tmp_path / "deep" / "image.exr"
    image.save(path)
    again = CoefficientImage.load(path)
    for name in ("coefficients", "alpha", "depth_mm"):
        assert np.array_equal(getattr(again, name), getattr(image, name))
    assert again.basis.fingerprint == image.basis.fingerprint and again.notes == image.notes
    assert list(path.parent.iterdir()) == [path]


def edited(change: Callable[[dict[str, Any], dict[str, Any]], object]) -> Callable[[Path], None]:
    return lambda path: edit_exr(path, change)


def header(**texts: object) -> Callable[[Path], None]:
    """Return an edit that writes texts of ours into a header; None leaves one out."""

    def change(head: dict[str, Any], _: object) -> None:
        for name, text in texts.items():
            head[f"volspec:{name}"] = text
            if text is None:
                del head[f"volspec:{name}"]

    return edited(change)


def other_basis_version(head: dict[str, Any], _: object) -> None:
    basis = json.loads(head["volspec:basis"])
    head["volspec:basis"] = json.dumps(basis | {"version": 99})


def with_integers(_: object, channels: dict[str, Any]) -> None:
    channels |= {name: v.astype(np.uint32) for name, v in channels.items() if "." in name}


def cut_off(part: float) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(path.read_bytes()[: int(part * path.stat().st_size)])


@pytest.mark.parametrize(
    ("damage", "code"),
    [
        (edited(other_basis_version), "damaged"),
        (header(format=4), "unsupported"),
        (header(basis=None), "unsupported"),
        (header(basis="{"), "damaged"),
        (edited(lambda h, c: c.pop("light.c03.V")), "damaged"),
        *((header(fov_deg=text), "damaged") for text in ("wide", '"wide"', "{", "200")),
        *((header(camera=text), "damaged") for text in ('{"position_mm": 3}', '"left"', "{")),
        (header(notes="5"), "damaged"),
        *((header(groups=text), "damaged") for text in (None, '{"key": 2}', '["key"]')),
        (header(groups='{"key": 0.5, "fill": 0.5}'), "damaged"),
        (edited(lambda h, c: c["A"].__isub__(0.5)), "damaged"),
        (edited(lambda h, c: c["A"].__imul__(3)), "damaged"),
        (edited(with_integers), "damaged"),
        (Path.unlink, "not-found"),
        (lambda path: path.write_bytes(b"hello" * 50), "damaged"),
        *((cut_off(part), "damaged") for part in (0.0, 0.1, 0.75)),
    ],
)
def test_files_of_another_making_are_refused(image, tmp_path, capfd, damage, code):
    """The reader's own complaints do not reach the terminal."""
    path = tmp_path / "image.exr"
    image.save(path)
    damage(path)
    with raises(ImageError, code) as caught:
        CoefficientImage.load(path)
    assert path.name in str(caught.value) and capfd.readouterr().err == ""


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
def test_light_groups_come_back_under_their_own_names(image, tmp_path, kind):
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


def test_light_groups_are_layers_of_the_file(image, tmp_path):
    grouped(image, np.float16).save(tmp_path / "image.exr")
    with OpenEXR.File(str(tmp_path / "image.exr"), separate_channels=True) as file:
        channels = {name: channel.pixels.dtype for name, channel in file.channels().items()}
        assert json.loads(file.header()["volspec:groups"]) == ODD
    halves = {f"{layer}.c{k:02d}.V": np.float16 for layer in LAYERS for k in range(7)}
    assert channels == halves | dict.fromkeys(("A", "Z", "first.Z"), np.float32)
    assert max(map(len, channels)) < 64


def test_a_preview_and_texts_are_saved_for_others(image, tmp_path):
    path = tmp_path / "image.exr"
    image.save(path, np.full((12, 9, 3), (0.25, -0.5, np.nan)), {"hint": "paste me"})
    # Without separate_channels R, G, B and A are joined, if they are of one type.
    with OpenEXR.File(str(path)) as file:
        pixels, header = file.channels()["RGBA"].pixels, dict(file.header())
    assert header["volspec:hint"] == "paste me" and "chromaticities" in header
    assert pixels[0, 0, :3].tolist() == [0.25, -0.5, 0], "NaN is black"
    assert np.array_equal(pixels[..., 3], image.alpha)
    assert np.array_equal(CoefficientImage.load(path).coefficients, image.coefficients)


def test_a_compositor_s_rounding_of_opacity_is_clipped(image, tmp_path):
    alpha = image.alpha.copy()
    alpha[0, :2] = -5e-4, 1 + 5e-4
    dataclasses.replace(image, alpha=alpha).save(tmp_path / "image.exr")
    again = CoefficientImage.load(tmp_path / "image.exr").alpha
    assert again[0, :2].tolist() == [0, 1]
    assert np.array_equal(again[1:], alpha[1:])


def test_a_layer_is_a_view_of_its_group_s_channels(image):
    made = grouped(image)
    for k, name in enumerate(ODD):
        layer = made.layer(name)
        assert layer.shape == (12, 9, 7) and np.shares_memory(layer, made.coefficients)
        assert np.array_equal(layer, made.coefficients[..., 7 * k : 7 * k + 7])
    assert "9x12" in repr(image) and ", ".join(ODD) in repr(made)


IMAGE = "coefficient image: "


def changed(**change: object) -> Callable[[CoefficientImage, Path], object]:
    return lambda image, _: dataclasses.replace(image, **change)


def noted(text: str) -> Callable[[CoefficientImage, Path], object]:
    return lambda image, _: stored_relight_spec(dataclasses.replace(image, notes={"viewing": text}))


def write(path: Any) -> None:
    with write_whole(path):
        raise AssertionError("nothing may be written")


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (changed(groups={"key": 0.5, "fill": 0.4}), f"range {IMAGE}groups"),
        (changed(groups={"key": 1.5, "fill": -0.5}), f"range {IMAGE}groups['key']"),
        (changed(groups={"fill": -0.5, "key": 1.5}), f"range {IMAGE}groups['fill']"),
        (changed(groups={"key": float("nan")}), f"range {IMAGE}groups['key']"),
        (changed(groups={"key": True}), f"range {IMAGE}groups['key']"),
        (changed(groups={}), f"missing {IMAGE}groups"),
        (changed(groups=("key",)), f"missing {IMAGE}groups"),
        (changed(groups={" ": 1.0}), f"type {IMAGE}name of a group"),
        (changed(groups={3: 1.0}), f"type {IMAGE}name of a group"),
        (changed(groups={"a": 0.5, "b": 0.5}), f"shape {IMAGE}coefficients"),
        (changed(coefficients=np.zeros((12, 9, 5), np.float32)), f"shape {IMAGE}coefficients"),
        (changed(coefficients=np.zeros((12, 9, 7))), f"type {IMAGE}coefficients"),
        (changed(coefficients=np.zeros((12, 9, 7)).tolist()), f"type {IMAGE}coefficients"),
        (changed(first_mm=np.zeros((9, 12), np.float32)), f"shape {IMAGE}first_mm"),
        (changed(alpha=np.zeros((3, 9), np.float32)), f"shape {IMAGE}alpha"),
        *((noted(t), "damaged ") for t in ("garbage", '{"model": 3}', '{"newkey": 3}', "[1]")),
        (lambda image, _: image.layer("key"), "unknown "),
        (lambda image, path: image.save(path, np.zeros((9, 12, 3))), "shape "),
        # Which would no longer be read, or be another's.
        (lambda image, path: image.save(path, texts={"basis": "mine"}), "duplicate "),
        (lambda image, path: image.save(path, texts={"fov_deg": "mine"}), "duplicate "),
        (lambda image, path: image.save(path.with_suffix(".tif")), "unsupported "),
        (lambda image, path: image.save(path / "below" / "image.exr"), "unwritable "),
        (lambda image, path: image.save(path.with_name("folder.exr")), "unwritable "),
        (lambda image, path: write(path.with_name("folder.exr")), "unwritable "),
        (lambda image, path: write("/dev/null"), "unwritable "),
        (lambda image, path: write(None), "type "),
    ],
)
def test_what_no_cast_leaves_and_no_file_takes_is_refused(image, tmp_path, make, fault):
    path = tmp_path / "image.exr"
    path.write_text("precious")
    (tmp_path / "folder.exr").mkdir()
    refuses(lambda: make(image, path), fault)
    assert path.read_text() == "precious" and len([*tmp_path.rglob("*")]) == 2
    assert Path("/dev/null").is_char_device()


def test_a_failed_write_leaves_what_was_there_and_links_are_followed(tmp_path):
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    link.symlink_to(target)
    with write_whole(link) as temporary:
        temporary.write_text("here")
    with suppress(RuntimeError), write_whole(link) as temporary:
        temporary.write_text("half")
        raise RuntimeError("disk full")
    assert link.is_symlink() and target.read_text() == "here"
    assert sorted(tmp_path.iterdir()) == [link, target]
