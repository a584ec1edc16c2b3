"""Edits and commands of the view: orbit, pan, zoom, roll, sides, and a view that fits.

    mouse, keys -> [camera] -> View

A fitted view frames the voxels that the transfer function leaves visible.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import RaycastSpec
from volspec.transfer import SurfaceTable, Transfer
from volspec.viewer.model.cuts import crop_bounds, overlay_command, world_mm
from volspec.viewer.model.edit import Change, Command, bind, edit
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import ZOOMS, View, clamp, face_normal, orbit_deg, radius_mm, vector
from volspec.volume import Volume

Array = NDArray[np.float64]
# The most voxels sampled along each axis; the error is below one percent of the picture.
_MOST = 64
# Opacities below this fraction of the greatest count as haze.
_HAZE = 0.02
# Fraction of the picture's sides that a fitted view fills.
_FILLS = 0.85
_ITERATIONS = 4


def fit_view(
    view: View, volume: Volume, transfer: Transfer, shading: RaycastSpec, aspect: float
) -> View:
    """Fit a view to the visible part of a volume; ``aspect`` is the picture's width / height."""
    axes = np.stack(view.camera(volume).frame())
    points = shown_mm(volume, transfer, shading) @ axes.T
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = (points - middle).T
    tall = _FILLS * math.tan(math.radians(view.fov_deg) / 2)
    wide = tall * aspect
    if view.orthographic:
        height = max(2 * float(y.max()), 2 * float(x.max()) / aspect) / _FILLS
        zoom = 2 * radius_mm(volume) / max(height, 1e-12)
        return replace(view, zoom=clamp(zoom, *ZOOMS), target_mm=vector(middle @ axes))
    distance = max(_span_within(x, z, wide)[0], _span_within(y, z, tall)[0], 1e-12)
    shift = [_centre_from(along, z, distance, slope) for along, slope in ((x, wide), (y, tall))]
    sine = math.sin(math.radians(view.fov_deg) / 2)
    zoom = clamp(radius_mm(volume) / (distance * sine), *ZOOMS)
    return replace(view, zoom=zoom, target_mm=vector((middle + [*shift, 0.0]) @ axes))


def _span_within(along: Array, depth: Array, slope: float) -> tuple[float, float]:
    """Return the distance at which points fit within ± a slope, and the offset to centre them."""
    high, low = float((along - slope * depth).max()), float((-along - slope * depth).max())
    return (high + low) / (2 * slope), (high - low) / 2


def _centre_from(along: Array, depth: Array, distance: float, slope: float) -> float:
    """Return the offset that centres the points in perspective from a distance."""
    place = 0.0
    for _ in range(_ITERATIONS):
        nearest, place = _span_within(along, depth, slope)
        # From further away than necessary, the points span a smaller slope.
        slope *= max(nearest / distance, 1e-3)
    return place


def shown_mm(volume: Volume, transfer: Transfer, shading: RaycastSpec) -> Array:
    """(N, 3) points around the visible voxels; the volume's corners if none is visible."""
    steps = [-(-size // _MOST) for size in volume.values.shape]
    k, j, i = steps
    values = np.ascontiguousarray(volume.values[::k, ::j, ::i])
    visible = _visible_voxels(values, volume, transfer)
    crop = crop_bounds(shading, volume)
    for axis, (low, high) in enumerate(reversed(crop)):
        at = np.arange(values.shape[axis]) * steps[axis]
        visible[(slice(None),) * axis + ((at < low - 1) | (at > high + 1),)] = False
    rows = visible.any(axis=2)
    first = visible.argmax(axis=2)[rows]
    last = values.shape[2] - 1 - visible[..., ::-1].argmax(axis=2)[rows]
    k_rows, j_rows = np.nonzero(rows)
    places = np.concatenate([np.stack([at, j_rows, k_rows], axis=1) for at in (first, last)])
    # A visible voxel may reach half way to the next sampled one.
    halves = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    index = ((places[:, None] + halves) * [i, j, k]).reshape(-1, 3)
    points = world_mm(volume, np.clip(index, *np.transpose(crop)))
    for plane in shading.clip_planes:
        points = points[(points - plane.point_mm) @ np.asarray(plane.normal) >= 0]
    return points if len(points) else volume.corners_mm


def _visible_voxels(
    values: NDArray[np.generic], volume: Volume, transfer: Transfer
) -> NDArray[np.bool_]:
    """(z, y, x) True if a voxel is visible, or a surface passes next to it."""
    table = transfer.bake(min(volume.spacing_mm))
    if isinstance(table, SurfaceTable):
        layer = np.searchsorted(np.sort(table.values), values)
        visible = np.zeros(values.shape, bool)
        for axis in range(3):
            passed = np.diff(layer, axis=axis) != 0
            ahead = (slice(None),) * axis
            visible[(*ahead, slice(1, None))] |= passed
            visible[(*ahead, slice(None, -1))] |= passed
        return visible
    opacity = np.atleast_2d(table.opacity).max(axis=0)
    low, high = table.domain
    at = np.rint((values.astype(np.float32) - low) * ((len(opacity) - 1) / (high - low)))
    shown = opacity > _HAZE * opacity.max()
    if table.labels:
        shown = np.append(shown, False)
        at = np.where((at < 0) | (at >= len(opacity)), len(opacity), at)
    return shown[np.clip(at, 0, len(shown) - 1).astype(np.int32)]


# A drag over the picture's height turns by this angle, and multiplies the zoom by e to this power.
_TURN_DEG, _ZOOM_RATE = 180.0, 2.0
# A notch of the wheel zooms as a drag over this fraction of the picture's height, rolls by these
# degrees, or multiplies the field of view by e to this power.
_NOTCH, _NOTCH_DEG, _NOTCH_FOV = 0.06, 5.0, 0.06
# A key turns by these degrees, pans by this fraction of the picture's height, or changes the
# field of view by this many notches.
_KEY_DEG, _KEY_PAN, _KEY_FOV = 15.0, 0.05, 3.0
_FOVS_DEG = (5.0, 120.0)
_POLE_DEG = 89.9
# A target may be panned this many radii from the volume's centre.
_FURTHEST = 4.0


@edit
def orbit(state: ViewState, across: float, down: float) -> ViewState:
    """Turn the view by a drag, in fractions of the picture's height."""
    view = state.view
    # A rolled picture follows the mouse as well.
    roll = math.radians(view.roll_deg)
    right = math.cos(roll) * across + math.sin(roll) * down
    down = math.cos(roll) * down - math.sin(roll) * across
    azimuth = math.remainder(view.azimuth_deg - _TURN_DEG * right, 360.0)
    elevation = clamp(view.elevation_deg + _TURN_DEG * down, -90.0, 90.0)
    return _with_view(state, azimuth_deg=azimuth, elevation_deg=elevation)


@edit
def pan(state: ViewState, across: float, down: float) -> ViewState:
    """Move the view by a drag, in fractions of the picture's height."""
    volume = state.document.volume
    camera = state.view.camera(volume)
    right, up, _ = camera.frame()
    half = camera.distance_mm * math.tan(math.radians(camera.fov_deg) / 2)
    tall = camera.height_mm or 2 * half
    centre = volume.corners_mm.mean(axis=0)
    far = np.asarray(camera.target_mm) + tall * (down * up - across * right) - centre
    most = _FURTHEST * radius_mm(volume)
    far *= min(1.0, most / max(float(np.linalg.norm(far)), 1e-12))
    return _with_view(state, target_mm=vector(centre + far))


@edit
def zoom(state: ViewState, _across: float, down: float) -> ViewState:
    """Zoom by a drag, in fractions of the picture's height."""
    factor = math.exp(clamp(-_ZOOM_RATE * down, -10.0, 10.0))
    return _with_view(state, zoom=clamp(state.view.zoom * factor, *ZOOMS))


@edit
def roll(state: ViewState, degrees: float) -> ViewState:
    """Roll the view clockwise."""
    return _with_view(state, roll_deg=math.remainder(state.view.roll_deg + degrees, 360.0))


@edit
def zoom_notches(state: ViewState, notches: float) -> ViewState:
    """Zoom by notches of the wheel."""
    return zoom(state, 0.0, -_NOTCH * notches)


@edit
def roll_notches(state: ViewState, notches: float) -> ViewState:
    """Roll the view by notches of the wheel."""
    return roll(state, _NOTCH_DEG * notches)


@edit
def widen_notches(state: ViewState, notches: float) -> ViewState:
    """Narrow the field of view by notches of the wheel, or widen it by negative ones."""
    factor = math.exp(clamp(-_NOTCH_FOV * notches, -5.0, 5.0))
    return _with_view(state, fov_deg=clamp(state.view.fov_deg * factor, *_FOVS_DEG))


@edit
def look_at_face(state: ViewState, face: int) -> ViewState:
    """Look at the target from the direction of a face of the orientation cube."""
    if not 0 <= face < 6:
        return state
    azimuth, elevation = orbit_deg(face_normal(face), state.view.up)
    # Straight from above or below, any azimuth would do; 0 keeps the front at the bottom.
    azimuth = 0.0 if abs(elevation) > _POLE_DEG else azimuth
    return _with_view(state, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=0.0)


def _with_view(state: ViewState, **changes: Any) -> ViewState:
    return replace(state, view=replace(state.view, **changes))


def _turn(right_deg: float, down_deg: float) -> Change:
    return bind(orbit, right_deg / _TURN_DEG, down_deg / _TURN_DEG)


def _projection(state: ViewState) -> ViewState:
    return _with_view(state, orthographic=not state.view.orthographic)


def _fit(state: ViewState) -> ViewState:
    width, height = (max(side, 1) for side in state.size)
    volume = state.document.volume
    view = fit_view(state.view, volume, state.transfer, state.shading, width / height)
    return replace(state, view=view)


def _side(title: str, key: str, azimuth_deg: float, elevation_deg: float) -> Command:
    """Return the command that looks from a side; its key is F3D's, or Ctrl and the opposite's."""
    angles = {"azimuth_deg": azimuth_deg, "elevation_deg": elevation_deg, "roll_deg": 0.0}
    return Command(f"view-{title.lower()}", "View", title, (key,), bind(_with_view, **angles))


COMMANDS = (
    _side("Front", "1", 0.0, 0.0),
    _side("Right", "3", 90.0, 0.0),
    _side("Top", "7", 0.0, 90.0),
    _side("Isometric", "9", 45.0, 35.264),
    _side("Back", "ctrl+1", 180.0, 0.0),
    _side("Left", "ctrl+3", -90.0, 0.0),
    _side("Bottom", "ctrl+7", 0.0, -90.0),
    Command(
        "projection", "View", "Orthographic", ("5",), _projection, lambda s: s.view.orthographic
    ),
    Command("fit", "View", "Fit the visible part", ("f",), _fit),
    Command(
        "reset-view",
        "View",
        "The scene's own view",
        ("enter",),
        lambda state: replace(state, view=state.document.view),
    ),
    Command("roll-left", "View", "Roll 90° to the left", ("4",), bind(roll, -90.0)),
    Command("roll-right", "View", "Roll 90° to the right", ("6",), bind(roll, 90.0)),
    Command("turn-up", "View", "Turn 90° upwards", ("8",), _turn(0.0, 90.0)),
    Command("turn-down", "View", "Turn 90° downwards", ("2",), _turn(0.0, -90.0)),
    Command(
        "fov-wider", "View", "Wider field of view", ("ctrl+-",), bind(widen_notches, -_KEY_FOV)
    ),
    Command(
        "fov-narrower", "View", "Narrower field of view", ("ctrl+=",), bind(widen_notches, _KEY_FOV)
    ),
    overlay_command("cube", "View", "Orientation cube"),
    overlay_command("scale", "View", "Scale bar"),
    # Not in a menu, which would grow too long.
    Command("orbit-left", "", "Orbit to the left", ("left",), _turn(_KEY_DEG, 0.0)),
    Command("orbit-right", "", "Orbit to the right", ("right",), _turn(-_KEY_DEG, 0.0)),
    Command("orbit-up", "", "Orbit upwards", ("up",), _turn(0.0, _KEY_DEG)),
    Command("orbit-down", "", "Orbit downwards", ("down",), _turn(0.0, -_KEY_DEG)),
    Command("pan-left", "", "Pan to the left", ("shift+left",), bind(pan, _KEY_PAN, 0.0)),
    Command("pan-right", "", "Pan to the right", ("shift+right",), bind(pan, -_KEY_PAN, 0.0)),
    Command("pan-up", "", "Pan upwards", ("shift+up",), bind(pan, 0.0, _KEY_PAN)),
    Command("pan-down", "", "Pan downwards", ("shift+down",), bind(pan, 0.0, -_KEY_PAN)),
    Command("zoom-in", "", "Zoom in", ("=", "+"), bind(zoom_notches, 1.0)),
    Command("zoom-out", "", "Zoom out", ("-",), bind(zoom_notches, -1.0)),
)
