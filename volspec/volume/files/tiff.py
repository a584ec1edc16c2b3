"""Multi-page TIFF files (plain, ImageJ, OME-TIFF), and folders of TIFF or PNG slices.

file -> tifffile: axes and pages -> [tiff] -> Reading
folder -> names in order -> [tiff] -> Reading
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.channels import Channel
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
from volspec.volume.files.slices import Slices, level_of_slices
from volspec.volume.pyramid import Stack

SUFFIXES = (".tif", ".tiff")
# tifffile's letters: channels and the samples of a pixel, time.
_CHANNELS, _TIME = "CS", "T"
_PNG = ".png"
# tifffile's letter for the samples of a pixel.
_SAMPLES = "S"
# Greatest compression ratio that is expected.
_MOST_PACKED = 100


def read_tiff(query: Query) -> Reading:
    """Read a TIFF file's stack, with the channel and time that the query selects."""
    path = query.path
    query.allow("spacing", "channel", "time")
    remarks: list[str] = []
    with picture_errors(path), _opened(path) as tiff:
        series, through, channels = _series(tiff, query)
        at = _selected(series, through, channels, query)
        query.end_choices()
        if through == _TIME:
            remarks.append(f"{path}: its pages are points in time, but are read as slices")
        spacing = resolve_spacing(stated_spacing_mm(tiff, series.keyframe), query, remarks)
        if (slices := _Pages.of(tiff, series, through, at)) is None:
            query.reserve(series.shape, series.dtype.itemsize)
            index = tuple(at.get(axis, slice(None)) for axis in series.axes)
            values = np.array(series.asarray()[index])
        else:
            query.reserve((*series.keyframe.shape, slices.count), series.dtype.itemsize)
            values = stack_slices(range(slices.count), slices.read)
    number = at.get("C", 0)
    channel = channels[number] if number < len(channels) else None
    return Reading(values, spacing_mm=spacing, remarks=remarks, channel=channel)


def tiff_stack(query: Query) -> Stack | None:
    """Return a stack that is larger than memory as a level, read page by page; else None.

    So are those of several channels or times, unless one is selected.
    """
    path = query.path
    if query.choices is not None or path.stat().st_size * _MOST_PACKED <= query.most_bytes:
        return None
    with picture_errors(path), _opened(path) as tiff:
        series, through, channels = _series(tiff, query)
        sizes = dict(zip(series.axes, series.shape, strict=True))
        shape = sizes[through], sizes["Y"], sizes["X"]
        others = {axis: n for axis, n in sizes.items() if axis not in (through, "Y", "X")}
        selected = all(n == 1 or _names(axis, n)[0] in query.options for axis, n in others.items())
        if math.prod(shape) * series.dtype.itemsize <= query.most_bytes or not selected:
            return None
        at = _selected(series, through, channels, query)
        slices = _Pages.of(tiff, series, through, at)
        spacing = resolve_spacing(stated_spacing_mm(tiff, series.keyframe), query, [])
    if slices is None:
        return None
    read = partial(_pages_of_file, path, through, at)
    level = level_of_slices(Slices(path, shape, series.dtype, read), spacing)
    number = at.get("C", 0)
    return Stack([level], channels[number] if number < len(channels) else None)


def _pages_of_file(
    path: Path, through: str, at: dict[str, int], numbers: Sequence[int]
) -> list[NDArray[Any]]:
    with picture_errors(path), _opened(path) as tiff:
        found = _Pages.of(tiff, _only_series(tiff, Query(path)), through, at)
        assert found is not None
        return [found.read(number) for number in numbers]


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


def _series(tiff: Any, query: Query) -> tuple[Any, str, list[Channel]]:
    """Return a file's stack, the axis of its slices, and its channels."""
    series = _only_series(tiff, query)
    sizes = dict(zip(series.axes, series.shape, strict=True))
    return series, _slice_axis(series, query), stated_channels(tiff, sizes.get("C", 1))


def _selected(series: Any, through: str, channels: list[Channel], query: Query) -> dict[str, int]:
    """Return the index that the query selects along each axis that a volume lacks."""
    named = [channel.name for channel in channels]
    return {
        axis: query.index(*_names(axis, count), () if axis == _TIME else named)
        for axis, count in zip(series.axes, series.shape, strict=True)
        if axis not in (through, "Y", "X")
    }


@dataclass(frozen=True, slots=True, eq=False)
class _Pages:
    """Slices of an open file: ``read(k)`` returns the k-th, without other channels and times."""

    count: int
    read: Callable[[int], NDArray[Any]]

    @classmethod
    def of(cls, tiff: Any, series: Any, through: str, at: dict[str, int]) -> _Pages | None:
        """Return the slices; None if a page is not one, and the series has to be read whole."""
        # One block of bytes, even if ImageJ lists only one page.
        run = series.dataoffset is not None
        own = series.axes[series.axes.index("Y") :] if run else series.keyframe.axes
        leading = series.axes[: len(series.axes) - len(own)]
        counts, page = series.shape[: len(leading)], series.shape[len(leading) :]
        if through not in leading or not (run or len(series.pages) == math.prod(counts)):
            return None
        within = tuple(at.get(axis, slice(None)) for axis in own)
        dtype = np.dtype(tiff.byteorder + series.dtype.char)

        def read(k: int) -> NDArray[Any]:
            place = [k if axis == through else at[axis] for axis in leading]
            number = int(np.ravel_multi_index(place, counts))
            if not run:
                return page_values(series.pages[number])[within]
            items = math.prod(page)
            first = series.dataoffset + number * items * dtype.itemsize
            values = np.fromfile(tiff.filehandle.path, dtype, items, offset=first)
            return values.reshape(page)[within]

        return cls(series.shape[series.axes.index(through)], read)


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


def pictures_stack(query: Query) -> Stack | None:
    """Return a folder of pictures that is larger than memory as a level; else None."""
    files = pictures_in(query.path)
    if query.choices is not None or len(files) < 2:
        return None
    first, stated = _read_picture(files[0], lambda shape, itemsize: None)
    shape = len(files), first.shape[0], first.shape[1]
    channels = 1 if first.ndim == 2 else first.shape[2]
    if math.prod(shape) * first.itemsize <= query.most_bytes or (
        channels > 1 and "channel" not in query.options
    ):
        return None
    own = Query(query.path, query.options)
    read = partial(_slices_of_folder, files, first.shape, own)
    slices = Slices(query.path, shape, first.dtype, read)
    return Stack([level_of_slices(slices, resolve_spacing(stated, query, []))])


def _slices_of_folder(
    files: Sequence[Path], shape: tuple[int, ...], query: Query, numbers: Sequence[int]
) -> list[NDArray[Any]]:
    return [
        _read_slice(files[number], shape, query, lambda shape, itemsize: None) for number in numbers
    ]


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
