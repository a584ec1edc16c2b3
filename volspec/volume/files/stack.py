"""Folders of pictures, one a slice: TIFF or PNG.

folder -> names in order -> [stack] -> Reading
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.files.pages import Reserve, page_values, png_values, readable
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.stacking import stacked
from volspec.volume.files.tiff import SUFFIXES
from volspec.volume.files.tiff_spacing import spacing_of, stated_mm

_PNG = ".png"
# tifffile's letter for the samples of a pixel.
_SAMPLES = "S"


def pictures_in(folder: Path) -> list[Path]:
    """A folder's TIFF files, or where there are none its PNG files; ``z2`` before ``z10``."""
    files = [p for p in folder.iterdir() if not p.name.startswith(".") and p.is_file()]
    for endings in (SUFFIXES, (_PNG,)):
        if found := [path for path in files if path.name.lower().endswith(endings)]:
            return sorted(found, key=lambda path: _in_order(path.name))
    return []


def _in_order(name: str) -> list[tuple[int, str]]:
    """Numbers by their value, letters in between; equal numbers by how they are written.

    >>> sorted(["z10.tif", "z2.tif", "Z01.tif"], key=_in_order)
    ['Z01.tif', 'z2.tif', 'z10.tif']
    """
    parts = re.split(r"(\d+)", name.casefold())
    return [(int(part) if part.isdecimal() else 0, part) for part in parts]


def read_stack(query: Query) -> Reading:
    """Read a folder of pictures.

    Raises
    ------
    VolumeError
        If one is damaged, or of another size than the first, or all are in colour and no
        channel is chosen.
    """
    query.allow("spacing", "channel")
    files = pictures_in(query.path)
    if len(files) == 1:
        raise VolumeError(
            f"{query.path}: holds one picture, {files[0].name}, a volume has several slices; give "
            "all of them, or a TIFF file of several pages itself"
        )
    remarks: list[str] = []

    def reserve(shape: Sequence[int], itemsize: int) -> None:
        query.reserve((*shape, len(files)), itemsize)

    first, stated = _picture(files[0], reserve)
    spacing = spacing_of(stated, query, remarks)
    values = stacked(files, partial(_slice, shape=first.shape, query=query, reserve=reserve))
    return Reading(values, spacing_mm=spacing, remarks=remarks)


def _slice(path: Path, shape: tuple[int, ...], query: Query, reserve: Reserve) -> NDArray[Any]:
    """(Y, X) of one file, which is as large as the first."""
    values, _ = _picture(path, reserve)
    if values.shape != shape:
        raise VolumeError(
            f"{path}: is {_size(values.shape)}, the first slice {_size(shape)}; take out what is "
            "no slice, or make all of one size"
        )
    if values.ndim == 2:
        query.index("channel", 1, "channels")
        return values
    chosen: NDArray[Any] = values[..., query.index("channel", shape[2], "channels")]
    return chosen


def _size(shape: tuple[int, ...]) -> str:
    channels = f" of {shape[2]} channels" if len(shape) > 2 else ""
    return f"{shape[1]}x{shape[0]}{channels}"


def _picture(path: Path, reserve: Reserve) -> tuple[NDArray[Any], tuple[float | None, ...]]:
    """(Y, X) or (Y, X, S) of one file, and the spacing that it states."""
    with readable(path):
        if path.suffix.lower() == _PNG:
            return png_values(path, reserve), (None, None, None)
        from tifffile import TiffFile

        with TiffFile(path) as tiff:
            page = tiff.pages[0]
            if (pages := len(tiff.pages) * page.imagedepth) > 1:
                raise VolumeError(
                    f"{path}: holds {pages} pages beside other files; give a file of several pages "
                    "itself, or a folder of single ones"
                )
            reserve(page.shape, page.dtype.itemsize)
            values = page_values(page)
            if page.axes.startswith(_SAMPLES):  # a plane for each colour
                values = np.moveaxis(values, 0, -1)
            return values, stated_mm(tiff, page)
