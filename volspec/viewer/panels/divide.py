"""The line between two settings of lights, shown side by side."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.lighting import Rows, shining
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_LINE, _SHADE, _TEXT = (1.0, 1.0, 1.0, 0.85), (0.0, 0.0, 0.0, 0.45), (1.0, 1.0, 1.0, 1.0)


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw it over the picture, and which lights are on either side."""
    if state.other is None:
        return None
    x, y, width, height = desk.areas["picture"]
    at = round(x + state.divide * width)
    draw_list = imgui.get_background_draw_list()
    draw_list.push_clip_rect((x, y), (x + width, y + height))
    line, shade, white = (imgui.color_convert_float4_to_u32(c) for c in (_LINE, _SHADE, _TEXT))
    draw_list.add_line((at, y), (at, y + height), line, desk.px(1.5))
    draw_list.add_circle_filled((at, y + height / 2), desk.px(6), line)
    pad = desk.px(7)
    for rows, side in ((state.lights, -1), (state.other, 1)):
        text = called(rows)
        size = imgui.calc_text_size(text)
        left = at + pad * 2 if side > 0 else at - pad * 2 - size.x
        top = y + desk.px(18)
        ends = (left - pad, top - pad / 2), (left + size.x + pad, top + size.y + pad / 2)
        draw_list.add_rect_filled(*ends, shade, desk.px(4))
        draw_list.add_text((left, top), white, text)
    draw_list.pop_clip_rect()
    return None


def called(rows: Rows) -> str:
    """The names of what shines."""
    lit = [row.name for row, weight in zip(rows, shining(rows), strict=True) if weight > 0]
    return " + ".join(lit[:3]) + (" + …" if len(lit) > 3 else "") or "dark"
