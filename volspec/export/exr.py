"""Frames as OpenEXR: linear light, half floats, the primaries told.

    pixels -> [exr]

Opacity is multiplied into the colours, as compositors expect of this format.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._exr import write_exr
from volspec.appearance.spaces import ColourSpace
from volspec.errors import ImageError

_LARGEST_HALF = float(np.finfo(np.float16).max)


class ExrRows:
    """Rows of one picture, kept until all are there."""

    def __init__(self) -> None:
        self.parts: list[NDArray[np.float16]] = []

    def rows(self, pixels: NDArray[Any]) -> None:
        """Add rows; (R, W, C) linear."""
        bounded = np.clip(np.nan_to_num(pixels, nan=0.0), -_LARGEST_HALF, _LARGEST_HALF)
        self.parts.append(bounded.astype(np.float16))


@contextmanager
def exr_file(
    path: str | os.PathLike[str], space: ColourSpace, text: Mapping[str, str]
) -> Iterator[ExrRows]:
    """An OpenEXR picture that takes its rows; it appears when all are there.

    Parameters
    ----------
    path : path
    space : ColourSpace
        Its primaries and white go into the header's ``chromaticities``.
    text : {name: text}
        Goes into the header, as ``volspec:name``.

    Raises
    ------
    ImageError
        If the file cannot be written.
    """
    writer = ExrRows()
    yield writer
    pixels = np.concatenate(writer.parts)
    numbers = [float(v) for xy in (*space.primaries_xy, space.white_xy) for v in xy]
    header: dict[str, Any] = {"chromaticities": tuple(numbers)}
    header |= {f"volspec:{name}": value for name, value in text.items()}
    channels = {name: pixels[..., i] for i, name in enumerate("RGBA"[: pixels.shape[2]])}
    write_exr(path, header, channels, ImageError)
