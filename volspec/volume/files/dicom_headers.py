"""Headers of DICOM files, read with GDCM: series, size and position in the patient.

    files -> [dicom_headers] -> Slice -> dicom

References
----------
[1] DICOM PS3.6, tags; PS3.4 B.5, SOP classes; PS3.10, 7.1: the file's first bytes.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError

SUFFIXES = (".dcm", ".dicom", ".ima")
_PREAMBLE = 128
# Of `Series`, in the order of its fields.
_SERIES_TAGS = ("0020|000e", "0020|0011", "0008|103e", "0008|0060")
# Classes without pictures: DICOMDIR; waveforms, presentation states, raw data, reports, documents,
# radiotherapy structures and plans.
_NO_PICTURES = re.compile(
    r"1\.2\.840\.10008\.(1\.3\.10|5\.1\.4\.(34\..*|1\.1\.((9|11|67|88|104)\..*|66(\.[1235])?"
    r"|481\.([3-9]|\d\d))))"
)
# The class in the file's header, or in a file without one: tag 0008,0016 with or without "UI".
_CLASS = re.compile(
    rb"(?:\x02\x00\x02\x00UI..|\x08\x00\x16\x00(?:UI..|..\x00\x00))([0-9.]+)", re.DOTALL
)

# The modality, tag 0008,0060, likewise with or without its type; and those without pictures.
_MODALITY = re.compile(rb"\x08\x00\x60\x00(?:CS..|..\x00\x00)([A-Z]+)", re.DOTALL)
_NAMED_MODALITIES = {
    "RTSTRUCT": "radiotherapy structures",
    "RTPLAN": "a radiotherapy plan",
    "RTRECORD": "a radiotherapy record",
    "SR": "a structured report",
    "PR": "a presentation state",
    "KO": "a selection of key objects",
    "REG": "a registration",
    "DOC": "a document",
    "PLAN": "a plan",
    "FID": "fiducial marks",
    "RWV": "a table of real-world values",
    "ECG": "an electrocardiogram",
    "HD": "a haemodynamic waveform",
    "AU": "a sound",
}
# Bytes in which both are looked for.
_HEAD_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Series:
    """Identity of a series: its UID, and a number, a description and a modality for people."""

    uid: str
    number: str
    description: str
    modality: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """Header of one DICOM file."""

    path: Path
    uid: str  # the instance's UID; copies of a file share it
    series: Series
    number: int  # the instance's number in its series
    size: tuple[int, int, int]  # columns, rows, frames
    components: int  # values per pixel
    itemsize: int  # bytes per value
    spacing_mm: tuple[float, float, float]  # the last is between frames
    directions: NDArray[np.float64]  # (3, 3); columns: along columns, rows and frames
    origin_mm: NDArray[np.float64]  # (3,), centre of the first pixel
    placed: bool  # a position is stated for the file as a whole
    thickness_mm: float | None  # distance between slices if stated, else their thickness
    scale: float = 1.0  # of a dose, in grays

    def fits_stack(self, other: Slice) -> bool:
        """Return True if both have the same size and orientation, like slices of one stack."""
        return (
            (self.size, self.components) == (other.size, other.components)
            and np.allclose(self.spacing_mm[:2], other.spacing_mm[:2], rtol=1e-3)
            and np.allclose(self.directions, other.directions, atol=2e-3)
        )


def is_dicom(path: Path) -> bool:
    """Return True if a file begins with DICOM's preamble."""
    try:
        with path.open("rb") as file:
            return file.read(_PREAMBLE + 4)[_PREAMBLE:] == b"DICM"
    except OSError:
        return False


def dicom_files(folder: Path) -> list[Path]:
    """Return a folder's DICOM files, found by suffix or first bytes; hidden files are left out."""
    return sorted(
        path
        for path in folder.iterdir()
        if not path.name.startswith(".")
        and path.is_file()
        and (path.name.lower().endswith(SUFFIXES) or is_dicom(path))
    )


def headers(paths: Sequence[Path], strangers: list[Path] | None = None) -> list[Slice]:
    """Read headers, leaving out files of classes without pictures.

    Files that do not even begin like DICOM are added to ``strangers`` if it is given; other
    unreadable ones may be slices, so they are refused.
    """
    found = []
    with captured_output([]):
        for path in paths:
            try:
                found.append(_header(path))
            except VolumeError:
                if strangers is None or is_dicom(path):
                    raise
                strangers.append(path)
    return [each for each in found if each is not None]


def describe_without_pictures(path: Path) -> str:
    """Return what a file of a class without pictures is, from its modality; else "DICOM"."""
    modality = _MODALITY.search(_head(path))
    word = modality[1].decode() if modality else ""
    return f"{word} ({_NAMED_MODALITIES[word]})" if word in _NAMED_MODALITIES else "DICOM"


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(_HEAD_BYTES)


def _has_no_pictures(path: Path) -> bool:
    """Return True if a file's class or modality is one without pictures."""
    head = _head(path)
    named, modality = _CLASS.search(head), _MODALITY.search(head)
    if named is not None and _NO_PICTURES.fullmatch(named[1].decode()):
        return True
    return modality is not None and modality[1].decode() in _NAMED_MODALITIES


def _header(path: Path) -> Slice | None:
    import SimpleITK as sitk

    reader = sitk.ImageFileReader()
    reader.SetImageIO("GDCMImageIO")
    reader.SetFileName(os.fspath(path))
    try:
        reader.ReadImageInformation()
    except RuntimeError as error:
        if _has_no_pictures(path):
            return None
        raise VolumeError(
            f"{path}: cannot be read as a DICOM picture; damaged or truncated, copy it again or "
            "take it out of the folder",
            code="damaged",
        ) from error
    columns, rows, *frames = reader.GetSize()
    x, y, *z = reader.GetSpacing()
    return Slice(
        path=path,
        uid=_text(reader, "0008|0018"),
        series=Series(*(_text(reader, tag) for tag in _SERIES_TAGS)),
        number=int(_number(reader, "0020|0013") or 0),
        size=(columns, rows, frames[0] if frames else 1),
        components=reader.GetNumberOfComponents(),
        itemsize=sitk.Image([1, 1, 1], reader.GetPixelID()).GetSizeOfPixelComponent(),
        spacing_mm=(x, y, _frame_step(reader) or (z[0] if z else 1.0)),
        directions=np.reshape(reader.GetDirection(), (3, 3)),
        origin_mm=np.array(reader.GetOrigin()),
        placed=bool(_text(reader, "0020|0032")),
        thickness_mm=_number(reader, "0018|0088") or _number(reader, "0018|0050"),
        scale=_number(reader, "3004|000e") or 1.0,
    )


def _text(reader: Any, tag: str) -> str:
    if not reader.HasMetaDataKey(tag):
        return ""
    # Padded to an even length with a space or a zero.
    return str(reader.GetMetaData(tag)).strip(" \0\n")


def _frame_step(reader: Any) -> float | None:
    """Return the distance between the frames of a dose, from their offsets."""
    try:
        first, second, *_ = (float(n) for n in _text(reader, "3004|000c").split("\\"))
    except ValueError:
        return None
    return second - first or None


def _number(reader: Any, tag: str) -> float | None:
    try:
        return float(_text(reader, tag))
    except ValueError:
        return None
