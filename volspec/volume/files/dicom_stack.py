"""Stack of DICOM slices as a volume, or as labels: order, lattice and values.

    Slice, ... -> [dicom_stack] -> Reading

Rescale slope and intercept are applied slice by slice (Hounsfield units, PET). Positions and
directions are the patient's (LPS). The lattice is made of the slices' positions: none is missing
without a word, and slices of a tilted gantry stay where they were taken.

References
----------
[1] DICOM PS3.3, C.7.6.2 Image Plane Module, C.7.6.16.2 Plane Position: positions of slices.
[2] DICOM PS3.3, C.8.20 Segmentation: segments of a file, each with frames of its own.
"""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError
from volspec.volume.files.dicom_frames import Slice, read_values
from volspec.volume.files.lattice import (
    affine,
    group_slices,
    slice_step_mm,
    spacing_text,
    stack_slices,
    unevenness,
)
from volspec.volume.files.query import Query, Reading
from volspec.volume.metadata import Metadata

# Key of a remark on slices that are not even, which are not assumed to be.
_UNEVEN = "uneven"
# Fraction of the slices' distance by which a segment's frames may be off it.
_JITTER = 0.1


def read_stack(requested: list[Slice], query: Query, remarks: list[str]) -> Reading:
    """Read the largest stack of a series."""
    if any("MOSAIC" in each.file.image_type for each in requested):
        raise VolumeError(
            f"{query.path}: are Siemens mosaics (Image Type … MOSAIC), each a volume of tiles",
            f"dcm2niix unpacks them: dcm2niix -z y -o . {shlex.quote(str(query.path))}",
            code="unsupported",
        )
    stack = _largest_stack(requested, query, remarks)
    first = stack[0]
    if first.components != 1:
        raise VolumeError(
            f"{first.file.path}: holds {first.components} components per pixel (colour); a "
            "volume has one, give a series of greyscale pictures",
            code="shape",
        )
    guesses: dict[str, str] = {}  # remarks by what is assumed; dropped if the query states it
    if first.file.segments is not None:
        values, world = _read_segments(stack, query, remarks)
    else:
        stack = _sorted_slices(stack, query)
        query.end_choices()
        world = _lattice(stack, query, guesses)
        itemsize = -(-first.file.layout["bits_allocated"] // 8)
        is_scaled = any(each.rescale != (1, 0) for each in stack)
        query.reserve((*first.size, len(stack)), max(itemsize, 4 if is_scaled else 1))
        with captured_output([]):
            values = stack_slices(stack, read_values)
    if not first.pixel_mm:
        guesses["pixels 1 mm apart"] = _no_spacing(first, query)
    if query.spacing_mm is not None:
        guesses = {}
    file, assumed = first.file, tuple(each for each in guesses if each != _UNEVEN)
    return Reading(
        values,
        world_from_index=world,
        remarks=[*remarks, *guesses.values()],
        labels=file.segments,
        metadata=Metadata(file.modality, file.unit, first.in_patient, assumed),
    )


def stacks_of(series: Sequence[Slice]) -> list[list[Slice]]:
    """Group slices by size and orientation, the largest group last."""
    stacks: list[list[Slice]] = []
    for each in series:
        for stack in stacks:
            if each.fits_stack(stack[0]):
                stack.append(each)
                break
        else:
            stacks.append([each])
    return sorted(stacks, key=len)


def _advice(one: Slice, for_files: str) -> str:
    """Return a remedy for the files of a folder, or for the frames of one file."""
    path = shlex.quote(str(one.file.path))
    return for_files if one.file.frames == 1 else f"split it into volumes: dcm2niix -s y {path}"


def _largest_stack(series: list[Slice], query: Query, remarks: list[str]) -> list[Slice]:
    """Return the slices of one size and orientation, leaving out single others such as a scout."""
    many = {each.file.path: each.file for each in series if each.file.frames > 1}
    if len(many) > 1 and len({file.concatenation or path for path, file in many.items()}) > 1:
        raise VolumeError(
            f"{query.path}: holds {len(many)} files of many frames, each a volume; give one of "
            f"them, such as {next(iter(many))}",
            code="conflict",
        )
    stacks = stacks_of(series)
    *others, most = stacks
    if any(len(stack) > 1 for stack in others):
        counts = ", ".join(f"{len(s)} of {s[0].size[0]}x{s[0].size[1]}" for s in reversed(stacks))
        raise VolumeError(
            f"{query.path}: holds slices of {len(stacks)} sizes or orientations in one series "
            f"({counts})",
            _advice(most[0], "put each stack into a folder of its own"),
            code="conflict",
        )
    if len(most) < 2:
        columns, rows = most[0].size
        if others:
            raise VolumeError(
                f"{query.path}: the {len(series)} slices of its series differ in size or "
                "orientation, as a localizer's do, and do not stack; give another series",
                code="shape",
            )
        raise VolumeError(
            f"{query.path}: a single slice ({columns}x{rows}) is not a volume; give the folder "
            "that holds all slices of the series",
            code="shape",
        )
    if others:
        what = "files" if most[0].file.frames == 1 else "frames"
        remarks.append(
            f"{query.path}: {len(others)} of {len(series)} {what} left out, of another size or "
            f"orientation, such as {others[0][0].name}"
        )
    return most


def _sorted_slices(stack: list[Slice], query: Query) -> list[Slice]:
    """Return one slice for each position in order; slices without positions by their numbers."""
    stack = sorted(stack, key=lambda each: (each.order, each.file.path.name))
    if not _are_placed(stack, query):
        query.index("time", 1, "time steps")
        return stack
    places = group_slices(np.array([each.origin_mm for each in stack]), stack[0].directions[:, 2])
    times = len(places[0])
    if any(len(place) != times for place in places):
        a, b, *_ = next(place for place in places if len(place) > 1)
        raise VolumeError(
            f"{query.path}: {stack[a].name} and {stack[b].name} lie at the same place, "
            "and other places have more or fewer slices",
            _advice(stack[a], "leave one of each in the folder"),
            code="duplicate",
        )
    if len(places) == 1:
        raise VolumeError(
            f"{query.path}: all {times} slices lie at the same place; a volume needs slices at two "
            "places or more",
            code="duplicate",
        )
    chosen = query.index("time", times, "time steps, echoes or the like at every place")
    return [stack[place[chosen]] for place in places]


def _are_placed(stack: list[Slice], query: Query) -> bool:
    """Return True if all slices have positions, False if none has; refuse others."""
    lost = [each for each in stack if each.origin_mm is None]
    if lost and len(lost) < len(stack):
        raise VolumeError(
            f"{query.path}: {lost[0].name} states no position in the patient, but others of its "
            "series do",
            _advice(lost[0], "take it out of the folder"),
            code="conflict",
        )
    return not lost


def _no_spacing(first: Slice, query: Query) -> str:
    """Return a remark on pixels of unknown size, with that at the detector as an example."""
    y, x = first.file.detector_mm or (1.0, 1.0)
    at = f" ({x:g} × {y:g} mm are stated, but at the detector)" if first.file.detector_mm else ""
    return (
        f"{query.path}: states no spacing of pixels, 1 mm is assumed{at}; if that is wrong, give "
        f"it in mm as in {query.example(spacing=spacing_text(x, y, abs(first.apart_mm or 1)))}"
    )


def _lattice(stack: list[Slice], query: Query, guesses: dict[str, str]) -> NDArray[np.float64]:
    """Return world_from_index of slices in order."""
    first = stack[0]
    y, x = first.pixel_mm or (1.0, 1.0)
    if first.origin_mm is not None:
        at = np.array([each.origin_mm for each in stack])
        step = slice_step_mm(at, [each.name for each in stack], query, (x, y))
        if uneven := unevenness(at):
            guesses[_UNEVEN] = f"{query.path}: {uneven}"
        return _world(first, at[0], step)
    apart = first.apart_mm or 1.0
    what = (
        "the slices state no positions; they are ordered by number,"
        if first.file.frames == 1
        else f"its {len(stack)} frames are read as slices"
    )
    guesses[f"slices {abs(apart):g} mm apart"] = (
        f"{query.path}: {what} {abs(apart):g} mm apart; if that is wrong, give the distance as in "
        f"{query.example(spacing=spacing_text(x, y, abs(apart)))}"
    )
    start = np.zeros(3) if first.file.start_mm is None else first.file.start_mm
    return _world(first, start, first.directions[:, 2] * apart)


def _world(
    first: Slice, origin: NDArray[np.float64], step: NDArray[np.float64]
) -> NDArray[np.float64]:
    y, x = first.pixel_mm or (1.0, 1.0)
    return affine(np.column_stack([first.directions[:, :2] * (x, y), step]), origin)


def _read_segments(
    stack: list[Slice], query: Query, remarks: list[str]
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Read a segmentation as a label map, in which frames without a segment may be left out.

    Of overlapping segments the last is read; fractions are from one half on.
    """
    query.index("time", 1, "time steps")
    first, is_placed = stack[0], _are_placed(stack, query)
    at = np.array([each.origin_mm for each in stack])
    places = group_slices(at, first.directions[:, 2]) if is_placed else []
    if len(places) < 2:
        raise VolumeError(
            f"{query.path}: its segments state no two positions; a volume needs slices at two "
            "places or more",
            code="shape",
        )
    query.end_choices()
    starts = at[[place[0] for place in places]]
    apart = np.linalg.norm(starts - starts[0], axis=1)
    usual = np.diff(apart)
    number = np.rint(apart / np.median(usual[usual < 1.5 * usual.min()]))
    step = (starts[-1] - starts[0]) / number[-1]
    if np.abs(starts[0] + number[:, None] * step - starts).max() > _JITTER * np.linalg.norm(step):
        raise VolumeError(
            f"{query.path}: its segments lie on slices at uneven distances; resample it to a "
            "regular grid, such as with 3D Slicer",
            code="conflict",
        )
    largest = max(first.file.segments or (), default=0)
    dtype = np.dtype(np.uint8 if largest < 256 else np.uint16)
    shape = (int(number[-1]) + 1, *first.size[::-1])
    query.reserve(shape, dtype.itemsize)
    values, overlap = np.zeros(shape, dtype), 0
    for place, z in zip(places, number.astype(int), strict=True):
        for each in sorted((stack[k] for k in place), key=lambda one: one.segment):
            frame = read_values(each)
            mask = frame >= each.file.half
            overlap += int(np.count_nonzero(values[z][mask]))
            values[z][mask] = each.segment or frame[mask]
    if overlap:
        remarks.append(f"{query.path}: its segments overlap in {overlap} voxels; the last is read")
    if first.file.half > 1:
        remarks.append(f"{query.path}: holds fractions; read as segments from one half on")
    return values, _world(first, starts[0], step)
