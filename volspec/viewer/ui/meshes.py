"""The list of meshes: show, name, material, opacity and removal of each; the place of one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
from imgui_bundle import imgui

from volspec.scene.tables import MeshSpec
from volspec.viewer.model import meshes
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.form import Form, FormField, draw_field, draw_fields
from volspec.viewer.ui.transfer_detail import draw_cross
from volspec.viewer.ui.widgets import as_one_line, pick, shorten, shown_rows

# Lines under the list: the button, a title, unit, place and turn.
_LINES = 5
# The list scrolls if it is longer, and there is no room for more.
_MIN_ROWS = 4
_FLAGS = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.scroll_y
_SHOWN = FormField("shown", "##shown", tip="Show; hidden meshes cast no shadow")
_XYZ = "x, y, z. {} Double-click to type"
_LIMITS, _ANY = meshes.LIMITS, (0.0, 0.0)
_OPACITY = FormField("opacity", "##opacity", _LIMITS["opacity"])
_MOVE = FormField("move_mm", "##move", _LIMITS["move_mm"], "%.5g mm", key="mesh move_mm", tip=_XYZ)
_TURN = FormField("turn_deg", "##turn", _ANY, "%.4g°", speed=0.5, key="mesh turn_deg", tip=_XYZ)
_UNIT = FormField("unit_mm", "##unit", _LIMITS["unit_mm"], "1 unit = %.5g mm", key="mesh unit")
_SIZE = replace(_UNIT, name="size_mm", text="%.5g mm")
_CUT = FormField("cut", "Cut with the volume", key="mesh cut")


def _form(index: int) -> Form:
    """Return the settings of a mesh."""
    return Form(lambda state: state.meshes[index], partial(meshes.set_mesh, index=index))


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    new = state
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    below = (_LINES if state.meshes else 1) * imgui.get_frame_height_with_spacing()
    room = imgui.get_content_region_avail().y - below
    count = len(state.meshes)
    height = line * max(min(count, room / line), min(max(count, 1), _MIN_ROWS))
    if not imgui.begin_table("meshes", 5, _FLAGS, (0, height)):
        return None
    fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
    imgui.table_setup_column("show", fixed, imgui.get_frame_height())
    imgui.table_setup_column("name", stretch, 0.36)
    imgui.table_setup_column("material", stretch, 0.36)
    imgui.table_setup_column("opacity", stretch, 0.28)
    imgui.table_setup_column("remove", fixed, imgui.get_frame_height())
    for index in shown_rows(len(state.meshes)):
        imgui.push_id(index)
        imgui.table_next_row()
        # After a removal, the numbers of the rows are others.
        new = _row(new, ui, index, state.meshes[index]) if new is state else new
        imgui.pop_id()
    imgui.end_table()
    if imgui.button("Add …"):
        new = ui.run(new, "add-mesh")
    ui.note("add mesh", "PLY, OBJ, STL, VTP or glTF; or drop it onto the window")
    if new.meshes:
        new = _place(new, ui)
    return None if new is state else new


def _place(state: ViewState, ui: UiContext) -> ViewState:
    """Draw unit, place and turn of the chosen mesh."""
    index = meshes.chosen_mesh(state)
    row = state.meshes[index]
    imgui.separator_text(f"Place of {as_one_line(row.name)}")
    size = _UNIT if row.shape is None else _SIZE
    size = replace(size, speed=0.01 * getattr(row, size.name))
    step = float(np.ptp(state.document.volume.corners_mm, axis=0).max()) / 500.0
    imgui.push_item_width(-1)
    new = draw_fields(state, ui, _form(index), size, replace(_MOVE, speed=step), _TURN, _CUT)
    imgui.pop_item_width()
    return new


def _row(state: ViewState, ui: UiContext, index: int, row: MeshSpec) -> ViewState:
    imgui.table_next_column()
    new = draw_field(state, ui, _form(index), replace(_SHOWN, key=f"mesh shown {index}"))
    imgui.table_next_column()
    imgui.align_text_to_frame_padding()
    colour = imgui.Col_.text if row.shown else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    is_chosen = index == meshes.chosen_mesh(state)
    name = shorten(row.name, imgui.get_content_region_avail().x)
    pressed, _ = imgui.selectable(f"{name}##name", is_chosen)
    imgui.pop_style_color()
    ui.note(f"mesh name {index}", f"{as_one_line(row.file or row.name)}\nClick for its place")
    if pressed:
        new = meshes.choose(new, index)
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    look = meshes.look_text(row)
    picked = pick("##material", look, state.transfer.materials)
    ui.note(f"mesh material {index}", f"{as_one_line(look)}\nClick for another material")
    if picked is not None:
        new = meshes.set_material(new, index, picked)
    imgui.table_next_column()
    imgui.set_next_item_width(-1)
    new = draw_field(new, ui, _form(index), replace(_OPACITY, key=f"mesh opacity {index}"))
    imgui.table_next_column()
    if draw_cross(ui):
        new = meshes.remove(new, index)
    ui.note(f"remove mesh {index}", "Remove from the scene")
    return new
