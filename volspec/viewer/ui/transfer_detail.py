"""The chosen part in numbers: values, opacity, its mix of materials, and their library."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

from imgui_bundle import imgui

from volspec.basis import Basis
from volspec.errors import VolspecError
from volspec.spectra import Observer, SpectralGrid, Spectrum, reflectance_names
from volspec.spectra.files import split_address
from volspec.spectra.library import FLUOROPHORE
from volspec.transfer import presets
from volspec.viewer.model import fields, materials, transfer_edits
from volspec.viewer.model.commands import rank_matches
from volspec.viewer.model.materials import other_functions, uses_of_material
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts
from volspec.viewer.ui import palette_editor
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import Colour
from volspec.viewer.ui.transfer_plot import (
    LIT,
    material_colours,
    part_colours,
    spectrum_colour,
    swatch,
)
from volspec.viewer.ui.widgets import (
    as_one_line,
    search_field,
    shorten,
    shown_rows,
    text_width,
    wrap_text,
)
from volspec.viewer.work import css_colours
from volspec.volume import value_form

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
    "sRGB": "display colour",
}


def draw_library(state: ViewState, ui: UiContext, index: int) -> ViewState:
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
    picked = _results(state, rows, ui)
    if entered or (panel.complaint == _COMPUTING and not waits):
        picked = first
    if panel.complaint:
        wrap_text(panel.complaint, imgui.Col_.text)
    return add_picked_material(state, ui, index, picked) if picked else state


# Called in every frame during a search.
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
    """Return all names that can be picked; a reflectance hides a CSS colour of the same name."""
    measured = reflectance_names()
    return (*measured, *(name for name in materials.colour_names() if name not in measured))


@lru_cache(maxsize=1024)
def material_class(name: str) -> str:
    """Return the class of a name in the library as text.

    >>> [material_class(name) for name in ("gold", "PMC/Banana", "steelblue", "white")]
    ['metal', 'memory colour', 'CSS colour', 'flat']
    """
    if name.startswith(f"{FLUOROPHORE}:"):
        return FLUOROPHORE
    start, mark, _ = name.partition("/")
    if mark:
        return _SETS.get(start.partition(" ")[0], "sample")
    if name in ("white", "black"):
        return "flat"
    return "metal" if name in reflectance_names() else "CSS colour"


def _spectrum(state: ViewState, name: str) -> Spectrum | None:
    """Return the reflectance of a name or colour; None if it is neither, or not ready yet."""
    basis = state.transfer.basis
    if _is_pending(basis, name):
        return None
    of = basis.grid, basis.observer_deg
    spectra = css_colours.colours(*of).spectra if _is_colour(name) else None
    return (spectra or {}).get(name.casefold()) or _look_up(name, *of)


def _is_colour(name: str) -> bool:
    return materials.is_colour(name) and name.casefold() not in reflectance_names()


def _is_pending(basis: Basis, name: str) -> bool:
    """Return True for a colour's name while colours are still computed in the background."""
    return _is_colour(name) and css_colours.colours(basis.grid, basis.observer_deg).spectra is None


@lru_cache(maxsize=1024)
def _look_up(name: str, grid: SpectralGrid, observer_deg: Observer) -> Spectrum | None:
    if split_address(name) is not None:  # a file, read on Enter
        return None
    try:
        return materials.reflectance_for(name, grid, observer_deg, ".")
    except VolspecError:
        return None


def _results(state: ViewState, rows: list[str], ui: UiContext) -> str:
    """Draw the list; return the name that was clicked, empty if none."""
    picked = ""
    line = imgui.get_frame_height_with_spacing()
    if imgui.begin_child("found", (0, _ROWS * line)):
        for i in shown_rows(len(rows), line):
            if _result(state, rows[i], ui):
                picked = rows[i]
            ui.note(f"found {i}")
        if not rows:
            file = split_address(ui.library.search.strip()) is not None
            text = "Enter reads the file" if file else "No match"
            wrap_text(text, imgui.Col_.text_disabled)
    imgui.end_child()
    return picked


def _result(state: ViewState, name: str, ui: UiContext) -> bool:
    """Draw a row of colour, name and class; return True if it was clicked."""
    if (spectrum := _spectrum(state, name)) is not None:
        swatch(ui, spectrum_colour(state, spectrum))
    else:
        imgui.dummy((imgui.get_frame_height(), imgui.get_frame_height()))
    imgui.same_line(0, ui.px(6))
    imgui.align_text_to_frame_padding()
    kind = material_class(name) if name in library_names() else "as typed"
    room = imgui.get_content_region_avail().x - text_width(kind) - ui.px(8)
    left = imgui.get_cursor_pos_x()
    flags = imgui.SelectableFlags_.no_auto_close_popups
    clicked, _ = imgui.selectable(f"{shorten(name, room)}###{name}", False, flags)
    tip(f"{name}, {kind}")
    imgui.same_line(left + room + ui.px(8))
    imgui.text_disabled(kind)
    return bool(clicked)


def add_picked_material(state: ViewState, ui: UiContext, index: int, name: str) -> ViewState:
    """Make a part of the material that was picked, or show the error."""
    panel = ui.library
    if _is_pending(state.transfer.basis, name):
        # It is added as soon as it is ready; the window keeps drawing while a notice is shown.
        panel.search, panel.complaint = name, _COMPUTING
        ui.notify(_COMPUTING)
        return state
    new, panel.complaint, _ = materials.add_material(state, index, name)
    if not panel.complaint:
        panel.search = ""
    ui.notify(materials.material_message(state.transfer, new.transfer))
    return new


_CLAMP = imgui.SliderFlags_.always_clamp
# Most opacities are small, where the slider is finer.
_FINE = imgui.SliderFlags_.logarithmic | _CLAMP
# The widths of a remove button, and of a material's name; pixels at 96 dpi.
_REMOVE, _NAME = 24, 110


def chosen_part(state: ViewState) -> int:
    """Return the index of the part whose details are shown."""
    return min(max(state.interface.part, 0), len(list_parts(state.transfer)) - 1)


def height_above(lines: int, ui: UiContext, min_px: float = 115, below: float = 0.0) -> float:
    """Return the panel's height above some lines of details and ``below`` pixels."""
    room = imgui.get_content_region_avail().y - lines * imgui.get_frame_height_with_spacing()
    return max(room - below, ui.px(min_px))


def draw_value(state: ViewState, ui: UiContext, kind: str) -> ViewState:
    """Draw the chosen part's value and opacity and the button that removes it in one line."""
    index, parts, new = chosen_part(state), list_parts(state.transfer), state
    now, volume = parts[index].values[0], fields.data(state).volume
    low, high = presets.value_span(volume)
    width = (imgui.get_content_region_avail().x - ui.px(_REMOVE) - 2 * ui.px(6)) / 2
    imgui.set_next_item_width(width)
    step = (high - low) / 500
    words = f"value {value_form(volume)}"
    changed, value = imgui.drag_float("##value", now, step, low, high, words, _CLAMP)
    ui.note("part value", f"{kind} {index + 1} of {len(parts)}. Double-click to type")
    if changed:
        new = transfer_edits.move_point(new, index, value, parts[index].opacity)
    imgui.same_line()
    new = draw_opacity(new, ui, index, width)
    imgui.same_line()
    return draw_remove(new, ui, index, f"Remove the {kind.lower()}")


def draw_opacity(
    state: ViewState, ui: UiContext, index: int, width: float, form: str = "opacity %.3f"
) -> ViewState:
    """Draw the slider for a part's opacity, with the number in a format."""
    now = list_parts(state.transfer)[index].opacity
    imgui.set_next_item_width(width)
    changed, opacity = imgui.slider_float("##opacity", now, 0.0, 1.0, form, _FINE)
    ui.note("part opacity", "Double-click or Ctrl+click to type")
    return transfer_edits.set_opacity(state, index, opacity) if changed else state


def draw_remove(state: ViewState, ui: UiContext, index: int, text: str) -> ViewState:
    """Draw the small button that removes a part."""
    pressed = draw_cross(ui)
    ui.note("remove part", text)
    return transfer_edits.remove_point(state, index) if pressed else state


def draw_cross(ui: UiContext) -> bool:
    """Draw the small button that removes; return True if pressed."""
    imgui.push_style_color(imgui.Col_.button, (0.0, 0.0, 0.0, 0.0))
    pressed = imgui.button("×", (ui.px(_REMOVE), 0))
    imgui.pop_style_color()
    return bool(pressed)


def draw_material(state: ViewState, ui: UiContext, index: int) -> ViewState:
    """Draw the search for a material, and the list: a click picks one alone, sliders mix.

    A click on a colour picks another one for its material; of a mix, the one with most weight.
    """
    mix = list_parts(state.transfer)[index].mix
    new = _colour_button(state, ui, max(mix, key=mix.__getitem__), part_colours(state)[index])
    imgui.same_line(0, ui.px(4))
    imgui.set_next_item_width(-1.0)
    imgui.set_next_window_size_constraints((ui.px(300), 0), (ui.px(420), ui.px(420)))
    if not imgui.begin_combo("##material", mix_text(mix), imgui.ComboFlags_.height_largest):
        ui.note("material", "Material: one, a mix, or another one from the library")
        return new
    new = _material_list(new, ui, index)
    imgui.end_combo()
    return new


def _colour_button(state: ViewState, ui: UiContext, name: str, colour: Colour) -> ViewState:
    """Draw a colour that a click changes: of a material, under the light."""
    x, y = imgui.get_cursor_screen_pos()
    swatch(ui, colour)
    imgui.set_cursor_screen_pos((x, y))
    side = imgui.get_frame_height()
    imgui.push_id(f"colour of {name}")
    if imgui.invisible_button("##pick", (side, side)):
        imgui.open_popup("picker")
    ui.note(f"swatch {name}", f"{LIT}\nClick to give {as_one_line(name)} another colour")
    new = state
    if imgui.begin_popup("picker"):
        new = palette_editor.draw_material_colour(state, ui, name)
        imgui.end_popup()
    imgui.pop_id()
    return new


def draw_part_swatch(state: ViewState, ui: UiContext, index: int) -> ViewState:
    """Draw a part's colour, and on a click the list of materials."""
    x, y = imgui.get_cursor_screen_pos()
    swatch(ui, part_colours(state)[index])
    imgui.set_cursor_screen_pos((x, y))
    side = imgui.get_frame_height()
    if imgui.invisible_button("##colour", (side, side)):
        imgui.open_popup("materials")
    mix = list_parts(state.transfer)[index].mix
    ui.note(f"colour {index}", f"{mix_text(mix)}\nClick for another material")
    imgui.set_next_window_size_constraints((ui.px(300), 0), (ui.px(420), ui.px(420)))
    if not imgui.begin_popup("materials"):
        return state
    new = _material_list(state, ui, index)
    imgui.end_popup()
    return new


def _material_list(state: ViewState, ui: UiContext, index: int) -> ViewState:
    """Draw the search for a material and the list of those there are, in a popup."""
    mix = list_parts(state.transfer)[index].mix
    new = draw_library(state, ui, index)
    if not ui.library.search.strip():
        lone = sum(weight > 0 for weight in mix.values()) < 2
        for name, colour in material_colours(state).items():
            imgui.push_id(name)
            new = _colour_button(new, ui, name, colour)
            new = _material_row(new, ui, index, name, mix.get(name, 0.0), lone)
            imgui.pop_id()
    return new


def _material_row(
    state: ViewState, ui: UiContext, index: int, name: str, weight: float, lone: bool
) -> ViewState:
    """Draw a material's name, its weight in a part's mix, and the button that removes it."""
    new = state
    imgui.same_line(0, ui.px(6))
    imgui.align_text_to_frame_padding()
    flags = imgui.SelectableFlags_.no_auto_close_popups
    label = f"{shorten(name, ui.px(_NAME))}###{name}"
    if imgui.selectable(label, weight > 0, flags, (ui.px(_NAME), 0))[0]:
        new = transfer_edits.set_material(new, index, name)
    ui.note(f"material {name}", f"Only {name}")
    imgui.same_line()
    imgui.set_next_item_width(-ui.px(_REMOVE) - imgui.get_style().item_spacing.x)
    # The weight of a single material cannot change.
    imgui.begin_disabled(lone and weight > 0)
    changed, weight = imgui.slider_float("##share", weight, 0.0, 1.0, "%.2f", _CLAMP)
    imgui.end_disabled()
    ui.note(f"share {name}")
    if changed:
        new = transfer_edits.set_material_weight(new, index, name, weight)
    imgui.same_line()
    why = uses_of_material(new.transfer, name, new.meshes, other_functions(new))
    imgui.begin_disabled(bool(why))
    pressed = draw_cross(ui)
    imgui.end_disabled()
    ui.note(f"take out {name}")
    free = f"Remove {as_one_line(name)}: no part is made of it"
    tip(why[:1].upper() + why[1:] or free, greyed=True)
    return materials.remove_material(new, name) if pressed else new


def mix_text(mix: Mapping[str, float]) -> str:
    """Return a mix as text.

    >>> mix_text({"steel": 0.7, "gold": 0.3, "iron": 0.0}), mix_text({"steel": 1.0})
    ('70 % steel, 30 % gold', 'steel')
    """
    parts = sorted(((weight, name) for name, weight in mix.items() if weight > 0), reverse=True)
    if len(parts) == 1 and parts[0][0] > 0.995:
        return parts[0][1]
    return ", ".join(f"{100 * weight:.0f} % {name}" for weight, name in parts)
