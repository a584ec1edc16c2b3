"""Round handles in a plot: dragged, clicked away, and added where there is none.

Handle -> [handles] -> Touch -> events
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from imgui_bundle import imgui, implot

from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights.colours import Colour
from volspec.viewer.ui.panels.widgets import packed
from volspec.viewer.ui.window.style import ACCENT


@dataclass(frozen=True, slots=True)
class Handle:
    """One of them.

    Parameters
    ----------
    place : (x, y)
        In the plot's units.
    words : str
        Shown at the mouse.
    colour : (3,) float, optional
        sRGB codes, 0 to 1; the ink's where left out.
    """

    place: tuple[float, float]
    words: str
    colour: Colour | None = None


@dataclass(frozen=True, slots=True)
class Touch:
    """What the mouse does to one.

    Parameters
    ----------
    what : {"move", "remove", "choose", "add"}
    x, y : float
        Where it is moved or added, in the plot's units.
    index : int
        Of the handle; of none that is added.
    """

    what: Literal["move", "remove", "choose", "add"]
    x: float = 0.0
    y: float = 0.0
    index: int = 0


def touched(handles: Sequence[Handle], chosen: int, ui: UiContext, dark: bool) -> Iterator[Touch]:
    """Draw them in the plot that was begun, the chosen one ringed; what the mouse does."""
    held = False
    for i, handle in enumerate(handles):
        # The last three ask for what it tells of the mouse; `_mark` is what is seen.
        moved, x, y, clicked, hovered, down = implot.drag_point(
            i, *handle.place, (0, 0, 0, 0), ui.px(5), 0, False, False, False
        )
        held = held or bool(down) or bool(hovered)
        if hovered and imgui.is_mouse_clicked(1):
            yield Touch("remove", index=i)
        elif moved:
            yield Touch("move", x, y, i)
        if clicked or down:
            yield Touch("choose", index=i)
        if hovered or down:
            imgui.set_tooltip(handle.words)
        _mark(ui, handle, packed(ACCENT[dark]) if i == chosen else ink(), i == chosen)
    if implot.is_plot_hovered() and not held and imgui.is_mouse_double_clicked(0):
        mouse = implot.get_plot_mouse_pos()
        yield Touch("add", mouse.x, mouse.y)


def ink() -> int:
    """The text's colour, packed."""
    return int(imgui.get_color_u32(imgui.Col_.text))


def _mark(ui: UiContext, handle: Handle, ring: int, chosen: bool) -> None:
    """A handle in its colour, ringed so that it is seen on any ground."""
    implot.push_plot_clip_rect(ui.px(6))
    draw_list, place = implot.get_plot_draw_list(), implot.plot_to_pixels(*handle.place)
    draw_list.add_circle_filled(place, ui.px(5.5 if chosen else 4.5), ring)
    if handle.colour is not None:
        draw_list.add_circle_filled(place, ui.px(3.5), packed(handle.colour))
    implot.pop_plot_clip_rect()
