"""NIfTI, Analyze, FreeSurfer, AFNI, Philips and MINC files, by nibabel.

    nibabel's header -> Layout -> [neuro] -> Reading

nibabel reads headers and chooses between a file's maps to the world. Voxels are read by `Layout`,
which neither scales more than is asked for nor fills in what is missing; those of PAR/REC and MINC,
whose slices have a scale each, by nibabel.

References
----------
[1] nifti1.h and nifti2.h, R. W. Cox et al.: x, y, z follow from the sform (method 3) or the qform
    (method 2) alone if its code is above 0, else from pixdim without an orientation (method 1).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolumeError, one_line
from volspec.volume.files.label_tables import labels_in_xml
from volspec.volume.files.lattice import LPS_FROM_RAS, affine, mm_per_unit
from volspec.volume.files.layout import TRUNCATED, Layout, choose_axes, require_data
from volspec.volume.files.presence import GZIP, is_packed, open_unpacked
from volspec.volume.files.query import Query, Reading
from volspec.volume.labels import Labels
from volspec.volume.metadata import NO_UNIT, Metadata

PAIRS = (".hdr", ".hdr.gz", ".img", ".img.gz")
"""Endings of NIfTI and Analyze in two files."""
# NIfTI's code of the intent "label".
_LABELS = 1002
# Bytes of headers, and the most of extensions that are searched for names.
_NIFTI_1, _NIFTI_2, _MAX_EXTENSION = 348, 540, 1 << 24
_SECONDS = {"sec": 1.0, "msec": 1e-3, "usec": 1e-6}
# Radians between the axes of two maps from which on it is said which of them is taken.
_TURNED = 0.01
_PATIENT = Metadata(is_patient=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Opened:
    """An image of which the header is read."""

    header: Any
    proxy: Any  # nibabel's, of the voxels
    data: Path
    packed: bool  # by gzip
    world: NDArray[np.float64] | None  # nibabel's map to RAS, if the file states where axes lead
    extensions: bytes = b""  # of a NIfTI header

    @classmethod
    def of(cls, path: Path) -> _Opened:
        """Read a header; a file is unpacked if it is packed, whatever its name says."""
        import nibabel

        with _wrap_errors(path):
            packed = is_packed(path)
        with _wrap_errors(path), open_unpacked(path) as file:
            head = file.read(_NIFTI_2)
            named = path.name.lower().endswith((".nii", ".nii.gz"))
            if named or head[344:347] == b"n+1" or head[4:7] == b"n+2":
                return cls._of_nifti(path, head, file, packed)
        with _wrap_errors(path):
            if path.name.lower().endswith((".mgh", ".mgz")):
                with open_unpacked(path) as file:
                    holder = nibabel.fileholders.FileHolder(str(path), file)
                    image: Any = nibabel.MGHImage.from_file_map({"image": holder})
            else:
                _require_header(path)
                image = nibabel.load(path)
        data = Path(image.file_map["image"].filename)
        require_data(path, data)
        if data != path:
            packed = data.name.lower().endswith(".gz")
        world = image.affine if _is_oriented(image) else None
        return cls(image.header, image.dataobj, data, packed, world)

    @classmethod
    def _of_nifti(cls, path: Path, head: bytes, file: Any, packed: bool) -> _Opened:
        """Read a header as it is: nibabel's own way changes or refuses what can be understood."""
        from nibabel import Nifti1Header, Nifti2Header
        from nibabel.arrayproxy import ArrayProxy

        magics = {b"n+1\0": (Nifti1Header, _NIFTI_1), b"n+2\0": (Nifti2Header, _NIFTI_2)}
        kind, size = magics.get(head[344:348]) or magics.get(head[4:8]) or (None, 0)
        if head.startswith(GZIP):
            raise VolumeError(
                f"{path}: is packed by gzip twice",
                f"unpack it once: gunzip -c {path} > once-{path.name}",
                code="damaged",
            )
        if kind is None or len(head) < size or size not in _sizes(head):
            raise VolumeError(
                f"{path}: is no NIfTI image; is the file complete and of the type its name says?",
                code="damaged",
            )
        header = kind(head[:size], check=False)
        dtype = np.dtype(np.void)
        with suppress(Exception):  # of nibabel's own
            dtype = header.get_data_dtype()
        if not dtype.itemsize:
            raise VolumeError(
                f"{path}: its values have NIfTI type {int(header['datatype'])}, which this machine "
                "has no numbers for",
                "save it with another type, such as float32 by nibabel",
                code="unsupported",
            )
        start = float(header["vox_offset"])
        first = int(start) if size + 4 <= start < 2**40 else size + 4
        extensions = (head + file.read(min(first, _MAX_EXTENSION)))[size:first]
        slope, shift = header.get_slope_inter() if np.isfinite(header["scl_slope"]) else (1, 0)
        arguments = header.get_data_shape(), dtype, first, slope or 1, shift or 0
        return cls(header, ArrayProxy(os.fspath(path), arguments), path, packed, None, extensions)


def _require_header(path: Path) -> None:
    """Refuse the voxels of a pair without their header."""
    name = path.name.lower().removesuffix(".gz")
    if name.endswith(".img"):
        stem = path.name[: len(name) - 4]
        names = [f"{stem}{end}" for end in (".hdr", ".HDR", ".hdr.gz")]
        if not any((path.parent / name).is_file() for name in names):
            raise VolumeError(
                f"{path}: its header is in {names[0]}, which is not there",
                f"copy it into {path.parent}, next to the voxels",
                code="not-found",
            )


def _sizes(head: bytes) -> tuple[int, int]:
    """Return the size that a NIfTI header states, in either byte order."""
    return int.from_bytes(head[:4], "little"), int.from_bytes(head[:4], "big")


def read_neuro(query: Query) -> Reading:
    """Read a 3-D image, or one time step and one component of it."""
    path = query.path
    query.allow("time", "channel")
    opened = _Opened.of(path)
    shape = tuple(int(count) for count in opened.proxy.shape)
    while len(shape) > 3 and shape[-1] == 1:
        shape = shape[:-1]
    time_first = path.name.lower().endswith(".mnc") and len(shape) == 4
    if time_first:
        shape = (*shape[1:], shape[0])
    dtype = np.dtype(getattr(opened.proxy, "dtype", np.float32))
    if dtype.kind == "c":
        raise VolumeError(
            f"{path}: its values are complex numbers",
            "save their magnitude, such as with nibabel and numpy.abs",
            code="unsupported",
        )
    # Colours are the fastest axis; time is the fourth of the others, and a fifth has components.
    if dtype.names:
        shape, dtype = (len(dtype.names), *shape), dtype[0]
    first = int(len(opened.proxy.shape) < len(shape))
    roles = {0: "channel"} if first else {}
    roles |= dict.fromkeys(range(first + 3, first + 4), "time") if len(shape) > first + 3 else {}
    roles |= dict.fromkeys(range(first + 4, len(shape)), "channel")
    picked = choose_axes(query, shape, roles, _step_s(opened.header))
    notes: list[str] = []
    world, metadata = _world_from_index(opened, query, notes)
    labels = _labels(opened)
    layout = _layout(path, opened, dtype, shape)
    if layout is not None:
        # FreeSurfer writes how the image was made after its voxels.
        ends = path.name.lower().endswith((".mgh", ".mgz"))
        values = layout.read(picked, query, [] if ends else notes)
    else:
        query.reserve(shape[:3], dtype.itemsize)
        index: tuple[Any, ...] = (..., *(picked[axis] for axis in range(3, len(shape))))
        with _wrap_errors(path):
            part = opened.proxy[index[::-1] if time_first else index]
        values = np.asarray(part, np.float32).T
        values = values.reshape(values.shape[-3:])
    return Reading(values, world_from_index=world, notes=notes, labels=labels, metadata=metadata)


@contextmanager
def _wrap_errors(path: Path) -> Iterator[None]:
    """Turn whatever nibabel raises for a damaged file into a one-line error."""
    try:
        yield
    except (VolumeError, PermissionError):
        raise
    except EOFError as error:
        raise VolumeError(f"{path}: {TRUNCATED}", code="damaged") from error
    except Exception as error:
        if isinstance(error, FileNotFoundError) and error.filename:
            require_data(path, Path(error.filename))
        raise VolumeError(
            f"{path}: cannot be read ({one_line(error)}); is the file complete and of the type "
            "its name says?",
            code="damaged",
        ) from error


def _layout(
    path: Path, opened: _Opened, dtype: np.dtype[Any], shape: tuple[int, ...]
) -> Layout | None:
    """Return the place of the voxels; None if only nibabel can assemble them."""
    from nibabel.arrayproxy import ArrayProxy

    proxy = opened.proxy
    by_part = getattr(proxy, "_scaling", None) is not None  # AFNI's
    if not isinstance(proxy, ArrayProxy) or by_part:
        return None
    encoding, start = "gzip" if opened.packed else "raw", int(proxy.offset)
    scaling = float(proxy.slope), float(proxy.inter)
    return Layout(path, (opened.data,), dtype, shape, encoding, skip=start, scaling=scaling)


def _step_s(header: Any) -> float | None:
    """Return the time between steps, if it is stated."""
    zooms = header.get_zooms()
    if len(zooms) < 4 or not hasattr(header, "get_xyzt_units"):
        return None
    second = _SECONDS.get(_units(header)[1])
    return second * float(zooms[3]) if second and 0 < zooms[3] < np.inf else None


def _world_from_index(
    opened: _Opened, query: Query, notes: list[str]
) -> tuple[NDArray[np.float64], Metadata]:
    """Return the map to millimetres in LPS; without an orientation, that of the spacing alone."""
    header = opened.header
    if not hasattr(header, "get_xyzt_units"):
        if opened.world is None:
            return _spacing_affine(header), Metadata()
        return LPS_FROM_RAS @ opened.world, _PATIENT
    unit_mm = mm_per_unit(_units(header)[0])
    assumed = (NO_UNIT,) if unit_mm is None else ()
    unit_mm = unit_mm or 1.0
    maps = {name: _map(header, name) for name in ("sform", "qform") if header[f"{name}_code"] > 0}
    usable = [matrix for matrix in maps.values() if matrix is not None]
    broken = next((name for name, matrix in maps.items() if matrix is None), "")
    if broken and not usable and query.spacing_mm is None:
        raise VolumeError(
            f"{query.path}: its {broken}, the map to millimetres, holds NaN, infinity or an axis "
            "without a direction",
            f"give the spacing, as {query.example(spacing='1,1,1')}",
            code="damaged",
        )
    if broken == "sform" and usable:
        notes.append(
            f"{query.path}: its sform holds NaN, infinity or an axis without a direction; its "
            "qform is taken"
        )
    if not usable:
        return _spacing_affine(header, unit_mm), Metadata(assumed=assumed)
    if len(usable) == 2 and _axes_differ(*usable):
        notes.append(
            f"{query.path}: its sform (code {int(header['sform_code'])}) and its qform (code "
            f"{int(header['qform_code'])}) lead to different directions; the sform is taken, as by "
            "nibabel"
        )
    world = LPS_FROM_RAS @ np.diag([unit_mm, unit_mm, unit_mm, 1.0]) @ usable[0]
    return world, replace(_PATIENT, assumed=assumed)


def _units(header: Any) -> tuple[str, str]:
    """Return the units of space and time; unknown if their codes are none of NIfTI's."""
    try:
        space, time = header.get_xyzt_units()
    except KeyError:
        return "unknown", "unknown"
    return str(space), str(time)


def _map(header: Any, name: str) -> NDArray[np.float64] | None:
    """Return a header's sform or qform (4, 4) as nifti1.h says; None if it is no map."""
    header = header.copy()
    sizes = np.abs(header["pixdim"][1:4])  # without a sign of their own
    sizes = np.where(sizes > 0, sizes, 1.0)
    header["pixdim"][:4] = [-1.0 if header["pixdim"][0] < 0 else 1.0, *sizes]
    try:
        with np.errstate(all="ignore"):
            matrix = np.asarray(getattr(header, f"get_{name}")(), np.float64)
            columns = matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0)
            is_map = np.isfinite(matrix).all() and abs(np.linalg.det(columns)) > 1e-6
    except Exception:  # whatever nibabel raises for a quaternion that is none
        return None
    return matrix if is_map else None


def _is_oriented(image: Any) -> bool:
    """Return True for an image other than NIfTI whose file states where its axes lead."""
    from nibabel import MGHImage
    from nibabel.analyze import AnalyzeHeader

    if isinstance(image.header, AnalyzeHeader):  # only SPM's file of a matrix next to it says so
        beside = image.file_map.get("mat")
        return beside is not None and Path(beside.filename).exists()
    return not isinstance(image, MGHImage) or bool(image.header["goodRASFlag"] > 0)


def _axes_differ(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return True if an axis of two maps leads elsewhere."""
    with np.errstate(invalid="ignore", divide="ignore"):
        columns = [m[:3, :3] / np.linalg.norm(m[:3, :3], axis=0) for m in (one, other)]
    return bool((columns[0] * columns[1]).sum(axis=0).min() < np.cos(_TURNED))


def _spacing_affine(header: Any, unit_mm: float = 1.0) -> NDArray[np.float64]:
    """Return the map of a header without an orientation; 0 and what is no number count as 1."""
    zooms = np.abs(np.array(header.get_zooms()[:3], np.float64))
    zooms = np.where((zooms > 0) & np.isfinite(zooms), zooms, 1.0)
    sides = np.zeros(3)  # the third of a picture is not stated
    sides[: len(zooms)] = zooms * unit_mm
    return affine(np.diag(sides), (0.0, 0.0, 0.0))


def _labels(opened: _Opened) -> Labels | None:
    """Return the labels that a NIfTI header states; None if it does not say that it holds any."""
    head, order = opened.extensions, getattr(opened.header, "endianness", "<")
    offset = 4
    while head[:1] > b"\0" and offset + 8 <= len(head):
        nbytes, _ = struct.unpack_from(order + "2i", head, offset)
        if nbytes < 8:
            break
        if labels := labels_in_xml(head[offset + 8 : offset + nbytes].decode("utf-8", "replace")):
            return labels
        offset += nbytes
    with suppress(KeyError, ValueError, IndexError, TypeError):  # of headers other than NIfTI
        return {} if int(opened.header["intent_code"]) == _LABELS else None
    return None
