"""Choices that a volume's address leaves open, and the layouts that raw bytes may have.

volume_choices -> [choices] -> dialog, status line -> address
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from urllib.parse import parse_qsl, urlencode

import numpy as np

from volspec.errors import VolumeError, one_line
from volspec.viewer.model.paths import size_text
from volspec.volume import (
    MAX_FIELDS,
    Choice,
    Volume,
    differ_in_numbers,
    order_steps,
    series_address,
)
from volspec.volume.files import SCALES

# By the key of a choice.
TITLES = {
    "series": "Series",
    "level": "Resolution",
    "channel": "Channel",
    "time": "Time",
    "scale": "Values",
}
# Factor by which values over decades exceed their median.
_DECADES = 1000.0
# Voxels along each axis that are looked at.
_LOOKED_AT = 40


@dataclass(frozen=True, slots=True)
class NeedsChoice:
    """A volume's address that leaves something open, and all its choices."""

    path: str
    choices: tuple[Choice, ...]


USES = {
    "fields": ("Fields of one scene", "At their places in one space, a colour each"),
    "steps": ("Steps of a time series", "All on one lattice, with one look"),
    "each": ("One after the other", "The last stays open; File › Open recent has all"),
}
"""Uses of files that were dropped together: title and description."""
_OTHERS = {".toml": "a scene", ".json": "a session", ".exr": "a cast image"}


@dataclass(frozen=True, slots=True)
class Dropped:
    """Volumes and scenes that were dropped together, of which to choose a use.

    Meshes that were dropped with them are added to what is opened.
    """

    paths: tuple[str, ...]
    meshes: tuple[str, ...] = ()

    def ordered(self, use: str) -> tuple[str, ...]:
        """Return the paths in the order in which a use takes them."""
        return order_steps(self.paths) if use == "steps" else self.paths

    def moved_up(self, path: str) -> Dropped:
        """Return the files with one before its predecessor.

        >>> Dropped(("before.nii", "after.nii")).moved_up("after.nii").paths
        ('after.nii', 'before.nii')
        """
        index = self.paths.index(path)
        above = max(index - 1, 0)
        remaining = self.paths[:index] + self.paths[index + 1 :]
        return replace(self, paths=(*remaining[:above], path, *remaining[above:]))

    @property
    def numbered(self) -> bool:
        """True if the names differ in numbers alone: these order steps, and propose that use."""
        return differ_in_numbers(self.paths)

    def problem(self, use: str) -> str:
        """Return why a use is impossible, as far as names show; empty if it may be possible."""
        if use == "each":
            return ""
        for path in self.paths:
            name, ending = os.path.basename(path), os.path.splitext(path)[1].lower()
            if ending in _OTHERS:
                return f"{name} is {_OTHERS[ending]}, not a volume"
        if use == "fields" and len(self.paths) > MAX_FIELDS:
            return f"There are {len(self.paths)} files; a scene has at most {MAX_FIELDS} fields"
        try:
            if use == "steps":
                series_address(self.paths)
        except VolumeError as error:
            return one_line(error)
        return ""


def address_with(path: str, values: Mapping[str, str]) -> str:
    """Return an address with some of its options set.

    >>> address_with("a b.tif?time=1", {"time": "2", "channel": "0"})
    'a b.tif?time=2&channel=0'
    """
    file, _, query = path.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True)) | dict(values)
    return f"{file}?{urlencode(options, safe=',.<>|')}"


def scale_choice(volume: Volume) -> tuple[Choice, ...]:
    """Return the choice between values and their logarithms, if they are over decades."""
    is_log = volume.metadata.is_log
    if not is_log:
        strides = tuple(slice(None, None, -(-n // _LOOKED_AT)) for n in volume.values.shape)
        above = volume.values[strides][volume.values[strides] > 0]
        spans_decades = above.size > 0 and _DECADES * float(np.median(above)) < volume.range[1]
        if not spans_decades or volume.range[0] < 0 or volume.pyramid is not None or volume.labels:
            return ()
    return (Choice("scale", SCALES, ("as they are", "logarithmic"), SCALES[is_log]),)


def value_text(choice: Choice, number: int) -> str:
    """Return the name of a choice's value for people, who count from 1.

    >>> value_text(Choice("channel", ("0", "1"), ("DAPI", "GFP")), 1)
    'GFP'
    >>> value_text(Choice("time", ("0", "1"), ("0", "1")), 1)
    '2 of 2'
    """
    name = choice.names[number]
    return f"{number + 1} of {len(choice.names)}" if name == choice.values[number] else name


ORDERS = ("little", "big")
DTYPES = ("uint8", "int8", "uint16", "int16", "uint32", "int32", "float32", "float64")


@dataclass(frozen=True, slots=True)
class RawLayout:
    """Layout of the voxels in a file without a header."""

    shape: tuple[int, int, int] = (256, 256, 256)  # x, y, z
    dtype: str = "uint8"
    order: str = "little"  # of a number's bytes
    offset: int = 0  # bytes before the voxels
    spacing_mm: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def nbytes(self) -> int:
        """Size of the voxels."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize

    @property
    def options(self) -> dict[str, str]:
        """The options of the file's address."""
        options = {
            "shape": "x".join(map(str, self.shape)),
            "dtype": self.dtype,
            "spacing": ",".join(f"{mm:g}" for mm in self.spacing_mm),
        }
        if self.order == "big" and np.dtype(self.dtype).itemsize > 1:
            options["order"] = self.order
        return options | ({"offset": str(self.offset)} if self.offset else {})

    def check(self, nbytes: int) -> tuple[bool, str]:
        """Compare with a file's size; return whether it can be read, and a line about it."""
        surplus = nbytes - self.offset - self.nbytes
        have, need = f"the file has {nbytes:,} bytes", f"takes {self.nbytes:,}"
        if min(self.shape) < 1 or self.offset < 0:
            return False, "Give positive counts, and an offset of 0 or more"
        if surplus < 0:
            return False, f"This layout {need}, {have}: {-surplus:,} too few"
        if surplus > 0:
            return True, f"This layout {need}, {have}: {surplus:,} are left over"
        return True, f"This layout {need} bytes, as the file has ({size_text(nbytes)})"

    def __str__(self) -> str:
        multibyte = np.dtype(self.dtype).itemsize > 1
        order = f", {self.order}-endian" if multibyte else ""
        offset = f", after {self.offset} bytes" if self.offset else ""
        return f"{' × '.join(map(str, self.shape))}, {self.dtype}{order}{offset}"


MAX_GUESSES = 8
# Sides of slices that scanners and simulations make.
_SIDES = (
    *(32, 41, 48, 64, 80, 96, 100, 128, 150, 160, 192, 200, 208, 240, 250, 256, 300, 301, 320),
    *(341, 384, 400, 480, 500, 512, 600, 640, 768, 800, 832, 1000, 1024, 1536, 2048),
)
_SHAPE = re.compile(r"(?<!\d)(\d{1,5})[x_×,-](\d{1,5})[x_×,-](\d{1,5})(?!\d)", re.IGNORECASE)
# A header before the voxels is at most this long.
_MAX_HEADER = 4096


def guess_layouts(name: str, nbytes: int, sample: bytes) -> tuple[RawLayout, ...]:
    """Return plausible layouts of a file, the best first.

    Shapes are the one in the file's name, cubes, and stacks of square slices of usual sizes. Types
    are those in which neighbouring voxels of the ``sample``, bytes from the middle of the file at a
    multiple of 8, differ least.

    >>> str(guess_layouts("head_256x256x110_uint8.raw", 256 * 256 * 110, b"")[0])
    '256 × 256 × 110, uint8'
    """
    types = _types(sample)
    layouts: dict[RawLayout, tuple[float, ...]] = {}
    for number, (dtype, order, roughness) in enumerate(types):
        itemsize = np.dtype(dtype).itemsize
        named = dtype in name.lower()
        for match in _SHAPE.finditer(name):
            x, y, z = map(int, match.groups())
            layout = RawLayout((x, y, z), dtype, order)
            remainder = nbytes - layout.nbytes
            if 0 <= remainder <= _MAX_HEADER and layout.nbytes:
                layout = RawLayout((x, y, z), dtype, order, offset=remainder)
                layouts.setdefault(layout, (0, not named, remainder > 0, roughness, number))
        if nbytes % itemsize:
            continue
        count = nbytes // itemsize
        cube = round(count ** (1 / 3))
        for side in (*_SIDES, cube):
            depth, remainder = divmod(count, max(side, 1) ** 2)
            if remainder == 0 and 8 <= depth <= 8 * side:
                unlike = abs(math.log(depth / side))
                key = (1, not named, round(roughness, 1), unlike, number)
                layouts.setdefault(RawLayout((side, side, depth), dtype, order), key)
    ranked = sorted(layouts, key=lambda layout: layouts[layout])
    return tuple(ranked[:MAX_GUESSES])


def _types(sample: bytes) -> list[tuple[str, str, float]]:
    """Return types with their byte order, and how much neighbours differ; the smoothest first."""
    rated = []
    for dtype in ("uint8", "uint16", "int16", "float32"):
        for order, code in zip(ORDERS, "<>", strict=True):
            kind = np.dtype(f"{code}{np.dtype(dtype).str[1:]}")
            if order == "big" and kind.itemsize == 1:
                continue
            rated.append((dtype, order, _roughness(sample, kind)))
    return sorted(rated, key=lambda row: row[2])


def _roughness(sample: bytes, kind: np.dtype[np.generic]) -> float:
    """Return the mean difference of neighbours relative to the spread of the values."""
    with np.errstate(all="ignore"):
        values = np.frombuffer(sample, kind, len(sample) // kind.itemsize).astype(np.float64)
        if values.size < 2 or not np.isfinite(values).all() or np.abs(values).max() > 1e12:
            return 2.0
        spread = float(values.std())
        if kind.kind in "iu":  # a wrong sign adds jumps, which would widen the spread, too
            other = values + np.where(values < 0, 1.0, 0.0) * 256.0**kind.itemsize
            if kind.kind == "u":
                half = 256.0**kind.itemsize / 2
                other = values - np.where(values >= half, 2 * half, 0.0)
            spread = min(spread, float(other.std()))
        if kind.kind == "f" and 0 < np.abs(values[values != 0]).min(initial=1.0) < 1e-12:
            return 2.0  # integers read as numbers close to 0
        return float(np.abs(np.diff(values)).mean() / spread) if spread > 0 else 1.0
