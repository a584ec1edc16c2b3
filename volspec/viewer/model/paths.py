"""Paths that users drop, type and complete.

window, dialogs -> [paths] -> file commands
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile

from volspec.errors import InputError

# Slices: one DICOM file means its series, pictures mean their folder.
_DICOM = (".dcm", ".dicom", ".ima")
_PICTURES = ((".tif", ".tiff"), (".png",))
MOST_ROWS = 200


def dropped_path(paths: Sequence[str]) -> str:
    """Return the one scene or volume that files dropped together belong to.

    Raises InputError if they belong to several.
    """
    if len(paths) == 1:
        return paths[0]
    # A header and its data, such as .nhdr and .raw or .mhd and .zraw.
    headers = [path for path in paths if path.lower().endswith((".nhdr", ".mhd", ".toml"))]
    if len(headers) == 1:
        return headers[0]
    if len({os.path.dirname(path) for path in paths}) == 1:
        if _all_end(paths, _DICOM):
            return paths[0]
        if any(_all_end(paths, endings) for endings in _PICTURES):
            return os.path.dirname(paths[0])
    raise InputError(
        f"{len(paths)} files were dropped; drop one scene or volume, or the folder of its slices",
        code="conflict",
    )


def _all_end(paths: Sequence[str], endings: tuple[str, ...]) -> bool:
    return all(path.lower().endswith(endings) for path in paths)


def check_name(path: str | os.PathLike[str]) -> None:
    """Raise InputError if a name, or a folder above it, is not UTF-8: Linux allows such names."""
    whole = os.path.abspath(path)
    if not _is_text(whole):
        raise InputError(
            f"{whole}: the name is not UTF-8, so no scene or session can store it; rename it",
            code="unsupported",
        )


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Listing:
    """Contents of a folder that complete a path."""

    folder: str  # as typed, ending with the separator
    rows: tuple[str, ...]  # names that begin as typed, `MOST_ROWS` at most; folders end with "/"
    common: str  # the path, completed as far as all names agree


def list_paths(text: str, suffixes: Sequence[str] = ()) -> Listing:
    """List folders, and files with one of the endings, that complete a path.

    ``~`` is the user's home folder. ``suffixes`` are in lower case; none lists all files. Names
    that are not UTF-8 are left out, as `check_name` refuses them.
    """
    start = max(text.rfind("/"), text.rfind(os.sep)) + 1  # Windows accepts both
    folder, typed = text[:start], text[start:]
    rows: list[str] = []
    try:
        with os.scandir(os.path.expanduser(folder) or ".") as entries:
            for entry in entries:
                name = entry.name
                hidden = name.startswith(".") and not typed.startswith(".")
                hidden |= not _is_text(name)
                if hidden or not name.casefold().startswith(typed.casefold()):
                    continue
                if entry.is_dir():
                    rows.append(name + "/")
                elif not suffixes or name.lower().endswith(tuple(suffixes)):
                    rows.append(name)
    except OSError:
        return Listing(folder, (), text)
    rows.sort(key=lambda name: (not name.endswith("/"), name.casefold()))
    letters = zip(*(row.casefold() for row in rows), strict=False)
    shared = sum(1 for _ in takewhile(lambda each: len(set(each)) == 1, letters))
    common = rows[0][:shared] if rows else typed
    return Listing(folder, tuple(rows[:MOST_ROWS]), folder + common)


@dataclass(frozen=True, slots=True)
class PathRequest:
    """Request for a path, which a dialog answers."""

    kind: str  # identifies the request in the answer
    title: str
    save: bool = False  # the file will be written
    # Accepted endings; the first is added to a file name for saving that has none of them.
    suffixes: tuple[str, ...] = ()
    start: str = ""  # the proposed path

    def complete(self, text: str) -> str:
        """Return a typed path with ``~`` and the ending filled in; an empty one stays empty."""
        path = os.path.expanduser(text.strip())
        ends = not self.save or path.lower().endswith(self.suffixes)
        return path if not path or ends else path + self.suffixes[0]
