"""Frames of DICOM files: places in the patient, and values.

    dicom_headers -> [dicom_frames] -> Slice, read_values -> dicom

A file of many frames states their places and values in functional groups, of a frame or shared,
or for the file as a whole. A frame is a slice, as is a file of one.

References
----------
[1] DICOM PS3.3, C.7.6.16 functional groups; C.7.6.2 Image Plane; C.8.2.1 CT: Rescale Type; C.8.9.1
    PET: Units; C.8.20 segmentations; C.8.8.3 doses; C.8.4.8 frames of nuclear medicine.
[2] DICOM PS3.3, C.11.1 Modality LUT; C.10.7.1.1: colours of segments, in CIELAB under D50.
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from volspec._extras import install_command
from volspec.errors import VolumeError
from volspec.volume.labels import Label
from volspec.volume.metadata import HU

# Functional groups that are read; the last is not one, but nuclear medicine's.
_GROUPS = (
    *("PlanePosition", "PlaneOrientation", "PixelMeasures", "FrameContent", "MREcho"),
    *("PixelValueTransformation", "RealWorldValueMapping", "MRDiffusion"),
    *("SegmentIdentification", "DetectorInformation"),
    *("TemporalPosition", "CardiacSynchronization"),
)
# What differs between frames at one place, and dimensions that are the place itself: stack,
# position in it, position in the patient.
_REPEATS = (
    *("TemporalPositionIndex", "TemporalPositionTimeOffset", "NominalCardiacTriggerDelayTime"),
    *("NominalPercentageOfCardiacPhase", "EffectiveEchoTime", "DiffusionBValue"),
)
_PLACES = (0x00209056, 0x00209057, 0x00200032)
# Units by DICOM's codes: of PET, of doses, and in Rescale Type.
_UNITS = {"BQML": "Bq/ml", "CNTS": "counts", "CPS": "counts/s", "GML": "g/ml", "PCNT": "%"}
_UNITS |= {"GY": "Gy", "MGML": "mg/ml", "PCT": "%"}
_UNIT_TAGS = {"PT": "Units", "RTDOSE": "DoseUnits"}
# What pydicom says of compressions that no installed decoder reads, such as JPEG of 12 bits.
_NO_DECODER = re.compile("does not support|missing dependencies")
DEFLATED = "1.2.840.10008.1.2.1.99"
"""Transfer syntax of files that are compressed as a whole."""
# Texts of a file's header, by DICOM's keywords.
_TEXTS = (
    *("SOPInstanceUID", "SeriesInstanceUID", "StudyInstanceUID", "ConcatenationUID", "PatientID"),
    *("SeriesNumber", "SeriesDescription", "Modality", "ImageType", "PatientName"),
)


@dataclass(frozen=True, slots=True, eq=False)
class File:
    """Header of a DICOM file, without its frames."""

    path: Path
    texts: Mapping[str, str]  # by DICOM's keywords; empty if not stated
    unit: str  # of the values
    start_mm: NDArray[np.float64] | None  # position of the file as a whole
    detector_mm: Sequence[float]  # of pixels at the detector, along y and x, if stated
    segments: dict[int, Label] | None
    half: float  # least value of a segment
    layout: dict[str, Any]  # rows, columns, bits, transfer syntax, as pydicom's decoders take them
    shift: int  # unused bits below the stored ones
    modality_lut: tuple[int, NDArray[Any]] | None  # first stored value, and what all of them mean
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
        return (
            (self.size, self.components) == (other.size, other.components)
            and np.allclose(self.directions, other.directions, atol=2e-3)
            and len(self.pixel_mm) == len(other.pixel_mm)
            and np.allclose(self.pixel_mm, other.pixel_mm, 1e-3, 0)
        )


def frames_of(file: BinaryIO, parsed: Any, layout: dict[str, Any]) -> list[Slice]:
    """Return the frames of a parsed file, whose pixels have a layout."""
    count = layout["number_of_frames"] = int(layout["number_of_frames"])
    shared = _groups(*parsed.get("SharedFunctionalGroupsSequence") or ())
    frames = [_groups(item) for item in parsed.get("PerFrameFunctionalGroupsSequence") or ()]
    groups = [[*frame, *shared] for frame in frames[:count]] + [shared] * (count - len(frames))
    dataset = [parsed, *_groups(parsed)]
    header = _file(file, parsed, layout, groups[0], dataset)
    start = header.start_mm
    dimensions = parsed.get("DimensionIndexSequence") or ()
    pointers = [dimension.get("DimensionIndexPointer") for dimension in dimensions]
    offsets = _offsets_mm(parsed, dataset, count)
    slices = []
    for k, frame in enumerate(groups):
        scope = [*frame, *dataset]
        orientation = _directions(scope)
        directions = np.eye(3) if orientation is None else orientation
        origin = _vector("ImagePositionPatient", frame if count > 1 else scope)
        in_patient = orientation is not None and (origin is not None or start is not None)
        if origin is None and count > 1 and offsets:
            origin = (0 if start is None else start) + directions[:, 2] * offsets[k]
        indices = zip(pointers, _numbers("DimensionIndexValues", frame), strict=False)
        order = [_number(name, frame) or 0 for name in _REPEATS]
        order += [index for pointer, index in indices if pointer not in _PLACES]
        slices.append(
            Slice(
                file=header,
                frame=k,
                order=(*order, _number("InstanceNumber", dataset) or 0, k),
                pixel_mm=_pixel_mm("PixelSpacing", scope),
                directions=directions,
                origin_mm=origin,
                in_patient=in_patient,
                apart_mm=_number("SpacingBetweenSlices", scope) or _number("SliceThickness", scope),
                rescale=_rescale(frame, scope),
                segment=int(_number("ReferencedSegmentNumber", frame) or 0),
            )
        )
    return slices


def _file(
    file: BinaryIO, parsed: Any, layout: dict[str, Any], groups: list[Any], dataset: list[Any]
) -> File:
    """Return a file's header; ``groups`` are the first frame's."""
    bits, high = layout.get("bits_stored", 0), _number("HighBit", dataset) or 0
    shift = max(int(high) + 1 - bits, 0) if bits else 0
    layout["bits_stored"] = bits + shift
    is_fraction = text_of("SegmentationType", parsed) == "FRACTIONAL"
    segments = parsed.get("SegmentSequence")
    return File(
        path=Path(file.name),
        texts={keyword: text_of(keyword, parsed) for keyword in _TEXTS},
        unit=_unit(parsed, groups, [*groups, *dataset]),
        start_mm=_vector("ImagePositionPatient", dataset),
        detector_mm=_pixel_mm("ImagerPixelSpacing", dataset)
        or _pixel_mm("NominalScannedPixelSpacing", dataset),
        segments=None if segments is None else {int(s.SegmentNumber): _label(s) for s in segments},
        half=(_number("MaximumFractionalValue", dataset) or 255) / 2 if is_fraction else 1,
        layout=layout,
        shift=shift,
        modality_lut=_modality_lut(parsed, layout["transfer_syntax_uid"]),
        state=_state(file),
    )


@contextmanager
def lenient() -> Iterator[None]:
    """Accept values that break DICOM's rules, without warnings."""
    from pydicom import config

    with warnings.catch_warnings(), config.disable_value_validation():
        warnings.simplefilter("ignore")
        yield


def _state(file: BinaryIO) -> tuple[int, int]:
    """Return what changes with a file's contents."""
    status = os.fstat(file.fileno())
    return status.st_size, status.st_mtime_ns


def text_of(keyword: str, *places: Any) -> str:
    """Return the first statement of a text in several places; empty if there is none."""
    texts = ("\\".join(map(str, _values(keyword, place))).strip(" \0") for place in places)
    return next(filter(None, texts), "")


def _values(keyword: str, place: Any) -> Sequence[Any]:
    """Return the values of an element; none if it is missing or empty."""
    value = place.get(keyword)
    many = isinstance(value, Sequence) and not isinstance(value, str)
    return value if many else [] if value in (None, "") else [value]


def _groups(*items: Any) -> list[Any]:
    sequences = (item.get(f"{name}Sequence") for item in items for name in _GROUPS)
    return [group[0] for group in sequences if group]


def _numbers(keyword: str, places: Sequence[Any], count: int | None = None) -> list[float]:
    """Return the first statement of finite numbers in several places; none if there is none."""
    for place in places:
        with suppress(ValueError, TypeError, OverflowError):  # no numbers
            numbers = [float(value) for value in _values(keyword, place)]
            if numbers and len(numbers) == (count or len(numbers)) and np.isfinite(numbers).all():
                return numbers
    return []


def _number(keyword: str, places: Sequence[Any]) -> float | None:
    return next(iter(_numbers(keyword, places, 1)), None)


def _vector(keyword: str, places: Sequence[Any]) -> NDArray[np.float64] | None:
    numbers = _numbers(keyword, places, 3)
    return np.array(numbers) if numbers else None


def _pixel_mm(keyword: str, places: Sequence[Any]) -> list[float]:
    """Return distances along y and x; none unless they are stated, and positive."""
    numbers = _numbers(keyword, places, 2)
    return numbers if all(number > 0 for number in numbers) else []


def _directions(places: Sequence[Any]) -> NDArray[np.float64] | None:
    """Return unit vectors along columns, rows and slices, as columns; None if not stated."""
    x, y = np.reshape(_numbers("ImageOrientationPatient", places, 6) or np.zeros(6), (2, 3))
    vectors = np.array([x, y, np.cross(x, y)])
    lengths = np.linalg.norm(vectors, axis=1)
    return (vectors / lengths[:, None]).T if lengths[2] > 0.5 else None  # else parallel


def _offsets_mm(parsed: Any, dataset: Sequence[Any], count: int) -> list[float]:
    """Return the distances of frames from the first position; none if they are not stated.

    Doses have them (GridFrameOffsetVector), and nuclear medicine (SliceVector).
    """
    if offsets := _numbers("GridFrameOffsetVector", [parsed], count):
        return [offset - offsets[0] for offset in offsets]
    gap_mm = _number("SpacingBetweenSlices", dataset) or 0
    return [(number - 1) * gap_mm for number in _numbers("SliceVector", [parsed], count) if gap_mm]


def _rescale(groups: Sequence[Any], scope: Sequence[Any]) -> tuple[float, float]:
    """Return slope and intercept of a frame; of real-world values only if no others are stated."""
    slope, intercept = _number("RescaleSlope", scope), _number("RescaleIntercept", scope)
    if slope is None and intercept is None:
        slope = _number("DoseGridScaling", scope) or _number("RealWorldValueSlope", groups)
        intercept = _number("RealWorldValueIntercept", groups)
    return 1.0 if slope is None else slope, intercept or 0.0


def _modality_lut(parsed: Any, syntax: Any) -> tuple[int, NDArray[Any]] | None:
    """Return the first stored value that a Modality LUT maps, and its output; None without one."""
    if not (sequence := parsed.get("ModalityLUTSequence")):
        return None
    entries, first, _ = map(int, sequence[0].LUTDescriptor)
    data, count = sequence[0].LUTData, entries or 1 << 16
    if isinstance(data, bytes):  # words, or bytes that are padded to a word
        order = "<" if syntax.is_little_endian else ">"
        data = np.frombuffer(data, f"{order}u2" if len(data) >= 2 * count else np.uint8)
    table = np.array(data[:count], np.uint16)
    if len(table) < count:
        raise ValueError("Modality LUT")
    return first, table


def _unit(parsed: Any, groups: Sequence[Any], scope: Sequence[Any]) -> str:
    """Return the unit of rescaled values; without a Rescale Type a CT's is HU (C.8.2.1)."""
    luts = parsed.get("ModalityLUTSequence") or ()
    kind = text_of("RescaleType", *scope) or text_of("ModalityLUTType", *luts)
    modality = text_of("Modality", parsed)
    is_rescaled = bool(luts) or _number("RescaleIntercept", scope) is not None
    if modality == "CT" and is_rescaled and kind in ("", HU):
        return "" if "LOCALIZER" in text_of("ImageType", parsed) else HU
    if modality in _UNIT_TAGS or is_rescaled:
        tag = _UNIT_TAGS.get(modality)
        return _UNITS.get(text_of(tag, *scope) if tag else kind, "")
    codes = [code for group in groups for code in group.get("MeasurementUnitsCodeSequence") or ()]
    code = text_of("CodeValue", *codes)
    return "" if code == "1" else code  # UCUM's


def _label(segment: Any) -> Label:
    """Return the name and the colour of a segment."""
    kinds = segment.get("SegmentedPropertyTypeCodeSequence") or ()
    name = text_of("SegmentLabel", segment) or text_of("CodeMeaning", *kinds)
    codes = _numbers("RecommendedDisplayCIELabValue", [segment], 3)
    if not codes:
        return Label(name)
    # Few files are segmentations, and these imports take longer than to read one.
    from volspec.appearance.display import (
        D50_XYZ,
        D50_from_white,
        encode_sRGB,
        linear_sRGB_from_XYZ,
        sRGB_WHITE_XYZ,
    )
    from volspec.appearance.models import XYZ_from_cielab

    Lab = np.multiply(codes, (100, 255, 255)) / 65535 - (0, 128, 128)
    XYZ = np.linalg.solve(D50_from_white(sRGB_WHITE_XYZ), XYZ_from_cielab(Lab, D50_XYZ))
    red, green, blue = encode_sRGB(linear_sRGB_from_XYZ(XYZ)).round(4).tolist()
    return Label(name, (red, green, blue))


def read_values(one: Slice) -> NDArray[Any]:
    """Read a slice's values (Y, X), rescaled, of the narrowest type that holds them."""
    values = _stored_values(one)
    if one.file.modality_lut is not None:
        first, table = one.file.modality_lut
        return np.take(table, values.astype(np.int64) - first, mode="clip")
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
            if _state(stream) != file.state:
                raise VolumeError(
                    f"{file.path}: changed while the series was being read; read it again",
                    code="state",
                )
            decoder = get_decoder(syntax)
            if layout["bits_allocated"] == 1 and decoder.is_native and syntax != DEFLATED:
                return _bits(one)
            stream.seek(layout["offset"])
            source = _read_deflated(file.path, file.state) if syntax == DEFLATED else stream
            values, _ = decoder.as_array(source, index=one.frame, raw=True, **layout)
    except (VolumeError, MemoryError):
        raise
    except Exception as error:  # of any kind: the bytes may be anything
        is_unknown = isinstance(error, NotImplementedError) or _NO_DECODER.search(str(error))
        raise VolumeError(
            f"{file.path}: its pixels are compressed as {syntax.name}, which needs a decoder"
            if is_unknown
            else f"{file.path}: its pixels ({syntax.name}) are damaged or truncated",
            f"{install_command('dicom')}, or export it uncompressed"
            if is_unknown
            else "copy it again, or take it out of the folder",
            code="unsupported" if is_unknown else "damaged",
        ) from error
    return values >> file.shift if file.shift else values


def _bits(one: Slice) -> NDArray[np.uint8]:
    """Read pixels of one bit; pydicom reads frames that begin within a byte too short."""
    columns, rows = one.size
    count = rows * columns
    start, skipped = divmod(one.frame * count, 8)
    offset = one.file.layout["offset"] + start
    packed = np.fromfile(one.file.path, np.uint8, -(-(skipped + count) // 8), offset=offset)
    return np.unpackbits(packed, bitorder="little")[skipped:][:count].reshape(rows, columns)


@lru_cache(maxsize=1)
def _read_deflated(path: Path, state: tuple[int, int]) -> Any:
    """Return the elements of a file that is compressed as a whole."""
    from pydicom import dcmread

    return dcmread(path)
