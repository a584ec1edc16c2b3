"""DICOM series, read with pydicom: choice of a series in a folder.

    folder, or one file of it -> headers -> [dicom] -> dicom_stack -> Reading

Slices are files of one frame each, or the frames of a file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from volspec.errors import VolumeError
from volspec.volume.files.dicom_frames import File, Slice
from volspec.volume.files.dicom_headers import describe_without_pictures, dicom_files, headers
from volspec.volume.files.dicom_stack import read_stack, stacks_of
from volspec.volume.files.query import Choice, Query, Reading

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
        return read_stack(requested, query, remarks)
    except VolumeError as error:
        if not remarks:
            raise
        # Files that were left out may be the slices that are missing.
        left_out = remarks[0].removeprefix(f"{query.path}: ")
        problem = f"{error.problem} ({left_out})"
        raise VolumeError(problem, error.remedy, code=error.code, given=error.given) from error


def _requested_series(query: Query, remarks: list[str]) -> list[Slice]:
    """Return the slices of the series that the query selects, each once."""
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
    if own and own[0].file.frames > 1 and not own[0].file.concatenation:
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
        count = len(strangers) + len({each.file.path for each in found})
        remarks.append(
            f"{path}: {len(strangers)} of {count} files left out, which cannot be read as DICOM "
            f"pictures, such as {strangers[0].name}"
        )
    if own:
        chosen = own[0].file.series
        found = [*own, *(each for each in found if each.file.path != path)]
    else:
        chosen = _choose_uid(found, query, remarks)
    series = [each for each in found if each.file.series == chosen]
    # Copies of a file share its UID; a file without one is unique.
    unique = {each.file.uid or each.file.path: each.file for each in series}
    series = [each for each in series if unique[each.file.uid or each.file.path] is each.file]
    _require_one_patient(series, query)
    return series


def _require_one_patient(series: list[Slice], query: Query) -> None:
    """Refuse slices of several patients or studies; some programs give every file a new study."""
    patients = {each.file.patient: each.name for each in series}
    studies = {each.file.study: each.name for each in series}
    mixed = patients if len(patients) > 1 else studies
    if len(patients) > 1 or 1 < len(studies) < len(series):
        one, other, *_ = mixed.values()
        raise VolumeError(
            f"{query.path}: {one} and {other} are of different patients or studies, though of one "
            "series; put each patient's files into a folder of their own",
            code="conflict",
        )


def _choose_uid(found: list[Slice], query: Query, remarks: list[str]) -> str:
    """Return the UID of the only series that is a volume, or of the one that ``series=`` names."""
    kinds: dict[str, list[Slice]] = {}
    for each in found:
        kinds.setdefault(each.file.series, []).append(each)
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
    return [uid for uid, (one, *_) in kinds.items() if given in (None, uid, one.file.number)]


def _is_volume(series: Sequence[Slice]) -> bool:
    """Return True if a series has greyscale slices that stack."""
    stack = stacks_of(series)[-1]
    if stack[0].components != 1 or len(stack) < 2:
        return False
    normal = stack[0].directions[:, 2]
    along = [float(each.origin_mm @ normal) for each in stack if each.origin_mm is not None]
    return len(along) < len(stack) or float(np.ptp(along)) > 0


def _series_choice(kinds: Mapping[str, Sequence[Slice]], given: str | None) -> Choice:
    """Return the choice of a series by its number, or by its UID if the number is not unique."""
    numbers = [each[0].file.number for each in kinds.values()]
    values, names, chosen = [], [], None
    for slices in sorted(kinds.values(), key=lambda each: _order(each[0].file)):
        file, (columns, rows) = slices[0].file, slices[0].size
        unique = file.number and numbers.count(file.number) == 1
        values.append(file.number if unique else file.series)
        what = f"{file.modality} {file.description!r}".strip()
        word = "slices" if file.frames == 1 else "frames"
        names.append(f"{what} ({len(slices)} {word} of {columns}x{rows})")
        if given in (file.series, values[-1]):
            chosen = values[-1]
    return Choice("series", tuple(values), tuple(names), chosen)


def _order(file: File) -> tuple[int, str]:
    return int(file.number) if file.number.isdecimal() else 0, file.series
