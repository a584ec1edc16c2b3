"""A redesigned scene on disk: its file with comments kept, and the palette beside it.

Redesigned -> [writing] -> NEW.toml, NEW-palette.toml
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from volspec._files import require_writable, write_whole
from volspec.errors import SceneError
from volspec.palette import Design, save_palette
from volspec.scene import Scene
from volspec.spectra.files import split_address


@dataclass(frozen=True, slots=True)
class Changes:
    """What is new in a scene's file.

    Parameters
    ----------
    materials : tuple of str
        Their reflectances come from the palette.
    light : str, optional
        A new light, from the palette too.
    lux : float, optional
        Its illuminance, where the light it is like has one.
    exact : bool
        Whether the scene is now cast by its materials, as its basis would blur the design.
    """

    materials: tuple[str, ...]
    light: str | None = None
    lux: float | None = None
    exact: bool = False


def write(scene: Scene, made: Design, changes: Changes, path: Path) -> tuple[Path, Path]:
    """Write both files; `Redesigned.save` says what can go wrong."""
    import tomlkit

    if path.suffix.lower() != ".toml":
        raise SceneError(f"{path}: scenes are TOML; name it .toml")
    beside = path.with_name(f"{path.stem}-palette.toml")
    for each in (path, beside):
        require_writable(each)
    try:
        document: Any = tomlkit.parse(scene.path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SceneError(
            f"{scene.path}: cannot be read again ({error.strerror}); load the scene from a file, "
            "whose comments are kept"
        ) from error
    if path.parent.resolve() != scene.folder.resolve():
        _lead_from(document, scene, path.parent)
    for row in document["material"]:
        if row["name"] in changes.materials:
            row["reflectance"] = f"{beside.name}#{row['name']}"
    if changes.light is not None:
        row = tomlkit.table()
        row["name"] = changes.light
        row["spectrum"] = f"{beside.name}#{changes.light}"
        if changes.lux is not None:
            row["illuminance_lux"] = changes.lux
        row.add(tomlkit.nl())
        document["light"].append(row)
    if changes.exact:
        basis = document.setdefault("basis", tomlkit.table())
        for key in [key for key in basis if key in ("name", "size", "positive", "train")]:
            del basis[key]
        basis["method"] = "materials"
    # The palette first: a scene without its palette would be broken, not the other way round.
    save_palette(made, beside)
    with write_whole(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8")
    return path, beside


def _lead_from(document: Any, scene: Scene, folder: Path) -> None:
    """Let file names start from another folder than the scene's."""
    for table, key in _addresses(document):
        text = str(table[key])
        if (file := _file_in(text, scene.folder)) is None:
            if set("+*") & set(text) and any(split_address(part) for part in text.split("+")):
                raise SceneError(
                    f"{scene.path}: {text!r} mixes files, which cannot be led to from "
                    f"{folder}; write the new scene into the folder of the old one"
                )
            continue
        led = Path(os.path.relpath(scene.folder / file, folder)).as_posix()
        table[key] = led + text[len(file) :]


def _addresses(document: Any) -> Iterator[tuple[Any, str]]:
    """Every place of a scene's file that may name a file."""
    yield document["volume"], "file"
    for row in document["material"]:
        yield from ((row, key) for key in ("reflectance", "filter") if key in row)
    yield from ((row, "spectrum") for row in document["light"])
    if "name" in document.get("basis", {}):
        yield document["basis"], "name"


def _file_in(text: str, folder: Path) -> str | None:
    """The part of an address that is a file's name, if it is one."""
    if address := split_address(text):
        return address[0]
    file = text.partition("?")[0]
    return file if (folder / file).exists() else None
