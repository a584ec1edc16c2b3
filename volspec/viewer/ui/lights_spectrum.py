"""Large spectra: the mix of all lights, and the chosen light, which the mouse can draw."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.spectra import SpectralGrid
from volspec.viewer.model import light_parts
from volspec.viewer.model.light_rows import LightRow, light_rig, row_at
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import Rect, fill, mixed_values, outline, spark
from volspec.viewer.ui.widgets import as_one_line, shorten, text_width

# The upper edge relative to the peak: of a mix, and of a spectrum that the pen may raise.
_MIX_TOP, _PEN_TOP = 1.08, 1.35
# Size of the axis' letters, as a fraction of the panel's.
_SMALL = 0.87
_TICKS = (400, 450, 500, 550, 600, 650, 700, 750)


def draw_mix(state: ViewState, ui: UiContext, width: float, height: float) -> None:
    """Draw the mix, filled, and the chosen light as a line."""
    grid = state.document.grid
    rect = _frame(ui, grid, width, height, "mix")
    if (rig := light_rig(state.lights)) is not None:
        spark(rect, rig, grid, headroom=_MIX_TOP)
    if (row := row_at(state.lights, state.interface.light)) is not None:
        values, draw_list = mixed_values(row.rig, grid), imgui.get_window_draw_list()
        text = imgui.get_color_u32(imgui.Col_.text)
        outline(draw_list, rect, values, float(values.max()) * _MIX_TOP, text, ui.px(1.5))
    tip("Filled: the mix; line: the chosen light. Each is scaled to its own peak")


def draw_pen(state: ViewState, ui: UiContext, height: float) -> ViewState:
    """Draw the chosen light's spectrum, which the mouse can change."""
    index, grid = state.interface.light, state.document.grid
    row = row_at(state.lights, index)
    if row is None:
        return state
    panel, new = ui.lights, _heading(state, row, ui)
    panel.part = min(panel.part, len(row.rig.lights) - 1)
    values = row.rig.lights[panel.part].values
    width = imgui.get_content_region_avail().x
    rect = _frame(ui, grid, width, height - imgui.get_frame_height_with_spacing(), "pen")
    ui.areas["spectrum"] = int(rect[0]), int(rect[1]), int(rect[2]), int(rect[3])
    drawing = imgui.is_item_active()
    if not drawing:
        panel.pen, panel.top = None, float(values.max()) * _PEN_TOP
    draw_list = imgui.get_window_draw_list()
    fill(draw_list, rect, values, panel.top, grid)
    ink = imgui.get_color_u32(imgui.Col_.text)
    outline(draw_list, rect, values, panel.top, ink, ui.px(1.5))
    if not (drawing or imgui.is_item_hovered()):
        return new
    mouse = imgui.get_mouse_pos()
    place = pen_place((mouse.x, mouse.y), rect, len(values), panel.top)
    if drawing:
        start, panel.pen = panel.pen or place, place
        new = light_parts.draw(new, index, panel.part, start, place)
    _crosshair(ui, rect, mouse.x, place, grid)
    return new


def pen_place(
    mouse: tuple[float, float], rect: Rect, bands: int, top: float
) -> tuple[float, float]:
    """Return the pen's place: 0 at the first band's middle to 1 at the last one's, and power.

    >>> pen_place((105.0, 20.0), (100.0, 10.0, 50.0, 20.0), 5, 2.0)
    (0.0, 1.0)
    """
    x, y, width, height = rect
    band = (mouse[0] - x) / width * bands - 0.5
    return band / (bands - 1), max(top * (1 - (mouse[1] - y) / height), 0.0)


def _heading(state: ViewState, row: LightRow, ui: UiContext) -> ViewState:
    """Draw the light's name, a choice of its spectra, and a button to reset it."""
    groups, new = row.rig.groups, state
    room = imgui.get_content_region_avail().x
    imgui.align_text_to_frame_padding()
    imgui.text(shorten(row.name, room * 0.4))
    if len(groups) > 1:
        imgui.same_line()
        imgui.set_next_item_width(ui.px(84))
        parts = [f"{as_one_line(group) or 'all groups'}##{j}" for j, group in enumerate(groups)]
        _, ui.lights.part = imgui.combo("##part", min(ui.lights.part, len(parts) - 1), parts)
    imgui.same_line()
    if row.before is None:
        imgui.align_text_to_frame_padding()
        imgui.text_disabled("Draw with the mouse")
        return new
    imgui.same_line(room - text_width("Reset") - 2 * imgui.get_style().frame_padding.x)
    if imgui.button("Reset"):
        new = ui.run(new, "reset-spectrum")
    ui.note("reset spectrum", f"Back to {as_one_line(row.before.name)}")
    return new


def _frame(ui: UiContext, grid: SpectralGrid, width: float, height: float, name: str) -> Rect:
    """Draw a plot's background and its wavelengths; return the plot's rectangle."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button(name, (width, height))
    ui.note(name)
    draw_list, small = imgui.get_window_draw_list(), imgui.get_font_size() * _SMALL
    rect = x, y + ui.px(2), width, height - small - ui.px(8)
    bottom = rect[1] + rect[3]
    background = imgui.get_color_u32(imgui.Col_.frame_bg, 0.45)
    draw_list.add_rect_filled((x, rect[1]), (x + width, bottom), background)
    dim = imgui.get_color_u32(imgui.Col_.text_disabled)
    stride = 1 if width > ui.px(260) else 2 if width > ui.px(100) else 3
    for nm in _TICKS[::stride]:
        tick_x = x + wavelength_share(nm, grid) * width
        if not x <= tick_x <= x + width:
            continue
        text = f"{nm} nm" if nm == _TICKS[0] and stride == 1 else f"{nm}"
        label_width = text_width(text) * _SMALL
        draw_list.add_line((tick_x, bottom), (tick_x, bottom + ui.px(3)), dim)
        left = min(max(tick_x - label_width / 2, x), x + width - label_width)
        draw_list.add_text(imgui.get_font(), small, (left, bottom + ui.px(4)), dim, text)
    return rect


def wavelength_share(nm: float, grid: SpectralGrid) -> float:
    """Return a wavelength's place, 0 to 1, in a plot with bands of equal width."""
    bands_nm = grid.wavelengths_nm
    step = float(bands_nm[1] - bands_nm[0])
    return float((nm - bands_nm[0]) / step + 0.5) / len(bands_nm)


def _crosshair(
    ui: UiContext, rect: Rect, mouse_x: float, place: tuple[float, float], grid: SpectralGrid
) -> None:
    """Draw a line under the mouse, with its wavelength and power."""
    x, y, width, height = rect
    cx = min(max(mouse_x, x), x + width)
    draw_list = imgui.get_window_draw_list()
    draw_list.add_line((cx, y), (cx, y + height), imgui.get_color_u32(imgui.Col_.text, 0.35))
    first, last = grid.wavelengths_nm[[0, -1]]
    nm = first + min(max(place[0], 0.0), 1.0) * (last - first)
    text = f"{nm:.0f} nm  {place[1]:.2f}"
    w = text_width(text)
    left = cx + ui.px(6) if cx + w + ui.px(8) < x + width else cx - w - ui.px(6)
    draw_list.add_text((left, y + ui.px(3)), imgui.get_color_u32(imgui.Col_.text), text)
