"""VTK image data and evenly spaced rectilinear grids, read with pyvista.

    file, or pieces or blocks that it names -> [vtk] -> Reading

XML (``.vti .vtr``, in pieces ``.pvti .pvtr``, in blocks ``.vtm .vtmb``), legacy ``.vtk`` and HDF5
(``.vtkhdf``). Lengths are checked first: VTK leaves missing voxels uninitialised.

References
----------
[1] VTK File Formats, docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

from __future__ import annotations

import base64
import binascii
import logging
import math
import struct
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.parsers import expat

from volspec._extras import require_extra
from volspec.errors import VolumeError
from volspec.volume.channels import Channel
from volspec.volume.files.layout import TRUNCATED, damage_error, data_files
from volspec.volume.files.query import Query, Reading
from volspec.volume.files.vtk_grid import scalar_names, values_and_lattice
from volspec.volume.metadata import NO_UNIT, Metadata

# Bits of the legacy format's types; vtkIdType is stored as int.
_LEGACY_BITS = {
    **dict.fromkeys(("bit",), 1),
    **dict.fromkeys(("char", "signed_char", "unsigned_char"), 8),
    **dict.fromkeys(("short", "unsigned_short"), 16),
    **dict.fromkeys(("int", "unsigned_int", "vtkidtype", "float"), 32),
    **dict.fromkeys(("long", "unsigned_long", "vtktypeint64", "vtktypeuint64", "double"), 64),
}
_XML_BYTES = {
    f"{kind}{bits}": bits // 8 for kind in ("Int", "UInt", "Float") for bits in (8, 16, 32, 64)
}
_HEADER_TYPES = {"UInt32": "I", "UInt64": "Q"}
# Components of the legacy format's arrays that state none.
_LEGACY_COMPONENTS = {"vectors": "3", "normals": "3", "tensors": "9", "tensors6": "6"}
_BLOCKS, _IMAGES = (".vtm", ".vtmb"), (".vti", ".vtr", ".pvti", ".pvtr")
# Greatest depth of elements: VTK's files have seven levels, and its parser recurses.
_DEEPEST = 32
_CHUNK = 1 << 20
_UNREADABLE = "not readable as VTK image data"


def read_vtk(query: Query) -> Reading:
    """Read a grid; of several arrays or components one, of several blocks the one named."""
    if query.path.suffix.lower() in _BLOCKS:
        return _read_block(query)
    query.allow("channel")
    check_vtk(query)
    grid = _grid(query)
    fields = scalar_names(grid, str(query.path), query)
    names = [name if part is None else f"{name} {part}" for name, part in fields]
    noun = "channels (arrays and components)"
    number = query.index("channel", len(names), noun, names)
    query.end_choices()
    name = str(query.path)
    values, world, notes = values_and_lattice(grid, *fields[number], name, query)
    channel = Channel(names[number]) if len(names) > 1 else None
    metadata = Metadata(assumed=(NO_UNIT,))
    return Reading(values, None, world, notes, None, channel, metadata)


def _grid(query: Query) -> Any:
    """Read a file with pyvista, whose errors become one line."""
    require_extra("vtk", str(query.path))
    import pyvista
    from pyvista.core.utilities.observers import VtkErrorCatcher
    from vtkmodules.vtkCommonCore import vtkLogger, vtkObject

    # VTK prints its errors and pyvista logs them again; both are replaced by one line.
    before = vtkLogger.GetCurrentVerbosityCutoff()
    # If another library has switched off VTK's warnings, errors would not be caught either.
    warnings_shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.SetGlobalWarningDisplay(1)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)
    logging.disable(logging.ERROR)
    try:
        with VtkErrorCatcher(raise_errors=True, send_to_logging=False), warnings.catch_warnings():
            # pyvista turns errors that it catches into warnings.
            warnings.filterwarnings("error", ".*raised an error while reading", UserWarning)
            return pyvista.read(query.path)
    except (OSError, ValueError, RuntimeError, TypeError, UserWarning) as error:
        raise damage_error(query.path, _UNREADABLE) from error
    finally:
        logging.disable(logging.NOTSET)
        vtkLogger.SetStderrVerbosity(before)
        vtkObject.SetGlobalWarningDisplay(warnings_shown)


def _read_block(query: Query) -> Reading:
    """Read the only block of image data, or the one that ``dataset=`` names."""
    members = _XmlHeader(query.path).files
    names = [key for key, file in members.items() if file.lower().endswith(_IMAGES)]
    if not names:
        listed = ", ".join(sorted({Path(file).suffix for file in members.values()})) or "no file"
        raise VolumeError(
            f"{query.path}: none of its blocks is image data; they are {listed}",
            "resample one to image data in ParaView (Resample To Image)",
            code="unsupported",
        )
    files = data_files(query.path, [members[name] for name in names])
    blocks = dict(zip(names, files, strict=True))
    name = query.array_named({name: _XmlHeader(path).counts for name, path in blocks.items()})
    options = {key: value for key, value in query.options.items() if key != "dataset"}
    return read_vtk(replace(query, path=blocks[name], options=options))


def check_vtk(query: Query) -> None:
    """Refuse a file with arrays longer than the file, or than memory."""
    suffix = query.path.suffix.lower()
    if suffix == ".vtkhdf":
        _reserve_hdf(query)
    elif suffix not in _IMAGES:
        _check_legacy(query)
    else:
        header = _XmlHeader(query.path)
        nbytes = header.check(query)
        for piece in data_files(query.path, [*header.files.values()]) if header.files else ():
            nbytes += _XmlHeader(piece).check(replace(query, path=piece))
        if nbytes:
            query.reserve((nbytes,), 1)


def _reserve_hdf(query: Query) -> None:
    """Refuse image data in HDF5 that exceed memory, with 8 bytes for a value of each array."""
    from vtkmodules.vtkIOHDF import vtkHDFReader

    reader = vtkHDFReader()
    reader.SetFileName(str(query.path))
    reader.UpdateInformation()
    extent = reader.GetOutputInformation(0).Get(reader.GetExecutive().WHOLE_EXTENT())
    if extent is not None:
        sides = [high - low + 1 for low, high in zip(extent[::2], extent[1::2], strict=True)]
        arrays = reader.GetNumberOfPointArrays() + reader.GetNumberOfCellArrays()
        query.reserve(sides, 8 * max(arrays, 1))


def _check_legacy(query: Query) -> None:
    """Refuse a legacy file with arrays longer than the file, or than memory."""
    path = query.path
    size = path.stat().st_size
    nbytes = 0
    with path.open("rb") as file:
        binary = [file.readline(256) for _ in range(3)][2].strip().upper() == b"BINARY"
        tuples = "0"
        while line := file.readline(4096):
            match line.decode("latin-1").lower().split():
                case ["point_data" | "cell_data", tuples]:
                    continue
                case ["scalars", _, kind, *components]:
                    file.readline(4096)  # the lookup table's name
                    counts = [*(components or ["1"]), tuples]
                case ["vectors" | "normals" | "tensors" | "tensors6" as what, _, kind]:
                    counts = [_LEGACY_COMPONENTS[what], tuples]
                case ["color_scalars", _, components]:
                    kind, counts = "unsigned_char", [components, tuples]
                case [_, per_tuple, count, kind]:  # an array of a FIELD
                    counts = [per_tuple, count]
                case _:  # other words, or data of arrays that are no channels
                    continue
            if kind not in _LEGACY_BITS or not all(n.isdecimal() for n in counts):
                continue
            values = math.prod(map(int, counts))
            stored = -(-values * _LEGACY_BITS[kind] // 8)
            nbytes += stored
            # VTK itself detects missing ASCII values; a value and a space take two bytes.
            total = file.tell() + (stored if binary else 2 * values - 1)
            if total > size:
                raise VolumeError(
                    f"{path}: holds {size} bytes, its header declares {total} or more; {TRUNCATED}",
                    code="damaged",
                )
            if not binary:
                break
            file.seek(stored, 1)
    if nbytes:
        query.reserve((nbytes,), 1)


@dataclass(slots=True)
class _Array:
    """Location and declared length of a ``DataArray`` element's bytes."""

    values: int
    itemsize: int
    form: str
    offset: int
    # For inline data: the first characters, and counts of characters and words.
    text: str = ""
    length: int = 0
    words: int = 0


class _AppendedData(Exception):
    """End of the XML: appended data follow."""


class _XmlHeader:
    """Elements of an XML file, up to its appended data."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.arrays: list[_Array] = []
        self.files: dict[str, str] = {}  # pieces, or blocks by their names
        self.counts: list[int] = []  # points along x, y, z of the whole
        self._order, self._word, self._compressed = "<", "I", False
        # Encoding of appended data, and the first byte after their underscore.
        self._encoding, self._start = "", 0
        self._open: list[str] = []
        self._array: _Array | None = None
        # Points and cells of the current piece; cells of all pieces so far, and of the whole.
        self._points = self._cells = self._covered = self._total = 0
        self._parse()

    def _parse(self) -> None:
        size = self.path.stat().st_size
        with self.path.open("rb") as file:
            file.seek(max(size - 1024, 0))
            if b"</VTKFile>" not in file.read():
                problem = f"{_UNREADABLE}, </VTKFile> is missing; {TRUNCATED}"
                raise VolumeError(f"{self.path}: {problem}", code="damaged")
            file.seek(0)
            parser = expat.ParserCreate()
            parser.StartElementHandler = lambda name, attrs: self._begin(parser, name, attrs)
            parser.EndElementHandler = self._end
            parser.CharacterDataHandler = self._text
            try:
                with suppress(_AppendedData):
                    while chunk := file.read(_CHUNK):
                        parser.Parse(chunk)
                if self._start:
                    file.seek(self._start)
                    head = file.read(_CHUNK)
                    self._start += head.index(b"_", head.index(b">")) + 1
            except (expat.ExpatError, ValueError, LookupError) as error:
                raise damage_error(self.path, _UNREADABLE) from error

    def _begin(self, parser: Any, name: str, attrs: dict[str, str]) -> None:
        self._open.append(name)
        if len(self._open) > _DEEPEST:
            raise ValueError("nested too deeply")
        if name == "VTKFile":
            self._order = ">" if attrs.get("byte_order") == "BigEndian" else "<"
            self._word = _HEADER_TYPES[attrs.get("header_type", "UInt32")]
            self._compressed = bool(attrs.get("compressor"))
        elif name.removeprefix("P") in ("ImageData", "RectilinearGrid"):
            self.counts = _counts(attrs["WholeExtent"])
            self._total = _cells(self.counts)
        elif name == "Piece":
            counts = _counts(attrs["Extent"])
            self._points, self._cells = math.prod(counts), _cells(counts)
            self._covered += self._cells
            if source := attrs.get("Source"):
                self.files[source] = source
        elif name == "DataSet" and (file := attrs.get("file")):
            called = attrs.get("name", "").strip("/")
            self.files[called if called not in ("", *self.files) else Path(file).stem] = file
        elif name == "DataArray" and self._open[-2] in ("PointData", "CellData"):
            tuples = self._points if self._open[-2] == "PointData" else self._cells
            values = tuples * max(int(attrs.get("NumberOfComponents", "1")), 1)
            place = attrs.get("format", "ascii"), int(attrs.get("offset", "0"))
            self._array = _Array(values, _XML_BYTES[attrs["type"]], *place)
            self.arrays.append(self._array)
        elif name == "AppendedData":
            self._encoding = attrs.get("encoding", "base64")
            self._start = parser.CurrentByteIndex
            raise _AppendedData

    def _end(self, name: str) -> None:
        self._open.pop()
        if name == "DataArray":
            self._array = None

    def _text(self, text: str) -> None:
        array, text = self._array, text.strip()
        if array is None or self._open[-1] != "DataArray":  # text of an InformationKey
            return
        array.length += len(text)
        array.words += len(text.split())
        array.text = (array.text + text)[:64] if len(array.text) < 64 else array.text

    def check(self, query: Query) -> int:
        """Return the bytes of the arrays; refuse those that exceed the file, or memory."""
        # Pieces in files of their own may overlap.
        if self._covered < self._total or (self.arrays and self._covered > self._total):
            raise VolumeError(
                f"{self.path}: its pieces cover {self._covered} of {self._total} cells; are all "
                "there? Save it as one piece",
                code="damaged",
            )
        nbytes = sum(array.values * array.itemsize for array in self.arrays)
        if self.arrays:
            query.reserve((nbytes,), 1)
        with self.path.open("rb") as file:
            for array in self.arrays:
                try:
                    actual = self._stored_bytes(array, file)
                except (ValueError, struct.error, binascii.Error, OverflowError, OSError) as error:
                    raise damage_error(self.path, _UNREADABLE) from error
                query.require_held(actual, (array.values,), array.values * array.itemsize)
        return nbytes

    def _stored_bytes(self, array: _Array, file: Any) -> int:
        """Return the size of an array in the file, from the lengths stored before its bytes."""
        if array.form == "ascii":
            return array.words * array.itemsize
        is_raw = array.form == "appended" and self._encoding == "raw"
        if array.form == "appended":
            file.seek(self._start + array.offset)
            head = file.read(64)
            left = self.path.stat().st_size - file.tell() + len(head)
        else:
            head, left = array.text.encode("ascii"), array.length
        words = 3 if self._compressed else 1
        nbytes = words * struct.calcsize(self._word)
        if not is_raw:
            head, left = base64.b64decode(head[: -(-nbytes // 3) * 4]), left // 4 * 3
        first, *sizes = struct.unpack_from(f"{self._order}{words}{self._word}", head)
        if not self._compressed:
            return int(min(first, left - nbytes))
        block, last = sizes
        return int(block * (first - 1) + last if last else block * first)


def _counts(extent: str) -> list[int]:
    """Return the number of points along each side of an extent, ``"0 5 0 4 0 39"``."""
    ends = [int(number) for number in extent.split()]
    counts = [high - low + 1 for low, high in zip(ends[::2], ends[1::2], strict=True)]
    if len(counts) != 3 or min(counts) < 1:
        raise ValueError("Extent")
    return counts


def _cells(counts: list[int]) -> int:
    return math.prod(max(count - 1, 1) for count in counts)
