"""TIFF files of several pages: plain, ImageJ's, OME-TIFF.

file -> tifffile: axes and pages -> [tiff] -> Reading
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.files.pages import page_values, readable
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.stacking import stacked
from volspec.volume.files.tiff_spacing import spacing_of, stated_mm

SUFFIXES = (".tif", ".tiff")
# tifffile's letters: channels and the samples of a pixel, time.
_CHANNELS, _TIME = "CS", "T"


def read_tiff(query: Query) -> Reading:
    """Read the stack that a TIFF file holds; of several channels or times the one asked for.

    Raises
    ------
    VolumeError
        If it holds a single picture, pictures of several sizes, or more than a stack.
    """
    from tifffile import TiffFile

    path = query.path
    query.allow("spacing", "channel", "time")
    remarks: list[str] = []
    with readable(path), TiffFile(path, **_pages_alike(path)) as tiff:
        series = _only_series(tiff, query)
        through = _slice_axis(series, query)
        at = {
            axis: query.index(*_names(axis, count))
            for axis, count in zip(series.axes, series.shape, strict=True)
            if axis not in (through, "Y", "X")
        }
        if through == _TIME:
            remarks.append(f"{path}: its pages are points in time, and are taken for slices")
        spacing = spacing_of(stated_mm(tiff, series.keyframe), query, remarks)
        values = _values(tiff, series, through, at, query)
    return Reading(values, spacing_mm=spacing, remarks=remarks)


def _pages_alike(path: Path) -> dict[str, bool]:
    """How to open a file: pages that tifffile has written one by one are a series each in it."""
    from tifffile import TiffFile

    with TiffFile(path) as tiff:
        single = len(tiff.series) > 1 and all(len(each.pages) == 1 for each in tiff.series)
        return {"is_shaped": False} if single and tiff.is_shaped else {}


def _only_series(tiff: Any, query: Query) -> Any:
    """The series of a file, or the one stack among single pictures (labels, previews)."""
    if len(tiff.series) == 1:
        return tiff.series[0]
    stacks = [series for series in tiff.series if len(series.pages) > 1]
    if len(stacks) == 1:
        return stacks[0]
    sizes = ", ".join("x".join(map(str, series.shape[::-1])) for series in tiff.series[:8])
    raise VolumeError(
        f"{query.path}: holds pictures of several sizes ({sizes}); a volume's slices have one, "
        "save the stack alone"
    )


def _slice_axis(series: Any, query: Query) -> str:
    """The axis that runs through the slices."""
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
            f"{query.path}: is a single picture ({counts}), a volume has several slices; give the "
            f"folder that holds them, {query.path.absolute().parent}"
        )
    raise VolumeError(
        f"{query.path}: holds {counts} values along {series.axes[::-1]}, of which no stack of "
        "slices can be told; save one stack"
    )


def _names(axis: str, count: int) -> tuple[str, int, str]:
    """The option that chooses along an axis, how many there are, and what they are."""
    if axis == _TIME:
        return "time", count, "time steps"
    return "channel", count, "channels"


def _values(tiff: Any, series: Any, through: str, at: dict[str, int], query: Query) -> NDArray[Any]:
    """(Z, Y, X), read without the other channels and times."""
    itemsize = series.dtype.itemsize
    index = tuple(at.get(axis, slice(None)) for axis in series.axes)
    if series.dataoffset is not None:  # one block of bytes, also where ImageJ lists one page only
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
    return stacked(range(count), page)
