"""The library of materials: a search, and the list of its results with their colours."""

from __future__ import annotations

from functools import lru_cache

from imgui_bundle import imgui

from volspec.basis import Basis
from volspec.errors import VolspecError
from volspec.spectra import SpectralGrid, Spectrum, reflectance_names
from volspec.spectra.files import split_address
from volspec.viewer.model import materials
from volspec.viewer.model.commands import rank_matches
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_plot import spectrum_colour, swatch
from volspec.viewer.ui.widgets import search_field, shorten, shown_rows, text_width, tip, wrap_text
from volspec.viewer.work import css_colours

_HINT = "Another: gold, skin, steelblue, #c08040, FILE.csv"
_ROWS = 8
_COMPUTING = "Computing colours …"
# Classes by the first word of a name before its slash; metals have none.
_SETS = {
    "ACES": "camera patch",
    "CES": "CIE 224 sample",
    "ColorChecker": "chart patch",
    "ISO": "chart patch",
    "PMC": "memory colour",
    "TCS": "CIE test colour",
    "Vrhel": "object",
    "VS": "CQS sample",
}


def draw(state: ViewState, ui: UiContext, index: int) -> ViewState:
    """Draw the search for a part's material, and its results while there is a search."""
    panel = ui.library
    entered = search_field("##library", _HINT, panel)
    ui.note("library")
    typed = panel.search.strip()
    if not typed:
        return state
    rows = matching_entries(typed)
    listed = bool(rows) and rows[0].casefold() == typed.casefold()
    if not listed and _spectrum(state, typed) is not None:
        rows = [typed, *rows]
    first = rows[0] if rows else typed
    waits = _is_pending(state.transfer.basis, first)
    if entered and not waits:  # Enter has taken the keyboard from the field
        imgui.set_keyboard_focus_here(-1)
    wanted = _draw_results(state, rows, ui)
    if entered or (panel.complaint == _COMPUTING and not waits):
        wanted = first
    if panel.complaint:
        wrap_text(panel.complaint, imgui.Col_.text)
    return add_picked_material(state, ui, index, wanted) if wanted else state


# Called in every frame while something is searched for.
@lru_cache(maxsize=8)
def matching_entries(search: str) -> list[str]:
    """Return the reflectances and colours that match a search, those that begin with it first.

    >>> matching_entries("gold")[0], matching_entries("steelb")[:2], matching_entries("xyzzy")
    ('gold', ['steelblue', 'lightsteelblue'], [])
    """
    start = search.casefold()
    rows = rank_matches(library_names(), search, lambda name: f"{name} {material_class(name)}")
    names = {name: name.casefold() for name in rows}
    return sorted(rows, key=lambda name: (names[name] != start, not names[name].startswith(start)))


@lru_cache(maxsize=1)
def library_names() -> tuple[str, ...]:
    """Return all names that can be picked; a measured reflectance hides a colour of its name."""
    measured = reflectance_names()
    return (*measured, *(name for name in materials.colour_names() if name not in measured))


@lru_cache(maxsize=1024)
def material_class(name: str) -> str:
    """Return the class of a name of the library as text.

    >>> [material_class(name) for name in ("gold", "PMC/Banana", "steelblue", "white")]
    ['metal', 'memory colour', 'CSS colour', 'flat']
    """
    start, mark, _ = name.partition("/")
    if mark:
        return _SETS.get(start.partition(" ")[0], "sample")
    if name in ("white", "black"):
        return "flat"
    return "metal" if name in reflectance_names() else "CSS colour"


def _spectrum(state: ViewState, name: str) -> Spectrum | None:
    """Return the reflectance of a name or colour; None if it is neither, or not made yet."""
    basis = state.transfer.basis
    if _is_pending(basis, name):
        return None
    of = basis.grid, basis.observer_deg
    made = css_colours.colours(*of).spectra if _is_colour(name) else None
    return (made or {}).get(name.casefold()) or _look_up(name, *of)


def _is_colour(name: str) -> bool:
    return materials.is_colour(name) and name.casefold() not in reflectance_names()


def _is_pending(basis: Basis, name: str) -> bool:
    """Return True if a name is a colour's, and colours are still computed in the background."""
    return _is_colour(name) and css_colours.colours(basis.grid, basis.observer_deg).spectra is None


@lru_cache(maxsize=1024)
def _look_up(name: str, grid: SpectralGrid, observer_deg: int) -> Spectrum | None:
    if split_address(name) is not None:  # a file, read on Enter
        return None
    try:
        return materials.reflectance_for(name, grid, observer_deg, ".")
    except VolspecError:
        return None


def _draw_results(state: ViewState, rows: list[str], ui: UiContext) -> str:
    """Draw the list; return the name that was clicked, or an empty one."""
    wanted = ""
    line = imgui.get_frame_height_with_spacing()
    if imgui.begin_child("found", (0, _ROWS * line)):
        for i in shown_rows(len(rows), line):
            if _draw_result(state, rows[i], ui):
                wanted = rows[i]
            ui.note(f"found {i}")
        if not rows:
            file = split_address(ui.library.search.strip()) is not None
            text = "Enter reads the file" if file else "No match"
            wrap_text(text, imgui.Col_.text_disabled)
    imgui.end_child()
    return wanted


def _draw_result(state: ViewState, name: str, ui: UiContext) -> bool:
    """Draw a row of colour, name and class; return True if it was clicked."""
    if (spectrum := _spectrum(state, name)) is not None:
        swatch(ui, spectrum_colour(state, spectrum))
    else:
        imgui.dummy((imgui.get_frame_height(), imgui.get_frame_height()))
    imgui.same_line(0, ui.px(6))
    imgui.align_text_to_frame_padding()
    what = material_class(name) if name in library_names() else "as typed"
    room = imgui.get_content_region_avail().x - text_width(what) - ui.px(8)
    left = imgui.get_cursor_pos_x()
    flags = imgui.SelectableFlags_.no_auto_close_popups
    clicked, _ = imgui.selectable(f"{shorten(name, room)}###{name}", False, flags)
    tip(f"{name}, {what}")
    imgui.same_line(left + room + ui.px(8))
    imgui.text_disabled(what)
    return bool(clicked)


def add_picked_material(state: ViewState, ui: UiContext, index: int, wanted: str) -> ViewState:
    """Make a part of the material that was picked, or show the error."""
    panel = ui.library
    if _is_pending(state.transfer.basis, wanted):
        # It is added as soon as it is made; the window goes on drawing while a notice is shown.
        panel.search, panel.complaint = wanted, _COMPUTING
        ui.notify(_COMPUTING)
        return state
    new, panel.complaint = materials.add_material(state, index, wanted)
    if not panel.complaint:
        panel.search = ""
    ui.notify(materials.material_message(state.transfer, new.transfer))
    return new
