"""A scene's file from disk: text, tables, and what is wrong in words.

TOML -> [reading] -> SceneFile
"""

from __future__ import annotations

import os
from typing import Any

from pydantic import ValidationError

from volspec._parse import parse_toml, read_text
from volspec._tables import faults
from volspec.errors import SceneError
from volspec.scene.file import SceneFile
from volspec.scene.versions import migrate


class SceneFaults(SceneError):
    """Several things are wrong with one file; it says the first, and knows all."""

    def __init__(self, lines: list[str]) -> None:
        super().__init__(lines[0])
        self.lines = lines


def scene_text(path: str | os.PathLike[str]) -> str:
    """What a scene's file says.

    Raises
    ------
    SceneError
        If it cannot be read.
    """
    return read_text(path, SceneError, "a scene file (.toml)")


def scene_data(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The tables of a scene's file in the newest version, not checked yet.

    Raises
    ------
    SceneError
        If it cannot be read, is no TOML or of a later version.
    """
    name, text = os.fspath(path), scene_text(path)
    try:
        data = parse_toml(text)
    except ValueError as error:
        raise SceneError(f"{name}: not valid TOML: {error}") from error
    try:
        migrate(data)
    except SceneError as error:
        raise SceneError(f"{name}: {error}") from None
    return data


def scene_file(data: dict[str, Any], path: str | os.PathLike[str]) -> SceneFile:
    """The tables, each checked by itself and beside the others.

    Raises
    ------
    SceneError
        Names file, field and value of the first that is wrong; `SceneFaults.lines` are all.
    """
    try:
        return SceneFile.model_validate(data)
    except ValidationError as error:
        name = os.fspath(path)
        raise SceneFaults([f"{name}: {line}" for line in faults(error, SceneFile)]) from error
