"""Input and output of readers: a file name with options, and the file's voxels and lattice.

    load_volume -> [Query] -> reader -> [Reading] -> Volume

Options follow a question mark: ``FOLDER?series=3&spacing=1,1,2``.
"""

from __future__ import annotations

import math
import mmap
import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from volspec._extras import install_command
from volspec._files import is_remote
from volspec._gpu import host_free_bytes
from volspec.errors import DeviceError, VolumeError, nearest, one_line, quote
from volspec.volume.channels import ALL, MAX_FIELDS, Channel
from volspec.volume.labels import Labels
from volspec.volume.metadata import Metadata

SCALES = "linear", "log"
"""Values of ``scale=``."""
# Most arrays that a message lists.
_MAX_LISTED = 8
_BYTES = re.compile(r"(\d+(?:\.\d*)?)\s*([KMGT]?)(i?)B?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Choice:
    """Option of an address of which a volume takes one value, such as a channel.

    ``name?key=value`` selects a value; other choices may depend on it.
    """

    key: str  # "series", "level", "channel", "time"; "shape" for raw bytes without a layout
    values: tuple[str, ...]  # none for a layout
    names: tuple[str, ...]  # for people, one for each value
    chosen: str | None = None  # value that is given, or taken by default; None: it must be given


class ChoicesListed(Exception):
    """Ends a reader that was asked only for its choices."""


def _declare_nothing(nbytes: int) -> None:
    """Do nothing; a function by name, as a query is pickled."""


@dataclass(frozen=True, slots=True)
class Query:
    """Path of a volume and the options given with it, as text.

    >>> query = Query.of("stack.tif?spacing=0.5,0.5,2&channel=1")
    >>> query.path.name, query.spacing_mm, query.index("channel", 3, "channels")
    ('stack.tif', (0.5, 0.5, 2.0), 1)
    """

    path: Path
    options: dict[str, str] = field(default_factory=dict)
    # Called by `reserve` with the number of bytes that a reader is about to allocate.
    declare: Callable[[int], None] = field(default=_declare_nothing, compare=False)
    # A list makes readers add their choices to it, and end before they read voxels.
    choices: list[Choice] | None = field(default=None, compare=False)
    labels: str | None = None  # ``labels=``, a table for volumes of any format
    memory_bytes: int | None = None  # ``memory=``, most bytes of voxels in memory
    unit: str | None = None  # ``unit=`` of the values, such as HU
    is_log: bool = False  # ``scale=log``, voxels hold the decimal logarithms of the file's values

    @classmethod
    def of(cls, text: str) -> Query:
        """Split a name at its question mark; the name of an existing file has no options."""
        path, _, query = text.partition("?")
        try:
            if query and not is_remote(text) and Path(text).exists():
                return cls(Path(text))
        except (OSError, ValueError) as error:  # the name is too long or contains NUL
            raise VolumeError(
                f"volume: invalid path {quote(text)}: {one_line(error)}", code="syntax", given=text
            ) from error
        if not path:
            raise VolumeError(
                "volume: the name is empty; give a file or a folder, such as . for this one",
                code="missing",
            )
        options: dict[str, str] = {}
        for part in query.split("&"):
            key, _, value = map(unquote, part.partition("="))  # a plus sign is one
            if not key and not value:
                continue
            if key in options:
                raise VolumeError(f"{path}: {key}= is given twice; give it once", code="duplicate")
            options[key] = value
        labels = options.pop("labels", None)
        if labels == "":
            raise VolumeError(f"{path}: labels= is empty; give a file", code="missing")
        memory, unit = options.pop("memory", None), options.pop("unit", None)
        nbytes, scale = bytes_of(memory, path), options.pop("scale", "linear")
        if scale not in SCALES:
            remedy = f"give scale={SCALES[1]}, or leave it out"
            raise VolumeError.refused(f"{path}: scale", scale, remedy, "unknown")
        parsed = cls(path_of(path), options, labels=labels, memory_bytes=nbytes, unit=unit)
        return replace(parsed, is_log=scale == SCALES[1])

    @property
    def is_remote(self) -> bool:
        """True if the path is a URL."""
        return is_remote(str(self.path))

    @property
    def most_bytes(self) -> int:
        """Bytes up to which a volume is read as a whole: by default half of what is free."""
        return host_free_bytes() // 2 if self.memory_bytes is None else self.memory_bytes

    def example(self, **options: str) -> str:
        """Return the address with further options, quoted for a shell, for messages.

        >>> Query.of("a b/v.nii?time=2").example(channel="0")
        "'a b/v.nii?time=2&channel=0'"
        """
        settings = {"labels": self.labels, "unit": self.unit}
        settings["scale"] = SCALES[1] if self.is_log else None
        merged = self.options | {k: v for k, v in settings.items() if v is not None} | options
        coded = {k: v.replace("%", "%25").replace("&", "%26") for k, v in merged.items()}
        return shlex.quote(f"{self.path}?" + "&".join(f"{k}={v}" for k, v in coded.items()))

    def allow(self, *names: str) -> None:
        """Refuse options other than ``names``, and those that every volume takes."""
        names = tuple(dict.fromkeys((*names, "spacing", "labels", "unit", "scale")))
        if unknown := sorted(set(self.options) - set(names)):
            raise VolumeError(
                f"{self.path}: unknown option {unknown[0]!r}",
                f"{nearest(unknown[0], names, count=1)}known are {', '.join(names)}",
                code="unknown",
                given=unknown[0],
            )

    @property
    def spacing_mm(self) -> tuple[float, float, float] | None:
        """``spacing=x,y,z`` in mm, positive; None if left out."""
        text = self.options.get("spacing")
        if text is None:
            return None
        try:
            x, y, z = (float(number) for number in text.split(","))
        except ValueError as error:
            raise VolumeError(
                f"{self.path}: spacing={text} cannot be read; write millimetres along x, y, z "
                f"as in {self.example(spacing='0.65,0.65,2')}",
                code="syntax",
                given=text,
            ) from error
        if not (min(x, y, z) > 0 and max(x, y, z) < math.inf):
            raise VolumeError(
                f"{self.path}: spacing={text}; give three positive numbers of millimetres, as in "
                f"{self.example(spacing='0.65,0.65,2')}",
                code="range",
                given=text,
            )
        return x, y, z

    def completed(self, metadata: Metadata) -> Metadata:
        """Return a file's statements with the address': ``unit=``, ``spacing=`` and ``scale=``."""
        completed = metadata.given(self.unit, self.spacing_mm is not None)
        return replace(completed, is_log=self.is_log)

    def index(self, key: str, count: int, noun: str, names: Sequence[str] = ()) -> int:
        """Return the index chosen by an option such as ``channel=N`` or ``time=N``, counted from 0.

        If there is only one, the option may be left out. ``noun`` is the plural for messages;
        ``names`` are the values' names, if the file states them.
        """
        value = self.options.get(key)
        if value == ALL and key == "channel":
            value = None
        if value is None and count == 1:
            return 0
        if self.choices is not None and count > 1:
            return self._offer(key, count, names)
        if count == 1 and value != "0":
            raise VolumeError(
                f"{self.path}: {key}={value}, but there is only one; leave it out",
                code="conflict",
                given=value,
            )
        if value is None:
            many = key == "channel" and count > MAX_FIELDS
            listing = (
                f"more than the {MAX_FIELDS} that open together" if many else "but a volume has one"
            )
            raise VolumeError(
                f"{self.path}: holds {count} {noun}, {listing}; choose one with "
                f"{self.example(**{key: '0'})} (0 … {count - 1})",
                code="missing",
            )
        if not value.isdecimal() or int(value) >= count:
            valid = "0 or 1" if count == 2 else f"a number from 0 to {count - 1}"
            raise VolumeError(
                f"{self.path}: holds {count} {noun}, {key}={value} is none of them; give {valid}",
                code="range",
                given=value,
            )
        return int(value)

    def array_named(self, shapes: Mapping[str, Sequence[int]]) -> str:
        """Return the array chosen by ``dataset=``, or the only one; ``shapes`` are theirs."""
        value = self.options.get("dataset", "").strip("/")
        names = tuple(sorted(shapes, key=lambda name: (-math.prod(shapes[name]), name)))
        listed = ", ".join(names[:_MAX_LISTED]) + ", …" * (len(names) > _MAX_LISTED)
        if self.choices is not None and len(names) > 1:
            sizes = tuple(f"{name} ({' × '.join(map(str, shapes[name][::-1]))})" for name in names)
            self.choices.append(Choice("dataset", names, sizes, value if value in shapes else None))
            if value not in shapes:
                self.end_choices()  # the others depend on it
        if not value and len(names) == 1:
            return names[0]
        if not value:
            raise VolumeError(
                f"{self.path}: holds {len(names)} datasets",
                f"choose one with {self.example(dataset=names[0])}; there are {listed}",
                code="missing",
            )
        if value not in shapes:
            raise VolumeError(
                f"{self.path}: has no dataset {value!r} of three or four axes",
                f"{nearest(value, names, count=1)}there are {listed}",
                code="unknown",
                given=value,
            )
        return value

    def _offer(self, key: str, count: int, names: Sequence[str]) -> int:
        """Add a choice of indices; return the given index if it is one, else 0."""
        assert self.choices is not None
        values = tuple(map(str, range(count)))
        named = tuple(names if len(names) == count and all(names) else values)
        value = self.options.get(key)
        if key == "channel" and count <= MAX_FIELDS:
            values, named = (ALL, *values), ("all", *named)
            value = value or ALL
        selected = value if value in values else None
        self.choices.append(Choice(key, values, named, selected))
        return 0 if selected in (None, ALL) else int(selected)

    def end_choices(self) -> None:
        """End a reader that was asked only for its choices; call it before voxels are read."""
        if self.choices is not None:
            raise ChoicesListed

    def reserve(self, shape: Sequence[int], itemsize: int) -> None:
        """Refuse voxels that do not fit into memory, before allocating them.

        The shape is the header's, with components, in any order; ``itemsize`` is a value's bytes.
        """
        nbytes = math.prod(shape) * itemsize
        counts = "x".join(map(str, shape))
        if min(shape, default=0) < 1:
            raise VolumeError(
                f"{self.path}: its header declares {counts or 'no'} voxels; is it damaged?",
                code="damaged",
            )
        free = host_free_bytes()
        if nbytes > free:
            raise VolumeError(
                f"{self.path}: its header declares {counts} voxels, {nbytes / 2**30:.1f} GiB; "
                f"{free / 2**30:.1f} GiB of memory are free",
                "save it uncompressed (NRRD, NIfTI, MetaImage, MRC, .npy, raw) or as HDF5, TIFF or "
                "OME-Zarr, which are read in parts and by volspec convert, or give a smaller one",
                code="size",
            )
        self.declare(nbytes)

    def require_held(self, actual: int, shape: Sequence[int], nbytes: int) -> None:
        """Refuse a file with fewer bytes of voxels than its header declares."""
        if actual < nbytes:
            raise VolumeError(
                f"{self.path}: holds {actual} bytes of voxels, its header declares {nbytes} "
                f"({'x'.join(map(str, shape))}); truncated, copy or download it again",
                code="damaged",
            )

    def surplus(self, actual: int | None, nbytes: int) -> list[str]:
        """Return a note on bytes of voxels that the header does not declare, if there are any."""
        if actual is None or actual <= nbytes:
            return []
        return [
            f"{self.path}: {actual} bytes of voxels, its header declares {nbytes} and the rest is "
            "not read; are its size and type right?"
        ]


def path_of(name: str) -> Path:
    """Return a file's name or a URL as a path. Raises DeviceError if URLs are not supported."""
    if not is_remote(name):
        return Path(name)
    if name.lower().startswith("ftp:"):
        raise DeviceError(
            f"{name}: FTP has no way to read parts of a file; give https://…, s3://… or a file",
            code="unsupported",
        )
    try:
        from upath import UPath

        return cast(Path, UPath(name))
    except (ImportError, ValueError) as error:
        raise DeviceError(
            f"{name}: is not on this machine, and cannot be reached ({one_line(error)[:100]}); "
            f"{install_command('remote')}, for s3:// also s3fs, for gs:// gcsfs",
            code="unsupported",
        ) from error


def bytes_of(value: str | None, path: str) -> int | None:
    """Return a number of bytes, given with a unit; None if nothing is given.

    >>> bytes_of("1.5GiB", "v.zarr"), bytes_of("200 MB", "v.zarr"), bytes_of("4096", "v.zarr")
    (1610612736, 200000000, 4096)
    """
    if value is None:
        return None
    match = _BYTES.fullmatch(value.strip())
    if match is None or float(match[1]) <= 0:
        raise VolumeError(
            f"{path}: memory={value} is not a number of bytes",
            "write it as memory=2GiB or memory=500MB",
            code="syntax",
            given=value,
        )
    unit, binary = match[2].upper(), bool(match[3])
    power = "KMGT".index(unit) + 1 if unit else 0
    return int(float(match[1]) * (1024 if binary else 1000) ** power)


@dataclass(frozen=True, slots=True)
class Stored:
    """Voxels stored uncompressed as a run of bytes in a file."""

    path: str
    shape: tuple[int, ...]  # (Z, Y, X)
    dtype: str  # NumPy's code, byte order included
    offset: int = 0

    @property
    def root(self) -> str:
        """The file, as of a Zarr store."""
        return self.path

    @property
    def nbytes(self) -> int:
        """Bytes of all voxels."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize

    def __getitem__(self, index: tuple[int | slice, ...]) -> NDArray[Any]:
        """Read some of the voxels; pages of the file do not stay in this process's memory."""
        mapped = np.memmap(self.path, self.dtype, "r", self.offset, self.shape)
        return np.array(mapped[index])

    def read(self) -> NDArray[Any]:
        """Read the voxels. They are not mapped, since the file may change while they are in use.

        They begin on a memory page, so that Intel's OpenCL uses them without a copy. NumPy asks for
        huge pages, which take a quarter of the time.
        """
        memory = np.empty(self.nbytes + mmap.PAGESIZE, np.uint8)
        memory = memory[-memory.ctypes.data % mmap.PAGESIZE :][: self.nbytes]
        try:
            with open(self.path, "rb", buffering=0) as file:
                file.seek(self.offset)
                left = memoryview(memory)
                while left and (count := file.readinto(left)):
                    left = left[count:]
        except OSError as error:
            raise VolumeError(
                f"{self.path}: cannot be read ({one_line(error)})", code="damaged"
            ) from error
        if left:
            raise VolumeError(
                f"{self.path}: became shorter while it was being read; read it again", code="state"
            )
        return np.ndarray(self.shape, self.dtype, memory)


class OneSlice:
    """Array without an axis of slices, as one with a first axis for a single slice."""

    def __init__(self, array: Any) -> None:
        self._array, self.root = array, getattr(array, "root", None)
        self.shape, self.dtype = (1, *array.shape), array.dtype
        self.chunks = array.chunks and (1, *array.chunks)

    def __getitem__(self, index: tuple[int | slice, ...]) -> NDArray[Any]:
        values: NDArray[Any] = np.asarray(self._array[index[1:]])[None][index[0]]
        return values


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Voxels as stored in a file, and their lattice; `Volume` converts or refuses them."""

    values: NDArray[Any] | Stored  # (Z, Y, X), of any type and number of axes; (Y, X): one slice
    spacing_mm: tuple[float, float, float] | None = None
    world_from_index: NDArray[np.float64] | None = None
    notes: Sequence[str] = ()  # warnings for the caller of `load_volume`
    labels: Labels | None = None  # stated by the header, perhaps without names; None: not stated
    channel: Channel | None = None  # what the file says of the one that is read
    metadata: Metadata = field(default_factory=Metadata)
    owner: Any = None  # owner of the values' memory, if they do not own it themselves
