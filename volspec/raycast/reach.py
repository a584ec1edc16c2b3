"""Whether a cast of a volume can count with lights and a camera: how far, how fast they fall.

volume, camera, spec -> [reach] -> raycast
"""

from __future__ import annotations

import math
from functools import partial

from volspec.errors import CameraError, InputError, RaycastError
from volspec.raycast.camera import Camera
from volspec.raycast.lights import Point
from volspec.raycast.spec import RaycastSpec, diagonal_mm
from volspec.volume import Volume

# In diagonals of the volume: squares of much longer ways are not numbers in float32.
MAX_REACH = 1e9


def check_reach(volume: Volume, camera: Camera, spec: RaycastSpec) -> None:
    """Refuse what is farther than `MAX_REACH` times the volume's diagonal.

    Raises
    ------
    CameraError
        If the camera, its target or its picture reaches farther.
    RaycastError
        If a point light does, or its falloff, or that is as much too short.
    """
    middle = volume.corners_mm.mean(axis=0)
    check = partial(_check, volume)
    from_target = math.dist(camera.target_mm, middle)
    check("camera: position_mm to target_mm", camera.distance_mm, "come nearer", CameraError)
    check("camera: target_mm to the volume", from_target, "look at the volume", CameraError)
    check("camera: height_mm", camera.height_mm or 0.0, "give less", CameraError)
    for group in spec.groups:
        for source in group.sources:
            if not isinstance(source, Point):
                continue
            origin = middle if source.frame == "world" else (0.0, 0.0, 0.0)
            who, falloff = f"point light of {group.name!r}", source.falloff_mm
            check(f"{who}: its distance", math.dist(source.position_mm, origin), "take Directional")
            if falloff is None:
                continue
            check(f"{who}: falloff_mm", falloff, "leave it out")
            if falloff < diagonal_mm(volume) / MAX_REACH:
                raise RaycastError(
                    f"{who}: falloff_mm is {falloff:g}, {volume.name} {diagonal_mm(volume):g} mm "
                    f"across; give {diagonal_mm(volume) / MAX_REACH:.2g} or more"
                )


def _check(
    volume: Volume, what: str, mm: float, remedy: str, error: type[InputError] = RaycastError
) -> None:
    across = diagonal_mm(volume)
    if mm > MAX_REACH * across:
        raise error(
            f"{what} is {mm:g} mm and {volume.name} {across:g} mm across: more than "
            f"{MAX_REACH:g} times as far; {remedy}"
        )
