"""The list of a volume's fields: show, solo, name and weight of each."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from imgui_bundle import imgui

from volspec.viewer.model import fields, transfer_edits, transfer_parts
from volspec.viewer.model.document import FieldLook
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.form import Form, FormField, draw_field
from volspec.viewer.ui.quality import CAST
from volspec.viewer.ui.widgets import as_one_line, lit_button, shorten, text_width
from volspec.volume import value_form

_FLAGS = imgui.TableFlags_.sizing_fixed_fit
_ADDS = FormField("add_fields", "Add light", key="add fields")
_WEIGHT = FormField("weight", "##weight", fields.WEIGHTS, "× %.2f", is_logarithmic=True)


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
    return _limits(draw_field(new, ui, CAST, _ADDS), ui)


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
    form = Form(lambda state: state.fields[number], partial(fields.set_look, number=number))
    side = imgui.get_frame_height()
    imgui.table_next_column()
    new = draw_field(state, ui, form, FormField("shown", "##shown", key=f"field shown {number}"))
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
    return draw_field(new, ui, form, replace(_WEIGHT, key=f"field weight {number}"))
