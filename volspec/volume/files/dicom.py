"""DICOM series through SimpleITK (GDCM): which slices belong together, in which order, and where.

    folder, or one file of it -> headers -> [dicom] -> Reading

Rescale slope and intercept are applied slice by slice (Hounsfield units, PET). Positions and
directions are the patient's (LPS). ITK's own reader of series gives every stack the mean distance
of its slices and right angles, whatever lacks or was tilted: hence the lattice is made here.

References
----------
[1] DICOM PS3.3, C.7.6.2 Image Plane Module: positions and orientations of slices.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError
from volspec.volume.files.dicom_headers import Series, Slice, dicom_files, headers
from volspec.volume.files.itk import complaint
from volspec.volume.files.lattice import Places, affine, step_mm, unevenness
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.stacking import stacked

# Values (Z, Y, X), and world_from_index (4, 4).
_Placed = tuple[NDArray[Any], NDArray[np.float64]]
# Patient, study, series.
_LEVELS = 3
# Series that one line lists.
_MOST_LISTED = 8


def series_folders(folder: Path) -> list[Path]:
    """The folder itself where it holds DICOM files, else those nearest below it that do."""
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
    """Read a folder's series, or the one that a file belongs to.

    Raises
    ------
    VolumeError
        If it is not clear which series is meant, a file is damaged, slices are missing or lie at
        the same places, or the pictures are in colour.
    """
    remarks: list[str] = []
    guesses: list[str] = []  # of the distance of slices: done without where it is given
    series = _one_stack(_asked_for(query), query, remarks)
    if series[0].components != 1:
        raise VolumeError(
            f"{series[0].path}: holds {series[0].components} components a pixel (colour); a volume "
            "has one, give a series of grey pictures"
        )
    if series[0].size[2] > 1:
        query.index("time", 1, "time steps")
        query.reserve(series[0].size, series[0].itemsize)
        values, world = _frames(series[0], guesses)
    else:
        values, world = _slices(_one_time(series, query), query, guesses)
    if query.spacing_mm is None:
        remarks += guesses
    return Reading(values, world_from_index=world, remarks=remarks)


def _asked_for(query: Query) -> list[Slice]:
    """The series that is meant, each slice once."""
    path = query.path
    query.allow(*(("series",) if path.is_dir() else ()), "time", "spacing")
    folders = series_folders(path) if path.is_dir() else [path.parent]
    own = None if path.is_dir() else headers([path])
    if own and own[0].size[2] > 1:
        return own
    found = headers([file for folder in folders for file in dicom_files(folder)])
    if not found or own == []:
        raise VolumeError(f"{path}: holds no DICOM pictures; give the folder of a series")
    if own:
        chosen = own[0].series.uid
        found = [*own, *(each for each in found if each.path != path)]
    else:
        chosen = _chosen(found, query)
    # Copies of a file have its UID; without one a file is itself.
    unique = {each.uid or each.path: each for each in found if each.series.uid == chosen}
    return list(unique.values())


def _chosen(found: list[Slice], query: Query) -> str:
    """The UID of the only series, or of the one that ``series=`` names."""
    kinds: dict[str, list[Slice]] = {}
    for each in found:
        kinds.setdefault(each.series.uid, []).append(each)
    given = query.options.get("series")
    meant = [uid for uid, (one, *_) in kinds.items() if given in (None, uid, one.series.number)]
    if len(meant) == 1:
        return meant[0]
    numbers = [each[0].series.number for each in kinds.values()]
    rows = []
    for one, *others in sorted(kinds.values(), key=lambda each: _order(each[0].series)):
        number = one.series.number
        name = number if number and numbers.count(number) == 1 else one.series.uid
        columns, height, frames = one.size
        slices = f"{len(others) + 1} slices" if frames == 1 else f"{frames} frames"
        rows.append(f"{name} {one.series.description!r} ({slices} of {columns}x{height})")
    more = f" and {len(rows) - _MOST_LISTED} more" if len(rows) > _MOST_LISTED else ""
    wrong = "" if given is None else f"series={given} names {len(meant) or 'none'} of them; "
    raise VolumeError(
        f"{query.path}: holds {len(kinds)} series; {wrong}name one as {query.name}?series="
        f"{rows[0].split(' ')[0]}: {', '.join(rows[:_MOST_LISTED])}{more}"
    )


def _order(series: Series) -> tuple[int, str]:
    number = series.number
    return (int(number) if number.isdecimal() else 0, series.uid)


def _one_stack(series: list[Slice], query: Query, remarks: list[str]) -> list[Slice]:
    """The slices of one size and orientation; single others, such as a scout, are left out."""
    stacks: list[list[Slice]] = []
    for each in series:
        for stack in stacks:
            if each.lies_like(stack[0]):
                stack.append(each)
                break
        else:
            stacks.append([each])
    frames = [each for each in series if each.size[2] > 1]
    if len(frames) > 1:
        raise VolumeError(
            f"{query.path}: holds {len(frames)} files of many frames, each a volume; give one of "
            f"them, as {frames[0].path}",
            code="conflict",
        )
    stacks.sort(key=lambda stack: len(stack) * stack[0].size[2])
    *others, most = stacks
    if any(len(stack) > 1 for stack in others):
        told = ", ".join(f"{len(s)} of {s[0].size[0]}x{s[0].size[1]}" for s in reversed(stacks))
        raise VolumeError(
            f"{query.path}: holds slices of {len(stacks)} sizes or orientations in one series "
            f"({told}); put each stack into a folder of its own"
        )
    if len(most) * most[0].size[2] < 2:
        columns, rows, _ = most[0].size
        raise VolumeError(
            f"{query.path}: a single slice ({columns}x{rows}) is no volume; give the folder that "
            "holds all slices of the series"
        )
    if others:
        first = others[0][0].path.name
        remarks.append(
            f"{query.path}: {len(others)} of {len(series)} files left out, of another size or "
            f"orientation, such as {first}"
        )
    return most


def _one_time(series: list[Slice], query: Query) -> list[Slice]:
    """One slice a place, in the order of the places; of those without places by their numbers."""
    series = sorted(series, key=lambda each: (each.number, each.path.name))
    lost = next((each for each in series if not each.placed), None)
    if lost is not None:
        if any(each.placed for each in series):
            raise VolumeError(
                f"{lost.path}: states no position in the patient, others of its series do; take "
                "it out of the folder"
            )
        query.index("time", 1, "time steps")
        return series
    at = np.array([each.origin_mm for each in series])
    stacks = Places(at, series[0].directions[:, 2]).stacks()
    times = len(stacks[0])
    if any(len(stack) != times for stack in stacks):
        a, b, *_ = next(stack for stack in stacks if len(stack) > 1)
        raise VolumeError(
            f"{query.path}: {series[a].path.name} and {series[b].path.name} lie at the same place, "
            "and not all slices are there as often; leave one of each in the folder"
        )
    if len(stacks) == 1:
        raise VolumeError(
            f"{query.path}: all {times} slices lie at the same place; a volume has slices at two "
            "places or more"
        )
    chosen = query.index("time", times, "time steps, echoes or the like at every place")
    return [series[stack[chosen]] for stack in stacks]


def _slices(series: list[Slice], query: Query, guesses: list[str]) -> _Placed:
    first = series[0]
    x, y, _ = first.spacing_mm
    directions = first.directions
    if not first.placed:
        apart = first.thickness_mm or 1.0
        origin, step = np.zeros(3), directions[:, 2] * apart
        guesses.append(
            f"{query.path}: the slices state no positions; taken in the order of their numbers, "
            f"{apart:g} mm apart; give {query.name}?spacing=x,y,z where that is wrong"
        )
    else:
        at = np.array([each.origin_mm for each in series])
        origin, step = at[0], step_mm(at, [each.path.name for each in series], query)
        if uneven := unevenness(at):
            guesses.append(f"{query.path}: {uneven}")
    query.reserve((*first.size, len(series)), first.itemsize)
    with captured_output([]):
        values = stacked(series, _pixels)
    columns = np.column_stack([directions[:, 0] * x, directions[:, 1] * y, step])
    return values, affine(columns, origin)


def _frames(file: Slice, guesses: list[str]) -> _Placed:
    """One file of many frames: an enhanced CT or MR, or a film."""
    with captured_output([]):
        values = _picture(file)
    z = file.spacing_mm[2]
    guesses.append(
        f"{file.path}: its {file.size[2]} frames are taken for slices {z:g} mm apart; give "
        f"{file.path.name}?spacing=x,y,z where that is wrong"
    )
    columns = file.directions * np.array(file.spacing_mm)
    return values, affine(columns, file.origin_mm)


def _pixels(file: Slice) -> NDArray[Any]:
    """One slice, (Y, X)."""
    values: NDArray[Any] = _picture(file)[0]
    # Rescaled 16-bit pixels come as 32-bit ones; most fit again.
    if values.dtype == np.int32 and values.min() >= -(2**15) and values.max() < 2**15:
        return values.astype(np.int16)
    return values


def _picture(file: Slice) -> NDArray[Any]:
    """(Z, Y, X) of a file, rescaled."""
    import SimpleITK as sitk

    try:
        image = sitk.ReadImage(os.fspath(file.path), imageIO="GDCMImageIO")
    except RuntimeError as error:
        raise VolumeError(
            f"{file.path}: cannot be read ({complaint(error, [])}); damaged, or compressed in "
            "a way that GDCM does not know",
            code="damaged",
        ) from error
    values: NDArray[Any] = sitk.GetArrayFromImage(image)
    return values
