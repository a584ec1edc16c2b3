"""Files of another kind than a command takes: what they are, and which command takes them."""

from __future__ import annotations

import shlex
from pathlib import Path

from volspec.errors import ImageError, SceneError

# What to do with an image that was cast.
RELIGHT = "relight it: volspec relight {file} --light LIGHT -o FRAME.png"


def require_scene(path: Path, instead: str = RELIGHT) -> None:
    """Refuse a coefficient image where a scene belongs.

    Parameters
    ----------
    path : Path
    instead : str
        What to do with it, ``{file}`` in place of its name.

    Raises
    ------
    SceneError
    """
    if path.suffix.lower() == ".exr" and path.is_file():
        remedy = instead.format(file=shlex.quote(str(path)))
        raise SceneError(f"{path}: is an image that was cast, not a scene; {remedy}")


def require_image(path: Path, instead: str) -> None:
    """Refuse a scene where a coefficient image belongs; parameters as of `require_scene`.

    Raises
    ------
    ImageError
    """
    if path.suffix.lower() == ".toml" and path.is_file():
        remedy = instead.format(file=shlex.quote(str(path)))
        raise ImageError(f"{path}: is a scene, not an image that was cast; {remedy}")
