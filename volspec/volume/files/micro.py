"""Microscopes' formats: Zeiss CZI, Leica LIF, Nikon ND2, Olympus OIB and OIF.

    file -> library of its format -> Image -> [micro] -> Reading

A file holds images (``series=``: scenes, positions), each with time steps and channels. Libraries
are of the extra ``micro``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._extras import install_command
from volspec.errors import DeviceError, VolumeError, one_line
from volspec.volume.channels import Channel
from volspec.volume.files.lattice import mm_per_unit, stack_slices
from volspec.volume.files.pages import resolve_spacing
from volspec.volume.files.query import ChoicesListed, Query, Reading

_OTHERWISE = (
    "save it as OME-TIFF in Fiji (File, Import, Bio-Formats), or as OME-Zarr with bioformats2raw"
)
# Errors of metadata that are not complete.
_UNSTATED = (KeyError, TypeError, ValueError, AttributeError, IndexError)


@dataclass(frozen=True, slots=True)
class Image:
    """Axes of one image of a file, and a function that reads a slice of it."""

    sizes: dict[str, int]  # by T, C, Z, Y, X
    dtype: Any
    read: Callable[[dict[str, int]], NDArray[Any]]  # (Y, X) of a place along T, C and Z
    um: Mapping[str, float | None]  # spacing along X, Y, Z
    channels: Sequence[str] = ()


def read_micro(query: Query) -> Reading:
    """Read a channel and a time step of an image."""
    query.allow("series", "channel", "time")
    package, open_image = _READERS[query.path.suffix.lower()]
    with ExitStack() as stack:
        try:
            image = open_image(query, stack)
            time = query.index("time", image.sizes.get("T", 1), "time steps")
            count = image.sizes.get("C", 1)
            channel = query.index("channel", count, "channels", image.channels)
            other_axes = {k: n for k, n in image.sizes.items() if k not in "TCZYX" and n > 1}
            if other_axes:
                raise VolumeError(
                    f"{query.path}: has axes other than x, y, z, channels and time: {other_axes}",
                    _OTHERWISE,
                    code="unsupported",
                )
            query.end_choices()
            shape = tuple(image.sizes.get(axis, 1) for axis in "ZYX")
            query.reserve(shape, np.dtype(image.dtype).itemsize)
            places = [{"T": time, "C": channel, "Z": z} for z in range(shape[0])]
            values = stack_slices(places, image.read).reshape(shape)
        except (VolumeError, ChoicesListed):
            raise
        except ImportError as error:
            raise DeviceError(
                f"{query.path}: needs {package}",
                f"{install_command('micro')}, or {_OTHERWISE}",
                code="unsupported",
            ) from error
        except Exception as error:  # whatever the library raises
            raise VolumeError(
                f"{query.path}: cannot be read ({one_line(error)[:120]})",
                f"copy it again, or {_OTHERWISE}",
                code="damaged",
            ) from error
    x, y, z = (um / 1e3 if (um := image.um.get(axis)) and um > 0 else None for axis in "XYZ")
    notes: list[str] = []
    spacing, metadata = resolve_spacing((x, y or x, z), query, notes, len(values))
    named = Channel(next(iter(image.channels[channel:]), ""))
    return Reading(values, spacing, None, notes, None, named, metadata)


def _series(query: Query, names: Sequence[str]) -> int:
    return query.index("series", len(names), "images", names)


def _czi(query: Query, stack: ExitStack) -> Image:
    from pylibCZIrw import czi

    file = stack.enter_context(czi.open_czi(str(query.path)))
    scenes = sorted(file.scenes_bounding_rectangle) or [None]
    scene = scenes[_series(query, [f"scene {number}" for number in scenes])]
    box = file.scenes_bounding_rectangle.get(scene, file.total_bounding_rectangle)
    sizes = {axis: high - low for axis, (low, high) in file.total_bounding_box.items()}
    metadata = file.metadata["ImageDocument"]["Metadata"]
    um, names = {}, []
    with suppress(*_UNSTATED):
        for distance in _ensure_list(metadata["Scaling"]["Items"]["Distance"]):
            um[distance["@Id"]] = float(distance["Value"]) * 1e6
    with suppress(*_UNSTATED):
        channels = metadata["Information"]["Image"]["Dimensions"]["Channels"]["Channel"]
        names = [channel.get("@Name", "") for channel in _ensure_list(channels)]
    one = file.read(roi=(box.x, box.y, 1, 1), scene=scene)
    is_colour = one.shape[-1] == 3 and sizes.get("C", 1) == 1

    def read(index: dict[str, int]) -> NDArray[Any]:
        part = 2 - index["C"] if is_colour else 0  # blue, green, red
        plane = index | {"C": 0} if is_colour else index
        return np.asarray(file.read(plane=plane, scene=scene)[..., part])

    sizes |= {"X": box.w, "Y": box.h} | ({"C": 3} if is_colour else {})
    return Image(sizes, one.dtype, read, um, names)


def _ensure_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _lif(query: Query, stack: ExitStack) -> Image:
    import liffile

    images = stack.enter_context(liffile.LifFile(query.path)).images
    image = images[_series(query, [image.name for image in images])]
    um = {
        axis: abs(float(places[1] - places[0])) * 1e6
        for axis, places in image.coords.items()
        if len(places) > 1
    }
    axes = [axis for axis in "TCZ" if axis in image.sizes]
    sizes = dict(image.sizes)
    return Image(sizes, image.dtype, lambda index: image.frame(**{k: index[k] for k in axes}), um)


def _nd2(query: Query, stack: ExitStack) -> Image:
    import nd2

    file = stack.enter_context(nd2.ND2File(query.path))
    sizes = dict(file.sizes)
    position = _series(query, [f"position {k}" for k in range(sizes.pop("P", 1))])
    sizes["C"] = sizes.get("C", 1) * sizes.pop("S", 1)
    numbers = {
        tuple(index.get(axis, 0) for axis in "TPZ"): number
        for number, index in enumerate(file.loop_indices or ({},))
    }

    def read(index: dict[str, int]) -> NDArray[Any]:
        frame = file.read_frame(numbers[index["T"], position, index["Z"]])
        if file.is_rgb:
            return frame[..., index["C"]]
        return frame[index["C"]] if frame.ndim > 2 else frame

    um, names = {}, []
    with suppress(Exception):  # of the library, if metadata are not complete
        channels = file.metadata.channels
        volume = channels[0].volume
        is_stated = volume.axesCalibrated
        um = {axis: volume.axesCalibration[k] for k, axis in enumerate("XYZ") if is_stated[k]}
        names = [channel.channel.name or "" for channel in channels]
    return Image(sizes, file.dtype, read, um, names)


def _oif(query: Query, stack: ExitStack) -> Image:
    import oiffile

    file = stack.enter_context(oiffile.OifFile(query.path))
    series, header = file.series[0], file.mainfile
    inner = dict(zip(file.axes, file.shape, strict=True))
    sizes = dict(zip(series.axes, series.shape, strict=True)) | {axis: inner[axis] for axis in "YX"}
    um: dict[str, float | None] = {}
    with suppress(*_UNSTATED):
        reference, depth = header["Reference Image Parameter"], header["Axis 3 Parameters Common"]
        um = {"X": float(reference["WidthConvertValue"])}
        um["Y"] = float(reference["HeightConvertValue"])
        um["Z"] = float(depth["Interval"]) * (mm_per_unit(depth["UnitName"]) or 0) * 1e3
    count = sizes.get("C", 1)
    names = [header.get(f"Channel {k + 1} Parameters", {}).get("DyeName", "") for k in range(count)]
    voxels = cache(file.asarray)

    def read(index: dict[str, int]) -> Any:
        return voxels()[tuple(index.get(axis, 0) for axis in series.axes)]

    return Image(sizes, file.dtype, read, um, names)


_READERS: dict[str, tuple[str, Callable[[Query, ExitStack], Image]]] = {
    ".czi": ("pylibCZIrw", _czi),
    ".lif": ("liffile", _lif),
    ".nd2": ("nd2", _nd2),
    ".oib": ("oiffile", _oif),
    ".oif": ("oiffile", _oif),
}
