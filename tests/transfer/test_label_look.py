"""First look of a segmentation: materials, colours, names, and the scene made of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises
from tests.support.raycasts import METAL_BASIS, METALS
from tests.volume.test_labels import blocks
from volspec.appearance.display.spaces import encode_sRGB, linear_sRGB_from_XYZ
from volspec.basis import MaterialBasis
from volspec.errors import SpectrumError, TransferError, VolumeError
from volspec.spectra import DEFAULT_GRID
from volspec.transfer import LabelFunction, label_look
from volspec.transfer.nan_voxels import MaskLabels, bake_for_volume
from volspec.volume.labels import Label


@pytest.mark.parametrize("colour", [(1, 0, 0), (0.2, 0.7, 0.4), (0.9, 0.8, 0.95), (0.0, 0.0, 0.0)])
def test_a_mix_has_its_display_colour_under_daylight(colour):
    spectrum = vs.reflectance(label_look.mix_text(label_look.smits_weights(colour)))
    XYZ = MaterialBasis({"m": spectrum}).xyz([1, 0], vs.light("D65"))
    shown = encode_sRGB(linear_sRGB_from_XYZ(XYZ))
    assert np.abs(shown - colour).max() < 0.02


def test_colours_of_neighbouring_numbers_differ():
    codes = np.array(label_look.distinct_colours(255))
    assert np.linalg.norm(np.diff(codes[:24], axis=0), axis=1).min() > 0.2
    assert len({tuple(row) for row in codes.tolist()}) == 255


def test_black_in_a_table_is_no_colour():
    labels = {1: Label("a", (0, 0, 0)), 2: Label("b", (1, 0, 0)), 3: Label("c")}
    colours = label_look.label_colours(labels)
    assert max(colours[1]) > 0.2 and colours[2] == (1, 0, 0) and colours[3] != colours[1]


def test_few_labels_have_a_material_each_and_many_share_eight():
    few = vs.Volume(blocks([1, 2]), labels={1: Label("liver"), 2: Label()})
    function, texts = label_look.label_function(few, DEFAULT_GRID)
    assert list(function.materials) == list(texts) == ["liver", "label 2"]
    assert function.names == {1: "liver"}
    many = vs.Volume(blocks(list(range(1, 118)), 3), labels={n: Label() for n in range(1, 118)})
    function, texts = label_look.label_function(many, DEFAULT_GRID)
    assert len(function.labels) == 117 and len(function.materials) <= 8 and function.basis.size <= 9


@pytest.mark.filterwarnings("ignore:.*quality")
@pytest.mark.not_quick
def test_a_segmentation_opens_with_labels_and_its_scene_keeps_them(tmp_path):
    np.save(tmp_path / "v.npy", blocks([1, 2, 5]))
    (tmp_path / "v.txt").write_text("1 liver\n2 spleen\n5 aorta\n")
    scene = vs.Scene.from_volume(tmp_path / "v.npy")
    assert isinstance(scene.transfer, LabelFunction) and isinstance(scene.basis, MaterialBasis)
    again = vs.Scene.load(scene.save(tmp_path / "v.toml"))
    assert isinstance(again.transfer, LabelFunction)
    assert again.transfer.names == {1: "liver", 2: "spleen", 5: "aorta"}
    assert again.render(size=(48, 32)).alpha.max() > 0.9
    soft = vs.Scene.from_volume(tmp_path / "v.npy", preset="soft-hard")
    assert soft.file.transfer.kind == "points"


@pytest.mark.not_quick
def test_a_scene_s_labels_have_the_numbers_of_the_file(tmp_path):
    """Also in masks of another volume, by number or name."""
    np.save(tmp_path / "v.npy", blocks([997, 614454277, 70000], dtype=np.uint32))
    (tmp_path / "v.txt").write_text("997 root\n70000 CH\n614454277 SCs\n")
    scene = vs.Scene.from_volume(tmp_path / "v.npy")
    again = vs.Scene.load(scene.save(tmp_path / "v.toml"))
    assert [row.label for row in again.file.transfer.labels] == [997, 70000, 614454277]
    # As of labels that need no other numbers.
    np.save(tmp_path / "few.npy", blocks([1, 3, 2], dtype=np.uint16))
    few = vs.Scene.from_volume(tmp_path / "few.npy")
    one, other = (each.casting(step_mm=0.5).render(size=(40, 24)).alpha for each in (again, few))
    assert np.array_equal(one, other) and one.max() > 0.9
    function = again.transfer
    assert isinstance(function, LabelFunction)
    alone = replace(function, hidden=frozenset({997, 70000})).bake(1.0, again.volume().numbers)
    assert alone.opacity.tolist() == [0, 0, 0, 0.9]
    labels = MaskLabels.of("", again.volume())
    assert [labels.add(each) for each in ("CH", 614454277)] == [(2, 3), (3, 4)]
    assert not labels.reaches(*labels.add(8))


def test_great_labels_of_values_that_are_no_labels_are_refused():
    volume = vs.Volume(blocks([1, 70000], dtype=np.float32))
    function = LabelFunction({70000: (1.0, "gold")}, METALS, METAL_BASIS)
    with raises(TransferError, "range", "LabelFunction.labels"):
        bake_for_volume(function, volume)


def test_labels_can_be_asked_for(tmp_path):
    np.save(tmp_path / "mask.npy", blocks([1, 1]))
    assert vs.Scene.from_volume(tmp_path / "mask.npy").file.transfer.kind == "points"
    labelled = vs.Scene.from_volume(tmp_path / "mask.npy", preset="labels")
    assert labelled.file.transfer.kind == "labels"


def labels_of_fractions(folder: Path) -> vs.Scene:
    np.save(folder / "mask.npy", blocks([1, 1]) * np.float32(0.3))
    return vs.Scene.from_volume(folder / "mask.npy", preset="labels")


@pytest.mark.parametrize(
    ("make", "error", "code"),
    [
        (labels_of_fractions, VolumeError, "conflict"),
        (lambda _: vs.reflectance("white*0.75+copper*0.5"), SpectrumError, "range"),
        (lambda _: vs.reflectance("white*0.25+coper*0.5"), SpectrumError, "unknown"),
    ],
)
def test_mixes_above_one_and_labels_of_fractions_are_refused(tmp_path, make, error, code):
    with raises(error, code):
        make(tmp_path)


def test_hidden_labels_are_transparent_and_keep_their_opacity():
    volume = vs.Volume(blocks([1, 2]), labels={1: Label("liver"), 2: Label("spleen")})
    function, _ = label_look.label_function(volume, DEFAULT_GRID)
    hidden = replace(function, reference_step_mm=1.0, hidden=frozenset({2}))
    assert hidden.bake(1.0).opacity.tolist() == [0, 0.9, 0] and hidden.labels[2][0] == 0.9


def test_the_weights_of_any_colour_are_a_mix():
    codes = np.random.default_rng(0).integers(0, 256, (4000, 3)) / 255
    sums = [sum(label_look.smits_weights(each).values()) for each in codes]
    assert min(sums) > 0 and max(sums) <= 1
