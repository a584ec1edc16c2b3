"""DICOM series, read with pydicom: choice of a series, and its slices as a volume or as labels.

    folder, or one file of it -> dicom_headers -> Slice, ... -> [dicom] -> Reading

Slices are files of one frame each, or the frames of a file. The lattice is made of their positions
in the patient (LPS): none is missing without a word, and slices of a tilted gantry stay where they
were taken.

References
----------
[1] DICOM PS3.3, C.7.6.2 Image Plane Module, C.7.6.16.2 Plane Position: positions of slices.
[2] DICOM PS3.3, C.8.20 Segmentation: segments of a file, each with frames of its own.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError
from volspec.volume.files.dicom_frames import Slice, read_values
from volspec.volume.files.dicom_headers import dicom_files, headers
from volspec.volume.files.lattice import (
    affine,
    group_slices,
    slice_step_mm,
    spacing_text,
    stack_slices,
    unevenness,
)
from volspec.volume.files.query import Choice, Query, Reading
from volspec.volume.metadata import Metadata

# Patient, study, series.
_LEVELS = 3
# Most series that an error lists.
_MAX_LISTED = 8
# Fraction of the slices' distance by which a segment's frames may be off it.
_JITTER = 0.1


def series_folders(folder: Path) -> list[Path]:
    """Return the folder itself if it holds DICOM files, else the nearest folders below that do."""
    level = [folder]
    for _ in range(_LEVELS + 1):
        if found := [each for each in level if dicom_files(each)]:
            return found
        below = [path for each in level for path in sorted(each.iterdir()) if path.is_dir()]
        level = [path for path in below if not path.name.startswith(".")]
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


def _requested_series(query: Query, remarks: list[str]) -> list[Slice]:
    """Return the slices of the series that the query selects, each once."""
    path, is_folder = query.path, query.path.is_dir()
    query.allow(*(("series", "time") if is_folder else ("time",)))
    own = [] if is_folder else headers([path])
    if own and own[0].file.frames > 1 and not own[0].file.texts["ConcatenationUID"]:
        return own
    folders = series_folders(path) if is_folder else [path.parent]
    files = [file for folder in folders for file in dicom_files(folder) if file != path]
    strangers: list[Path] = []
    found = own + headers(files, strangers)
    if not found:
        headers(strangers)  # raises the first one's error
        raise VolumeError(
            f"{path}: holds no DICOM pictures; give the folder of a series", code="not-found"
        )
    if strangers:
        count = len(strangers) + len({each.file.path for each in found})
        remarks.append(
            f"{path}: {len(strangers)} of {count} files left out, which cannot be read as DICOM "
            f"pictures, such as {strangers[0].name}"
        )
    every: dict[str, list[Slice]] = {}
    for each in sorted(found, key=_series_order):
        every.setdefault(each.file.texts["SeriesInstanceUID"], []).append(each)
    chosen = own[0].file.texts["SeriesInstanceUID"] if own else _choose_uid(every, query, remarks)
    # Copies of a file share its UID; a file without one is unique.
    series = every[chosen]
    originals = {each.file.texts["SOPInstanceUID"] or each.file.path: each.file for each in series}
    kept = set(originals.values())
    series = [each for each in series if each.file in kept]
    patients = {each.file.texts["PatientID"] or _patient_name(each): each.name for each in series}
    studies = {each.file.texts["StudyInstanceUID"]: each.name for each in series}
    # Some programs give every file a study of its own.
    if len(patients) > 1 or 1 < len(studies) < len(series):
        one, other, *_ = (patients if len(patients) > 1 else studies).values()
        raise VolumeError(
            f"{path}: {one} and {other} are of different patients or studies, though of one "
            "series; put each patient's files into a folder of their own",
            code="conflict",
        )
    names = {_patient_name(each): each.name for each in series}
    if len(names) > 1:
        one, other, *_ = names.values()
        remarks.append(
            f"{path}: {one} and {other} state the same Patient ID but different Patient's Names; "
            "are they of one patient?"
        )
    return series


def _patient_name(one: Slice) -> str:
    """Return the patient's name without case and empty components at its end."""
    return one.file.texts["PatientName"].rstrip("^ ").casefold()


def _series_order(one: Slice) -> tuple[int, str]:
    """Return a sort key of slices by their series' number, then its UID."""
    number, uid = one.file.texts["SeriesNumber"], one.file.texts["SeriesInstanceUID"]
    return int(number) if number.isdecimal() else 0, uid


def _choose_uid(every: Mapping[str, list[Slice]], query: Query, remarks: list[str]) -> str:
    """Return the UID of the only series that is a volume, or of the one that ``series=`` names."""
    stacked = {uid: each for uid, each in every.items() if len(every) == 1 or _is_volume(each)}
    given = query.options.get("series")
    listed = _series_choice(stacked, given)
    if query.choices is not None and len(stacked) > 1:
        query.choices.append(listed)
    meant = _named_series(stacked, given) or _named_series(every, given)
    if len(meant) == 1:
        if given is None and len(every) > 1:
            remarks.append(
                f"{query.path}: holds {len(every)} series; the only one whose slices stack is "
                f"read: {listed.names[0]}"
            )
        return meant[0]
    if not stacked:
        raise VolumeError(
            f"{query.path}: holds {len(every)} series, none of which has slices that stack, as "
            "single pictures and localizers have not; give the folder of a CT or MR series",
            code="shape",
        )
    query.end_choices()
    rows = [f"{value} {name}" for value, name in zip(listed.values, listed.names, strict=True)]
    more = f" and {len(rows) - _MAX_LISTED} more" if len(rows) > _MAX_LISTED else ""
    wrong = "" if given is None else f"series={given} names {len(meant) or 'none'} of them; "
    raise VolumeError(
        f"{query.path}: holds {len(stacked)} series; {wrong}name one as "
        f"{query.example(series=listed.values[0])}: {', '.join(rows[:_MAX_LISTED])}{more}",
        code="missing" if given is None else "unknown",
        given=given,
    )


def _named_series(every: Mapping[str, Sequence[Slice]], given: str | None) -> list[str]:
    """Return the UIDs of the series with a UID or number; all if none is given."""
    numbers = {uid: each[0].file.texts["SeriesNumber"] for uid, each in every.items()}
    return [uid for uid, number in numbers.items() if given in (None, uid, number)]


def _is_volume(series: Sequence[Slice]) -> bool:
    """Return True if a series has greyscale slices that stack."""
    stack = _stacks_of(series)[-1]
    if stack[0].components != 1 or len(stack) < 2:
        return False
    normal = stack[0].directions[:, 2]
    along = [float(each.origin_mm @ normal) for each in stack if each.origin_mm is not None]
    return len(along) < len(stack) or float(np.ptp(along)) > 0


def _series_choice(every: Mapping[str, Sequence[Slice]], given: str | None) -> Choice:
    """Return the choice of a series by its number, or by its UID if the number is not unique."""
    numbers = [each[0].file.texts["SeriesNumber"] for each in every.values()]
    values, names, chosen = [], [], None
    for (uid, slices), number in zip(every.items(), numbers, strict=True):
        file, (columns, rows) = slices[0].file, slices[0].size
        values.append(number if number and numbers.count(number) == 1 else uid)
        what = f"{file.texts['Modality']} {file.texts['SeriesDescription']!r}".strip()
        word = "slices" if file.frames == 1 else "frames"
        names.append(f"{what} ({len(slices)} {word} of {columns}x{rows})")
        if given in (uid, values[-1]):
            chosen = values[-1]
    return Choice("series", tuple(values), tuple(names), chosen)


def _read_stack(requested: list[Slice], query: Query, remarks: list[str]) -> Reading:
    """Read the largest stack of a series."""
    if any("MOSAIC" in each.file.texts["ImageType"] for each in requested):
        raise VolumeError(
            f"{query.path}: are Siemens mosaics (Image Type … MOSAIC), each a volume of tiles",
            f"dcm2niix unpacks them: dcm2niix -z y -o . {shlex.quote(str(query.path))}",
            code="unsupported",
        )
    stack = _largest_stack(requested, query, remarks)
    first, file = stack[0], stack[0].file
    if first.components != 1:
        raise VolumeError(
            f"{file.path}: holds {first.components} components per pixel (colour); a volume has "
            "one, give a series of greyscale pictures",
            code="shape",
        )
    guesses: dict[str, str] = {}  # reasons of what is assumed, unless the query has a spacing
    places = _places(stack, query)
    first = places[0][0]
    if file.segments is not None:
        values, step = _read_segments(places, query, remarks)
    else:
        stack = _at_one_time(places, query)
        first = stack[0]
        step = _step_mm(stack, query, guesses)
        itemsize = -(-file.layout["bits_allocated"] // 8)
        is_scaled = any(each.rescale != (1, 0) or each.file.modality_lut for each in stack)
        query.reserve((*first.size, len(stack)), max(itemsize, 4 if is_scaled else 1))
        with captured_output([]):
            values = stack_slices(stack, read_values)
        at = np.array([each.origin_mm for each in stack if each.origin_mm is not None])
        if query.spacing_mm is None and len(at) > 1 and (uneven := unevenness(at)):
            remarks.append(f"{query.path}: {uneven}")
    if first.origin_mm is not None and not first.in_patient:
        remarks.append(
            f"{query.path}: states no usable Image Orientation (Patient), which is two vectors at "
            "right angles; its slices are taken as axial"
        )
    y, x = first.pixel_mm or file.detector_mm or (1.0, 1.0)
    if not first.pixel_mm:
        but = f" ({x:g} × {y:g} mm are stated, but at the detector)" if file.detector_mm else ""
        guesses["pixels 1 mm apart"] = f"states no spacing of pixels, 1 mm is assumed{but}"
    if query.spacing_mm is not None:
        guesses = {}
    example = query.example(spacing=spacing_text(x, y, abs(first.apart_mm or 1)))
    for guess in guesses.values():
        remarks.append(f"{query.path}: {guess}; if that is wrong, give it in mm as in {example}")
    y, x = first.pixel_mm or (1.0, 1.0)
    columns = np.column_stack([first.directions[:, :2] * (x, y), step])
    origin = file.start_mm if first.origin_mm is None else first.origin_mm
    return Reading(
        values,
        world_from_index=affine(columns, np.zeros(3) if origin is None else origin),
        remarks=remarks,
        labels=file.segments,
        metadata=Metadata(file.texts["Modality"], file.unit, first.in_patient, tuple(guesses)),
    )


def _stacks_of(series: Sequence[Slice]) -> list[list[Slice]]:
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
    if len(many) > 1 and len({f.texts["ConcatenationUID"] or f.path for f in many.values()}) > 1:
        raise VolumeError(
            f"{query.path}: holds {len(many)} files of many frames, each a volume; give one of "
            f"them, such as {next(iter(many))}",
            code="conflict",
        )
    stacks = _stacks_of(series)
    *others, most = stacks
    if any(len(stack) > 1 for stack in others):
        counts = ", ".join(f"{len(s)} of {s[0].size[0]}x{s[0].size[1]}" for s in reversed(stacks))
        raise VolumeError(
            f"{query.path}: holds slices of {len(stacks)} sizes or orientations in one series "
            f"({counts})",
            _advice(most[0], "put each stack into a folder of its own"),
            code="conflict",
        )
    if others and len(most) < 2:
        raise VolumeError(
            f"{query.path}: the {len(series)} slices of its series differ in size or orientation, "
            "as a localizer's do, and do not stack; give another series",
            code="shape",
        )
    if others:
        what = "files" if most[0].file.frames == 1 else "frames"
        remarks.append(
            f"{query.path}: {len(others)} of {len(series)} {what} left out, of another size or "
            f"orientation, such as {others[0][0].name}"
        )
    return most


def _places(stack: list[Slice], query: Query) -> list[list[Slice]]:
    """Return the slices at each place, in order; those without positions by their numbers."""
    stack = sorted(stack, key=lambda each: (each.order, each.file.path.name))
    lost = [each for each in stack if each.origin_mm is None]
    if len(lost) == len(stack):
        return [[each] for each in stack]
    if lost:
        raise VolumeError(
            f"{query.path}: {lost[0].name} states no position in the patient, but others of its "
            "series do",
            _advice(lost[0], "take it out of the folder"),
            code="conflict",
        )
    groups = group_slices(np.array([each.origin_mm for each in stack]), stack[0].directions[:, 2])
    if len(groups) == 1 < len(stack):
        raise VolumeError(
            f"{query.path}: all {len(stack)} slices lie at the same place; a volume needs slices "
            "at two places or more",
            code="duplicate",
        )
    return [[stack[k] for k in group] for group in groups]


def _at_one_time(places: list[list[Slice]], query: Query) -> list[Slice]:
    """Return one slice for each place, of the time that the query selects."""
    times = len(places[0])
    if any(len(place) != times for place in places):
        one, other, *_ = max(places, key=len)
        raise VolumeError(
            f"{query.path}: {one.name} and {other.name} lie at the same place, and other places "
            "have more or fewer slices",
            _advice(one, "leave one of each in the folder"),
            code="duplicate",
        )
    chosen = query.index("time", times, "time steps, echoes or the like at every place")
    query.end_choices()
    return [place[chosen] for place in places]


def _step_mm(stack: list[Slice], query: Query, guesses: dict[str, str]) -> NDArray[np.float64]:
    """Return the (3,) step from slice to slice."""
    first = stack[0]
    if len(stack) == 1:
        return first.directions[:, 2] * (first.apart_mm or 0.0)
    if first.origin_mm is None:
        apart = first.apart_mm or 1.0
        what = (
            "the slices state no positions; they are ordered by number,"
            if first.file.frames == 1
            else f"its {len(stack)} frames are read as slices"
        )
        guesses[f"slices {abs(apart):g} mm apart"] = f"{what} {abs(apart):g} mm apart"
        return first.directions[:, 2] * apart
    at = np.array([each.origin_mm for each in stack])
    y, x = first.pixel_mm or (1.0, 1.0)
    return slice_step_mm(at, [each.name for each in stack], query, (x, y))


def _read_segments(
    places: list[list[Slice]], query: Query, remarks: list[str]
) -> tuple[NDArray[Any], NDArray[np.float64]]:
    """Read a segmentation as a label map, in which frames without a segment may be left out.

    Of overlapping segments the last is read; fractions are from one half on. Returns the step of
    the slices, too.
    """
    query.index("time", 1, "time steps")
    first = places[0][0]
    if first.origin_mm is None:
        raise VolumeError(
            f"{query.path}: its segments state no positions; a volume needs slices at two places "
            "or more",
            code="shape",
        )
    query.end_choices()
    at = np.array([place[0].origin_mm for place in places])
    if len(at) == 1:
        number, step = np.zeros(1), first.directions[:, 2] * (first.apart_mm or 0.0)
    else:
        apart = np.linalg.norm(at - at[0], axis=1)
        usual = np.diff(apart)
        number = np.rint(apart / np.median(usual[usual < 1.5 * usual.min()]))
        step = (at[-1] - at[0]) / number[-1]
    if np.abs(at[0] + number[:, None] * step - at).max() > _JITTER * np.linalg.norm(step):
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
        for each in sorted(place, key=lambda one: one.segment):
            frame = read_values(each)
            mask = frame >= each.file.half
            overlap += int(np.count_nonzero(values[z][mask]))
            values[z][mask] = each.segment or frame[mask]
    if overlap:
        remarks.append(f"{query.path}: its segments overlap in {overlap} voxels; the last is read")
    if first.file.half > 1:
        remarks.append(f"{query.path}: holds fractions; read as segments from one half on")
    return values, step
