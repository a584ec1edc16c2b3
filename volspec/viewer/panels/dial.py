"""The light dial: all lights around a circle, and a place between them that blends them."""

from __future__ import annotations

from typing import Any

from imgui_bundle import imgui

from volspec.viewer.events import Event, reduced
from volspec.viewer.lighting import corners, dial_place, shining
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState
from volspec.viewer.style import ACCENT


def draw(state: ViewState, desk: Desk, width: float, height: float) -> ViewState:
    """Draw it; a drag blends."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button("dial", (width, height))
    desk.note("dial")
    middle = x + width / 2, y + height / 2
    radius = min(height / 2 - desk.px(24), width / 2 - desk.px(40))
    new = state
    if imgui.is_item_active() and len(state.lights) > 1:
        mouse = imgui.get_mouse_pos()
        place = (mouse.x - middle[0]) / radius, (mouse.y - middle[1]) / radius
        new = reduced(state, Event("dial", *place))
    elif imgui.is_item_hovered(imgui.HoveredFlags_.delay_normal):
        imgui.set_tooltip("Drag to blend the lights; the middle is all of them alike")
    _rim(new, desk, middle, radius)
    return new


def _rim(state: ViewState, desk: Desk, middle: tuple[float, float], radius: float) -> None:
    draw_list = imgui.get_window_draw_list()
    line = imgui.get_color_u32(imgui.Col_.button_active)
    text = imgui.get_color_u32(imgui.Col_.text)
    rim = corners(len(state.lights))
    at = [(middle[0] + px * radius, middle[1] + py * radius) for px, py in rim]
    draw_list.add_circle_filled(middle, radius, imgui.get_color_u32(imgui.Col_.frame_bg), 64)
    if len(at) > 2:
        ends: list[Any] = [imgui.ImVec2(*place) for place in at]
        draw_list.add_polyline(ends, line, desk.px(1), imgui.ImDrawFlags_.closed)
    weights = shining(state.lights)
    px, py = dial_place(weights)
    marker = middle[0] + px * radius, middle[1] + py * radius
    for place, weight in zip(at, weights, strict=True):
        if weight > 0:
            faint = imgui.color_convert_float4_to_u32((*ACCENT[state.interface.dark][:3], 0.6))
            draw_list.add_line(marker, place, faint, desk.px(1 + 2 * weight))
    for row, place, (cx, cy) in zip(state.lights, at, rim, strict=True):
        raw, _ = desk.swatch(row.rig, state.seen)
        packed = imgui.color_convert_float4_to_u32((*raw, 1.0))
        draw_list.add_circle_filled(place, desk.px(7), packed)
        draw_list.add_circle(place, desk.px(7), line, 0, desk.px(1))
        if len(state.lights) <= 8:
            name = row.name if len(row.name) <= 5 else f"{row.name[:4]}…"
            size = imgui.calc_text_size(name)
            out = desk.px(13)
            left = place[0] + cx * out - size.x * (0.5 - 0.5 * cx)
            top = place[1] + cy * out - size.y * (0.5 - 0.5 * cy)
            draw_list.add_text((left, top), imgui.get_color_u32(imgui.Col_.text_disabled), name)
    draw_list.add_circle_filled(marker, desk.px(5), text)
    draw_list.add_circle(marker, desk.px(5), imgui.get_color_u32(imgui.Col_.window_bg), 0, 1.5)
