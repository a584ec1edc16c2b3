"""Frames as PNG files: their colour space, what made them as text, whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import write_whole
from volspec.appearance.spaces import SPACES, ColourSpace, space_of
from volspec.errors import ImageError
from volspec.export.icc import icc_profile


def write_frame(
    path: str | os.PathLike[str],
    frame: NDArray[np.uint8],
    text: Mapping[str, str] | None = None,
    space: str | Path | ColourSpace = "sRGB",
) -> None:
    """Write an 8-bit frame.

    Parameters
    ----------
    path : str or path
        Ends in ``.png``.
    frame : (H, W, 3) uint8
    text : {keyword: text}, optional
        Kept in the file (light, scene, software).
    space : str, path or ColourSpace
        What its codes are of: ``viewing.display.space``. sRGB is told by PNG's own chunk, any
        other by an ICC profile.

    Raises
    ------
    ImageError
        If the name does not end in ``.png``.
    InputError
        If the folder cannot be written to.
    ViewingError
        If the space is unknown.
    """
    import imageio.v3 as iio
    from PIL.PngImagePlugin import PngInfo

    if Path(path).suffix.lower() != ".png":
        raise ImageError(f"{os.fspath(path)}: frames are PNG files; name it .png")
    if not (
        isinstance(frame, np.ndarray)
        and frame.dtype == np.uint8
        and frame.ndim == 3
        and frame.shape[2] == 3
    ):
        what = f"{frame.dtype} {frame.shape}" if isinstance(frame, np.ndarray) else repr(frame)
        raise ImageError(
            f"{os.fspath(path)}: the frame is {what:.60}; give (H, W, 3) uint8, as "
            "Relighter.frame makes it"
        )
    colours = space_of(space)
    info = PngInfo()
    profile: dict[str, Any] = {}
    if colours == SPACES["sRGB"]:
        info.add(b"sRGB", b"\0")  # perceptual intent, IEC 61966-2-1
    else:
        profile = {"icc_profile": icc_profile(colours)}
    for keyword, value in (text or {}).items():
        info.add_itxt(keyword, value)
    with write_whole(path) as temporary:
        iio.imwrite(temporary, frame, plugin="pillow", extension=".png", pnginfo=info, **profile)


def read_frame_text(path: str | os.PathLike[str]) -> dict[str, str]:
    """The texts that `write_frame` kept in a file."""
    from PIL import Image

    with Image.open(path) as image:
        return {str(key): str(value) for key, value in image.info.items() if isinstance(value, str)}


def file_stem(name: str) -> str:
    """A file name for a light's name: letters, digits, ``+ - . _`` stay, the rest becomes ``-``.

    >>> file_stem("D65*0.5+A*0.5"), file_stem("../x")
    ('D65-0.5+A-0.5', 'x')
    """
    kept = "".join(c if c.isalnum() or c in "+-._" else "-" for c in name)
    return kept.strip("-.") or "light"
