"""Imaris files, ``.ims``: HDF5 with resolution levels, through h5py.

    DataSet/ResolutionLevel 0/TimePoint 0/Channel 0/Data -> [imaris] -> Stack -> Reading

References
----------
[1] Imaris 5.5 file format, imaris.oxinst.com/support/imaris-file-format: ``ExtMin0 ExtMax0`` are
    the ends along x of all voxels, ``ImageSizeX`` their number; chunks at the ends are filled up.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from volspec.volume.channels import Channel
from volspec.volume.files.hdf5 import Dataset, if_larger, open_hdf5, read_finest, texts
from volspec.volume.files.lattice import affine, mm_per_unit
from volspec.volume.files.query import Query, Reading
from volspec.volume.levels.pyramid import Level, Stack
from volspec.volume.metadata import Metadata


def read_imaris(query: Query) -> Reading:
    """Read a channel and a time step of an Imaris file."""
    query.allow("channel", "time")
    return read_finest(query, _select_stack(query))


def imaris_stack(query: Query) -> Stack | None:
    """Return the levels of an Imaris file that is larger than memory; else None."""
    return if_larger(query, _select_stack)


def _select_stack(query: Query) -> Stack:
    """Return the levels of a channel and time step, finest first."""
    with open_hdf5(query) as file:
        info, first = file["DataSetInfo"], file["DataSet/ResolutionLevel 0"]
        channels = [_texts_of(info[f"Channel {c}"]) for c in range(len(first["TimePoint 0"]))]
        names = [channel.get("Name", "") for channel in channels]
        time = query.index("time", len(first), "time steps")
        number = query.index("channel", len(channels), "channels", names)
        image = _texts_of(info["Image"])
        low, high = ([float(image[f"Ext{end}{k}"]) for k in range(3)] for end in ("Min", "Max"))
        unit_mm = mm_per_unit(image.get("Unit")) or 1e-3
        levels = []
        for k in range(len(file["DataSet"])):
            place = f"DataSet/ResolutionLevel {k}/TimePoint {time}/Channel {number}"
            sizes = _texts_of(file[place])
            x, y, z = (int(sizes[f"ImageSize{axis}"]) for axis in "XYZ")
            array = Dataset(query.path, file, f"{place}/Data")
            array.shape = z, y, x  # chunks at the ends are filled up
            step = np.subtract(high, low) / (x, y, z) * unit_mm
            world = affine(np.diag(step), np.multiply(low, unit_mm) + step / 2)
            levels.append(Level(array, (0, 1, 2), (0, 0, 0), world, array.chunks or (z, y, x)))
        shade = [float(component) for component in channels[number].get("Color", "").split()]
        colour = (shade[0], shade[1], shade[2]) if len(shade) == 3 else None
        assumed = () if mm_per_unit(image.get("Unit")) else ("lengths in µm",)
        channel = Channel(names[number], colour)
        return Stack(levels, channel, metadata=Metadata(assumed=assumed))


def _texts_of(group: Any) -> dict[str, str]:
    """Return the attributes of a group, which are arrays of characters."""
    return {key: "".join(texts(text)) for key, text in group.attrs.items()}
