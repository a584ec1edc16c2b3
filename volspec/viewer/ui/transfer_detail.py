"""The chosen part in numbers: values, opacity, and its mix of materials."""

from __future__ import annotations

from collections.abc import Mapping

from imgui_bundle import imgui

from volspec.viewer.model import materials, presets, transfer_edits
from volspec.viewer.model.materials import uses_of_material
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts
from volspec.viewer.ui import transfer_library
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_plot import material_colours, part_colours, swatch
from volspec.viewer.ui.widgets import as_one_line, shorten, tip

_CLAMP = imgui.SliderFlags_.always_clamp
# Opacities are small: the slider is finer there.
_FINE = imgui.SliderFlags_.logarithmic | _CLAMP
# The widths of a button that removes, and of a material's name; pixels at 96 dpi.
_REMOVE, _NAME = 24, 110


def chosen_part(state: ViewState) -> int:
    """Return the index of the part whose details are shown."""
    return min(max(state.interface.part, 0), len(list_parts(state.transfer)) - 1)


def height_above(lines: int, ui: UiContext, least: float = 115, below: float = 0.0) -> float:
    """Return the panel's height above some lines of details and ``below`` pixels."""
    room = imgui.get_content_region_avail().y - lines * imgui.get_frame_height_with_spacing()
    return max(room - below, ui.px(least))


def draw_value(state: ViewState, ui: UiContext, what: str) -> ViewState:
    """Draw the chosen part's value and opacity and the button that removes it in one line."""
    index, parts, new = chosen_part(state), list_parts(state.transfer), state
    now, (low, high) = parts[index].values[0], presets.value_span(state.document.volume)
    wide = (imgui.get_content_region_avail().x - ui.px(_REMOVE) - 2 * ui.px(6)) / 2
    imgui.set_next_item_width(wide)
    step = (high - low) / 500
    moved, value = imgui.drag_float("##value", now, step, low, high, "value %.5g", _CLAMP)
    ui.note("part value")
    tip(f"{what} {index + 1} of {len(parts)}. Double-click to type")
    if moved:
        new = transfer_edits.move_point(new, index, value, parts[index].opacity)
    imgui.same_line()
    new = draw_opacity(new, ui, index, wide)
    imgui.same_line()
    return draw_remove(new, ui, index, f"Remove the {what.lower()}")


def draw_opacity(state: ViewState, ui: UiContext, index: int, wide: float) -> ViewState:
    """Draw the slider of a part's opacity."""
    now = list_parts(state.transfer)[index].opacity
    imgui.set_next_item_width(wide)
    moved, given = imgui.slider_float("##opacity", now, 0.0, 1.0, "opacity %.3f", _FINE)
    ui.note("part opacity")
    tip("Double-click or Ctrl+click to type")
    return transfer_edits.set_opacity(state, index, given) if moved else state


def draw_remove(state: ViewState, ui: UiContext, index: int, text: str) -> ViewState:
    """Draw the small button that removes a part."""
    pressed = _cross(ui)
    ui.note("remove part")
    tip(text)
    return transfer_edits.remove_point(state, index) if pressed else state


def _cross(ui: UiContext) -> bool:
    imgui.push_style_color(imgui.Col_.button, (0.0, 0.0, 0.0, 0.0))
    pressed = imgui.button("×", (ui.px(_REMOVE), 0))
    imgui.pop_style_color()
    return bool(pressed)


def draw_material(state: ViewState, ui: UiContext, index: int) -> ViewState:
    """Draw the search for a material, and the list: a click takes one alone, sliders mix."""
    mix = list_parts(state.transfer)[index].mix
    swatch(ui, part_colours(state)[index])
    imgui.same_line(0, ui.px(4))
    imgui.set_next_item_width(-1.0)
    imgui.set_next_window_size_constraints((ui.px(300), 0), (ui.px(420), ui.px(420)))
    if not imgui.begin_combo("##material", mix_text(mix), imgui.ComboFlags_.height_largest):
        ui.note("material")
        tip("Material: one, a mix, or another one from the library")
        return state
    new = transfer_library.draw(state, ui, index)
    if not ui.library.search.strip():
        lone = sum(weight > 0 for weight in mix.values()) < 2
        for name, colour in material_colours(state).items():
            imgui.push_id(name)
            swatch(ui, colour)
            new = _material_row(new, ui, index, name, mix.get(name, 0.0), lone)
            imgui.pop_id()
    imgui.end_combo()
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
    ui.note(f"material {name}")
    tip(f"Only {name}")
    imgui.same_line()
    imgui.set_next_item_width(-ui.px(_REMOVE) - imgui.get_style().item_spacing.x)
    # The weight of a single material cannot change.
    imgui.begin_disabled(lone and weight > 0)
    moved, weight = imgui.slider_float("##share", weight, 0.0, 1.0, "%.2f", _CLAMP)
    imgui.end_disabled()
    ui.note(f"share {name}")
    if moved:
        new = transfer_edits.set_material_weight(new, index, name, weight)
    imgui.same_line()
    why = uses_of_material(new.transfer, name)
    imgui.begin_disabled(bool(why))
    pressed = _cross(ui)
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
    parts = sorted(((share, name) for name, share in mix.items() if share > 0), reverse=True)
    if len(parts) == 1 and parts[0][0] > 0.995:
        return parts[0][1]
    return ", ".join(f"{100 * share:.0f} % {name}" for share, name in parts)
