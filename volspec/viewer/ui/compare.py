"""Comparisons over the picture: the divide between two sets of lights, the error map."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imgui_bundle import imgui

from volspec.relight.error_map import ErrorMap
from volspec.viewer.model.light_rows import Rows, effective_weights
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import BLACK, WHITE, over_picture, pack_colour, shorten, text_width

Box = tuple[float, float, float, float]
_TOP, _GAP, _WIDEST = 16.0, 12.0, 260.0


def draw_divide(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it over the picture, and which lights are on either side."""
    if state.other is None:
        ui.areas.pop("sides", None)
        return None
    area = ui.areas["picture"]
    x, y, width, height = area
    at = round(x + state.divide * width)
    with over_picture(ui) as draw_list:
        # White on black: seen over any picture.
        draw_list.add_line((at, y), (at, y + height), pack_colour(BLACK, 0.5), ui.px(3.5))
        draw_list.add_line((at, y), (at, y + height), pack_colour(WHITE, 0.95), ui.px(1.5))
        _handle(ui, (at, y + height / 2))
        _labels(ui, area, at, (state.lights, state.other))
    return None


def _labels(
    ui: UiContext, area: tuple[int, int, int, int], at: float, sides: tuple[Rows, Rows]
) -> None:
    """Which lights are at the left and the right of the line."""
    _, y, width, _ = area
    draw_list = imgui.get_background_draw_list()
    pad, most = ui.px(8), min(width * 0.45, ui.px(_WIDEST))
    texts = [shorten(names_of(rows), most) for rows in sides]
    letters = text_width("A") + 2 * pad
    sizes = [imgui.calc_text_size(text) for text in texts]
    wide = sizes[0].x + 2 * pad + letters, sizes[1].x + 2 * pad + letters
    tall = sizes[0].y + pad
    boxes = label_boxes(area, at, wide, tall, ui.px(_TOP), ui.px(_GAP))
    lowest = max(top for _, top, _, _ in boxes) + tall
    ui.areas["sides"] = area[0], y, width, int(lowest - y)
    for letter, text, (left, top, breadth, _) in zip("AB", texts, boxes, strict=True):
        ends = (left, top), (left + breadth, top + tall)
        draw_list.add_rect_filled(*ends, pack_colour(BLACK, 0.72), ui.px(5))
        badge = (left, top), (left + letters, top + tall)
        draw_list.add_rect_filled(*badge, pack_colour(WHITE, 0.92), ui.px(5))
        draw_list.add_text((left + pad, top + pad / 2), pack_colour(BLACK), letter)
        draw_list.add_text((left + letters + pad, top + pad / 2), pack_colour(WHITE), text)


def label_boxes(
    area: tuple[int, int, int, int],
    at: float,
    widths: tuple[float, float],
    height: float,
    top: float,
    gap: float,
) -> tuple[Box, Box]:
    """Where the names stand: beside the line, inside the picture; one that has no room, lower.

    Parameters
    ----------
    area : (x, y, width, height)
        Of the picture.
    at : float
        The line's x.
    widths : (left, right)
        Of the two labels.
    height, top, gap : float
        Of a label; from the picture's edge; from the line.
    """
    x, y, width, _ = area
    left, right = at - gap - widths[0], at + gap
    a = min(max(left, x + gap), x + width - gap - widths[0]), y + top, widths[0], height
    b = max(min(right, x + width - gap - widths[1]), x + gap), y + top, widths[1], height
    lower = y + top + height + gap / 2
    if a[0] > left:
        a = a[0], lower, a[2], a[3]
    if b[0] < right:
        b = b[0], lower, b[2], b[3]
    return a, b


def _handle(ui: UiContext, at: tuple[float, float]) -> None:
    draw_list, radius, (x, y) = imgui.get_background_draw_list(), ui.px(11), at
    draw_list.add_circle_filled(at, radius + ui.px(1), pack_colour(BLACK, 0.5))
    draw_list.add_circle_filled(at, radius, pack_colour(WHITE, 0.95))
    near, far, half = ui.px(2.5), ui.px(7), ui.px(4)
    for side in (-1, 1):
        end, upper, lower = (x + side * far, y), (x + side * near, y - half), y + half
        dark = pack_colour((0.15, 0.15, 0.15))
        draw_list.add_triangle_filled(end, upper, (x + side * near, lower), dark)


def names_of(rows: Rows) -> str:
    """The names of what shines."""
    lit = [
        row.name for row, weight in zip(rows, effective_weights(rows), strict=True) if weight > 0
    ]
    return " + ".join(lit[:3]) + (" + …" if len(lit) > 3 else "") or "dark"


_STEPS = 48
# CIEDE2000 of colours that an eye can just tell apart.
_TOLD_APART = 1.0


def draw_error_map(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it."""
    shown = ui.results.error_map
    if shown is None or not state.interface.error_map:
        return None
    if shown.texture and shown.image is ui.results.image:
        left, top, right, bottom = ui.results.shown_at
        with over_picture(ui) as draw_list:
            draw_list.add_image(imgui.ImTextureRef(shown.texture), (left, top), (right, bottom))
    x, y, _, _ = ui.areas["picture"]
    _legend(ui, (x + ui.px(14), y + ui.px(14)))
    return None


def _legend(ui: UiContext, corner: tuple[float, float]) -> None:
    shown = ui.results.error_map
    assert shown is not None
    found = shown.map
    lines = error_map_lines(found, shown.problem)
    draw_list = imgui.get_background_draw_list()
    x, y = corner
    wide = max(text_width(line) for line in lines)
    tall = imgui.get_text_line_height_with_spacing()
    bar = ui.px(10) if found is not None else 0.0
    rows = len(lines) + int(found is not None)
    pad = ui.px(8)
    white = pack_colour(WHITE)
    end = x + wide + 2 * pad, y + rows * tall + bar + 2 * pad
    draw_list.add_rect_filled((x, y), end, pack_colour(BLACK, 0.55), ui.px(5))
    for i, line in enumerate(lines):
        draw_list.add_text((x + pad, y + pad + i * tall), white, line)
    if found is None:
        return
    top = y + pad + len(lines) * tall
    step = wide / _STEPS
    for i, colour in enumerate(_scale()):
        left = x + pad + i * step
        draw_list.add_rect_filled((left, top), (left + step + 1, top + bar), colour)
    for share in (0.0, 0.5, 1.0):
        text = f"{share * found.top:.3g}"
        at = x + pad + share * (wide - text_width(text))
        draw_list.add_text((at, top + bar + ui.px(1)), white, text)


def error_map_lines(found: ErrorMap | None, problem: str) -> list[str]:
    """The figures of a map; where there is none, why."""
    if found is None:
        return [problem or "Error map: working …"]
    figures = f"mean {found.mean:.2g}   95 % {found.p95:.2g}   max {found.max:.2g}"
    lines = [f"ΔE00, {found.compared}", figures]
    if found.max < _TOLD_APART:
        lines.append("An eye tells 1 apart: nothing here is seen")
    return lines


@lru_cache(maxsize=1)
def _scale() -> tuple[int, ...]:
    """The map's colours from 0 to its top, as `ErrorMap.heat` has them."""
    ramp = np.linspace(0, 1, _STEPS, dtype=np.float32)[None]
    colours = ErrorMap(ramp, np.ones_like(ramp)).heat(1.0)[0] / 255.0
    return tuple(pack_colour(colour) for colour in colours.tolist())
