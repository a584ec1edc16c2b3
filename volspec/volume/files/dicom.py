"""DICOM series, read with SimpleITK (GDCM): choice, order and lattice of the slices.

    folder, or one file of it -> headers -> [dicom] -> Reading

Rescale slope and intercept are applied slice by slice (Hounsfield units, PET). Positions and
directions are the patient's (LPS). ITK's own series reader gives every stack right angles and the
mean distance between slices, even if slices are missing or tilted; hence the lattice is built here.

References
----------
[1] DICOM PS3.3, C.7.6.2 Image Plane Module: positions and orientations of slices.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError
from volspec.volume.files.dicom_headers import (
    Series,
    Slice,
    describe_without_pictures,
    dicom_files,
    headers,
)
from volspec.volume.files.itk import itk_message
from volspec.volume.files.lattice import (
    affine,
    group_slices,
    slice_step_mm,
    spacing_text,
    stack_slices,
    unevenness,
)
from volspec.volume.files.query import Choice, Query, Reading

# Values (Z, Y, X), and world_from_index (4, 4).
_Placed = tuple[NDArray[Any], NDArray[np.float64]]
# Patient, study, series.
_LEVELS = 3
# Most series that an error lists.
_MOST_LISTED = 8


def series_folders(folder: Path) -> list[Path]:
    """Return the folder itself if it holds DICOM files, else the nearest folders below that do."""
    level = [folder]
    for _ in range(_LEVELS + 1):
        if found := [each for each in level if dicom_files(each)]:
            return found
        level = [
            below
            for each in level
            for below in sorted(each.iterdir())
            if below.is_dir() and not below.name.startswith(".")
        ]
    return []


def read_series(query: Query) -> Reading:
    """Read a folder's series, or the series that a file belongs to."""
    remarks: list[str] = []
    requested = _requested_series(query, remarks)
    try:
        return _read_stack(requested, query, remarks)
    except VolumeError as error:
        if not remarks:
            raise
        # Files that were left out may be the slices that are missing.
        left_out = remarks[0].removeprefix(f"{query.path}: ")
        problem = f"{error.problem} ({left_out})"
        raise VolumeError(problem, error.remedy, code=error.code, given=error.given) from error


def _read_stack(requested: list[Slice], query: Query, remarks: list[str]) -> Reading:
    """Read the largest stack of a series."""
    guesses: list[str] = []  # about the slices' distance; dropped if the query states it
    series = _largest_stack(requested, query, remarks)
    if series[0].components != 1:
        raise VolumeError(
            f"{series[0].path}: holds {series[0].components} components per pixel (colour); a "
            "volume has one, give a series of greyscale pictures",
            code="shape",
        )
    if series[0].size[2] > 1:
        query.index("time", 1, "time steps")
        query.end_choices()
        query.reserve(series[0].size, series[0].itemsize)
        values, world = _read_frames(series[0], query, guesses)
    else:
        ordered = _sorted_slices(series, query)
        query.end_choices()
        values, world = _read_slices(ordered, query, guesses)
    if query.spacing_mm is None:
        remarks += guesses
    return Reading(values, world_from_index=world, remarks=remarks)


def _requested_series(query: Query, remarks: list[str]) -> list[Slice]:
    """Return the series that the query selects, each slice once."""
    path = query.path
    query.allow(*(("series",) if path.is_dir() else ()), "time", "spacing")
    folders = series_folders(path) if path.is_dir() else [path.parent]
    own = None if path.is_dir() else headers([path])
    if own == []:
        raise VolumeError(
            f"{path}: is {describe_without_pictures(path)}, not a picture; give a slice of an "
            "image series, or its folder",
            code="not-found",
        )
    if own and own[0].size[2] > 1:
        return own
    strangers: list[Path] = []
    found = headers([file for folder in folders for file in dicom_files(folder)], strangers)
    if strangers and not found:
        headers(strangers)  # raises the first one's error
    if not found:
        raise VolumeError(
            f"{path}: holds no DICOM pictures; give the folder of a series", code="not-found"
        )
    if strangers:
        remarks.append(
            f"{path}: {len(strangers)} of {len(strangers) + len(found)} files left out, which "
            f"cannot be read as DICOM pictures, such as {strangers[0].name}"
        )
    if own:
        chosen = own[0].series.uid
        found = [*own, *(each for each in found if each.path != path)]
    else:
        chosen = _choose_uid(found, query, remarks)
    # Copies of a file share its UID; a file without one is unique.
    unique = {each.uid or each.path: each for each in found if each.series.uid == chosen}
    return list(unique.values())


def _choose_uid(found: list[Slice], query: Query, remarks: list[str]) -> str:
    """Return the UID of the only series that is a volume, or of the one that ``series=`` names."""
    kinds: dict[str, list[Slice]] = {}
    for each in found:
        kinds.setdefault(each.series.uid, []).append(each)
    stacked = {uid: each for uid, each in kinds.items() if len(kinds) == 1 or _is_volume(each)}
    given = query.options.get("series")
    if query.choices is not None and len(stacked) > 1:
        query.choices.append(_series_choice(stacked, given))
    meant = _named_series(stacked, given) or (_named_series(kinds, given) if given else [])
    if len(meant) == 1:
        if given is None and len(kinds) > 1:
            (name,) = _series_choice({meant[0]: kinds[meant[0]]}, None).names
            remarks.append(
                f"{query.path}: holds {len(kinds)} series; the only one whose slices stack is "
                f"read: {name}"
            )
        return meant[0]
    if not stacked:
        raise VolumeError(
            f"{query.path}: holds {len(kinds)} series, none of which has slices that stack, as "
            "single pictures and localizers have not; give the folder of a CT or MR series",
            code="shape",
        )
    query.end_choices()
    listed = _series_choice(stacked, given)
    rows = [f"{value} {name}" for value, name in zip(listed.values, listed.names, strict=True)]
    more = f" and {len(rows) - _MOST_LISTED} more" if len(rows) > _MOST_LISTED else ""
    wrong = "" if given is None else f"series={given} names {len(meant) or 'none'} of them; "
    raise VolumeError(
        f"{query.path}: holds {len(stacked)} series; {wrong}name one as "
        f"{query.example(series=listed.values[0])}: {', '.join(rows[:_MOST_LISTED])}{more}",
        code="missing" if given is None else "unknown",
        given=given,
    )


def _named_series(kinds: Mapping[str, Sequence[Slice]], given: str | None) -> list[str]:
    """Return the UIDs of the series with a UID or number; all if none is given."""
    return [uid for uid, (one, *_) in kinds.items() if given in (None, uid, one.series.number)]


def _is_volume(series: Sequence[Slice]) -> bool:
    """Return True if a series has a file of many frames, or greyscale slices that stack."""
    most = _stacks(series)[-1]
    first = most[0]
    if first.components != 1 or len(most) * first.size[2] < 2:
        return False
    along = [float(each.origin_mm @ first.directions[:, 2]) for each in most]
    return first.size[2] > 1 or not first.placed or float(np.ptp(along)) > 0


def _stacks(series: Sequence[Slice]) -> list[list[Slice]]:
    """Group slices by size and orientation, the largest group last."""
    stacks: list[list[Slice]] = []
    for each in series:
        for stack in stacks:
            if each.fits_stack(stack[0]):
                stack.append(each)
                break
        else:
            stacks.append([each])
    return sorted(stacks, key=lambda stack: len(stack) * stack[0].size[2])


def _series_choice(kinds: Mapping[str, Sequence[Slice]], given: str | None) -> Choice:
    """Return the choice of a series by its number, or by its UID if the number is not unique."""
    numbers = [each[0].series.number for each in kinds.values()]
    values, names, chosen = [], [], None
    for one, *others in sorted(kinds.values(), key=lambda each: _order(each[0].series)):
        series, (columns, height, frames) = one.series, one.size
        unique = series.number and numbers.count(series.number) == 1
        values.append(series.number if unique else series.uid)
        slices = f"{len(others) + 1} slices" if frames == 1 else f"{frames} frames"
        what = f"{series.modality} {series.description!r}".strip()
        names.append(f"{what} ({slices} of {columns}x{height})")
        if given in (series.uid, values[-1]):
            chosen = values[-1]
    return Choice("series", tuple(values), tuple(names), chosen)


def _order(series: Series) -> tuple[int, str]:
    number = series.number
    return (int(number) if number.isdecimal() else 0, series.uid)


def _largest_stack(series: list[Slice], query: Query, remarks: list[str]) -> list[Slice]:
    """Return the slices of one size and orientation, leaving out single others such as a scout."""
    frames = [each for each in series if each.size[2] > 1]
    if len(frames) > 1:
        raise VolumeError(
            f"{query.path}: holds {len(frames)} files of many frames, each a volume; give one of "
            f"them, such as {frames[0].path}",
            code="conflict",
        )
    stacks = _stacks(series)
    *others, most = stacks
    if any(len(stack) > 1 for stack in others):
        counts = ", ".join(f"{len(s)} of {s[0].size[0]}x{s[0].size[1]}" for s in reversed(stacks))
        raise VolumeError(
            f"{query.path}: holds slices of {len(stacks)} sizes or orientations in one series "
            f"({counts}); put each stack into a folder of its own",
            code="conflict",
        )
    if len(most) * most[0].size[2] < 2:
        columns, rows, _ = most[0].size
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
        first = others[0][0].path.name
        remarks.append(
            f"{query.path}: {len(others)} of {len(series)} files left out, of another size or "
            f"orientation, such as {first}"
        )
    return most


def _sorted_slices(series: list[Slice], query: Query) -> list[Slice]:
    """Return one slice for each position in order; slices without positions by their numbers."""
    series = sorted(series, key=lambda each: (each.number, each.path.name))
    lost = next((each for each in series if not each.placed), None)
    if lost is not None:
        if any(each.placed for each in series):
            raise VolumeError(
                f"{lost.path}: states no position in the patient, but others of its series do; "
                "take it out of the folder",
                code="conflict",
            )
        query.index("time", 1, "time steps")
        return series
    at = np.array([each.origin_mm for each in series])
    stacks = group_slices(at, series[0].directions[:, 2])
    times = len(stacks[0])
    if any(len(stack) != times for stack in stacks):
        a, b, *_ = next(stack for stack in stacks if len(stack) > 1)
        raise VolumeError(
            f"{query.path}: {series[a].path.name} and {series[b].path.name} lie at the same place, "
            "and other places have more or fewer slices; leave one of each in the folder",
            code="duplicate",
        )
    if len(stacks) == 1:
        raise VolumeError(
            f"{query.path}: all {times} slices lie at the same place; a volume needs slices at two "
            "places or more",
            code="duplicate",
        )
    chosen = query.index("time", times, "time steps, echoes or the like at every place")
    return [series[stack[chosen]] for stack in stacks]


def _read_slices(series: list[Slice], query: Query, guesses: list[str]) -> _Placed:
    """Read a file for each slice."""
    first = series[0]
    x, y, _ = first.spacing_mm
    directions = first.directions
    if not first.placed:
        apart = first.thickness_mm or 1.0
        origin, step = np.zeros(3), directions[:, 2] * apart
        guesses.append(
            f"{query.path}: the slices state no positions; they are ordered by number, "
            f"{apart:g} mm apart; if that is wrong, give the distance as in "
            f"{query.example(spacing=spacing_text(x, y, apart))}"
        )
    else:
        at = np.array([each.origin_mm for each in series])
        origin, step = at[0], slice_step_mm(at, [each.path.name for each in series], query, (x, y))
        if uneven := unevenness(at):
            guesses.append(f"{query.path}: {uneven}")
    query.reserve((*first.size, len(series)), first.itemsize)
    with captured_output([]):
        values = stack_slices(series, _read_slice)
    columns = np.column_stack([directions[:, 0] * x, directions[:, 1] * y, step])
    return values, affine(columns, origin)


def _read_frames(file: Slice, query: Query, guesses: list[str]) -> _Placed:
    """Read one file of many frames: an enhanced CT or MR, or a film."""
    x, y, z = file.spacing_mm
    with captured_output([]):
        values = _read_pixels(file)
    guesses.append(
        f"{file.path}: its {file.size[2]} frames are read as slices {abs(z):g} mm apart; if that "
        f"is wrong, give the distance as in {query.example(spacing=spacing_text(x, y, abs(z)))}"
    )
    columns = file.directions * np.array(file.spacing_mm)
    return values, affine(columns, file.origin_mm)


def _read_slice(file: Slice) -> NDArray[Any]:
    """Read one slice, (Y, X)."""
    values: NDArray[Any] = _read_pixels(file)[0]
    # Rescaled 16-bit pixels arrive as 32-bit values; most fit into 16 bits again.
    if values.dtype == np.int32 and values.min() >= -(2**15) and values.max() < 2**15:
        return values.astype(np.int16)
    return values


def _read_pixels(file: Slice) -> NDArray[Any]:
    """Read a file's rescaled values, (Z, Y, X)."""
    import SimpleITK as sitk

    try:
        image = sitk.ReadImage(os.fspath(file.path), imageIO="GDCMImageIO")
    except RuntimeError as error:
        raise VolumeError(
            f"{file.path}: its pixels cannot be read ({itk_message(error, [])})",
            "if it is damaged or truncated, copy it again or take it out of the folder; if it is "
            f"compressed, unpack it: gdcmconv --raw {shlex.quote(str(file.path))} raw.dcm",
            code="damaged",
        ) from error
    values: NDArray[Any] = sitk.GetArrayFromImage(image)
    return values if file.scale == 1 else (values * file.scale).astype(np.float32)
