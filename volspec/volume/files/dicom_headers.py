"""Headers of DICOM files, read with GDCM: series, size and position in the patient.

    files -> [dicom_headers] -> Slice -> dicom

References
----------
[1] DICOM PS3.6, tags; PS3.4 B.5, SOP classes; PS3.10, 7.1: the file's first bytes.
"""

from __future__ import annotations

import os
import re
import shlex
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
# radiotherapy structures and plans, colour palettes.
_NO_PICTURES = re.compile(
    r"1\.2\.840\.10008\.(1\.3\.10|5\.1\.4\.(34\..*|39\..*|1\.1\.((9|11|67|88|104)\..*|66(\.[1235])?"
    r"|481\.([3-9]|\d\d))))"
)
# The class in the file's header, or in a file without one: tag 0008,0016 with or without "UI", of
# either byte order.
_CLASS = re.compile(
    rb"(?:\x02\x00\x02\x00UI..|(?:\x08\x00\x16\x00|\x00\x08\x00\x16)(?:UI..|..\x00\x00))([0-9.]+)",
    re.DOTALL,
)

# The modality, tag 0008,0060, likewise with or without its type; and those without pictures.
_MODALITY = re.compile(
    rb"(?:\x08\x00\x60\x00|\x00\x08\x00\x60)(?:CS..|..\x00\x00)([A-Z]+)", re.DOTALL
)
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
_NAMED_CLASSES = {
    "1.2.840.10008.1.3.10": "the table of contents of a folder (DICOMDIR)",
    "1.2.840.10008.5.1.4.39.": "a colour palette",
}
# A data set's first element: group 0002 or 0008, of either byte order, with a type or a length
# below 65536.
_DATA_SET = re.compile(
    rb"[\x02\x08]\x00.\x00(?:[A-Z]{2}|..\x00\x00)|\x00[\x02\x08]\x00.(?:[A-Z]{2}|\x00\x00..)",
    re.DOTALL,
)
# Tag of the pixels in both byte orders.
_PIXELS = (b"\xe0\x7f\x10\x00", b"\x7f\xe0\x00\x10")
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
    """Return True if a file begins with DICOM's preamble, or lacks it but begins like DICOM."""
    try:
        head = _head(path)
    except OSError:
        return False
    return head[_PREAMBLE : _PREAMBLE + 4] == b"DICM" or (
        _DATA_SET.match(head) is not None and _CLASS.search(head) is not None
    )


def dicom_files(folder: Path) -> list[Path]:
    """Return a folder's DICOM files, found by suffix or first bytes; hidden files are left out."""
    return sorted(
        path
        for path in folder.iterdir()
        if not path.name.startswith(".")
        and not path.name.upper().startswith("DICOMDIR")  # the table of contents of a CD
        and path.is_file()
        and (path.name.lower().endswith(SUFFIXES) or is_dicom(path))
    )


def headers(paths: Sequence[Path], strangers: list[Path] | None = None) -> list[Slice]:
    """Read headers, leaving out files of classes without pictures.

    Unreadable files are added to ``strangers`` if it is given, and refused otherwise.
    """
    found = []
    with captured_output([]):
        for path in paths:
            try:
                found.append(_header(path))
            except VolumeError:
                if strangers is None:
                    raise
                strangers.append(path)
    return [each for each in found if each is not None]


def describe_without_pictures(path: Path) -> str:
    """Return what a file without pictures is, from its modality or class."""
    head = _head(path)
    named, modality = _CLASS.search(head), _MODALITY.search(head)
    word = modality[1].decode() if modality else ""
    if word in _NAMED_MODALITIES:
        return f"{word} ({_NAMED_MODALITIES[word]})"
    uid = named[1].decode() if named else ""
    return next((name for start, name in _NAMED_CLASSES.items() if uid.startswith(start)), "DICOM")


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


def _fault(path: Path) -> str:
    """Return why GDCM cannot read a file, and the remedy."""
    name = shlex.quote(str(path))
    if _DATA_SET.match(_head(path)):
        return (
            "has no DICOM header (DICM after 128 bytes) and cannot be read; add one by DCMTK: "
            f"dcmconv {name} {shlex.quote(f'{path.stem}-header.dcm')}"
        )
    if is_dicom(path) and not any(tag in path.read_bytes() for tag in _PIXELS):
        return "holds no pixels; truncated, or not a picture: copy it again, or give another file"
    return (
        "cannot be read as a DICOM picture; damaged or truncated, copy it again, or try to convert "
        f"it: dcm2niix -s y {name}"
    )


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
        raise VolumeError(f"{path}: {_fault(path)}", code="damaged") from error
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
