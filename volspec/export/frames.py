"""Write frames as PNG files with colour space and metadata, name them, and find blank ones."""

from __future__ import annotations

import io
import os
import unicodedata
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec._files import require_suffix, write_whole
from volspec.appearance.display import ColourSpace, Hdr, colour_space
from volspec.errors import ImageError, InputError, VolspecWarning, one_line
from volspec.export.avif import BITS as AVIF_BITS
from volspec.export.avif import AvifWriter
from volspec.export.png import PngWriter

if TYPE_CHECKING:
    from PIL import Image

# Names that Windows reserves for devices, whatever follows the dot.
_DEVICES = {"con", "prn", "aux", "nul", *(f"{d}{i}" for d in ("com", "lpt") for i in range(1, 10))}
# Length of a stem in UTF-8 bytes; file systems allow 255 with the suffix.
_STEM_BYTES = 120
# A frame is blank if this fraction of its covered area, weighted by opacity, is blank.
_BLANK_FRACTION = 0.999
# Least number of rows and columns of a frame that are sampled.
_SAMPLED = 128
# Linear light that 8-bit codes round to black, and to white.
_BLACK, _WHITE = 1.5e-4, 0.995
_PROBLEMS = {"black": "is all black", "clipped": "is clipped all over"}
_REMEDIES = {
    "black": "there is too little light, materials do not reflect it, or a filter stops it: raise",
    "clipped": "there is too much light: lower",
}


Writer = TypeVar("Writer", bound="RowWriter")


def write_frame(
    path: str | os.PathLike[str],
    frame: NDArray[np.uint8] | NDArray[np.uint16],
    text: Mapping[str, str] | None = None,
    space: str | Path | ColourSpace | Hdr = "sRGB",
) -> None:
    """Write a frame.

    Parameters
    ----------
    path : str or path
        Name that ends in ``.png``, or in ``.avif`` with an `Hdr`, else `ImageError`.
    frame : (H, W, 3) or (H, W, 4) uint8 or uint16
        Display codes; the fourth channel is straight alpha.
    text : {keyword: text}, optional
        Metadata (light, scene, software); AVIF has none.
    space : str, path, ColourSpace or Hdr
        Colour space of the codes: ``viewing.display.space``. sRGB is written as PNG's own chunk,
        any other space as an ICC profile, Display P3 also as code points; an `Hdr` as code points
        alone. Of AVIF, which holds 16-bit codes in 10 bits.
    """
    suffixes = (".png", ".avif") if isinstance(space, Hdr) else (".png",)
    require_suffix(path, "frames", *suffixes)
    colours = space if isinstance(space, Hdr) else colour_space(space)
    if not (
        isinstance(frame, np.ndarray)
        and frame.dtype in (np.uint8, np.uint16)
        and frame.ndim == 3
        and frame.shape[2] in (3, 4)
        and frame.size
    ):
        shape = f"{frame.dtype} {frame.shape}" if isinstance(frame, np.ndarray) else repr(frame)
        raise ImageError.refused(
            f"{os.fspath(path)}: the frame",
            shape,
            "give (H, W, 3) uint8, as from Relighter.frame",
            "shape",
        )
    height, width, channels = frame.shape
    bits = 8 * frame.dtype.itemsize
    is_avif = Path(path).suffix.lower() == ".avif"
    if is_avif and (bits, channels) != (16, 3):
        shape = f"{frame.dtype} {frame.shape}"
        remedy = "give (H, W, 3) uint16"
        raise ImageError.refused(f"{os.fspath(path)}: the frame", shape, remedy, "shape")

    def make(file: BinaryIO) -> PngWriter | AvifWriter:
        if is_avif and isinstance(colours, Hdr):
            return AvifWriter(file, (width, height), AVIF_BITS[0], colours)
        return PngWriter(file, (width, height), channels, bits, colours, text or {})

    with row_file(path, make) as file:
        file.rows(frame)


class RowWriter(Protocol):
    """Writes a picture to a binary file, row by row."""

    def rows(self, pixels: Any) -> None:
        """Append rows; (R, W, C)."""

    def close(self) -> None:
        """Write the end of the picture; the file stays open."""


def encode(pixels: NDArray[Any], make: Callable[[BinaryIO], RowWriter]) -> bytes:
    """Return the contents of a whole picture's file."""
    file = io.BytesIO()
    writer = make(file)
    writer.rows(pixels)
    writer.close()
    return file.getvalue()


@contextmanager
def row_file(path: str | os.PathLike[str], make: Callable[[BinaryIO], Writer]) -> Iterator[Writer]:
    """Open a file for rows; the file appears when the context ends."""
    with write_whole(path) as temporary, temporary.open("wb") as file:
        writer = make(file)
        yield writer
        writer.close()


def read_frame(path: Path) -> Image.Image:
    """Read a frame's picture; `InputError` if the file is damaged."""
    from PIL import Image

    try:
        with Image.open(path) as file:
            file.load()
            return file.copy()
    except Exception as error:  # Pillow raises exceptions of any class
        raise InputError(
            f"{path}: cannot be read ({one_line(error)}); delete it and repeat the command",
            code="damaged",
        ) from None


def read_frame_text(path: str | os.PathLike[str]) -> dict[str, str]:
    """Read the metadata that `write_frame` wrote."""
    from PIL import Image

    with Image.open(path) as image:
        return {str(key): str(value) for key, value in image.info.items() if isinstance(value, str)}


def file_stem(name: str) -> str:
    """Return a file stem for a light's name: all but letters, digits and ``+ - . _`` become ``-``.

    Accents are composed, long names are cut, and names reserved by Windows get a leading ``_``.

    >>> file_stem("D65*0.5+A*0.5"), file_stem("../x"), file_stem("con.x")
    ('D65-0.5+A-0.5', 'x', '_con.x')
    """
    composed = unicodedata.normalize("NFC", name)
    allowed = "".join(c if c.isalnum() or c in "+-._" else "-" for c in composed)
    short = allowed.encode()[:_STEM_BYTES].decode(errors="ignore")
    stem = short.strip("-.") or "light"
    return f"_{stem}" if stem.partition(".")[0].casefold() in _DEVICES else stem


def distinct_stems(names: Sequence[str], taken: Sequence[str] = ("sheet",)) -> list[str]:
    """Return a stem for each name; repetitions of a stem, ignoring case, get a number.

    >>> distinct_stems(["a b", "A*B", "sheet"])
    ['a-b', 'A-B-2', 'sheet-2']
    """
    used = {name.casefold() for name in taken}
    stems = []
    for name in names:
        stem, number = file_stem(name), 2
        while (tried := stem if number == 2 else f"{stem}-{number - 1}").casefold() in used:
            number += 1
        used.add(tried.casefold())
        stems.append(tried)
    return stems


@dataclass(slots=True)
class _Coverage:
    """Sampled opacity of a frame, and its black and clipped parts."""

    light: str
    cut: bool = False
    visible: bool = False
    covered: float = 0.0
    blank: dict[str, float] = field(default_factory=lambda: dict.fromkeys(_PROBLEMS, 0.0))


class BlankFrames:
    """Find frames that are all black, clipped all over, or cut away; ``remedy`` names settings."""

    def __init__(self, remedy: str) -> None:
        self._remedy = remedy
        self._frames: dict[str, _Coverage] = {}

    def add(
        self,
        name: str,
        light: str,
        pixels: NDArray[Any],
        alpha: NDArray[np.float32],
        side: int = 0,
        *,
        cut: bool = False,
    ) -> None:
        """Sample a frame, or the next rows of a frame whose shorter side has ``side`` pixels.

        Pixels are display codes, or linear light premultiplied by opacity, the fourth channel.
        ``alpha`` is opacity as cast, so that a backdrop alone counts as blank. ``cut`` is True if
        what is near or far was left out of what was cast.
        """
        stride = max(1, (side or min(alpha.shape)) // _SAMPLED)
        colours, cover = pixels[::stride, ::stride, :3], alpha[::stride, ::stride]
        if pixels.dtype.kind == "u":
            dark, bright = colours == 0, colours == np.iinfo(pixels.dtype).max
        else:
            scale = cover[..., None] if pixels.shape[2] == 4 else 1.0
            dark, bright = colours <= _BLACK * scale, colours >= _WHITE * scale
        black = dark.all(axis=-1)
        coverage = self._frames.setdefault(name, _Coverage(light))
        coverage.cut = cut
        coverage.visible |= bool(alpha.any())
        coverage.covered += float(cover.sum())
        coverage.blank["black"] += float(cover[black].sum())
        coverage.blank["clipped"] += float(cover[(dark | bright).all(axis=-1) & ~black].sum())

    def warn(self) -> None:
        """Issue one warning for all frames of each kind."""
        frames = self._frames.items()
        empty = [name for name, cover in frames if cover.cut and not cover.visible]
        if empty:
            remedy = "move near_mm and far_mm of [depth]"
            self._warn(f"cuts leave nothing to be seen in {empty[0]}{_more(empty)}; {remedy}")
        for kind, problem in _PROBLEMS.items():
            lights = {
                name: cover.light
                for name, cover in frames
                if cover.covered > 0.0 and cover.blank[kind] >= _BLANK_FRACTION * cover.covered
            }
            if not lights:
                continue
            name, light = next(iter(lights.items()))
            more = _more(lights)
            self._warn(f"{name} {problem} under {light}{more}; {_REMEDIES[kind]} {self._remedy}")

    def _warn(self, text: str) -> None:
        warnings.warn(text, VolspecWarning, stacklevel=3)


def _more(names: Collection[str]) -> str:
    """Return how many more there are than the first."""
    return f", and {len(names) - 1} more" if len(names) > 1 else ""
