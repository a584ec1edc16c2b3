"""Events and actions of the view: orbit, pan, zoom, roll, views along the axes, step by step.

mouse, keys -> [camera] -> View
"""

from __future__ import annotations

from dataclasses import replace

from volspec.viewer.model.events.cuts import flipped
from volspec.viewer.model.events.event import Action, Change, Event, Reducer
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view.fitting import fitted
from volspec.viewer.model.view.views import TURN_DEG

# Of one notch of the wheel, as a share of the picture's height, and in degrees of a roll.
WHEEL, ROLL_DEG = 0.06, 5.0
# Of one press of a key.
STEP_DEG, STEP = 15.0, 0.05
# Notches.
WIDER = 3.0


def _orbit(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.orbited(event.x, event.y))


def _pan(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.panned(event.x, event.y, state.document.volume))


def _zoom(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.zoomed(-event.y))


def _wheel(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.zoomed(WHEEL * event.y))


def _roll(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.rolled(event.x))


def _roll_wheel(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.rolled(ROLL_DEG * event.y))


def _fov(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.widened(-event.y))


def _face(state: ViewState, event: Event) -> ViewState:
    """Seen from where a face of the orientation cube looks."""
    if not 0 <= event.index < 6:
        return state
    axis, far = divmod(event.index, 2)
    direction = [0.0, 0.0, 0.0]
    direction[axis] = 1.0 if far else -1.0
    x, y, z = direction
    return replace(state, view=state.view.looking_from((x, y, z)))


def _after(name: str, x: float = 0.0, y: float = 0.0) -> Change:
    """What an event does each time it is asked for."""
    return lambda state: EVENTS[name](state, Event(name, x, y))


def _turned(right_deg: float, down_deg: float) -> Change:
    return _after("orbit", right_deg / TURN_DEG, down_deg / TURN_DEG)


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


EVENTS: dict[str, Reducer] = {
    "orbit": _orbit,
    "pan": _pan,
    "zoom": _zoom,
    "wheel": _wheel,
    "roll": _roll,
    "roll-wheel": _roll_wheel,
    "fov": _fov,
    "face": _face,
}

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
    Action("orbit-left", "", "Orbit to the left", ("left",), _turned(STEP_DEG, 0.0)),
    Action("orbit-right", "", "Orbit to the right", ("right",), _turned(-STEP_DEG, 0.0)),
    Action("orbit-up", "", "Orbit upwards", ("up",), _turned(0.0, STEP_DEG)),
    Action("orbit-down", "", "Orbit downwards", ("down",), _turned(0.0, -STEP_DEG)),
    Action("pan-left", "", "Pan to the left", ("shift+left",), _after("pan", STEP)),
    Action("pan-right", "", "Pan to the right", ("shift+right",), _after("pan", -STEP)),
    Action("pan-up", "", "Pan upwards", ("shift+up",), _after("pan", 0.0, STEP)),
    Action("pan-down", "", "Pan downwards", ("shift+down",), _after("pan", 0.0, -STEP)),
    Action("zoom-in", "", "Zoom in", ("=", "+"), _after("wheel", y=1.0)),
    Action("zoom-out", "", "Zoom out", ("-",), _after("wheel", y=-1.0)),
)

ACTIONS = (
    *(
        Action(f"view-{side}", "View", title, (key,), _from_side(side))
        for side, title, key in _SIDES
    ),
    Action(
        "projection", "View", "Orthographic", ("5",), _projection, lambda s: s.view.orthographic
    ),
    Action("fit", "View", "Fit what is shown", ("f",), _fit),
    Action("reset-view", "View", "The scene's own view", ("enter",), _reset),
    Action("roll-left", "View", "Roll 90° to the left", ("4",), _after("roll", -90.0)),
    Action("roll-right", "View", "Roll 90° to the right", ("6",), _after("roll", 90.0)),
    Action("turn-up", "View", "Turn 90° upwards", ("8",), _turned(0.0, 90.0)),
    Action("turn-down", "View", "Turn 90° downwards", ("2",), _turned(0.0, -90.0)),
    Action("fov-wider", "View", "Wider field of view", ("ctrl+-",), _after("fov", y=-WIDER)),
    Action("fov-narrower", "View", "Narrower field of view", ("ctrl+=",), _after("fov", y=WIDER)),
    Action(
        "cube", "View", "Orientation cube", (), flipped("cube"), lambda s: s.interface.aids.cube
    ),
    Action("scale", "View", "Scale bar", (), flipped("scale"), lambda s: s.interface.aids.scale),
    *_STEPS,
)
