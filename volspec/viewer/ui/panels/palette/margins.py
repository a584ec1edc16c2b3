"""The margins of the palette's table: each spectrum's name and curve, and whether it may change.

state, Table -> [margins] -> events
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imgui_bundle import imgui
from numpy.typing import NDArray

from volspec.spectra import Spectrum
from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.lights.lighting import LightRow, shining
from volspec.viewer.model.palette.table import Table
from volspec.viewer.model.palette.wishes import LIGHT, Member
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights.look import fill, outline
from volspec.viewer.ui.panels.widgets import WAITING_GREYED, in_line, shortened, tip
from volspec.viewer.ui.window.style import ACCENT

ROW_POPUP, COLUMN_POPUP = "palette row", "palette column"
_MAY_CHANGE = "It may change, to show the colours wanted"
_SEVERAL = "Several lights in one are not designed; the Lights panel has each of them"


def member(
    state: ViewState, table: Table, ui: UiContext, which: Member, index: int, wide: float
) -> ViewState:
    """A spectrum at the margin: whether it may change, its name, its curve."""
    kind, name = which
    new, is_light = state, kind == LIGHT
    opened = which in state.board.wishes.open
    imgui.begin_group()
    imgui.push_style_var(imgui.StyleVar_.frame_padding, (0, 0))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(5), ui.px(2)))
    lit = is_light and shining(state.lights)[index] > 0
    colour = ACCENT[state.interface.dark] if lit else imgui.get_style_color_vec4(imgui.Col_.text)
    imgui.push_style_color(imgui.Col_.text, colour)
    imgui.text(shortened(name, wide))
    imgui.pop_style_color()
    clicked = imgui.is_item_clicked(0) or imgui.is_item_clicked(1)
    shown = f"{in_line(name)}{', shown in the picture' if lit else ''}"
    about = parts_told(state.lights[index]) if is_light else ""
    words = "\n".join(filter(None, (shown, about, "Click for more")))
    tip(words, WAITING_GREYED)
    single = not is_light or len(state.lights[index].rig.lights) == 1
    imgui.begin_disabled(not single)
    pressed, _ = imgui.checkbox("##open", opened)
    imgui.end_disabled()
    ui.note(f"open {kind} {index}")
    tip(_MAY_CHANGE if single else _SEVERAL, WAITING_GREYED)
    if pressed:
        new = reduced(new, Event("open", index=index, key=kind))
    imgui.same_line()
    x, y = imgui.get_cursor_screen_pos()
    size = wide - imgui.get_frame_height() - ui.px(5), imgui.get_frame_height()
    imgui.invisible_button("curve", size)
    clicked = clicked or imgui.is_item_clicked(0) or imgui.is_item_clicked(1)
    ui.note(f"{kind} {index}")
    tip(words, WAITING_GREYED)
    _curve(table.spectra[which], (x, y), size, is_light, ui)
    imgui.pop_style_var(2)
    imgui.end_group()
    if clicked:
        ui.member = kind, index
        ui.popup = COLUMN_POPUP if is_light else ROW_POPUP
    return new


def _curve(
    spectrum: Spectrum,
    place: tuple[float, float],
    size: tuple[float, float],
    is_light: bool,
    ui: UiContext,
) -> None:
    """A light filled with the colours of its wavelengths; a reflectance as a line from 0 to 1."""
    heights = levels(spectrum, is_light)
    (x, y), (wide, tall) = place, size
    draw_list, rect = imgui.get_window_draw_list(), (x, y, wide, tall)
    if is_light:
        fill(draw_list, rect, heights, 1.0, spectrum.grid)
        return
    base = imgui.get_color_u32(imgui.Col_.button_active)
    draw_list.add_line((x, y + tall), (x + wide, y + tall), base)
    line = imgui.get_color_u32(imgui.Col_.text_disabled)
    outline(draw_list, rect, heights, 1.0, line, ui.px(1.3))


@lru_cache(maxsize=256)
def levels(spectrum: Spectrum, is_light: bool) -> NDArray[np.float64]:
    """Heights 0 to 1: a light's of its largest value, a reflectance's of 1."""
    values = spectrum.values
    most = max(float(values.max()), 1e-12) if is_light else 1.0
    return np.asarray(np.clip(values / most, 0.0, 1.0))


def parts_told(row: LightRow) -> str:
    """What a column is whose light is several, or of one light group alone; empty for others.

    A cell is one colour, and a light of several groups has another wherever one is shadowed: the
    table shows what is out of every shadow.
    """
    if len(row.rig.lights) == 1:
        return f"From {row.rig.groups[0]} alone" if row.rig.groups[0] else ""
    parts = []
    for text, group, weight in zip(row.texts, row.rig.groups, row.rig.weights, strict=True):
        if weight > 0:
            what = in_line(text or "drawn by hand")
            parts.append(f"{what} from {group}" if group else what)
    return f"{' + '.join(parts)}\nThe cells are what all of it shows together, out of shadow"
