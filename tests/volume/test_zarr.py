"""OME-Zarr, plain Zarr and N5 folders: levels, channels, scales, and what is refused."""

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tensorstore
import zarr

from tests.support.errors import advised_address, raises, warns
from tests.support.patience import in_fork
from tests.support.volumes import load_silently
from volspec.errors import DeviceError, VolumeError
from volspec.large.conversion import convert
from volspec.volume import Volume, load_series, load_volume, volume_choices
from volspec.volume.files.query import Query
from volspec.volume.load import read_here
from volspec.volume.metadata import NO_SPACING, NO_UNIT, Metadata
from volspec.volume.out_of_memory import level_of

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
    assert volume.metadata.assumed == ()
    assert volume.values.dtype == np.uint16 and np.array_equal(volume.values, VALUES)
    assert volume.spacing_mm == pytest.approx((0.0005, 0.0005, 0.002))
    assert volume.world_from_index[:3, 3] == pytest.approx([0.03, 0.02, 0.01])


def test_a_fork_is_told_to_spawn(tmp_path):
    load_silently(path := write(tmp_path / "v.zarr"))
    error = in_fork(lambda: load_silently(path))
    assert (type(error), error.code) == (DeviceError, "state") and "'spawn'" in error.remedy


def test_a_level_is_chosen(tmp_path):
    path = write(tmp_path / "v.zarr")
    coarse = load_silently(f"{path}?level=1")
    assert np.array_equal(coarse.values, VALUES[::2, ::2, ::2])
    assert coarse.spacing_mm == pytest.approx((0.001, 0.001, 0.004))
    reading = read_here(Query.of(f"{path}?memory={VALUES.nbytes - 1}"))
    assert reading.values.shape == coarse.values.shape
    assert re.search(r"level 1 is read; .*v\.zarr\?level=0", reading.notes[0])
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
        volume = load_volume(path)
    assert volume.spacing_mm == (0.5, 0.5, 2) and volume.metadata.assumed == (NO_UNIT,)
    assert load_silently(f"{path}?spacing=1,1,4").spacing_mm == (1, 1, 4)
    edit_ome(path, multiscales=[{"axes": ["z", "y", "x"], "datasets": [{"path": "0"}]}])
    assert load_silently(path).metadata.assumed == (NO_SPACING,)


TURN = [[1.0, 0, 0], [0, 0.6, 0.8], [0, -0.8, 0.6]]
ROTATION = {"type": "rotation", "rotation": TURN}
AFFINE = {"type": "affine", "affine": [[*row, 0.0] for row in TURN]}


@pytest.mark.parametrize(
    "step", [ROTATION, AFFINE, {"type": "sequence", "transformations": [ROTATION]}]
)
def test_transformations_that_are_matrices_turn_the_axes(tmp_path, step):
    path = write(tmp_path / "v.zarr", change={"coordinateTransformations": [step]})
    world = load_silently(path).world_from_index
    turned = np.array([[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])  # along x, y, z
    assert np.allclose(world[:3, :3], turned * (5e-4, 5e-4, 2e-3))


def test_a_spacing_replaces_a_transformation_that_is_no_matrix(tmp_path):
    change = {"coordinateTransformations": [{"type": "displacements", "path": "field"}]}
    path = write(tmp_path / "v.zarr", change=change)
    with raises(VolumeError, "unsupported") as caught:
        load_volume(path)
    assert load_silently(advised_address(caught.value)).spacing_mm == (1, 1, 1)


@pytest.mark.parametrize("numbers", [[2.0], [0, 1, 1], [2, -0.7, 1], ["a", 1, 1], [2, np.nan, 1]])
def test_a_spacing_replaces_a_scale_that_is_none(tmp_path, numbers):
    steps = [{"type": "scale", "scale": numbers}]
    path = write(tmp_path / "v.zarr", change={"coordinateTransformations": steps})
    with raises(VolumeError, "damaged") as caught:
        load_volume(path)
    assert load_silently(advised_address(caught.value)).spacing_mm == (1, 1, 1)


def test_damaged_chunks_are_left_out_only_of_coarser_levels(tmp_path):
    cut_chunk(tmp_path / "v.zarr")
    with raises(VolumeError, "damaged") as caught:
        load_volume(tmp_path / "v.zarr")
    assert load_silently(advised_address(caught.value)).pyramid is not None
    with raises(VolumeError, "damaged") as caught:
        load_volume(f"{tmp_path / 'v.zarr'}?dataset=0")
    assert "?" not in caught.value.remedy


@pytest.mark.parametrize("form", [2, 3])
def test_arrays_without_a_picture_are_volumes(tmp_path, form):
    group = zarr.open_group(str(tmp_path / "v.zarr"), mode="w", zarr_format=form)
    for name, values in (("one", VALUES), ("in/two", TWO), ("short", VALUES[0])):
        group.create_array(name, data=values)
    (choice,) = volume_choices(tmp_path / "v.zarr")
    assert (choice.key, choice.values) == ("dataset", ("in/two", "one"))
    volume = load_silently(f"{tmp_path}/v.zarr?dataset=one")
    assert np.array_equal(volume.values, VALUES)
    assert volume.metadata.assumed == (NO_SPACING,)
    assert load_silently(f"{tmp_path}/v.zarr/one?spacing=1,2,3").metadata.assumed == ()
    (other,) = load_silently(f"{tmp_path}/v.zarr?dataset=in/two&axes=czyx").fields
    assert np.array_equal(other.values, VALUES + 1)


@pytest.mark.filterwarnings("ignore:.*more than memory may take")
@pytest.mark.parametrize("stated", [Metadata("CT", "HU", True, (NO_UNIT,)), Metadata(), None])
def test_what_a_store_states_is_the_same_in_memory_and_beyond(tmp_path, stated):
    """A conversion repeats what its source states; a store of another program has no patient."""
    values = np.arange(64**3, dtype=np.uint16).reshape((64,) * 3)
    path = tmp_path / "v.zarr"
    if stated is None:
        write(path, values)
    else:
        convert(level_of(Volume(values)), path, metadata=stated)
    whole, large = load_volume(path), load_volume(f"{path}?memory=300kB")
    assert (whole.pyramid is None, large.pyramid is None) == (True, False)
    assert whole.metadata == large.metadata == large.finest.metadata == (stated or Metadata())


def write_n5(path: Path, values: np.ndarray, **stated: Any) -> Path:
    """A dataset of N5 whose axes are (Z, Y, X)."""
    spec = {"driver": "n5", "kvstore": {"driver": "file", "path": f"{path}/"}}
    kind = {"dataType": str(values.dtype), "compression": {"type": "gzip"}}
    size = {"dimensions": values.shape[::-1], "blockSize": [4] * values.ndim}
    tensorstore.open(spec | {"metadata": size | kind}, create=True).result()[...] = values.T
    (path / "attributes.json").write_text(json.dumps(size | kind | stated))
    return path


UM = {"resolution": [0.5, 0.7, 2.0], "units": ["um"] * 3}
NM = {"pixelResolution": {"unit": "nm", "dimensions": [500, 700, 2000]}}


@pytest.mark.parametrize("stated", [UM, NM])
def test_n5_has_its_axes_fastest_first(tmp_path, stated):
    volume = load_silently(write_n5(tmp_path / "v.n5", VALUES, **stated))
    assert np.array_equal(volume.values, VALUES) and volume.metadata.assumed == ()
    assert volume.spacing_mm == pytest.approx((0.0005, 0.0007, 0.002))
    (other,) = load_silently(f"{write_n5(tmp_path / 'two', TWO)}?axes=xyzc").fields
    assert np.array_equal(other.values, VALUES + 1)


def test_the_finest_of_a_multiscale_n5_is_read_and_others_are_offered(tmp_path):
    write_n5(tmp_path / "v.n5/em/s0", VALUES)
    coarse = VALUES[::2, ::2, ::2]
    path = write_n5(tmp_path / "v.n5/em/s1", coarse, downsamplingFactors=[2, 2, 2], **NM)
    world = load_silently(path).world_from_index
    assert np.allclose(np.diag(world), (0.001, 0.0014, 0.004, 1))
    assert np.allclose(world[:3, 3], (0.00025, 0.00035, 0.001))
    (tmp_path / "v.n5/em/attributes.json").write_text(json.dumps(NM))
    fine = load_silently(tmp_path / "v.n5")
    assert fine.shape_xyz == (8, 6, 4)
    assert fine.spacing_mm == pytest.approx((0.0005, 0.0007, 0.002))
    write_n5(tmp_path / "v.n5/labels", VALUES)
    assert volume_choices(tmp_path / "v.n5")[0].values == ("em/s0", "labels")


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
        (lambda path: write(path, VALUES[:, 0], SPACE[:2]), "", "shape"),
        (lambda path: zarr.create_array(path, data=TWO), "", "shape"),
        (lambda path: zarr.create_array(path, data=VALUES[0, 0]), "", "shape"),
        (lambda path: zarr.create_array(path, data=VALUES), "?axes=zyy", "shape"),
        (lambda path: write(path, TWO, [{"name": "angle"}, *SPACE]), "", "shape"),
        (cut_chunk, "", "damaged"),
        (lambda path: (write(path) / "zarr.json").write_text("{"), "", "damaged"),
        (stated(axes=[{"type": "space"}, *SPACE[1:]]), "", "damaged"),
        (stated(axes=[{"name": "t"}, *SPACE]), "", "damaged"),
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
