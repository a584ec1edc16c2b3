"""Multi-page TIFF files: plain, ImageJ's and OME-TIFF.

    file -> tifffile: series, axes, pages -> [tiff] -> Slices -> Reading, or Stack

References
----------
[1] OME-TIFF specification: Images of a file, planes in other files, companion files (BinaryOnly).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec.errors import Code, VolumeError
from volspec.volume.channels import unique_titles
from volspec.volume.files.lattice import stack_slices
from volspec.volume.files.pages import (
    PICTURES,
    ome_root,
    page_values,
    picture_errors,
    resolve_spacing,
    stated_channels,
    stated_spacing_mm,
)
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.slices import SliceStack, larger_stack
from volspec.volume.levels.pyramid import Stack

SUFFIXES = PICTURES["TIFF"]
# tifffile's letters: time, slices, channels, rows, columns, samples of a pixel.
_TIME, _SLICES, _AXES, _OF_PICTURES = "T", "Z", "TZCYXS", "CYXS"
# Greatest compression ratio that is expected.
_MAX_PACKED = 100
# Most sizes that a message lists.
_MAX_LISTED = 8


def read_tiff(query: Query) -> Reading:
    """Read a TIFF file's stack, with the channel and time that the query selects."""
    return _slices(query).reading(query)


def tiff_stack(query: Query) -> Stack | None:
    """Return a stack that is larger than memory as a level, read page by page; else None.

    So are those of several channels or times, unless one is selected.
    """
    small = query.path.stat().st_size * _MAX_PACKED <= query.most_bytes
    return None if small else larger_stack(query, _slices)


def _slices(query: Query) -> SliceStack:
    path, notes = query.path, list[str]()
    with picture_errors(path), _open_tiff(path) as tiff:
        stack = _select_stack(tiff, query)
        query.end_choices()
        series, sizes = stack.series, stack.sizes
        if stack.slice_axis == _TIME:
            notes.append(f"{path}: its pages are points in time, but are read as slices")
        if (companion := _companion(tiff)) is not None:
            notes.append(
                f"{path}: {companion.name}, which states its axes and spacing, is missing; copy it "
                "to the same folder"
            )
        if "C" in stack.axes and not (stack.slice_axis or tiff.is_ome):
            slices = query.example(axes=stack.axes.replace("C", "Z"))
            notes.append(f"{path}: is a picture of channels; if these are slices, read {slices}")
        shape = _complete_slices(stack, path, notes), sizes["Y"], sizes["X"]
        spacing = stated_spacing_mm(tiff, series.keyframe, series)
        channels = stated_channels(tiff, series, sizes.get("C", 1))
    file_query = Query(path, query.options)
    return SliceStack(
        *(path, shape, series.dtype, partial(_read_pages, file_query)),
        *resolve_spacing(spacing, query, notes, shape[0]),
        channels[stack.indices.get("C", 0)] if channels else None,
        notes,
        stored_shape=() if stack.has_pages else series.shape,
    )


def _read_pages(query: Query, numbers: Sequence[int]) -> NDArray[Any]:
    with picture_errors(query.path), _open_tiff(query.path) as tiff:
        stack = _select_stack(tiff, query)
        series, axes = stack.series, stack.axes
        if stack.is_run or not stack.has_pages:
            dtype = np.dtype(tiff.byteorder + series.dtype.char)
            voxels = (
                np.memmap(tiff.filehandle.path, dtype, "r", series.dataoffset, series.shape)
                if stack.is_run
                else series.asarray()
            )
            picked = _index_axes(voxels, axes, stack.indices, (*stack.slice_axis, *"YX"))
            return np.asarray((picked if stack.slice_axis else picked[None])[numbers])
        count = len(stack.leading)

        def read(k: int) -> NDArray[Any]:
            place = [
                k if axis == stack.slice_axis else stack.indices[axis] for axis in stack.leading
            ]
            number = np.ravel_multi_index(place, series.shape[:count])
            page = page_values(series.pages[int(number)]).reshape(series.shape[count:])
            return _index_axes(page, axes[count:], stack.indices, "YX")

        return stack_slices(numbers, read)


def _open_tiff(path: Path) -> Any:
    """Open a file, or that with its OME-XML.

    Pages written one by one are joined, which tifffile makes separate series.
    """
    from tifffile import TiffFile

    tiff = TiffFile(path)
    _require_parts_inside(path, ome_root(tiff))
    if tiff.is_shaped and len(tiff.series) > 1 and all(len(s.pages) == 1 for s in tiff.series):
        tiff.close()
        return TiffFile(path, is_shaped=False)
    if (companion := _companion(tiff)) is not None and companion.is_file():
        tiff.close()
        require_inside(companion, VolumeError)
        if companion.name.lower().endswith(SUFFIXES):
            tiff = TiffFile(companion)
        else:
            tiff = TiffFile(path, omexml=companion.read_text(encoding="utf-8"))
        _require_parts_inside(path, ome_root(tiff))
    return tiff


def _require_parts_inside(path: Path, root: Element) -> None:
    """Raise VolumeError if an OME-XML names a file of planes that must not be opened."""
    for element in root.iterfind(".//{*}UUID"):
        require_inside(path.parent / element.get("FileName", ""), VolumeError)


def _companion(tiff: Any) -> Path | None:
    """Return the file with the OME-XML of one that has only a reference to it."""
    row = ome_root(tiff).find("{*}BinaryOnly")
    name = "" if row is None else row.get("MetadataFile", "")
    return Path(tiff.filehandle.path).parent / Path(name).name if name else None


class _Selection(NamedTuple):
    """Stack in an open file."""

    series: Any
    axes: str
    sizes: dict[str, int]  # length of each axis
    slice_axis: str  # axis of the slices; empty of one picture
    indices: Mapping[str, int]  # index along the other axes but Y and X
    leading: str  # axes along which pages follow
    is_run: bool  # it is one block of bytes, even if ImageJ lists only its first page
    has_pages: bool  # each page is of one slice; else the series is read as a whole


def _select_stack(tiff: Any, query: Query) -> _Selection:
    """Return the stack that a query selects by its series, axes, channel and time."""
    query.allow("series", "axes", "channel", "time")
    series, axes = _series(tiff, query)
    slice_axis, sizes = _slice_axis(series, axes, query), dict(zip(axes, series.shape, strict=True))
    names = [channel.name for channel in stated_channels(tiff, series, sizes.get("C", 1))]
    index = {
        axis: query.index("time", count, "time steps")
        if axis == _TIME
        else query.index("channel", count, "channels", names)
        for axis, count in sizes.items()
        if axis not in (slice_axis, "Y", "X")
    }
    leading, is_run = axes.rstrip("YXS"), series.dataoffset is not None
    is_paged = is_run or len(series.pages) == math.prod(sizes[axis] for axis in leading)
    has_pages = is_paged and not {*"YX"} & {*leading}
    return _Selection(series, axes, sizes, slice_axis, index, leading, is_run, has_pages)


def _series(tiff: Any, query: Query) -> tuple[Any, str]:
    """Return the stack that the query selects, with its axes; labels and previews are none."""
    letters = query.options.get("axes", "").upper()
    pairs = [(s, letters if len(letters) == len(s.axes) else s.axes) for s in tiff.series]
    stacks = [(series, axes) for series, axes in pairs if {*axes} - {*_OF_PICTURES}]
    pairs = stacks or pairs
    titles = unique_titles([series.name or "stack" for series, _ in pairs])
    names = [f"{title} ({_size(series)})" for title, (series, _) in zip(titles, pairs, strict=True)]
    series, axes = pairs[query.index("series", len(pairs), "stacks", names)]
    if len(pairs) > 1 and "series" not in query.options:
        query.end_choices()  # the others depend on it
    is_valid = len({*letters}) == len(letters) and {*"YX"} <= {*letters} <= {*_AXES}
    if letters and (axes != letters or not is_valid):
        raise VolumeError(
            f"{query.path}: axes={letters} do not fit its {len(axes)} axes ({_size(series)})",
            f"give {len(axes)} different letters of {_AXES}, Y and X among them",
            code="syntax",
            given=letters,
        )
    return series, axes


def _size(series: Any) -> str:
    return "x".join(map(str, series.shape[::-1]))


def _slice_axis(series: Any, axes: str, query: Query) -> str:
    """Return the axis along which slices are stacked; none of a single picture."""
    extra = [axis for axis in axes if axis not in _OF_PICTURES]
    if len({*axes}) == len(axes) and _SLICES in extra and {*extra} <= {_SLICES, _TIME}:
        return _SLICES
    if len(extra) == 1:
        return extra[0]
    if extra:
        free = iter([axis for axis in "ZTC" if axis not in axes])
        likely = [axis if axis in _AXES else next(free, axis) for axis in axes[::-1]]
        why = f"holds {_size(series)} values, and does not state which axis has the slices"
        remedy = f"name its axes, as in {query.example(axes=''.join(likely[::-1]))}"
    elif series.shape[axes.index("S")] > 4 if "S" in axes else False:
        why = f"is a picture of {series.shape[axes.index('S')]} samples a pixel ({_size(series)})"
        remedy = f"if these are slices, read it as {query.example(axes=axes.replace('S', 'Z'))}"
    else:
        return ""
    raise VolumeError(f"{query.path}: {why}", remedy, code="shape")


def _complete_slices(stack: _Selection, path: Path, notes: list[str]) -> int:
    """Return the number of slices before the first that lacks pages, and note the others.

    A slice is complete with all channels of which the file has any page at that time.
    """
    series, leading = stack.series, stack.leading
    slice_axis, index = stack.slice_axis, stack.indices
    count = stack.sizes.get(slice_axis, 1)
    present = np.array([page is not None for page in series.pages])
    if present.all():
        return count
    present = present.reshape(series.shape[: len(leading)])
    time = {axis: k for axis, k in index.items() if axis == _TIME}
    other_axes = [axis for axis in leading if axis != slice_axis and axis not in time]
    by_slice = _index_axes(present, leading, time, (*slice_axis, *other_axes)).reshape(count, -1)
    complete = by_slice[:, by_slice.any(axis=0)].all(axis=1)
    first = count if complete.all() else int(complete.argmin())
    remedy = "if they are in other files, copy these to the same folder"
    if not _index_axes(present, leading, index, slice_axis).any():
        code: Code = "range" if by_slice.any() else "damaged"  # "range": other channels are read
        raise VolumeError(f"{path}: no pages of this channel and time are there", remedy, code=code)
    if first < count:
        why = f"{path}: pages are missing from slice {first} on (of slices 0 to {count - 1})"
        if first < 2:
            raise VolumeError(why, remedy, code="damaged")
        notes.append(
            f"{why}, as after an aborted acquisition; the {first} before are read; {remedy}"
        )
    return first


def _index_axes(
    values: NDArray[Any], axes: str, picked: Mapping[str, int], order: Iterable[str]
) -> NDArray[Any]:
    """View an array at an index along some of its axes, with its other axes in an order."""
    remaining = [axis for axis in axes if axis not in picked]
    index = tuple(picked.get(axis, slice(None)) for axis in axes)
    return values[index].transpose([remaining.index(axis) for axis in order])
