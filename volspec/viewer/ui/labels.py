"""The list of a segmentation's labels: eye, colour, name, opacity of each."""

from __future__ import annotations

from itertools import chain, count

from imgui_bundle import imgui

from volspec.transfer import LabelFunction
from volspec.viewer.model import labels, transfer_edits
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import transfer_detail
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import draw_eye, lit_button, shorten, shown_rows

# The least height of the list; pixels at 96 dpi.
_MIN = 100
# A search is offered for more labels than these.
_FEW = 12
_FLAGS = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.scroll_y


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the buttons for all labels, the search, and the list."""
    function = state.transfer
    assert isinstance(function, LabelFunction)
    new = _head(state, ui, function)
    matches = labels.matching_labels(function, ui.labels_search)
    height = transfer_detail.height_above(1, ui, _MIN)
    if imgui.begin_table("labels", 4, _FLAGS, (0, height)):
        fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
        imgui.table_setup_column("eye", fixed, ui.px(50))
        imgui.table_setup_column("colour", fixed, ui.px(24))
        imgui.table_setup_column("name", stretch, 0.55)
        imgui.table_setup_column("opacity", stretch, 0.45)
        keys = list(function.labels)
        for row in shown_rows(len(matches)):
            index = matches[row]
            imgui.push_id(index)
            imgui.table_next_row()
            # After an edit, the numbers of the rows may have changed.
            new = _row(new, ui, function, index, keys[index]) if new is state else new
            imgui.pop_id()
        imgui.end_table()
    if not matches:
        imgui.text_disabled("No matches")
        return new
    if imgui.button("Add label"):
        candidates = chain(sorted(state.document.volume.labels), count(1))
        unlisted = next(label for label in candidates if label not in function.labels)
        new = transfer_edits.add_point(new, unlisted, 0.5)
    ui.note("add label", "Adds the lowest number of the volume's that is not listed, or a new one")
    return new


def _head(state: ViewState, ui: UiContext, function: LabelFunction) -> ViewState:
    """Draw the buttons that show or hide all, and the search."""
    new = state
    visible_count = len(function.labels) - len(function.hidden)
    if draw_eye(ui, visible_count > 0, "eye of all"):
        new = ui.run(new, "labels-hide" if visible_count else "labels-show")
    ui.note("all labels", "Hide all labels" if visible_count else "Show all labels")
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    imgui.text_disabled(f"{visible_count} of {len(function.labels)} shown")
    if len(function.labels) <= _FEW:
        ui.labels_search = ""
        return new
    imgui.same_line()
    imgui.set_next_item_width(-1)
    _, ui.labels_search = imgui.input_text_with_hint("##search", "Search", ui.labels_search)
    ui.note("search labels", "Part of a name, or a number")
    return new


def _row(
    state: ViewState, ui: UiContext, function: LabelFunction, index: int, label: int
) -> ViewState:
    new, visible = state, label not in function.hidden
    imgui.table_next_column()
    if draw_eye(ui, visible, "eye"):
        new = labels.toggle_label(new, label)
    ui.note(f"eye {label}", "Hide" if visible else "Show")
    imgui.same_line(0, ui.px(2))
    alone = visible and len(function.hidden) == len(function.labels) - 1
    side = imgui.get_frame_height()
    if lit_button("S", alone and len(function.labels) > 1, state.interface.dark, (side, side)):
        new = labels.show_only(new, label)
    ui.note(f"only {label}", "Show all again" if alone else "Show only this label")
    imgui.table_next_column()
    new = transfer_detail.draw_part_swatch(new, ui, index)
    imgui.table_next_column()
    imgui.align_text_to_frame_padding()
    title = labels.label_title(function, label)
    colour = imgui.Col_.text if visible else imgui.Col_.text_disabled
    imgui.push_style_color(imgui.Col_.text, imgui.get_style_color_vec4(colour))
    is_chosen = transfer_detail.chosen_part(state) == index
    words = shorten(title, imgui.get_content_region_avail().x)
    if imgui.selectable(f"{words}###name", is_chosen)[0]:
        new = transfer_edits.choose_part(new, index)
    imgui.pop_style_color()
    ui.note(f"name {label}", title)
    if imgui.begin_popup_context_item("label menu"):
        if imgui.selectable("Show only this label", False)[0]:
            new = labels.show_only(new, label)
        if imgui.selectable("Remove from the list; it becomes transparent", False)[0]:
            new = transfer_edits.remove_point(new, index)
        imgui.end_popup()
    imgui.table_next_column()
    if new is state:
        new = transfer_detail.draw_opacity(new, ui, index, -1, "%.3f")
        ui.note(f"label {label}")
    return new
