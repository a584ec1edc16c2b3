"""Saved light states: a list to recall from, with a cross-fade."""

from __future__ import annotations

from functools import lru_cache

from imgui_bundle import imgui

from volspec.relight import LightRig
from volspec.viewer.model.actions import BY_NAME
from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.lights.lighting import Rows, rig_of
from volspec.viewer.model.lights.states import MOST_SECONDS, recalled
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights.colours import raw_colour
from volspec.viewer.ui.panels.lights.look import spark
from volspec.viewer.ui.panels.widgets import in_line, name_field, packed, shortened, tip

_SWATCH, _SPARK = 16.0, 46.0
_MENU = "state menu"


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the tab."""
    new = state
    if imgui.button("Save state"):
        new = ui.done(new, BY_NAME["save-state"])
    ui.note("save state")
    tip("All lights and the viewing, to come back to (Alt+S)")
    imgui.same_line()
    imgui.set_next_item_width(-ui.px(40))
    text = "at once" if state.interface.fade_s <= 0 else "%.1f s"
    moved, seconds = imgui.slider_float("Fade", state.interface.fade_s, 0.0, MOST_SECONDS, text)
    ui.note("fade")
    if moved:
        new = reduced(new, Event("fade", seconds))
    if not state.kept:
        imgui.text_disabled("Saved states stand here. Alt+1 … Alt+9 fade to them.")
        return new
    for i in range(len(state.kept)):
        imgui.push_id(i)
        new = _line(new, state, ui, i)
        imgui.pop_id()
    return new


def _line(new: ViewState, state: ViewState, ui: UiContext, i: int) -> ViewState:
    saved = state.kept[i]
    if ui.lights.naming == i:
        return _rename(new, ui, i)
    x, y = imgui.get_cursor_screen_pos()
    height, width = imgui.get_frame_height(), imgui.get_content_region_avail().x
    here = saved.seen == state.seen and recalled(state.lights, saved.lights) == state.lights
    button = height
    pressed, _ = imgui.selectable("##recall", here, size=(width - button - ui.px(6), height))
    ui.note(f"state {i}")
    tip(f"Fade to {in_line(saved.name)}{f' (Alt+{i + 1})' if i < 9 else ''}")
    if pressed:
        new = reduced(new, Event("recall-state", index=i))
    _look(state, ui, i, (x, y))
    imgui.same_line(width - button)
    if imgui.button("…", (button, 0)):
        imgui.open_popup(_MENU)
    ui.note(f"more {i}")
    return _menu(new, state, ui, i)


def _look(state: ViewState, ui: UiContext, i: int, at: tuple[float, float]) -> None:
    """Number, colour, spectrum, name."""
    (x, y), saved, grid = at, state.kept[i], state.document.grid
    height, inset = imgui.get_frame_height(), ui.px(3)
    draw_list = imgui.get_window_draw_list()
    dim, text = (imgui.get_color_u32(c) for c in (imgui.Col_.text_disabled, imgui.Col_.text))
    top = y + (height - imgui.get_font_size()) / 2
    draw_list.add_text((x + ui.px(4), top), dim, f"{i + 1}")
    left = x + ui.px(22)
    rig = kept_rig(saved.lights)
    if rig is not None:
        ends = (left, y + inset), (left + ui.px(_SWATCH), y + height - inset)
        draw_list.add_rect_filled(*ends, packed(raw_colour(rig)), ui.px(3))
        rect = left + ui.px(_SWATCH + 6), y + inset, ui.px(_SPARK), height - 2 * inset
        spark(draw_list, rect, rig, grid)
    left += ui.px(_SWATCH + _SPARK + 14)
    room = x + imgui.get_content_region_avail().x - height - ui.px(12) - left
    draw_list.add_text((left, top), text, shortened(saved.name, room))


@lru_cache(maxsize=128)
def kept_rig(rows: Rows) -> LightRig | None:
    """What a saved state shines with; the same one each time, by which colours are kept."""
    return rig_of(rows)


def _rename(new: ViewState, ui: UiContext, i: int) -> ViewState:
    scraps = ui.lights
    entered, ended = name_field("##name", scraps)
    ui.note("state name")
    if entered:
        new = reduced(new, Event("rename-state", index=i, key=scraps.name))
    if ended:
        scraps.naming, scraps.name = -1, ""
    return new


def _menu(new: ViewState, state: ViewState, ui: UiContext, i: int) -> ViewState:
    if not imgui.begin_popup(_MENU):
        return new
    if imgui.menu_item("Rename", "", False)[0]:
        ui.lights.naming, ui.lights.name = i, state.kept[i].name
        ui.lights.focus = True
    ui.note("rename state")
    if imgui.menu_item("Save the present lights here", "", False)[0]:
        new = reduced(new, Event("save-over-state", index=i))
    if imgui.menu_item("Delete", "", False)[0]:
        new = reduced(new, Event("delete-state", index=i))
    imgui.end_popup()
    return new
