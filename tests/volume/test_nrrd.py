"""NRRD and MetaImage headers: axes, units, spaces and segments as the formats define them."""

import bz2
import gzip
from typing import Any

import numpy as np
import pytest

from tests.support.errors import raises, warns
from tests.support.volumes import META, RAW, VALUES, load_silently
from volspec.errors import VolumeError
from volspec.volume import Metadata, Volume, load_volume
from volspec.volume.metadata import NO_SPACING, NO_UNIT

SIZE = (1, 0.7, 0.5)
VECTORS = "space directions: (0.5,0,0) (0,0.7,0) (0,0,1)\nspace origin: (1,2,3)\n"
LPS = f"space: left-posterior-superior\n{VECTORS}"
MINS = "axis mins: 1 2 3\naxis maxs: 2.5 3.4 4\n"


def nrrd(fields: str, data: bytes = RAW, sizes: str = "4 3 2", kind: str = "short") -> bytes:
    count = len(sizes.split())
    head = f"NRRD0005\ntype: {kind}\ndimension: {count}\nsizes: {sizes}\nendian: little\n"
    return f"{head}encoding: raw\n{fields.strip()}\n\n".encode() + data


def read(folder: Any, content: bytes, name: str = "v.nrrd", options: str = "") -> Volume:
    (folder / name).write_bytes(content)
    return load_silently(f"{folder / name}{options}")


GEOMETRIES: dict[str, tuple[str, tuple[float, ...], tuple[float, ...], Metadata]] = {
    "patient": (LPS, (0.5, 0.7, 1), (1, 2, 3), Metadata(is_patient=True, assumed=(NO_UNIT,))),
    # RAS and LAS lead to the other side.
    "RAS": (
        f"space: RAS\n{VECTORS}",
        (-0.5, -0.7, 1),
        (-1, -2, 3),
        Metadata("", "", True, (NO_UNIT,)),
    ),
    "LAS": (
        f"space: left-anterior-superior-time\n{VECTORS}",
        *((0.5, -0.7, 1), (1, -2, 3), Metadata("", "", True, (NO_UNIT,))),
    ),
    "no patient": (
        f"space: 3D-right-handed\n{VECTORS}",
        *((0.5, 0.7, 1), (1, 2, 3), Metadata(assumed=(NO_UNIT,))),
    ),
    "space units": (
        f'space dimension: 3\nspace units: "um" "microns" "µm"\n{VECTORS}',
        *((5e-4, 7e-4, 1e-3), (1e-3, 2e-3, 3e-3), Metadata()),
    ),
    "cm": (f'{LPS}space units: "cm" "cm" "cm"', (5, 7, 10), (10, 20, 30), Metadata("", "", True)),
    "units": ('spacings: 5 7 10\nunits: "um" "um" "um"', (5e-3, 7e-3, 1e-2), (0, 0, 0), Metadata()),
    "nodes": (
        f"{MINS}centerings: node node node",
        *((0.5, 0.7, 1), (1, 2, 3), Metadata(assumed=(NO_UNIT,))),
    ),
    "cells": (
        f"{MINS}centerings: cell cell cell",
        *((0.375, 1.4 / 3, 0.5), (1.1875, 2 + 0.7 / 3, 3.25), Metadata(assumed=(NO_UNIT,))),
    ),
    "mixed": (
        f"{MINS}centers: node cell node",
        *((0.5, 1.4 / 3, 1), (1, 2 + 0.7 / 3, 3), Metadata(assumed=(NO_UNIT,))),
    ),
    "backwards": (
        "axis mins: 2.5 0 0\naxis maxs: 1 2 1\ncenterings: node node node",
        *((-0.5, 1, 1), (2.5, 0, 0), Metadata(assumed=(NO_UNIT,))),
    ),
    "nothing": ("content: a ramp", (1, 1, 1), (0, 0, 0), Metadata(assumed=(NO_SPACING,))),
}


@pytest.mark.parametrize("name", GEOMETRIES)
def test_axes_follow_the_format_s_definition(tmp_path, name):
    fields, steps, origin, metadata = GEOMETRIES[name]
    volume = read(tmp_path, nrrd(fields))
    assert np.allclose(volume.world_from_index[:3], np.column_stack([np.diag(steps), origin]))
    assert volume.metadata == metadata and np.array_equal(volume.values, VALUES)


@pytest.mark.parametrize(
    ("encoding", "data"),
    [
        ("bzip2", bz2.compress(RAW)),
        ("gz", gzip.compress(RAW)),
        ("hex", RAW.hex(" ", 2).encode()),
        ("ascii", b"\n".join(b"%d" % each for each in VALUES.ravel())),
    ],
    ids=["bzip2", "gzip", "hex", "text"],
)
@pytest.mark.parametrize("apart", [False, True])
def test_every_encoding_is_read(tmp_path, encoding, data, apart):
    header = nrrd(LPS, b"").replace(b"raw", encoding.encode())
    if apart:
        (tmp_path / "voxels").write_bytes(data)
        header, data = header[:-1] + b"data file: voxels\n", b""
    assert np.array_equal(read(tmp_path, header + data, "v.nhdr").values, VALUES)


@pytest.mark.parametrize(
    "listed", ["data file: LIST 2\na0.raw\na1.raw", "data file: a%d.raw 0 1 1"]
)
def test_slices_in_several_files_are_stacked(tmp_path, listed):
    for k, part in enumerate(VALUES):
        (tmp_path / f"a{k}.raw").write_bytes(part.tobytes())
    assert np.array_equal(read(tmp_path, nrrd(listed, b""), "v.nhdr").values, VALUES)
    (tmp_path / "a1.raw").write_bytes(RAW[:20])
    with raises(VolumeError, "damaged"):
        load_volume(tmp_path / "v.nhdr")


PAIRS = np.stack([VALUES, VALUES + 1])
NONE = "space directions: {} (0.5,0,0) (0,0.7,0) (0,0,1) {}\n"
LAYOUTS = {
    "none first": (NONE.format("none", ""), np.moveaxis(PAIRS, 0, -1), "2 4 3 2", "channel"),
    "none last": (NONE.format("", "none"), PAIRS, "4 3 2 2", "time"),
    "list last": (
        f"{NONE.format('', 'none')}kinds: domain domain domain list",
        *(PAIRS, "4 3 2 2", "channel"),
    ),
    "vector": (
        "kinds: vector domain domain domain",
        np.moveaxis(PAIRS, 0, -1),
        "2 4 3 2",
        "channel",
    ),
    "time": ("kinds: time space space space", np.moveaxis(PAIRS, 0, -1), "2 4 3 2", "time"),
    "no kinds": ("spacings: 1 1 1 nan", PAIRS, "4 3 2 2", "time"),
    "tensor": (
        "kinds: 3D-masked-symmetric-matrix domain domain domain",
        *(
            np.moveaxis(np.concatenate([PAIRS, PAIRS, PAIRS, PAIRS[:1]]), 0, -1),
            "7 4 3 2",
            "channel",
        ),
    ),
}


@pytest.mark.parametrize("name", LAYOUTS)
def test_axes_that_are_not_of_space_are_times_or_channels(tmp_path, name):
    fields, values, sizes, option = LAYOUTS[name]
    content = nrrd(fields, np.ascontiguousarray(values).tobytes(), sizes)
    volume = read(tmp_path, content, options=f"?{option}=1")
    assert np.array_equal(volume.values, VALUES + 1)
    if option == "channel":
        assert (
            len(load_volume(tmp_path / "v.nrrd").fields) == int(sizes.split()[0]) - 1
            or name == "list last"
        )


SEGMENTS = (
    "space: LPS\n{}\nSegment0_Name:=Muskel groß\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n"
    "Segment1_Name:=肝臓\nSegment1_LabelValue:=1\nSegment1_Layer:=1\nSegment1_Color:=0 1 0"
)


def test_segments_of_all_layers_have_their_names_and_colours(tmp_path):
    fields = SEGMENTS.format("kinds: list domain domain domain")
    layers = np.zeros((2, 3, 4, 2), np.int16)
    layers[0, ..., 0] = 1
    layers[:, 0, :, 1] = 1
    (tmp_path / "v.seg.nrrd").write_bytes(nrrd(fields, layers.tobytes(), "2 4 3 2"))
    with warns("4 voxels", "?channel=0"):
        volume = load_volume(tmp_path / "v.seg.nrrd")
    assert [label.name for label in volume.labels.values()] == ["Muskel groß", "肝臓"]
    assert volume.labels[2].colour == (0, 1, 0) and not volume.fields
    assert np.array_equal(volume.values, np.where(layers[..., 1], 2, layers[..., 0]))
    alone = load_silently(f"{tmp_path}/v.seg.nrrd?channel=1")
    assert {n: label.name for n, label in alone.labels.items()} == {1: "肝臓"}


def test_segments_of_great_or_signed_numbers_are_found_without_a_table_of_all(tmp_path):
    layers = np.zeros((2, 3, 4, 2), np.int32)
    layers[0, ..., 0], layers[1, ..., 0], layers[1, 0, 0, 1] = -1, 2_000_000_000, 1
    fields = SEGMENTS.format("kinds: list domain domain domain")
    fields = fields.replace("Segment0_LabelValue:=1", "Segment0_LabelValue:=2000000000")
    path = tmp_path / "v.seg.nrrd"
    path.write_bytes(nrrd(fields, layers.tobytes(), "2 4 3 2", "int"))
    with warns("1 voxels", "?channel=0"):
        volume = load_volume(path)
    assert [label.name for label in volume.labels.values()] == ["Muskel groß", "肝臓"]
    assert np.bincount(volume.values.ravel()).tolist() == [12, 11, 1]


TURNED = "TransformMatrix = 0.707 0.707 0 -0.707 0.707 0 0 0 1\n"
META_FIELDS: dict[str, tuple[str, tuple[float, ...], Metadata]] = {
    "um": ("DistanceUnits = um\nElementSpacing = 0.5 0.7 2\n", (5e-4, 7e-4, 2e-3), Metadata()),
    "cm": ("DistanceUnits = cm\nElementSize = 0.5 0.7 2\n", (5, 7, 20), Metadata()),
    # Of two or three decimals, as programs write them.
    "rounded": (
        f"{TURNED}ElementSpacing = 0.5 0.7 2\n",
        (0.5, 0.7, 2),
        Metadata(assumed=(NO_UNIT,)),
    ),
    "patient": (
        "AnatomicalOrientation = RAI\nElementSpacing = 1 1 2\n",
        *((1, 1, 2), Metadata(is_patient=True, assumed=(NO_UNIT,))),
    ),
    "unknown": (
        "AnatomicalOrientation = ???\nDistanceUnits = ?\nElementSpacing = 1 1 2\n",
        *((1, 1, 2), Metadata(assumed=(NO_UNIT,))),
    ),
    "nothing": ("", (1, 1, 1), Metadata(assumed=(NO_SPACING,))),
}


@pytest.mark.parametrize("name", META_FIELDS)
def test_metaimage_states_units_and_whose_axes_they_are(tmp_path, name):
    fields, spacing, metadata = META_FIELDS[name]
    volume = read(tmp_path, f"{META}{fields}ElementDataFile = LOCAL\n".encode() + RAW, "v.mha")
    assert np.allclose(volume.spacing_mm, spacing) and volume.metadata == metadata
    if name == "rounded":
        assert np.allclose(volume.world_from_index[:2, 0], np.full(2, 0.5 / np.sqrt(2)))


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("v.mhd", f"{META}ElementDataFile = scan.raw\n".encode()),
        ("v.nhdr", nrrd("data file: scan.raw", b"")),
    ],
)
def test_the_missing_file_of_voxels_is_named(tmp_path, name, content):
    with raises(VolumeError, "not-found") as refused:
        read(tmp_path, content, name)
    assert "scan.raw" in refused.value.problem and str(tmp_path) in refused.value.remedy


def test_an_address_states_what_the_file_does_not(tmp_path):
    (tmp_path / "ct.nrrd").write_bytes(nrrd("spacings: 1 1 1"))
    volume = load_silently(f"{tmp_path}/ct.nrrd?unit=HU&spacing=1,1,2")
    assert volume.metadata == Metadata(unit="HU") and volume.spacing_mm == (1, 1, 2)
    assert volume.downsampled(1).metadata.in_hounsfield
