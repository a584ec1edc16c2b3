"""The lattice around several fields in one space, in which their rays and lights are placed.

volume, tables by field -> [fields] -> raycast
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from volspec.errors import RaycastError
from volspec.raycast.launch.row_batches import Result
from volspec.raycast.spec import MAX_STEPS, RaycastSpec
from volspec.transfer import FieldTables, Tables
from volspec.volume import Volume

# Voxels of other fields' corners that may lie outside, by rounding.
_INSIDE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FieldCast:
    """Cast of one or several fields, and the lattice around all of them.

    ``frame`` has the axes of the volume, and its fields; it is the volume itself if that covers
    all. ``spec`` are the settings there. ``specs`` are those of each field by name, whose rays the
    frame's crop cuts, if there is one. ``several`` are the tables, None of a volume's own field
    alone, without a mask, which has kernels of its own.
    """

    several: FieldTables | None
    frame: Volume
    spec: RaycastSpec
    specs: Mapping[str, RaycastSpec]

    @property
    def cut_apart(self) -> bool:
        """True if a plane cuts some fields and not others."""
        return any(plane.fields for plane in self.spec.clip_planes)

    @classmethod
    def of(
        cls, volume: Volume, tables: Tables, spec: RaycastSpec, frame: Volume | None = None
    ) -> FieldCast:
        """Return the cast of a volume's fields; ``frame`` is from `frame_around`, if known.

        Raises RaycastError if a plane cuts an unknown field; of several, also as
        `RaycastSpec.check_fields`.
        """
        if not isinstance(tables, FieldTables):
            spec = spec.naming_fields(volume).for_field(volume.name)
            return cls(None, volume, spec, {volume.name: spec})
        spec.check_fields()
        frame = frame or frame_around(volume, tables.tables)
        # Every field takes the volume's steps.
        spec = replace(spec.naming_fields(volume), step_mm=spec.step_of(volume))
        uncropped = replace(spec, crop_voxels=None)
        specs = {name: uncropped.for_field(name) for name in tables.tables}
        if spec.crop_voxels is not None and frame is not volume:
            spec.kept(volume)  # refuses what is beyond
            first = volume.index_from_world @ frame.world_from_index[:, 3]
            x, y, z = (
                (low - round(origin), high - round(origin))
                for (low, high), origin in zip(spec.crop_voxels, first, strict=False)
            )
            spec = replace(spec, crop_voxels=(x, y, z))
        return cls(tables, frame, spec, specs)


def add_pictures(pictures: Sequence[Result]) -> Result:
    """Return the sum of fields' pictures, each cast alone; they are changed in place.

    C = Σ C_f, α = 1 − Π (1 − α_f); depths are means by α_f, and the nearest hit.
    """
    first, *remaining = pictures
    coefficients, alpha, depth_mm, first_mm = first
    limit = np.finfo(coefficients.dtype).max
    weight = alpha.copy()
    for channels, added, away_mm, hit_mm in remaining:
        coefficients[...] = np.clip(np.float32(coefficients) + channels, -limit, limit)
        alpha += added * (1.0 - alpha)
        visible, total = added > 0.0, weight + added
        near = np.where(weight > 0.0, depth_mm, 0.0)[visible] * weight[visible]
        depth_mm[visible] = (near + added[visible] * away_mm[visible]) / total[visible]
        np.minimum(first_mm, hit_mm, out=first_mm)
        weight = total
    return first


def frame_around(volume: Volume, names: Iterable[str]) -> Volume:
    """Return the lattice around some of a volume's fields, with its axes; itself if it covers them.

    >>> import numpy as np
    >>> inner = Volume(np.zeros((4, 4, 4)), spacing_mm=(0.5, 0.5, 0.5), name="inner")
    >>> outer = Volume(np.zeros((3, 3, 9)), name="outer")
    >>> frame_around(Volume(np.zeros((3, 3, 3)), fields=[inner, outer]), ["inner", "outer"])
    Volume('frame', 9x3x3 uint8 and 3 more, (1.0, 1.0, 1.0) mm)
    """
    matrix = volume.index_from_world
    corners = np.concatenate([volume.by_name[name].corners_mm for name in names])
    index = corners @ matrix[:3, :3].T + matrix[:3, 3]
    low = np.minimum(np.floor(index.min(axis=0) + _INSIDE), 0.0).astype(int)
    last = np.array(volume.shape_xyz) - 1
    high = np.maximum(np.ceil(index.max(axis=0) - _INSIDE), last).astype(int)
    shape = tuple((high - low + 1).tolist())
    if shape == volume.shape_xyz:
        return volume
    if max(shape) > MAX_STEPS:
        middle = volume.corners_mm.mean(axis=0)
        far = {name: np.abs(volume.by_name[name].corners_mm - middle).max() for name in names}
        name = max(far, key=far.__getitem__)
        raise RaycastError(
            f"field {name!r} reaches {far[name]:.3g} mm from the middle of {volume.name}, which is "
            f"{np.ptp(volume.corners_mm, axis=0).max():.3g} mm large",
            "check its spacing_mm and matrix, both in mm",
            code="range",
        )
    world = volume.world_from_index.copy()
    world[:3, 3] += world[:3, :3] @ low
    # A volume without voxels: one byte, seen as often as there would be. Checks would copy it.
    values = np.broadcast_to(np.zeros(1, np.uint8), shape[::-1])
    fields = (replace(volume, fields=()), *volume.fields)
    frame = copy(replace(volume, fields=()))
    attributes = {"values": values, "world_from_index": world, "name": "frame", "fields": fields}
    for key, value in attributes.items():
        object.__setattr__(frame, key, value)
    return frame


def common_dtype(fields: Iterable[Volume]) -> np.dtype[Any]:
    """Return the type in which the values of all fields are exact (float32 for wide ones).

    >>> import numpy as np
    >>> kinds = (np.uint8, np.int16)
    >>> common_dtype(Volume(np.zeros((2, 2, 2), kind)) for kind in kinds)
    dtype('int16')
    """
    dtype = np.result_type(*(field.values.dtype for field in fields))
    return dtype if dtype.itemsize <= 2 else np.dtype(np.float32)
