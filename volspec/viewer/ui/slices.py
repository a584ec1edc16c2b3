"""The panel of three slices under the same lights; a click in one moves the others."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from volspec.camera import is_patient, place_text, place_unit
from volspec.raycast import framing
from volspec.viewer.model import slices
from volspec.viewer.model.slices import PLANES, SliceLayout, voxel_number
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.cuts import SLICE_COLOURS
from volspec.viewer.ui.widgets import BLACK, WHITE, pack_colour, text_width
from volspec.viewer.work.slice_pictures import SlicePictures
from volspec.volume import value_text

Area = tuple[float, float, float, float]
# Pixels at 96 dpi: the least height for all slices, the least side of one, and letters' distance
# from its edge.
_MIN, _FLATTEST, _MARGIN = 150.0, 10.0, 4.0
# Offsets at which a letter's dark outline is drawn.
_AROUND = tuple((a, b) for a in (-1.2, 0.0, 1.2) for b in (-1.2, 0.0, 1.2))
# The least width of a slider with its text at the right; if narrower, the text is above.
_SHORTEST = 50.0
# A slice's side shorter than this, in lines of text, has no letters at its ends.
_CRAMPED = 2.6
# Lines of the panel without the pictures: one for each slice, and four below.
_LINES = 7


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the panel."""
    if ui.results.slices is None:
        return state
    new, volume = state, state.document.volume
    layouts = [slices.slice_layout(volume, plane) for plane in PLANES]
    avail, width = imgui.get_content_region_avail(), _steady_width()
    below = _LINES * imgui.get_frame_height_with_spacing() + 4 * imgui.get_style().item_spacing.y
    sizes = slice_sizes(
        [slices.size_mm(volume, layout) for layout in layouts],
        (width, max(avail.y - below, ui.px(_MIN))),
        ui.px(_FLATTEST),
    )
    lasts = [volume.shape_xyz[layout.normal] - 1 for layout in layouts]
    widest = max(text_width(slice_text(_title(state, i), n, n)) for i, n in enumerate(lasts))
    label_width = widest + imgui.get_style().item_inner_spacing.x
    for index, (layout, size) in enumerate(zip(layouts, sizes, strict=True)):
        new = _slider(new, ui, index, layout, (width - label_width, width))
        new = _picture(new, ui, ui.results.slices, index, layout, size)
    new = _looks(new, ui)
    imgui.push_text_wrap_pos(imgui.get_cursor_pos_x() + width)
    imgui.text_disabled(crossing_text(state))
    imgui.pop_text_wrap_pos()
    return new


def slice_sizes(
    sizes_mm: list[tuple[float, float]], room: tuple[float, float], min_px: float
) -> list[tuple[float, float]]:
    """Return the sizes in pixels, to one scale, of slices stacked in the room available.

    Sides shorter than ``min_px`` are stretched to it.
    """
    max_mm, total_mm = max(width for width, _ in sizes_mm), sum(height for _, height in sizes_mm)
    by = min(room[0] / max_mm, room[1] / total_mm)
    return [(max(width * by, min_px), max(height * by, min_px)) for width, height in sizes_mm]


def crossing_text(state: ViewState) -> str:
    """Return the value and the place at which the slices cross, as text."""
    volume, fractions = state.document.volume, state.interface.slices.at
    i, j, k = (voxel_number(volume, axis, fractions[axis]) for axis in range(3))
    place = framing.world_mm(volume, np.array([i, j, k], dtype=np.float64))
    value = value_text(volume, float(volume.nan_if_missing(volume.values[k, j, i])))
    unit = place_unit(volume, state.interface.overlays.patient)
    return f"{value}  at  {place_text(volume, place)} {unit}"


def _steady_width() -> float:
    """Return the width of the panel's items, which does not depend on its scrollbar."""
    style = imgui.get_style()
    return float(imgui.get_window_width() - 2 * style.window_padding.x - style.scrollbar_size)


def _title(state: ViewState, index: int) -> str:
    plane = PLANES[index]
    patient = is_patient(state.document.volume, state.interface.overlays.patient)
    return plane.name if patient else f"Across {'xyz'[plane.normal]}"


def slice_text(title: str, number: int, last: int) -> str:
    """Return a slice's title and number, for people who count from 1.

    >>> slice_text("Axial", 188, 188)
    'Axial 189 of 189'
    """
    return f"{title} {number + 1} of {last + 1}".lstrip()


def _slider(
    state: ViewState, ui: UiContext, index: int, layout: SliceLayout, widths: tuple[float, float]
) -> ViewState:
    """Draw a slider with its text at the right, or above if the first width is too short."""
    volume, plane = state.document.volume, PLANES[index]
    last = volume.shape_xyz[layout.normal] - 1
    number = voxel_number(volume, layout.normal, state.interface.slices.at[layout.normal])
    title, (room, full_width) = _title(state, index), widths
    fits = room >= ui.px(_SHORTEST)
    if not fits:
        short = full_width < text_width(slice_text(title, last, last))
        imgui.text(slice_text("" if short else title, number, last))
    imgui.set_next_item_width(room if fits else full_width)
    changed, new = imgui.slider_int(f"##{plane.name}", number, 0, last, "")
    ui.note(f"slider {plane.name}")
    if fits:
        imgui.same_line(0, imgui.get_style().item_inner_spacing.x)
        imgui.text(slice_text(title, number, last))
    return slices.move_slice(state, index, new / last) if changed else state


def _picture(
    state: ViewState,
    ui: UiContext,
    pictures: SlicePictures,
    index: int,
    layout: SliceLayout,
    size: tuple[float, float],
) -> ViewState:
    """Draw one slice; a drag moves the other two, the wheel steps through."""
    name, (width, height) = PLANES[index].name, size
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
        new = slices.point_at(new, index, (mouse.x - x) / width, (mouse.y - y) / height)
    if imgui.is_item_hovered():
        imgui.set_item_key_owner(imgui.Key.mouse_wheel_y)
        if turned := imgui.get_io().mouse_wheel:
            new = slices.step_slice(new, index, round(turned) or turned)
    _crosshair(new, ui, layout, (x, y, width, height))
    _letters(new, ui, layout, (x, y, width, height))
    return new


def _crosshair(state: ViewState, ui: UiContext, layout: SliceLayout, area: Area) -> None:
    """Darken the cropped part, and draw the other two slices as lines in their colours."""
    (x, y, width, height), volume = area, state.document.volume
    draw_list, dark = imgui.get_window_draw_list(), pack_colour(BLACK, 0.55)
    extent = slices.crop_extent(volume, layout, framing.crop_bounds(state.shading, volume))
    left, right = (x + fraction * width for fraction in extent[::2])
    top, bottom = (y + fraction * height for fraction in extent[1::2])
    draw_list.add_rect_filled((x, y), (x + width, top), dark)
    draw_list.add_rect_filled((x, bottom), (x + width, y + height), dark)
    draw_list.add_rect_filled((x, top), (left, bottom), dark)
    draw_list.add_rect_filled((right, top), (x + width, bottom), dark)
    across, down = slices.crossing_place(volume, layout, state.interface.slices)
    column, row = x + across * width, y + down * height
    colours = [pack_colour(SLICE_COLOURS[axis], 0.75) for axis in (layout.across, layout.down)]
    draw_list.add_line((column, y), (column, y + height), colours[0], ui.px(1))
    draw_list.add_line((x, row), (x + width, row), colours[1], ui.px(1))
    frame_colour = pack_colour(SLICE_COLOURS[layout.normal], 0.9)
    draw_list.add_rect((x, y), (x + width, y + height), frame_colour, 0.0, ui.px(1))


def _letters(state: ViewState, ui: UiContext, layout: SliceLayout, area: Area) -> None:
    """Draw the directions at the edges, with an outline that is legible on any slice."""
    (x, y, width, height), volume = area, state.document.volume
    draw_list = imgui.get_window_draw_list()
    shade, ink = pack_colour(BLACK, 0.85), pack_colour(WHITE, 0.95)
    patient = is_patient(volume, state.interface.overlays.patient)
    letters = slices.edge_letters(volume, layout, patient)
    edges = (0.0, 0.5), (1.0, 0.5), (0.5, 0.0), (0.5, 1.0)
    margin = ui.px(_MARGIN)
    for text, (px, py) in zip(letters, edges, strict=True):
        size = imgui.calc_text_size(text)
        if (width if py == 0.5 else height) < _CRAMPED * size.y:
            continue
        left = x + margin + px * (width - size.x - 2 * margin)
        top = y + margin / 2 + py * (height - size.y - margin)
        for right, down in _AROUND:
            draw_list.add_text((left + ui.px(right), top + ui.px(down)), shade, text)
        draw_list.add_text((left, top), ink, text)


def _looks(state: ViewState, ui: UiContext) -> ViewState:
    settings = state.interface.slices
    pressed, _ = imgui.checkbox("Lit", settings.lit)
    ui.note("lit", "Under the same lights as the volume; otherwise greys")
    new = ui.run(state, "slices-lit") if pressed else state
    button_width = text_width("Auto greys") + 2 * imgui.get_style().frame_padding.x
    imgui.same_line()
    if imgui.get_content_region_avail().x < button_width:
        imgui.new_line()
    imgui.begin_disabled(settings.greys is None)
    if imgui.button("Auto greys"):
        new = ui.run(new, "slices-greys")
    imgui.end_disabled()
    low, high = state.document.volume.typical_range
    span = (high - low) or 1.0
    window = slices.grey_window(settings, state.document.data[""].histogram)
    black, white = (low + fraction * span for fraction in window)
    imgui.set_next_item_width(_steady_width())
    digits = "%.0f" if state.document.volume.values.dtype.kind in "iu" else "%.4g"
    changed, black, white = imgui.drag_float_range2(
        "##greys", black, white, span / 300, low, high, digits, digits
    )
    ui.note("greys", "Values shown black and white, for voxels that the transfer function hides")
    if changed:
        new = slices.set_greys(new, (black - low) / span, (white - low) / span)
    return new
