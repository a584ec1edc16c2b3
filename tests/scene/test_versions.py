"""The version of a scene's file, and older ones brought to it."""

from __future__ import annotations

from collections.abc import MutableMapping
from pathlib import Path
from typing import Any

import pytest

from tests.support.errors import raises
from tests.support.scenes import BALL, DAY, write_scene_text
from volspec.errors import SceneError
from volspec.scene import Scene, file

TEXT = f"# A ball.{BALL}# By day.\n{DAY}"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_scene_text(tmp_path, TEXT)


def test_a_file_without_a_version_is_of_the_first(path: Path) -> None:
    """Files of the first release have no version, and get none when written again."""
    scene = Scene.load(path)
    assert scene.file.version == 1
    assert scene.save().read_text(encoding="utf-8") == TEXT
    path.write_text(f"version = 1\n{TEXT}", encoding="utf-8")
    assert Scene.load(path).file == scene.file


@pytest.mark.parametrize(
    ("version", "message"),
    [
        ("2", "version is 2; this volspec reads up to 1; install a later one"),
        ("0", "version is 0; give a whole number from 1"),
        ('"1"', "version is '1'; give a whole number from 1"),
        ("true", "version is True; give a whole number from 1"),
    ],
)
def test_another_version_is_refused_in_one_line(path: Path, version: str, message: str) -> None:
    path.write_text(f"version = {version}\nlater = true\n{TEXT}", encoding="utf-8")
    with pytest.raises(SceneError) as caught:
        Scene.load(path)
    assert str(caught.value) == f"{path}: {message}"


def test_a_migration_is_applied_before_the_file_is_checked(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Suppose that the next version called a light's spectrum its power: old files load, and are
    written in the new form with their comments."""

    def renamed(data: MutableMapping[str, Any]) -> None:
        for row in data["light"]:
            row["spectrum"] = row.pop("power")

    path.write_text(TEXT.replace("spectrum =", "power ="), encoding="utf-8")
    with raises(SceneError, "unknown", "light[0].power"):
        Scene.load(path)
    monkeypatch.setattr(file, "MIGRATIONS", {1: renamed})
    scene = Scene.load(path)
    assert (scene.file.version, scene.file.light[0].spectrum) == (2, "D65")
    text = scene.save().read_text(encoding="utf-8")
    assert 'spectrum = "D65"' in text and "power" not in text and "# By day." in text
    assert "version = 2\n" in text and text.startswith("# A ball.\n")
    assert Scene.load(path).file == scene.file
