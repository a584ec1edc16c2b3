"""The light dial: all lights around a circle, and a place between them that blends them."""

from __future__ import annotations

import math
from typing import Any

from imgui_bundle import imgui

from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.lights.blending import corners, dial_place
from volspec.viewer.model.lights.lighting import shining
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights.colours import raw_colour
from volspec.viewer.ui.panels.lights.names import (
    Box,
    Label,
    Letters,
    Measure,
    Ring,
    extents,
    labels_of,
    line_starts,
    ring_for,
    under,
)
from volspec.viewer.ui.panels.widgets import in_line, packed, text_width, tip
from volspec.viewer.ui.window.style import ACCENT

# Room for names: above and below, and at the sides; beyond a dot, and between two of them.
_ABOVE, _BESIDE, _OUT, _GAP = 27.0, 60.0, 3.0, 4.0
# The least radius.
_LEAST = 24.0
_DOT, _SMALL_DOT, _MANY = 7.0, 4.0, 16


def draw(state: ViewState, ui: UiContext, width: float, height: float) -> ViewState:
    """Draw it; a drag blends."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button("dial", (width, height))
    ui.note("dial")
    ring = _ring(state, ui, (x, y, width, height))
    middle, radius = ring.middle, ring.radius
    new, hovered = state, -1
    mouse = imgui.get_mouse_pos()
    place = (mouse.x - middle[0]) / radius, (mouse.y - middle[1]) / radius
    if imgui.is_item_active() and len(state.lights) > 1:
        new = reduced(state, Event("dial", *place))
    elif imgui.is_item_hovered():
        hovered = nearest(len(state.lights), *place, reach=ui.px(14) / radius)
        if hovered < 0:
            hovered = under(_placed(state, ui, ring, -1), mouse.x, mouse.y)
        if hovered >= 0:
            row = state.lights[hovered]
            imgui.set_tooltip("\n".join(dict.fromkeys(map(in_line, (row.name, row.label)))))
        else:
            tip("Drag to blend the lights; the middle is all of them alike")
    _rim(new, ui, middle, radius, hovered)
    _names(new, ui, _placed(new, ui, ring, hovered), hovered)
    return new


def nearest(count: int, x: float, y: float, reach: float) -> int:
    """The light at a place of the dial; -1 where none is within reach."""
    away = [math.hypot(px - x, py - y) for px, py in corners(count)]
    closest = min(range(count), key=lambda i: away[i])
    return closest if away[closest] <= reach else -1


def _dot(state: ViewState, ui: UiContext) -> float:
    return ui.px(_DOT if len(state.lights) <= _MANY else _SMALL_DOT)


def _rim(
    state: ViewState, ui: UiContext, middle: tuple[float, float], radius: float, hovered: int
) -> None:
    draw_list = imgui.get_window_draw_list()
    line = imgui.get_color_u32(imgui.Col_.button_active)
    text = imgui.get_color_u32(imgui.Col_.text)
    rim = corners(len(state.lights))
    at = [(middle[0] + px * radius, middle[1] + py * radius) for px, py in rim]
    draw_list.add_circle_filled(middle, radius, imgui.get_color_u32(imgui.Col_.frame_bg), 64)
    if 2 < len(at) <= _MANY:
        ends: list[Any] = [imgui.ImVec2(*place) for place in at]
        draw_list.add_polyline(ends, line, ui.px(1), imgui.ImDrawFlags_.closed)
    weights = shining(state.lights)
    px, py = dial_place(weights)
    marker = middle[0] + px * radius, middle[1] + py * radius
    accent = ACCENT[state.interface.dark]
    # Many rays would fill the disc.
    strength = 0.6 * min(1.0, _MANY / 2 / max(sum(weight > 0 for weight in weights), 1))
    for place, weight in zip(at, weights, strict=True):
        if weight > 0:
            draw_list.add_line(marker, place, packed(accent, strength), ui.px(1 + 2 * weight))
    dot = _dot(state, ui)
    for i, (row, place) in enumerate(zip(state.lights, at, strict=True)):
        draw_list.add_circle_filled(place, dot, packed(raw_colour(row.rig)))
        ring = text if i in (hovered, state.interface.light) else line
        draw_list.add_circle(place, dot, ring, 0, ui.px(1.5 if ring == text else 1))
    draw_list.add_circle_filled(marker, ui.px(5), text)
    draw_list.add_circle(marker, ui.px(5), imgui.get_color_u32(imgui.Col_.window_bg), 0, 1.5)


def _ring(state: ViewState, ui: UiContext, within: Box) -> Ring:
    _, _, width, height = within
    radii = ui.px(_LEAST), min(height / 2 - ui.px(_ABOVE), width / 2 - ui.px(_BESIDE))
    return ring_for(_asking(state), within, radii, _out(state, ui), _width(ui))


def width_for(state: ViewState, ui: UiContext, height: float) -> float:
    """How wide it would be with all names whole."""
    radius = max(height / 2 - ui.px(_ABOVE), ui.px(_LEAST))
    return sum(extents(_asking(state), radius + _out(state, ui), _width(ui)))


def _asking(state: ViewState) -> list[str]:
    """Names that the dial makes room for: none of many, of which few are written."""
    return [row.name for row in state.lights] if len(state.lights) <= _MANY else []


def _out(state: ViewState, ui: UiContext) -> float:
    return _dot(state, ui) + ui.px(_OUT)


def _width(ui: UiContext) -> Measure:
    """How wide a name is with the gap beside it."""
    return lambda text: text_width(text) + ui.px(_GAP)


def _placed(state: ViewState, ui: UiContext, ring: Ring, hovered: int) -> list[Label]:
    """As many names as there is room for: what is under the mouse, is chosen, shines first."""
    weights, chosen = shining(state.lights), state.interface.light
    ranks = [
        i - 1e3 * weight - 1e3 * (i == chosen) - 1e4 * (i == hovered)
        for i, weight in enumerate(weights)
    ]
    letters = Letters(imgui.get_text_line_height(), _width(ui))
    return labels_of([row.name for row in state.lights], ranks, ring, letters)


def _names(state: ViewState, ui: UiContext, labels: list[Label], hovered: int) -> None:
    weights, places = shining(state.lights), corners(len(state.lights))
    draw_list, half = imgui.get_window_draw_list(), ui.px(_GAP) / 2
    dim, text = (imgui.get_color_u32(c) for c in (imgui.Col_.text_disabled, imgui.Col_.text))
    for label in labels:
        colour = text if weights[label.index] > 0 or label.index == hovered else dim
        y, step = label.box[1], label.box[3] / len(label.lines)
        starts = line_starts(label, places[label.index], _width(ui))
        for i, (x, line) in enumerate(zip(starts, label.lines, strict=True)):
            draw_list.add_text((x + half, y + i * step), colour, line)
