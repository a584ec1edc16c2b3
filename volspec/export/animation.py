"""Compute camera, viewing and transfer function of every frame, from turntables or keyframes.

    Scene, [export], [[keyframe]] -> [animation] -> plan

Interpolation is smooth and never goes beyond the keyframes on either side [1].

References
----------
[1] Fritsch & Butland (1984), "A method for constructing local monotone piecewise cubic
    interpolants", SIAM J. Sci. Stat. Comput. 5(2), 300-304; scipy's PchipInterpolator.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._checks import Vector, unit
from volspec.camera import Camera, Orbit
from volspec.errors import (
    CameraError,
    ImageError,
    InputError,
    SceneError,
    TransferError,
    ViewingError,
)
from volspec.image import DepthEffects
from volspec.raycast.launch import check_reach
from volspec.relight import Look, RelightSpec
from volspec.scene import Scene
from volspec.scene.tables import KeyCamera, Keyframe, Turntable
from volspec.transfer import (
    Isosurfaces,
    TransferFunction,
    TransferFunction2D,
    Transfers,
    bake_for_volume,
    check_opacities,
)
from volspec.volume import Volume

Array = NDArray[np.float64]
Keys = Sequence[Keyframe]
# (times of the keyframes, their values, times of the frames) -> values of the frames.
Interpolate = Callable[[ArrayLike, ArrayLike, ArrayLike], Array]
Row = TypeVar("Row")
Made = TypeVar("Made")

# Decimals to which a number of frames is rounded: 2 s at 24 fps are 48 frames.
_DIGITS = 6
# Within this fraction of its distance a camera is on the axis, where the azimuth is undefined.
_ON_AXIS = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class FrameState:
    """Camera, transfer function and viewing of a frame, without its light."""

    camera: Camera
    transfer: Transfers
    look: Look
    step: int | None = None  # of a series that plays


def played_steps(frames: int, steps: int, loops: int = 1) -> list[int]:
    """Return the time step of every frame.

    >>> played_steps(6, 3), played_steps(4, 2, loops=2)
    ([0, 0, 1, 1, 2, 2], [0, 1, 0, 1])
    """
    return [i * steps * loops // frames % steps for i in range(frames)]


def frame_times_s(keys: Keys, fps: float) -> Array:
    """Return the time of each frame; the first and the last keyframe each have a frame.

    If the keyframes are not a whole number of frames apart, the last step is shorter.
    """
    first, last = keys[0].time_s, keys[-1].time_s
    steps = math.ceil(round((last - first) * fps, _DIGITS))
    return np.append(first + np.arange(steps) / fps, last)


def interpolate_keyframes(times_s: ArrayLike, values: ArrayLike, at_s: ArrayLike) -> Array:
    """Interpolate (K, ...) values at rising times by a monotone cubic: (F, ...).

    Values are constant before the first and after the last time. A Catmull-Rom spline would
    overshoot between keyframes of equal value.

    >>> interpolate_keyframes([0, 1, 2], [0, 10, 10], [0, 1, 1.5, 2, 9]).tolist()
    [0.0, 10.0, 10.0, 10.0, 10.0]
    """
    from scipy.interpolate import PchipInterpolator

    keys = np.asarray(values, dtype=np.float64)
    times, frame_times = np.asarray(times_s, dtype=np.float64), np.asarray(at_s, dtype=np.float64)
    if len(times) == 1:
        return np.repeat(keys, len(frame_times), axis=0)
    rows: Array = PchipInterpolator(times, keys)(np.clip(frame_times, times[0], times[-1]))
    # Keyframes are exact to the last bit, so that equal cameras share a cast.
    rows = np.clip(rows, keys.min(axis=0), keys.max(axis=0))
    for time, key in zip(times, keys, strict=True):
        rows[frame_times == time] = key
    return rows


def interpolate_ratios(times_s: ArrayLike, values: ArrayLike, at_s: ArrayLike) -> Array:
    """Interpolate logarithms of values above 0, so that zoom and exposure change by even ratios.

    >>> interpolate_ratios([0, 1], [1, 4], [0.5]).round(9).tolist()
    [2.0]
    """
    keys = np.asarray(values, dtype=np.float64)
    logs = np.log(keys)
    found_logs = interpolate_keyframes(times_s, logs, at_s)
    ratios = np.exp(found_logs)
    for log, key in zip(logs, keys, strict=True):
        ratios[found_logs == log] = key
    return ratios


def interpolate_angles(times_s: ArrayLike, angles_deg: ArrayLike, at_s: ArrayLike) -> Array:
    """Interpolate angles, by at most half a turn between keyframes.

    >>> interpolate_angles([0, 1], [350, 10], [0.5]).tolist()
    [360.0]
    """
    unwrapped = np.unwrap(np.asarray(angles_deg, dtype=np.float64), period=360.0)
    return interpolate_keyframes(times_s, unwrapped, at_s)


# Azimuth and elevation are interpolated separately, so that the horizon stays level.
_ORBIT: Mapping[str, Interpolate] = {
    "azimuth_deg": interpolate_angles,
    "elevation_deg": interpolate_keyframes,
    "fov_deg": interpolate_keyframes,
    "zoom": interpolate_ratios,
    "target_mm": interpolate_keyframes,
}
_PLACE: Mapping[str, Interpolate] = {
    "up": interpolate_keyframes,
    "fov_deg": interpolate_keyframes,
    "target_mm": interpolate_keyframes,
}
_DEPTH: Mapping[str, Interpolate] = {
    "focus_mm": interpolate_ratios,
    "aperture_mm": interpolate_ratios,
    "fog_mm": interpolate_ratios,
    "near_mm": interpolate_keyframes,
    "far_mm": interpolate_keyframes,
}
_VIEWING: Mapping[str, Interpolate] = {
    "exposure": interpolate_ratios,
    "L_A": interpolate_ratios,
    "Y_b": interpolate_keyframes,
    "D": interpolate_keyframes,
}


def _interpolated_tracks(
    keys: Sequence[tuple[float, Any]], by_name: Mapping[str, Interpolate], at_s: Array
) -> dict[str, Array]:
    """Interpolate every attribute that any keyframe's table sets: {name: (F, ...)}."""
    tracks = {}
    for name, interpolate in by_name.items():
        samples = [
            (time, getattr(table, name))
            for time, table in keys
            if table is not None and getattr(table, name) is not None
        ]
        if samples:
            times, values = zip(*samples, strict=True)
            tracks[name] = interpolate(times, values, at_s)
    return tracks


def _rows(tracks: Mapping[str, Array], count: int) -> list[dict[str, Any]]:
    """Return the values of each frame as floats and tuples of floats."""
    return [
        {
            name: tuple(track[i].tolist()) if track.ndim > 1 else float(track[i])
            for name, track in tracks.items()
        }
        for i in range(count)
    ]


def frame_states(scene: Scene, volume: Volume, spec: RelightSpec, at_s: Array) -> list[FrameState]:
    """Interpolate a scene's keyframes; a `SceneError` for values out of range names the time."""
    # Faults at the keyframes come first, as times in between do not cause these.
    for fault in keyframe_faults(scene, volume):
        raise fault
    keys = scene.file.keyframe
    with located_in(scene, "[[keyframe]] camera"):
        cameras = _reaching_cameras(scene, volume, keys, at_s)
    with located_in(scene, "[[keyframe]] viewing"):
        specs = _relight_specs(spec, keys, at_s)
    with located_in(scene, "[[keyframe]] transfer"):
        transfers = keyframe_transfers(scene, keys, at_s)
    with located_in(scene, "[[keyframe]] depth"):
        depths = _depths(scene, keys, at_s)
    rows = keyframe_opacities(scene, keys, at_s)
    return [
        FrameState(camera, transfer, Look(relight, opacities=row, depth=depth))
        for camera, transfer, relight, row, depth in zip(
            cameras, transfers, specs, rows, depths, strict=True
        )
    ]


def keyframe_faults(scene: Scene, volume: Volume) -> list[SceneError]:
    """Return the faults at the keyframes, each naming file, key and time."""

    def baked(keys: Keys, at_s: Array) -> object:
        transfers = keyframe_transfers(scene, keys, at_s)
        return _at_times(at_s, keys, transfers, lambda transfer: bake_for_volume(transfer, volume))

    parts: dict[str, Callable[[Keys, Array], object]] = {
        "camera": lambda keys, at_s: _reaching_cameras(scene, volume, keys, at_s),
        "viewing": lambda keys, at_s: _relight_specs(scene.relight, keys, at_s),
        "transfer": baked,
        "depth": lambda keys, at_s: _depths(scene, keys, at_s),
        "opacities": lambda keys, at_s: keyframe_opacities(scene, keys, at_s),
    }
    keys = scene.file.keyframe
    unique: dict[str, SceneError] = {}

    def faults(name: str, of: Keys, key: Keyframe) -> list[SceneError]:
        try:
            with located_in(scene, f"[[keyframe]] {name}"):
                parts[name](of, np.array([key.time_s]))
        except SceneError as error:
            return [error]
        return []

    for name in parts:
        giving = [key for key in keys if getattr(key, name) is not None]
        together = [fault for key in giving for fault in faults(name, keys, key)]
        # Report a fault at the keyframe that sets the value, not at keyframes that inherit it.
        alone = [fault for key in giving for fault in faults(name, [key], key)]
        unique |= {str(fault): fault for fault in (alone or together) if together}
    return list(unique.values())


def _reaching_cameras(scene: Scene, volume: Volume, keys: Keys, at_s: Array) -> list[Camera]:
    """Return the cameras; refuse one that is too far away to cast from."""
    cameras = keyframe_cameras(scene, volume, keys, at_s)
    _at_times(at_s, keys, cameras, lambda camera: check_reach(volume, camera, scene.raycast))
    return cameras


def _relight_specs(spec: RelightSpec, keys: Keys, at_s: Array) -> list[RelightSpec]:
    tracks = _interpolated_tracks([(key.time_s, key.viewing) for key in keys], _VIEWING, at_s)

    def make(row: dict[str, Any]) -> RelightSpec:
        return replace(spec, viewing=replace(spec.viewing, **row)) if row else spec

    return _at_times(at_s, keys, _rows(tracks, len(at_s)), make)


def _depths(scene: Scene, keys: Keys, at_s: Array) -> list[DepthEffects]:
    tracks = _interpolated_tracks([(key.time_s, key.depth) for key in keys], _DEPTH, at_s)
    default = scene.file.depth
    rows = _rows(tracks, len(at_s))
    return _at_times(at_s, keys, rows, lambda row: replace(default, **row) if row else default)


@contextmanager
def located_in(scene: Scene, place: str = "") -> Iterator[None]:
    """Prefix errors raised inside with the file's name and a place in it."""
    try:
        yield
    except InputError as error:
        where = f"{scene.path}: {place}: " if place else f"{scene.path}: "
        problem = str(error).removesuffix(f"; {error.remedy}")
        # Names of classes mean nothing to the author of a file.
        problem = re.sub(r"(?:(?<=: )|^)[A-Z]\w+\.(?=[A-Za-z_]+(?: is|:))", "", problem)
        raise SceneError(where + problem, error.remedy, code=error.code) from error


def _at_times(
    at_s: Array, keys: Keys, rows: Sequence[Row], make: Callable[[Row], Made]
) -> list[Made]:
    """Make an object from each frame's values; an error for values out of range names the time."""
    frames = []
    key_times = {key.time_s for key in keys}
    for time, row in zip(at_s.tolist(), rows, strict=True):
        try:
            frames.append(make(row))
        except (CameraError, TransferError, ViewingError, ImageError) as error:
            # Values between valid ones are valid; a path between two positions may not be.
            is_between = isinstance(error, CameraError) and time not in key_times
            remedy = ", or add a keyframe in between" if is_between else ""
            # "Viewing.D" is a keyframe's "D".
            own_error = error.at(error.field.partition(".")[2] or error.field)
            message = str(own_error).removeprefix("camera: ")
            raise type(error)(f"at {time:g} s: {message}{remedy}", code=error.code) from error
    return frames


def keyframe_opacities(scene: Scene, keys: Keys, at_s: Array) -> list[dict[str, float]]:
    """Return the scales of materials' opacities in every frame, by material."""
    default = dict(scene.raycast.opacities)
    rows = [dict(default) for _ in at_s]
    for name in dict.fromkeys(name for key in keys for name in key.opacities or ()):
        keyed = [(k.time_s, k.opacities[name]) for k in keys if k.opacities and name in k.opacities]
        times, scales = zip(*keyed, strict=True)
        for row, scale in zip(rows, interpolate_keyframes(times, scales, at_s), strict=True):
            row[name] = float(scale)
    _at_times(at_s, keys, rows, lambda row: check_opacities(scene.basis, row))
    return rows


def turntable_cameras(scene: Scene, volume: Volume, table: Turntable) -> list[Camera]:
    """Return the cameras of a turntable; the first is the scene's own.

    Whole turns end one step before the first camera, others at the last angle.
    """
    camera = scene.camera(volume)
    is_whole = math.fmod(table.degrees, 360.0) == 0.0
    steps = table.frames if is_whole else max(table.frames - 1, 1)
    # Further turns repeat the angles of the first, and so share its casts.
    angles = [math.fmod(table.degrees * i / steps, 360.0) for i in range(table.frames)]
    axis = scene.file.camera.up if table.axis is None else table.axis
    return [rotate_camera(camera, axis, angle) for angle in angles]


def rotate_camera(camera: Camera, axis: Vector, degrees: float) -> Camera:
    """Rotate a camera around its target, right-handed: about ``up`` the azimuth rises."""
    from scipy.spatial.transform import Rotation

    if degrees == 0.0:
        return camera
    direction = np.asarray(axis, dtype=np.float64)
    turn = Rotation.from_rotvec(np.radians(degrees) * direction / np.linalg.norm(direction))
    target = np.asarray(camera.target_mm)
    position = target + turn.apply(np.asarray(camera.position_mm) - target)
    up = turn.apply(np.asarray(camera.up))
    return replace(camera, position_mm=_triple(position), up=_triple(up))


def _triple(vector: Array) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z


def keyframe_cameras(scene: Scene, volume: Volume, keys: Keys, at_s: Array) -> list[Camera]:
    """Return the camera of every frame, from orbits or from positions."""
    cameras = [(key.time_s, key.camera) for key in keys]
    table = scene.file.camera
    names = {name for _, key in cameras if key is not None for name in key.set_keys}
    if not names:
        return [scene.camera(volume)] * len(at_s)
    if table.position_mm is None and not names & {"position_mm", "up"}:
        common = {field.name: getattr(table, field.name) for field in fields(Orbit)}
        rows = _rows(_interpolated_tracks(cameras, _ORBIT, at_s), len(at_s))
        return _at_times(at_s, keys, rows, lambda row: Camera.orbit(volume, **{**common, **row}))
    _check_ups(cameras)
    still = scene.camera(volume)
    tracks = _interpolated_tracks(cameras, _PLACE, at_s)
    # For orbits, up tilts with the camera; for positions, it is the axis.
    tracks.setdefault("up", np.asarray([table.up] * len(at_s)))
    places = [
        (time, key.position_mm)
        for time, key in cameras
        if key is not None and key.position_mm is not None
    ]
    if places:
        targets = tracks.get("target_mm", np.asarray([still.target_mm] * len(at_s)))
        offsets = _interpolated_offsets(cameras, places, table.up, still.target_mm, at_s)
        tracks["position_mm"] = targets + offsets
    rows = _rows(tracks, len(at_s))
    return _at_times(at_s, keys, rows, lambda row: replace(still, **row))


def _check_ups(cameras: Sequence[tuple[float, KeyCamera | None]]) -> None:
    """Refuse an up that turns to its opposite, as there is no shortest path."""
    ups = [(time, unit(key.up)) for time, key in cameras if key is not None and key.up is not None]
    for (before, one), (time, other) in pairwise(ups):
        if np.linalg.norm(np.add(one, other)) < _ON_AXIS:
            raise CameraError(
                f"up at {time:g} s is opposite to up at {before:g} s",
                "add a keyframe in between, with an up on the way",
                code="impossible",
            )


def _interpolated_offsets(
    cameras: Sequence[tuple[float, KeyCamera | None]],
    places: Sequence[tuple[float, tuple[float, float, float]]],
    up: Vector,
    still_mm: Vector,
    at_s: Array,
) -> Array:
    """Return (F, 3) from target to camera, interpolated as an orbit's angles and distance.

    Interpolated positions would cut through the volume.
    """
    times = np.array([time for time, _ in places])
    targets = _interpolated_tracks(cameras, {"target_mm": interpolate_keyframes}, times)
    offset = np.array([place for _, place in places]) - targets.get("target_mm", still_mm)
    distance = np.linalg.norm(offset, axis=1)
    if not distance.all():
        time_s = times[distance == 0][0]
        raise CameraError(
            f"position_mm at {time_s:g} s is target_mm", "move one of them", code="impossible"
        )
    axes = _axes(up)
    front, side, axis = (offset / distance[:, None] @ axes.T).T
    off_axis = np.hypot(front, side) > _ON_AXIS
    azimuth = np.zeros(len(at_s))
    if off_axis.any():
        angles = np.degrees(np.arctan2(side, front))[off_axis]
        azimuth = np.radians(interpolate_angles(times[off_axis], angles, at_s))
    elevation = interpolate_keyframes(times, np.arcsin(np.clip(axis, -1.0, 1.0)), at_s)
    level = np.cos(elevation)
    parts = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    return interpolate_ratios(times, distance, at_s)[:, None] * np.stack(parts, axis=1) @ axes


def _axes(up: Vector) -> Array:
    """Return (3, 3) rows: two directions perpendicular to ``up``, and ``up``."""
    axis = np.asarray(up) / np.linalg.norm(up)
    front = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    front /= np.linalg.norm(front)
    return np.stack([front, np.cross(axis, front), axis])


def keyframe_transfers(scene: Scene, keys: Keys, at_s: Array) -> list[Transfers]:
    """Return the transfer function of every frame; equal functions are one object."""
    keyed = [(key.time_s, key.transfer) for key in keys]
    tracks = _interpolated_tracks(keyed, {"shift": interpolate_keyframes}, at_s)
    by = tracks.get("shift", np.zeros(len(at_s)))
    points = _interpolated_points(scene, keys, at_s)
    cache: dict[bytes, Transfers] = {}

    def transfer_at(i: int) -> Transfers:
        key = np.append(np.zeros(0) if points is None else points[i].ravel(), by[i]).tobytes()
        if key not in cache:
            function = scene.transfer
            if points is not None:
                assert isinstance(function, TransferFunction | Isosurfaces)
                rows = [
                    (value, opacity, dict(zip(scene.materials, mix, strict=True)))
                    for value, opacity, *mix in points[i].tolist()
                ]
                function = _with_point_rows(function, rows)
            cache[key] = function if by[i] == 0.0 else shift_values(function, float(by[i]))
        return cache[key]

    return _at_times(at_s, keys, range(len(at_s)), transfer_at)


def shift_values(transfer: Transfers, by: float) -> Transfers:
    """Shift a transfer function along the axis of values; refuse labels."""
    if isinstance(transfer, TransferFunction | Isosurfaces):
        return _with_point_rows(
            transfer, [(value + by, *look) for value, *look in _point_rows(transfer)]
        )
    if isinstance(transfer, TransferFunction2D):
        regions = [
            replace(region, values=(region.values[0] + by, region.values[1] + by))
            for region in transfer.regions
        ]
        return replace(transfer, regions=regions)
    raise SceneError("shift: labels cannot be shifted", "leave it out", code="conflict")


def _interpolated_points(scene: Scene, keys: Keys, at_s: Array) -> Array | None:
    """Return (F, P, 2 + K): value, opacity and weights of the K materials; None without points."""
    samples = [
        (key.time_s, key.transfer.points)
        for key in keys
        if key.transfer is not None and key.transfer.points is not None
    ]
    if not samples:
        return None
    if not isinstance(scene.transfer, TransferFunction | Isosurfaces):
        raise SceneError(
            "points: [transfer] has neither points nor surfaces", "leave them out", code="conflict"
        )
    count, names = len(_point_rows(scene.transfer)), list(scene.materials)
    for time, rows in samples:
        if len(rows) != count:
            raise SceneError(
                f"points: {len(rows)} at {time:g} s, but [transfer] has {count}",
                f"give {count}",
                code="shape",
            )
    for time, rows in samples:
        for row in rows:
            if unknown := [name for name in row.material_weights if name not in names]:
                raise SceneError(
                    f"points: material {unknown[0]!r} at {time:g} s is unknown",
                    f"known: {', '.join(names)}",
                    code="unknown",
                )
    numbers = [
        [
            [row.value, row.opacity, *(row.material_weights.get(name, 0.0) for name in names)]
            for row in rows
        ]
        for _, rows in samples
    ]
    points = interpolate_keyframes([time for time, _ in samples], numbers, at_s)
    # Points move at different speeds, but none may overtake the next.
    points[..., 0] = np.maximum.accumulate(points[..., 0], axis=1)
    points[..., 2:] /= np.maximum(points[..., 2:].sum(axis=-1, keepdims=True), 1.0)
    return points


def _point_rows(transfer: TransferFunction | Isosurfaces) -> Sequence[Any]:
    """Return (value, opacity, mix) of each point or surface."""
    return transfer.points if isinstance(transfer, TransferFunction) else transfer.surfaces


def _with_point_rows(
    transfer: TransferFunction | Isosurfaces, rows: Sequence[Any]
) -> TransferFunction | Isosurfaces:
    if isinstance(transfer, TransferFunction):
        return replace(transfer, points=rows)
    return replace(transfer, surfaces=rows)
