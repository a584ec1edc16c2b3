"""Frames as PNG files: their colour space, what made them as text, whole or not at all."""

from __future__ import annotations

import io
import os
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import write_whole
from volspec.appearance.spaces import ColourSpace, space_of
from volspec.errors import ImageError, InputError, one_line
from volspec.export.png import PngWriter

if TYPE_CHECKING:
    from PIL import Image

# Names that Windows keeps for devices, whatever follows the dot.
_DEVICES = {"con", "prn", "aux", "nul", *(f"{d}{i}" for d in ("com", "lpt") for i in range(1, 10))}
# Of a stem in UTF-8; file systems take 255 with the suffix.
_STEM_BYTES = 120


def write_frame(
    path: str | os.PathLike[str],
    frame: NDArray[np.uint8] | NDArray[np.uint16],
    text: Mapping[str, str] | None = None,
    space: str | Path | ColourSpace = "sRGB",
) -> None:
    """Write a frame.

    Parameters
    ----------
    path : str or path
        Ends in ``.png``.
    frame : (H, W, 3) or (H, W, 4) uint8 or uint16
        With opacity, which is not multiplied in, as fourth.
    text : {keyword: text}, optional
        Kept in the file (light, scene, software).
    space : str, path or ColourSpace
        What its codes are of: ``viewing.display.space``. sRGB is told by PNG's own chunk, any
        other by an ICC profile, Display P3 by code points, too.

    Raises
    ------
    ImageError
        If the name does not end in ``.png``.
    InputError
        If the folder cannot be written to.
    ViewingError
        If the space is unknown.
    """
    require_png(path)
    colours = space_of(space)
    if not (
        isinstance(frame, np.ndarray)
        and frame.dtype in (np.uint8, np.uint16)
        and frame.ndim == 3
        and frame.shape[2] in (3, 4)
        and frame.size
    ):
        what = f"{frame.dtype} {frame.shape}" if isinstance(frame, np.ndarray) else repr(frame)
        raise ImageError.refused(
            f"{os.fspath(path)}: the frame",
            what,
            "give (H, W, 3) uint8, as Relighter.frame makes it",
        )
    with write_whole(path) as temporary:
        temporary.write_bytes(png_bytes(frame, text or {}, colours))


def require_png(path: str | os.PathLike[str]) -> None:
    """Refuse a name that no frame has.

    Raises
    ------
    ImageError
    """
    if Path(path).suffix.lower() != ".png":
        raise ImageError(f"{os.fspath(path)}: frames are PNG files; name it .png")


def png_bytes(
    frame: NDArray[np.uint8] | NDArray[np.uint16], text: Mapping[str, str], space: ColourSpace
) -> bytes:
    """The file of a frame; as `write_frame`."""
    height, width, channels = frame.shape
    file = io.BytesIO()
    writer = PngWriter(file, (width, height), channels, 8 * frame.dtype.itemsize, space, text)
    writer.rows(frame)
    writer.close()
    return file.getvalue()


@contextmanager
def png_file(
    path: str | os.PathLike[str],
    size: tuple[int, int],
    channels: int,
    bits: int,
    text: Mapping[str, str],
    space: ColourSpace,
) -> Iterator[PngWriter]:
    """A PNG that takes its rows one after the other; it appears when all are there.

    Parameters and errors are those of `write_frame` and `PngWriter`.
    """
    require_png(path)
    with write_whole(path) as temporary, temporary.open("wb") as file:
        writer = PngWriter(file, size, channels, bits, space, text)
        yield writer
        writer.close()


def to_uint16(codes: NDArray[Any]) -> NDArray[np.uint16]:
    """Codes 0 to 1, rounded; NaN is black."""
    return np.rint(np.clip(np.nan_to_num(codes, nan=0.0), 0.0, 1.0) * 65535.0).astype(np.uint16)


def read_frame(path: Path) -> Image.Image:
    """Return a frame's picture.

    Raises
    ------
    InputError
        If it is damaged.
    """
    from PIL import Image

    try:
        with Image.open(path) as file:
            file.load()
            return file.copy()
    except Exception as error:  # Pillow's are of any class
        raise InputError(
            f"{path}: cannot be read ({one_line(error)}); delete it and repeat the command",
            code="damaged",
        ) from None


def read_frame_text(path: str | os.PathLike[str]) -> dict[str, str]:
    """The texts that `write_frame` kept in a file."""
    from PIL import Image

    with Image.open(path) as image:
        return {str(key): str(value) for key, value in image.info.items() if isinstance(value, str)}


def file_stem(name: str) -> str:
    """A file name for a light's name: letters, digits, ``+ - . _`` stay, the rest becomes ``-``.

    Letters and their accents are composed, long names cut, and what Windows keeps for devices
    gets a ``_``.

    >>> file_stem("D65*0.5+A*0.5"), file_stem("../x"), file_stem("con.x")
    ('D65-0.5+A-0.5', 'x', '_con.x')
    """
    composed = unicodedata.normalize("NFC", name)
    kept = "".join(c if c.isalnum() or c in "+-._" else "-" for c in composed)
    short = kept.encode()[:_STEM_BYTES].decode(errors="ignore")
    stem = short.strip("-.") or "light"
    return f"_{stem}" if stem.partition(".")[0].casefold() in _DEVICES else stem


def distinct_stems(names: Sequence[str], taken: Sequence[str] = ("sheet",)) -> list[str]:
    """File names for several: where two would be one, in any case, the later gets a number.

    >>> distinct_stems(["a b", "A*B", "sheet"])
    ['a-b', 'A-B-2', 'sheet-2']
    """
    used = {name.casefold() for name in taken}
    found = []
    for name in names:
        stem, number = file_stem(name), 2
        while (tried := stem if number == 2 else f"{stem}-{number - 1}").casefold() in used:
            number += 1
        used.add(tried.casefold())
        found.append(tried)
    return found
