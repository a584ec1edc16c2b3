"""A redesigned scene on disk: its file with comments kept, and the palette beside it.

Redesigned -> [writing] -> NEW.toml, NEW-palette.toml
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from volspec._files import require_writable
from volspec.errors import SceneError, SpectrumError
from volspec.palette import Design, save_palette
from volspec.scene import Scene, write_scene
from volspec.scene.file import SceneFile
from volspec.scene.reading import scene_data, scene_file
from volspec.scene.writing import require_toml
from volspec.spectra.files import rebase_path, split_address
from volspec.spectra.lights import light_terms

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
    exact : bool
        Whether the scene is now cast by its materials, as its basis would blur the design.
    """

    materials: tuple[str, ...]
    light: str | None = None
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
        If it is no ``.toml`` or the scene itself; if it or its palette is somebody's own, or the
        scene takes spectra from that palette.
    InputError
        If there is no writing there.
    """
    require_toml(path)
    beside = path.with_name(f"{path.stem}-palette.toml")
    for each in (path, beside):
        require_writable(each)
    if _same(path, scene.path):
        raise SceneError(f"{path}: is the scene that the new one is made of; name it otherwise")
    if path.exists() and not _takes_from(path, beside):
        raise SceneError(
            f"{path}: is there already, and no wizard's; name the new scene otherwise",
            code="duplicate",
        )
    if not beside.exists():
        return beside
    first = beside.read_bytes().removeprefix(b"\xef\xbb\xbf")[:200].decode("utf-8", "replace")
    if not first.lstrip("# ").startswith(_OURS):
        raise SceneError(
            f"{beside}: is there already, and no wizard's; rename it, or name the new scene "
            "otherwise",
            code="duplicate",
        )
    if any(_same(beside, scene.folder / file) for file in _files_of(scene.file, scene.folder)):
        raise SceneError(
            f"{beside}: {scene.path} takes spectra from it; name the new scene otherwise"
        )
    return beside


def _takes_from(path: Path, palette: Path) -> bool:
    """Whether a scene takes spectra from the palette beside it, as every one of a wizard's does."""
    try:
        file = scene_file(scene_data(path), path)
    except SceneError:
        return False
    return any(path.parent / name == palette for name in _files_of(file, path.parent))


def _files_of(file: SceneFile, folder: Path) -> Iterator[str]:
    """The files that a scene takes spectra from."""
    names = [row.reflectance for row in file.material if isinstance(row.reflectance, str)]
    for row in file.light:
        if isinstance(row.spectrum, str):
            with suppress(SpectrumError):  # one that was just designed is in no file yet
                names += [name for name, _ in light_terms(row.spectrum, folder)]
    yield from (address[0] for name in names if (address := split_address(name)))


def _same(one: Path, other: Path) -> bool:
    return one.exists() and other.exists() and one.samefile(other)


def write(scene: Scene, made: Design, changes: Changes, path: Path) -> tuple[Path, Path]:
    """Write both files; `Redesigned.save` says what can go wrong."""
    beside = require_place(scene, path)
    if not scene.path.is_file():
        raise SceneError(
            f"{scene.path}: cannot be read again; load the scene from a file, whose comments are "
            "kept",
            code="damaged",
        )
    # Written as all names of the scene's files are: counted from the scene's own folder.
    palette = rebase_path(beside.name, beside.parent, scene.folder)
    update: dict[str, object] = {
        "material": [
            row.model_copy(update={"reflectance": f"{palette}#{row.name}"})
            if row.name in changes.materials
            else row
            for row in scene.file.material
        ],
        "light": [
            row.model_copy(update={"spectrum": f"{palette}#{row.name}"})
            if row.name == changes.light
            else row
            for row in scene.file.light
        ],
    }
    # The palette first: a scene without its palette would be broken, not the other way round.
    save_palette(made, beside, comment=f"{_OURS}; delete this line to keep it")
    return write_scene(scene.file.model_copy(update=update), path, scene), beside
