"""The list of meshes: show, name, material, opacity and removal of each."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.scene.specs import MeshSpec
from volspec.viewer.model import meshes
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_detail import draw_cross
from volspec.viewer.ui.widgets import as_one_line, describe_field, pick, shorten, shown_rows

_FLAGS = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.scroll_y


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    new = state
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    room = imgui.get_content_region_avail().y - imgui.get_frame_height_with_spacing()
    height = max(min(len(state.meshes) * line, room), line)
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
    return None if new is state else new


def _row(state: ViewState, ui: UiContext, index: int, row: MeshSpec) -> ViewState:
    new = state
    imgui.table_next_column()
    changed, shown = imgui.checkbox("##shown", row.shown)
    ui.note(f"mesh shown {index}", "Show; hidden meshes cast no shadow")
    if changed:
        new = meshes.set_shown(new, index, shown)
    imgui.table_next_column()
    imgui.align_text_to_frame_padding()
    colour = imgui.Col_.text if row.shown else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    imgui.text(shorten(row.name, imgui.get_content_region_avail().x))
    imgui.pop_style_color()
    ui.note(f"mesh name {index}", as_one_line(row.file or row.name))
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
    least = meshes.LEAST_OPACITY
    moved, opacity = imgui.slider_float("##opacity", row.opacity, least, 1.0, "%.2f", clamped)
    ui.note(f"mesh opacity {index}", describe_field(MeshSpec, "opacity"))
    if moved:
        new = meshes.set_opacity(new, index, opacity)
    imgui.table_next_column()
    if draw_cross(ui):
        new = meshes.remove(new, index)
    ui.note(f"remove mesh {index}", "Remove from the scene")
    return new
