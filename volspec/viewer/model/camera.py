"""Edits and commands of the view: orbit, pan, zoom, roll, sides, and a view that fits.

    mouse, keys -> [camera] -> View

A fitted view frames the voxels that the transfer function leaves visible.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from volspec.camera import face_normal, radius_mm, side_deg
from volspec.raycast import framing
from volspec.viewer.model.edit import Change, Command, bind, edit, switch
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp, orbit_deg, vector

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
    height_mm = camera.height_mm or 2 * half
    centre = volume.corners_mm.mean(axis=0)
    far = np.asarray(camera.target_mm) + height_mm * (down * up - across * right) - centre
    max_mm = _FURTHEST * radius_mm(volume)
    far *= min(1.0, max_mm / (float(np.linalg.norm(far)) or max_mm))
    return _with_view(state, target_mm=vector(centre + far))


@edit
def zoom(state: ViewState, _across: float, down: float) -> ViewState:
    """Zoom by a drag, in fractions of the picture's height."""
    factor = math.exp(clamp(-_ZOOM_RATE * down, -10.0, 10.0))
    return _with_view(state, zoom=clamp(state.view.zoom * factor, *framing.ZOOMS))


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


def _fit(state: ViewState) -> ViewState:
    width, height = (max(side, 1) for side in state.size)
    volume = state.document.volume
    view = framing.fit_view(state.view, volume, state.transfer, state.shading, width / height)
    return replace(state, view=view)


def _look_from(state: ViewState, side: str) -> ViewState:
    patient = state.interface.overlays.patient
    azimuth, elevation = side_deg(side, state.document.volume, patient)
    return _with_view(state, azimuth_deg=azimuth, elevation_deg=elevation, roll_deg=0.0)


def _side(title: str, key: str) -> Command:
    """Return the command that looks from a side; its key is F3D's, or Ctrl and the opposite's."""
    side = title.lower()
    return Command(
        f"view-{side}", "View", title, (key,), bind(_look_from, side), words="camera view"
    )


COMMANDS = (
    _side("Front", "1"),
    _side("Right", "3"),
    _side("Top", "7"),
    _side("Isometric", "9"),
    _side("Back", "ctrl+1"),
    _side("Left", "ctrl+3"),
    _side("Bottom", "ctrl+7"),
    switch(
        *("view.orthographic", "projection", "View", "Orthographic", ("5",)),
        words="camera perspective parallel projection",
    ),
    Command("fit", "View", "Fit the visible part", ("f",), _fit, words="camera zoom frame"),
    Command(
        "reset-view",
        "View",
        "Reset the view",
        ("enter",),
        lambda state: replace(state, view=state.document.view),
        words="camera home default scene's own view",
    ),
    Command("roll-left", "View", "Roll 90° to the left", ("4",), bind(roll, -90.0)),
    Command("roll-right", "View", "Roll 90° to the right", ("6",), bind(roll, 90.0)),
    Command("turn-up", "View", "Turn 90° upwards", ("8",), _turn(0.0, 90.0)),
    Command("turn-down", "View", "Turn 90° downwards", ("2",), _turn(0.0, -90.0)),
    Command(
        "fov-wider",
        "View",
        "Wider field of view",
        ("ctrl+-",),
        bind(widen_notches, -_KEY_FOV),
        words="camera lens",
    ),
    Command(
        "fov-narrower",
        "View",
        "Narrower field of view",
        ("ctrl+=",),
        bind(widen_notches, _KEY_FOV),
        words="camera lens",
    ),
    switch("interface.overlays.cube", "cube", "View", "Orientation cube"),
    switch("interface.overlays.scale", "scale", "View", "Scale bar", words="ruler size"),
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
