"""Events and actions of the view: orbit, pan, zoom, views along the axes.

mouse, keys -> [camera] -> View
"""

from __future__ import annotations

from dataclasses import replace

from volspec.viewer.events.event import Action, Change, Event, Reducer
from volspec.viewer.state import ViewState

# Of one notch of the wheel, as a share of the picture's height.
WHEEL = 0.06


def _orbit(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.orbited(event.x, event.y))


def _pan(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.panned(event.x, event.y, state.document.volume))


def _zoom(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.zoomed(-event.y))


def _wheel(state: ViewState, event: Event) -> ViewState:
    return replace(state, view=state.view.zoomed(WHEEL * event.y))


def _from_side(side: str) -> Change:
    return lambda state: replace(state, view=state.view.from_side(side))


def _projection(state: ViewState) -> ViewState:
    return replace(state, view=replace(state.view, orthographic=not state.view.orthographic))


def _reset(state: ViewState) -> ViewState:
    return replace(state, view=state.document.view)


def _fit(state: ViewState) -> ViewState:
    width, height = state.size
    return replace(state, view=state.view.fitted(width / height))


EVENTS: dict[str, Reducer] = {"orbit": _orbit, "pan": _pan, "zoom": _zoom, "wheel": _wheel}

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

ACTIONS = (
    *(
        Action(f"view-{side}", "View", title, (key,), _from_side(side))
        for side, title, key in _SIDES
    ),
    Action(
        "projection", "View", "Orthographic", ("5",), _projection, lambda s: s.view.orthographic
    ),
    Action("fit", "View", "Fit the volume", ("f",), _fit),
    Action("reset-view", "View", "The scene's own view", ("enter",), _reset),
)
