"""Microscopes' formats: Zeiss CZI, Leica LIF, Nikon ND2, Olympus OIB and OIF.

    file -> library of its format -> Image -> [micro] -> Reading

A file holds images (``series=``: scenes, positions), each with time steps and channels. Libraries
are of the extra ``micro``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import DeviceError, VolumeError, one_line
from volspec.volume.channels import Channel
from volspec.volume.files.lattice import mm_per_unit
from volspec.volume.files.query import ChoicesListed, Query, Reading
from volspec.volume.metadata import NO_SPACING, Metadata

_OTHERWISE = (
    "or save it as OME-TIFF in Fiji (File, Import, Bio-Formats), or as OME-Zarr with bioformats2raw"
)


@dataclass(frozen=True, slots=True)
class Image:
    """Axes of one image of a file, and a function that reads a volume of it."""

    sizes: dict[str, int]  # by T, C, Z, Y, X
    dtype: Any
    read: Callable[[int, int], NDArray[Any]]  # of a time step and a channel, as (Z, Y, X)
    um: Sequence[float | None] = (None, None, None)  # spacing along x, y, z
    channels: Sequence[str] = field(default_factory=list)


def read_micro(query: Query) -> Reading:
    """Read a channel and a time step of an image."""
    query.allow("series", "channel", "time")
    package, open_image = _READERS[query.path.suffix.lower()]
    with ExitStack() as stack:
        try:
            image = open_image(query, stack)
            others = {k: n for k, n in image.sizes.items() if k not in "TCZYX" and n > 1}
            time = query.index("time", image.sizes.get("T", 1), "time steps")
            count = image.sizes.get("C", 1)
            channel = query.index("channel", count, "channels", image.channels)
            if others:
                raise VolumeError(
                    f"{query.path}: has axes other than x, y, z, channels and time: {others}",
                    _OTHERWISE.removeprefix("or "),
                    code="unsupported",
                )
            query.end_choices()
            shape = tuple(image.sizes.get(axis, 1) for axis in "ZYX")
            query.reserve(shape, np.dtype(image.dtype).itemsize)
            values = image.read(time, channel).reshape(shape)
        except (VolumeError, ChoicesListed):
            raise
        except ImportError as error:
            raise DeviceError(
                f"{query.path}: needs {package}",
                f'pip install "volspec[micro]", {_OTHERWISE}',
                code="unsupported",
            ) from error
        except Exception as error:  # whatever the library raises
            raise damaged(query, error) from error
    spacing, remarks, metadata = _spacing(query, image.um)
    name = next(iter(image.channels[channel:]), "")
    return Reading(
        values, spacing, remarks=remarks, channel=Channel(name) if name else None, metadata=metadata
    )


def _spacing(
    query: Query, um: Sequence[float | None]
) -> tuple[tuple[float, float, float] | None, list[str], Metadata]:
    """Return the spacing in mm; a distance of slices that is not stated is that of pixels."""
    x, y, z = (each if each and each > 0 else None for each in um)
    if not x:
        return None, [], Metadata(assumed=(NO_SPACING,))
    remark = f"{query.path}: states no distance of slices; {x:g} µm, as between pixels, is assumed"
    unstated = z is None and query.spacing_mm is None
    return (x / 1e3, (y or x) / 1e3, (z or x) / 1e3), [remark] if unstated else [], Metadata()


def _series(query: Query, names: Sequence[str]) -> int:
    return query.index("series", len(names), "images", names)


def _czi(query: Query, stack: ExitStack) -> Image:
    from pylibCZIrw import czi

    file = stack.enter_context(czi.open_czi(str(query.path)))
    scenes = sorted(file.scenes_bounding_rectangle) or [None]
    scene = scenes[_series(query, [f"scene {each}" for each in scenes])]
    box = file.scenes_bounding_rectangle.get(scene, file.total_bounding_rectangle)
    sizes = {axis: high - low for axis, (low, high) in file.total_bounding_box.items()}
    stated = file.metadata["ImageDocument"]["Metadata"]
    um, names = {}, []
    with suppress(KeyError, TypeError, ValueError):
        for each in _listed(stated["Scaling"]["Items"]["Distance"]):
            um[each["@Id"]] = float(each["Value"]) * 1e6
    with suppress(KeyError, TypeError):
        channels = stated["Information"]["Image"]["Dimensions"]["Channels"]["Channel"]
        names = [each.get("@Name", "") for each in _listed(channels)]
    one = file.read(roi=(box.x, box.y, 1, 1), scene=scene)
    is_colour = one.shape[-1] == 3 and sizes.get("C", 1) == 1

    def read(time: int, channel: int) -> NDArray[Any]:
        plane = {"T": time, "C": 0 if is_colour else channel}
        part = 2 - channel if is_colour else 0  # blue, green, red
        return np.stack(
            [file.read(plane=plane | {"Z": z}, scene=scene)[..., part] for z in range(sizes["Z"])]
        )

    sizes |= {"X": box.w, "Y": box.h, "Z": sizes.get("Z", 1)} | ({"C": 3} if is_colour else {})
    return Image(sizes, one.dtype, read, [um.get(axis) for axis in "XYZ"], names)


def _listed(each: Any) -> list[Any]:
    return each if isinstance(each, list) else [each]


def _lif(query: Query, stack: ExitStack) -> Image:
    import liffile

    images = stack.enter_context(liffile.LifFile(query.path)).images
    image = images[_series(query, [each.name for each in images])]
    steps = {
        axis: abs(float(places[1] - places[0])) * 1e6
        for axis, places in image.coords.items()
        if len(places) > 1
    }

    def read(time: int, channel: int) -> NDArray[Any]:
        at = {"T": time, "C": channel}
        planes = [at | {"Z": z} for z in range(image.sizes.get("Z", 1))]
        known = [{k: n for k, n in plane.items() if k in image.sizes} for plane in planes]
        return np.stack([image.frame(**plane) for plane in known])

    return Image(dict(image.sizes), image.dtype, read, [steps.get(axis) for axis in "XYZ"])


def _nd2(query: Query, stack: ExitStack) -> Image:
    import nd2

    file = stack.enter_context(nd2.ND2File(query.path))
    sizes = dict(file.sizes)
    place = _series(query, [f"position {k}" for k in range(sizes.pop("P", 1))])
    sizes["C"] = sizes.get("C", 1) * sizes.pop("S", 1)

    def read(time: int, channel: int) -> NDArray[Any]:
        found = {
            at.get("Z", 0): number
            for number, at in enumerate(file.loop_indices or ({},))
            if at.get("T", 0) == time and at.get("P", 0) == place
        }
        frames = [file.read_frame(found[z]) for z in sorted(found)]
        if file.is_rgb:
            return np.stack([frame[..., channel] for frame in frames])
        return np.stack([frame[channel] if frame.ndim > 2 else frame for frame in frames])

    um: list[float | None] = [None, None, None]
    names: list[str] = []
    with suppress(Exception):  # of the library, if metadata are not complete
        channels = file.metadata.channels
        volume = channels[0].volume
        steps = zip(volume.axesCalibration, volume.axesCalibrated, strict=True)
        um = [step if is_stated else None for step, is_stated in steps]
        names = [each.channel.name or "" for each in channels]
    return Image(sizes, file.dtype, read, um, names)


def _oif(query: Query, stack: ExitStack) -> Image:
    import oiffile

    file = stack.enter_context(oiffile.OifFile(query.path))
    whole, stated = file.series[0], file.mainfile
    inner = dict(zip(file.axes, file.shape, strict=True))
    sizes = dict(zip(whole.axes, whole.shape, strict=True)) | {axis: inner[axis] for axis in "YX"}
    um: list[float | None] = [None, None, None]
    with suppress(KeyError, TypeError, ValueError):
        reference, depth = stated["Reference Image Parameter"], stated["Axis 3 Parameters Common"]
        um[:2] = (float(reference[f"{side}ConvertValue"]) for side in ("Width", "Height"))
        um[2] = float(depth["Interval"]) * (mm_per_unit(depth["UnitName"]) or 0) * 1e3
    count = sizes.get("C", 1)
    names = [stated.get(f"Channel {k + 1} Parameters", {}).get("DyeName", "") for k in range(count)]

    def read(time: int, channel: int) -> NDArray[Any]:
        at = {"T": time, "C": channel}
        return file.asarray()[tuple(at.get(axis, slice(None)) for axis in whole.axes)]

    return Image(sizes, file.dtype, read, um, names)


def damaged(query: Query, error: Exception) -> VolumeError:
    """Return the error of a file that its library cannot read."""
    return VolumeError(
        f"{query.path}: cannot be read ({one_line(error)[:120]})",
        f"copy it again, {_OTHERWISE}",
        code="damaged",
    )


_READERS: dict[str, tuple[str, Callable[[Query, ExitStack], Image]]] = {
    ".czi": ("pylibCZIrw", _czi),
    ".lif": ("liffile", _lif),
    ".nd2": ("nd2", _nd2),
    ".oib": ("oiffile", _oif),
    ".oif": ("oiffile", _oif),
}
