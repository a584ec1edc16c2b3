"""Files of several channels: all are read, with what the file says of them."""

from pathlib import Path

import numpy as np
import pytest
import pyvista
import tifffile
from numpy.typing import NDArray

import volspec as vs
from tests.support.errors import warns
from volspec.appearance.display.spaces import linear_sRGB_from_XYZ
from volspec.errors import VolspecWarning
from volspec.transfer import FieldFunctions
from volspec.transfer.channel_look import channel_limits
from volspec.volume import load_volume, volume_choices
from volspec.volume.channels import Channel
from volspec.volume.summary import summarise

SIZES = {"PhysicalSizeX": 0.2, "PhysicalSizeY": 0.2, "PhysicalSizeZ": 0.5}
NAMES = ["DAPI", "Actin", "Actin"]


@pytest.fixture(scope="module")
def values() -> NDArray[np.uint16]:
    """(C, Z, Y, X) with a bright block in each."""
    found = np.random.default_rng(1).integers(90, 110, (3, 6, 20, 24)).astype(np.uint16)
    for channel in range(3):
        found[channel, 1:5, 4:16, 4 + 6 * channel : 10 + 6 * channel] += 2000
    return found


@pytest.fixture(scope="module")
def ome_tiff(values: NDArray[np.uint16], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ome") / "cells.ome.tif"
    channels = {
        "Name": NAMES,
        "Color": [0x0000FFFF, 0x00FF00FF, -1],
        "EmissionWavelength": [461, 520, 600],
        "ExcitationWavelength": [358, 490, 4],
    }
    metadata = {"axes": "ZCYX", **SIZES, "Channel": channels}
    tifffile.imwrite(path, values.transpose(1, 0, 2, 3), metadata=metadata)
    return path


def test_a_vti_of_several_arrays_opens_with_all(tmp_path):
    ramp = np.arange(60, dtype=np.float32)
    for place in ("point_data", "cell_data"):
        grid = pyvista.ImageData(dimensions=(5, 4, 3) if place == "point_data" else (6, 5, 4))
        getattr(grid, place)["pressure"] = ramp
        getattr(grid, place)["label"] = (ramp > 20).astype(np.uint8)
        grid.save(tmp_path / "flow.vti")
        volume = load_volume(tmp_path / "flow.vti")
        assert [each.title for each in (volume, *volume.fields)] == ["pressure", "label"]
        assert volume.range == (0.0, 59.0) and volume.fields[0].values.dtype == np.uint8
        alone = load_volume(f"{tmp_path / 'flow.vti'}?channel=1")
        assert alone.fields == () and alone.range == (0.0, 1.0)
    (choice,) = volume_choices(tmp_path / "flow.vti")
    assert choice.names == ("all", "pressure", "label")


def test_an_ome_tiff_opens_with_all_channels(ome_tiff, values):
    volume = load_volume(ome_tiff)
    fields = [volume, *volume.fields]
    assert all(np.array_equal(f.values, v) for f, v in zip(fields, values, strict=True))
    assert [field.name for field in fields[1:]] == ["Actin", "Actin 2"]
    assert [field.channel.name for field in fields] == NAMES
    assert all(field.has_lattice_of(volume) for field in fields)
    assert volume.spacing_mm == pytest.approx((2e-4, 2e-4, 5e-4))
    dapi, actin, third = (field.channel for field in fields)
    assert (dapi.colour, dapi.excitation_nm, dapi.emission_nm) == ((0.0, 0.0, 1.0), 358.0, 461.0)
    assert actin.colour == (0.0, 1.0, 0.0)
    assert (third.colour, third.excitation_nm) == ((1.0, 1.0, 1.0), None)  # 4 nm is no light


def test_the_summary_lists_them_with_their_ranges(ome_tiff):
    volume = load_volume(ome_tiff)
    channels = summarise(volume).channels
    assert list(channels.values()) == [each.range for each in (volume, *volume.fields)]
    assert list(channels)[:2] == NAMES[:2]
    assert summarise(load_volume(f"{ome_tiff}?channel=1")).channels == {}


def test_an_address_takes_one_channel_and_the_choice_lists_all(ome_tiff):
    one = load_volume(f"{ome_tiff}?channel=1")
    assert (one.channel.name, one.fields) == ("Actin", ())
    assert len(load_volume(f"{ome_tiff}?channel=all").fields) == 2
    (choice,) = volume_choices(ome_tiff)
    assert (choice.values, choice.chosen) == (("all", "0", "1", "2"), "all")
    assert choice.names == ("all", *NAMES)


def test_its_scene_has_each_channel_in_its_colour(ome_tiff):
    scene = vs.Scene.from_volume(ome_tiff, lights=["D65"])
    assert isinstance(scene.transfer, FieldFunctions)
    assert list(scene.transfer.functions) == ["", "Actin", "Actin 2"]
    tables = [function.bake(1.0) for function in scene.transfer.functions.values()]
    XYZ = scene.basis.xyz(np.array([each.coefficients[-1] for each in tables]), vs.light("D65"))
    colours = np.array([[0, 0, 1], [0, 1, 0], [1, 1, 1]])
    assert linear_sRGB_from_XYZ(XYZ) == pytest.approx(colours, abs=0.01)


def test_a_scene_is_saved_and_read_with_its_channels(ome_tiff, tmp_path):
    scene = vs.Scene.from_volume(ome_tiff, lights=["D65"])
    again = vs.Scene.load(scene.save(tmp_path / "cells.toml"))
    assert [row.name for row in again.file.field] == ["Actin", "Actin 2"]
    assert len(again.volume().fields) == 2


def test_limits_are_those_of_the_file_or_of_the_histogram(values):
    stated = vs.Volume(values[0], channel=Channel(limits=(200.0, 900.0)))
    assert channel_limits(stated) == (200.0, 900.0)
    low, high = channel_limits(vs.Volume(values[0], channel=Channel(limits=(5e4, 6e4))))
    assert 90 <= low < high and high > 2000
    # Far from 0, where the range is in the last of a number's digits.
    low, high = channel_limits(vs.Volume((values[0] / 1000 + 1e6).astype(np.float32)))
    assert 1e6 < low < high and high > 1e6 + 1


def test_imagej_s_colours_and_limits_are_read(values, tmp_path):
    path = tmp_path / "stack.tif"
    ramp = np.arange(256, dtype=np.uint8)
    colours = (1, 0, 0), (0, 1, 0), (1, 1, 0)
    luts = [np.stack([ramp * code for code in colour]) for colour in colours]
    metadata = {"axes": "ZCYX", "unit": "um", "spacing": 0.5, "LUTs": luts}
    metadata["Ranges"] = (100.0, 2000.0, 0.0, 900.0, 5.0, 5.0)
    stack = values.transpose(1, 0, 2, 3)
    tifffile.imwrite(path, stack, imagej=True, resolution=(5.0, 5.0), metadata=metadata)
    channels = [each.channel for each in load_volume(path).by_name.values()]
    assert [c.colour for c in channels] == list(colours)
    assert [c.limits for c in channels] == [(100.0, 2000.0), (0.0, 900.0), None]


def test_a_dark_channel_is_left_out(values, tmp_path):
    path, dark = tmp_path / "dark.ome.tif", values.copy()
    dark[0] = 7
    metadata = {"axes": "ZCYX", **SIZES}
    tifffile.imwrite(path, dark.transpose(1, 0, 2, 3), metadata=metadata)
    with warns("left out"):
        volume = load_volume(path)
    assert np.array_equal(volume.values, dark[1]) and len(volume.fields) == 1
    empty = dark.astype(np.float32)
    empty[1] = np.nan
    tifffile.imwrite(path, empty.transpose(1, 0, 2, 3), metadata=metadata)
    with pytest.warns(VolspecWarning) as caught:
        volume = load_volume(path)
    assert any("channel 1" in str(each.message) for each in caught)
    assert np.array_equal(volume.values, empty[2]) and volume.fields == ()
