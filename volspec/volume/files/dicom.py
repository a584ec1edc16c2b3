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
        if folders := [entry for entry in level if dicom_files(entry)]:
            return folders
        below = [path for entry in level for path in sorted(entry.iterdir()) if path.is_dir()]
        level = [path for path in below if not path.name.startswith(".")]
    return []


def read_series(query: Query) -> Reading:
    """Read a folder's series, or the series that a file belongs to."""
    notes: list[str] = []
    requested = _requested_series(query, notes)
    try:
        return _read_stack(requested, query, notes)
    except VolumeError as error:
        if not notes:
            raise
        # Files that were left out may be the slices that are missing.
        left_out = notes[0].removeprefix(f"{query.path}: ")
        problem = f"{error.problem} ({left_out})"
        raise VolumeError(problem, error.remedy, code=error.code, given=error.given) from error


def _requested_series(query: Query, notes: list[str]) -> list[Slice]:
    """Return the slices of the series that the query selects, each once."""
    path, is_folder = query.path, query.path.is_dir()
    query.allow(*(("series", "time") if is_folder else ("time",)))
    named = [] if is_folder else headers([path])
    if named and named[0].file.frames > 1 and not named[0].file.texts["ConcatenationUID"]:
        return named
    folders = series_folders(path) if is_folder else [path.parent]
    files = [file for folder in folders for file in dicom_files(folder) if file != path]
    strangers: list[Path] = []
    slices = named + headers(files, strangers)
    if not slices:
        headers(strangers)  # raises the first one's error
        raise VolumeError(
            f"{path}: holds no DICOM pictures; give the folder of a series", code="not-found"
        )
    if strangers:
        count = len(strangers) + len({s.file.path for s in slices})
        notes.append(
            f"{path}: {len(strangers)} of {count} files left out, which cannot be read as DICOM "
            f"pictures, such as {strangers[0].name}"
        )
    by_uid: dict[str, list[Slice]] = {}
    for slice_ in sorted(slices, key=_series_order):
        by_uid.setdefault(slice_.file.texts["SeriesInstanceUID"], []).append(slice_)
    uid = named[0].file.texts["SeriesInstanceUID"] if named else _choose_uid(by_uid, query, notes)
    # Copies of a file share its UID; a file without one is unique.
    series = by_uid[uid]
    originals = {s.file.texts["SOPInstanceUID"] or s.file.path: s.file for s in series}
    kept = set(originals.values())
    series = [s for s in series if s.file in kept]
    patients = {s.file.texts["PatientID"] or _patient_name(s): s.name for s in series}
    studies = {s.file.texts["StudyInstanceUID"]: s.name for s in series}
    # Some programs give every file a study of its own.
    if len(patients) > 1 or 1 < len(studies) < len(series):
        one, other, *_ = (patients if len(patients) > 1 else studies).values()
        raise VolumeError(
            f"{path}: {one} and {other} are of different patients or studies, though of one "
            "series; put each patient's files into a folder of their own",
            code="conflict",
        )
    names = {_patient_name(s): s.name for s in series}
    if len(names) > 1:
        one, other, *_ = names.values()
        notes.append(
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


def _choose_uid(by_uid: Mapping[str, list[Slice]], query: Query, notes: list[str]) -> str:
    """Return the UID of the only series that is a volume, or of the one that ``series=`` names."""
    stacked = {uid: stack for uid, stack in by_uid.items() if len(by_uid) == 1 or _is_volume(stack)}
    option = query.options.get("series")
    listed = _series_choice(stacked, option)
    if query.choices is not None and len(stacked) > 1:
        query.choices.append(listed)
    meant = _named_series(stacked, option) or _named_series(by_uid, option)
    if len(meant) == 1:
        if option is None and len(by_uid) > 1:
            notes.append(
                f"{query.path}: holds {len(by_uid)} series; the only one whose slices stack is "
                f"read: {listed.names[0]}"
            )
        return meant[0]
    if not stacked:
        raise VolumeError(
            f"{query.path}: holds {len(by_uid)} series, none of which has slices that stack, as "
            "single pictures and localizers have not; give the folder of a CT or MR series",
            code="shape",
        )
    query.end_choices()
    rows = [f"{value} {name}" for value, name in zip(listed.values, listed.names, strict=True)]
    more = f" and {len(rows) - _MAX_LISTED} more" if len(rows) > _MAX_LISTED else ""
    wrong = "" if option is None else f"series={option} names {len(meant) or 'none'} of them; "
    raise VolumeError(
        f"{query.path}: holds {len(stacked)} series; {wrong}name one as "
        f"{query.example(series=listed.values[0])}: {', '.join(rows[:_MAX_LISTED])}{more}",
        code="missing" if option is None else "unknown",
        given=option,
    )


def _named_series(by_uid: Mapping[str, Sequence[Slice]], option: str | None) -> list[str]:
    """Return the UIDs of the series with a UID or number; all if none is given."""
    numbers = {uid: slices[0].file.texts["SeriesNumber"] for uid, slices in by_uid.items()}
    return [uid for uid, number in numbers.items() if option in (None, uid, number)]


def _is_volume(series: Sequence[Slice]) -> bool:
    """Return True if a series has greyscale slices that stack."""
    stack = _stacks_of(series)[-1]
    if stack[0].components != 1 or len(stack) < 2:
        return False
    normal = stack[0].directions[:, 2]
    offsets = [float(slice_.origin_mm @ normal) for slice_ in stack if slice_.origin_mm is not None]
    return len(offsets) < len(stack) or float(np.ptp(offsets)) > 0


def _series_choice(by_uid: Mapping[str, Sequence[Slice]], option: str | None) -> Choice:
    """Return the choice of a series by its number, or by its UID if the number is not unique."""
    numbers = [slices[0].file.texts["SeriesNumber"] for slices in by_uid.values()]
    values, names, selected = [], [], None
    for (uid, slices), number in zip(by_uid.items(), numbers, strict=True):
        file, (columns, rows) = slices[0].file, slices[0].size
        values.append(number if number and numbers.count(number) == 1 else uid)
        title = f"{file.texts['Modality']} {file.texts['SeriesDescription']!r}".strip()
        word = "slices" if file.frames == 1 else "frames"
        names.append(f"{title} ({len(slices)} {word} of {columns}x{rows})")
        if option in (uid, values[-1]):
            selected = values[-1]
    return Choice("series", tuple(values), tuple(names), selected)


def _read_stack(requested: list[Slice], query: Query, notes: list[str]) -> Reading:
    """Read the largest stack of a series."""
    if any("MOSAIC" in slice_.file.texts["ImageType"] for slice_ in requested):
        raise VolumeError(
            f"{query.path}: are Siemens mosaics (Image Type … MOSAIC), each a volume of tiles",
            f"dcm2niix unpacks them: dcm2niix -z y -o . {shlex.quote(str(query.path))}",
            code="unsupported",
        )
    stack = _largest_stack(requested, query, notes)
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
        values, step = _read_segments(places, query, notes)
    else:
        stack = _at_one_time(places, query)
        first = stack[0]
        step = _step_mm(stack, query, guesses)
        itemsize = -(-file.layout["bits_allocated"] // 8)
        is_scaled = any(slice_.rescale != (1, 0) or slice_.file.modality_lut for slice_ in stack)
        query.reserve((*first.size, len(stack)), max(itemsize, 4 if is_scaled else 1))
        with captured_output([]):
            values = stack_slices(stack, read_values)
        origins = np.array([slice_.origin_mm for slice_ in stack if slice_.origin_mm is not None])
        if query.spacing_mm is None and len(origins) > 1 and (uneven := unevenness(origins)):
            notes.append(f"{query.path}: {uneven}")
    if first.origin_mm is not None and not first.in_patient:
        notes.append(
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
        notes.append(f"{query.path}: {guess}; if that is wrong, give it in mm as in {example}")
    y, x = first.pixel_mm or (1.0, 1.0)
    columns = np.column_stack([first.directions[:, :2] * (x, y), step])
    origin = file.start_mm if first.origin_mm is None else first.origin_mm
    return Reading(
        values,
        world_from_index=affine(columns, np.zeros(3) if origin is None else origin),
        notes=notes,
        labels=file.segments,
        metadata=Metadata(file.texts["Modality"], file.unit, first.in_patient, tuple(guesses)),
    )


def _stacks_of(series: Sequence[Slice]) -> list[list[Slice]]:
    """Group slices by size and orientation, the largest group last."""
    stacks: list[list[Slice]] = []
    for slice_ in series:
        for stack in stacks:
            if slice_.fits_stack(stack[0]):
                stack.append(slice_)
                break
        else:
            stacks.append([slice_])
    return sorted(stacks, key=len)


def _advice(one: Slice, for_files: str) -> str:
    """Return a remedy for the files of a folder, or for the frames of one file."""
    path = shlex.quote(str(one.file.path))
    return for_files if one.file.frames == 1 else f"split it into volumes: dcm2niix -s y {path}"


def _largest_stack(series: list[Slice], query: Query, notes: list[str]) -> list[Slice]:
    """Return the slices of one size and orientation, leaving out single others such as a scout."""
    many = {slice_.file.path: slice_.file for slice_ in series if slice_.file.frames > 1}
    if len(many) > 1 and len({f.texts["ConcatenationUID"] or f.path for f in many.values()}) > 1:
        raise VolumeError(
            f"{query.path}: holds {len(many)} files of many frames, each a volume; give one of "
            f"them, such as {next(iter(many))}",
            code="conflict",
        )
    stacks = _stacks_of(series)
    *smaller, largest = stacks
    if any(len(stack) > 1 for stack in smaller):
        counts = ", ".join(f"{len(s)} of {s[0].size[0]}x{s[0].size[1]}" for s in reversed(stacks))
        raise VolumeError(
            f"{query.path}: holds slices of {len(stacks)} sizes or orientations in one series "
            f"({counts})",
            _advice(largest[0], "put each stack into a folder of its own"),
            code="conflict",
        )
    if smaller and len(largest) < 2:
        raise VolumeError(
            f"{query.path}: the {len(series)} slices of its series differ in size or orientation, "
            "as a localizer's do, and do not stack; give another series",
            code="shape",
        )
    if smaller:
        noun = "files" if largest[0].file.frames == 1 else "frames"
        notes.append(
            f"{query.path}: {len(smaller)} of {len(series)} {noun} left out, of another size or "
            f"orientation, such as {smaller[0][0].name}"
        )
    return largest


def _places(stack: list[Slice], query: Query) -> list[list[Slice]]:
    """Return the slices at each place, in order; those without positions by their numbers."""
    stack = sorted(stack, key=lambda slice_: (slice_.order, slice_.file.path.name))
    stray = [s for s in stack if s.origin_mm is None]
    if len(stray) == len(stack):
        return [[s] for s in stack]
    if stray:
        raise VolumeError(
            f"{query.path}: {stray[0].name} states no position in the patient, but others of its "
            "series do",
            _advice(stray[0], "take it out of the folder"),
            code="conflict",
        )
    groups = group_slices(np.array([s.origin_mm for s in stack]), stack[0].directions[:, 2])
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
    index = query.index("time", times, "time steps, echoes or the like at every place")
    query.end_choices()
    return [place[index] for place in places]


def _step_mm(stack: list[Slice], query: Query, guesses: dict[str, str]) -> NDArray[np.float64]:
    """Return the (3,) step from slice to slice."""
    first = stack[0]
    if len(stack) == 1:
        return first.directions[:, 2] * (first.apart_mm or 0.0)
    if first.origin_mm is None:
        gap_mm = first.apart_mm or 1.0
        assumption = (
            "the slices state no positions; they are ordered by number,"
            if first.file.frames == 1
            else f"its {len(stack)} frames are read as slices"
        )
        guesses[f"slices {abs(gap_mm):g} mm apart"] = f"{assumption} {abs(gap_mm):g} mm apart"
        return first.directions[:, 2] * gap_mm
    origins = np.array([slice_.origin_mm for slice_ in stack])
    y, x = first.pixel_mm or (1.0, 1.0)
    return slice_step_mm(origins, [slice_.name for slice_ in stack], query, (x, y))


def _read_segments(
    places: list[list[Slice]], query: Query, notes: list[str]
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
    origins = np.array([place[0].origin_mm for place in places])
    if len(origins) == 1:
        number, step = np.zeros(1), first.directions[:, 2] * (first.apart_mm or 0.0)
    else:
        distances = np.linalg.norm(origins - origins[0], axis=1)
        usual = np.diff(distances)
        number = np.rint(distances / np.median(usual[usual < 1.5 * usual.min()]))
        step = (origins[-1] - origins[0]) / number[-1]
    if np.abs(origins[0] + number[:, None] * step - origins).max() > _JITTER * np.linalg.norm(step):
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
        for slice_ in sorted(place, key=lambda one: one.segment):
            frame = read_values(slice_)
            mask = frame >= slice_.file.half
            overlap += int(np.count_nonzero(values[z][mask]))
            values[z][mask] = slice_.segment or frame[mask]
    if overlap:
        notes.append(f"{query.path}: its segments overlap in {overlap} voxels; the last is read")
    if first.file.half > 1:
        notes.append(f"{query.path}: holds fractions; read as segments from one half on")
    return values, step
