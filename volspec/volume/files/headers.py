"""Fields of NRRD and MetaImage headers, and a check for those that ITK would misread.

    path -> [headers] -> itk

ITK mirrors an axis with negative spacing, passes MetaImage's ``ElementDataFile`` to C's
``sprintf``, and follows it to any folder.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path, PurePath

import numpy as np

from volspec.errors import VolumeError, quoted

TRUNCATED = "truncated, copy or download it again"
# Greatest number of a header's lines, and their greatest length.
_MOST_LINES, _MOST_LENGTH = 10_000, 1 << 16
# Most dimensions of both formats; beyond, MetaIO loops over a count that overflows.
_MOST_DIMENSIONS = 16
# The only conversion that MetaImage defines in slices' names: slice%03d.raw.
_PATTERN, _NUMBER = re.compile(r"[^%]*%0?\d{0,2}d[^%]*"), re.compile(r"-?\d+")
# NRRD's kinds of axes along which ITK has voxels, not the components of one.
_NRRD_AXES = ("domain", "space", "time", "none", "???")
# MetaIO also accepts a colon, and without either reads the value from the next line.
_META_LINE = re.compile(r"([^=:\r]+)[=:]([^\r]*)")


def check_itk_header(path: Path) -> None:
    """Refuse an NRRD or MetaImage header that ITK would misread."""
    header = HeaderFields.read(path)
    fields = header.named
    spacing = fields.get("spacings") or fields.get("ElementSpacing") or ""
    others = component_axes(fields)
    try:
        numbers = [float(word) for k, word in enumerate(spacing.split()) if k not in others]
    except ValueError:
        numbers = []  # left to ITK's message
    if not all(0 < number < np.inf for number in numbers):
        raise VolumeError(
            f"{path}: spacing {spacing}; each of x, y, z must be positive, correct the header",
            code="range",
        )
    dimensions = fields.get("dimension") or fields.get("NDims") or "3"
    try:
        in_range = 1 <= float(dimensions) <= _MOST_DIMENSIONS
    except ValueError:
        in_range = True  # left to ITK's message
    if not in_range:
        raise VolumeError(
            f"{path}: {quoted(dimensions)} dimensions; expected 3, correct the header", code="shape"
        )
    sizes = fields.get("sizes") or fields.get("DimSize") or ""
    if not all(is_count(word) and int(word) > 0 for word in sizes.split()):
        raise VolumeError(
            f"{path}: sizes {quoted(sizes)}; each must be a positive whole number of fewer than 20 "
            "digits",
            code="range",
        )
    for name in _data_files(path, header):
        parts = PurePath(name.replace("\\", "/"))
        if parts.is_absolute() or ".." in parts.parts or ":" in name:
            raise VolumeError(
                f"{path}: its voxels are said to be in {quoted(name)}; a data file must lie in the "
                "header's folder or below it, move it there and correct the header",
                code="unsupported",
            )


def _data_files(path: Path, header: HeaderFields) -> list[str]:
    """Return the names of separate data files; none if the header's file holds the voxels."""
    named = data_field(header.named)
    name, *numbers = named.split() or [""]
    if "%" in named and not (_PATTERN.fullmatch(name) and all(map(_NUMBER.fullmatch, numbers))):
        raise VolumeError(
            f"{path}: its voxels are said to be in {quoted(named)}; a pattern of names has one "
            "number, such as slice%03d.raw 1 110 1",
            code="syntax",
        )
    if name.upper() != "LIST":
        return [] if named.upper() == "LOCAL" else [named]
    lines = path.read_bytes()[header.end :].decode("latin-1").splitlines()
    return [line.strip() for line in lines if line.strip()]


def component_axes(fields: dict[str, str]) -> list[int]:
    """Return the indices of the axes of an NRRD along which a voxel has components."""
    kinds = fields.get("kinds", "").lower().split()
    return [at for at, kind in enumerate(kinds) if kind not in _NRRD_AXES]


def data_field(fields: dict[str, str]) -> str:
    """Return the data file's name, pattern or ``LIST``; ``LOCAL`` means the header's own file."""
    keys = ("ElementDataFile", "datafile")
    return next((fields[key] for key in keys if key in fields), "LOCAL")


def is_meta(path: Path) -> bool:
    """Return True for MetaImage, judged by the file name's ending."""
    return path.suffix.lower() in (".mhd", ".mha")


@dataclass(frozen=True, slots=True)
class HeaderFields:
    """Fields of an NRRD or MetaImage header."""

    # NRRD's names in lower case without spaces, such as ``byteskip``; MetaImage's unchanged.
    named: dict[str, str]
    # Custom keys and values of NRRD.
    pairs: dict[str, str] = field(default_factory=dict)
    # First byte after the header, or after the line that begins a list of files.
    end: int = 0

    @classmethod
    def read(cls, path: Path) -> HeaderFields:
        """Read a header; refuse a MetaImage line that is not a field, since MetaIO misreads it."""
        read_line = cls._meta_field if is_meta(path) else cls._nrrd_field
        named: dict[str, str] = {}
        pairs: dict[str, str] = {}
        with path.open("rb") as file:
            if not is_meta(path) and not file.readline(80).startswith(b"NRRD"):
                return cls({})
            for number in range(_MOST_LINES):
                read = file.readline(_MOST_LENGTH)
                line = read.strip().decode("latin-1")
                if not read or not (line or is_meta(path)):
                    break
                try:
                    given = read_line(line)
                except ValueError as error:
                    raise VolumeError(
                        f"{path}: line {number + 1} of its header, {quoted(line)}, is not "
                        "written as Name = value; correct or delete it",
                        code="syntax",
                    ) from error
                if given is None:
                    key, is_pair, value = line.partition(":=")
                    if is_pair and not line.startswith("#"):
                        pairs[key] = value
                    continue
                key, value = given
                named[key] = value
                is_list = value.upper().startswith("LIST")
                if key == "ElementDataFile" or (key == "datafile" and is_list):  # the last
                    break
            return cls(named, pairs, file.tell())

    @staticmethod
    def _meta_field(line: str) -> tuple[str, str] | None:
        if not line:
            return None
        if (match := _META_LINE.fullmatch(line)) is None:
            raise ValueError(line)
        return match[1].rstrip(" \t"), match[2].lstrip("=: \t")

    @staticmethod
    def _nrrd_field(line: str) -> tuple[str, str] | None:
        key, found, value = line.partition(":")
        if not found or key.startswith("#") or value.startswith("="):
            return None  # a comment, or a custom key and value
        return key.strip().lower().replace(" ", ""), value.strip()


def is_count(word: str) -> bool:
    """Return True for a whole number that can count bytes: one with fewer than 20 digits."""
    return word.isdecimal() and len(word) < 20
