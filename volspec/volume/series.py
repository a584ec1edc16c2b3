"""A series: the time steps of a volume, read when they are needed.

    4-D file, or files by a pattern -> [series] -> Volume of each step

All steps have one lattice, one type, and the range of all, so that nothing that depends on these
flickers: transfer functions, histograms, presets.
"""

from __future__ import annotations

import glob
import os
import re
import threading
import warnings
from collections import OrderedDict
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, overload

import numpy as np

from volspec._confine import require_inside
from volspec.errors import VolspecError, VolspecWarning, VolumeError, one_line
from volspec.volume.files.query import Choice
from volspec.volume.files.slices import missing_numbers
from volspec.volume.labels import Labels
from volspec.volume.load import load_step, load_volume, volume_choices
from volspec.volume.model import Volume

PATTERN = "*"
"""Part of an address in place of any text in the names of files."""
JOINER = "|"
"""Part of an address between the names of files in one folder: ``before.nrrd|after.nrrd``."""
KEPT_BYTES = 2 << 30
"""Bytes of steps that stay in memory by default."""

Load = Callable[[], Volume]
Known = dict[str, Volume | tuple[str, ...]]
"""A volume, or the addresses of a series' steps, by address."""
# Type, least and greatest value, True if some are missing, typical range and labels of all steps.
_Alike = tuple[np.dtype[Any], float, float, bool, tuple[float, float], Labels]


class Series(Sequence[Volume]):
    """Time steps of a volume.

    Parameters
    ----------
    steps : sequence of Volume, arrays (Z, Y, X) or callables
        In the order of time; a callable reads its step, whenever that is not in memory.
    names : sequence of str, optional
        Of the steps, for messages; default: their numbers.
    kept_bytes : int
        Bytes of read steps that stay in memory.

    Every step is read once to find the range of all. One that cannot be read is left out.

    Raises
    ------
    VolumeError
        If no step can be read, or one has another lattice or other fields than the first.

    Warns
    -----
    VolspecWarning
        If a step cannot be read.

    Examples
    --------
    >>> ramp = np.arange(8, dtype=np.uint8).reshape(2, 2, 2)
    >>> beat = Series([Volume(ramp), Volume(ramp + 5)])
    >>> len(beat), beat[0].range
    (2, (0.0, 12.0))
    """

    def __init__(
        self,
        steps: Sequence[Volume | Load],
        names: Sequence[str] = (),
        kept_bytes: int = KEPT_BYTES,
    ) -> None:
        named = list(names) or [f"step {number}" for number in range(len(steps))]
        self._kept: OrderedDict[int, Volume] = OrderedDict()
        self._kept_bytes = kept_bytes
        self._lock = threading.Lock()
        self._alike: dict[str, _Alike] = {}
        self._loads: list[Load] = []
        self.names: tuple[str, ...] = ()
        failed: VolumeError | OSError | None = None
        first: Volume | None = None
        for step, name in zip(steps, named, strict=True):
            load = step if callable(step) else partial(_itself, step)
            try:
                volume = Volume.of(load())
            except (VolumeError, OSError) as error:
                warnings.warn(
                    f"{name} is left out of the series: {one_line(error)}",
                    VolspecWarning,
                    stacklevel=2,
                )
                if failed is None:
                    failed = error
                continue
            first = first or volume
            _require_alike(volume, first, name)
            self._widen(volume)
            self._keep(len(self._loads), volume)
            self._loads.append(load)
            self.names += (name,)
        if first is None:
            raise failed or VolumeError(
                "series: no time steps", "give a volume for each", code="missing", field="steps"
            )
        self.name = first.name
        self.shape = first.shape_xyz
        self.nbytes = sum(
            part.values.size * self._alike[name][0].itemsize for name, part in first.by_role.items()
        )

    def __getstate__(self) -> dict[str, Any]:
        """Pickle and copy without the steps that can be read again."""
        return self.__dict__ | {"_kept": OrderedDict(), "_lock": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__ |= state | {"_lock": threading.Lock()}

    def __len__(self) -> int:
        return len(self._loads)

    def __repr__(self) -> str:
        return f"Series({len(self)} steps of {self.shape} voxels)"

    @overload
    def __getitem__(self, number: int) -> Volume: ...
    @overload
    def __getitem__(self, number: slice) -> list[Volume]: ...
    def __getitem__(self, number: int | slice) -> Volume | list[Volume]:
        """Return a step, from memory or its file, or several; threads may do so at once.

        Raises VolumeError if its file cannot be read any more, IndexError if there is none.
        """
        if isinstance(number, slice):
            return [self[step] for step in range(len(self))[number]]
        if not -len(self) <= number < len(self):
            raise IndexError(f"series: has {len(self)} time steps, {number} is none of them")
        number = range(len(self))[number]
        with self._lock:
            volume = self._kept.get(number)
            if volume is not None:
                self._kept.move_to_end(number)
        if volume is None:
            volume = Volume.of(self._loads[number]())
            with self._lock:
                self._keep(number, volume)
        return self._as_others(volume)

    def _widen(self, volume: Volume) -> None:
        """Take a step's type and range into those of all, field by field."""
        for name, field in volume.by_role.items():
            (low, high), missing = field.range, field.missing is not None
            dtype, typical, labels = field.values.dtype, field.typical_range, field.labels
            if (previous := self._alike.get(name)) is not None:
                low, high = min(low, previous[1]), max(high, previous[2])
                dtype = np.result_type(dtype, previous[0])
                dtype = dtype if dtype.itemsize <= 2 else np.dtype(np.float32)
                missing |= previous[3]
                typical = min(typical[0], previous[4][0]), max(typical[1], previous[4][1])
                labels = MappingProxyType(dict(sorted({**labels, **previous[5]}.items())))
            self._alike[name] = dtype, low, high, missing, typical, labels

    def _as_others(self, volume: Volume) -> Volume:
        """Return a step with the type and range of all."""
        alike = volume.of_series(self.name, *self._alike[""])
        fields = [field.of_series(field.name, *self._alike[field.name]) for field in volume.fields]
        return alike.with_fields(fields) if fields else alike

    def _keep(self, number: int, volume: Volume) -> None:
        """Keep a step in memory, instead of those used longest ago if there is no room."""
        self._kept[number] = volume
        while len(self._kept) > 1 and sum(map(_nbytes, self._kept.values())) > self._kept_bytes:
            self._kept.popitem(last=False)


def _itself(volume: Volume) -> Volume:
    return volume


def _nbytes(volume: Volume) -> int:
    """Return the bytes of all fields' voxels."""
    return sum(field.values.nbytes for field in (volume, *volume.fields))


def _require_alike(volume: Volume, first: Volume, name: str) -> None:
    """Refuse a step with another lattice or other fields than the first."""
    fields, expected = volume.by_role, first.by_role
    if fields.keys() != expected.keys():
        raise VolumeError(
            f"{name}: has the fields {', '.join(volume.by_name)}, but the first step has "
            f"{', '.join(first.by_name)}",
            "give steps of the same fields",
            code="conflict",
        )
    for key, field in fields.items():
        if not field.has_lattice_of(expected[key]):
            raise VolumeError(
                f"{name}: has another lattice, {_lattice(field)}, than the first step, "
                f"{_lattice(expected[key])}",
                "give steps of one lattice, or resample this one",
                code="shape",
            )


def _lattice(volume: Volume) -> str:
    """Describe a lattice in a message."""
    counts = "x".join(map(str, volume.shape_xyz))
    return f"{counts} voxels of {', '.join(f'{mm:.4g}' for mm in volume.spacing_mm)} mm"


def load_series(path: str | os.PathLike[str], *, kept_bytes: int = KEPT_BYTES) -> Series:
    """Open the time steps of a volume.

    Parameters
    ----------
    path : str or path
        A file of several time steps, as for `volspec.load_volume` without ``time=``; or files of
        one step each, by a pattern: ``beat/*.nrrd``, in the order of the numbers in their names;
        or by their names, ``visits/before.nrrd|after.nrrd``, in this order.
        Options follow a question mark: ``beat/*.nrrd?spacing=1,1,2``.
    kept_bytes : int
        Bytes of voxels that stay in memory; other steps are read again when they are needed.

    Raises
    ------
    VolumeError
        If there is only one step; if a file is missing, no step can be read, or steps have
        different lattices.

    Warns
    -----
    VolspecWarning
        If a step cannot be read and is left out, or the numbers of files have a gap.
    """
    addresses = step_addresses(os.fspath(path))
    if len(addresses) < 2:
        raise VolumeError(
            f"{path}: holds no time steps",
            "give a file of several, or a pattern of files, such as 'beat/*.nrrd'",
            code="missing",
        )
    return _open_series(addresses, kept_bytes)


def open_volume(address: str) -> tuple[Volume, Series | None]:
    """Return a volume; or the first step of a series, with the range of all, and the series.

    Errors and warnings are those of `load_volume` and `load_series`.
    """
    source = volume_or_steps(address)
    if isinstance(source, Volume):
        return source, None
    series = _open_series(source, KEPT_BYTES)
    return series[0], series


def load_at(address: str, step: int, count: int, cache: Known) -> Volume:
    """Read a volume, or a step, from 0, of a series of so many.

    What the address leads to is looked up in ``cache``, and added there: a volume that is no series
    is read once. Raises VolumeError as `load_volume`, or if the series has another length.
    """
    first = address not in cache
    source = cache.setdefault(address, volume_or_steps(address)) if first else cache[address]
    if isinstance(source, Volume):
        return source
    if len(source) != count:
        raise VolumeError(
            f"{address}: has {len(source)} time steps, but the volume has {count}",
            "give as many, or one alone with ?time=0",
            code="shape",
        )
    return load_step(source[step], 0 if first else 1)


def require_step(address: str, step: int, count: int) -> None:
    """Raise VolumeError if there is no step of this number."""
    if step >= count:
        raise VolumeError(
            f"{address}: has {count} time step{'s' * (count > 1)}, step = {step} is none of them",
            f"give 0 to {count - 1}" if count > 1 else "leave it out",
            code="range",
            given=step,
        )


def volume_or_steps(address: str) -> Volume | tuple[str, ...]:
    """Read a volume; of a series return the addresses of its steps."""
    if is_pattern(address):
        return step_addresses(address)
    try:
        return load_volume(address)
    except VolumeError as error:
        if error.code != "missing" or len(addresses := step_addresses(address)) == 1:
            raise
        return addresses


def _open_series(addresses: Sequence[str], kept_bytes: int) -> Series:
    loads = [partial(load_step, path, number) for number, path in enumerate(addresses)]
    return Series(loads, addresses, kept_bytes)


def step_addresses(address: str) -> tuple[str, ...]:
    """Return the addresses of a volume's time steps; itself if it has one.

    Raises VolumeError if a pattern fits no file.

    Warns
    -----
    VolspecWarning
        If the numbers in the names of files have a gap.
    """
    path, mark, options = address.partition("?")
    if is_pattern(address):
        require_inside(path, VolumeError)
        folder, names = os.path.split(path)
        if JOINER in names:
            return tuple(
                f"{os.path.join(folder, name)}{mark}{options}" for name in names.split(JOINER)
            )
        paths = sorted(glob.glob(path), key=_in_order)
        if not paths:
            raise VolumeError(
                f"{path}: no file fits this pattern", "check the folder", code="not-found"
            )
        _warn_of_gaps(path, paths)
        return tuple(f"{name}{mark}{options}" for name in paths)
    choices: tuple[Choice, ...] = ()
    with suppress(VolspecError):  # raised again when it is read
        choices = volume_choices(address)
    times = next((choice for choice in choices if choice.key == "time"), None)
    if times is None or times.chosen is not None:
        return (address,)
    joined = f"{address}&" if mark else f"{address}?"
    return tuple(f"{joined}time={value}" for value in times.values)


def is_pattern(address: str) -> bool:
    """Return True if an address is a pattern of files, or their names, and not the name of one.

    >>> [is_pattern(each) for each in ("beat/*.nrrd?spacing=1,1,1", "a.nii|b.nii", "heart.nii")]
    [True, True, False]
    """
    path = address.partition("?")[0]
    several = PATTERN in path or JOINER in os.path.basename(path)
    return several and not Path(path).exists()


def order_steps(paths: Sequence[str]) -> tuple[str, ...]:
    """Return files in the order of the numbers in their names; as given if more differs.

    >>> order_steps(["beat10.nii", "beat9.nii"]), order_steps(["before.nii", "after.nii"])
    (('beat9.nii', 'beat10.nii'), ('before.nii', 'after.nii'))
    """
    return tuple(sorted(paths, key=_in_order) if differ_in_numbers(paths) else paths)


def series_address(paths: Sequence[str]) -> str:
    """Return the address of the series of some files, in the order of `order_steps`.

    A pattern if the names differ in numbers alone and it fits no other file, else the names.

    Raises VolumeError if these are in several folders, or have a letter of addresses.

    >>> series_address(["visits/before.nii", "visits/after.nii"])
    'visits/before.nii|after.nii'
    """
    paths = order_steps(paths)
    if differ_in_numbers(paths):
        parts = zip(*(re.split(r"(\d+)", path) for path in paths), strict=True)
        pattern = "".join(part[0] if len(set(part)) == 1 else PATTERN for part in parts)
        if tuple(sorted(glob.glob(pattern), key=_in_order)) == paths:
            return pattern
    folder = os.path.dirname(paths[0])
    names = [os.path.basename(path) for path in paths]
    for path, name in zip(paths, names, strict=True):
        if os.path.dirname(path) != folder:
            raise VolumeError(
                f"{name} is in another folder than {names[0]}",
                "move the steps into one folder",
                code="conflict",
            )
        if any(mark in name for mark in (PATTERN, JOINER, "?")):
            raise VolumeError(f"{name} has {PATTERN}, {JOINER} or ?", "rename it", code="conflict")
    return os.path.join(folder, JOINER.join(names))


def differ_in_numbers(paths: Sequence[str]) -> bool:
    """Return True if paths differ in numbers alone.

    >>> differ_in_numbers(["beat10.nii", "beat9.nii"])
    True
    """
    return len({re.sub(r"\d+", "0", path) for path in paths}) == 1


def _in_order(name: str) -> list[int | str]:
    """Return a key that sorts numbers in names by their value."""
    parts = re.split(r"(\d+)", name)
    return [int(part) if part.isdecimal() else part for part in parts]


def _warn_of_gaps(pattern: str, names: Sequence[str]) -> None:
    """Warn if the only number that differs in the names misses some of its regular values."""
    if missing := missing_numbers([Path(name).name for name in names]):
        warnings.warn(
            f"{pattern}: no file has the number {missing}; the steps before and after follow each "
            "other",
            VolspecWarning,
            stacklevel=4,
        )
