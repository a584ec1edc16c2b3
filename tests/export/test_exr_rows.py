"""OpenEXR files written row by row, as OpenEXR's own library reads them."""

import resource
from itertools import count
from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import OpenEXR
import pytest

from tests.export._layers import opened
from tests.support.errors import raises
from tests.support.patience import PATIENCE_S
from volspec._exr import write_exr
from volspec.appearance.display.spaces import SPACES
from volspec.errors import ImageError, InputError
from volspec.export import exr
from volspec.export.exr import ExrBands, ExrHeader, ExrWriter
from volspec.export.frames import encode, row_file

BANDS = ExrBands(np.array([400.0, 547.5, 1000.0]), "W")
TEXT = {"Title": 'é \u202e "x"', "relight": "a\nb"}


def exr_bytes(pixels: np.ndarray, header: ExrHeader) -> bytes:
    return encode(pixels, lambda file: ExrWriter(file, header))


def exr_file(path: Path, header: ExrHeader, threads: int = 2) -> Any:
    return row_file(path, lambda file: ExrWriter(file, header, threads))


def picture(size: tuple[int, int], channels: int, noise: bool) -> np.ndarray:
    shape = (*size[::-1], channels)
    if noise:  # which ZIP makes no smaller
        return np.random.default_rng(1).integers(0, 0x7C00, shape, np.uint16).view(np.float16)
    ramp = np.add.outer(np.arange(size[1]), np.arange(size[0] * channels))
    return ramp.reshape(shape) / np.float32(7)


@pytest.mark.parametrize("noise", [False, True])
@pytest.mark.parametrize("bands", [None, BANDS])
@pytest.mark.parametrize("has_alpha", [False, True])
@pytest.mark.parametrize("size", [(1, 1), (5, 37), (33, 16)])
def test_every_half_is_read_back(size, has_alpha, bands, noise, tmp_path):
    header = ExrHeader(size, SPACES["sRGB"], TEXT, has_alpha, bands)
    pixels = picture(size, len(header.channels), noise)
    (tmp_path / "a.exr").write_bytes(exr_bytes(pixels, header))
    said, channels = opened(tmp_path / "a.exr")
    assert set(channels) == set(header.channels)
    for k, name in enumerate(header.channels):
        assert channels[name].dtype == np.float16
        assert np.array_equal(channels[name], pixels[..., k].astype(np.float16)), name
    assert {name: said[f"volspec:{name}"] for name in TEXT} == TEXT
    sRGB = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329)
    assert said["chromaticities"] == pytest.approx(sRGB)
    assert said.get("emissiveUnits") == (None if bands is None else "W")


def test_rows_may_come_in_any_pieces(tmp_path):
    header = ExrHeader((6, 50), SPACES["sRGB"])
    pixels = picture((6, 50), 3, noise=False)
    with exr_file(tmp_path / "a.exr", header) as file:
        for part in np.split(pixels, [1, 18, 19, 48]):
            file.rows(part)
    assert (tmp_path / "a.exr").read_bytes() == exr_bytes(pixels, header)


def test_blocks_stand_in_their_order_whichever_is_packed_first(tmp_path, monkeypatch):
    header = ExrHeader((8, 160), SPACES["sRGB"])
    pixels = picture((8, 160), 3, noise=False)
    whole, packed = exr_bytes(pixels, header), exr._compress_block
    calls, others = count(), Event()

    def first_is_last(plain: bytes) -> bytes:
        if next(calls) == 0:
            assert others.wait(PATIENCE_S)
        else:
            others.set()
        return packed(plain)

    monkeypatch.setattr(exr, "_compress_block", first_is_last)
    with exr_file(tmp_path / "a.exr", header, threads=4) as file:
        file.rows(pixels)
    assert (tmp_path / "a.exr").read_bytes() == whole


def test_what_no_half_can_hold_is_the_largest_and_nan_is_black(tmp_path):
    header = ExrHeader((4, 1), SPACES["sRGB"])
    pixels = np.repeat(np.array([[np.inf, -1e9, np.nan, 0.5]]), 3, axis=0).T[None]
    (tmp_path / "a.exr").write_bytes(exr_bytes(pixels, header))
    assert opened(tmp_path / "a.exr")[1]["G"].tolist() == [[65504, -65504, 0, 0.5]]


def test_a_disk_without_room_for_an_image_is_named_as_by_other_writers(tmp_path, monkeypatch):
    def full(file: object, path: str) -> None:
        raise RuntimeError(f'Failed to write "{path}". No space left on device.')

    monkeypatch.setattr(OpenEXR.File, "write", full)
    with raises(InputError, "unwritable") as caught:
        write_exr(tmp_path / "a.exr", {}, {"R": np.ones((2, 2))}, ImageError)
    assert "make room" in str(caught.value) and ".part" not in str(caught.value)


def test_a_disk_that_fills_up_amid_the_rows_leaves_what_was_there(tmp_path):
    path = tmp_path / "a.exr"
    path.write_text("before")
    header = ExrHeader((64, 50), SPACES["sRGB"])
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))  # as if it were full there
    try:
        with raises(InputError, "unwritable"), exr_file(path, header) as file:
            file.rows(picture((64, 50), 3, noise=True))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [each.name for each in tmp_path.iterdir()] == ["a.exr"] and path.read_text() == "before"
