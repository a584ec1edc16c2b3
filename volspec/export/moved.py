"""Cameras of a turntable, cameras and transfer functions between keyframes.

Scene, [export], [[keyframe]] -> [moved] -> plan
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec.errors import CameraError, SceneError, TransferError, ViewingError
from volspec.export.motion import (
    Way,
    angles_between_keys,
    between_keys,
    ratios_between_keys,
    rows_of,
    tracks_between,
)
from volspec.raycast import Camera
from volspec.raycast.checks import Vector, unit
from volspec.scene import Scene
from volspec.scene.export import KeyframeTable, TurntableTable
from volspec.scene.keyparts import KeyCameraTable
from volspec.transfer import Isosurfaces, Transfer, TransferFunction, TransferFunction2D
from volspec.volume import Volume

# Azimuth and elevation go by themselves, so that the horizon stays level and neither swings past
# its keys.
_ORBIT: Mapping[str, Way] = {
    "azimuth_deg": angles_between_keys,
    "elevation_deg": between_keys,
    "fov_deg": between_keys,
    "zoom": ratios_between_keys,
    "target_mm": between_keys,
}
_PLACE: Mapping[str, Way] = {
    "up": between_keys,
    "fov_deg": between_keys,
    "target_mm": between_keys,
}
# Below this share of the distance a camera stands on the axis, where no azimuth is.
_ON_AXIS = 1e-6

Row = TypeVar("Row")
Made = TypeVar("Made")


def turned(scene: Scene, volume: Volume, table: TurntableTable) -> list[Camera]:
    """The cameras of a turntable; the first is the scene's own.

    Whole turns end one step before the first, others at their last degree.
    """
    camera = scene.camera(volume)
    whole = math.fmod(table.degrees, 360.0) == 0.0
    steps = table.frames if whole else max(table.frames - 1, 1)
    # Of several turns each is the first again, and its casts too.
    angles = [math.fmod(table.degrees * i / steps, 360.0) for i in range(table.frames)]
    axis = scene.file.camera.up if table.axis is None else table.axis
    return [around(camera, axis, angle) for angle in angles]


def around(camera: Camera, axis: tuple[float, float, float], degrees: float) -> Camera:
    """A camera gone around its target, right-handed: as a rising azimuth for its ``up``."""
    from scipy.spatial.transform import Rotation

    if degrees == 0.0:
        return camera
    towards = np.asarray(axis, dtype=np.float64)
    turn = Rotation.from_rotvec(np.radians(degrees) * towards / np.linalg.norm(towards))
    target = np.asarray(camera.target_mm)
    position = target + turn.apply(np.asarray(camera.position_mm) - target)
    up = turn.apply(np.asarray(camera.up))
    return replace(camera, position_mm=_triple(position), up=_triple(up))


def _triple(vector: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z


def moved_cameras(
    scene: Scene, volume: Volume, keys: Sequence[KeyframeTable], at_s: NDArray[np.float64]
) -> list[Camera]:
    """The camera at every time: an orbit, or places.

    Raises
    ------
    CameraError
        If what holds at a time is no camera; the message names the time.
    """
    told = [(key.time_s, key.camera) for key in keys]
    table = scene.file.camera
    given = {name for _, key in told if key is not None for name in key.given}
    if not given:
        return [scene.camera(volume)] * len(at_s)
    if table.position_mm is None and not given & {"position_mm", "up"}:
        common = table.model_dump(exclude={"position_mm"})
        moved = rows_of(tracks_between(told, _ORBIT, at_s), len(at_s))
        return at_each(at_s, keys, moved, lambda row: Camera.orbit(volume, **{**common, **row}))
    _check_ups(told)
    still = scene.camera(volume)
    tracks = tracks_between(told, _PLACE, at_s)
    # An orbit's own up leans with the camera; beside places it is the axis.
    tracks.setdefault("up", np.asarray([table.up] * len(at_s)))
    places = [
        (time, key.position_mm)
        for time, key in told
        if key is not None and key.position_mm is not None
    ]
    if places:
        targets = tracks.get("target_mm", np.asarray([still.target_mm] * len(at_s)))
        tracks["position_mm"] = targets + _offsets(told, places, table.up, still.target_mm, at_s)
    rows = rows_of(tracks, len(at_s))
    return at_each(at_s, keys, rows, lambda row: replace(still, **row))


def _check_ups(told: Sequence[tuple[float, KeyCameraTable | None]]) -> None:
    """Refuse an up that turns to its opposite: there is no short way."""
    ups = [(time, unit(key.up)) for time, key in told if key is not None and key.up is not None]
    for (before, one), (time, other) in pairwise(ups):
        if np.linalg.norm(np.add(one, other)) < _ON_AXIS:
            raise CameraError(
                f"up at {time:g} s is opposite to that at {before:g} s; give a keyframe between, "
                "whose up is the way"
            )


def at_each(
    at_s: NDArray[np.float64],
    keys: Sequence[KeyframeTable],
    rows: Sequence[Row],
    make: Callable[[Row], Made],
) -> list[Made]:
    """What the numbers of each time make.

    Raises
    ------
    CameraError, TransferError, ViewingError
        If they make none; the message names the time.
    """
    times = [key.time_s for key in keys]
    made = []
    for time, row in zip(at_s.tolist(), rows, strict=True):
        try:
            made.append(make(row))
        except (CameraError, TransferError, ViewingError) as error:
            # Numbers between good ones are good; a way between two places may not be.
            astray = isinstance(error, CameraError) and time not in times
            remedy = ", or give a keyframe between" if astray else ""
            said = str(error).removeprefix("camera: ")
            raise type(error)(f"at {time:g} s: {said}{remedy}") from error
    return made


def _offsets(
    told: Sequence[tuple[float, KeyCameraTable | None]],
    places: Sequence[tuple[float, tuple[float, float, float]]],
    up: Vector,
    still_mm: Vector,
    at_s: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(F, 3) from target to camera: angles and distance go by themselves, as an orbit's do.

    Numbers of the places themselves would lead through the volume where it is gone around.
    """
    times = np.array([time for time, _ in places])
    targets = tracks_between(told, {"target_mm": between_keys}, times)
    away = np.array([place for _, place in places]) - targets.get("target_mm", still_mm)
    distance = np.linalg.norm(away, axis=1)
    if not distance.all():
        at = times[distance == 0][0]
        raise CameraError(f"position_mm at {at:g} s is target_mm; move one of them")
    axes = _axes(up)
    front, side, axis = (away / distance[:, None] @ axes.T).T
    off_axis = np.hypot(front, side) > _ON_AXIS
    azimuth = np.zeros(len(at_s))
    if off_axis.any():
        angles = np.degrees(np.arctan2(side, front))[off_axis]
        azimuth = np.radians(angles_between_keys(times[off_axis], angles, at_s))
    elevation = between_keys(times, np.arcsin(np.clip(axis, -1.0, 1.0)), at_s)
    level = np.cos(elevation)
    parts = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
    return ratios_between_keys(times, distance, at_s)[:, None] * np.stack(parts, axis=1) @ axes


def _axes(up: Vector) -> NDArray[np.float64]:
    """(3, 3) rows: two directions square to ``up``, and ``up``."""
    axis = np.asarray(up) / np.linalg.norm(up)
    front = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    front /= np.linalg.norm(front)
    return np.stack([front, np.cross(axis, front), axis])


def moved_transfers(
    scene: Scene, keys: Sequence[KeyframeTable], at_s: NDArray[np.float64]
) -> list[Transfer]:
    """The transfer function at every time; equal ones are one object.

    Raises
    ------
    SceneError
        If keyframes give points where the scene has none or another number of them, or a shift
        where there are labels.
    TransferError
        If what holds at a time is no transfer function; the message names the time.
    """
    shifts = [(key.time_s, key.transfer.shift) for key in keys if key.transfer is not None]
    given = [(time, shift) for time, shift in shifts if shift is not None]
    by = np.zeros(len(at_s))
    if given:
        by = between_keys([time for time, _ in given], [shift for _, shift in given], at_s)
    points = _points(scene, keys, at_s)
    made: dict[bytes, Transfer] = {}

    def at(i: int) -> Transfer:
        key = np.append(np.zeros(0) if points is None else points[i].ravel(), by[i]).tobytes()
        if key not in made:
            function = scene.transfer if points is None else _with_points(scene, points[i])
            made[key] = function if by[i] == 0.0 else shifted(function, float(by[i]))
        return made[key]

    return at_each(at_s, keys, range(len(at_s)), at)


def shifted(transfer: Transfer, by: float) -> Transfer:
    """A transfer function whose values are all moved.

    Raises
    ------
    SceneError
        If it is one of labels, which lie nowhere.
    """
    if isinstance(transfer, TransferFunction):
        return replace(
            transfer, points=[(value + by, opacity, mix) for value, opacity, mix in transfer.points]
        )
    if isinstance(transfer, Isosurfaces):
        return replace(
            transfer,
            surfaces=[(value + by, opacity, mix) for value, opacity, mix in transfer.surfaces],
        )
    if isinstance(transfer, TransferFunction2D):
        regions = [
            replace(region, values=(region.values[0] + by, region.values[1] + by))
            for region in transfer.regions
        ]
        return replace(transfer, regions=regions)
    raise SceneError("shift: labels have no values to shift; leave it out", code="conflict")


def _points(
    scene: Scene, keys: Sequence[KeyframeTable], at_s: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """(F, P, 2 + K): value, opacity and shares of the K materials; None where no key has points."""
    given = [
        (key.time_s, key.transfer.points)
        for key in keys
        if key.transfer is not None and key.transfer.points is not None
    ]
    if not given:
        return None
    count = len(_own_points(scene))
    for time, rows in given:
        if len(rows) != count:
            raise SceneError(
                f"points: {len(rows)} at {time:g} s, [transfer] has {count}; give as many"
            )
    names = list(scene.materials)
    for time, rows in given:
        for row in rows:
            if unknown := [name for name in row.shares if name not in names]:
                raise SceneError(
                    f"points: material {unknown[0]!r} at {time:g} s is unknown; there is "
                    f"{', '.join(names)}",
                    code="unknown",
                )
    numbers = [
        [[row.value, row.opacity, *(row.shares.get(name, 0.0) for name in names)] for row in rows]
        for _, rows in given
    ]
    found = between_keys([time for time, _ in given], numbers, at_s)
    # Each moves at its own pace: none may overtake the next.
    found[..., 0] = np.maximum.accumulate(found[..., 0], axis=1)
    found[..., 2:] /= np.maximum(found[..., 2:].sum(axis=-1, keepdims=True), 1.0)
    return found


def _own_points(scene: Scene) -> Sequence[Any]:
    if isinstance(scene.transfer, TransferFunction):
        return scene.transfer.points
    if isinstance(scene.transfer, Isosurfaces):
        return scene.transfer.surfaces
    raise SceneError(
        "points: [transfer] has neither points nor surfaces; leave them out", code="conflict"
    )


def _with_points(scene: Scene, numbers: NDArray[np.float64]) -> Transfer:
    rows = [
        (value, opacity, dict(zip(scene.materials, mix, strict=True)))
        for value, opacity, *mix in numbers.tolist()
    ]
    if isinstance(scene.transfer, Isosurfaces):
        return replace(scene.transfer, surfaces=rows)
    assert isinstance(scene.transfer, TransferFunction)
    return replace(scene.transfer, points=rows)
