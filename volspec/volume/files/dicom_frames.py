"""Frames of DICOM files: places in the patient, and values.

    dicom_headers -> [dicom_frames] -> Slice, read_values -> dicom_stack

A file of many frames states their places and values in functional groups, of a frame or shared,
or for the file as a whole. A frame is a slice, as is a file of one.

References
----------
[1] DICOM PS3.3, C.7.6.16 functional groups; C.7.6.2 Image Plane; C.8.2.1 CT: Rescale Type; C.8.9.1
    PET: Units; C.8.20 segmentations; C.8.8.3 doses; C.8.4.8 frames of nuclear medicine.
[2] DICOM PS3.3, C.10.7.1.1: colours of segments, in CIELAB under D50.
"""

from __future__ import annotations

import math
import os
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError
from volspec.volume.labels import Label
from volspec.volume.metadata import HU

# Functional groups that are read; the last is not one, but nuclear medicine's.
_GROUPS = (
    *("PlanePosition", "PlaneOrientation", "PixelMeasures", "FrameContent", "MREcho"),
    *("PixelValueTransformation", "RealWorldValueMapping", "MRDiffusion"),
    *("SegmentIdentification", "DetectorInformation"),
)
# What differs between frames at one place, and dimensions that are the place itself: stack,
# position in it, position in the patient.
_REPEATS = ("TemporalPositionIndex", "EffectiveEchoTime", "DiffusionBValue")
_PLACES = (0x00209056, 0x00209057, 0x00200032)
# Units by DICOM's codes: of PET, of doses, and in Rescale Type.
_UNITS = {"BQML": "Bq/ml", "CNTS": "counts", "CPS": "counts/s", "GML": "g/ml", "PCNT": "%"}
_UNITS |= {"GY": "Gy", "MGML": "mg/ml", "PCT": "%"}
_UNIT_TAGS = {"PT": "Units", "RTDOSE": "DoseUnits"}
# Attributes that state distances of pixels elsewhere than in the patient.
_AT_DETECTOR = ("ImagerPixel", "NominalScannedPixel")
# What pydicom says of compressions that no installed decoder reads, such as JPEG of 12 bits.
_NO_DECODER = re.compile("does not support|missing dependencies")
# Vectors whose product is smaller are parallel.
_LEAST_AREA = 0.5
DEFLATED = "1.2.840.10008.1.2.1.99"
"""Transfer syntax of files that are compressed as a whole."""
# White of CIELAB, and linear sRGB from XYZ under it.
_D50 = (0.9642, 1.0, 0.8249)
_RGB_FROM_XYZ_D50 = np.reshape(
    (3.1338561, -1.6168667, -0.4906146, -0.9787684, 1.9161415, 0.033454)
    + (0.0719453, -0.2289914, 1.4052427),
    (3, 3),
)


@dataclass(frozen=True, slots=True, eq=False)
class File:
    """Header of a DICOM file, without its frames."""

    path: Path
    uid: str  # the instance's UID; copies of a file share it
    series: str  # UID
    number: str  # of the series
    description: str
    modality: str
    patient: str  # ID
    study: str  # UID
    concatenation: str  # UID that the parts of a divided file share
    image_type: tuple[str, ...]
    unit: str  # of the values
    start_mm: NDArray[np.float64] | None  # position of the file as a whole
    detector_mm: Sequence[float]  # of pixels at the detector, along y and x, if stated
    segments: dict[int, Label] | None
    half: float  # least value of a segment
    layout: dict[str, Any]  # rows, columns, bits, transfer syntax, as pydicom's decoders take them
    shift: int  # unused bits below the stored ones
    state: tuple[int, int]  # size and time of change

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(self.layout["number_of_frames"])


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """A frame, and its place in the patient."""

    file: File
    frame: int
    order: tuple[float, ...]  # of slices at one place, or without places
    pixel_mm: Sequence[float]  # along y and x; none if not stated
    directions: NDArray[np.float64]  # (3, 3); columns: along columns, rows and slices
    origin_mm: NDArray[np.float64] | None  # (3,), centre of the first pixel
    in_patient: bool  # these are stated, in the patient's frame
    apart_mm: float | None  # distance between slices if stated, else their thickness
    rescale: tuple[float, float]  # slope and intercept
    segment: int  # 0 if the values are the segments

    @property
    def name(self) -> str:
        """The file's name, or the frame's number."""
        return self.file.path.name if self.file.frames == 1 else f"frame {self.frame + 1}"

    @property
    def size(self) -> tuple[int, int]:
        """Columns and rows."""
        return self.file.layout["columns"], self.file.layout["rows"]

    @property
    def components(self) -> int:
        """Values per pixel, or of its colour in a palette."""
        layout = self.file.layout
        is_palette = layout.get("photometric_interpretation") == "PALETTE COLOR"
        return 3 if is_palette else int(layout["samples_per_pixel"])

    def fits_stack(self, other: Slice) -> bool:
        """Return True if both have the same size and orientation, like slices of one stack."""
        a, b = self.directions, other.directions
        return (
            (a is b or np.allclose(a, b, atol=2e-3))
            and (self.size, self.components) == (other.size, other.components)
            and len(self.pixel_mm) == len(other.pixel_mm)
            and np.allclose(self.pixel_mm, other.pixel_mm, rtol=1e-3)
        )


def frames_of(
    path: Path, parsed: Any, layout: dict[str, Any], status: os.stat_result
) -> list[Slice]:
    """Return the frames of a parsed file, whose pixels have a layout."""
    count = layout["number_of_frames"] = int(layout["number_of_frames"])
    shared = _groups(*parsed.get("SharedFunctionalGroupsSequence") or ())
    own = [_groups(item) for item in parsed.get("PerFrameFunctionalGroupsSequence") or ()]
    whole = [parsed, *_groups(parsed)]
    bits, high = layout.get("bits_stored", 0), _number("HighBit", whole) or 0
    shift = max(int(high) + 1 - bits, 0) if bits else 0
    stored = {"path": path, "layout": layout, "shift": shift, "state": file_state(status)}
    layout["bits_stored"] = bits + shift
    file = _file(parsed, [*(own or [[]])[0], *shared], whole, **stored)
    dimensions = parsed.get("DimensionIndexSequence") or ()
    pointers = [each.get("DimensionIndexPointer") for each in dimensions]
    offsets = _offsets_mm(parsed, whole, count)
    slices = []
    for k in range(count):
        groups = [*own[k], *shared] if k < len(own) else shared
        every = [*groups, *whole]
        cosines = _cosines(every)
        directions = _directions(cosines)
        position = _numbers("ImagePositionPatient", groups if count > 1 else every, 3)
        origin = np.array(position) if position else None
        if origin is None and offsets:
            origin = (0 if file.start_mm is None else file.start_mm) + directions[:, 2] * offsets[k]
        indices = zip(pointers, _numbers("DimensionIndexValues", groups), strict=False)
        order = [_number(name, groups) or 0 for name in _REPEATS]
        order += [index for pointer, index in indices if pointer not in _PLACES]
        slices.append(
            Slice(
                file=file,
                frame=k,
                order=(*order, _number("InstanceNumber", whole) or 0, k),
                pixel_mm=_positive(_numbers("PixelSpacing", every, 2)),
                directions=directions,
                origin_mm=origin,
                in_patient=bool(cosines) and (bool(position) or file.start_mm is not None),
                apart_mm=_number("SpacingBetweenSlices", every) or _number("SliceThickness", every),
                rescale=_rescale(groups, every),
                segment=int(_number("ReferencedSegmentNumber", groups) or 0),
            )
        )
    return slices


def _file(parsed: Any, groups: list[Any], whole: list[Any], **stored: Any) -> File:
    """Return a file's header; ``groups`` are the first frame's, ``stored`` are further fields."""
    every = [*groups, *whole]
    start = _numbers("ImagePositionPatient", whole, 3)
    at_detector = (_numbers(f"{name}Spacing", whole, 2) for name in _AT_DETECTOR)
    is_fraction = text_of("SegmentationType", parsed) == "FRACTIONAL"
    segments = parsed.get("SegmentSequence")
    return File(
        uid=text_of("SOPInstanceUID", parsed),
        series=text_of("SeriesInstanceUID", parsed),
        number=text_of("SeriesNumber", parsed),
        description=text_of("SeriesDescription", parsed),
        modality=text_of("Modality", parsed),
        patient=text_of("PatientID", parsed),
        study=text_of("StudyInstanceUID", parsed),
        concatenation=text_of("ConcatenationUID", parsed),
        image_type=tuple(text_of("ImageType", parsed).split("\\")),
        unit=_unit(parsed, groups, every),
        start_mm=np.array(start) if start else None,
        detector_mm=next((_positive(each) for each in at_detector if each), []),
        segments=None if segments is None else {int(s.SegmentNumber): _label(s) for s in segments},
        half=(_number("MaximumFractionalValue", whole) or 255) / 2 if is_fraction else 1,
        **stored,
    )


@contextmanager
def lenient() -> Iterator[None]:
    """Accept values that break DICOM's rules, without warnings."""
    from pydicom import config

    with warnings.catch_warnings(), config.disable_value_validation():
        warnings.simplefilter("ignore")
        yield


def file_state(status: os.stat_result) -> tuple[int, int]:
    """Return what changes with a file's contents."""
    return status.st_size, status.st_mtime_ns


def text_of(keyword: str, *places: Any) -> str:
    """Return the first statement of a text in several places; empty if there is none."""
    for place in places:
        given = place.get(keyword)
        if given not in (None, ""):
            many = isinstance(given, Sequence) and not isinstance(given, str)
            return ("\\".join(map(str, given)) if many else str(given)).strip(" \0")
    return ""


def _groups(*items: Any) -> list[Any]:
    found = (item.get(f"{name}Sequence") for item in items for name in _GROUPS)
    return [group[0] for group in found if group]


def _numbers(keyword: str, places: Sequence[Any], count: int | None = None) -> list[float]:
    """Return the first statement of finite numbers in several places; none if there is none."""
    for place in places:
        with suppress(ValueError, TypeError, OverflowError):  # missing, or no numbers
            given = place.get(keyword)
            many = isinstance(given, Sequence) and not isinstance(given, str)
            numbers = [float(each) for each in (given if many else [given])]
            if len(numbers) == (count or len(numbers)) and all(map(math.isfinite, numbers)):
                return numbers
    return []


def _number(keyword: str, places: Sequence[Any]) -> float | None:
    return next(iter(_numbers(keyword, places, 1)), None)


def _positive(numbers: list[float]) -> list[float]:
    return numbers if all(each > 0 for each in numbers) else []


def _cosines(places: Sequence[Any]) -> tuple[float, ...]:
    """Return the directions along columns and rows; none if they are not stated, or parallel."""
    cosines = _numbers("ImageOrientationPatient", places, 6)
    is_plane = cosines and np.linalg.norm(np.cross(cosines[:3], cosines[3:])) > _LEAST_AREA
    return tuple(cosines) if is_plane else ()


@lru_cache(maxsize=256)
def _directions(cosines: tuple[float, ...]) -> NDArray[np.float64]:
    """Return unit vectors along columns, rows and slices, as columns."""
    x, y = np.reshape(cosines or (1, 0, 0, 0, 1, 0), (2, 3)).astype(np.float64)
    across = np.cross(x, y)
    return np.column_stack([each / np.linalg.norm(each) for each in (x, y, across)])


def _offsets_mm(parsed: Any, whole: Sequence[Any], count: int) -> list[float]:
    """Return the distances of frames from the first position; none if they are not stated.

    Doses have them (GridFrameOffsetVector), and nuclear medicine (SliceVector).
    """
    if count == 1:
        return []
    if offsets := _numbers("GridFrameOffsetVector", [parsed], count):
        return [each - offsets[0] for each in offsets]
    apart = _number("SpacingBetweenSlices", whole) or 0
    return [(each - 1) * apart for each in _numbers("SliceVector", [parsed], count) if apart]


def _rescale(groups: Sequence[Any], every: Sequence[Any]) -> tuple[float, float]:
    """Return slope and intercept of a frame; of real-world values only if no others are stated."""
    slope, intercept = _number("RescaleSlope", every), _number("RescaleIntercept", every)
    if slope is None and intercept is None:
        slope = _number("DoseGridScaling", every) or _number("RealWorldValueSlope", groups)
        intercept = _number("RealWorldValueIntercept", groups)
    return 1.0 if slope is None else slope, intercept or 0.0


def _unit(parsed: Any, groups: Sequence[Any], every: Sequence[Any]) -> str:
    """Return the unit of rescaled values; without a Rescale Type a CT's is HU (C.8.2.1)."""
    modality, kind = text_of("Modality", parsed), text_of("RescaleType", *every)
    is_rescaled = _number("RescaleIntercept", every) is not None
    if modality == "CT" and is_rescaled and kind in ("", HU):
        return "" if "LOCALIZER" in text_of("ImageType", parsed) else HU
    if modality in _UNIT_TAGS or is_rescaled:
        return _UNITS.get(text_of(_UNIT_TAGS.get(modality, "RescaleType"), *every), "")
    codes = [code for each in groups for code in each.get("MeasurementUnitsCodeSequence") or ()]
    code = text_of("CodeValue", *codes)
    return "" if code == "1" else code  # UCUM's


def _label(segment: Any) -> Label:
    """Return the name and the colour of a segment."""
    kinds = segment.get("SegmentedPropertyTypeCodeSequence") or ()
    name = text_of("SegmentLabel", segment) or text_of("CodeMeaning", *kinds)
    lab = _numbers("RecommendedDisplayCIELabValue", [segment], 3)
    if not lab:
        return Label(name)
    L, a, b = lab[0] * 100 / 65535, lab[1] * 255 / 65535 - 128, lab[2] * 255 / 65535 - 128
    f = np.array([(L + 16) / 116 + a / 500, (L + 16) / 116, (L + 16) / 116 - b / 200])
    XYZ = np.where(f > 6 / 29, f**3, (f - 4 / 29) * 108 / 841) * _D50
    RGB = np.clip(_RGB_FROM_XYZ_D50 @ XYZ, 0, 1)
    codes = np.where(RGB <= 0.0031308, 12.92 * RGB, 1.055 * RGB ** (1 / 2.4) - 0.055)
    red, green, blue = codes.round(4).tolist()
    return Label(name, (red, green, blue))


def read_values(one: Slice) -> NDArray[Any]:
    """Read a slice's values (Y, X), rescaled, of the narrowest type that holds them."""
    values = _stored_values(one)
    slope, intercept = one.rescale
    if (slope, intercept) == (1, 0):
        return values
    largest = abs(slope) * 2.0 ** (8 * values.itemsize) + abs(intercept)
    if values.dtype.kind == "f" or slope % 1 or intercept % 1 or largest >= 2**31:
        return (values * np.float64(slope) + intercept).astype(np.float32)
    values = values.astype(np.int32) * int(slope) + int(intercept)
    # Rescaled 16-bit pixels mostly fit into 16 bits again.
    fits = values.min() >= -(2**15) and values.max() < 2**15
    return values.astype(np.int16) if fits else values


def _stored_values(one: Slice) -> NDArray[Any]:
    """Read a slice's stored values (Y, X), decompressed."""
    from pydicom.pixels.decoders.base import get_decoder

    file, layout = one.file, one.file.layout
    syntax = layout["transfer_syntax_uid"]
    try:
        with lenient(), file.path.open("rb") as stream:
            if file_state(os.fstat(stream.fileno())) != file.state:
                fault = f"{file.path}: changed while the series was being read; read it again"
                raise VolumeError(fault, code="state")
            decoder = get_decoder(syntax)
            if layout["bits_allocated"] == 1 and decoder.is_native and syntax != DEFLATED:
                return _bits(one, stream)
            stream.seek(layout["offset"])
            source = _inflated(file.path, file.state) if syntax == DEFLATED else stream
            values, _ = decoder.as_array(source, index=one.frame, raw=True, **layout)
    except (VolumeError, MemoryError):
        raise
    except Exception as error:  # of any kind: the bytes may be anything
        if isinstance(error, NotImplementedError) or _NO_DECODER.search(str(error)):
            raise VolumeError(
                f"{file.path}: its pixels are compressed as {syntax.name}, which needs a decoder",
                "export it uncompressed, or try pip install pylibjpeg pylibjpeg-openjpeg "
                "pylibjpeg-libjpeg",
                code="unsupported",
            ) from error
        raise VolumeError(
            f"{file.path}: its pixels ({syntax.name}) are damaged or truncated; copy it again, or "
            "take it out of the folder",
            code="damaged",
        ) from error
    return values >> file.shift if file.shift else values


def _bits(one: Slice, stream: BinaryIO) -> NDArray[np.uint8]:
    """Read pixels of one bit; pydicom reads frames that begin within a byte too short."""
    columns, rows = one.size
    start, skipped = divmod(one.frame * rows * columns, 8)
    stream.seek(one.file.layout["offset"] + start)
    packed = stream.read(-(-(skipped + rows * columns) // 8))
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), bitorder="little")
    return bits[skipped : skipped + rows * columns].reshape(rows, columns)


@lru_cache(maxsize=1)
def _inflated(path: Path, state: tuple[int, int]) -> Any:
    """Return the elements of a file that is compressed as a whole."""
    from pydicom import dcmread

    return dcmread(path)
