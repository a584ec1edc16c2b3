"""The list of a volume's fields: show, solo, name and weight of each."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.raycast import RaycastSpec
from volspec.viewer.model import fields, transfer_edits, transfer_parts
from volspec.viewer.model.document import FieldLook
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import (
    as_one_line,
    describe_field,
    lit_button,
    shorten,
    text_width,
)
from volspec.volume import value_form

_FLAGS = imgui.TableFlags_.sizing_fixed_fit


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the list; nothing for a volume of one field."""
    if not state.fields or not imgui.begin_table("fields", 4, _FLAGS):
        return state
    new, side = state, imgui.get_frame_height()
    fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
    imgui.table_setup_column("show", fixed, side)
    imgui.table_setup_column("solo", fixed, side)
    imgui.table_setup_column("name", stretch, 0.55)
    imgui.table_setup_column("weight", stretch, 0.45)
    for number, look in enumerate(state.fields):
        imgui.push_id(number)
        imgui.table_next_row()
        new = _row(new, ui, number, look)
        imgui.pop_id()
    imgui.end_table()
    flipped, _ = imgui.checkbox("Add light", new.shading.add_fields)
    ui.note("add fields", describe_field(RaycastSpec, "add_fields"))
    new = fields.toggle_adding(new) if flipped else new
    return _limits(new, ui)


def _limits(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the contrast limits of the chosen field."""
    low, high = transfer_parts.limits(state.transfer)
    volume = fields.data(state).volume
    first, last = volume.typical_range
    step = (last - first) / 500
    form = "%.0f" if step > 0.05 else value_form(volume)
    imgui.set_next_item_width(-text_width("Limits") - imgui.get_style().item_inner_spacing.x)
    changed, low, high = imgui.drag_float_range2(
        "Limits", low, high, step, first, last, form, form, imgui.SliderFlags_.always_clamp
    )
    ui.note("field limits", "Contrast limits: the values between which the field's curve lies")
    return transfer_edits.set_limits(state, low, high) if changed else state


def _row(state: ViewState, ui: UiContext, number: int, look: FieldLook) -> ViewState:
    new, side = state, imgui.get_frame_height()
    imgui.table_next_column()
    changed, visible = imgui.checkbox("##shown", look.shown)
    ui.note(f"field shown {number}", "Show this field")
    if changed:
        new = fields.set_shown(new, number, visible)
    imgui.table_next_column()
    alone = fields.is_alone(state, number)
    if lit_button("S", alone, state.interface.dark, (side, side)):
        new = fields.solo(new, number)
    ui.note(f"field solo {number}", "Show all again" if alone else "Show only this field")
    imgui.table_next_column()
    imgui.align_text_to_frame_padding()
    colour = imgui.Col_.text if look.shown else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    name = fields.title(state, look)
    shown_name = shorten(name, imgui.get_content_region_avail().x)
    pressed, _ = imgui.selectable(f"{shown_name}##name", number == state.chosen_field)
    imgui.pop_style_color()
    ui.note(f"field name {number}", f"{as_one_line(name)}\nClick to edit its transfer function")
    if pressed:
        new = fields.choose(new, number)
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    flags = imgui.SliderFlags_.logarithmic
    edited, weight = imgui.slider_float(
        "##weight", look.weight, 0.0, fields.MAX_WEIGHT, "× %.2f", flags
    )
    ui.note(f"field weight {number}", "Factor of this field's density")
    return fields.set_weight(new, number, weight) if edited else new
