"""Microscopes' formats, in files that this module writes: channels, times, images, voxels."""

import struct
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.support.errors import raises
from tests.support.volumes import load_silently
from volspec.errors import DeviceError, VolumeError
from volspec.volume import load_volume
from volspec.volume.files.query import Query
from volspec.volume.load import read_here

VALUES = np.arange(4 * 6 * 8, dtype=np.uint16).reshape(4, 6, 8)
TWO = np.stack([VALUES, VALUES + 1])
NAMES = "DAPI", "GFP"
MODULES = {"czi": "pylibCZIrw", "lif": "liffile", "nd2": "nd2", "oib": "oiffile", "oif": "oiffile"}


def write_czi(path: Path) -> None:
    """Two scenes of two channels."""
    czi = pytest.importorskip("pylibCZIrw.czi")
    with czi.create_czi(str(path)) as file:
        for scene, c, z in np.ndindex(2, 2, 4):
            at = {"C": c, "Z": z, "T": 0}
            file.write(TWO[c, z] + 10 * scene, plane=at, scene=scene, location=(0, 100 * scene))
        steps = {"scale_x": 5e-7, "scale_y": 7e-7, "scale_z": 2e-6}
        file.write_metadata("two", channel_names=dict(enumerate(NAMES)), **steps)


def write_lif(path: Path) -> None:
    """Two images of two channels, each with its block of bytes."""
    pytest.importorskip("liffile")

    def block(text: str, *size: int) -> bytes:
        head = struct.pack("<BQ", 0x2A, *size) if size else b""
        body = head + struct.pack("<BI", 0x2A, len(text)) + text.encode("utf-16-le")
        return struct.pack("<II", 0x70, len(body)) + body

    sides = "".join(
        f'<DimensionDescription DimID="{k + 1}" NumberOfElements="{count}" Origin="0" Unit="m" '
        f'Length="{(count - 1) * step}" BytesInc="{VALUES.strides[2 - k]}" BitInc="0"/>'
        for k, (count, step) in enumerate(zip((8, 6, 4), (5e-7, 7e-7, 2e-6), strict=True))
    )
    channels = "".join(
        f'<ChannelDescription DataType="0" Resolution="16" BytesInc="{k * VALUES.nbytes}" '
        'ChannelTag="0" LUTName="Gray" BitInc="0" NameOfMeasuredQuantity="" Unit="" '
        'IsLUTInverted="0" Min="0" Max="1"/>'
        for k in (0, 1)
    )
    images = "".join(
        f'<Element Name="{k}" UniqueID="{k}"><Memory Size="{TWO.nbytes}" MemoryBlockID="M{k}"/>'
        f"<Data><Image><ImageDescription><Channels>{channels}</Channels><Dimensions>{sides}"
        "</Dimensions></ImageDescription></Image></Data></Element>"
        for k in (0, 1)
    )
    head = (
        '<LMSDataContainerHeader Version="2"><Element Name="p" UniqueID="p"><Children>'
        f"{images}</Children></Element></LMSDataContainerHeader>"
    )
    parts = (block(f"M{k}", TWO.nbytes) + (TWO + 10 * k).tobytes() for k in (0, 1))
    path.write_bytes(block(head) + b"".join(parts))


def write_ims(path: Path) -> None:
    """Two levels of two channels; chunks are filled up to 8 voxels."""
    with h5py.File(path, "w") as file:

        def state(place: str, **text: str) -> None:
            for key, value in text.items():
                file.require_group(place).attrs[key] = np.frombuffer(value.encode(), "S1")

        state("DataSetInfo/Image", Unit="um", ExtMin0="10", ExtMin1="0", ExtMin2="0")
        state("DataSetInfo/Image", ExtMax0="14", ExtMax1="4.2", ExtMax2="8")
        for c, level in np.ndindex(2, 2):
            state(f"DataSetInfo/Channel {c}", Name=NAMES[c], Color="0 0.5 1")
            every = TWO[c][:: level + 1, :: level + 1, :: level + 1]
            place = f"DataSet/ResolutionLevel {level}/TimePoint 0/Channel {c}"
            full = np.pad(every, [(0, -n % 8) for n in every.shape])
            file.create_dataset(f"{place}/Data", data=full, chunks=(8, 8, 8))
            z, y, x = map(str, every.shape)
            state(place, ImageSizeX=x, ImageSizeY=y, ImageSizeZ=z)


@pytest.mark.parametrize("write", [write_czi, write_lif, write_ims])
def test_channels_images_and_voxels(tmp_path, write):
    kind = write.__name__.removeprefix("write_")
    has_series = kind != "ims"
    write(path := tmp_path / f"v.{kind}")
    fields = [*load_silently(f"{path}?series=1" if has_series else path).by_role.values()]
    for k, volume in enumerate(fields):
        assert np.array_equal(volume.values, VALUES + k + 10 * has_series)
        assert volume.spacing_mm == pytest.approx((5e-4, 7e-4, 2e-3))
        assert volume.channel.name == ("" if kind == "lif" else NAMES[k])  # LIF has none
    assert len(fields) == 2 and fields[0].metadata.assumed == ()
    if has_series:
        with raises(VolumeError, "missing"):
            load_volume(path)


def test_imaris_has_its_place_colour_and_levels(tmp_path):
    write_ims(tmp_path / "v.ims")
    volume = load_volume(f"{tmp_path / 'v.ims'}?channel=1")
    assert np.allclose(volume.world_from_index[:3, 3], (0.01025, 0.00035, 0.001))
    assert volume.channel.colour == (0, 0.5, 1)
    large = load_volume(f"{tmp_path / 'v.ims'}?channel=1&memory=100")
    assert [level.shape for level in large.pyramid.levels] == [(4, 6, 8), (2, 3, 4)]
    assert np.array_equal(large.values, VALUES[::2, ::2, ::2] + 1)


@pytest.mark.parametrize("kind", MODULES)
def test_damaged_files_and_missing_libraries_have_remedies(tmp_path, monkeypatch, kind):
    path = tmp_path / f"v.{kind}"
    path.write_bytes(b"no microscope wrote this")
    monkeypatch.setitem(sys.modules, MODULES[kind], None)
    with raises(DeviceError, "unsupported") as caught:
        read_here(Query.of(str(path)))
    assert "volspec[micro]" in caught.value.remedy and "Fiji" in caught.value.remedy
    monkeypatch.undo()
    pytest.importorskip(MODULES[kind])
    with raises(VolumeError, "damaged"):
        load_volume(path)
