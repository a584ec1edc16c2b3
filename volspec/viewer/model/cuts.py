"""Crop box and clip planes: mathematics, handles, edits and commands.

    state, projection -> [cuts] -> outlines, handles -> mouse, keys -> RaycastSpec

The crop box is aligned with the voxels, planes with the world.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import InputError
from volspec.raycast import ClipPlane, RaycastSpec
from volspec.raycast.spec import MAX_PLANES, Bounds
from volspec.viewer.model.edit import Change, Command, edit, refusable
from volspec.viewer.model.projection import Place, Projection
from volspec.viewer.model.state import Aids, ViewState
from volspec.viewer.model.view import Vector, radius_mm, vector
from volspec.volume import Volume

Array = NDArray[np.float64]
Crop = tuple[Bounds, Bounds, Bounds]
# Planes that lie together to this share of the volume's radius cut alike.
_SAME = 1e-3
# Voxels that a crop leaves at least along each axis.
LEAST = 1.0


def crop_of(shading: RaycastSpec, volume: Volume) -> Crop:
    """What stays along each axis, in voxels, also where nothing is cropped."""
    last = np.array(volume.shape_xyz) - 1.0
    given = shading.crop_voxels or tuple((0.0, float(end)) for end in last)
    # A scene's crop may reach beyond the volume, or miss it.
    low = np.clip([pair[0] for pair in given], 0.0, last - LEAST)
    high = np.clip([pair[1] for pair in given], low + LEAST, last)
    x, y, z = ((float(a), float(b)) for a, b in zip(low, high, strict=True))
    return x, y, z


def with_crop_face(shading: RaycastSpec, volume: Volume, face: int, at: float) -> RaycastSpec:
    """One face of the crop elsewhere; a voxel is left, and a whole volume is no crop."""
    if not 0 <= face < 6:
        return shading
    axis, far = divmod(face, 2)
    crop = list(crop_of(shading, volume))
    low, high = crop[axis]
    last = volume.shape_xyz[axis] - 1.0
    if far:
        high = min(max(at, low + LEAST), last)
    else:
        low = min(max(at, 0.0), high - LEAST)
    crop[axis] = low, high
    whole = all(pair == (0.0, n - 1.0) for pair, n in zip(crop, volume.shape_xyz, strict=True))
    x, y, z = crop
    return replace(shading, crop_voxels=None if whole else (x, y, z))


def world_mm(volume: Volume, index: Array) -> Array:
    """(…, 3) voxel indices (x, y, z) as places in the world."""
    return np.asarray(index @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3])


def box_corners_mm(crop: Crop, volume: Volume) -> Array:
    """(2, 2, 2, 3) corners, the axes by x, y, z."""
    return world_mm(volume, np.stack(np.meshgrid(*crop, indexing="ij"), axis=-1))


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
    crop: Crop, volume: Volume, projection: Projection
) -> list[tuple[Place, Place, bool]]:
    """The box's edges in the window, and whether its own faces hide each."""
    corners = box_corners_mm(crop, volume).reshape(8, 3)
    facing = _facing(crop, volume, projection)
    starts, ends = (corners[[edge[k] for edge in _EDGES]] for k in (0, 1))
    drawn = projection.segments(starts, ends)
    return [
        (*line, not any(facing[face] for face in faces))
        for line, (_, _, faces) in zip(drawn, _EDGES, strict=True)
        if line is not None
    ]


def _facing(crop: Crop, volume: Volume, projection: Projection) -> NDArray[np.bool_]:
    """(6,) whether each face is seen from outside: whether the eye is beyond it, in voxels."""
    camera, index_from_world = projection.camera, volume.index_from_world
    if camera.height_mm is None:
        eye = index_from_world[:3, :3] @ camera.position_mm + index_from_world[:3, 3]
        return np.array(
            [[eye[k] < low, eye[k] > high] for k, (low, high) in enumerate(crop)]
        ).ravel()
    towards = index_from_world[:3, :3] @ camera.frame()[2]
    return np.array([[along > 0, along < 0] for along in towards]).ravel()


def anchor_mm(plane: ClipPlane, volume: Volume) -> Array:
    """Where a plane is held: its own point, or where that is far off, one near the middle."""
    centre = volume.corners_mm.mean(axis=0)
    point, normal = np.asarray(plane.point_mm), np.asarray(plane.normal)
    if np.linalg.norm(point - centre) <= radius_mm(volume):
        return point
    return np.asarray(centre + normal * ((point - centre) @ normal))


def distance_mm(plane: ClipPlane, volume: Volume) -> float:
    """From the volume's middle to a plane, along its normal."""
    centre = volume.corners_mm.mean(axis=0)
    return float((np.asarray(plane.point_mm) - centre) @ np.asarray(plane.normal))


def with_plane(shading: RaycastSpec, volume: Volume, normal: Vector) -> RaycastSpec:
    """Add a clip plane through the volume's middle.

    Raises
    ------
    InputError
        If there is one already, no room for another, or the normal is 0.
    """
    new = ClipPlane(vector(volume.corners_mm.mean(axis=0)), normal)
    for plane in shading.clip_planes:
        near = abs(distance_mm(plane, volume)) <= _SAME * radius_mm(volume)
        if near and math.dist(plane.normal, new.normal) <= _SAME:
            raise InputError("A clip plane lies here already; move that one first")
    if len(shading.clip_planes) >= MAX_PLANES:
        raise InputError(f"{MAX_PLANES} clip planes are the most; remove one first")
    return replace(shading, clip_planes=(*shading.clip_planes, new))


def with_clip_plane(shading: RaycastSpec, index: int, plane: ClipPlane | None) -> RaycastSpec:
    """One plane replaced, or removed; all as they are where there is no such plane."""
    planes = shading.clip_planes
    if not 0 <= index < len(planes):
        return shading
    new = () if plane is None else (plane,)
    return replace(shading, clip_planes=(*planes[:index], *new, *planes[index + 1 :]))


def with_plane_distance(
    shading: RaycastSpec, volume: Volume, index: int, distance: float
) -> RaycastSpec:
    """A plane at another distance from the volume's middle, within what it can cut."""
    if not 0 <= index < len(shading.clip_planes):
        return shading
    plane = shading.clip_planes[index]
    reach = radius_mm(volume)
    by = min(max(distance, -reach), reach) - distance_mm(plane, volume)
    point = anchor_mm(plane, volume) + by * np.asarray(plane.normal)
    return with_clip_plane(shading, index, replace(plane, point_mm=vector(point)))


def with_plane_normal(
    shading: RaycastSpec, volume: Volume, index: int, azimuth_deg: float, elevation_deg: float
) -> RaycastSpec:
    """A plane turned about where it is held; angles of its normal about the world's axes."""
    if not 0 <= index < len(shading.clip_planes):
        return shading
    plane = shading.clip_planes[index]
    azimuth, elevation = math.radians(math.fmod(azimuth_deg, 360.0)), math.radians(elevation_deg)
    flat = math.cos(elevation)
    normal = flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)
    return with_clip_plane(shading, index, ClipPlane(vector(anchor_mm(plane, volume)), normal))


def with_plane_flipped(shading: RaycastSpec, index: int) -> RaycastSpec:
    """The other side of a plane stays."""
    if not 0 <= index < len(shading.clip_planes):
        return shading
    plane = shading.clip_planes[index]
    x, y, z = plane.normal
    return with_clip_plane(shading, index, replace(plane, normal=(-x, -y, -z)))


def outline_mm(point: Array, normal: Array, corners: Array) -> Array:
    """(N, 3) the polygon that a plane cuts out of a box; empty where it misses."""
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
    across = spokes[0] / max(float(np.linalg.norm(spokes[0])), 1e-12)
    order = np.argsort(np.arctan2(spokes @ np.cross(normal, across), spokes @ across))
    return np.asarray(ring[order])


# From a plane's middle to the handle that tilts it, and what keeps the two apart; pixels at 96 dpi.
ARM, APART = 64.0, 26.0


@dataclass(frozen=True, slots=True)
class Handle:
    """Something in the picture that can be dragged.

    Parameters
    ----------
    name : str
        ``crop``, ``plane-shift`` or ``plane-tilt``.
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


def handles_at(
    shading: RaycastSpec, volume: Volume, projection: Projection, aids: Aids, scale: float
) -> tuple[Handle, ...]:
    """What can be dragged in the picture; nothing that stands behind the camera.

    Parameters
    ----------
    shading, volume : RaycastSpec, Volume
    projection : Projection
    aids : Aids
        Which are shown; only the plane that stands out can be tilted, and it comes first.
    scale : float
        Pixels of the window for each at 96 dpi.
    """
    found: list[Handle] = []
    if aids.planes:
        for i, plane in enumerate(shading.clip_planes):
            both = _plane_handles(i, plane, volume, projection, scale)
            found = [*both, *found] if i == aids.plane else [*found, *both[:1]]
    if aids.crop:
        bounds = crop_of(shading, volume)
        for face in range(6):
            x, y, depth = projection.placed(_face_mm(bounds, face, volume))
            if depth > 0:
                found.append(Handle("crop", face, (float(x), float(y)), (float(x), float(y))))
    return tuple(found)


def drag_handle(
    shading: RaycastSpec, volume: Volume, handle: Handle, place: Place, projection: Projection
) -> tuple[float, float]:
    """Place a handle so that what it moves is seen at a place.

    Parameters
    ----------
    shading : RaycastSpec
        As it was when the handle was taken hold of.
    volume, handle, place, projection

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
        by = projection.along(_face_mm(bounds, handle.index, volume), column / spacing, place)
        return bounds[axis][far] + by / spacing, 0.0
    plane = shading.clip_planes[handle.index]
    anchor, normal = anchor_mm(plane, volume), np.asarray(plane.normal)
    if handle.name == "plane-shift":
        return distance_mm(plane, volume) + projection.along(anchor, normal, place), 0.0
    middle = projection.placed(anchor)
    x, y = (place[k] - float(middle[k]) for k in (0, 1))
    right, up, forward = projection.camera.frame()
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
    index: int, plane: ClipPlane, volume: Volume, projection: Projection, scale: float
) -> list[Handle]:
    """One in its middle to shift it, one at the end of its axis that faces the eye to tilt it."""
    x, y, depth = (float(v) for v in projection.placed(anchor_mm(plane, volume)))
    if depth <= 0:
        return []
    right, up, forward = projection.camera.frame()
    normal, arm = np.asarray(plane.normal), ARM * scale
    near = -math.copysign(arm, float(normal @ forward))
    tip = x + near * float(normal @ right), y - near * float(normal @ up)
    close = math.dist(tip, (x, y)) < APART * scale
    drawn = (x, y + APART * scale) if close else tip
    shift = Handle("plane-shift", index, (x, y), (x, y))
    return [shift, Handle("plane-tilt", index, drawn, tip, arm)]


# So near the mouse takes hold of a handle; pixels at 96 dpi.
_GRIP = 11.0


def handles_of(state: ViewState, projection: Projection, scale: float) -> tuple[Handle, ...]:
    """Those in the picture; ``scale`` as `volspec.viewer.model.cuts.handles`."""
    aids, shading = state.interface.aids, state.shading
    if not (aids.crop or (aids.planes and shading.clip_planes)):
        return ()
    return handles_at(shading, state.document.volume, projection, aids, scale)


def nearest_handle(found: tuple[Handle, ...], place: Place, scale: float) -> Handle | None:
    """The handle that a press at a place of the window takes hold of."""
    handle = min(found, key=lambda each: math.dist(each.place, place), default=None)
    if handle is None or math.dist(handle.place, place) > _GRIP * scale:
        return None
    return handle


# Beyond this no volume reaches, and float64 keeps its digits.
_MOST = 1e9


@edit
def move_crop(state: ViewState, face: int, at: float) -> ViewState:
    """Move a face of the crop box, in voxels."""
    at = min(max(at, -_MOST), _MOST)
    volume = state.document.volume
    return replace(state, shading=with_crop_face(state.shading, volume, face, at))


@edit
def shift_plane(state: ViewState, index: int, mm: float) -> ViewState:
    """Move a clip plane along its normal."""
    volume = state.document.volume
    return replace(state, shading=with_plane_distance(state.shading, volume, index, mm))


@edit
def tilt_plane(state: ViewState, index: int, azimuth: float, elevation: float) -> ViewState:
    """Turn a clip plane's normal to a direction, in degrees."""
    volume, elevation = state.document.volume, min(max(elevation, -90.0), 90.0)
    shading = with_plane_normal(state.shading, volume, index, azimuth, elevation)
    return replace(state, shading=shading)


@edit
def flip_plane(state: ViewState, index: int) -> ViewState:
    """Cut away the other side of a plane."""
    return replace(state, shading=with_plane_flipped(state.shading, index))


@edit
def remove_plane(state: ViewState, index: int) -> ViewState:
    """Remove a clip plane."""
    return replace(state, shading=with_clip_plane(state.shading, index, None))


@edit
def choose_plane(state: ViewState, index: int) -> ViewState:
    """Choose the clip plane that has handles."""
    if not 0 <= index < len(state.shading.clip_planes):
        return state
    return with_aids(state, plane=index)


def move_handle(state: ViewState, handle: Handle, x: float, y: float) -> ViewState:
    """Move what a handle holds to where `cuts.drag_handle` has it."""
    match handle.name:
        case "crop":
            return move_crop(state, handle.index, x)
        case "plane-shift":
            return shift_plane(state, handle.index, x)
        case _:
            return tilt_plane(state, handle.index, x, y)


def with_aids(state: ViewState, **changes: Any) -> ViewState:
    """Other things over the picture."""
    aids = replace(state.interface.aids, **changes)
    return replace(state, interface=replace(state.interface, aids=aids))


def toggle_aid(name: str) -> Change:
    """Shows or hides something over the picture."""
    return lambda state: with_aids(state, **{name: not getattr(state.interface.aids, name)})


@refusable
def add_plane(state: ViewState, normal: Vector) -> ViewState:
    """Add a clip plane through the volume's middle, and choose it."""
    shading = with_plane(state.shading, state.document.volume, normal)
    chosen = with_aids(state, plane=len(shading.clip_planes) - 1, planes=True)
    return replace(chosen, shading=shading)


def _normal_facing(state: ViewState) -> Vector:
    """What is before the middle is cut away."""
    return vector(state.view.camera(state.document.volume).frame()[2])


def _along(axis: int) -> Callable[[ViewState], Vector]:
    """Across an axis of the voxels, which are those of the slices."""
    return lambda state: vector(state.document.volume.world_from_index[:3, axis])


def _adding(
    name: str, title: str, keys: tuple[str, ...], normal: Callable[[ViewState], Vector]
) -> Command:
    """A command that adds a plane with the normal that a state gives."""
    return Command(name, "Cut", title, keys, lambda state: add_plane(state, normal(state)))


def _uncropped(state: ViewState) -> ViewState:
    return replace(state, shading=replace(state.shading, crop_voxels=None))


def _planeless(state: ViewState) -> ViewState:
    return replace(state, shading=replace(state.shading, clip_planes=()))


def _of_chosen(change: Callable[[ViewState, int], ViewState]) -> Change:
    """An edit of the plane that has handles."""
    return lambda state: change(state, state.interface.aids.plane)


COMMANDS = (
    Command("crop", "Cut", "Crop box", ("c",), toggle_aid("crop"), lambda s: s.interface.aids.crop),
    Command("reset-crop", "Cut", "Undo the crop", ("ctrl+shift+x",), _uncropped),
    _adding("plane-facing", "Add a clip plane facing you", ("p",), _normal_facing),
    *(
        _adding(f"plane-{axis}", f"Add a clip plane across {axis}", (), _along(i))
        for i, axis in enumerate("xyz")
    ),
    Command("flip-plane", "Cut", "Flip the clip plane", (), _of_chosen(flip_plane)),
    Command("remove-plane", "Cut", "Remove the clip plane", (), _of_chosen(remove_plane)),
    Command("remove-planes", "Cut", "Remove all clip planes", (), _planeless),
    Command(
        *("planes", "Cut", "Clip planes' handles", (), toggle_aid("planes")),
        lambda s: s.interface.aids.planes,
    ),
)
