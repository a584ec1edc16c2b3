"""Paths that users drop, type and complete.

window, dialogs -> [paths] -> file commands
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import takewhile
from pathlib import Path

from volspec._files import is_remote
from volspec._triangles import MESHES
from volspec.errors import InputError
from volspec.volume.files import DICOM_SUFFIXES, PICTURES, is_dicom, is_stack

# Slices: one DICOM file means its series, pictures mean their folder.
_PICTURES = tuple(PICTURES.values())
MAX_ROWS = 2000
# Files that belong to meshes: materials, buffers, textures.
_OF_MESHES = (".mtl", ".bin", ".png", ".jpg", ".jpeg", ".bmp")
# Headers, and the data that they name.
_HEADERS = (".nhdr", ".mhd", ".hdr", ".head", ".par")
_DATA = (".raw", ".zraw", ".raw.gz", ".img", ".img.gz", ".brik", ".brik.gz", ".rec", ".bin")
SPECTRA = (".csv", ".spd", ".spdx", ".ies", ".ldt")


def dropped_documents(paths: Sequence[str]) -> tuple[str, ...]:
    """Return the scenes and volumes among files dropped together, in their order.

    A header takes its data with it, slices of one folder are a volume, and a scene means its one
    volume.

    >>> dropped_documents(("a.mhd", "a.zraw", "b.nrrd", "tile.ply", "lamp.csv"))
    ('a.mhd', 'b.nrrd')
    """
    meshes = dropped_meshes(paths)
    remaining = [path for path in paths if path not in meshes]
    if meshes and _all_end(remaining, (*_OF_MESHES, *PICTURES["TIFF"])):
        return ()
    if len(paths) == 1:
        return tuple(paths)
    one_folder = len({os.path.dirname(path) for path in paths}) == 1
    if one_folder and any(_all_end(paths, kind) for kind in _PICTURES) and not is_stack(paths[0]):
        return (os.path.dirname(paths[0]),)
    headed = any(_all_end([path], _HEADERS) for path in remaining)
    parts = (*SPECTRA, *(_OF_MESHES if meshes else ()), *(_DATA if headed else ()))
    by_source: dict[str, str] = {}
    for path in remaining:
        if not _all_end([path], parts):
            is_slice = _all_end([path], DICOM_SUFFIXES)
            by_source.setdefault(os.path.dirname(path) if is_slice else path, path)
    documents = tuple(by_source.values())
    scenes = tuple(path for path in documents if _all_end([path], (".toml",)))
    return scenes if len(scenes) == 1 and len(documents) == 2 else documents


def dropped_meshes(paths: Sequence[str]) -> tuple[str, ...]:
    """Return the meshes among files dropped together."""
    return tuple(path for path in paths if _all_end([path], MESHES))


def relative_path(path: str, folder: str) -> str:
    """Return a path relative to a folder; on another drive it stays absolute, and so does a URL."""
    if is_remote(path):
        return path
    file = Path(path).absolute()
    file = file.parent.resolve() / file.name
    try:
        return Path(os.path.relpath(file, Path(folder).resolve())).as_posix()
    except ValueError:
        return file.as_posix()


def name_below(path: str, folder: str) -> str | None:
    """Return a path relative to a folder that it lies in or below; None elsewhere."""
    name = relative_path(path, folder)
    outside = is_remote(name) or os.path.isabs(name) or Path(name).parts[:1] == ("..",)
    return None if outside else name


def _all_end(paths: Sequence[str], endings: tuple[str, ...]) -> bool:
    return all(path.lower().endswith(endings) for path in paths)


def check_name(path: str | os.PathLike[str]) -> None:
    """Raise InputError if a name, or a folder above it, is not UTF-8: Linux allows such names."""
    full_path = os.path.abspath(path)
    if not _is_text(full_path):
        raise InputError(
            f"{full_path}: the name is not UTF-8, so no scene or session can store it; rename it",
            code="unsupported",
        )


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class PathRow:
    """A folder, whose name ends with "/", or a file of a list."""

    name: str
    size: int = 0  # bytes
    changed_s: float = 0.0  # since the epoch


@dataclass(frozen=True, slots=True)
class Listing:
    """Contents of a folder that complete a path."""

    folder: str  # as typed, ending with the separator
    # Those whose names begin as typed: folders first, `MAX_ROWS` at most.
    rows: tuple[PathRow, ...]
    common: str  # the path, completed as far as all names agree
    other_files: int = 0  # number of files with other endings
    dicom: int = 0  # number of DICOM files among the rows


def list_paths(
    text: str, suffixes: Sequence[str] = (), base: str = "", slices: bool = False
) -> Listing:
    """List folders, and files with one of the endings, that complete a path.

    The path starts from the folder ``base``, the current one if empty; ``~`` is the user's home
    folder. ``suffixes`` are in lower case; none lists all files. With ``slices``, files without an
    ending and DICOM files with any are listed and counted, too. Names that are not UTF-8 are left
    out, as `check_name` refuses them.
    """
    start = max(text.rfind("/"), text.rfind(os.sep)) + 1  # Windows accepts both
    folder, typed = text[:start], text[start:]
    rows: list[tuple[str, os.DirEntry[str]]] = []
    other_files = dicom = 0
    try:
        with os.scandir(os.path.join(base, os.path.expanduser(folder)) or ".") as entries:
            for entry in entries:
                name = entry.name
                hidden = name.startswith(".") and not typed.startswith(".")
                hidden |= not _is_text(name)
                if hidden or not name.casefold().startswith(typed.casefold()):
                    continue
                if entry.is_dir():
                    rows.append((name + "/", entry))
                    continue
                is_slice = slices and _is_slice(entry)
                dicom += is_slice
                bare = slices and not os.path.splitext(name)[1]
                if not suffixes or is_slice or bare or name.lower().endswith(tuple(suffixes)):
                    rows.append((name, entry))
                else:
                    other_files += 1
    except OSError:
        return Listing(folder, (), text)
    rows.sort(key=lambda row: (not row[0].endswith("/"), row[0].casefold()))
    letters = zip(*(name.casefold() for name, _ in rows), strict=False)
    shared = sum(1 for _ in takewhile(lambda column: len(set(column)) == 1, letters))
    common = rows[0][0][:shared] if rows else typed
    listed = tuple(_path_row(*row) for row in rows[:MAX_ROWS])
    return Listing(folder, listed, folder + common, other_files, dicom)


def _is_slice(entry: os.DirEntry[str]) -> bool:
    """Return True for a DICOM file, by its ending or else by its first bytes."""
    if entry.name.lower().endswith(DICOM_SUFFIXES):
        return True
    try:
        stat = entry.stat()
        return entry.is_file() and _begins_as_dicom(entry.path, stat.st_size, stat.st_mtime)
    except OSError:
        return False


# A dialog lists its folder once a second.
@lru_cache(maxsize=4 * MAX_ROWS)
def _begins_as_dicom(path: str, _size: int, _changed_s: float) -> bool:
    return is_dicom(Path(path))


def _path_row(name: str, entry: os.DirEntry[str]) -> PathRow:
    try:
        stat = entry.stat()
    except OSError:  # a link to nowhere
        return PathRow(name)
    return PathRow(name, stat.st_size, stat.st_mtime)


@dataclass(frozen=True, slots=True)
class FolderPlace:
    """A folder that a dialog offers."""

    name: str
    folder: str


# Folders of recent files that a dialog offers.
_MAX_RECENT = 6


def folder_places(
    opened: str | None, recent: Sequence[str], examples: str
) -> tuple[FolderPlace, ...]:
    """Return the folders to offer: each once, and only those that exist.

    ``opened`` is the folder of the open file, ``recent`` are files, the last one first.
    """
    places = [("Home", os.path.expanduser("~"))]
    if opened is not None:
        places.append(("Folder of the open file", opened))
    places += [("Current folder", os.getcwd()), ("Examples", examples)]
    if os.name == "posix":
        places.append(("Computer", "/"))
    listed = {os.path.realpath(folder) for _, folder in places}
    folders = dict.fromkeys(os.path.dirname(path) for path in recent)
    fresh = [folder for folder in folders if folder and os.path.realpath(folder) not in listed]
    places += [(os.path.basename(folder) or folder, folder) for folder in fresh[:_MAX_RECENT]]
    unique: dict[str, FolderPlace] = {}
    for name, folder in places:
        if os.path.isdir(folder):
            unique.setdefault(os.path.realpath(folder), FolderPlace(name, os.path.abspath(folder)))
    return tuple(unique.values())


def size_text(size: int) -> str:
    """Return a file's size in the greatest unit that gives at least 1.

    >>> [size_text(size) for size in (0, 999, 1500, 7_250_000, 3_000_000_000)]
    ['0 B', '999 B', '1.5 kB', '7.2 MB', '3 GB']
    """
    number, unit = float(size), "B"
    for larger in ("kB", "MB", "GB", "TB"):
        if number < 1000:
            break
        number, unit = number / 1000, larger
    return f"{number:.2g} {unit}" if number < 100 else f"{number:.0f} {unit}"


@dataclass(frozen=True, slots=True)
class PathRequest:
    """Request for a path, which a dialog answers."""

    kind: str  # identifies the request in the answer
    title: str
    save: bool = False  # the file will be written
    # Accepted endings; the first is added to a file name for saving that has none of them.
    suffixes: tuple[str, ...] = ()
    start: str = ""  # the proposed path; one that ends with "/" is a folder
    files: str = ""  # what the endings are, for the choice of a filter
    folders: bool = False  # a folder may be chosen, too
    also: str = ""  # ending of a second file that is written with the first

    def complete(self, text: str) -> str:
        """Return a typed path with ``~`` and the ending filled in; an empty one stays empty."""
        path = os.path.expanduser(text.strip())
        ends = not self.save or path.lower().endswith(self.suffixes)
        return path if not path or ends else path + self.suffixes[0]

    def replaced(self, path: str) -> list[str]:
        """Return the files that would be replaced if a path was written."""
        files = (path, os.path.splitext(path)[0] + self.also) if self.also else (path,)
        return [file for file in files if self.save and os.path.isfile(file)]
