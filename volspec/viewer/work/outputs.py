"""Files that the viewer makes of its picture: where they go, how large they are, their progress.

document -> [outputs] -> screenshot, films
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import TypeVar

from volspec._checks import MAX_SIDE
from volspec._files import plain_stem, require_writable
from volspec.errors import CastCancelled, OpenCLError
from volspec.export import even_size, file_stem
from volspec.pipeline import Raycaster
from volspec.viewer.model.document import Document

T = TypeVar("T")
SHOWN, TWICE, CUSTOM = "As shown", "Twice as shown", "Custom"
_SIZES = {
    "HD, 1280 × 720": (1280, 720),
    "Full HD, 1920 × 1080": (1920, 1080),
    "4K, 3840 × 2160": (3840, 2160),
    "Square, 1080 × 1080": (1080, 1080),
}
PRESETS = (SHOWN, TWICE, *_SIZES, CUSTOM)


@dataclass(frozen=True, slots=True)
class PictureSize:
    """Size of a picture in pixels, or of a film: ``even`` unless it is given in numbers."""

    preset: str = SHOWN
    custom: tuple[int, int] = (1280, 720)  # width and height, for the last of `PRESETS`
    even: bool = False

    def pixels(self, window_size: tuple[int, int]) -> tuple[int, int]:
        """Return width and height; ``window_size`` is the size in the window."""
        if self.preset == CUSTOM:
            width, height = (min(max(side, 1), MAX_SIDE) for side in self.custom)
            return width, height
        times = 2 if self.preset == TWICE else 1
        size_px = window_size[0] * times, window_size[1] * times
        width, height = _SIZES.get(self.preset, even_size(size_px) if self.even else size_px)
        return min(width, MAX_SIDE), min(height, MAX_SIDE)


@dataclass(frozen=True, slots=True)
class Destination:
    """Folder and name of a file to write."""

    folder: str = ""  # empty for `output_folder`
    name: str = ""  # with or without the suffix; empty for the scene's title

    def path(self, title: str, usual: Path, suffix: str) -> Path:
        """Return the first free path, with a number if the name is taken.

        ``usual`` is the folder unless another is given.
        """
        stem = file_stem(self.name.strip().removesuffix(suffix) or title)
        names = chain([stem], (f"{stem}-{number}" for number in count(1)))
        folder = Path(os.path.expanduser(self.folder)) if self.folder.strip() else usual
        folder = folder.absolute()
        return next(path for name in names if not (path := folder / f"{name}{suffix}").exists())

    def new_path(self, document: Document, suffix: str) -> Path:
        """Return the path of a document's file, whose folder is made when it is written.

        Raises InputError if it cannot be.
        """
        path = self.path(short_title(document), output_folder(document), suffix)
        require_writable(path)
        return path


def short_title(document: Document) -> str:
    """Return the title; without endings if it is the file name of the volume."""
    file = document.file
    name = "" if file is None else os.path.basename(file.volume.file.partition("?")[0])
    return plain_stem(document.title) if document.title == name else document.title


def output_folder(document: Document) -> Path:
    """Return the opened file's folder; the user's pictures if nothing is to be written there.

    Next to a folder of slices, as a picture in it would become a slice.
    """
    folder = document.own_folder
    writable = folder is not None and os.access(folder, os.W_OK | os.X_OK)
    return folder if folder is not None and writable else pictures_folder()


def pictures_folder() -> Path:
    """Return the user's folder of pictures, or the home folder."""
    home = Path.home()
    folder_name = os.environ.get("XDG_PICTURES_DIR", "")
    if not folder_name:
        settings = Path(os.environ.get("XDG_CONFIG_HOME") or home / ".config") / "user-dirs.dirs"
        try:
            text = settings.read_text(encoding="utf-8")
        except (OSError, ValueError):
            text = ""
        match = re.search(r'^XDG_PICTURES_DIR="(.*)"', text, re.MULTILINE)
        folder_name = match[1].replace("$HOME", str(home)) if match else ""
    folder = Path(folder_name) if folder_name else home / "Pictures"
    return folder if folder.is_dir() else home


@dataclass(slots=True)
class Progress:
    """Progress of a file in the making; the window shows it, and cancels the work with ``ended``.

    The ``kind`` is a word for the file, such as "picture".
    """

    title: str
    kind: str = "picture"
    step: str = ""  # the present step, after the cast
    fraction: float = 0.0  # 0 to 1
    ended: bool = False

    def report(self, fraction: float) -> None:
        """Set the fraction; called by the cast."""
        self.fraction = fraction

    def check(self) -> None:
        """Raise CastCancelled if the work is to end."""
        if self.ended:
            raise CastCancelled(f"the {self.kind} was cancelled")


def with_own_caster(document: Document, use: Callable[[Raycaster], T]) -> T:
    """Cast with a Raycaster of its own: the window's casts would wait for the document's.

    If the device has no room for the volume twice, the document's is used.
    """
    shared = document.caster
    try:
        caster = Raycaster(document.volume, device=shared.device if shared else None)
        return use(caster)
    except OpenCLError:
        if shared is None:
            raise
        return use(shared)
