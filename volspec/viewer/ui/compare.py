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


def draw_divide(state: ViewState, ui: UiContext) -> None:
    """Draw the divide, and the names of the lights on either side."""
    if state.other is None:
        ui.areas.pop("sides", None)
        return
    x, y, width, height = ui.areas["picture"]
    at = round(x + state.divide * width)
    with over_picture(ui) as draw_list:
        # White on black is seen over any picture.
        draw_list.add_line((at, y), (at, y + height), pack_colour(BLACK, 0.5), ui.px(3.5))
        draw_list.add_line((at, y), (at, y + height), pack_colour(WHITE, 0.95), ui.px(1.5))
        _draw_handle(draw_list, ui, at, y + height / 2)
        _draw_labels(draw_list, ui, at, (state.lights, state.other))


def _draw_labels(
    draw_list: imgui.ImDrawList, ui: UiContext, at: float, sides: tuple[Rows, Rows]
) -> None:
    area = x, y, width, _ = ui.areas["picture"]
    pad, most = ui.px(8), min(width * 0.45, ui.px(_WIDEST))
    texts = [shorten(names_of(rows), most) for rows in sides]
    letters = text_width("A") + 2 * pad
    sizes = [imgui.calc_text_size(text) for text in texts]
    wide = sizes[0].x + 2 * pad + letters, sizes[1].x + 2 * pad + letters
    tall = sizes[0].y + pad
    boxes = label_boxes(area, at, wide, tall, ui.px(_TOP), ui.px(_GAP))
    lowest = max(top for _, top, _, _ in boxes) + tall
    ui.areas["sides"] = x, y, width, int(lowest - y)
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
    """Place two labels next to the line and inside the picture; one without room is lower.

    ``at`` is the line's x; a label is ``top`` below the picture's upper edge and ``gap`` away
    from the line.
    """
    x, y, width, _ = area
    upper, lower = y + top, y + top + height + gap / 2
    left, right = at - gap - widths[0], at + gap
    a = min(max(left, x + gap), x + width - gap - widths[0])
    b = max(min(right, x + width - gap - widths[1]), x + gap)
    return (
        (a, lower if a > left else upper, widths[0], height),
        (b, lower if b < right else upper, widths[1], height),
    )


def _draw_handle(draw_list: imgui.ImDrawList, ui: UiContext, x: float, y: float) -> None:
    draw_list.add_circle_filled((x, y), ui.px(12), pack_colour(BLACK, 0.5))
    draw_list.add_circle_filled((x, y), ui.px(11), pack_colour(WHITE, 0.95))
    half, dark = ui.px(4), pack_colour((0.15, 0.15, 0.15))
    for side in (-1, 1):
        base, end = x + side * ui.px(2.5), (x + side * ui.px(7), y)
        draw_list.add_triangle_filled(end, (base, y - half), (base, y + half), dark)


def names_of(rows: Rows) -> str:
    """Return the names of the lights that are on."""
    weights = effective_weights(rows)
    lit = [row.name for row, weight in zip(rows, weights, strict=True) if weight > 0]
    return " + ".join(lit[:3]) + (" + …" if len(lit) > 3 else "") or "dark"


_STEPS = 48
# CIEDE2000 of a just noticeable difference.
_NOTICEABLE = 1.0


def draw_error_map(state: ViewState, ui: UiContext) -> None:
    """Draw the error map and its legend."""
    shown = ui.results.error_map
    if shown is None or not state.interface.error_map:
        return
    if shown.texture and shown.image is ui.results.image:
        left, top, right, bottom = ui.results.shown_at
        with over_picture(ui) as draw_list:
            draw_list.add_image(imgui.ImTextureRef(shown.texture), (left, top), (right, bottom))
    _draw_legend(ui, shown.map, error_map_lines(shown.map, shown.problem))


def _draw_legend(ui: UiContext, found: ErrorMap | None, lines: list[str]) -> None:
    draw_list, white = imgui.get_background_draw_list(), pack_colour(WHITE)
    x, y = ui.areas["picture"][0] + ui.px(14), ui.areas["picture"][1] + ui.px(14)
    pad, bar = ui.px(8), ui.px(10)
    wide, tall = max(map(text_width, lines)), imgui.get_text_line_height_with_spacing()
    bottom = y + len(lines) * tall + 2 * pad + (tall + bar if found is not None else 0.0)
    end = x + wide + 2 * pad, bottom
    draw_list.add_rect_filled((x, y), end, pack_colour(BLACK, 0.55), ui.px(5))
    for i, line in enumerate(lines):
        draw_list.add_text((x + pad, y + pad + i * tall), white, line)
    if found is None:
        return
    top, step = y + pad + len(lines) * tall, wide / _STEPS
    for i, colour in enumerate(_scale()):
        left = x + pad + i * step
        draw_list.add_rect_filled((left, top), (left + step + 1, top + bar), colour)
    for fraction in (0.0, 0.5, 1.0):
        text = f"{fraction * found.top:.3g}"
        at = x + pad + fraction * (wide - text_width(text))
        draw_list.add_text((at, top + bar + ui.px(1)), white, text)


def error_map_lines(found: ErrorMap | None, problem: str) -> list[str]:
    """Return the figures of a map, or why there is none."""
    if found is None:
        return [problem or "Error map: working …"]
    figures = f"mean {found.mean:.2g}   95 % {found.p95:.2g}   max {found.max:.2g}"
    lines = [f"ΔE00, {found.compared}", figures]
    if found.max < _NOTICEABLE:
        lines.append("An eye tells 1 apart: nothing here is seen")
    return lines


@lru_cache(maxsize=1)
def _scale() -> tuple[int, ...]:
    """Return the map's colours from 0 to its top, as in `ErrorMap.heat`."""
    ramp = np.linspace(0, 1, _STEPS, dtype=np.float32)[None]
    colours = ErrorMap(ramp, np.ones_like(ramp)).heat(1.0)[0] / 255.0
    return tuple(pack_colour(colour) for colour in colours.tolist())
