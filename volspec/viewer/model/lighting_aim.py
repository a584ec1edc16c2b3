"""Directions of light sources, and the handles that aim them in the picture.

state, projection -> [lighting_aim] -> handles -> mouse -> directions and places
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Place, Projection
from volspec.raycast import Directional, Point, RaycastSpec, Source, Spot
from volspec.viewer.model.cuts import CutHandle
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp, orbit_axes

HANDLE = "light"
# The radius at which a direction is square to the view, as a fraction of the picture's shorter
# side; a light behind the volume is up to twice as far from the middle.
RING = 0.23
# The least distance of a handle from the picture's edge, in pixels.
_EDGE = 14.0


class Placed(NamedTuple):
    """A light source, with the indices of its group and of itself within the group."""

    group: int
    number: int
    source: Source


def list_sources(shading: RaycastSpec) -> tuple[Placed, ...]:
    """Return all light sources in the order of their groups."""
    return tuple(
        Placed(g, s, source)
        for g, group in enumerate(shading.groups)
        for s, source in enumerate(group.sources)
    )


def camera_axes(state: ViewState) -> NDArray[np.float64]:
    """(3, 3) rows: the camera's right, up and back in the world."""
    right, up, forward = state.view.camera(state.document.volume).frame()
    return np.stack([right, up, -forward])


def eye_mm(state: ViewState) -> NDArray[np.float64]:
    """(3,) position of the camera."""
    return np.asarray(state.view.camera(state.document.volume).position_mm)


def in_camera(state: ViewState, point_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a point (3,) of the world in the camera's frame: right, up, back from the eye."""
    return np.asarray(camera_axes(state) @ (np.asarray(point_mm) - eye_mm(state)))


def axes_from_angles(state: ViewState, source: Source) -> NDArray[np.float64]:
    """(3, 3) rows: right, up and front, from which a source's azimuth and elevation count.

    In the world they are those of the camera's orbit: a light at the camera's angles shines like a
    headlight. In the camera's frame they are the camera's own.
    """
    if getattr(source, "frame", "world") == "camera":
        return np.eye(3)
    return orbit_axes(state.view.up)


def middle_mm(state: ViewState, source: Point) -> NDArray[np.float64]:
    """(3,) the volume's middle in a point light's frame."""
    middle = np.asarray(state.document.volume.corners_mm.mean(axis=0))
    return middle if source.frame == "world" else in_camera(state, middle)


def direction(state: ViewState, source: Source) -> NDArray[np.float64] | None:
    """(3,) unit vector from the volume to a lamp in its frame; None for other sources."""
    if isinstance(source, Directional):
        return np.asarray(source.towards)
    if isinstance(source, Point):
        offset = np.asarray(source.position_mm) - middle_mm(state, source)
        length = float(np.linalg.norm(offset))
        return offset / length if length > 0 else np.array([0.0, 0.0, 1.0])
    return None


def angles_deg(state: ViewState, source: Source) -> tuple[float, float] | None:
    """Return the azimuth and elevation of a lamp; None for other sources."""
    towards = direction(state, source)
    if towards is None:
        return None
    right, up, front = axes_from_angles(state, source)
    azimuth = math.degrees(math.atan2(float(towards @ right), float(towards @ front)))
    return azimuth, math.degrees(math.asin(clamp(float(towards @ up), -1.0, 1.0)))


def distance_mm(state: ViewState, source: Point) -> float:
    """Return the distance of a point light from the volume's middle."""
    return float(np.linalg.norm(np.asarray(source.position_mm) - middle_mm(state, source)))


def ring(projection: Projection) -> tuple[Place, float]:
    """Return the centre and radius of the circle of directions that are square to the view."""
    x, y, width, height = projection.area
    return (x + width / 2, y + height / 2), RING * min(width, height)


def is_behind(state: ViewState, source: Source) -> bool:
    """Return True if a lamp shines from behind the volume."""
    towards = direction(state, source)
    if towards is None:
        return False
    if getattr(source, "frame", "world") == "world":
        towards = camera_axes(state) @ towards
    return bool(towards[2] < 0)


def list_handles(state: ViewState, projection: Projection) -> tuple[CutHandle, ...]:
    """Return the handles of lamps: a point light's at its place, a spot's at its target.

    They are before the camera.

    A place outside of the picture is moved to its edge.

    A directional light's distance from the picture's middle is the angle between its direction and
    the view.
    """
    if not state.interface.overlays.lights:
        return ()
    (x, y), radius = ring(projection)
    axes, handles = camera_axes(state), []
    for index, (_, _, source) in enumerate(list_sources(state.shading)):
        if isinstance(source, Point):
            place = np.asarray(getattr(source, handle_field(source)))
            if source.frame == "camera":
                place = place @ axes + eye_mm(state)
            u, v, depth = (float(value) for value in projection.to_window(place))
            if depth <= 0:
                continue
        elif isinstance(source, Directional):
            towards = np.asarray(source.towards)
            right, up, back = towards if source.frame == "camera" else axes @ towards
            across = math.hypot(right, up)
            length = radius * math.atan2(across, back) / (math.pi / 2) / max(across, 1e-12)
            u, v = x + length * right, y - length * up
        else:
            continue
        handles.append(CutHandle(HANDLE, index, _inside((u, v), projection), (u, v)))
    return tuple(handles)


def handle_field(source: Source) -> str:
    """Return the field of a lamp that its handle sets."""
    return {Directional: "towards", Spot: "target_mm"}.get(type(source), "position_mm")


def _inside(place: Place, projection: Projection) -> Place:
    x, y, width, height = projection.area
    u = clamp(place[0], x + _EDGE, x + width - _EDGE)
    return u, clamp(place[1], y + _EDGE, y + height - _EDGE)


def unproject_handle(
    state: ViewState, source: Source, place: Place, projection: Projection
) -> NDArray[np.float64] | None:
    """(3,) direction or place, in a lamp's frame, whose handle is at a place in the window."""
    if isinstance(source, Directional):
        (x, y), radius = ring(projection)
        right, up = place[0] - x, y - place[1]
        angle = min(math.hypot(right, up) / radius * (math.pi / 2), math.pi)
        flat = math.sin(angle) / max(math.hypot(right, up), 1e-12)
        towards = np.array([flat * right, flat * up, math.cos(angle)])
        return towards if source.frame == "camera" else towards @ camera_axes(state)
    if isinstance(source, Point):
        # It moves in the plane through it that is parallel to the picture.
        axes, eye = camera_axes(state), eye_mm(state)
        position = np.asarray(getattr(source, handle_field(source)))
        world = position if source.frame == "world" else position @ axes + eye
        u, v, depth = (float(value) for value in projection.to_window(world))
        mm = projection.mm_per_px * max(depth, 0.0)
        step = np.array([(place[0] - u) * mm, (v - place[1]) * mm, 0.0])
        return position + (step @ axes if source.frame == "world" else step)
    return None
