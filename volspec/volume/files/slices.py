"""Folders of pictures as stacks, and stacks that are read slice by slice.

folder -> names in order, channels and times in names -> [slices] -> Slices
Slices -> [slices] -> Reading, or Stack if larger than memory
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.channels import Channel
from volspec.volume.checks import checked_geometry
from volspec.volume.files.lattice import stack_slices
from volspec.volume.files.pages import (
    PICTURES,
    Spacing,
    page_values,
    picture_errors,
    picture_values,
    resolve_spacing,
    stated_spacing_mm,
)
from volspec.volume.files.query import Query, Reading
from volspec.volume.levels.pyramid import Index, Level, Stack
from volspec.volume.metadata import Metadata

# Bytes of the slices of a chunk.
_CHUNK_BYTES = 2**24
# Most missing numbers that a note lists.
_MAX_LISTED = 3
# tifffile's letter for the samples of a pixel.
_SAMPLES = "S"
# Words before a number in the name of a picture, by the option that selects it.
_OPTIONS = {
    **dict.fromkeys(("c", "ch", "chan", "channel", "w", "wavelength"), "channel"),
    **dict.fromkeys(("t", "tp", "time", "timepoint", "frame"), "time"),
}


@dataclass(frozen=True, slots=True, eq=False)
class SliceStack:
    """Array (Z, Y, X) whose slices are read as a whole, and what is stated of it.

    ``read`` returns an array of the slices with some numbers, and can be pickled.
    """

    root: Path  # the file or folder
    shape: Index
    dtype: np.dtype[Any]
    read: Callable[[Sequence[int]], NDArray[Any]]
    spacing_mm: tuple[float, float, float]
    metadata: Metadata
    channel: Channel | None
    notes: list[str]
    stored_shape: tuple[int, ...] = ()  # shape of what is read for any slice

    def __getitem__(self, index: tuple[slice, slice, slice]) -> NDArray[Any]:
        return self.read(range(self.shape[0])[index[0]])[:, index[1], index[2]]

    def reading(self, query: Query) -> Reading:
        """Read all of them."""
        query.reserve(self.stored_shape or self.shape, self.dtype.itemsize)
        values = self.read(range(self.shape[0]))
        details = self.channel, self.metadata
        return Reading(values, self.spacing_mm, None, self.notes, None, *details)


def larger_stack(query: Query, find: Callable[[Query], SliceStack]) -> Stack | None:
    """Return slices that are larger than memory as a level whose chunks are whole slices."""
    if query.choices is not None:
        return None
    try:
        slices = find(query)
    except VolumeError:  # the reader raises it, or reads channels one by one
        return None
    count, rows, columns = slices.shape
    slice_bytes = rows * columns * slices.dtype.itemsize
    if slices.stored_shape or count * slice_bytes <= query.most_bytes:
        return None
    _, world = checked_geometry(slices.spacing_mm, None, str(slices.root))
    chunk = max(min(_CHUNK_BYTES // slice_bytes, 16, count), 1), rows, columns
    level = Level(slices, (0, 1, 2), (0, 0, 0), world, chunk)
    return Stack([level], slices.channel, None, slices.notes, metadata=slices.metadata)


def read_stack(query: Query) -> Reading:
    """Read a folder of pictures of one size, or one channel and time of them."""
    return _slices(query).reading(query)


def pictures_stack(query: Query) -> Stack | None:
    """Return a folder of pictures that is larger than memory as a level; else None."""
    return larger_stack(query, _slices)


def pictures_in(folder: Path) -> list[Path]:
    """Return a folder's pictures of the format that most of them have; ``z2`` before ``z10``."""
    return max(_by_format(folder).values(), key=len, default=[])


def _by_format(path: Path) -> dict[str, list[Path]]:
    """Return a picture by its format, or those of a folder, of which one alone may be TIFF."""
    paths, limit = (path.iterdir(), 1) if path.is_dir() else ([path], 0)
    files = [p for p in paths if not p.name.startswith(".") and p.is_file()]
    files.sort(key=lambda path: _natural_key(path.name))
    kinds = {
        kind: [path for path in files if path.name.lower().endswith(endings)]
        for kind, endings in PICTURES.items()
    }
    return {kind: files for kind, files in kinds.items() if len(files) > (kind != "TIFF" and limit)}


def missing_numbers(names: Sequence[str]) -> str:
    """List the values that the only number that differs in the names leaves out of regular ones.

    >>> missing_numbers(["s1.tif", "s2.tif", "s5.tif"]), missing_numbers(["s2.tif", "s4.tif"])
    ('3, 4', '')
    """
    numbers = [[int(n) for n in re.findall(r"\d+", name)] for name in names]
    if len({len(number) for number in numbers}) > 1:
        return ""
    differing = [column for column in zip(*numbers, strict=True) if len(set(column)) > 1]
    if len(differing) != 1:
        return ""
    steps = [later - earlier for earlier, later in pairwise(differing[0])]
    usual = min(steps)
    missing = [
        earlier + usual * k
        for earlier, step in zip(differing[0], steps, strict=False)
        for k in range(1, step // usual if usual else 0)
        if step % usual == 0
    ]
    return ", ".join(map(str, missing[:_MAX_LISTED])) + ", …" * (len(missing) > _MAX_LISTED)


def _natural_key(name: str) -> list[tuple[int, str]]:
    """Return a sort key by letters and by the values of numbers, then by their digits.

    >>> sorted(["z10.tif", "z2.tif", "Z01.tif"], key=_natural_key)
    ['Z01.tif', 'z2.tif', 'z10.tif']
    """
    parts = re.split(r"(\d+)", name.casefold())
    return [(int(part) if part.isdecimal() else 0, part) for part in parts]


def _slices(query: Query) -> SliceStack:
    query.allow("time", "channel")
    path, kinds = query.path, _by_format(query.path)
    kind, files = max(kinds.items(), key=lambda item: len(item[1]))
    parts, of_names = _parts_of_names(files)
    notes = [f"{path}: {note}" for note in of_names]
    if len(kinds) > 1:
        counts = ", ".join(f"{len(files)} {kind}" for kind, files in kinds.items())
        notes.append(
            f"{path}: holds pictures of several formats ({counts}), of which {kind} is read; move "
            "the others to a folder of their own"
        )
    expected = {part["slice"] for part in parts}
    rows, _, _ = _choose_rows(list(zip(files, parts, strict=True)), "time", "time steps", query)
    first, spacing = _read_picture(rows[0][0])
    samples = 1 if first.ndim == 2 else first.shape[2]
    rows, name, sample = _choose_rows(rows, "channel", "channels", query, samples)
    query.end_choices()
    if missing := sorted(expected - {part["slice"] for _, part in rows}, key=_natural_key):
        raise VolumeError(
            f"{path}: has no slice {missing[0]} with channel and time of {rows[0][0].name}",
            "complete the folder, or remove that slice of the others",
            code="missing",
        )
    if gaps := missing_numbers([file.name for file, _ in rows]):
        notes.append(
            f"{path}: no slice has the number {gaps}; those before and after follow each other"
        )
    return SliceStack(
        *(path, (len(rows), *first.shape[:2]), first.dtype),
        partial(_read_files, [file for file, _ in rows], first.shape, sample),
        *resolve_spacing(spacing, query, notes, len(rows)),
        Channel(name) if name and samples == 1 else None,
        notes,
    )


_Row = tuple[Path, dict[str, str]]


def _choose_rows(
    rows: list[_Row], key: str, noun: str, query: Query, samples: int = 1
) -> tuple[list[_Row], str, int]:
    """Return the files that an option selects, its value in their names, and a pixel's sample."""
    names = sorted({part.get(key, "") for _, part in rows}, key=_natural_key)
    name, sample = divmod(query.index(key, len(names) * samples, noun, names), samples)
    return [row for row in rows if row[1].get(key, "") == names[name]], names[name], sample


def _parts_of_names(files: Sequence[Path]) -> tuple[list[dict[str, str]], list[str]]:
    """Return the slice that each name states, its channel and time if these vary, and notes.

    >>> names = [Path(f"z{z}_ch{c}.tif") for z in (0, 1) for c in (0, 1)]
    >>> _parts_of_names(names)[0][1]
    {'slice': '0', 'channel': 'ch1'}
    """
    tokens = [re.findall(r"\d+|[^\W\d_]+", path.stem) for path in files]
    same = len({len(row) for row in tokens}) == 1
    columns = dict(enumerate(zip(*tokens, strict=True))) if same else {}
    varying = [n for n, column in columns.items() if len({*column}) > 1]
    repeated = [n for n in varying if len({*columns[n]}) < len(files)]
    if len({tuple(row[n] for n in repeated) for row in tokens}) == len(files):
        varying = repeated  # without a running number of all files
    parts: list[dict[str, str]] = [{} for _ in files]
    numbers: list[set[str]] = []
    notes = []
    for n in varying:
        is_word = not all(part.isdecimal() for part in columns[n])
        word = "" if is_word or not n else re.sub(".*[a-z](?=[A-Z])", "", tokens[0][n - 1])
        option = "channel" if is_word else _OPTIONS.get(word.casefold(), "slice")
        if option == "slice":
            word = " " if numbers else ""
            numbers.append({*columns[n]})
        for part, row in zip(parts, tokens, strict=True):
            part[option] = part.get(option, "") + word + row[n]
    if len(numbers) > 1 and math.prod(map(len, numbers)) == len({p["slice"] for p in parts}):
        notes.append(
            "several numbers vary in its names, but all files are read as one stack; if they are "
            "several, move each to a folder of its own"
        )
    if not numbers and "time" in parts[0] and "channel" in parts[0]:
        parts = [{"slice": part["time"], "channel": part["channel"]} for part in parts]
        notes.append("the points in time in its names are read as slices")
    total = math.prod(len({part[option] for part in parts}) for option in parts[0])
    is_grid = len({tuple(part.values()) for part in parts}) == len(files) > total / 2
    if "slice" in parts[0] and is_grid:
        return parts, notes
    return [{"slice": path.name} for path in files], notes


def _read_files(
    files: Sequence[Path], shape: tuple[int, ...], sample: int, numbers: Sequence[int]
) -> NDArray[Any]:
    """Read (Z, Y, X) from some of the files, which must have the first one's size."""

    def read(number: int) -> NDArray[Any]:
        values, _ = _read_picture(files[number])
        if values.shape != shape:
            raise VolumeError(
                f"{files[number]}: is {_size(values.shape)}, the first slice {_size(shape)}; "
                "remove what is not a slice, or make all the same size",
                code="shape",
            )
        return values if values.ndim == 2 else values[..., sample]

    return stack_slices(numbers, read)


def _size(shape: tuple[int, ...]) -> str:
    channels = f" of {shape[2]} channels" if len(shape) > 2 else ""
    return f"{shape[1]}x{shape[0]}{channels}"


def _read_picture(path: Path) -> tuple[NDArray[Any], Spacing]:
    """Read (Y, X) or (Y, X, S) and the stated spacing from one file."""
    with picture_errors(path):
        if not path.name.lower().endswith(PICTURES["TIFF"]):
            return picture_values(path), (None, None, None)
        from tifffile import TiffFile

        with TiffFile(path) as tiff:
            page = tiff.pages[0]
            if (pages := len(tiff.pages) * page.imagedepth) > 1:
                raise VolumeError(
                    f"{path}: holds {pages} pages, and its folder has other files; give a file of "
                    "several pages itself, or a folder of single ones",
                    code="conflict",
                )
            values = page_values(page)
            if page.axes.startswith(_SAMPLES):  # a plane per colour
                values = np.moveaxis(values, 0, -1)
            return values, stated_spacing_mm(tiff, page)
