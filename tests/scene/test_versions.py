"""The version of a scene's file, and older ones brought to it."""

from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

import pytest

from tests.support.errors import raises
from tests.support.scenes import BALL, DAY, write_scene_text
from volspec.errors import SceneError
from volspec.scene import Scene, file
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, SpectralGrid

TEXT = f"# A ball.{BALL}# By day.\n{DAY}".replace("version = 2\n", "")
COARSE = SpectralGrid(380, 780, 10)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_scene_text(tmp_path, TEXT)


def load(path: Path, text: str) -> Scene:
    path.write_text(text, encoding="utf-8")
    return Scene.load(path)


def test_a_file_without_a_version_is_of_the_first(path):
    """Files of the first release have no version; written again they say what they had."""
    scene = Scene.load(path)
    assert scene.file.version == 2
    assert (scene.basis.name, scene.basis.grid) == ("general-7-10nm", PAPERS_GRID)
    assert scene.relight.mode == "componentwise"
    text = scene.save().read_text(encoding="utf-8")
    # Nothing is lost, and only the version and the former defaults are new.
    assert [line for line in TEXT.splitlines() if line not in text.splitlines()] == []
    assert [line for line in text.splitlines() if line and line not in TEXT.splitlines()] == [
        "version = 2",
        "[viewing]",
        'mode = "componentwise"',
        "[basis]",
        "grid_nm = [400.0, 700.0, 10.0]",
    ]
    assert Scene.load(path).file == scene.file
    assert Scene.load(path).save().read_text(encoding="utf-8") == text
    assert load(path, f"version = 1\n{TEXT}").file == scene.file


def test_the_second_version_has_81_bands_and_fitted_colours(path):
    scene = load(path, f"version = 2\n{TEXT}")
    assert (scene.basis.name, scene.basis.grid) == ("general-7", DEFAULT_GRID)
    assert scene.relight.mode == "fitted"
    assert scene.save().read_text(encoding="utf-8") == f"version = 2\n{TEXT}"


@pytest.mark.parametrize(
    ("table", "name", "grid", "mode"),
    [
        ('name = "general-9-positive"', "general-9-positive-10nm", PAPERS_GRID, "componentwise"),
        ("size = 5", "general-5-10nm", PAPERS_GRID, "componentwise"),
        ('method = "materials"', "scene", PAPERS_GRID, "componentwise"),
        ('grid_nm = [380, 780, 10]\nmethod = "pca"', "scene", COARSE, "componentwise"),
        ('size = 5\n[viewing]\nmode = "exact"', "general-5-10nm", PAPERS_GRID, "exact"),
    ],
)
def test_the_first_version_s_defaults_are_kept_next_to_what_a_file_says(
    path, table, name, grid, mode
):
    scene = load(path, f"{TEXT}[basis]\n{table}\n")
    assert (scene.basis.name, scene.basis.grid, scene.relight.mode) == (name, grid, mode)
    saved = Scene.load(scene.save())
    assert saved.file == scene.file
    assert saved.basis.fingerprint == scene.basis.fingerprint


@pytest.mark.parametrize("version", [1, 2])
def test_bands_of_a_palette_are_those_of_its_values(path, version):
    """Designs without ``grid_nm`` are of the first release if they have 31 values."""
    for bands, grid in ((31, PAPERS_GRID), (81, DEFAULT_GRID)):
        palette = path.with_name("design.toml")
        palette.write_text(f'[[light]]\nname = "lamp"\nvalues = {[1.0] * bands}\n')
        text = f"version = {version}\n" + TEXT.replace('"D65"', '"design.toml#lamp"')
        assert load(path, text).basis.grid == grid


@pytest.mark.parametrize(
    ("version", "code"), [("3", "unsupported"), ("0", "range"), ('"1"', "range"), ("true", "range")]
)
def test_another_version_is_refused_in_one_line(path, version, code):
    with raises(SceneError, code, "version") as caught:
        load(path, f"version = {version}\nlater = true\n{TEXT}")
    assert str(path) in str(caught.value)


def test_a_migration_is_applied_before_the_file_is_checked(path, monkeypatch):
    """Suppose that the next version called a light's spectrum its power: old files load, and are
    written in the new form with their comments."""

    def renamed(data: MutableMapping[str, Any]) -> None:
        for row in data["light"]:
            row["spectrum"] = row.pop("power")

    monkeypatch.setattr(file, "MIGRATIONS", {**file.MIGRATIONS, 2: renamed})
    scene = load(path, TEXT.replace("spectrum =", "power ="))
    assert (scene.file.version, scene.file.light[0].spectrum) == (3, "D65")
    text = scene.save().read_text(encoding="utf-8")
    assert 'spectrum = "D65"' in text and "power" not in text and "# By day." in text
    assert "version = 3\n" in text and text.startswith("# A ball.\n")
    assert Scene.load(path).file == scene.file
