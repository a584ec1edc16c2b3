"""Confinement of input files to one folder, so that scenes of others can be opened.

    confined(FOLDER) -> every reader of files -> [require_inside]

All that a scene, a room, a palette or a volume's header names is opened by a reader that asks here
first. Child processes inherit the folder.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volspec.errors import InputError

VARIABLE = "VOLSPEC_CONFINED"
"""The environment variable that holds the folder, without links, of this process."""
_PACKAGE = Path(__file__).resolve().parent
_SHIPPED = _PACKAGE / "_assets" / "data", _PACKAGE.parent / "data"  # of a wheel, of a checkout


@contextmanager
def confined(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Open only input files below a folder, and no URLs, while the body runs.

    Links are followed: one that leads outside is refused, as is an absolute path or ``..`` that
    does. It holds for the whole process and all its threads, and for files that are read later,
    such as a scene's volume. Files that ship with volspec can be named. Outputs are where the
    caller says, since no scene names one, unless a link in the folder leads them elsewhere.

    Parameters
    ----------
    folder : path
        Within a body that is confined already, a folder below that one.

    Raises
    ------
    InputError
        If there is no such folder; in the body, if a file leads outside, with the code
        ``"unreadable"`` and the class of the reader's other errors.

    Examples
    --------
    >>> import volspec as vs
    >>> with vs.confined("data/scenes"):
    ...     vs.load_volume("theirs/ct.nrrd")
    Traceback (most recent call last):
    volspec.errors.VolumeError: theirs/ct.nrrd: leads outside of ..., the only folder of files ...
    """
    name = os.fspath(folder)
    if not os.path.isdir(name):
        raise InputError(f"{name}: no such folder", "give one of scenes", code="not-found")
    require_inside(name)
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = os.path.realpath(name)
    try:
        yield
    finally:
        confine(before)


def confine(folder: str | None) -> None:
    """Set the folder of this process, as `confined_folder` returns it; None: any may be opened."""
    os.environ.pop(VARIABLE, None)
    if folder is not None:
        os.environ[VARIABLE] = folder


def confined_folder() -> str | None:
    """Return the folder to which this process is confined; None if it is not."""
    return os.environ.get(VARIABLE) or None


def is_inside(path: str | os.PathLike[str]) -> bool:
    """Return True if a file may be opened, whether it exists or not."""
    folder, name = confined_folder(), str(path)  # a URL is no os.PathLike
    if folder is None:
        return True
    try:
        real = Path(os.path.realpath(name))
    except ValueError:  # a NUL character: no file
        return False
    return "://" not in name and any(real.is_relative_to(root) for root in (folder, *_SHIPPED))


def require_inside(path: str | os.PathLike[str], error: type[InputError] = InputError) -> None:
    """Raise ``error`` if a file must not be opened; readers call it before they look for one."""
    if not is_inside(path):
        raise error(
            f"{path}: leads outside of {confined_folder()}, the only folder of files "
            "that may be opened",
            "copy it there, or name another folder as --confined",
            code="unreadable",
            given=str(path),
        )


def require_target_inside(path: Path, target: Path) -> None:
    """Raise InputError if an output's path has a link in the folder that leads outside of it."""
    folder = confined_folder()
    if folder is None or target.is_relative_to(folder):
        return
    named = Path(os.path.abspath(path))
    if any(Path(os.path.realpath(parent)).is_relative_to(folder) for parent in named.parents):
        raise InputError(
            f"{path}: leads by a link outside of {folder}, the only folder of files that may be "
            "opened",
            "choose another name, or a folder elsewhere",
            code="unwritable",
        )


def require_links_inside(path: Path, error: type[InputError]) -> None:
    """Raise ``error`` if a file or folder has links that lead outside, below it or in its parts.

    Parts are next to it, with the same name before the first dot, as of formats of several files.
    """
    if confined_folder() is None:
        return
    require_inside(path, error)
    stem = f"{path.name.partition('.')[0]}."
    near = [part for part in path.parent.glob("*") if part.name.startswith(stem)]
    for part in (path, *near):
        require_inside(part, error)
        for folder, folders, files in os.walk(part):
            for name in (*folders, *files):
                if os.path.islink(link := os.path.join(folder, name)):
                    require_inside(link, error)
