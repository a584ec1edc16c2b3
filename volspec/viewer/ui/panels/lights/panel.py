"""The lights: a row each, and under them the dial, the chosen light, its spectrum, saved states."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.actions import BY_NAME
from volspec.viewer.model.lights.lighting import rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights import detail, dial, library, rows, spectrum, states
from volspec.viewer.ui.panels.widgets import key_text, lit_button, tip

# Of what is under the rows, tabs included; and of the buttons.
_LEAST_TABS, _BUTTONS = 134.0, 34.0
_LEAST_ROWS = 3
# Of the panel's height, where the list is long.
_TABS_SHARE = 0.4
# Of the spectrum beside the dial.
_LEAST_MIX = 84.0
# With so much room the dial stands over its spectrum.
_TALL = 300.0
TABS = ("Dial", "Light", "Spectrum", "States")


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    whole = imgui.get_content_region_avail().y
    room = whole - max(ui.px(_LEAST_TABS), _TABS_SHARE * whole) - ui.px(_BUTTONS)
    height = whole_rows(len(state.lights), room / line) * line + ui.px(2)
    new = rows.draw(state, ui, height)
    new = _buttons(new, ui)
    if imgui.begin_tab_bar("light tabs"):
        for name in TABS:
            wanted = ui.lights.to_tab == name
            flags = imgui.TabItemFlags_.set_selected if wanted else imgui.TabItemFlags_.none
            opened, _ = imgui.begin_tab_item(name, None, flags)
            ui.note(f"tab {name}")
            if opened:
                ui.lights.tab = name
                if wanted:
                    ui.lights.to_tab = ""
                new = _tab(name, new, ui)
                imgui.end_tab_item()
        imgui.end_tab_bar()
    return None if new is state else new


def whole_rows(count: int, room: float) -> int:
    """How many of the rows are seen at once where so many fit; none of them in part.

    >>> whole_rows(5, 4.6), whole_rows(5, 8.0), whole_rows(5, 1.2)
    (4, 5, 3)
    """
    return min(count, max(int(room), _LEAST_ROWS))


def _tab(name: str, state: ViewState, ui: UiContext) -> ViewState:
    least = ui.px(_LEAST_TABS) - 1.5 * imgui.get_frame_height_with_spacing()
    height = max(imgui.get_content_region_avail().y, least)
    if name == "Dial":
        return _dial(state, ui, height)
    if name == "Spectrum":
        return spectrum.draw_pen(state, ui, height)
    new = state
    if imgui.begin_child(f"tab {name}", (0, height)):
        new = detail.draw(state, ui) if name == "Light" else states.draw(state, ui)
    imgui.end_child()
    return new


def _dial(state: ViewState, ui: UiContext, height: float) -> ViewState:
    width = imgui.get_content_region_avail().x
    gap = imgui.get_style().item_spacing.x
    if height > ui.px(_TALL):
        new = dial.draw(state, ui, width, height * 0.62)
        spectrum.draw_mix(new, ui, width, height * 0.38 - gap)
        return new
    share = min(max(dial.width_for(state, ui, height), width * 0.6), width - ui.px(_LEAST_MIX))
    new = dial.draw(state, ui, share, height)
    imgui.same_line()
    spectrum.draw_mix(new, ui, width - share - gap, height)
    return new


def _buttons(state: ViewState, ui: UiContext) -> ViewState:
    if imgui.button("Add"):
        library.open_popup(ui)
    ui.note("add light")
    tip("A light from the library, from a file, or a mix")
    new = library.draw(state, ui)
    one = len(state.lights) < 2
    new = _action(new, ui, "remove-light", "Remove", "Takes the chosen light off the list", one)
    dark = rig_of(state.lights) is None
    new = _action(new, ui, "keep-mix", "Keep mix", "The present mix as a light of its own", dark)
    new = _action(new, ui, "compare", "A | B", "These lights beside others, with a divide")
    if state.other is not None:
        new = _action(new, ui, "swap", "Swap", "The lights of both sides change places")
    return new


def _action(
    state: ViewState, ui: UiContext, name: str, title: str, what: str, disabled: bool = False
) -> ViewState:
    """A button for an action, beside the last one; lit where it is on."""
    action = BY_NAME[name]
    imgui.same_line(0, ui.px(6))
    on = action.on is not None and action.on(state)
    imgui.begin_disabled(disabled)
    pressed = lit_button(title, on, state.interface.dark)
    imgui.end_disabled()
    ui.note(f"button {name}")
    key = key_text(action)
    tip(f"{what} ({key})" if key else what)
    return ui.done(state, action) if pressed else state
