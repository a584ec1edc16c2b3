"""Files that are not what their names say: packed ones, dead links, pointers of Git, web pages.

load, layout, neuro -> [presence] -> one line that names the way to the contents
"""

from __future__ import annotations

import gzip
import os
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import IO, cast

from volspec.errors import VolumeError

GZIP = b"\x1f\x8b"
# Bytes of a file that are looked at.
_LOOKED_AT = 1024
_POINTERS = {
    b"version https://git-lfs": ("Git LFS", "git lfs pull --include {}"),
    b"/annex/objects/": ("git-annex", "git annex get {}"),
}
# Beginnings of pages and of servers' answers, and what such XML has near its beginning.
_PAGES = (b"<!doctype html", b"<html", b"<head", b"<script", b'{"', b"{'")
_IN_PAGES = (b"<html", b"<error>", b"<!doctype html")


def is_packed(path: Path) -> bool:
    """Return True if a file is packed by gzip, whatever its name says."""
    with path.open("rb") as file:
        return file.read(2) == GZIP


def open_unpacked(path: Path) -> IO[bytes]:
    """Open a file, which is unpacked if it is packed by gzip."""
    return cast(IO[bytes], gzip.open(path)) if is_packed(path) else path.open("rb")


def require_contents(path: Path, who: str = "") -> bytes:
    """Return a file's first bytes. Raises VolumeError if its contents are somewhere else.

    ``who`` begins the message; by default the path.
    """
    who = who or f"{path}:"
    if path.is_symlink() and not path.exists():
        raise VolumeError(
            f"{who} is a link to {os.readlink(path)}, which is missing",
            f"fetch it (git annex get or datalad get {shlex.quote(str(path))}), or copy it",
            code="not-found",
        )
    with path.open("rb") as file:
        head = file.read(_LOOKED_AT)
    begins = head.removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    for start, (program, command) in _POINTERS.items():
        if begins.startswith(start):
            raise VolumeError(
                f"{who} is a pointer of {program}, not the file",
                command.format(shlex.quote(str(path))),
                code="damaged",
            )
    is_page = begins.startswith(_PAGES) and b"\0" not in head
    if is_page or (begins.startswith(b"<") and any(mark in begins for mark in _IN_PAGES)):
        raise VolumeError(
            f"{who} is a web page or a server's answer, not a volume",
            "download the file itself",
            code="damaged",
        )
    return head


def require_slices(folder: Path, endings: Iterable[str]) -> None:
    """Refuse a folder with slices that are dead links, or pointers of Git."""
    entries = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    slices = [path for path in entries if path.suffix.lower() in ("", *endings)]
    if dead := [path for path in slices if path.is_symlink() and not path.exists()]:
        raise VolumeError(
            f"{folder}: {len(dead)} of its {len(slices)} slices are links to what is missing, such "
            f"as {dead[0].name}",
            f"fetch them (git annex get or datalad get {shlex.quote(str(folder))}), or copy them",
            code="not-found",
        )
    files = [path for path in slices if path.is_file()]
    for path in {*files[:1], *files[len(files) // 2 :][:1], *files[-1:]}:
        require_contents(path)
