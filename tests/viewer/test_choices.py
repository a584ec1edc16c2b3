"""Choices that an address leaves open, and guesses of the layout of raw bytes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.errors import refuses
from volspec.errors import ImageError, VolspecError, VolumeError
from volspec.viewer.model.choices import RawLayout, Undecided, address_with, guess_layouts
from volspec.viewer.work.documents import open_path
from volspec.volume import Choice, load_volume, phantom

SHAPE = (40, 64, 48)  # x, y, z


def blob(kind: str) -> bytes:
    """A smooth volume of square slices, as bytes of a type."""
    z, y, x = np.mgrid[0:40, 0:64, 0:64]
    far = ((x - 30) ** 2 + (y - 34) ** 2 + (z - 20) ** 2) / 500.0
    scaled = 200 * np.exp(-far) if kind == "u1" else 3000 * np.exp(-far) - 1000
    if kind.endswith("u2"):
        scaled += 1000
    return scaled.astype(kind).tobytes()


@pytest.mark.parametrize("kind", ["u1", "<u2", ">u2", "<i2", ">i2", "<f4", ">f4"])
def test_the_layout_of_raw_bytes_is_found_by_their_smoothness(kind: str, tmp_path: Path) -> None:
    data = blob(kind)
    middle = len(data) // 2 // 8 * 8
    guesses = guess_layouts("scan.raw", len(data), data[middle : middle + 65536])
    dtype = np.dtype(kind)
    assert guesses[0].shape == (64, 64, 40)
    same = [g for g in guesses[:2] if g.dtype == dtype.newbyteorder("=").name]
    assert same and (dtype.itemsize == 1 or same[0].order == ("big" if ">" in kind else "little"))
    # The address reads the same voxels.
    path = tmp_path / "scan.raw"
    path.write_bytes(data)
    volume = load_volume(address_with(str(path), same[0].options))
    np.testing.assert_allclose(volume.values.ravel(), np.frombuffer(data, kind), rtol=1e-6)


def test_a_name_that_states_the_shape_is_believed_if_the_size_agrees() -> None:
    voxels = 40 * 64 * 48
    (first, *_) = guess_layouts("ct_40x64x48_uint16.raw", 2 * voxels + 348, b"")
    assert (first.shape, first.dtype, first.offset) == (SHAPE, "uint16", 348)
    assert all(guess.shape != (1, 2, 3) for guess in guess_layouts("v1.2_1x2x3.raw", voxels, b""))
    assert guess_layouts("odd.raw", 10007, b"") == ()


def test_a_layout_is_compared_with_the_size_of_its_file() -> None:
    layout = RawLayout(SHAPE, "int16", "big", 8, (0.5, 0.5, 2.0))
    assert layout.nbytes == 2 * 40 * 64 * 48
    fits = [layout.check(layout.nbytes + 8 + more)[0] for more in (-1, 0, 1)]
    assert fits == [False, True, True]
    assert not RawLayout((0, 4, 4)).check(64)[0]
    assert address_with("a.raw", layout.options) == (
        "a.raw?shape=40x64x48&dtype=int16&spacing=0.5,0.5,2&order=big&offset=8"
    )


@pytest.mark.not_quick
def test_what_is_ambiguous_is_asked(tmp_path: Path) -> None:
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    ball = (phantom.ball(12).values * 1000).astype(np.uint16)
    several = tmp_path / "cells.ome.tif"
    stack = np.stack([np.stack([ball, 2 * ball])] * 3)
    notes = {"axes": "TCZYX", "Channel": {"Name": ["DAPI", "GFP"]}}
    notes |= {f"PhysicalSize{axis}": 1.0 for axis in "XYZ"}
    notes |= {f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"}
    tifffile.imwrite(several, stack, metadata=notes)
    found = open_path(str(several), None)
    document = found.state.document
    assert len(document.series) == 3 and document.choices == ()
    assert [look.name for look in found.state.fields] == ["", "GFP"]
    found = open_path(address_with(str(several), {"time": "1", "channel": "1"}), None)
    document = found.state.document
    assert {choice.key: choice.chosen for choice in document.choices} == {"channel": "1"}
    assert document.series is None
    raw = tmp_path / "scan.raw"
    raw.write_bytes(bytes(64))
    assert open_path(str(raw), None) == Undecided(str(raw), (Choice("shape", (), ()),))


@pytest.mark.parametrize(
    ("name", "kind"), [("x.raw?shape=9x9x9&dtype=uint8", VolumeError), ("x.exr", ImageError)]
)
def test_what_is_damaged_is_refused(tmp_path: Path, name: str, kind: type[VolspecError]) -> None:
    (tmp_path / name.partition("?")[0]).write_bytes(b"no picture")
    refuses(lambda: open_path(str(tmp_path / name), None), "damaged", kind)
