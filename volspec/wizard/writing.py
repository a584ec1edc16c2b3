"""A redesigned scene on disk: its file with comments kept, and the palette beside it.

Redesigned -> [writing] -> NEW.toml, NEW-palette.toml
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from volspec._files import line_end, require_writable, write_whole
from volspec.errors import SceneError, SpectrumError
from volspec.palette import Design, save_palette
from volspec.scene import Scene
from volspec.spectra.files import split_address
from volspec.spectra.lights import light_terms
from volspec.spectra.moved import moved_address, moved_file, moved_light

# A palette that begins so is replaced by the next wizard; any other is somebody's own.
_OURS = "Written by volspec wizard, which replaces it"


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


def require_place(scene: Scene, path: Path) -> Path:
    """Refuse a new scene that would be written over files that are not a wizard's.

    Returns
    -------
    path
        Of the palette beside it.

    Raises
    ------
    SceneError
        If it is no ``.toml`` or the scene itself, or its palette is somebody's own or one that
        the scene takes spectra from.
    InputError
        If there is no writing there.
    """
    if path.suffix.lower() != ".toml":
        raise SceneError(f"{path}: scenes are TOML; name it .toml")
    beside = path.with_name(f"{path.stem}-palette.toml")
    for each in (path, beside):
        require_writable(each)
    if _same(path, scene.path):
        raise SceneError(f"{path}: is the scene that the new one is made of; name it otherwise")
    if not beside.exists():
        return beside
    first = beside.read_bytes().removeprefix(b"\xef\xbb\xbf")[:200].decode("utf-8", "replace")
    if not first.lstrip("# ").startswith(_OURS):
        raise SceneError(
            f"{beside}: is there already, and no wizard's; rename it, or name the new scene "
            "otherwise"
        )
    if any(_same(beside, scene.folder / file) for file in _files_of(scene)):
        raise SceneError(
            f"{beside}: {scene.path} takes spectra from it; name the new scene otherwise"
        )
    return beside


def _files_of(scene: Scene) -> Iterator[str]:
    """The files that a scene takes spectra from."""
    names = [row.reflectance for row in scene.file.material]
    for row in scene.file.light:
        with suppress(SpectrumError):  # one that was just designed is in no file yet
            names += [name for name, _ in light_terms(row.spectrum, scene.folder)]
    yield from (address[0] for name in names if (address := split_address(name)))


def _same(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)


def write(scene: Scene, made: Design, changes: Changes, path: Path) -> tuple[Path, Path]:
    """Write both files; `Redesigned.save` says what can go wrong."""
    import tomlkit

    beside = require_place(scene, path)
    try:
        document: Any = tomlkit.parse(scene.path.read_text(encoding="utf-8-sig"))
        ends = line_end(scene.path)
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
    save_palette(made, beside, comment=f"{_OURS}; delete this line to keep it")
    with write_whole(path) as temporary:
        temporary.write_text(tomlkit.dumps(document), encoding="utf-8", newline=ends)
    return path, beside


def _lead_from(document: Any, scene: Scene, folder: Path) -> None:
    """Let file names start from another folder than the scene's."""
    ways = scene.folder, folder
    for row in document["light"]:
        row["spectrum"] = moved_light(str(row["spectrum"]), *ways)
    for row in document["material"]:
        for key in ("reflectance", "filter"):
            if key in row:
                row[key] = moved_address(str(row[key]), *ways)
    tables = [(document["volume"], "file")]
    if "name" in document.get("basis", {}):
        tables.append((document["basis"], "name"))
    for table, key in tables:
        text = str(table[key])
        file = text.partition("?")[0]
        if (scene.folder / file).exists():
            table[key] = moved_file(file, *ways) + text[len(file) :]
