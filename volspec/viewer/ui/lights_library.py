"""The library of lights: a search, the names found with their colours, and temperatures."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from imgui_bundle import imgui

from volspec.errors import VolspecError, one_line
from volspec.relight import LightRig
from volspec.spectra import SpectralGrid, light
from volspec.spectra.files import split_address
from volspec.spectra.library import canonical_light, describe_light, library_names, search_lights
from volspec.viewer.model import lights
from volspec.viewer.model.document import Document
from volspec.viewer.model.edit import Edited
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import fill_box, kelvin_slider, raw_colour
from volspec.viewer.ui.widgets import search_field, shorten, shown_rows, text_width, wrap_text

POPUP = "add a light"
_HINT = "tungsten, sodium, FL2, D65*0.7+A*0.3, FILE.csv"
_DAYLIGHT = (4000.0, 25000.0)


def draw(state: ViewState, ui: UiContext, take: Callable[..., Edited] = lights.add) -> ViewState:
    """Draw the library while it is open; ``take`` gets the state and the ``text`` of a light."""
    imgui.set_next_window_size((ui.px(340), 0))
    if not imgui.begin_popup(POPUP):
        return state
    panel, new = ui.library, state
    entered = search_field("##search", _HINT, panel)
    matches, typed = list(search_lights(panel.search)), panel.search.strip()
    picked = _draw_matches(matches, typed, ui, state.document)
    if entered and typed:
        is_notation = split_address(typed) is not None or set("*+") & set(typed)
        picked = matches[0] if matches and not is_notation else typed
    imgui.separator()
    picked = _temperatures(ui) or picked
    if picked:
        new, panel.complaint, _ = take(state, text=picked)
        if new is not state:
            imgui.close_current_popup()
    if panel.complaint:
        imgui.text_wrapped(panel.complaint)
    imgui.end_popup()
    return new


@lru_cache(maxsize=64)
def verdict(text: str, grid: SpectralGrid, folder: str) -> tuple[LightRig | None, str]:
    """Return the light of a notation, or its error; files are read only on Enter."""
    if not text or split_address(text) is not None:
        return None, "Enter reads the file" if text else ""
    try:
        return LightRig((light(text, grid, folder=folder),)), ""
    except (VolspecError, OSError) as error:
        return None, one_line(error)


def _draw_matches(matches: list[str], typed: str, ui: UiContext, document: Document) -> str:
    """Draw the list; return the name that was clicked, empty if none."""
    picked, grid, folder = "", document.grid, document.folder
    if imgui.begin_child("found", (0, ui.px(208))):
        rig, wrong = verdict(typed, grid, folder)
        if rig is not None and typed not in matches and not canonical_light(typed):
            matches = [typed, *matches]
        for i in shown_rows(len(matches)):
            if _entry(matches[i], ui, verdict(matches[i], grid, folder)[0]):
                picked = matches[i]
            ui.note(f"found {i}")
        if not matches:
            wrap_text(wrong, imgui.Col_.text_disabled)
    imgui.end_child()
    return picked


def _entry(name: str, ui: UiContext, rig: LightRig | None) -> bool:
    """Draw colour, name and description; return True if it was clicked."""
    x, y = imgui.get_cursor_screen_pos()
    width, line = imgui.get_content_region_avail().x, imgui.get_text_line_height()
    clicked, _ = imgui.selectable(f"##{name}", False, size=(width, line))
    draw_list, side = imgui.get_window_draw_list(), ui.px(13)
    if rig is not None:
        fill_box((x, y + (line - side) / 2, side, side), raw_colour(rig), ui.px(3))
    max_width = width - side - ui.px(16)
    text = imgui.get_color_u32(imgui.Col_.text)
    draw_list.add_text((x + side + ui.px(8), y), text, shorten(name, max_width))
    kind = describe_light(name) if name in library_names() else "as typed"
    room = width - side - ui.px(20) - min(text_width(name), max_width)
    short = shorten(kind, room) if room > ui.px(40) else ""
    dim = imgui.get_color_u32(imgui.Col_.text_disabled)
    draw_list.add_text((x + width - text_width(short), y), dim, short)
    tip(f"{name}\n{kind}")
    return bool(clicked)


def _temperatures(ui: UiContext) -> str:
    """Draw lights by temperature; return the notation of the one clicked, empty if none."""
    picked, panel = "", ui.library
    imgui.set_next_item_width(-ui.px(150))
    _, panel.kelvin = kelvin_slider("##planck", panel.kelvin)
    imgui.same_line()
    if imgui.button("Planck", (ui.px(64), 0)):
        picked = f"planck:{panel.kelvin:.0f}"
    ui.note("planck", "A Planck radiator of this temperature")
    imgui.same_line()
    low, high = _DAYLIGHT
    imgui.begin_disabled(not low <= panel.kelvin <= high)
    if imgui.button("Daylight", (-1, 0)):
        picked = f"daylight:{panel.kelvin:.0f}"
    imgui.end_disabled()
    tip(f"CIE daylight of this temperature, {low:.0f} to {high:.0f} K")
    return picked
