"""Overlays of the picture: probe, scale bar, orientation cube, divide, error map."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imgui_bundle import imgui

from volspec.camera import cube_faces, cube_label, is_patient, length_mm, scale_text
from volspec.relight import ErrorMap
from volspec.viewer.model.light_rows import Rows, lit_names
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import HALF, cube_middle, face_at
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import fill, outline
from volspec.viewer.ui.widgets import (
    ACCENT,
    BLACK,
    WHITE,
    over_picture,
    pack_colour,
    shorten,
    text_width,
)
from volspec.viewer.work.probe import PixelProbe

_W = imgui.WindowFlags_
BARE_WINDOW = _W.no_decoration | _W.no_docking | _W.no_saved_settings
_FLAGS = BARE_WINDOW | _W.no_inputs | _W.always_auto_resize | _W.no_focus_on_appearing
# The scale bar in pixels at 96 dpi; a narrower picture has none.
_MAX_BAR, _MARGIN, _TICK, _NARROW = 130.0, 16.0, 4.0, 90.0
# The probe's spectra: width and height in pixels at 96 dpi, and room above the peak.
_SIZE = (196.0, 74.0)
_HEADROOM = 1.06
# A face of the cube at a smaller cosine to the eye has no letters.
_ASKEW = 0.3
# The grey of a face: a constant, and a factor for its cosine.
_SHADE = 0.30, 0.34
_EDGE, _LETTER = (0.08, 0.08, 0.08), (0.02, 0.02, 0.02)


def draw_scale(state: ViewState, ui: UiContext) -> None:
    """Draw the scale bar."""
    x, y, width, height = ui.areas["picture"]
    if not state.interface.overlays.scale or width < ui.px(_NARROW):
        return
    projection = ui.projection(state)
    mm = length_mm(projection.mm_per_px, min(ui.px(_MAX_BAR), width / 3))
    long = mm / projection.mm_per_px
    right, low = x + width - ui.px(_MARGIN), y + height - ui.px(_MARGIN)
    left, tick = right - long, ui.px(_TICK)
    text = scale_text(mm, state.document.volume)
    size = imgui.calc_text_size(text)
    line, shade = pack_colour(WHITE, 0.9), pack_colour(BLACK, 0.55)
    strokes = (
        ((left, low), (right, low)),
        ((left, low - tick), (left, low + tick)),
        ((right, low - tick), (right, low + tick)),
    )
    with over_picture(ui) as draw_list:
        # The dark outline first, so that the bar is legible on any picture.
        for colour, thick, shift in ((shade, 3.5, 1.0), (line, 1.5, 0.0)):
            for ends in strokes:
                draw_list.add_line(*ends, colour, ui.px(thick))
            place = (left + right - size.x) / 2 + shift, low - size.y - tick + shift
            draw_list.add_text(place, colour, text)
    ui.areas["scale"] = int(left), int(low - tick), int(long), int(2 * tick)


def draw_probe(state: ViewState, ui: UiContext) -> None:
    """Draw the probe's reading over the picture's lower left corner."""
    reading = ui.results.under_mouse
    if reading is None or not state.interface.probe:
        return
    x, y, _, height = ui.areas["picture"]
    corner = x + ui.px(12), y + height - ui.px(12) - ui.time_bar
    imgui.set_next_window_pos(corner, imgui.Cond_.always, (0.0, 1.0))
    imgui.set_next_window_bg_alpha(0.82)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(5))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(3)))
    if imgui.begin("##probe", None, _FLAGS)[0]:
        widest = max(text_width(name) for name, _ in reading.rows)
        label = widest + ui.px(14) + imgui.get_style().window_padding.x
        for name, value in reading.rows:
            imgui.text_disabled(name)
            imgui.same_line(label)
            imgui.text(value)
        _spectra(reading, ui)
    imgui.end()
    imgui.pop_style_var(2)


def _spectra(reading: PixelProbe, ui: UiContext) -> None:
    """Draw the light as a line, and the reflected spectrum filled with its colours."""
    x, y = imgui.get_cursor_screen_pos()
    width, height = (ui.px(side) for side in _SIZE)
    imgui.dummy((width, height))
    rect = x, y + ui.px(4), width, height - ui.px(4)
    draw_list = imgui.get_window_draw_list()
    fill(draw_list, rect, reading.reflected, _HEADROOM, reading.grid)
    text = imgui.get_color_u32(imgui.Col_.text)
    outline(draw_list, rect, reading.light, _HEADROOM, text, ui.px(1.2))


def draw_cube(state: ViewState, ui: UiContext) -> None:
    """Draw the orientation cube."""
    if not state.interface.overlays.cube:
        return
    projection = ui.projection(state)
    x, y = cube_middle(projection, ui.scale)
    half = HALF * ui.scale
    mouse, hovered = imgui.get_mouse_pos(), None
    if not imgui.get_io().want_capture_mouse:
        hovered = face_at(projection, (mouse.x, mouse.y), ui.scale)
    patient = is_patient(state.document.volume, state.interface.overlays.patient)
    with over_picture(ui) as draw_list:
        for face, corners, towards in cube_faces(projection.camera):
            a, b, c, d = ((x + half * px, y + half * py) for px, py in corners.tolist())
            grey = _SHADE[0] + _SHADE[1] * towards
            shade = ACCENT[True] if face == hovered else (grey, grey, grey)
            draw_list.add_quad_filled(a, b, c, d, pack_colour(shade, 0.88))
            draw_list.add_quad(a, b, c, d, pack_colour(_EDGE, 0.8), ui.px(1.2))
            if towards < _ASKEW:
                continue
            text = cube_label(face, patient)
            size = imgui.calc_text_size(text)
            middle_x, middle_y = (a[0] + c[0]) / 2, (a[1] + c[1]) / 2
            ink = pack_colour(_LETTER, min((towards - _ASKEW) / 0.3, 1.0))
            draw_list.add_text((middle_x - size.x / 2, middle_y - size.y / 2), ink, text)
            ui.areas[f"cube {face}"] = int(middle_x) - 1, int(middle_y) - 1, 2, 2


Box = tuple[float, float, float, float]
_TOP, _GAP, _WIDEST = 16.0, 12.0, 260.0


def draw_divide(state: ViewState, ui: UiContext) -> None:
    """Draw the divide, and the names of the lights on either side."""
    if state.other is None:
        ui.areas.pop("sides", None)
        return
    x, y, width, height = ui.areas["picture"]
    line_x = round(x + state.divide * width)
    with over_picture(ui) as draw_list:
        # White on black is visible on any picture.
        draw_list.add_line((line_x, y), (line_x, y + height), pack_colour(BLACK, 0.5), ui.px(3.5))
        draw_list.add_line((line_x, y), (line_x, y + height), pack_colour(WHITE, 0.95), ui.px(1.5))
        _draw_handle(draw_list, ui, line_x, y + height / 2)
        _draw_labels(draw_list, ui, line_x, (state.lights, state.other))


def _draw_labels(
    draw_list: imgui.ImDrawList, ui: UiContext, line_x: float, sides: tuple[Rows, Rows]
) -> None:
    """Draw the names of the lights; no letters for the sides, as lights have such names."""
    area = x, y, width, _ = ui.areas["picture"]
    pad, max_width = ui.px(8), min(width * 0.45, ui.px(_WIDEST))
    texts = [shorten(lit_names(rows), max_width) for rows in sides]
    sizes = [imgui.calc_text_size(text) for text in texts]
    widths = sizes[0].x + 2 * pad, sizes[1].x + 2 * pad
    height = sizes[0].y + pad
    boxes = label_boxes(area, line_x, widths, height, ui.px(_TOP), ui.px(_GAP))
    lowest = max(top for _, top, _, _ in boxes) + height
    ui.areas["sides"] = x, y, width, int(lowest - y)
    for text, (left, top, breadth, _) in zip(texts, boxes, strict=True):
        ends = (left, top), (left + breadth, top + height)
        draw_list.add_rect_filled(*ends, pack_colour(BLACK, 0.72), ui.px(5))
        draw_list.add_text((left + pad, top + pad / 2), pack_colour(WHITE), text)


def label_boxes(
    area: tuple[int, int, int, int],
    line_x: float,
    widths: tuple[float, float],
    height: float,
    top: float,
    gap: float,
) -> tuple[Box, Box]:
    """Place two labels next to the line and inside the picture; one without room is moved down.

    ``line_x`` is the line's x; a label is ``top`` below the picture's upper edge and ``gap`` away
    from the line.
    """
    x, y, width, _ = area
    upper, lower = y + top, y + top + height + gap / 2
    left, right = line_x - gap - widths[0], line_x + gap
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


_STEPS = 48
# CIEDE2000 of a just noticeable difference.
_NOTICEABLE = 1.0


def draw_error_map(state: ViewState, ui: UiContext) -> None:
    """Draw the error map and its legend."""
    error_map = ui.results.error_map
    if error_map is None or not state.interface.error_map:
        return
    if not error_map.shows(ui.results.image, state):
        _draw_legend(ui, None, error_map_lines(None, ""))
        return
    if error_map.texture:
        left, top, right, bottom = ui.results.shown_at
        with over_picture(ui) as draw_list:
            draw_list.add_image(imgui.ImTextureRef(error_map.texture), (left, top), (right, bottom))
    _draw_legend(ui, error_map.map, error_map_lines(error_map.map, error_map.problem))


def _draw_legend(ui: UiContext, errors: ErrorMap | None, lines: list[str]) -> None:
    draw_list, white = imgui.get_background_draw_list(), pack_colour(WHITE)
    x, y = ui.areas["picture"][0] + ui.px(14), ui.areas["picture"][1] + ui.px(14)
    pad, bar = ui.px(8), ui.px(10)
    width, line_h = max(map(text_width, lines)), imgui.get_text_line_height_with_spacing()
    bottom = y + len(lines) * line_h + 2 * pad + (line_h + bar if errors is not None else 0.0)
    end = x + width + 2 * pad, bottom
    draw_list.add_rect_filled((x, y), end, pack_colour(BLACK, 0.55), ui.px(5))
    for i, line in enumerate(lines):
        draw_list.add_text((x + pad, y + pad + i * line_h), white, line)
    if errors is None:
        return
    top, step = y + pad + len(lines) * line_h, width / _STEPS
    for i, colour in enumerate(_scale()):
        left = x + pad + i * step
        draw_list.add_rect_filled((left, top), (left + step + 1, top + bar), colour)
    for fraction in (0.0, 0.5, 1.0):
        text = f"{fraction * errors.top:.3g}"
        label_x = x + pad + fraction * (width - text_width(text))
        draw_list.add_text((label_x, top + bar + ui.px(1)), white, text)


def error_map_lines(errors: ErrorMap | None, problem: str) -> list[str]:
    """Return the figures of a map, or the message in its place."""
    if errors is None:
        return [problem or "Error map: computing …"]
    figures = f"mean {errors.mean:.2g}   95 % {errors.p95:.2g}   max {errors.max:.2g}"
    lines = [f"ΔE00, {errors.compared}", figures]
    if errors.max < _NOTICEABLE:
        lines.append("Below 1 no difference is visible")
    return lines


@lru_cache(maxsize=1)
def _scale() -> tuple[int, ...]:
    """Return the map's colours from 0 to its top, as in `ErrorMap.heat`."""
    ramp = np.linspace(0, 1, _STEPS, dtype=np.float32)[None]
    colours = ErrorMap(ramp, np.ones_like(ramp)).heat(1.0)[0] / 255.0
    return tuple(pack_colour(colour) for colour in colours.tolist())
