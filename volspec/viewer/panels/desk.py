"""What panels are given besides the state: measured times, colours looked up, areas noted down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from imgui_bundle import imgui

from volspec.appearance import passage_of
from volspec.appearance.srgb import encode, linear_from_XYZ
from volspec.errors import VolspecError
from volspec.raycast import CoefficientImage
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import white_XYZ
from volspec.viewer.design import News
from volspec.viewer.events.event import Change
from volspec.viewer.heat import Heat
from volspec.viewer.lighting import KELVIN
from volspec.viewer.panels.light_scraps import LightScraps
from volspec.viewer.projection import Projection
from volspec.viewer.reading import Reading
from volspec.viewer.recent import RecentFile
from volspec.viewer.slice_pictures import SlicePictures
from volspec.viewer.state import ViewState


@dataclass(slots=True)
class Search:
    """What is looked for in the command palette.

    Parameters
    ----------
    text : str
    at : int
        The row that Enter takes.
    fresh : bool
        Whether the field is to take the keyboard.
    picked : Any
        The command that was picked; it is done once the window is seen without the palette.
    waits : int
        Frames until then.
    """

    text: str = ""
    at: int = 0
    fresh: bool = True
    picked: Any = None
    waits: int = 0


Colour = tuple[float, float, float]
# Rows are few; a temperature that is dragged makes many.
_MOST_SWATCHES = 256


@dataclass(slots=True)
class Desk:
    """The panels' surroundings; new values every frame.

    Parameters
    ----------
    scale : float
        Pixels of the window for each at 96 dpi.
    areas : {name: (x, y, width, height)}
        Where things were drawn, for the trace.
    asked : list of str
        Actions that are the app's to do.
    shown_at : (left, top, right, bottom)
        Where the picture was drawn last.
    recent : tuple of RecentFile
        Files opened lately.
    commands : Search, optional
        The command palette; None where it is closed.
    menu : bool
        Whether the first menu is to open now.
    front : str
        The panel that is to come to the front now.
    item : str
        Its item that is to take the keyboard.
    """

    scale: float = 1.0
    areas: dict[str, tuple[int, int, int, int]] = field(default_factory=dict)
    asked: list[str] = field(default_factory=list)
    image: CoefficientImage | None = None
    search: str = ""
    kelvin: float = 3200.0
    complaint: str = ""
    device: str = ""
    fps: float = 0.0
    ms: dict[str, float] = field(default_factory=dict)
    whole: bool = False
    under_mouse: Reading | None = None
    heat: Heat | None = None
    shown_at: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    slices: SlicePictures | None = None
    _projected: tuple[Any, Projection] | None = None
    lights: LightScraps = field(default_factory=LightScraps)
    design: News = field(default_factory=News)
    popup: str = ""
    member: tuple[str, int] = ("", 0)
    recent: tuple[RecentFile, ...] = ()
    commands: Search | None = None
    menu: bool = False
    front: str = ""
    item: str = ""
    _swatches: dict[tuple[LightRig, RelightSpec], tuple[Colour, Colour]] = field(
        default_factory=dict
    )

    def px(self, size: float) -> float:
        """A size in the window's pixels."""
        return size * self.scale

    def acted(
        self, state: ViewState, change: Change, refusal: Callable[[ViewState], str] | None = None
    ) -> ViewState:
        """What an action makes of a state; where it refuses to, that is said."""
        new = change(state)
        if new is state and refusal is not None and (why := refusal(state)):
            self.asked.append(f"say {why}")
        return new

    def projection(self, state: ViewState) -> Projection:
        """Where the state's camera shows things in the window."""
        of = state.view, state.document.volume, self.areas["picture"]
        if self._projected is None or self._projected[0] != of:
            camera = state.view.camera(state.document.volume)
            self._projected = of, Projection(camera, self.areas["picture"])
        return self._projected[1]

    def note(self, name: str) -> None:
        """Note down where the last item is."""
        (x, y), (right, bottom) = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.areas[name] = (int(x), int(y), int(right - x), int(bottom - y))

    def swatch(self, rig: LightRig, seen: RelightSpec) -> tuple[Colour, Colour]:
        """A light on white paper: as it is beside the display's white, and to an adapted eye."""
        key = rig, seen
        if key not in self._swatches:
            if len(self._swatches) >= _MOST_SWATCHES:
                self._swatches.clear()
            self._swatches[key] = swatch_colours(rig, seen)
        return self._swatches[key]


def swatch_colours(rig: LightRig, seen: RelightSpec) -> tuple[Colour, Colour]:
    """As `Desk.swatch`; sRGB codes, 0 to 1."""
    white = white_XYZ(rig.mixed(rig.lights[0].grid))
    linear = np.maximum(linear_from_XYZ(white), 0.0)
    raw = encode(linear / max(float(linear.max()), 1e-9))
    viewing = seen.viewing
    try:
        given = replace(viewing, adapting="given")
        if rig.total_lux:
            given = replace(given, illuminance_lux=rig.total_lux)
        adapted = encode(linear_from_XYZ(passage_of(given, white).apply(0.96 * white)))
    except VolspecError:  # a light without a white to adapt to
        adapted = raw
    return _colour(raw), _colour(adapted)


def _colour(values: np.ndarray) -> Colour:
    r, g, b = (float(value) for value in values)
    return r, g, b


@lru_cache(maxsize=256)
def packed(colour: tuple[float, float, float, float]) -> int:
    """A colour, 0 to 1, as draw lists take it."""
    return imgui.color_convert_float4_to_u32(colour)


def kelvin_slider(label: str, kelvin: float) -> tuple[bool, float]:
    """A temperature, finer where the eye is finer."""
    return imgui.slider_float(
        label, kelvin, *KELVIN, format="%.0f K", flags=imgui.SliderFlags_.logarithmic
    )
