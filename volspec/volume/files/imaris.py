"""Imaris files, ``.ims``: HDF5 with resolution levels, through h5py.

    DataSet/ResolutionLevel 0/TimePoint 0/Channel 0/Data -> [imaris] -> Reading

References
----------
[1] Imaris 5.5 file format, imaris.oxinst.com/support/imaris-file-format: ``ExtMin0 ExtMax0`` are
    the ends along x of all voxels, ``ImageSizeX`` their number; chunks at the ends are filled up.
"""

from __future__ import annotations

import numpy as np

from volspec.errors import DeviceError, VolumeError
from volspec.volume.channels import Channel
from volspec.volume.files.hdf5 import DAMAGE, Dataset, texts
from volspec.volume.files.lattice import affine, mm_per_unit
from volspec.volume.files.micro import damaged
from volspec.volume.files.query import Query, Reading
from volspec.volume.pyramid import Level, Stack

_ENDS = "Min", "Max"


def read_imaris(query: Query) -> Reading:
    """Read a channel and a time step of an Imaris file."""
    query.allow("channel", "time")
    levels, channel = _imaris(query)
    query.end_choices()
    finest = levels[0]
    query.reserve(finest.shape, finest.dtype.itemsize)
    try:
        values = finest.array[tuple(slice(n) for n in finest.shape)]
    except DAMAGE as error:
        raise damaged(query, error) from error
    return Reading(values, world_from_index=finest.world_from_index, channel=channel)


def imaris_stack(query: Query) -> Stack | None:
    """Return the levels of an Imaris file that is larger than memory; else None."""
    if query.choices is not None or query.path.stat().st_size <= query.most_bytes // 100:
        return None
    levels, channel = _imaris(query)
    return None if levels[0].nbytes <= query.most_bytes else Stack(levels, channel)


def _imaris(query: Query) -> tuple[list[Level], Channel]:
    """Return the levels of a channel and time step, finest first."""
    try:
        import h5py

        with h5py.File(query.path, "r") as file:
            info = file["DataSetInfo"]
            first = file["DataSet/ResolutionLevel 0"]
            channels = [dict(info[f"Channel {c}"].attrs) for c in range(len(first["TimePoint 0"]))]
            names = ["".join(texts(each.get("Name", ""))) for each in channels]
            time = query.index("time", len(first), "time steps")
            number = query.index("channel", len(channels), "channels", names)
            stated = {key: "".join(texts(text)) for key, text in info["Image"].attrs.items()}
            low, high = (np.array([float(stated[f"Ext{e}{k}"]) for k in range(3)]) for e in _ENDS)
            unit_mm = mm_per_unit(stated.get("Unit")) or 1e-3
            places = [
                f"DataSet/ResolutionLevel {k}/TimePoint {time}/Channel {number}"
                for k in range(len(file["DataSet"]))
            ]
            sizes = [
                [int("".join(texts(file[place].attrs[f"ImageSize{axis}"]))) for axis in "XYZ"]
                for place in places
            ]
        levels = []
        for place, (x, y, z) in zip(places, sizes, strict=True):
            array = Dataset(query.path, f"{place}/Data")
            array.shape = z, y, x  # chunks at the ends are filled up
            step = (high - low) / (x, y, z) * unit_mm
            world = affine(np.diag(step), low * unit_mm + step / 2)
            levels.append(Level(array, (0, 1, 2), (0, 0, 0), world, array.chunks or (z, y, x)))
        shade = [float(each) for each in "".join(texts(channels[number].get("Color", ""))).split()]
        colour = (shade[0], shade[1], shade[2]) if len(shade) == 3 else None
        return levels, Channel(names[number], colour)
    except ImportError as error:
        raise DeviceError(
            f'{query.path}: is an Imaris file, which needs h5py; pip install "volspec[hdf5]"',
            code="unsupported",
        ) from error
    except VolumeError:
        raise
    except DAMAGE as error:
        raise damaged(query, error) from error
