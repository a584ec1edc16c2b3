"""Paths as people give them: files dropped, typed and completed.

window, dialogs -> [paths] -> chores
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from volspec.errors import InputError

# Slices: of DICOM one file stands for its series, of pictures their folder for all.
_DICOM = (".dcm", ".dicom", ".ima")
_PICTURES = ((".tif", ".tiff"), (".png",))
MOST_ROWS = 200


def path_of_drop(paths: Sequence[str]) -> str:
    """What files dropped together mean: one of them.

    Raises
    ------
    InputError
        If they mean nothing; says what could be dropped.
    """
    if len(paths) == 1:
        return paths[0]
    # A header and its bytes, as .nhdr and .raw or .mhd and .zraw.
    headers = [path for path in paths if path.lower().endswith((".nhdr", ".mhd", ".toml"))]
    if len(headers) == 1:
        return headers[0]
    if len({os.path.dirname(path) for path in paths}) == 1:
        if _all_end(paths, _DICOM):
            return paths[0]
        if any(_all_end(paths, endings) for endings in _PICTURES):
            return os.path.dirname(paths[0])
    raise InputError(
        f"{len(paths)} files were dropped; drop one scene or volume, or the folder of its slices"
    )


def _all_end(paths: Sequence[str], endings: tuple[str, ...]) -> bool:
    return all(path.lower().endswith(endings) for path in paths)


def check_name(path: str | os.PathLike[str]) -> None:
    """Refuse what Linux takes for a name and no text can hold.

    Raises
    ------
    InputError
        If it, or a folder above it, is not UTF-8.
    """
    whole = os.path.abspath(path)
    if not _is_text(whole):
        raise InputError(
            f"{whole}: this name is not UTF-8, no scene or session could hold it; rename it"
        )


def _is_text(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


@dataclass(frozen=True, slots=True)
class Listing:
    """What is in a folder, for a path that is being typed.

    Parameters
    ----------
    folder : str
        As typed, with the separator at its end.
    rows : tuple of str
        Names that go on as typed; folders end with a separator.
    common : str
        The path, completed as far as all rows agree.
    """

    folder: str
    rows: tuple[str, ...]
    common: str


def list_paths(text: str, suffixes: Sequence[str] = ()) -> Listing:
    """Folders, and files with one of the endings, that go on as a path does.

    Names that are not UTF-8 are left out, as `check_name` refuses them.

    Parameters
    ----------
    text : str
        What is typed; ``~`` is the user's own folder, relative paths start where the program runs.
    suffixes : sequence of str
        Endings of files, in small letters; none lists all.
    """
    folder, typed = text[: text.rfind("/") + 1], text[text.rfind("/") + 1 :]
    if os.sep != "/" and os.sep in typed:  # Windows takes both
        at = text.rfind(os.sep) + 1
        folder, typed = text[:at], text[at:]
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
    longer = rows[0][: _shared(rows)] if rows else typed
    return Listing(folder, tuple(rows[:MOST_ROWS]), folder + longer)


def _shared(rows: Sequence[str]) -> int:
    """With how many letters all names begin."""
    letters = zip(*(row.casefold() for row in rows), strict=False)
    return sum(1 for _ in takewhile(lambda each: len(set(each)) == 1, letters))


@dataclass(frozen=True, slots=True)
class PathRequest:
    """What a path is asked for.

    Parameters
    ----------
    kind : str
        Given back with the path.
    title : str
    save : bool
        Whether the file will be written.
    suffixes : tuple of str
        Endings of its name; the first is added where a name to be written has none.
    start : str
        What is proposed.
    """

    kind: str
    title: str
    save: bool = False
    suffixes: tuple[str, ...] = ()
    start: str = ""

    def named(self, text: str) -> str:
        """What was typed, with ``~`` and the ending filled in."""
        path = os.path.expanduser(text.strip())
        ends = not self.save or path.lower().endswith(self.suffixes)
        return path if not path or ends else path + self.suffixes[0]


def path_exists(path: str) -> bool:
    """Whether there is such a file."""
    return Path(path).is_file()
