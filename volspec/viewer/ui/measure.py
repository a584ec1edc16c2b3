"""Measurements and labels over the picture, and the panel that lists them."""

from __future__ import annotations

from collections.abc import Sequence

from imgui_bundle import imgui

from volspec.camera import Projection
from volspec.scene.tables import Annotation, place_annotation
from volspec.settings import Vector
from volspec.viewer.model import measure
from volspec.viewer.model.edit import bind
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import CLICK_FRAMES, UiContext
from volspec.viewer.ui.mouse import Area
from volspec.viewer.ui.widgets import (
    BLACK,
    WHITE,
    focus_if_wanted,
    lit_button,
    over_picture,
    pack_colour,
)

# Sizes in pixels at 96 dpi: dots, lines, their outline, and a label's leader, right and up alike.
_DOT, _LINE, _OUTLINE, _LEADER = 3.5, 1.6, 1.6, 26.0
_TITLES = {"distance": "Distance", "angle": "Angle", "label": "Label"}


def draw_annotations(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the annotations, the points picked so far, and what to click next.

    Esc ends a tool; without one, a double click on a caption edits its text in the panel.
    """
    projection = ui.projection(state)
    edited = None
    for number, annotation in enumerate(state.annotations):
        area = _draw(projection, ui, annotation.points_mm, annotation.caption)
        if area is not None:
            ui.areas[f"annotation {number}"] = area
            edited = number if _double_clicked(area) else edited
    if not state.interface.tool:
        if edited is None:
            return None
        ui.text_wanted = f"annotation text {edited}", CLICK_FRAMES
        return measure.show(state)
    points = state.interface.tool_points
    if points:
        _draw(projection, ui, points, "")
    _draw_hint(measure.hint(state), ui)
    escaped = imgui.is_key_pressed(imgui.Key.escape) and not imgui.get_io().want_text_input
    return measure.stop(state) if escaped else None


def _double_clicked(area: Area) -> bool:
    """Return True if this frame has a double click into an area of the picture."""
    (x, y), (left, top, width, height) = imgui.get_mouse_pos(), area
    inside = left <= x < left + width and top <= y < top + height
    free = inside and not imgui.get_io().want_capture_mouse
    return free and imgui.is_mouse_double_clicked(0)


def _draw(
    projection: Projection, ui: UiContext, points: Sequence[Vector], caption: str
) -> Area | None:
    """Draw points, the line through them and a caption; return the caption's rectangle."""
    leader = (ui.px(_LEADER), -ui.px(_LEADER)) if caption else (0.0, 0.0)
    placed = place_annotation(points, projection, leader)
    if placed is None:
        return None
    (x, y), dots = placed.caption.tolist(), placed.dots.tolist()
    lines = [(one.tolist(), two.tolist()) for one, two in placed.lines]
    size, pad = imgui.calc_text_size(caption), ui.px(4)
    text = x + ui.px(7), y - size.y - ui.px(4)
    low = text[0] - pad, text[1] - pad / 2
    high = text[0] + size.x + pad, text[1] + size.y + pad / 2
    with over_picture(ui) as draw_list:
        # The outline first: white on black is visible on any picture.
        for colour, wider in ((pack_colour(BLACK, 0.75), ui.px(_OUTLINE)), (pack_colour(WHITE), 0)):
            for one, two in lines:
                draw_list.add_line(one, two, colour, ui.px(_LINE) + 2 * wider)
            for dot in dots:
                draw_list.add_circle_filled(dot, ui.px(_DOT) + wider, colour)
        if caption:
            draw_list.add_rect_filled(low, high, pack_colour(BLACK, 0.62), ui.px(3))
            draw_list.add_text(text, pack_colour(WHITE), caption)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _draw_hint(text: str, ui: UiContext) -> None:
    """Write what to click next at the picture's lower edge."""
    x, y, width, height = ui.areas["picture"]
    size, pad = imgui.calc_text_size(text), ui.px(8)
    left, top = x + (width - size.x) / 2, y + height - size.y - ui.px(22)
    with over_picture(ui) as draw_list:
        low, high = (left - pad, top - pad / 2), (left + size.x + pad, top + size.y + pad / 2)
        draw_list.add_rect_filled(low, high, pack_colour(BLACK, 0.72), ui.px(5))
        draw_list.add_text((left, top), pack_colour(WHITE), text)


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel: a button for each tool, and the annotations."""
    new = state
    for number, (tool, title) in enumerate(_TITLES.items()):
        if number:
            imgui.same_line(0, ui.px(6))
        if lit_button(title, state.interface.tool == tool, state.interface.dark):
            new = measure.start(new, tool)
        ui.note(f"tool {tool}")
    if not state.annotations:
        imgui.text_wrapped("Pick a tool, then click points of the picture.")
    remove: int | None = None
    for i, annotation in enumerate(state.annotations):
        imgui.push_id(i)
        new = _row(new, annotation, ui, i)
        imgui.same_line(0, ui.px(6))
        if imgui.button("×", (imgui.get_frame_height(), 0)):
            remove = i
        ui.note(f"remove annotation {i}", "Remove it")
        imgui.pop_id()
    if remove is not None:
        new = measure.remove(new, remove)
    return None if new is state else new


def _row(state: ViewState, note: Annotation, ui: UiContext, i: int) -> ViewState:
    """Draw an annotation's text to edit, and its number."""
    number = "" if note.value is None else note.caption.removeprefix(note.text).strip()
    room = imgui.get_content_region_avail().x - imgui.get_frame_height() - ui.px(6)
    imgui.set_next_item_width(room - (ui.px(96) if number else 0))
    focus_if_wanted(f"annotation text {i}", ui)
    flags = imgui.InputTextFlags_.auto_select_all
    changed, text = imgui.input_text_with_hint("##text", "name", note.text, flags)
    ui.note(f"annotation text {i}")
    if number:
        imgui.same_line(0, ui.px(6))
        imgui.align_text_to_frame_padding()
        imgui.text(number)
        imgui.same_line(room + imgui.get_style().window_padding.x)
    return ui.edited(state, bind(measure.rename, i, text)) if changed else state
