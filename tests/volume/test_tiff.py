"""TIFF files of several pages and folders of pictures: values, spacing, and what is refused."""

import re
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image
from tifffile import OmeXml, TiffFile, TiffWriter, imwrite

from tests.support.errors import advised_address, raises, warns
from tests.support.volumes import load_silently
from volspec.errors import VolspecWarning, VolumeError
from volspec.volume import load_volume, volume_choices
from volspec.volume.metadata import NO_SPACING

VALUES = np.arange(5 * 6 * 7, dtype=np.uint16).reshape(5, 6, 7) * 300
BYTES = (VALUES // 300).astype(np.uint8)
TWO = np.stack([VALUES, VALUES + 1])
STACKS = np.stack([TWO, TWO + 7]).transpose(0, 2, 1, 3, 4)  # T Z C Y X
SIZES = {"PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5, "PhysicalSizeZ": 2}


def write_lzw(path: Path, values: np.ndarray) -> None:
    first, *others = [Image.fromarray(page) for page in values]
    first.save(path, save_all=True, append_images=others, compression="tiff_lzw")


OME = {"metadata": {"axes": "ZYX", **SIZES}}
IMAGEJ = {"imagej": True, "resolution": (2, 2)}
MICRONS = {"axes": "ZYX", "unit": "um", "spacing": 2.0}
STATED = {
    "imagej.tif": IMAGEJ | {"metadata": MICRONS},
    "zunit.tif": IMAGEJ | {"metadata": MICRONS | {"zunit": "mm", "spacing": 0.002}},
    "negative.tif": IMAGEJ | {"metadata": MICRONS | {"spacing": -2.0}},
    "x.ome.tif": OME,
    "x.ome.btf": OME | {"bigtiff": True},
    "packed.ome.tiff": OME | {"compression": "zlib"},
}


@pytest.mark.parametrize("name", STATED)
def test_spacing_is_what_imagej_and_ome_state(tmp_path, name):
    """Sizes are micrometres if OME-XML names no unit."""
    imwrite(tmp_path / name, VALUES, **STATED[name])
    volume = load_silently(tmp_path / name)
    assert volume.values.dtype == np.uint16 and np.array_equal(volume.values, VALUES)
    assert volume.spacing_mm == pytest.approx((0.0005, 0.0005, 0.002))
    assert load_silently(f"{tmp_path / name}?spacing=1,2,3").spacing_mm == (1, 2, 3)


def test_pages_without_a_spacing_are_1_mm_apart_with_a_warning(tmp_path):
    """300 dots an inch are ignored: many programs write them by default."""
    for name, dots in (("a.tif", 1), ("b.tif", 300)):
        resolution = {"resolution": (dots, dots), "resolutionunit": "INCH"}
        imwrite(tmp_path / name, VALUES, photometric="minisblack", **resolution)
        with warns("1", f"{name}?spacing="):
            volume = load_volume(tmp_path / name)
        assert np.array_equal(volume.values, VALUES) and volume.spacing_mm == (1, 1, 1)
        assert volume.metadata.assumed == (NO_SPACING,)


def test_of_a_resolution_in_the_plane_the_distance_of_slices_is_taken(tmp_path):
    imwrite(tmp_path / "ct.tif", VALUES, resolution=(500, 500), resolutionunit="CENTIMETER")
    with warns("0.02", file=__file__):
        volume = load_volume(tmp_path / "ct.tif")
    assert volume.spacing_mm == (0.02, 0.02, 0.02) and len(volume.metadata.assumed) == 1


@pytest.mark.parametrize("packed", [None, "zlib"])
@pytest.mark.parametrize("axes", ["ZXY", "YXZ", "XYZ"])
def test_axes_in_any_order_are_slices_rows_and_columns(tmp_path, axes, packed):
    stored = VALUES.transpose(["ZYX".index(axis) for axis in axes])
    how = {"metadata": {"axes": axes}, "compression": packed}
    imwrite(tmp_path / "v.tif", stored, photometric="minisblack", **how)
    assert np.array_equal(load_silently(f"{tmp_path}/v.tif?spacing=1,1,1").values, VALUES)


@pytest.mark.parametrize(
    ("values", "axes", "more"), [(VALUES, {"axes": "CYX"}, ""), (TWO[::-1], {}, "&time=1")]
)
def test_the_address_names_axes_that_the_file_does_not(tmp_path, values, axes, more):
    """ImageJ's old writers call slices channels; four axes may have no names."""
    imwrite(tmp_path / "v.tif", values, photometric="minisblack", metadata=axes)
    channels = pytest.warns(VolspecWarning) if axes else raises(VolumeError, "shape")
    with channels as caught:
        load_volume(f"{tmp_path}/v.tif?spacing=1,1,1")
    said = caught[0].message if axes else caught.value
    assert np.array_equal(load_silently(advised_address(said) + more).values, VALUES)
    with raises(VolumeError, "syntax"):
        load_volume(f"{tmp_path}/v.tif?axes=ZZYX")


def test_each_stack_of_an_ome_tiff_has_its_own_spacing_and_channels(tmp_path):
    """An overview of one plane is none."""
    path = tmp_path / "two.ome.tif"
    with TiffWriter(path) as file:
        file.write(VALUES[0], metadata={"axes": "YX", "PhysicalSizeX": 10})
        file.write(TWO, metadata={"axes": "CZYX", **SIZES, "Channel": {"Name": ["DAPI", "GFP"]}})
        file.write(VALUES[:, :4], metadata={"axes": "ZYX", **SIZES, "PhysicalSizeX": 1})
    with raises(VolumeError, "missing") as caught:
        load_volume(path)
    first, second = load_silently(advised_address(caught.value)), load_silently(f"{path}?series=1")
    assert [field.channel.name for field in (first, *first.fields)] == ["DAPI", "GFP"]
    assert first.spacing_mm == pytest.approx((0.0005, 0.0005, 0.002))
    assert (second.shape_xyz, second.spacing_mm[0]) == ((7, 4, 5), pytest.approx(0.001))
    (series,) = volume_choices(path)
    assert (series.values, series.chosen) == (("0", "1"), None)
    assert [choice.key for choice in volume_choices(f"{path}?series=0")] == ["series", "channel"]


XML = OmeXml()
XML.addimage("uint16", TWO.shape, (10, 1, 1, 6, 7, 1), axes="CZYX", **SIZES)


def test_slices_before_the_first_missing_page_are_read(tmp_path):
    """Eight pages are five of a channel and three of the other; four are of the first."""
    path, pages = tmp_path / "v.ome.tif", TWO.reshape(10, 6, 7)
    for count, address, slices, fields in ((8, path, 3, 1), (4, f"{path}?channel=0", 4, 0)):
        text, grey = XML.tostring(), {"photometric": "minisblack", "metadata": None}
        imwrite(path, pages[:count], description=text, **grey)
        with warns(f"slice {slices}", file=__file__):
            volume = load_volume(address)
        assert np.array_equal(volume.values, VALUES[:slices]) and len(volume.fields) == fields
    with raises(VolumeError, "range"):
        load_volume(f"{path}?channel=1")


def test_ome_xml_in_a_companion_file_is_read(tmp_path):
    path, companion = tmp_path / "v.ome.tif", tmp_path / "v.companion.ome"
    row = f'<BinaryOnly MetadataFile="{companion.name}"/>'
    text = re.sub("<Image.*</Image>", row, XML.tostring(), flags=re.DOTALL)
    imwrite(path, TWO.reshape(10, 6, 7), description=text, metadata=None)
    with warns(companion.name):
        assert load_volume(f"{path}?spacing=1,1,1").shape_xyz == (7, 6, 10)
    companion.write_text(XML.tostring(), encoding="utf-8")
    volume = load_silently(path)
    assert np.array_equal(volume.fields[0].values, TWO[1])
    assert volume.spacing_mm == pytest.approx((0.0005, 0.0005, 0.002))


@pytest.mark.parametrize("values", [VALUES.astype(np.float32), VALUES.astype(np.uint8), VALUES])
def test_lzw_pages_are_read(tmp_path, values):
    """Many programs write them; tifffile alone cannot read them."""
    write_lzw(tmp_path / "v.tif", values)
    volume = load_silently(f"{tmp_path}/v.tif?spacing=1,1,1")
    assert volume.values.dtype == values.dtype and np.array_equal(volume.values, values)


def write_any_lzw(path: Path, values: np.ndarray, **how: Any) -> None:
    """Any type, which neither Pillow nor tifffile alone writes: nine bits for every byte."""

    def packed(page: np.ndarray) -> bytes:
        data = page.tobytes()
        starts = range(0, len(data), 200)  # the table is cleared before codes grow longer
        codes = [code for start in starts for code in (256, *data[start : start + 200])]
        bits = "".join(f"{code:09b}" for code in [*codes, 257])
        return int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8))

    kind = {"shape": values.shape, "dtype": values.dtype, "compression": "zlib"}
    imwrite(path, (packed(page) for page in values), **kind, **how)
    with TiffFile(path, mode="r+") as file:
        for page in file.pages:
            page.tags["Compression"].overwrite(5)


def test_white_is_zero_or_not_the_values_are_those_stored(tmp_path):
    for write in (imwrite, write_any_lzw):
        write(tmp_path / "v.tif", BYTES, photometric="miniswhite")
        assert np.array_equal(load_silently(f"{tmp_path}/v.tif?spacing=1,1,1").values, BYTES)


def test_pages_written_one_by_one_are_a_stack(tmp_path):
    """tifffile describes each as a picture of its own."""
    with TiffWriter(tmp_path / "v.tif") as file:
        for page in VALUES:
            file.write(page, photometric="minisblack", contiguous=False)
    assert np.array_equal(load_silently(f"{tmp_path}/v.tif?spacing=1,1,1").values, VALUES)


@pytest.mark.parametrize("packed", [None, "zlib"])
def test_a_channel_and_a_time_are_chosen(tmp_path, packed):
    path = tmp_path / "cells.ome.tif"
    imwrite(path, STACKS, compression=packed, metadata={"axes": "TZCYX", **SIZES})
    assert np.array_equal(load_silently(f"{path}?time=1").fields[0].values, VALUES + 8)
    assert np.array_equal(load_silently(f"{path}?time=1&channel=1").values, VALUES + 8)


def test_one_colour_of_rgb_pages_is_chosen(tmp_path):
    colours = np.stack([VALUES % 251, VALUES % 13, VALUES % 7], axis=-1).astype(np.uint8)
    imwrite(tmp_path / "v.tif", colours, photometric="rgb", compression="zlib")
    (tmp_path / "folder").mkdir()
    for k, page in enumerate(colours):
        iio.imwrite(tmp_path / "folder" / f"{k}.png", page)
    for name in ("v.tif", "folder"):
        address = f"{tmp_path}/{name}?spacing=1,1,1"
        assert np.array_equal(load_silently(address).fields[1].values, VALUES % 7)
        assert np.array_equal(load_silently(f"{address}&channel=1").values, VALUES % 13)


def test_colours_in_planes_of_their_own_are_channels(tmp_path):
    for k, page in enumerate(VALUES):
        colours = np.stack([page, page + 1, page + 2])
        imwrite(tmp_path / f"{k}.tif", colours, photometric="rgb", planarconfig="separate")
    assert np.array_equal(load_silently(f"{tmp_path}?spacing=1,1,1&channel=2").values, VALUES + 2)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".jp2", ".bmp", ".jpg"])
def test_a_folder_of_pictures_is_read_in_order_of_its_numbers(tmp_path, suffix):
    values = BYTES if suffix in (".bmp", ".jpg") else VALUES
    for k, page in enumerate(values, 8):
        Image.fromarray(page).save(tmp_path / f"Slice {k}{suffix}")
    (tmp_path / "log.txt").write_text("written by the scanner")
    (tmp_path / "._Slice 8.tif").write_text("by the system")
    if suffix != ".png":
        iio.imwrite(tmp_path / "preview.png", np.zeros((9, 9), np.uint8))
    volume = load_silently(f"{tmp_path}?spacing=0.5,0.5,2")
    assert volume.values.dtype == values.dtype and volume.spacing_mm == (0.5, 0.5, 2)
    assert np.abs(volume.values - values.astype(float)).max() <= (4 if suffix == ".jpg" else 0)
    with warns("?spacing="):
        assert load_volume(tmp_path).metadata.assumed == (NO_SPACING,)


def test_of_several_formats_in_a_folder_the_most_frequent_is_read(tmp_path):
    for k, page in enumerate(VALUES):
        Image.fromarray(page).save(tmp_path / f"{k}{'.png' if k < 3 else '.tif'}")
    with warns("3 PNG", "2 TIFF"):
        assert np.array_equal(load_volume(f"{tmp_path}?spacing=1,1,1").values, VALUES[:3])


NAMES = {
    "img_z{z:03}_ch{c:02}.tif": ("ch00", "ch01"),
    "scanC{c}Z{z}.tif": ("C0", "C1"),
    "{n:04}_w{c}_s1_z{z}.tif": ("w0", "w1"),
    "{word}_{z:03}.tif": ("DAPI", "GFP"),
    "img_t{c:03}_z{z}.tif": ("t000", "t001"),
}


@pytest.mark.parametrize("names", NAMES)
def test_channels_and_times_in_names_are_chosen(tmp_path, names):
    key = "time" if "_t" in names else "channel"
    for n in range(10):
        name = names.format(n=n, z=n // 2, c=n % 2, word=("DAPI", "GFP")[n % 2])
        imwrite(tmp_path / name, TWO[n % 2, n // 2])
    (choice,) = volume_choices(tmp_path)
    assert (choice.key, choice.names[-2:]) == (key, NAMES[names])
    address = f"{tmp_path}?{key}=1&spacing=1,1,1"
    assert np.array_equal(load_silently(address).values, TWO[1])
    (tmp_path / name).unlink()
    with raises(VolumeError, "missing"):
        load_volume(address)


@pytest.mark.parametrize("names", ["s01_roi2_{0}", "{0}_12{1}", "c{2}_{0}", "a{0}_{4}", "b{2}_{3}"])
def test_other_numbers_in_names_are_those_of_slices(tmp_path, recwarn, names):
    """Constants, times of day, numbers that go on in the next box; two that start again warn."""
    for n in range(4):
        imwrite(tmp_path / f"{names.format(n, 7 * n, n // 2, n % 2, 'xyzw'[n])}.tif", VALUES[n])
    assert np.array_equal(load_volume(f"{tmp_path}?spacing=1,1,1").values, VALUES[:4])
    assert len(recwarn) == ("{3}" in names)


def two(folder: Path, second: np.ndarray) -> None:
    for name, page in (("0.tif", VALUES[0]), ("1.tif", second)):
        imwrite(folder / name, page, photometric="minisblack")


def edit(path: Path, change: Callable[[bytes], bytes]) -> None:
    path.write_bytes(change(path.read_bytes()))


def cut(folder: Path, packed: str | None = None) -> None:
    imwrite(folder / "v.tif", VALUES, photometric="minisblack", compression=packed)
    edit(folder / "v.tif", lambda data: data[:-300])


def damaged_lzw(folder: Path) -> None:
    write_lzw(folder / "v.tif", VALUES)
    edit(folder / "v.tif", lambda data: data[:8] + bytes(32) + data[40:])  # of the first page


def cut_png(folder: Path) -> None:
    for k in range(2):
        iio.imwrite(folder / f"{k}.png", VALUES[k])
    edit(folder / "1.png", lambda data: data[:-40])


def png_of_wide_colours(folder: Path) -> None:
    for k in range(2):
        iio.imwrite(folder / f"{k}.png", np.zeros((6, 7, 3), np.uint8))
        data = bytearray((folder / f"{k}.png").read_bytes())
        header = bytes([*data[12:24], 16, *data[25:29]])
        data[12:33] = header + zlib.crc32(header).to_bytes(4)
        (folder / f"{k}.png").write_bytes(data)


def many_slices_in_a_page(folder: Path) -> None:
    for k in range(2):
        block = np.zeros((16, 16, 16), np.uint8)
        imwrite(folder / f"{k}.tif", block, volumetric=True, tile=(16, 16, 16))


def any_lzw(values: np.ndarray, **how: Any) -> Callable[[Path], None]:
    """Pillow reads them silently: bytes swapped, signs lost, 16-bit colours cut to 8."""
    return lambda folder: write_any_lzw(folder / "v.tif", values, **how)


def stacks(values: np.ndarray, axes: str) -> Callable[[Path], None]:
    return lambda folder: imwrite(folder / "v.ome.tif", values, metadata={"axes": axes, **SIZES})


SIGNS, COLOURS = BYTES.astype(np.int8), np.stack([VALUES] * 3, axis=-1)
LZW = "/v.tif?spacing=1,1,1&channel=0"
REFUSED: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "big-endian LZW": (any_lzw((VALUES - 100).astype(">i2"), byteorder=">"), LZW, "unsupported"),
    "LZW of floats": (any_lzw(VALUES.astype(">f4"), byteorder=">"), LZW, "unsupported"),
    "LZW of signs": (any_lzw(SIGNS), LZW, "unsupported"),
    "LZW of colours": (any_lzw(COLOURS, photometric="rgb"), LZW, "unsupported"),
    "no time": (stacks(STACKS, "TZCYX"), "/v.ome.tif", "missing"),
    "no channel": (stacks(STACKS, "TZCYX"), "/v.ome.tif?time=1&channel=2", "range"),
    "dark channels": (stacks(np.full_like(TWO, 7), "CZYX"), "/v.ome.tif", "range"),
    "two sizes": (lambda folder: two(folder, VALUES[0, :3]), "", "shape"),
    "a stack among pages": (lambda folder: two(folder, VALUES), "", "conflict"),
    "wide colours": (png_of_wide_colours, "", "unsupported"),
    "slices in a page": (many_slices_in_a_page, "", "conflict"),
    "cut": (cut, "/v.tif", "damaged"),
    "cut and packed": (lambda folder: cut(folder, "zlib"), "/v.tif", "damaged"),
    "damaged LZW": (damaged_lzw, "/v.tif", "damaged"),
    "cut PNG": (cut_png, "", "damaged"),
    "junk": (lambda folder: (folder / "v.tif").write_bytes(b"hello" * 99), "/v.tif", "damaged"),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", REFUSED)
def test_pictures_that_are_no_volume_are_refused_in_one_line(tmp_path, capfd, caplog, kind):
    write, name, code = REFUSED[kind]
    write(tmp_path)
    with raises(VolumeError, code):
        load_volume(f"{tmp_path}{name}")
    assert capfd.readouterr().err == "" and not caplog.records, "a reader complained by itself"
