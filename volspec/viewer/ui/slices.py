"""The panel of three slices under the same lights; a click in one moves the others."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from volspec.viewer.model import slices
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.cuts import crop_of, world_mm
from volspec.viewer.model.slices import (
    PLANES,
    Layout,
    crop_extent,
    crossing_place,
    edge_letters,
    is_patient,
    layout_of,
    number_of,
    size_mm,
    window_of,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.cuts import SLICE_COLOURS
from volspec.viewer.ui.widgets import BLACK, WHITE, pack_colour, text_width, tip
from volspec.viewer.work.slice_pictures import SlicePictures

# Pixels at 96 dpi: the least height for all slices, the least side of one, and letters' distance
# from its edge.
_LEAST, _FLATTEST, _MARGIN = 150.0, 10.0, 4.0
# Where a letter's shade is drawn beside it.
_AROUND = tuple((a, b) for a in (-1.2, 0.0, 1.2) for b in (-1.2, 0.0, 1.2))
# Of a slider with its words beside it; with less they stand above.
_SHORTEST = 50.0
# Of a slice's side in lines of text: a shorter one has no letters at its ends.
_CRAMPED = 2.6
# Lines of the panel beside the pictures: one for each slice, and four below.
_LINES = 7


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    if ui.results.slices is None:
        return None
    new, volume = state, state.document.volume
    layouts = [layout_of(volume, plane) for plane in PLANES]
    avail, wide = imgui.get_content_region_avail(), _steady_width()
    below = _LINES * imgui.get_frame_height_with_spacing() + 4 * imgui.get_style().item_spacing.y
    sizes = slice_sizes(
        [size_mm(volume, layout) for layout in layouts],
        (wide, max(avail.y - below, ui.px(_LEAST))),
        ui.px(_FLATTEST),
    )
    beside = _widest(state, layouts) + imgui.get_style().item_inner_spacing.x
    for index, (layout, size) in enumerate(zip(layouts, sizes, strict=True)):
        new = _slider(new, ui, index, layout, (wide - beside, wide))
        new = _picture(new, ui, ui.results.slices, index, layout, size)
    new = _looks(new, ui)
    imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + wide)
    imgui.text_disabled(crossing_text(state))
    imgui.pop_text_wrap_pos()
    return None if new is state else new


def slice_sizes(
    sizes_mm: list[tuple[float, float]], room: tuple[float, float], least: float
) -> list[tuple[float, float]]:
    """Width and height of slices one above the other in a room, all to one scale.

    Those that would be next to nothing are stretched to ``least``.
    """
    wide, tall = max(width for width, _ in sizes_mm), sum(height for _, height in sizes_mm)
    by = min(room[0] / wide, room[1] / tall)
    return [(max(width * by, least), max(height * by, least)) for width, height in sizes_mm]


def crossing_text(state: ViewState) -> str:
    """What is where the slices cross."""
    volume, at = state.document.volume, state.interface.slices.at
    i, j, k = (number_of(volume, axis, at[axis]) for axis in range(3))
    x, y, z = world_mm(volume, np.array([i, j, k], dtype=np.float64))
    value = float(volume.values[k, j, i])
    return f"{value:.5g}  at  {x:.1f}  {y:.1f}  {z:.1f} mm"


def _steady_width() -> float:
    """Of the panel's items, whether it has a scrollbar or not: one must not bring the other."""
    style = imgui.get_style()
    return float(imgui.get_window_width() - 2 * style.window_padding.x - style.scrollbar_size)


def _title(state: ViewState, index: int) -> str:
    plane = PLANES[index]
    patient = is_patient(state.document.volume, state.interface.aids.patient)
    return plane.name if patient else f"Across {'xyz'[plane.normal]}"


def _widest(state: ViewState, layouts: list[Layout]) -> float:
    """Of the words beside the sliders."""
    shape = state.document.volume.shape_xyz
    lasts = [shape[layout.normal] - 1 for layout in layouts]
    return max(text_width(_where(_title(state, i), last, last)) for i, last in enumerate(lasts))


def _where(title: str, number: int, last: int) -> str:
    return f"{title} {number}/{last}".lstrip()


def _slider(
    state: ViewState, ui: UiContext, index: int, layout: Layout, widths: tuple[float, float]
) -> ViewState:
    """With its words at the right; above, where the first of the widths is too short for it."""
    volume, plane = state.document.volume, PLANES[index]
    last = volume.shape_xyz[layout.normal] - 1
    number = number_of(volume, layout.normal, state.interface.slices.at[layout.normal])
    room, wide = widths
    fits = room >= ui.px(_SHORTEST)
    if not fits:
        short = wide < text_width(_where(_title(state, index), last, last))
        imgui.text(_where("" if short else _title(state, index), number, last))
    imgui.set_next_item_width(room if fits else wide)
    moved, new = imgui.slider_int(f"##{plane.name}", number, 0, last, "")
    ui.note(f"slider {plane.name}")
    if fits:
        imgui.same_line(0, imgui.get_style().item_inner_spacing.x)
        imgui.text(_where(_title(state, index), number, last))
    return slices.move_slice(state, index, new / last) if moved else state


def _picture(
    state: ViewState,
    ui: UiContext,
    pictures: SlicePictures,
    index: int,
    layout: Layout,
    size: tuple[float, float],
) -> ViewState:
    """One slice with its crosshair; a drag points, the wheel goes through."""
    name, (width, high) = PLANES[index].name, size
    texture = pictures.texture(state, name, layout, width)
    corner = imgui.get_cursor_screen_pos()
    x, y = round(corner.x + (_steady_width() - width) / 2), round(corner.y)
    imgui.set_cursor_screen_pos((x, y))
    imgui.image(imgui.ImTextureRef(texture), size)
    imgui.set_cursor_screen_pos((x, y))
    imgui.invisible_button(f"slice {name}", size)
    ui.note(f"slice {name}")
    new = state
    if imgui.is_item_active():
        mouse = imgui.get_mouse_pos()
        share = (mouse.x - x) / width, (mouse.y - y) / high
        new = slices.point_at(new, index, *share)
    if imgui.is_item_hovered():
        imgui.set_item_key_owner(imgui.Key.mouse_wheel_y)
        if turned := imgui.get_io().mouse_wheel:
            new = slices.step_slice(new, index, round(turned) or turned)
    _crosshair(new, ui, layout, (x, y, width, high))
    return new


def _crosshair(
    state: ViewState, ui: UiContext, layout: Layout, area: tuple[float, float, float, float]
) -> None:
    """What a crop leaves, and the other two slices' lines in their colours."""
    x, y, width, height = area
    volume = state.document.volume
    draw_list = imgui.get_window_draw_list()
    left, top, right, bottom = crop_extent(volume, layout, crop_of(state.shading, volume))
    for x0, y0, x1, y1 in (
        *((0.0, 0.0, 1.0, top), (0.0, bottom, 1.0, 1.0)),
        *((0.0, top, left, bottom), (right, top, 1.0, bottom)),
    ):
        ends = (x + x0 * width, y + y0 * height), (x + x1 * width, y + y1 * height)
        draw_list.add_rect_filled(*ends, pack_colour(BLACK, 0.55))
    across, down = crossing_place(volume, layout, state.interface.slices)
    at = x + across * width, y + down * height
    for axis, ends in (
        (layout.across, ((at[0], y), (at[0], y + height))),
        (layout.down, ((x, at[1]), (x + width, at[1]))),
    ):
        draw_list.add_line(*ends, pack_colour(SLICE_COLOURS[axis], 0.75), ui.px(1))
    own = pack_colour(SLICE_COLOURS[layout.normal], 0.9)
    draw_list.add_rect((x, y), (x + width, y + height), own, 0.0, ui.px(1))
    _letters(state, ui, layout, area)


def _letters(
    state: ViewState, ui: UiContext, layout: Layout, area: tuple[float, float, float, float]
) -> None:
    """Where the edges look, on a shade that is legible on any slice."""
    (x, y, width, height), volume = area, state.document.volume
    draw_list = imgui.get_window_draw_list()
    shade, ink = pack_colour(BLACK, 0.85), pack_colour(WHITE, 0.95)
    letters = edge_letters(volume, layout, is_patient(volume, state.interface.aids.patient))
    edges = (0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0)
    margin = ui.px(_MARGIN)
    for text, (px, py) in zip(letters, edges, strict=True):
        size = imgui.calc_text_size(text)
        if (width if py == 0.5 else height) < _CRAMPED * size.y:
            continue
        place = (
            x + margin + px * (width - size.x - 2 * margin),
            y + margin / 2 + py * (height - size.y - margin),
        )
        for around in _AROUND:
            at = place[0] + ui.px(around[0]), place[1] + ui.px(around[1])
            draw_list.add_text(at, shade, text)
        draw_list.add_text(place, ink, text)


def _looks(state: ViewState, ui: UiContext) -> ViewState:
    settings = state.interface.slices
    pressed, _ = imgui.checkbox("Lit", settings.lit)
    ui.note("lit")
    tip("Under the same lights as the volume; else plain greys")
    new = ui.run(state, BY_NAME["slices-lit"]) if pressed else state
    wanted = text_width("Auto greys") + 2 * imgui.get_style().frame_padding.x
    imgui.same_line()
    if imgui.get_content_region_avail().x < wanted:
        imgui.new_line()
    imgui.begin_disabled(settings.greys is None)
    if imgui.button("Auto greys"):
        new = ui.run(new, BY_NAME["slices-greys"])
    imgui.end_disabled()
    low, high = state.document.volume.range
    span = (high - low) or 1.0
    window = window_of(settings, state.document.histogram)
    black, white = (low + share * span for share in window)
    imgui.set_next_item_width(_steady_width())
    digits = "%.0f" if state.document.volume.values.dtype.kind in "iu" else "%.4g"
    moved, black, white = imgui.drag_float_range2(
        "##greys", black, white, span / 300, low, high, digits, digits
    )
    ui.note("greys")
    tip("Values shown black and white, where the transfer function shows nothing")
    if moved:
        new = slices.set_greys(new, (black - low) / span, (white - low) / span)
    return new
