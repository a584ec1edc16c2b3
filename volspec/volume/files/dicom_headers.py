"""DICOM files: how they are recognised, and their headers, read with pydicom.

    files -> [dicom_headers] -> dicom_frames -> Slice -> dicom

References
----------
[1] DICOM PS3.6, tags; PS3.4 B.5, SOP classes; PS3.5 A, transfer syntaxes; PS3.10, 7.1: the file's
    first bytes.
"""

from __future__ import annotations

import math
import os
import re
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any, BinaryIO

from volspec._confine import is_inside
from volspec.errors import VolumeError
from volspec.volume.files.dicom_frames import DEFLATED, Slice, frames_of, lenient, text_of

DICOM_SUFFIXES = (".dcm", ".dicom", ".ima")
# Classes without pictures: DICOMDIR; waveforms, presentation states, raw data, reports, documents,
# radiotherapy structures and plans, colour palettes; and the modalities of files without a class.
_NO_PICTURES = re.compile(
    r"1\.2\.840\.10008\.(1\.3\.10|5\.1\.4\.(34\..*|39\..*|1\.1\.((9|11|67|88|104)\..*|66(\.[1235])?"
    r"|481\.([3-9]|\d\d))))"
)
_PICTURELESS = re.compile("RT(STRUCT|PLAN|RECORD)|SR|PR|KO|REG|DOC|PLAN|FID|RWV|ECG|HD|AU")
# The class in the file's header, or in a file without one: tag 0008,0016 with or without "UI", of
# either byte order.
_CLASS = re.compile(
    rb"(?:\x02\x00\x02\x00UI..|(?:\x08\x00\x16\x00|\x00\x08\x00\x16)(?:UI..|..\x00\x00))([0-9.]+)",
    re.DOTALL,
)
# A data set's first element: group 0002 or 0008, of either byte order, with a type or a length
# below 65536.
_DATA_SET = re.compile(
    rb"[\x02\x08]\x00.\x00(?:[A-Z]{2}|..\x00\x00)|\x00[\x02\x08]\x00.(?:[A-Z]{2}|\x00\x00..)",
    re.DOTALL,
)
# Bytes in which both are looked for.
_HEAD_BYTES = 4096
# Pixels, by the last number of their tag 7FE0,00xx; and the length of compressed ones.
_PIXELS = {0x10: "PixelData", 0x08: "FloatPixelData", 0x09: "DoubleFloatPixelData"}
_UNDEFINED = 0xFFFFFFFF
# Transfer syntax of little-endian values without types.
_IMPLICIT = "1.2.840.10008.1.2"


def is_dicom(path: Path) -> bool:
    """Return True if a file begins with DICOM's preamble, or lacks it but begins like DICOM."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    is_bare = _DATA_SET.match(head) is not None and _CLASS.search(head) is not None
    return head[128:132] == b"DICM" or is_bare


def dicom_files(folder: Path) -> list[Path]:
    """Return a folder's DICOM files, found by suffix or first bytes; hidden files are left out."""
    return sorted(
        path
        for path in folder.iterdir()
        if not path.name.startswith(".")
        and not path.name.upper().startswith("DICOMDIR")  # the table of contents of a CD
        and path.is_file()
        and is_inside(path)
        and (path.name.lower().endswith(DICOM_SUFFIXES) or is_dicom(path))
    )


def headers(paths: Sequence[Path], strangers: list[Path] | None = None) -> list[Slice]:
    """Read the headers of pictures; other DICOM files are refused.

    If ``strangers`` is given, these are left out, and unreadable files are added to it.
    """
    slices: list[Slice] = []
    for path in paths:
        try:
            with path.open("rb") as file, lenient():
                slices += _slices(path, file)
            continue
        except VolumeError as error:
            fault = error
        except PermissionError:
            raise
        except Exception as error:  # of any kind: the bytes may be anything
            fault = VolumeError(
                f"{path}: cannot be read as a DICOM picture; damaged or truncated, copy it again, "
                f"or try to convert it: dcm2niix -s y {shlex.quote(str(path))}",
                code="damaged",
            )
            fault.__cause__ = error
        if strangers is None:
            raise fault
        if fault.code == "damaged":
            strangers.append(path)
    return slices


def _slices(path: Path, file: BinaryIO) -> list[Slice]:
    """Return the frames of a file."""
    from pydicom import dcmread
    from pydicom.uid import UID

    head = file.read(_HEAD_BYTES)
    if head[128:132] != b"DICM" and not _DATA_SET.match(head):
        raise ValueError("begins neither with a preamble nor with an element")
    file.seek(0)
    parsed = dcmread(file, stop_before_pixels=True, force=True)
    if parsed.file_meta.get("TransferSyntaxUID") == DEFLATED:
        file.seek(0)
        parsed = dcmread(file)
    layout, actual = _pixels(parsed, file)
    uid = str(parsed.file_meta.get("MediaStorageSOPClassUID") or parsed.get("SOPClassUID") or "")
    modality = text_of("Modality", parsed)
    if _NO_PICTURES.fullmatch(uid) or (not layout and _PICTURELESS.fullmatch(modality)):
        name = "DICOMDIR, a table of contents" if uid.endswith("8.1.3.10") else UID(uid).name
        content = f"{modality} ({name})" if modality and name else modality or name
        raise VolumeError(
            f"{path}: is {content}, not a picture; give a slice of an image series, or its folder",
            code="not-found",
        )
    if not layout:
        raise VolumeError(
            f"{path}: holds no pixels; truncated, or not a picture: copy it again, or give "
            "another file",
            code="damaged",
        )
    sizes = ("number_of_frames", "rows", "columns", "bits_allocated")
    needed = -(-math.prod(int(layout[name]) for name in sizes) // 8)
    if layout["samples_per_pixel"] == 1 and not 0 < needed <= actual:
        raise VolumeError(
            f"{path}: holds {actual} bytes of pixels, its header declares {needed}; truncated, "
            "copy it again, or take it out of the folder",
            code="damaged",
        )
    return frames_of(file, parsed, layout)


def _pixels(parsed: Any, file: BinaryIO) -> tuple[dict[str, Any], float]:
    """Return the pixels' layout, with their offset, and their bytes; infinite if compressed."""
    from pydicom.pixels.utils import as_pixel_options
    from pydicom.uid import UID

    syntax = parsed.file_meta.get("TransferSyntaxUID")
    if syntax == DEFLATED:
        keyword = next((name for name in _PIXELS.values() if name in parsed), None)
        layout = {"transfer_syntax_uid": UID(syntax), "pixel_keyword": keyword, "offset": 0}
        return as_pixel_options(parsed, **layout) if keyword else {}, math.inf
    tag = file.read(12)
    if len(tag) < 12 or tag[:2] not in (b"\xe0\x7f", b"\x7f\xe0"):
        return {}, 0
    is_explicit, is_little = tag[4:6].isalpha() and tag[6:8] == b"\0\0", tag[0] == 0xE0
    length = int.from_bytes(tag[8:] if is_explicit else tag[4:8], "little" if is_little else "big")
    is_compressed = length == _UNDEFINED
    if not is_compressed:  # whatever is stated
        syntax = _IMPLICIT + (".2" if not is_little else ".1" if is_explicit else "")
    offset = file.tell() - (0 if is_explicit else 4)
    layout = as_pixel_options(
        parsed,
        transfer_syntax_uid=UID(syntax),
        pixel_keyword=_PIXELS[tag[2] | tag[3]],
        pixel_vr=tag[4:6].decode() if is_explicit else "OW",
        offset=offset,
    )
    size = os.fstat(file.fileno()).st_size
    return layout, math.inf if is_compressed else min(length, size - offset)
