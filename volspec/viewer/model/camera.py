"""Edits and commands of the view: orbit, pan, zoom, roll, sides, and a view that fits.

    mouse, keys -> [camera_edits] -> View

A fitted view shows what the transfer function leaves visible, and no more of the volume. Every n-th
voxel will do for that: what is missed between them is a part of a percent of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import RaycastSpec
from volspec.transfer import SurfaceTable, Transfer
from volspec.viewer.model.cuts import crop_of, toggle_aid, world_mm
from volspec.viewer.model.edit import Change, Command, edit
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import TURN_DEG, View, radius_mm, vector, zoom_within
from volspec.volume import Volume

Array = NDArray[np.float64]
# Voxels along each axis that are looked at.
_MOST = 64
# Of the greatest opacity: what is below it is haze.
_HAZE = 0.02
# Of the picture's sides, for what is seen.
FILLS = 0.85
_ROUNDS = 4


def fitted(
    view: View, volume: Volume, transfer: Transfer, shading: RaycastSpec, aspect: float
) -> View:
    """A view from the same side that what is shown fills.

    Parameters
    ----------
    view : View
    volume, transfer, shading
        What is shown, and what is cut away of it.
    aspect : float
        Width of the picture by its height.
    """
    camera = view.camera(volume)
    right, up, forward = camera.frame()
    axes = np.stack([right, up, forward])
    points = shown_mm(volume, transfer, shading) @ axes.T
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    x, y, z = (points - middle).T
    tall = FILLS * math.tan(math.radians(view.fov_deg) / 2)
    wide = tall * aspect
    if view.orthographic:
        height = max(2 * float(y.max()), 2 * float(x.max()) / aspect) / FILLS
        zoom = 2 * radius_mm(volume) / max(height, 1e-12)
        return replace(view, zoom=zoom_within(zoom), target_mm=vector(middle @ axes))
    distance = max(_spanned(x, z, wide)[0], _spanned(y, z, tall)[0], 1e-12)
    shift = [_centred(along, z, distance, slope) for along, slope in ((x, wide), (y, tall))]
    sine = math.sin(math.radians(view.fov_deg) / 2)
    zoom = zoom_within(radius_mm(volume) / (distance * sine))
    return replace(view, zoom=zoom, target_mm=vector((middle + [*shift, 0.0]) @ axes))


def _spanned(along: Array, depth: Array, slope: float) -> tuple[float, float]:
    """How far off points are seen within ± a slope, and the place that is then in the middle."""
    high, low = float((along - slope * depth).max()), float((-along - slope * depth).max())
    return (high + low) / (2 * slope), (high - low) / 2


def _centred(along: Array, depth: Array, distance: float, slope: float) -> float:
    """The place that stands in the middle of what is seen from a distance."""
    place = 0.0
    for _ in range(_ROUNDS):
        nearest, place = _spanned(along, depth, slope)
        # Seen from further off than need be, it reaches less far.
        slope *= max(nearest / distance, 1e-3)
    return place


def _thinned(volume: Volume) -> tuple[NDArray[Any], tuple[int, int, int]]:
    """(z, y, x) every n-th voxel, and n along each axis."""
    k, j, i = (-(-size // _MOST) for size in volume.values.shape)
    return np.ascontiguousarray(volume.values[::k, ::j, ::i]), (k, j, i)


def shown_mm(volume: Volume, transfer: Transfer, shading: RaycastSpec) -> Array:
    """(N, 3) places around what is shown; the volume's corners where nothing is."""
    values, every = _thinned(volume)
    visible = _seen(values, volume, transfer)
    (x, y, z), (nk, nj, ni) = crop_of(shading, volume), values.shape
    for axis, (bounds, count) in enumerate(((z, nk), (y, nj), (x, ni))):
        at = np.arange(count) * every[axis]
        outside = (at < bounds[0] - 1) | (at > bounds[1] + 1)
        visible[(slice(None),) * axis + (outside,)] = False
    rows = visible.any(axis=2)
    first, last = visible.argmax(axis=2)[rows], ni - 1 - visible[..., ::-1].argmax(axis=2)[rows]
    k, j = np.nonzero(rows)
    places = np.concatenate([np.stack([at, j, k], axis=1) for at in (first, last)])
    index = places * np.array(every[::-1], dtype=np.float64)
    # What is seen may reach half way to the next voxel that was looked at.
    halves = np.array(list(np.ndindex(2, 2, 2))) - 0.5
    index = (index[:, None] + halves * every[::-1]).reshape(-1, 3)
    lows, highs = (np.array([pair[end] for pair in (x, y, z)]) for end in (0, 1))
    points = world_mm(volume, np.clip(index, lows, highs))
    for plane in shading.clip_planes:
        points = points[(points - plane.point_mm) @ np.asarray(plane.normal) >= 0]
    return points if len(points) else volume.corners_mm


def _seen(values: NDArray[Any], volume: Volume, transfer: Transfer) -> NDArray[np.bool_]:
    """(z, y, x) whether each voxel is shown, or a surface passes beside it."""
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


# Of one notch of the wheel, as a share of the picture's height, and in degrees of a roll.
WHEEL, ROLL_DEG = 0.06, 5.0
# Of one press of a key.
STEP_DEG, STEP = 15.0, 0.05
# Notches.
WIDER = 3.0


@edit
def orbit(state: ViewState, across: float, down: float) -> ViewState:
    """Turn the view by a drag, in shares of the picture's height."""
    return replace(state, view=state.view.orbited(across, down))


@edit
def pan(state: ViewState, across: float, down: float) -> ViewState:
    """Move the view by a drag, in shares of the picture's height."""
    return replace(state, view=state.view.panned(across, down, state.document.volume))


@edit
def zoom(state: ViewState, _across: float, down: float) -> ViewState:
    """Zoom by a drag, in shares of the picture's height."""
    return replace(state, view=state.view.zoomed(-down))


@edit
def roll(state: ViewState, degrees: float) -> ViewState:
    """Roll the view clockwise."""
    return replace(state, view=state.view.rolled(degrees))


@edit
def zoom_notches(state: ViewState, notches: float) -> ViewState:
    """Zoom by notches of the wheel."""
    return replace(state, view=state.view.zoomed(WHEEL * notches))


@edit
def roll_notches(state: ViewState, notches: float) -> ViewState:
    """Roll the view by notches of the wheel."""
    return replace(state, view=state.view.rolled(ROLL_DEG * notches))


@edit
def widen_notches(state: ViewState, notches: float) -> ViewState:
    """Widen the field of view by notches of the wheel."""
    return replace(state, view=state.view.widened(-notches))


@edit
def look_at_face(state: ViewState, face: int) -> ViewState:
    """Look from where a face of the orientation cube looks."""
    if not 0 <= face < 6:
        return state
    axis, far = divmod(face, 2)
    direction = [0.0, 0.0, 0.0]
    direction[axis] = 1.0 if far else -1.0
    x, y, z = direction
    return replace(state, view=state.view.looking_from((x, y, z)))


def _after(change: Callable[..., ViewState], *given: float) -> Change:
    return lambda state: change(state, *given)


def _turned(right_deg: float, down_deg: float) -> Change:
    return _after(orbit, right_deg / TURN_DEG, down_deg / TURN_DEG)


def _from_side(side: str) -> Change:
    return lambda state: replace(state, view=state.view.from_side(side))


def _projection(state: ViewState) -> ViewState:
    return replace(state, view=replace(state.view, orthographic=not state.view.orthographic))


def _reset(state: ViewState) -> ViewState:
    return replace(state, view=state.document.view)


def _fit(state: ViewState) -> ViewState:
    width, height = (max(side, 1) for side in state.size)
    what = state.document.volume, state.transfer, state.shading
    return replace(state, view=fitted(state.view, *what, width / height))


# F3D's keys, and with Ctrl from the other side.
_SIDES = (
    ("front", "Front", "1"),
    ("right", "Right", "3"),
    ("top", "Top", "7"),
    ("isometric", "Isometric", "9"),
    ("back", "Back", "ctrl+1"),
    ("left", "Left", "ctrl+3"),
    ("bottom", "Bottom", "ctrl+7"),
)

# Keys alone: a menu would only grow long.
_STEPS = (
    Command("orbit-left", "", "Orbit to the left", ("left",), _turned(STEP_DEG, 0.0)),
    Command("orbit-right", "", "Orbit to the right", ("right",), _turned(-STEP_DEG, 0.0)),
    Command("orbit-up", "", "Orbit upwards", ("up",), _turned(0.0, STEP_DEG)),
    Command("orbit-down", "", "Orbit downwards", ("down",), _turned(0.0, -STEP_DEG)),
    Command("pan-left", "", "Pan to the left", ("shift+left",), _after(pan, STEP, 0.0)),
    Command("pan-right", "", "Pan to the right", ("shift+right",), _after(pan, -STEP, 0.0)),
    Command("pan-up", "", "Pan upwards", ("shift+up",), _after(pan, 0.0, STEP)),
    Command("pan-down", "", "Pan downwards", ("shift+down",), _after(pan, 0.0, -STEP)),
    Command("zoom-in", "", "Zoom in", ("=", "+"), _after(zoom_notches, 1.0)),
    Command("zoom-out", "", "Zoom out", ("-",), _after(zoom_notches, -1.0)),
)

COMMANDS = (
    *(
        Command(f"view-{side}", "View", title, (key,), _from_side(side))
        for side, title, key in _SIDES
    ),
    Command(
        "projection", "View", "Orthographic", ("5",), _projection, lambda s: s.view.orthographic
    ),
    Command("fit", "View", "Fit what is shown", ("f",), _fit),
    Command("reset-view", "View", "The scene's own view", ("enter",), _reset),
    Command("roll-left", "View", "Roll 90° to the left", ("4",), _after(roll, -90.0)),
    Command("roll-right", "View", "Roll 90° to the right", ("6",), _after(roll, 90.0)),
    Command("turn-up", "View", "Turn 90° upwards", ("8",), _turned(0.0, 90.0)),
    Command("turn-down", "View", "Turn 90° downwards", ("2",), _turned(0.0, -90.0)),
    Command("fov-wider", "View", "Wider field of view", ("ctrl+-",), _after(widen_notches, -WIDER)),
    Command(
        "fov-narrower", "View", "Narrower field of view", ("ctrl+=",), _after(widen_notches, WIDER)
    ),
    Command(
        "cube", "View", "Orientation cube", (), toggle_aid("cube"), lambda s: s.interface.aids.cube
    ),
    Command(
        "scale", "View", "Scale bar", (), toggle_aid("scale"), lambda s: s.interface.aids.scale
    ),
    *_STEPS,
)
