"""Films of a state: the camera turns while lights fade, frame by frame.

state, Film, index -> [film] -> state of that frame -> preview, volspec.export
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from volspec.relight import RelightSpec
from volspec.viewer.model.document import Document
from volspec.viewer.model.light_rows import Rows, light_rig, only_row
from volspec.viewer.model.light_states import interpolate_lights
from volspec.viewer.model.state import ViewState

# What the lights do.
AS_SHOWN, LIGHTS = "As shown", "Fade from light to light"
STATES, SIDES = "Fade through the saved states", "Fade from A to B"
SECONDS, RATES = (0.5, 60.0), (8.0, 60.0)
_Stop = tuple[Rows, RelightSpec]


@dataclass(frozen=True, slots=True)
class Film:
    """Settings of a film."""

    degrees: float = 360.0  # by which the camera turns to the right; 0 for none
    lights: str = AS_SHOWN  # or `LIGHTS`, `STATES`, `SIDES`
    loops: bool = True  # lights fade back to the first, so that the end meets the start
    seconds: float = 4.0
    fps: float = 25.0
    steps: bool = True  # the time steps of a series play, at their own rate

    @property
    def frames(self) -> int:
        """Number of frames."""
        return max(round(self.seconds * self.fps), 1)


def with_frames(film: Film, frames: int) -> Film:
    """Return a film of a number of frames, at the same rate."""
    max_frames = int(SECONDS[1] * film.fps)
    return replace(film, seconds=min(max(frames, 1), max_frames) / film.fps)


def film_steps(document: Document, film: Film) -> list[int | None]:
    """Return the time step of every frame; None for the one that is shown."""
    if document.series is None or not film.steps:
        return [None] * film.frames
    per_frame, count = document.step_rate / film.fps, len(document.series)
    return [int(i * per_frame) % count for i in range(film.frames)]


def light_changes(state: ViewState) -> tuple[str, ...]:
    """Return what the lights of a state can do in a film."""
    possible = (
        (AS_SHOWN, True),
        (LIGHTS, len(state.lights) > 1),
        (STATES, len(state.saved_lights) > 1),
        (SIDES, state.other is not None),
    )
    return tuple(name for name, is_possible in possible if is_possible)


def frame_state(state: ViewState, film: Film, index: int) -> ViewState:
    """Return the state that a frame shows.

    Whole turns end one frame before their start, others at the last angle.
    """
    is_whole = math.fmod(film.degrees, 360.0) == 0.0
    steps = film.frames if is_whole else max(film.frames - 1, 1)
    angle = math.fmod(film.degrees * index / steps, 360.0)
    azimuth = math.remainder(state.view.azimuth_deg + angle, 360.0)
    view = replace(state.view, azimuth_deg=azimuth) if angle else state.view
    rows, spec = _lights_at(_stops(state, film), film, index)
    return replace(state, view=view, lights=rows, relight=spec, other=None, fade=None)


def _stops(state: ViewState, film: Film) -> list[_Stop]:
    """Return the settings of the lights that follow each other; dark ones are left out."""
    now = state.lights, state.relight
    stops: list[_Stop] = [now]
    if film.lights == LIGHTS:
        stops = [(only_row(state.lights, i), state.relight) for i in range(len(state.lights))]
    elif film.lights == STATES:
        stops = [(saved.lights, saved.relight) for saved in state.saved_lights]
    elif film.lights == SIDES and state.other is not None:
        stops = [now, (state.other, state.relight)]
    return [stop for stop in stops if light_rig(stop[0]) is not None] or [now]


def _lights_at(stops: list[_Stop], film: Film, index: int) -> _Stop:
    """Return the lights of a frame; a film that loops ends one frame before its start."""
    fades = len(stops) if film.loops else len(stops) - 1
    steps = film.frames if film.loops else max(film.frames - 1, 1)
    i, part = divmod(index * fades, steps)
    if part == 0 or len(stops) == 1:
        return stops[i % len(stops)]
    return interpolate_lights(stops[i % len(stops)], stops[(i + 1) % len(stops)], part / steps)
