"""The list of meshes: show, name, material, opacity and removal of each; the place of one."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui

from volspec.scene.tables import MeshSpec
from volspec.viewer.model import meshes
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_detail import draw_cross
from volspec.viewer.ui.widgets import as_one_line, describe_field, pick, shorten, shown_rows

# Lines under the list: the button, a title, unit, place and turn.
_LINES = 5
# The list scrolls if it is longer, and there is no room for more.
_MIN_ROWS = 4
_FLAGS = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.scroll_y


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
    index, new = meshes.chosen_mesh(state), state
    row = state.meshes[index]
    imgui.separator_text(f"Place of {as_one_line(row.name)}")
    size, unit = ("unit_mm", "1 unit = %.5g mm") if row.shape is None else ("size_mm", "%.5g mm")
    now = getattr(row, size)
    imgui.set_next_item_width(-1)
    edited, mm = imgui.drag_float("##unit", now, 0.01 * now, *meshes.UNITS_MM, unit)
    ui.note("mesh unit", describe_field(MeshSpec, size))
    if edited:
        new = meshes.scale(new, index, mm)
    step = float(np.ptp(state.document.volume.corners_mm, axis=0).max()) / 500.0
    for key, change, speed, text in (
        ("move_mm", meshes.move, step, "%.5g mm"),
        ("turn_deg", meshes.turn, 0.5, "%.4g°"),
    ):
        before = list(getattr(row, key))
        imgui.set_next_item_width(-1)
        edited, after = imgui.drag_float3(f"##{key}", before, speed, 0.0, 0.0, text)
        ui.note(f"mesh {key}", f"x, y, z. {describe_field(MeshSpec, key)} Double-click to type")
        for axis in range(3):
            if edited and after[axis] != before[axis]:
                new = change(new, index, axis, after[axis])
    changed, cut = imgui.checkbox("Cut with the volume", row.cut)
    ui.note("mesh cut", describe_field(MeshSpec, "cut"))
    return meshes.set_cut(new, index, cut) if changed else new


def _row(state: ViewState, ui: UiContext, index: int, row: MeshSpec) -> ViewState:
    new = state
    imgui.table_next_column()
    changed, visible = imgui.checkbox("##shown", row.shown)
    ui.note(f"mesh shown {index}", "Show; hidden meshes cast no shadow")
    if changed:
        new = meshes.set_shown(new, index, visible)
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
    clamped = imgui.SliderFlags_.always_clamp
    low = meshes.MIN_OPACITY
    edited, opacity = imgui.slider_float("##opacity", row.opacity, low, 1.0, "%.2f", clamped)
    ui.note(f"mesh opacity {index}", describe_field(MeshSpec, "opacity"))
    if edited:
        new = meshes.set_opacity(new, index, opacity)
    imgui.table_next_column()
    if draw_cross(ui):
        new = meshes.remove(new, index)
    ui.note(f"remove mesh {index}", "Remove from the scene")
    return new
