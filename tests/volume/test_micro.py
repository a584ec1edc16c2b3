"""Microscopes' formats, in files that this module writes: channels, times, images, voxels."""

import struct
import sys
from collections.abc import Callable
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


def write_czi(path: Path) -> None:
    """Two scenes of two channels."""
    czi = pytest.importorskip("pylibCZIrw.czi")
    with czi.create_czi(str(path)) as file:
        for scene in (0, 1):
            for c, channel in enumerate(TWO):
                for z, plane in enumerate(channel):
                    at = {"C": c, "Z": z, "T": 0}
                    file.write(plane + 10 * scene, plane=at, scene=scene, location=(0, 100 * scene))
        steps = {"scale_x": 5e-7, "scale_y": 7e-7, "scale_z": 2e-6}
        file.write_metadata("two", channel_names=dict(enumerate(NAMES)), **steps)


def write_lif(path: Path) -> None:
    """Two images of two channels, each with its block of bytes."""
    pytest.importorskip("liffile")

    def dimension(number: int, count: int, step: float, nbytes: int) -> str:
        return (
            f'<DimensionDescription DimID="{number}" NumberOfElements="{count}" Origin="0" '
            f'Length="{(count - 1) * step}" Unit="m" BytesInc="{nbytes}" BitInc="0"/>'
        )

    def block(text: str, *size: int) -> bytes:
        packed = text.encode("utf-16-le")
        head = struct.pack("<BQ", 0x2A, *size) if size else b""
        body = head + struct.pack("<BI", 0x2A, len(text)) + packed
        return struct.pack("<II", 0x70, len(body)) + body

    z, y, x = VALUES.shape
    sides = (
        dimension(1, x, 5e-7, 2) + dimension(2, y, 7e-7, 2 * x) + dimension(3, z, 2e-6, 2 * x * y)
    )
    channel = (
        '<ChannelDescription DataType="0" ChannelTag="0" Resolution="16" Min="0" Max="1" Unit="" '
        'NameOfMeasuredQuantity="" LUTName="Gray" IsLUTInverted="0" BytesInc="{}" BitInc="0"/>'
    )
    channels = "".join(channel.format(k * VALUES.nbytes) for k in (0, 1))
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
    text = {"X": "8", "Y": "6", "Z": "4", "Unit": "um", "ExtMin0": "10", "ExtMin1": "0"}
    text |= {"ExtMin2": "0", "ExtMax0": "14", "ExtMax1": "4.2", "ExtMax2": "8"}
    with h5py.File(path, "w") as file:
        stated = file.create_group("DataSetInfo/Image").attrs
        for key, value in text.items():
            stated[key] = np.frombuffer(value.encode(), "S1")
        for c, channel in enumerate(TWO):
            own = file.create_group(f"DataSetInfo/Channel {c}").attrs
            own["Name"] = np.frombuffer(NAMES[c].encode(), "S1")
            own["Color"] = np.frombuffer(b"0 0.5 1", "S1")
            for level in (0, 1):
                every = channel[:: level + 1, :: level + 1, :: level + 1]
                full = np.pad(every, [(0, -n % 8) for n in every.shape])
                place = f"DataSet/ResolutionLevel {level}/TimePoint 0/Channel {c}"
                file.create_dataset(f"{place}/Data", data=full, chunks=(8, 8, 8))
                for axis, n in zip("ZYX", every.shape, strict=True):
                    size = np.frombuffer(str(n).encode(), "S1")
                    file[place].attrs[f"ImageSize{axis}"] = size


WRITERS: dict[str, Callable[[Path], None]] = {
    "czi": write_czi,
    "lif": write_lif,
    "ims": write_ims,
}
HAVE_SERIES = "czi", "lif"


@pytest.mark.parametrize("kind", WRITERS)
def test_channels_images_and_voxels(tmp_path, kind):
    path = tmp_path / f"v.{kind}"
    WRITERS[kind](path)
    address = f"{path}?series=1" if kind in HAVE_SERIES else path
    fields = [*load_silently(address).by_role.values()]
    for k, volume in enumerate(fields):
        assert np.array_equal(volume.values, VALUES + k + 10 * (kind in HAVE_SERIES))
        assert volume.spacing_mm == pytest.approx((5e-4, 7e-4, 2e-3))
        assert volume.channel.name == ("" if kind == "lif" else NAMES[k])  # LIF has none
    assert len(fields) == 2 and fields[0].metadata.assumed == ()
    if kind in HAVE_SERIES:
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


@pytest.mark.parametrize(
    ("name", "module"),
    [("v.czi", "pylibCZIrw"), ("v.lif", "liffile"), ("v.nd2", "nd2"), ("v.oib", "oiffile")],
)
def test_without_its_library_a_file_is_refused_with_two_remedies(
    tmp_path, monkeypatch, name, module
):
    (tmp_path / name).write_bytes(b"any")
    monkeypatch.setitem(sys.modules, module, None)
    with raises(DeviceError, "unsupported") as caught:
        read_here(Query.of(str(tmp_path / name)))
    assert "volspec[micro]" in caught.value.remedy and "Fiji" in caught.value.remedy


@pytest.mark.parametrize("name", ["v.lif", "v.nd2", "v.oif", "v.czi"])
def test_damaged_files_are_refused(tmp_path, name):
    modules = {"lif": "liffile", "nd2": "nd2", "oif": "oiffile", "czi": "pylibCZIrw"}
    pytest.importorskip(modules[name[2:]])
    (tmp_path / name).write_bytes(b"no microscope wrote this")
    with raises(VolumeError, "damaged"):
        load_volume(tmp_path / name)
