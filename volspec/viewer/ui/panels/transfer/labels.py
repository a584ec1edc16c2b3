"""The labels of a segmentation: each with its opacity and its material."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.transfer import MAX_LABEL, LabelFunction
from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.transfer import detail
from volspec.viewer.ui.panels.widgets import tip

# The list's height.
_LEAST = 100


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the list, and what adds to it."""
    function = state.transfer
    assert isinstance(function, LabelFunction)
    new = state
    flags = imgui.TableFlags_.sizing_fixed_fit | imgui.TableFlags_.scroll_y
    if imgui.begin_table("labels", 4, flags, (0, detail.height_above(1, ui, _LEAST))):
        imgui.table_setup_column("label", imgui.TableColumnFlags_.width_fixed, ui.px(34))
        imgui.table_setup_column("opacity", imgui.TableColumnFlags_.width_stretch, 0.45)
        imgui.table_setup_column("material", imgui.TableColumnFlags_.width_stretch, 0.55)
        imgui.table_setup_column("remove", imgui.TableColumnFlags_.width_fixed, ui.px(24))
        for index, label in enumerate(function.labels):
            imgui.push_id(label)
            imgui.table_next_row()
            imgui.table_next_column()
            imgui.align_text_to_frame_padding()
            imgui.text(str(label))
            imgui.table_next_column()
            new = detail.opacity(new, ui, index, -1)
            ui.note(f"label {label}")
            imgui.table_next_column()
            if new.transfer is function:  # else the numbers of the rows may have changed
                new = detail.material(new, ui, index)
            imgui.table_next_column()
            if new.transfer is function:
                new = detail.remove(new, ui, index, "Remove the label: it is not seen")
            imgui.pop_id()
        imgui.end_table()
    if imgui.button("Add label"):
        new = reduced(new, Event("add-point", next_label(function), 0.5))
    tip("The least number that is not listed")
    return new


def next_label(function: LabelFunction) -> int:
    """The least label from 1 that is not listed."""
    return next(label for label in range(1, MAX_LABEL + 2) if label not in function.labels)
