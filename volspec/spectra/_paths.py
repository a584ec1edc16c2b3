"""What a caller gives for a path, checked before anything opens it."""

from __future__ import annotations

import os

from volspec.errors import SpectrumError


def path_text(path: object, what: str = "path") -> str:
    """A path as text.

    Raises
    ------
    SpectrumError
        If it is neither text nor a path, or no file can be called so.
    """
    text = os.fspath(path) if isinstance(path, str | os.PathLike) else None
    if not isinstance(text, str):
        raise SpectrumError(f"{what} {path!r} is no path; give text or a pathlib.Path")
    if "\0" in text:
        raise SpectrumError(f"{what} {text!r} holds a NUL character; no file is called so")
    return text
