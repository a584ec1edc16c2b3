"""Labels of segmentations: which volumes hold them, and their names and colours."""

import gzip
import pickle
import struct
import warnings

import numpy as np
import pytest
import SimpleITK as sitk
from scipy.ndimage import gaussian_filter

from tests.support.errors import raises, warns
from tests.support.volumes import load_silently, nifti
from tests.volume.test_zarr import edit_ome, write
from volspec.errors import VolumeError
from volspec.volume import Volume, load_volume
from volspec.volume.files.label_tables import read_label_table
from volspec.volume.labels import Label
from volspec.volume.summary import summarise

RED = (1.0, 0.0, 0.0)


def blocks(numbers: list[int], side: int = 6, dtype: type = np.uint8) -> np.ndarray:
    """A cube per label in a row, with background around them."""
    row = np.zeros((side + 2, side + 2, len(numbers) * (side + 1) + 1), dtype)
    for k, number in enumerate(numbers):
        start = k * (side + 1) + 1
        row[1:-1, 1:-1, start : start + side] = number
    return row


def smooth(levels: int, side: int = 24) -> np.ndarray:
    """A ball whose value falls from its centre, in few grey levels."""
    z, y, x = np.mgrid[-1 : 1 : side * 1j, -1 : 1 : side * 1j, -1 : 1 : side * 1j]
    return (np.clip(1 - x * x - y * y - z * z, 0, 1) * levels).astype(np.uint8)


NOISE = np.random.default_rng(1).integers(0, 30, (16, 16, 16)).astype(np.uint8)
CASES = {
    "few": (blocks([1, 2, 3]), 3),
    "116": (blocks(list(range(1, 117)), side=3), 116),
    "a hundred far apart": (blocks(list(range(1000, 3000, 20)), 3, np.uint16), 100),
    "whole floats": (blocks([1, 2, 5], dtype=np.float32), 3),
    "floats": (blocks([1, 2, 5], dtype=np.float32) * 0.5, 0),
    "a mask": (blocks([1, 1]), 0),
    "a phantom": (blocks([60, 120, 255]), 0),
    "a CT phantom": (blocks([0, 40, 300], dtype=np.int16) - 100, 0),
    "noise": (NOISE, 0),
    "grey levels": (smooth(20), 0),
}


@pytest.mark.parametrize("case", CASES)
def test_label_maps_are_told_from_measurements(tmp_path, case):
    values, count = CASES[case]
    np.save(tmp_path / "v.npy", values)
    assert len(load_silently(tmp_path / "v.npy").labels) == count


GREAT = 720575940379283


@pytest.mark.parametrize("dtype", [np.uint32, np.int64, np.float64])
def test_an_atlas_s_great_numbers_are_those_of_its_labels(tmp_path, dtype):
    """Voxels hold consecutive ones."""
    most = 614454277 if dtype == np.uint32 else GREAT
    np.save(tmp_path / "v.npy", blocks([997, most, 70000], dtype=dtype))
    volume = load_silently(tmp_path / "v.npy")
    assert volume.labels == {997: Label(), 70000: Label(), most: Label()}
    assert volume.numbers == (0, 997, 70000, most) and volume.values.dtype == np.uint16
    assert np.array_equal(volume.stated(volume.values), np.load(tmp_path / "v.npy"))
    assert [volume.value_of(number) for number in (997, most, 5)] == [1, 3, 9]
    assert summarise(volume).labels == {997: "", 70000: "", most: ""}
    (tmp_path / "v.txt").write_text(f"997 root 1 2 3\n70000 CH 4 5 6\n{most} SCs 255 0 0\n")
    labels = load_volume(f"{tmp_path}/v.npy?labels=v.txt").labels
    assert [each.name for each in labels.values()] == ["root", "CH", "SCs"]
    assert labels[most].colour == RED


@pytest.mark.parametrize("ending", ["nii.gz", "nrrd", "tif", "mha"])
def test_great_numbers_are_read_from_any_file(tmp_path, ending):
    values, path = blocks([5, 614454277, 70000], dtype=np.int32), tmp_path / f"v.{ending}"
    sitk.WriteImage(sitk.GetImageFromArray(values), str(path))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a spacing that TIFF does not state
        assert [*load_volume(path).labels] == [5, 70000, 614454277]


def test_an_array_with_its_labels_has_their_numbers():
    values = blocks([997, 614454277], dtype=np.uint32)
    volume = Volume(values, labels={614454277: Label("SCs")})
    assert volume.numbers == (0, 997, 614454277)
    again = pickle.loads(pickle.dumps(volume.downsampled(2, labels=True)))
    assert again.numbers == volume.numbers and again.labels == volume.labels


def cells(count: int, side: int, first: int = 1) -> np.ndarray:
    """Touching balls of radius 3 in random places, with consecutive numbers."""
    ball = sum(np.square(np.mgrid[-3:4, -3:4, -3:4])) < 9
    values = np.zeros((side,) * 3, np.uint32)
    places = np.random.default_rng(0).integers(0, side - 7, (count, 3))
    for number, (z, y, x) in enumerate(places, first):
        part = values[z : z + 7, y : y + 7, x : x + 7]
        part[ball & (part == 0)] = number
    return values


def grains(count: int) -> np.ndarray:
    """Cubes of two voxels, with numbers in random order and background between them."""
    numbers = np.zeros((52, 52, 52), np.uint32)
    numbers[:, ::2].flat[:count] = np.random.default_rng(0).permutation(count) + 1
    return np.kron(numbers, np.ones((2, 2, 2), np.uint32))


def test_any_number_of_cells_are_labels_and_enlarged_scans_are_none(tmp_path):
    for values in (cells(1500, 64), cells(1500, 64, 600_000_000)):
        np.save(tmp_path / "v.npy", values)
        assert len(load_silently(tmp_path / "v.npy").labels) == len(np.unique(values)) - 1 > 1300
    smooth = gaussian_filter(np.random.default_rng(1).random((20, 20, 20)), 2)
    scan = np.rint((smooth - smooth.min()) * 5e5).astype(np.uint16)
    np.save(tmp_path / "v.npy", np.kron(scan, np.ones((4, 4, 4), np.uint16)))
    with warns("?labels=FILE"):
        assert not load_volume(tmp_path / "v.npy").labels


@pytest.mark.parametrize(
    ("values", "query", "why"),
    [
        (blocks([-1, 1, 2], dtype=np.int16), "", "down to -1"),
        (blocks([-1, 614454277, 2], dtype=np.int32), "", "down to -1"),
        (grains(70_000), "", "70001 numbers are more than 65535"),
        (blocks([7, 614454277, 2], dtype=np.uint32), "?memory=1KiB", "coarser level"),
    ],
)
def test_labels_that_cannot_be_shown_as_such_are_remarked_on(tmp_path, values, query, why):
    np.save(tmp_path / "v.npy", values)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert not load_volume(f"{tmp_path}/v.npy{query}").labels
    assert sum(why in str(each.message) for each in caught) == 1


TABLES = {
    "v.ctbl": "# Color\n0 Background 0 0 0 0\n1 liver 255 0 0 255\n2 left_kidney 0 128 255 255\n",
    "v_LUT.txt": "#No. Label Name: R G B A\n\n0  Unknown 0 0 0 0\n1 liver 255 0 0 0\n"
    "2  left_kidney  0 128 255 0\n",
    "v.label": '################\n  0  0 0 0  0 0 0  "Clear Label"\n  1 255 0 0 1 1 1 "liver"\n'
    '  2 0 128 255 0.5 1 1 "left_kidney"\n',
    "v.tsv": "index\tname\tcolor\n1\tliver\t#ff0000\n2\tleft_kidney\t#0080ff\n",
    "named.txt": "1 liver 2001\r\n2 left_kidney 2002\r\n",
    "tabbed.txt": "0\tUnclassified\n1\tliver\n2\tleft_kidney\n",
    "numbers.json": '{"1": "liver", "2": "left_kidney"}',
    "dataset.json": '{"labels": {"background": 0, "liver": 1, "left_kidney": 2}}',
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_other_programs_are_read(tmp_path, name):
    (tmp_path / name).write_text(TABLES[name])
    table = read_label_table(tmp_path / name)
    assert (table[1].name, table[2].name) == ("liver", "left_kidney")
    if "255" in TABLES[name] or "#ff" in TABLES[name]:
        assert table[1].colour == RED and table[2].colour == (0, 128 / 255, 1)
    np.save(tmp_path / "seg.npy", blocks([1, 2]))
    assert load_silently(f"{tmp_path}/seg.npy?labels={name}").labels == {1: table[1], 2: table[2]}


def test_names_and_colours_of_two_tables_next_to_a_volume_are_joined(tmp_path):
    """MRIcron has names in a text, and 256 colours in planes of red, green and blue."""
    (tmp_path / "v.nii.gz").write_bytes(gzip.compress(nifti(blocks([1, 2]), np.eye(4), code=2)))
    (tmp_path / "v.nii.txt").write_text("1 liver 7\n2 kidney 9\n")
    lut = np.zeros((3, 256), np.uint8)
    lut[:, 1], lut[:, 2] = (255, 0, 0), (0, 255, 0)
    (tmp_path / "v.nii.lut").write_bytes(lut.tobytes())
    labels = load_silently(tmp_path / "v.nii.gz").labels
    assert labels == {1: Label("liver", RED), 2: Label("kidney", (0, 1, 0))}


def test_notes_and_other_volumes_tables_do_not_make_labels(tmp_path):
    np.save(tmp_path / "v.npy", NOISE)
    (tmp_path / "v.txt").write_text("Scanned on a Monday\n2 views\n")
    assert not load_silently(tmp_path / "v.npy").labels
    (tmp_path / "v.ctbl").write_text(TABLES["v.ctbl"])
    assert not load_silently(tmp_path / "v.npy").labels
    np.save(tmp_path / "v.npy", blocks([1, 2, 3]))
    (tmp_path / "v.ctbl").write_text("5000 a 9 9 9 255\n6000 b 9 9 9 255\n")
    assert load_silently(tmp_path / "v.npy").labels == {1: Label(), 2: Label(), 3: Label()}


def test_a_table_that_names_all_values_makes_labels(tmp_path):
    np.save(tmp_path / "v.npy", blocks([10, 900], dtype=np.uint16))
    assert not load_silently(tmp_path / "v.npy").labels
    (tmp_path / "v.txt").write_text("10 liver\n900 spleen\n")
    assert load_silently(tmp_path / "v.npy").labels[900].name == "spleen"


@pytest.mark.parametrize("given", ["", "?labels=t.txt"])
def test_a_table_that_names_few_labels_is_warned_about(tmp_path, given):
    """A table may be another volume's; one of nine tenths of the labels causes no warning."""
    np.save(tmp_path / "v.npy", blocks(list(range(1, 11)), 3))
    table = tmp_path / ("t.txt" if given else "v.txt")
    table.write_text("".join(f"{n} part{n}\n" for n in range(1, 9)))
    with warns(table.name, "8 of the 10", file=__file__):
        assert load_volume(f"{tmp_path}/v.npy{given}").labels[8].name == "part8"
    table.write_text("".join(f"{n} part{n}\n" for n in range(1, 10)))
    load_silently(f"{tmp_path}/v.npy{given}")


@pytest.mark.parametrize(
    ("values", "table", "query", "code", "word"),
    [
        (blocks([1, 2]), None, "?labels=t.txt", "not-found", "t.txt"),
        (blocks([1, 2]), "{}", "?labels=t.txt", "syntax", "t.txt"),
        # JSON as it is written.
        (blocks([1, 2]), "once upon a time", "?labels=t.txt", "syntax", ' {"1": "liver"}'),
        (blocks([1, 2]), "1 a\n2 b\n", "?labels=", "missing", "labels"),
        (blocks([1, 2]), "0 no\n5000 a\n6000 b\n", "?labels=t.txt", "conflict", "(5000, 6000)"),
        (blocks([1, 2]) * np.float32(0.3), "1 a\n2 b\n", "?labels=t.txt", "conflict", "labels="),
    ],
    ids=["none", "empty", "no table", "no name", "of another volume", "no labels"],
)
def test_tables_that_do_not_fit_are_refused(tmp_path, values, table, query, code, word):
    np.save(tmp_path / "v.npy", values)
    if table is not None:
        (tmp_path / "t.txt").write_text(table)
    with raises(VolumeError, code) as caught:
        load_volume(f"{tmp_path}/v.npy{query}")
    assert word in str(caught.value)


def test_slicer_s_segments_are_labels(tmp_path):
    image = sitk.GetImageFromArray(blocks([1, 2]))
    lung = {"LabelValue": "1", "Name": "right lung", "Color": "1 0 0", "Layer": "0"}
    for number, segment in enumerate((lung, {"LabelValue": "2", "Name": "tumour"})):
        for key, value in segment.items():
            image.SetMetaData(f"Segment{number}_{key}", value)
    sitk.WriteImage(image, str(tmp_path / "v.seg.nrrd"))
    labels = load_silently(tmp_path / "v.seg.nrrd").labels
    assert labels == {1: Label("right lung", RED), 2: Label("tumour")}


def test_a_nifti_intent_makes_a_mask_a_label(tmp_path):
    data = bytearray(nifti(blocks([1, 1]), np.eye(4), code=2))
    for intent, labels in ((0, {}), (1002, {1: Label()})):
        struct.pack_into("<h", data, 68, intent)
        (tmp_path / "mask.nii").write_bytes(data)
        assert load_silently(tmp_path / "mask.nii").labels == labels


@pytest.mark.parametrize("packed", [False, True])
def test_names_in_a_nifti_extension_are_read(tmp_path, packed):
    """TotalSegmentator writes them like this."""
    xml = (
        b'<?xml version="1.0"?><CaretExtension><VolumeInformation Index="0"><LabelTable>'
        b'<Label Key="1" Red="1" Green="0" Blue="0" Alpha="1"><![CDATA[spleen]]></Label>'
        b'<Label Key="2" Red="0" Green="0.5" Blue="1" Alpha="1"><![CDATA[kidney_right]]></Label>'
        b"</LabelTable></VolumeInformation></CaretExtension>"
    )
    size = -(-(len(xml) + 8) // 16) * 16
    data = bytearray(nifti(blocks([1, 2]), np.eye(4), code=2))
    struct.pack_into("<f", data, 108, 352 + size)
    data[348] = 1
    data[352:352] = struct.pack("<2i", size, 30) + xml.ljust(size - 8, b"\0")
    path = tmp_path / ("v.nii.gz" if packed else "v.nii")
    path.write_bytes(gzip.compress(data) if packed else data)
    labels = {1: Label("spleen", RED), 2: Label("kidney_right", (0, 0.5, 1))}
    assert load_silently(path).labels == labels


def test_an_image_label_of_ome_zarr_has_names_and_colours(tmp_path):
    path = write(tmp_path / "v.zarr", blocks([1, 2], 3).astype(np.uint16))
    properties = [{"label-value": 1, "class": "nucleus"}, {"label-value": 2, "area": 7}]
    colours = [{"label-value": 1, "rgba": [255, 0, 0, 255]}]
    edit_ome(path, **{"image-label": {"colors": colours, "properties": properties}})
    assert load_silently(path).labels == {1: Label("nucleus", RED), 2: Label("")}


def test_labels_stay_through_spacing_and_downsampling():
    volume = Volume(blocks([1, 2]), labels={1: Label("liver")})
    assert volume.with_spacing((1, 2, 3)).labels == volume.labels
    assert volume.downsampled(2, labels=True).labels == volume.labels
