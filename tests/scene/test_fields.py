"""``[[field]]``: files, channels, matrices and weights, and what is refused."""

import pickle
from copy import copy, deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises, warns
from tests.support.scenes import scene_text
from volspec.errors import InputError, SceneError
from volspec.export.plan import check_scene
from volspec.scene.writing import write_scene

HEAD = scene_text(
    {"bone": "grey:0.7", "hot": "ColorChecker/orange"},
    [(60, 0, "bone"), (200, 0.3, "bone")],
    file="ct.npy",
    lights={"D65": "D65"},
)
FIELD = """
[[field]]
name = "PET"
file = "pet.npy"
{keys}
[field.transfer]
{own}
points = [
    {{ value = 0.2, opacity = 0, material = "hot" }},
    {{ value = 1, opacity = 0.5, material = "hot" }},
]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    z, y, x = np.mgrid[-1:1:20j, -1:1:22j, -1:1:24j]
    np.save(tmp_path / "ct.npy", (220 * np.exp(-2 * (x**2 + y**2 + z**2))).astype(np.uint8))
    z, y, x = np.mgrid[-1:1:10j, -1:1:10j, -1:1:10j]
    np.save(tmp_path / "pet.npy", np.exp(-3 * (x**2 + y**2 + z**2)).astype(np.float32))
    return tmp_path


def scene(folder: Path, keys: str = "", own: str = "", head: str = HEAD) -> vs.Scene:
    path = folder / "scene.toml"
    path.write_text(head + FIELD.format(keys=keys, own=own))
    return vs.Scene.load(path)


MASKED = """
mask = "organs"
[[transfer.label]]
label = ["liver", 7]
points = [
    { value = 60, opacity = 0, material = "hot" },
    { value = 150, opacity = 0.6, material = "hot" },
]
[[transfer.label]]
label = 2
shown = false
"""
ORGANS = """
[[field]]
name = "organs"
file = "organs.npy"
spacing_mm = [2, 2, 2]
"""


@pytest.fixture
def masked(folder: Path) -> Path:
    """A scene whose CT has a mask on a coarser lattice."""
    organs = np.zeros((10, 11, 12), np.uint8)
    organs[:, :5, :6], organs[:, 5:, :6] = 1, 2
    np.save(folder / "organs.npy", organs)
    (folder / "organs.txt").write_text("1 liver\n2 spleen\n")
    path = folder / "masked.toml"
    path.write_text(HEAD.replace("[[light]]", MASKED + "[[light]]") + ORGANS)
    return path


def cast(scene: vs.Scene) -> vs.CoefficientImage:
    return scene.render(size=(40, 32))


@pytest.mark.not_quick
def test_a_scene_s_fields_are_cast_as_in_python(folder):
    made = scene(folder, "matrix = [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]]")
    ct, pet = (np.load(folder / name) for name in ("ct.npy", "pet.npy"))
    world = [[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]]
    own = vs.Volume(ct).with_fields([vs.Volume(pet, world_from_index=world, name="PET")])
    is_cast_as(made, own, made.transfer)


def is_cast_as(made: vs.Scene, volume: vs.Volume, transfer: vs.FieldFunctions) -> None:
    """Check that a scene is cast as a volume by functions, of which the first alone differs."""
    found, camera = cast(made).coefficients, made.camera(made.volume())
    same, alone = (
        vs.raycast(volume, each, camera, (40, 32), made.raycast).coefficients
        for each in (transfer, transfer.functions[""])
    )
    assert np.array_equal(found, same) and np.abs(found - alone).max() > 0.05


@pytest.mark.not_quick
def test_weights_and_shown_are_of_each_field(folder):
    whole = cast(scene(folder))
    none = cast(scene(folder, own="weight = 0.0"))
    hidden = cast(scene(folder, own="shown = false"))
    assert np.array_equal(none.coefficients, hidden.coefficients)
    assert not np.array_equal(whole.coefficients, hidden.coefficients)
    other = cast(scene(folder, head=HEAD.replace("[transfer]", "[transfer]\nshown = false")))
    assert 0 < other.alpha.max() < whole.alpha.max() + 1e-6


@pytest.mark.not_quick
def test_a_hidden_field_is_cast_as_fast_and_alike_as_a_volume_alone(folder):
    hidden = cast(scene(folder, own="shown = false", keys="spacing_mm = [2, 2, 2]"))
    (folder / "alone.toml").write_text(HEAD)
    alone = vs.Scene.load(folder / "alone.toml")
    assert np.array_equal(hidden.coefficients, cast(alone).coefficients)


@pytest.mark.parametrize(
    ("keys", "own", "code"),
    [
        ("matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]", "", "range"),
        ("matrix = [[1, 0, 0, 0]]", "", None),
        ("", "weight = -1.0", "range"),
        ("", "gradient_opacity = [[0, 0], [1, 1]]", "conflict"),
        ("matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 1]]", "", "range"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(folder, keys, own, code):
    with raises(SceneError, code) as caught:
        cast(scene(folder, keys, own))
    assert "[[field]] PET" in str(caught.value) and "\n" not in str(caught.value).strip()


@pytest.mark.parametrize(
    ("keys", "raycast", "words"),
    [
        ("", 'clip_planes = [{point_mm = [0, 0, 0], normal = [0, 0, 1], fields = ["MR"]}]', "'MR'"),
        ("", "preintegrated = true", "several fields"),
        ("spacing_mm = [1e6, 1e6, 1e6]", "", "'PET'"),
    ],
)
def test_what_a_cast_refuses_is_found_by_the_check(folder, keys, raycast, words):
    head = HEAD + f"[raycast]\n{raycast}\n"
    (folder / "scene.toml").write_text(head + FIELD.format(keys=keys, own=""))
    (fault,) = check_scene(folder / "scene.toml").errors
    assert words in fault and "scene.toml" in fault
    with raises(InputError):
        vs.Scene.load(folder / "scene.toml").render()


def test_a_field_that_is_missing_is_named(folder):
    path = folder / "scene.toml"
    path.write_text(HEAD + FIELD.format(keys="", own="").replace('file = "pet.npy"', ""))
    with raises(SceneError, "unknown") as caught:
        vs.Scene.load(path).volume()
    assert "PET" in str(caught.value)


@pytest.mark.not_quick
def test_a_scene_s_mask_is_cast_as_in_python(masked):
    made = vs.Scene.load(masked)
    assert not check_scene(masked).errors
    liver = vs.TransferFunction([(60, 0.0, "hot"), (150, 0.6, "hot")], made.materials, made.basis)
    mask = vs.Mask("organs", {1: liver, 7: liver, 2: None})
    own = {"": made.transfer.functions[""]}
    is_cast_as(made, made.volume(), vs.FieldFunctions(own, masks={"": mask}))


def pickled(given: Any) -> Any:
    return pickle.loads(pickle.dumps(given))


@pytest.mark.parametrize("again", [pickled, deepcopy, copy])
def test_scenes_and_their_errors_are_pickled_and_copied(masked, again):
    made = vs.Scene.load(masked)
    other = again(made)
    assert again(made.transfer).masks[""].functions.keys() == {"liver", 7, 2}
    assert str(other.transfer) == str(made.transfer) and repr(other.file) == repr(made.file)
    assert np.array_equal(cast(other).coefficients, cast(made).coefficients)
    masked.write_text("volume = 1")
    with pytest.raises(SceneError) as caught:
        vs.Scene.load(masked)
    assert str(again(caught.value)) == str(caught.value)
    assert again(caught.value).code == caught.value.code


def test_masks_are_written_and_read_back(masked):
    made = vs.Scene.load(masked)
    kept = made.save(masked.with_name("kept.toml"))
    assert vs.Scene.load(kept).file == made.file and "[[transfer.label]]" in kept.read_text()
    rows = made.file.transfer.label
    made.file = replace(made.file, transfer=replace(made.file.transfer, label=rows[:1]))
    fewer = made.save(masked.with_name("fewer.toml"))
    assert vs.Scene.load(fewer).file == made.file
    fresh = write_scene(made.file, masked.with_name("fresh.toml"))
    assert vs.Scene.load(fresh).file == made.file


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ('"liver"', '"lever"', "transfer.label[0].label: 'organs' has no label 'lever'"),
        ('mask = "organs"', 'mask = "organ"', "has no field 'organ'; did you mean 'organs'?"),
        ("label = 2", "label = -7", "transfer.label[1].label"),
        ("label = 2", "label = 7", "transfer.label[1].label: 7 is given twice"),
        ("label = 2", "values = [3, 3]", "transfer.label[1].values"),
        ("label = 2", "label = 2\nvalues = [3, 4]", "transfer.label[1].label: given with values"),
        ("shown = false", "", "transfer.label[1].points: missing"),
        ('mask = "organs"', "", "transfer.mask: missing"),
        ("opacity = 0.6", "opacity = 1.6", "transfer.label[0].points[1].opacity"),
    ],
)
def test_a_mistaken_mask_is_found_at_its_row(masked, old, new, place):
    text = masked.read_text()
    assert old in text
    masked.write_text(text.replace(old, new))
    (fault,) = check_scene(masked).errors
    assert place in fault and "\n" not in fault


def test_a_row_of_labels_that_are_nowhere_is_warned_of(masked):
    masked.write_text(masked.read_text().replace("label = 2", "label = 77"))
    with warns("transfer.label[1]", "'organs' (0 … 2)", "77"):
        assert not check_scene(masked).errors


def test_a_mask_s_file_must_hold_labels(masked):
    np.save(masked.with_name("organs.npy"), np.linspace(0, 1, 1320).reshape(10, 11, 12))
    masked.with_name("organs.txt").unlink()
    (fault,) = check_scene(masked).errors
    assert "transfer.label[0]" in fault and "not labels" in fault
