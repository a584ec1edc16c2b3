"""The palette's table: cells, and margins with each spectrum's name and curve."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.palette import VISIBLE, Cell, CellReport
from volspec.spectra import Spectrum
from volspec.viewer.model import palette_edits
from volspec.viewer.model.light_rows import LightRow, effective_weights
from volspec.viewer.model.palette_table import PaletteTable, may_design
from volspec.viewer.model.palette_targets import LIGHT, REFLECTANCE, Member, clip_codes, stays
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import Rect, fill, outline
from volspec.viewer.ui.widgets import ACCENT, BLACK, WHITE, as_one_line, pack_colour, shorten

ROW_POPUP, COLUMN_POPUP = "palette row", "palette column"
_MAY_CHANGE = "Ticked: designs may change it to meet the targets"
_SEVERAL = "A light with several spectra cannot be designed; edit it in the Lights panel"


def draw_spectrum(
    state: ViewState, table: PaletteTable, ui: UiContext, which: Member, index: int, width: float
) -> ViewState:
    """Draw a spectrum in the margin: its name, the checkbox that frees it, its curve."""
    kind, name = which
    new, is_light = state, kind == LIGHT
    imgui.begin_group()
    imgui.push_style_var(imgui.StyleVar_.frame_padding, (0, 0))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(5), ui.px(2)))
    is_on = is_light and effective_weights(state.lights)[index] > 0
    colour = ACCENT[state.interface.dark] if is_on else imgui.get_style_color_vec4(imgui.Col_.text)
    imgui.push_style_color(imgui.Col_.text, colour)
    imgui.text(shorten(name, width))
    imgui.pop_style_color()
    clicked = imgui.is_item_clicked(0) or imgui.is_item_clicked(1)
    title = f"{as_one_line(name)}{', shown in the picture' if is_on else ''}"
    note = column_note(state.lights[index]) if is_light else ""
    words = "\n".join(filter(None, (title, note, "Click for more")))
    tip(words, greyed=True)
    single = not is_light or may_design(state, index)
    imgui.begin_disabled(not single)
    pressed, _ = imgui.checkbox("##open", which in state.palette.targets.free)
    imgui.end_disabled()
    ui.note(f"open {kind} {index}", _MAY_CHANGE if single else _SEVERAL, greyed=True)
    if pressed:
        new = palette_edits.toggle_free(new, kind, index)
    imgui.same_line()
    x, y = imgui.get_cursor_screen_pos()
    size = width - imgui.get_frame_height() - ui.px(5), imgui.get_frame_height()
    imgui.invisible_button("curve", size)
    clicked = clicked or imgui.is_item_clicked(0) or imgui.is_item_clicked(1)
    ui.note(f"{kind} {index}", words, greyed=True)
    _draw_curve(table.spectra[which], (x, y, *size), is_light, ui)
    imgui.pop_style_var(2)
    imgui.end_group()
    if clicked:
        ui.member = kind, index
        ui.popup = COLUMN_POPUP if is_light else ROW_POPUP
    return new


def _draw_curve(spectrum: Spectrum, rect: Rect, is_light: bool, ui: UiContext) -> None:
    """Draw a light filled with the colours of its wavelengths, a reflectance as a line."""
    heights, draw_list = levels(spectrum, is_light), imgui.get_window_draw_list()
    if is_light:
        fill(draw_list, rect, heights, 1.0, spectrum.grid)
        return
    x, y, width, height = rect
    base = imgui.get_color_u32(imgui.Col_.button_active)
    draw_list.add_line((x, y + height), (x + width, y + height), base)
    line = imgui.get_color_u32(imgui.Col_.text_disabled)
    outline(draw_list, rect, heights, 1.0, line, ui.px(1.3))


@lru_cache(maxsize=256)
def levels(spectrum: Spectrum, is_light: bool) -> NDArray[np.float64]:
    """Return heights 0 to 1: a light relative to its largest value, a reflectance as it is."""
    values = spectrum.values
    peak = max(float(values.max()), 1e-12) if is_light else 1.0
    return np.asarray(np.clip(values / peak, 0.0, 1.0))


def column_note(row: LightRow) -> str:
    """Return a note on a light with several spectra or one light group; empty for others.

    Colours depend on each group's shadows: a cell shows the colour outside all shadows.
    """
    if len(row.rig.lights) == 1:
        return f"From {row.rig.groups[0]} alone" if row.rig.groups[0] else ""
    parts = [
        as_one_line(text or "drawn by hand") + (f" from {group}" if group else "")
        for text, group, weight in zip(row.texts, row.rig.groups, row.rig.weights, strict=True)
        if weight > 0
    ]
    return f"{' + '.join(parts)}\nCells show colours under the whole light, outside all shadows"


CELL_POPUP = "palette cell"
_ROW, _WIDTHS, _HEADER = 84.0, (38.0, 76.0), 42.0
_CELL = 36.0
# Above this luma of a cell, marks on it are black.
_LIGHT = 0.55
_MAX_ROWS = 12
_MARKS = {"same": "=", "distinct": "≠", "free": "~"}
_T = imgui.TableFlags_
_FLAGS = _T.scroll_x | _T.scroll_y | _T.sizing_fixed_fit | _T.no_pad_outer_x


def draw(state: ViewState, table: PaletteTable, ui: UiContext) -> ViewState:
    """Draw the table; a click on a cell chooses it and opens the editor."""
    count, style = len(table.columns), imgui.get_style()
    low, high = (ui.px(width) for width in _WIDTHS)
    padding = 2 * style.cell_padding.x
    room = imgui.get_content_region_avail().x - ui.px(_ROW) - padding
    column_width = min(max(room / count - padding, low), high)
    bar = style.scrollbar_size if (column_width + padding) * count > room + 1 else 0.0
    row = ui.px(_CELL) + 2 * style.cell_padding.y
    height = row * min(len(table.rows), _MAX_ROWS) + ui.px(_HEADER) + ui.px(4) + bar
    if not imgui.begin_table("palette", count + 1, _FLAGS, (0, height)):
        return state
    imgui.table_setup_scroll_freeze(1, 1)
    imgui.table_setup_column("material", imgui.TableColumnFlags_.width_fixed, ui.px(_ROW))
    for name in table.columns:
        imgui.table_setup_column(name, imgui.TableColumnFlags_.width_fixed, column_width)
    new = _header(state, table, ui, column_width)
    for i in range(len(table.rows)):
        new = _row(new, table, ui, i, column_width)
    imgui.end_table()
    return new


def _header(state: ViewState, table: PaletteTable, ui: UiContext, width: float) -> ViewState:
    new = state
    imgui.table_next_row(imgui.TableRowFlags_.headers, ui.px(_HEADER))
    background = imgui.get_color_u32(imgui.Col_.window_bg)
    imgui.table_set_bg_color(imgui.TableBgTarget_.row_bg0, background)
    imgui.table_next_column()
    imgui.text_disabled("may change")
    tip("Ticked spectra are designed; the others stay as they are", greyed=True)
    for j, name in enumerate(table.columns):
        if not imgui.table_next_column():  # scrolled out of view
            continue
        imgui.push_id(f"column {j}")
        new = draw_spectrum(new, table, ui, (LIGHT, name), j, width)
        imgui.pop_id()
    return new


def _row(state: ViewState, table: PaletteTable, ui: UiContext, i: int, width: float) -> ViewState:
    imgui.table_next_row(imgui.TableRowFlags_.none, ui.px(_CELL))
    imgui.table_next_column()
    imgui.push_id(f"row {i}")
    name = table.rows[i]
    new = draw_spectrum(state, table, ui, (REFLECTANCE, name), i, ui.px(_ROW))
    imgui.pop_id()
    for j, column in enumerate(table.columns):
        if not imgui.table_next_column():
            continue
        place, number = (name, column), i * len(table.columns) + j
        imgui.push_id(number)
        pressed = imgui.invisible_button("cell", (width, ui.px(_CELL)))
        ui.note(f"cell {number}")
        report, target = table.cells[place], state.palette.targets.cells.get(place)
        picked = state.interface.pick.place == place
        _draw_cell(report, target, picked, state.interface.dark, ui)
        tip(cell_lines(report, target))
        imgui.pop_id()
        if pressed:
            new = palette_edits.choose_cell(new, number)
            ui.popup = CELL_POPUP
    return new


def _draw_cell(
    report: CellReport, target: Cell | None, picked: bool, dark: bool, ui: UiContext
) -> None:
    (x, y), (right, bottom) = imgui.get_item_rect_min(), imgui.get_item_rect_max()
    draw_list, rounding = imgui.get_window_draw_list(), ui.px(3)
    obtained = clip_codes(report.obtained)
    ink = contrast(obtained)
    on = pack_colour(ink, 0.85)
    draw_list.add_rect_filled((x, y), (right, bottom), pack_colour(obtained), rounding)
    if target is not None:
        middle = (x + right) / 2, (y + bottom) / 2
        half = importance(target) * min(right - x, bottom - y) / 2
        ends = (middle[0] - half, middle[1] - half), (middle[0] + half, middle[1] + half)
        if report.wanted is not None:
            draw_list.add_rect_filled(*ends, pack_colour(clip_codes(report.wanted)))
        thickness = ui.px(2 if np.isinf(target.weight) else 1)
        draw_list.add_rect(*ends, pack_colour(ink, 0.45), 0.0, thickness)
        if target.kind in _MARKS:
            _write(_MARKS[target.kind], middle, on, ui.px(14), (0.5, 0.5))
    if report.error is not None and report.error > VISIBLE:
        text = f"{report.error:.{1 if report.error < 9.95 else 0}f}"
        _write(text, (right - ui.px(3), bottom - ui.px(1)), on, ui.px(11), (1.0, 1.0))
        if target is not None and not stays(target):
            frame = pack_colour(ACCENT[dark])
            draw_list.add_rect((x, y), (right, bottom), frame, rounding, ui.px(2))
    if not report.in_gamut:
        _write("!", (right - ui.px(4), y + ui.px(1)), on, ui.px(11), (1.0, 0.0))
    if picked:
        out, line = ui.px(1.5), imgui.get_color_u32(imgui.Col_.text)
        ends = (x - out, y - out), (right + out, bottom + out)
        draw_list.add_rect(*ends, line, rounding + out, ui.px(1))


def importance(cell: Cell) -> float:
    """Return the side of the target colour's square, as a fraction of the cell's, by its weight.

    >>> importance(Cell("black")), importance(Cell("black", weight=float("inf")))
    (0.44, 0.62)
    """
    return float(np.clip(0.44 + 0.06 * np.log2(cell.weight), 0.26, 0.62))


def cell_lines(report: CellReport, target: Cell | None) -> str:
    """Return a cell's tooltip."""
    where = f"{report.reflectance} under {report.light}"
    if target is None:
        return f"{where}\nNo target; click to set one"
    words = {
        "colour": "keeps its colour if possible" if stays(target) else "target: a colour",
        "free": f"target: one colour in group “{target.group}”",
        "black": "target: black",
        "same": f"target: the colour of {' under '.join(target.other or ())}",
        "distinct": f"target: ΔE ≥ {target.distance:g} from {' under '.join(target.other or ())}",
    }[target.kind]
    far = "" if report.delta_E_2000 is None else f"\nΔE {report.delta_E_2000:.1f}"
    if report.error is not None:
        far += ", met" if report.error <= VISIBLE else ", missed; below 1 is not visible"
    outside = "" if report.in_gamut else "\n! out of the display's gamut"
    return f"{where}\n{words}{far}{outside}"


def contrast(codes: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return black or white, whichever is easier to read on a colour."""
    luma = float(np.dot(codes, (0.299, 0.587, 0.114)))
    return BLACK if luma > _LIGHT else WHITE


def _write(
    text: str, place: tuple[float, float], colour: int, size: float, pivot: tuple[float, float]
) -> None:
    """Write a text with its pivot, (0, 0) upper left to (1, 1) lower right, at a place."""
    font = imgui.get_font()
    extent, full = imgui.calc_text_size(text), imgui.get_font_size()
    left = place[0] - pivot[0] * extent.x * size / full
    top = place[1] - pivot[1] * extent.y * size / full
    imgui.get_window_draw_list().add_text(font, size, (left, top), colour, text)
