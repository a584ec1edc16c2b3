"""The light dial: all lights around a circle, and a place between them that blends them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from imgui_bundle import imgui

from volspec.viewer.desk import Desk
from volspec.viewer.events import Event, reduced
from volspec.viewer.lights.blending import corners, dial_place
from volspec.viewer.lights.lighting import shining
from volspec.viewer.panels.lights.colours import raw_colour
from volspec.viewer.panels.widgets import in_line, packed, shortened, tip
from volspec.viewer.state import ViewState
from volspec.viewer.window.style import ACCENT

Box = tuple[float, float, float, float]
# Room for names: above and below, and at the sides.
_ABOVE, _BESIDE, _OUT = 27.0, 60.0, 3.0
_DOT, _SMALL_DOT, _MANY = 7.0, 4.0, 16


@dataclass(frozen=True, slots=True)
class Label:
    """A name that would stand at the rim.

    Parameters
    ----------
    index : int
        Of the light.
    box : (x, y, width, height)
    rank : float
        Those of lower rank come first.
    """

    index: int
    box: Box
    rank: float


def draw(state: ViewState, desk: Desk, width: float, height: float) -> ViewState:
    """Draw it; a drag blends."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button("dial", (width, height))
    desk.note("dial")
    middle = x + width / 2, y + height / 2
    radius = max(
        min(height / 2 - desk.px(_ABOVE), width / 2 - desk.px(_BESIDE)),
        desk.px(24),
    )
    new, hovered = state, -1
    mouse = imgui.get_mouse_pos()
    place = (mouse.x - middle[0]) / radius, (mouse.y - middle[1]) / radius
    if imgui.is_item_active() and len(state.lights) > 1:
        new = reduced(state, Event("dial", *place))
    elif imgui.is_item_hovered():
        hovered = nearest(len(state.lights), *place, reach=desk.px(14) / radius)
        if hovered >= 0:
            row = state.lights[hovered]
            imgui.set_tooltip("\n".join(dict.fromkeys(map(in_line, (row.name, row.label)))))
        else:
            tip("Drag to blend the lights; the middle is all of them alike")
    _rim(new, desk, middle, radius, hovered)
    _names(new, desk, (x, y, width, height), middle, radius, hovered)
    return new


def nearest(count: int, x: float, y: float, reach: float) -> int:
    """The light at a place of the dial; -1 where none is within reach."""
    away = [math.hypot(px - x, py - y) for px, py in corners(count)]
    closest = min(range(count), key=lambda i: away[i])
    return closest if away[closest] <= reach else -1


def free(labels: Sequence[Label], within: Box, taken: Sequence[Box] = ()) -> list[Label]:
    """Those names that overlap no other and stand inside; by rank, the first in the way stays."""
    kept: list[Label] = []
    boxes = list(taken)
    for label in sorted(labels, key=lambda each: each.rank):
        if _inside(label.box, within) and not any(_overlap(label.box, box) for box in boxes):
            kept.append(label)
            boxes.append(label.box)
    return kept


def _inside(box: Box, within: Box) -> bool:
    (x, y, width, height), (left, top, wide, tall) = box, within
    return x >= left and y >= top and x + width <= left + wide and y + height <= top + tall


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


def _dot(state: ViewState, desk: Desk) -> float:
    return desk.px(_DOT if len(state.lights) <= _MANY else _SMALL_DOT)


def _rim(
    state: ViewState, desk: Desk, middle: tuple[float, float], radius: float, hovered: int
) -> None:
    draw_list = imgui.get_window_draw_list()
    line = imgui.get_color_u32(imgui.Col_.button_active)
    text = imgui.get_color_u32(imgui.Col_.text)
    rim = corners(len(state.lights))
    at = [(middle[0] + px * radius, middle[1] + py * radius) for px, py in rim]
    draw_list.add_circle_filled(middle, radius, imgui.get_color_u32(imgui.Col_.frame_bg), 64)
    if 2 < len(at) <= _MANY:
        ends: list[Any] = [imgui.ImVec2(*place) for place in at]
        draw_list.add_polyline(ends, line, desk.px(1), imgui.ImDrawFlags_.closed)
    weights = shining(state.lights)
    px, py = dial_place(weights)
    marker = middle[0] + px * radius, middle[1] + py * radius
    accent = ACCENT[state.interface.dark]
    # Many rays would fill the disc.
    strength = 0.6 * min(1.0, _MANY / 2 / max(sum(weight > 0 for weight in weights), 1))
    for place, weight in zip(at, weights, strict=True):
        if weight > 0:
            draw_list.add_line(marker, place, packed(accent, strength), desk.px(1 + 2 * weight))
    dot = _dot(state, desk)
    for i, (row, place) in enumerate(zip(state.lights, at, strict=True)):
        draw_list.add_circle_filled(place, dot, packed(raw_colour(row.rig)))
        ring = text if i in (hovered, state.interface.light) else line
        draw_list.add_circle(place, dot, ring, 0, desk.px(1.5 if ring == text else 1))
    draw_list.add_circle_filled(marker, desk.px(5), text)
    draw_list.add_circle(marker, desk.px(5), imgui.get_color_u32(imgui.Col_.window_bg), 0, 1.5)


def _names(
    state: ViewState,
    desk: Desk,
    within: Box,
    middle: tuple[float, float],
    radius: float,
    hovered: int,
) -> None:
    """As many names as there is room for: what shines first."""
    weights, labels = shining(state.lights), []
    out = _dot(state, desk) + desk.px(_OUT)
    texts: dict[int, str] = {}
    gap = desk.px(4)
    for i, (cx, cy) in enumerate(corners(len(state.lights))):
        px, py = middle[0] + cx * (radius + out), middle[1] + cy * (radius + out)
        side = (px - within[0]) if cx < 0 else within[0] + within[2] - px
        room = within[2] if abs(cx) < 0.2 else max(side, desk.px(24))
        texts[i] = shortened(state.lights[i].name, room)
        size = imgui.calc_text_size(texts[i])
        left, top = px - size.x * (0.5 - 0.5 * cx), py - size.y * (0.5 - 0.5 * cy)
        if abs(cx) < 0.2:
            left = min(max(left, within[0]), within[0] + within[2] - size.x - gap)
        rank = i - 1e3 * weights[i] - 1e3 * (i == state.interface.light) - 1e4 * (i == hovered)
        labels.append(Label(i, (left, top, size.x + gap, size.y), rank))
    draw_list = imgui.get_window_draw_list()
    dim, text = (imgui.get_color_u32(c) for c in (imgui.Col_.text_disabled, imgui.Col_.text))
    disc = radius * 1.2
    centre = middle[0] - disc / 2, middle[1] - disc / 2, disc, disc
    for label in free(labels, within, (centre,)):
        colour = text if weights[label.index] > 0 or label.index == hovered else dim
        draw_list.add_text(label.box[:2], colour, texts[label.index])
