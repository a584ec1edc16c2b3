"""OME-Zarr folders: levels, channels, scales in millimetres, and what is refused."""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from tests.support.errors import raises, warns
from tests.support.volumes import load_silently
from volspec.errors import DeviceError, VolumeError
from volspec.volume import load_series, load_volume
from volspec.volume.files.query import Query
from volspec.volume.load import read_here

VALUES = np.arange(4 * 6 * 8, dtype=np.uint16).reshape(4, 6, 8)
TWO = np.stack([VALUES, VALUES + 1])
SPACE = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]
CHANNEL = {"name": "c", "type": "channel"}
TIME = {"name": "t", "type": "time", "unit": "second"}


def write(
    path: Path,
    values: np.ndarray = VALUES,
    axes: list[dict[str, str]] = SPACE,
    version: str = "0.5",
    change: dict[str, Any] | None = None,
) -> Path:
    """Two levels, the second of every other voxel; x and y 0.5, z 2 of the unit apart."""
    group = zarr.open_group(str(path), mode="w", zarr_format=2 if version == "0.4" else 3)
    names = [axis["name"] for axis in axes]
    datasets = []
    for level in (0, 1):
        step = 2**level
        every = tuple(slice(None, None, step if name in "zyx" else 1) for name in names)
        part = values[every]
        group.create_array(str(level), data=part, chunks=part.shape)
        scale = [{"z": 2.0, "y": 0.5, "x": 0.5}.get(name, 1.0) for name in names]
        wide = [s * step if name in "zyx" else s for s, name in zip(scale, names, strict=True)]
        steps = [{"type": "scale", "scale": wide}]
        datasets.append({"path": str(level), "coordinateTransformations": steps})
    picture = {"axes": axes, "datasets": datasets, "name": "cells"} | (change or {})
    stated = {"multiscales": [picture]}
    group.attrs.update(stated if version == "0.4" else {"ome": {"version": version, **stated}})
    return path


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_micrometres_become_millimetres(tmp_path, version):
    shift = [{"type": "translation", "translation": [10.0, 20.0, 30.0]}]
    change = {"coordinateTransformations": shift}
    volume = load_silently(write(tmp_path / "v.zarr", version=version, change=change))
    assert volume.values.dtype == np.uint16 and np.array_equal(volume.values, VALUES)
    assert volume.spacing_mm == pytest.approx((0.0005, 0.0005, 0.002))
    assert volume.world_from_index[:3, 3] == pytest.approx([0.03, 0.02, 0.01])


def test_a_level_is_chosen(tmp_path):
    path = write(tmp_path / "v.zarr")
    coarse = load_silently(f"{path}?level=1")
    assert np.array_equal(coarse.values, VALUES[::2, ::2, ::2])
    assert coarse.spacing_mm == pytest.approx((0.001, 0.001, 0.004))
    reading = read_here(Query.of(f"{path}?memory={VALUES.nbytes - 1}"))
    assert reading.values.shape == coarse.values.shape
    assert re.search(r"level 1 is read; .*v\.zarr\?level=0", reading.remarks[0])
    assert load_silently(f"{path}?level=0").shape_xyz == (8, 6, 4)


def test_a_channel_and_a_time_are_chosen_and_single_ones_dropped(tmp_path):
    path = write(tmp_path / "v.zarr", TWO[None], [TIME, CHANNEL, *SPACE])
    (other,) = load_silently(str(path)).fields
    assert np.array_equal(other.values, VALUES + 1)
    assert np.array_equal(load_silently(f"{path}?channel=1").values, VALUES + 1)


def test_times_are_a_series_with_all_channels(tmp_path):
    values = np.stack([[VALUES + 9 * t, VALUES // (t + 1)] for t in range(3)])
    path = write(tmp_path / "v.zarr", values, axes=[TIME, CHANNEL, *SPACE])
    series = load_series(path)
    assert len(series) == 3 and [len(step.fields) for step in series] == [1, 1, 1]
    for step, (one, two) in zip(series, values, strict=True):
        assert np.array_equal(step.values, one) and np.array_equal(step.fields[0].values, two)
    assert len(load_series(f"{path}?level=1&channel=0")[2].fields) == 0


def test_axes_in_another_order_are_turned(tmp_path):
    volume = load_silently(write(tmp_path / "v.zarr", VALUES.transpose(2, 1, 0), SPACE[::-1]))
    assert np.array_equal(volume.values, VALUES)
    assert volume.spacing_mm == pytest.approx((0.0005, 0.0005, 0.002))


def test_a_scale_without_a_unit_is_warned_about(tmp_path):
    path = write(tmp_path / "v.zarr", axes=[{"name": n, "type": "space"} for n in "zyx"])
    with warns("?spacing="):
        assert load_volume(path).spacing_mm == (0.5, 0.5, 2)
    assert load_silently(f"{path}?spacing=1,1,4").spacing_mm == (1, 1, 4)


def plate(path: Path) -> None:
    zarr.open_group(str(path), mode="w")
    write(path / "0")


def cut_chunk(path: Path) -> None:
    chunk = write(path) / "0" / "c" / "0" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-20])


def edit_ome(path: Path, **change: Any) -> None:
    group = zarr.open_group(str(path))
    group.attrs["ome"] = dict(group.attrs["ome"]) | change


def stated(**change: Any) -> Callable[[Path], Path]:
    return lambda path: write(path, change=change)


@pytest.mark.parametrize(
    ("make", "query", "code"),
    [
        (write, "?level=2", "range"),
        (lambda path: zarr.open_group(str(path), mode="w"), "", "unsupported"),
        (plate, "", "unsupported"),
        (lambda path: write(path, VALUES[0], SPACE[1:]), "", "shape"),
        (lambda path: write(path, TWO, [{"name": "angle"}, *SPACE]), "", "shape"),
        (cut_chunk, "", "damaged"),
        (lambda path: (write(path) / "zarr.json").write_text("{"), "", "damaged"),
        (stated(axes=[{"type": "space"}, *SPACE[1:]]), "", "damaged"),
        (stated(axes=[{"name": "t"}, *SPACE]), "", "damaged"),
        (stated(coordinateTransformations=[{"type": "scale", "scale": [2.0]}]), "", "damaged"),
        (stated(coordinateTransformations=[{"type": "affine", "affine": []}]), "", "damaged"),
    ],
)
def test_what_is_no_picture_is_refused(tmp_path, make, query, code):
    make(tmp_path / "v.zarr")
    with raises(VolumeError, code):
        load_volume(f"{tmp_path}/v.zarr{query}")


def test_without_zarr_it_is_refused(tmp_path, monkeypatch):
    path = write(tmp_path / "v.zarr")
    monkeypatch.setitem(sys.modules, "zarr", None)
    with raises(DeviceError, "unsupported"):
        read_here(Query.of(str(path)))
