"""Crop box and clip planes: geometry, handles, edits and commands.

    state, projection -> [cuts] -> outlines, handles -> mouse, keys -> RaycastSpec

The crop box is aligned with the voxel axes; clip planes are given in world coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Place, Projection, radius_mm
from volspec.errors import InputError
from volspec.raycast import MAX_PLANES, ClipPlane, RaycastSpec, framing
from volspec.settings import Vector
from volspec.viewer.model.edit import (
    Change,
    Command,
    Edited,
    bind,
    edit,
    refusable,
    switch,
    with_interface,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp, vector
from volspec.volume import Volume

Array = NDArray[np.float64]
# Planes closer to each other than this fraction of the volume's radius count as the same.
_SAME = 1e-3


def box_corners_mm(crop: framing.Crop, volume: Volume) -> Array:
    """(2, 2, 2, 3) corners, indexed by their sides along x, y and z."""
    return framing.world_mm(volume, np.stack(np.meshgrid(*crop, indexing="ij"), axis=-1))


# The box's corners by their sides along x, y and z, and its edges: two corners and the two faces
# that meet there (2 · axis, + 1 at the far end).
_CORNERS = list(np.ndindex(2, 2, 2))
_EDGES = [
    (i, i ^ bit, [2 * o + _CORNERS[i][o] for o in range(3) if o != axis])
    for axis, bit in enumerate((4, 2, 1))
    for i in range(8)
    if not i & bit
]


def box_edges(
    crop: framing.Crop, volume: Volume, projection: Projection
) -> list[tuple[Place, Place, bool]]:
    """Return the box's edges in the window, each with True if the box itself hides it."""
    corners = box_corners_mm(crop, volume).reshape(8, 3)
    facing = _front_faces(crop, volume, projection)
    starts, ends = (corners[[edge[k] for edge in _EDGES]] for k in (0, 1))
    drawn = projection.segments(starts, ends)
    return [
        (*line, not any(facing[face] for face in faces))
        for line, (_, _, faces) in zip(drawn, _EDGES, strict=True)
        if line is not None
    ]


def _front_faces(crop: framing.Crop, volume: Volume, projection: Projection) -> NDArray[np.bool_]:
    """(6,) True for each face whose outside faces the camera, by voxel coordinates."""
    camera, index_from_world = projection.camera, volume.index_from_world
    if camera.height_mm is None:
        eye = index_from_world[:3, :3] @ camera.position_mm + index_from_world[:3, 3]
        sides = [[coord < low, coord > high] for coord, (low, high) in zip(eye, crop, strict=True)]
        return np.array(sides).ravel()
    towards = index_from_world[:3, :3] @ camera.frame()[2]
    return np.array([[component > 0, component < 0] for component in towards]).ravel()


def anchor_mm(plane: ClipPlane, volume: Volume) -> Array:
    """Return the place of a plane's handles: its own point, or a nearer one if that is far off."""
    centre, point = volume.corners_mm.mean(axis=0), np.asarray(plane.point_mm)
    if np.linalg.norm(point - centre) <= radius_mm(volume):
        return point
    return np.asarray(centre + distance_mm(plane, volume) * np.asarray(plane.normal))


def distance_mm(plane: ClipPlane, volume: Volume) -> float:
    """Return the distance from the volume's middle to a plane, along its normal."""
    centre = volume.corners_mm.mean(axis=0)
    return float((np.asarray(plane.point_mm) - centre) @ np.asarray(plane.normal))


def outline_mm(point: Array, normal: Array, corners: Array) -> Array:
    """(N, 3) corners of the polygon where a plane cuts a box; empty if it misses the box."""
    flat = corners.reshape(8, 3)
    heights = (flat - point) @ normal
    cuts = []
    for i, j in ((i, i ^ bit) for bit in (1, 2, 4) for i in range(8) if not i & bit):
        a, b = heights[i], heights[j]
        if (a <= 0 < b) or (b <= 0 < a):
            cuts.append(flat[i] + a / (a - b) * (flat[j] - flat[i]))
    if len(cuts) < 3:
        return np.empty((0, 3))
    ring = np.array(cuts)
    spokes = ring - ring.mean(axis=0)
    across = spokes[0] / (float(np.linalg.norm(spokes[0])) or 1.0)
    order = np.argsort(np.arctan2(spokes @ np.cross(normal, across), spokes @ across))
    return np.asarray(ring[order])


# Pixels at 96 dpi: from a plane's middle to the handle that tilts it, the least distance between
# the two, and how near to a handle the mouse grips it.
ARM, APART, _GRIP = 64.0, 26.0, 11.0


@dataclass(frozen=True, slots=True)
class CutHandle:
    """A handle of the crop box or of a clip plane, in the window.

    ``anchor`` is the projection of the face or axis; ``place`` is moved off it if handles overlap.
    ``arm`` is the distance of a tilting handle's end from the plane's middle, in pixels.
    """

    name: str  # crop, plane-shift or plane-tilt
    index: int  # of the face (2 · axis, + 1 at the far end) or the plane
    place: Place
    anchor: Place
    arm: float = 0.0


def list_handles(state: ViewState, projection: Projection, scale: float) -> tuple[CutHandle, ...]:
    """Return the handles of the crop box and the clip planes in front of the camera.

    Only the chosen plane can be tilted, and its handles come first. ``scale`` is the window's
    pixel density relative to 96 dpi.
    """
    overlays, shading, volume = state.interface.overlays, state.shading, state.document.volume
    handles: list[CutHandle] = []
    if overlays.planes:
        for i, plane in enumerate(shading.clip_planes):
            both = _plane_handles(i, plane, volume, projection, scale)
            handles = [*both, *handles] if i == overlays.plane else [*handles, *both[:1]]
    if overlays.crop:
        bounds = framing.crop_bounds(shading, volume)
        for face in range(6):
            x, y, depth = (float(v) for v in projection.to_window(_face_mm(bounds, face, volume)))
            if depth > 0:
                handles.append(CutHandle("crop", face, (x, y), (x, y)))
    return tuple(handles)


def drag_handle(
    shading: RaycastSpec, volume: Volume, handle: CutHandle, place: Place, projection: Projection
) -> tuple[float, float]:
    """Return the numbers with which `move_handle` moves a handle to a place in the window.

    For a face: its voxel. For a plane: its distance from the volume's middle in mm, or its normal's
    azimuth and elevation in degrees. ``shading`` and ``handle`` are from the start of the drag.
    """
    if handle.name == "crop":
        bounds = framing.crop_bounds(shading, volume)
        axis, far = divmod(handle.index, 2)
        column = volume.world_from_index[:3, axis]
        spacing = float(np.linalg.norm(column))
        by = projection.nearest_on_line(
            _face_mm(bounds, handle.index, volume), column / spacing, place
        )
        return bounds[axis][far] + by / spacing, 0.0
    plane = shading.clip_planes[handle.index]
    anchor, normal = anchor_mm(plane, volume), np.asarray(plane.normal)
    if handle.name == "plane-shift":
        return distance_mm(plane, volume) + projection.nearest_on_line(anchor, normal, place), 0.0
    middle = projection.to_window(anchor)
    x, y = (place[k] - float(middle[k]) for k in (0, 1))
    right, up, forward = projection.camera.frame()
    # An arcball around the plane's middle; the end of its axis that faces the eye follows.
    near = -math.copysign(1.0, float(normal @ forward))
    flat = math.hypot(x, y) / handle.arm
    depth = math.sqrt(max(1.0 - flat * flat, 0.0))
    tip = near * ((x * right - y * up) / (handle.arm * max(flat, 1.0)) - depth * forward)
    azimuth = math.degrees(math.atan2(float(tip[1]), float(tip[0])))
    return azimuth, math.degrees(math.asin(clamp(float(tip[2]), -1.0, 1.0)))


def _face_mm(crop: framing.Crop, face: int, volume: Volume) -> Array:
    """(3,) middle of a face of the box."""
    axis, far = divmod(face, 2)
    middle = np.array([(low + high) / 2 for low, high in crop])
    middle[axis] = crop[axis][far]
    return framing.world_mm(volume, middle)


def _plane_handles(
    index: int, plane: ClipPlane, volume: Volume, projection: Projection, scale: float
) -> list[CutHandle]:
    """Return the handle at a plane's middle that shifts it, and one on its axis that tilts it."""
    x, y, depth = (float(v) for v in projection.to_window(anchor_mm(plane, volume)))
    if depth <= 0:
        return []
    right, up, forward = projection.camera.frame()
    normal, arm = np.asarray(plane.normal), ARM * scale
    near = -math.copysign(arm, float(normal @ forward))
    tip = x + near * float(normal @ right), y - near * float(normal @ up)
    close = math.dist(tip, (x, y)) < APART * scale
    drawn = (x, y + APART * scale) if close else tip
    shift = CutHandle("plane-shift", index, (x, y), (x, y))
    return [shift, CutHandle("plane-tilt", index, drawn, tip, arm)]


def nearest_handle(handles: tuple[CutHandle, ...], place: Place, scale: float) -> CutHandle | None:
    """Return the handle that a press at a place in the window grips."""
    handle = min(handles, key=lambda grip: math.dist(grip.place, place), default=None)
    if handle is None or math.dist(handle.place, place) > _GRIP * scale:
        return None
    return handle


@edit
def move_crop(state: ViewState, face: int, voxel: float) -> ViewState:
    """Move a face of the crop box to a voxel; a box around the whole volume removes the crop."""
    if not 0 <= face < 6:
        return state
    volume, (axis, far) = state.document.volume, divmod(face, 2)
    crop = list(framing.crop_bounds(state.shading, volume))
    low, high = crop[axis]
    last = volume.shape_xyz[axis] - 1.0
    if far:
        high = clamp(voxel, low + framing.MIN_CROP, last)
    else:
        low = clamp(voxel, 0.0, high - framing.MIN_CROP)
    crop[axis] = low, high
    uncropped = all(pair == (0.0, n - 1.0) for pair, n in zip(crop, volume.shape_xyz, strict=True))
    x, y, z = crop
    return _with_cuts(state, crop_voxels=None if uncropped else (x, y, z))


@refusable
def add_plane(state: ViewState, normal: Vector) -> ViewState:
    """Add a clip plane through the volume's middle, and choose it."""
    volume, planes = state.document.volume, state.shading.clip_planes
    new = ClipPlane(vector(volume.corners_mm.mean(axis=0)), normal)
    for plane in planes:
        near = abs(distance_mm(plane, volume)) <= _SAME * radius_mm(volume)
        if near and math.dist(plane.normal, new.normal) <= _SAME:
            raise InputError(
                "A clip plane lies here already; move that one first", code="duplicate"
            )
    if len(planes) >= MAX_PLANES:
        raise InputError(f"The limit is {MAX_PLANES} clip planes; remove one first", code="size")
    selected = with_overlays(state, plane=len(planes), planes=True)
    return _with_cuts(selected, clip_planes=(*planes, new))


@edit
def shift_plane(state: ViewState, index: int, mm: float) -> ViewState:
    """Move a clip plane along its normal to a distance from the volume's middle."""
    volume = state.document.volume

    def change(plane: ClipPlane) -> ClipPlane:
        reach = radius_mm(volume)
        by = clamp(mm, -reach, reach) - distance_mm(plane, volume)
        point = anchor_mm(plane, volume) + by * np.asarray(plane.normal)
        return replace(plane, point_mm=vector(point))

    return _with_plane(state, index, change)


@edit
def tilt_plane(state: ViewState, index: int, azimuth: float, elevation: float) -> ViewState:
    """Turn a clip plane's normal to a direction of the world, in degrees."""
    azimuth = math.radians(math.fmod(azimuth, 360.0))
    elevation = math.radians(clamp(elevation, -90.0, 90.0))
    flat = math.cos(elevation)
    normal = flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)

    def change(plane: ClipPlane) -> ClipPlane:
        anchor = vector(anchor_mm(plane, state.document.volume))
        return replace(plane, point_mm=anchor, normal=normal)

    return _with_plane(state, index, change)


@edit
def flip_plane(state: ViewState, index: int) -> ViewState:
    """Cut away the other side of a plane."""

    def change(plane: ClipPlane) -> ClipPlane:
        return replace(plane, normal=vector(-np.asarray(plane.normal)))

    return _with_plane(state, index, change)


@edit
def remove_plane(state: ViewState, index: int) -> ViewState:
    """Remove a clip plane."""
    return _with_plane(state, index, lambda _: None)


@edit
def choose_plane(state: ViewState, index: int) -> ViewState:
    """Choose the clip plane that has handles."""
    if not 0 <= index < len(state.shading.clip_planes):
        return state
    return with_overlays(state, plane=index)


def move_handle(state: ViewState, handle: CutHandle, x: float, y: float) -> ViewState:
    """Apply a handle's edit; ``x`` and ``y`` are the numbers from `drag_handle`."""
    match handle.name:
        case "crop":
            return move_crop(state, handle.index, x)
        case "plane-shift":
            return shift_plane(state, handle.index, x)
        case _:
            return tilt_plane(state, handle.index, x, y)


def _with_cuts(state: ViewState, **changes: Any) -> ViewState:
    return replace(state, shading=replace(state.shading, **changes))


def _with_plane(
    state: ViewState, index: int, change: Callable[[ClipPlane], ClipPlane | None]
) -> ViewState:
    """Replace a clip plane, or remove it if ``change`` returns None."""
    planes = state.shading.clip_planes
    if not 0 <= index < len(planes):
        return state
    new = change(planes[index])
    rows = (*planes[:index], *([] if new is None else [new]), *planes[index + 1 :])
    return _with_cuts(state, clip_planes=rows)


def with_overlays(state: ViewState, **changes: Any) -> ViewState:
    """Return the state with fields of its `Overlays` changed."""
    return with_interface(state, overlays=replace(state.interface.overlays, **changes))


def _add_facing(state: ViewState) -> Edited:
    return add_plane(state, vector(state.view.camera(state.document.volume).frame()[2]))


def _add_across(state: ViewState, axis: int) -> Edited:
    return add_plane(state, vector(state.document.volume.world_from_index[:3, axis]))


def _on_chosen_plane(change: Callable[[ViewState, int], ViewState]) -> Change:
    return lambda state: change(state, state.interface.overlays.plane)


COMMANDS = (
    switch("interface.overlays.crop", "crop", "Cut", "Crop box", ("c",)),
    Command(
        "reset-crop",
        "Cut",
        "Remove the crop",
        ("ctrl+shift+x",),
        bind(_with_cuts, crop_voxels=None),
    ),
    Command("plane-facing", "Cut", "Add a clip plane facing you", ("p",), _add_facing),
    *(
        Command(f"plane-{name}", "Cut", f"Add a clip plane across {name}", (), bind(_add_across, i))
        for i, name in enumerate("xyz")
    ),
    Command("flip-plane", "Cut", "Flip the clip plane", (), _on_chosen_plane(flip_plane)),
    Command("remove-plane", "Cut", "Remove the clip plane", (), _on_chosen_plane(remove_plane)),
    Command("remove-planes", "Cut", "Remove all clip planes", (), bind(_with_cuts, clip_planes=())),
    switch("interface.overlays.planes", "planes", "Cut", "Clip planes' handles"),
)
