"""Multi-page TIFF files (plain, ImageJ, OME-TIFF), and folders of TIFF or PNG slices.

file -> tifffile: axes and pages -> [tiff] -> Reading
folder -> names in order -> [tiff] -> Reading
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.files.lattice import stack_slices
from volspec.volume.files.pages import (
    Reserve,
    page_values,
    picture_errors,
    png_values,
    resolve_spacing,
    stated_channels,
    stated_spacing_mm,
)
from volspec.volume.files.query import Query, Reading

SUFFIXES = (".tif", ".tiff")
# tifffile's letters: channels and the samples of a pixel, time.
_CHANNELS, _TIME = "CS", "T"
_PNG = ".png"
# tifffile's letter for the samples of a pixel.
_SAMPLES = "S"


def read_tiff(query: Query) -> Reading:
    """Read a TIFF file's stack, with the channel and time that the query selects."""
    path = query.path
    query.allow("spacing", "channel", "time")
    remarks: list[str] = []
    with picture_errors(path), _opened(path) as tiff:
        series = _only_series(tiff, query)
        through = _slice_axis(series, query)
        sizes = dict(zip(series.axes, series.shape, strict=True))
        channels = stated_channels(tiff, sizes.get("C", 1))
        named = [channel.name for channel in channels]
        at = {
            axis: query.index(*_names(axis, count), () if axis == _TIME else named)
            for axis, count in sizes.items()
            if axis not in (through, "Y", "X")
        }
        query.end_choices()
        if through == _TIME:
            remarks.append(f"{path}: its pages are points in time, but are read as slices")
        spacing = resolve_spacing(stated_spacing_mm(tiff, series.keyframe), query, remarks)
        values = _values(tiff, series, through, at, query)
    number = at.get("C", 0)
    channel = channels[number] if number < len(channels) else None
    return Reading(values, spacing_mm=spacing, remarks=remarks, channel=channel)


def _opened(path: Path) -> Any:
    """Open a file; pages written one by one are joined, which tifffile makes separate series."""
    from tifffile import TiffFile

    tiff = TiffFile(path)
    if tiff.is_shaped and len(tiff.series) > 1 and all(len(s.pages) == 1 for s in tiff.series):
        tiff.close()
        tiff = TiffFile(path, is_shaped=False)
    return tiff


def _only_series(tiff: Any, query: Query) -> Any:
    """Return a file's only series, or the only stack among single pictures (labels, previews)."""
    if len(tiff.series) == 1:
        return tiff.series[0]
    stacks = [series for series in tiff.series if len(series.pages) > 1]
    if len(stacks) == 1:
        return stacks[0]
    sizes = ", ".join("x".join(map(str, series.shape[::-1])) for series in tiff.series[:8])
    raise VolumeError(
        f"{query.path}: holds pictures of several sizes ({sizes}); a volume's slices have the "
        "same size, save the stack alone",
        code="conflict",
    )


def _slice_axis(series: Any, query: Query) -> str:
    """Return the axis along which slices are stacked."""
    others = [axis for axis in series.axes if axis not in ("Y", "X", *_CHANNELS)]
    if "Z" in others:
        others = [axis for axis in others if axis not in ("Z", _TIME)]
        if not others:
            return "Z"
    elif len(others) == 1:
        return str(others[0])
    counts = "x".join(map(str, series.shape[::-1]))
    if not others:
        raise VolumeError(
            f"{query.path}: is a single picture ({counts}), a volume needs several slices; give "
            f"the folder that holds them, {query.path.absolute().parent}",
            code="shape",
        )
    raise VolumeError(
        f"{query.path}: holds {counts} values along {series.axes[::-1]}, among which no stack of "
        "slices is recognised; save one stack",
        code="shape",
    )


def _names(axis: str, count: int) -> tuple[str, int, str]:
    """Return the option that selects along an axis, the axis' length, and a noun for it."""
    if axis == _TIME:
        return "time", count, "time steps"
    return "channel", count, "channels"


def _values(tiff: Any, series: Any, through: str, at: dict[str, int], query: Query) -> NDArray[Any]:
    """Read (Z, Y, X) values without the other channels and times."""
    itemsize = series.dtype.itemsize
    index = tuple(at.get(axis, slice(None)) for axis in series.axes)
    if series.dataoffset is not None:  # one block of bytes, even if ImageJ lists only one page
        from tifffile import memmap

        which = next(k for k, each in enumerate(tiff.series) if each is series)
        whole = memmap(tiff.filehandle.path, series=which, mode="r")
        chosen = whole[index]
        query.reserve(chosen.shape, itemsize)
        # A copy: the file may change while the volume is in use.
        return np.array(chosen)
    own = series.keyframe.axes
    leading = series.axes[: len(series.axes) - len(own)]
    counts = series.shape[: len(leading)]
    if through not in leading or len(series.pages) != math.prod(counts):
        query.reserve(series.shape, itemsize)
        return np.array(series.asarray()[index])
    within = tuple(at.get(axis, slice(None)) for axis in own)

    def page(k: int) -> NDArray[Any]:
        place = [k if axis == through else at[axis] for axis in leading]
        return page_values(series.pages[int(np.ravel_multi_index(place, counts))])[within]

    count = series.shape[leading.index(through)]
    query.reserve((*series.keyframe.shape, count), itemsize)
    return stack_slices(range(count), page)


def pictures_in(folder: Path) -> list[Path]:
    """Return a folder's TIFF files, or else its PNG files; ``z2`` before ``z10``."""
    files = [p for p in folder.iterdir() if not p.name.startswith(".") and p.is_file()]
    for endings in (SUFFIXES, (_PNG,)):
        if found := [path for path in files if path.name.lower().endswith(endings)]:
            return sorted(found, key=lambda path: _natural_key(path.name))
    return []


def _natural_key(name: str) -> list[tuple[int, str]]:
    """Return a sort key by letters and by the values of numbers, then by their digits.

    >>> sorted(["z10.tif", "z2.tif", "Z01.tif"], key=_natural_key)
    ['Z01.tif', 'z2.tif', 'z10.tif']
    """
    parts = re.split(r"(\d+)", name.casefold())
    return [(int(part) if part.isdecimal() else 0, part) for part in parts]


def read_stack(query: Query) -> Reading:
    """Read a folder of pictures of one size, or one channel of them."""
    query.allow("spacing", "channel")
    files = pictures_in(query.path)
    if len(files) == 1:
        raise VolumeError(
            f"{query.path}: holds one picture, {files[0].name}, but a volume has several slices; "
            "give all of them, or a multi-page TIFF file itself",
            code="shape",
        )
    remarks: list[str] = []

    def reserve(shape: Sequence[int], itemsize: int) -> None:
        query.reserve((*shape, len(files)), itemsize)

    first, stated = _read_picture(files[0], reserve)
    query.index("channel", 1 if first.ndim == 2 else first.shape[2], "channels")
    query.end_choices()
    spacing = resolve_spacing(stated, query, remarks)
    read = partial(_read_slice, shape=first.shape, query=query, reserve=reserve)
    values = stack_slices(files, read)
    return Reading(values, spacing_mm=spacing, remarks=remarks)


def _read_slice(path: Path, shape: tuple[int, ...], query: Query, reserve: Reserve) -> NDArray[Any]:
    """Read (Y, X) from one file, which must have the first one's size."""
    values, _ = _read_picture(path, reserve)
    if values.shape != shape:
        raise VolumeError(
            f"{path}: is {_size(values.shape)}, the first slice {_size(shape)}; remove what is "
            "not a slice, or make all the same size",
            code="shape",
        )
    if values.ndim == 2:
        query.index("channel", 1, "channels")
        return values
    chosen: NDArray[Any] = values[..., query.index("channel", shape[2], "channels")]
    return chosen


def _size(shape: tuple[int, ...]) -> str:
    channels = f" of {shape[2]} channels" if len(shape) > 2 else ""
    return f"{shape[1]}x{shape[0]}{channels}"


def _read_picture(path: Path, reserve: Reserve) -> tuple[NDArray[Any], tuple[float | None, ...]]:
    """Read (Y, X) or (Y, X, S) and the stated spacing from one file."""
    with picture_errors(path):
        if path.suffix.lower() == _PNG:
            return png_values(path, reserve), (None, None, None)
        from tifffile import TiffFile

        with TiffFile(path) as tiff:
            page = tiff.pages[0]
            if (pages := len(tiff.pages) * page.imagedepth) > 1:
                raise VolumeError(
                    f"{path}: holds {pages} pages, and its folder has other files; give a file of "
                    "several pages itself, or a folder of single ones",
                    code="conflict",
                )
            reserve(page.shape, page.dtype.itemsize)
            values = page_values(page)
            if page.axes.startswith(_SAMPLES):  # a plane per colour
                values = np.moveaxis(values, 0, -1)
            return values, stated_spacing_mm(tiff, page)
