"""Spectra in large: of what shines, and of the chosen light, which the mouse can draw."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.spectra import SpectralGrid
from volspec.viewer.model import lights
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.light_parts import row_at
from volspec.viewer.model.light_rows import rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import Rect, fill, mixed_values, outline
from volspec.viewer.ui.widgets import as_one_line, shorten, text_width, tip

# Free above the peak; more where the pen is to go there.
_MIX_TOP, _PEN_TOP = 1.08, 1.35
# Type beside the panel's.
_SMALL = 0.87
_TICKS = (400, 450, 500, 550, 600, 650, 700, 750)


def draw_mix(state: ViewState, ui: UiContext, width: float, height: float) -> None:
    """What shines, filled; the chosen light alone as a line."""
    rect = _frame(ui, state.document.grid, width, height, "mix")
    grid, draw_list = state.document.grid, imgui.get_window_draw_list()
    rig = rig_of(state.lights)
    if rig is not None:
        values = mixed_values(rig, grid)
        fill(draw_list, rect, values, float(values.max()) * _MIX_TOP, grid)
    row = row_at(state.lights, state.interface.light)
    if row is not None:
        values = mixed_values(row.rig, grid)
        text = imgui.get_color_u32(imgui.Col_.text)
        outline(draw_list, rect, values, float(values.max()) * _MIX_TOP, text, ui.px(1.5))
    tip("Filled: what shines; line: the chosen light. Each to its own peak")


def draw_pen(state: ViewState, ui: UiContext, height: float) -> ViewState:
    """The chosen light's spectrum; the mouse draws on it."""
    index, grid = state.interface.light, state.document.grid
    row = row_at(state.lights, index)
    if row is None:
        return state
    panel, new = ui.lights, _heading(state, ui)
    panel.part = min(panel.part, len(row.rig.lights) - 1)
    values = row.rig.lights[panel.part].values
    taken = imgui.get_frame_height_with_spacing()
    width = imgui.get_content_region_avail().x
    rect = _frame(ui, grid, width, height - taken, "pen")
    ui.areas["spectrum"] = int(rect[0]), int(rect[1]), int(rect[2]), int(rect[3])
    held = imgui.is_item_active()
    if not held:
        panel.pen, panel.top = None, float(values.max()) * _PEN_TOP
    draw_list = imgui.get_window_draw_list()
    fill(draw_list, rect, values, panel.top, grid)
    ink = imgui.get_color_u32(imgui.Col_.text)
    outline(draw_list, rect, values, panel.top, ink, ui.px(1.5))
    if not (held or imgui.is_item_hovered()):
        return new
    mouse = imgui.get_mouse_pos()
    place = pen_place((mouse.x, mouse.y), rect, len(values), panel.top)
    if held:
        start, panel.pen = panel.pen or place, place
        new = lights.draw(new, index, panel.part, start, place)
    _cross(ui, rect, (mouse.x, mouse.y), place, grid)
    return new


def pen_place(
    mouse: tuple[float, float], rect: Rect, bands: int, top: float
) -> tuple[float, float]:
    """Where the pen is: share of the way from the first band's middle to the last one's, power.

    >>> pen_place((105.0, 20.0), (100.0, 10.0, 50.0, 20.0), 5, 2.0)
    (0.0, 1.0)
    """
    x, y, width, height = rect
    band = (mouse[0] - x) / width * bands - 0.5
    return band / (bands - 1), max(top * (1 - (mouse[1] - y) / height), 0.0)


def _heading(state: ViewState, ui: UiContext) -> ViewState:
    """Which spectrum it is, and the way back."""
    row = state.lights[state.interface.light]
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
    label = "Reset"
    button = text_width(label) + 2 * imgui.get_style().frame_padding.x
    imgui.same_line(room - button)
    if imgui.button(label):
        new = ui.run(new, BY_NAME["reset-spectrum"])
    ui.note("reset spectrum")
    tip(f"Back to {as_one_line(row.before.name)}")
    return new


def _frame(ui: UiContext, grid: SpectralGrid, width: float, height: float, name: str) -> Rect:
    """The plot's ground with its wavelengths beneath; an item of the panel."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button(name, (width, height))
    ui.note(name)
    draw_list, small = imgui.get_window_draw_list(), imgui.get_font_size() * _SMALL
    rect = x, y + ui.px(2), width, height - small - ui.px(8)
    bottom = rect[1] + rect[3]
    draw_list.add_rect_filled(
        (x, rect[1]), (x + width, bottom), imgui.get_color_u32(imgui.Col_.frame_bg, 0.45)
    )
    dim = imgui.get_color_u32(imgui.Col_.text_disabled)
    every = 1 if width > ui.px(260) else 2 if width > ui.px(100) else 3
    for nm in _TICKS[::every]:
        at = x + wavelength_share(nm, grid) * width
        text = f"{nm} nm" if nm == _TICKS[0] and every == 1 else f"{nm}"
        font = imgui.get_font()
        wide = text_width(text) * _SMALL
        if not x <= at <= x + width:
            continue
        draw_list.add_line((at, bottom), (at, bottom + ui.px(3)), dim)
        left = min(max(at - wide / 2, x), x + width - wide)
        draw_list.add_text(font, small, (left, bottom + ui.px(4)), dim, text)
    return rect


def wavelength_share(nm: float, grid: SpectralGrid) -> float:
    """Where a wavelength stands in a plot whose bands have equal parts of the width."""
    at: NDArray[np.float64] = grid.wavelengths_nm
    step = float(at[1] - at[0])
    return float((nm - at[0]) / step + 0.5) / len(at)


def _cross(
    ui: UiContext,
    rect: Rect,
    mouse: tuple[float, float],
    place: tuple[float, float],
    grid: SpectralGrid,
) -> None:
    """A hair line under the mouse, with its wavelength and power."""
    x, y, width, height = rect
    share = min(max(place[0], 0.0), 1.0)
    at = min(max(mouse[0], x), x + width)
    draw_list = imgui.get_window_draw_list()
    hair = imgui.get_color_u32(imgui.Col_.text, 0.35)
    draw_list.add_line((at, y), (at, y + height), hair)
    first, last = grid.wavelengths_nm[[0, -1]]
    text = f"{first + share * (last - first):.0f} nm  {place[1]:.2f}"
    wide = text_width(text)
    left = at + ui.px(6) if at + wide + ui.px(8) < x + width else at - wide - ui.px(6)
    draw_list.add_text((left, y + ui.px(3)), imgui.get_color_u32(imgui.Col_.text), text)
