"""Handles in the picture: where the crop's box and the clip planes are taken hold of.

RaycastSpec, Projection -> [handles] -> mouse -> events
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from volspec.raycast import ClipPlane, RaycastSpec
from volspec.viewer.model.view.aids import Aids
from volspec.viewer.model.view.cuts import Array, Crop, anchor_mm, crop_of, distance_mm, world_mm
from volspec.viewer.model.view.projection import Place, Projection
from volspec.volume import Volume

# From a plane's middle to the handle that tilts it, and what keeps the two apart; pixels at 96 dpi.
ARM, APART = 64.0, 26.0


@dataclass(frozen=True, slots=True)
class Handle:
    """Something in the picture that can be dragged.

    Parameters
    ----------
    name : str
        The event that a drag makes.
    index : int
        Of the face (2 · axis, + 1 at the far end) or the plane.
    place : (x, y)
        Where it is drawn.
    held : (x, y)
        Where what it moves is seen; the same but where handles would cover one another.
    arm : float
        Of one that tilts: pixels from the plane's middle to the end of its axis.
    """

    name: str
    index: int
    place: Place
    held: Place
    arm: float = 0.0


def handles(
    shading: RaycastSpec, volume: Volume, seen: Projection, aids: Aids, scale: float
) -> tuple[Handle, ...]:
    """What can be dragged in the picture; nothing that stands behind the camera.

    Parameters
    ----------
    shading, volume : RaycastSpec, Volume
    seen : Projection
    aids : Aids
        Which are shown; only the plane that stands out can be tilted, and it comes first.
    scale : float
        Pixels of the window for each at 96 dpi.
    """
    found: list[Handle] = []
    if aids.planes:
        for i, plane in enumerate(shading.clip_planes):
            both = _plane_handles(i, plane, volume, seen, scale)
            found = [*both, *found] if i == aids.plane else [*found, *both[:1]]
    if aids.crop:
        bounds = crop_of(shading, volume)
        for face in range(6):
            x, y, depth = seen.placed(_face_mm(bounds, face, volume))
            if depth > 0:
                found.append(Handle("crop", face, (float(x), float(y)), (float(x), float(y))))
    return tuple(found)


def dragged(
    shading: RaycastSpec, volume: Volume, handle: Handle, place: Place, seen: Projection
) -> tuple[float, float]:
    """What a handle's event is to say when what it moves shall be seen at a place.

    Parameters
    ----------
    shading : RaycastSpec
        As it was when the handle was taken hold of.
    volume, handle, place, seen

    Returns
    -------
    (x, y)
        Of a face its voxel; of a plane that is shifted its distance from the volume's middle
        in mm; of one that is tilted the azimuth and elevation of its normal in degrees.
    """
    if handle.name == "crop":
        bounds = crop_of(shading, volume)
        axis, far = divmod(handle.index, 2)
        column = volume.world_from_index[:3, axis]
        spacing = float(np.linalg.norm(column))
        by = seen.along(_face_mm(bounds, handle.index, volume), column / spacing, place)
        return bounds[axis][far] + by / spacing, 0.0
    plane = shading.clip_planes[handle.index]
    anchor, normal = anchor_mm(plane, volume), np.asarray(plane.normal)
    if handle.name == "plane-shift":
        return distance_mm(plane, volume) + seen.along(anchor, normal, place), 0.0
    middle = seen.placed(anchor)
    x, y = (place[k] - float(middle[k]) for k in (0, 1))
    right, up, forward = seen.camera.frame()
    # On a ball around the plane's middle; the end of its axis that faces the eye follows.
    near = -math.copysign(1.0, float(normal @ forward))
    flat = math.hypot(x, y) / handle.arm
    depth = math.sqrt(max(1.0 - flat * flat, 0.0))
    tip = near * ((x * right - y * up) / (handle.arm * max(flat, 1.0)) - depth * forward)
    azimuth = math.degrees(math.atan2(float(tip[1]), float(tip[0])))
    return azimuth, math.degrees(math.asin(min(max(float(tip[2]), -1.0), 1.0)))


def _face_mm(crop: Crop, face: int, volume: Volume) -> Array:
    """The middle of one of the box's faces."""
    axis, far = divmod(face, 2)
    middle = np.array([(low + high) / 2 for low, high in crop])
    middle[axis] = crop[axis][far]
    return world_mm(volume, middle)


def _plane_handles(
    index: int, plane: ClipPlane, volume: Volume, seen: Projection, scale: float
) -> list[Handle]:
    """One in its middle to shift it, one at the end of its axis that faces the eye to tilt it."""
    x, y, depth = (float(v) for v in seen.placed(anchor_mm(plane, volume)))
    if depth <= 0:
        return []
    right, up, forward = seen.camera.frame()
    normal, arm = np.asarray(plane.normal), ARM * scale
    near = -math.copysign(arm, float(normal @ forward))
    tip = x + near * float(normal @ right), y - near * float(normal @ up)
    close = math.dist(tip, (x, y)) < APART * scale
    drawn = (x, y + APART * scale) if close else tip
    shift = Handle("plane-shift", index, (x, y), (x, y))
    return [shift, Handle("plane-tilt", index, drawn, tip, arm)]
