"""The lights: a row each, and under them the dial, the chosen light, its spectrum, saved states."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.actions import BY_NAME
from volspec.viewer.model.lights.lighting import rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.desk import Desk
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


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw the panel."""
    line = imgui.get_frame_height() + 2 * imgui.get_style().cell_padding.y
    whole = imgui.get_content_region_avail().y
    room = whole - max(desk.px(_LEAST_TABS), _TABS_SHARE * whole) - desk.px(_BUTTONS)
    height = whole_rows(len(state.lights), room / line) * line + desk.px(2)
    new = rows.draw(state, desk, height)
    new = _buttons(new, desk)
    if imgui.begin_tab_bar("light tabs"):
        for name in TABS:
            wanted = desk.lights.to_tab == name
            flags = imgui.TabItemFlags_.set_selected if wanted else imgui.TabItemFlags_.none
            opened, _ = imgui.begin_tab_item(name, None, flags)
            desk.note(f"tab {name}")
            if opened:
                desk.lights.tab = name
                if wanted:
                    desk.lights.to_tab = ""
                new = _tab(name, new, desk)
                imgui.end_tab_item()
        imgui.end_tab_bar()
    return None if new is state else new


def whole_rows(count: int, room: float) -> int:
    """How many of the rows are seen at once where so many fit; none of them in part.

    >>> whole_rows(5, 4.6), whole_rows(5, 8.0), whole_rows(5, 1.2)
    (4, 5, 3)
    """
    return min(count, max(int(room), _LEAST_ROWS))


def _tab(name: str, state: ViewState, desk: Desk) -> ViewState:
    least = desk.px(_LEAST_TABS) - 1.5 * imgui.get_frame_height_with_spacing()
    height = max(imgui.get_content_region_avail().y, least)
    if name == "Dial":
        return _dial(state, desk, height)
    if name == "Spectrum":
        return spectrum.draw_pen(state, desk, height)
    new = state
    if imgui.begin_child(f"tab {name}", (0, height)):
        new = detail.draw(state, desk) if name == "Light" else states.draw(state, desk)
    imgui.end_child()
    return new


def _dial(state: ViewState, desk: Desk, height: float) -> ViewState:
    width = imgui.get_content_region_avail().x
    gap = imgui.get_style().item_spacing.x
    if height > desk.px(_TALL):
        new = dial.draw(state, desk, width, height * 0.62)
        spectrum.draw_mix(new, desk, width, height * 0.38 - gap)
        return new
    share = min(max(dial.width_for(state, desk, height), width * 0.6), width - desk.px(_LEAST_MIX))
    new = dial.draw(state, desk, share, height)
    imgui.same_line()
    spectrum.draw_mix(new, desk, width - share - gap, height)
    return new


def _buttons(state: ViewState, desk: Desk) -> ViewState:
    if imgui.button("Add"):
        library.open_popup(desk)
    desk.note("add light")
    tip("A light from the library, from a file, or a mix")
    new = library.draw(state, desk)
    one = len(state.lights) < 2
    new = _action(new, desk, "remove-light", "Remove", "Takes the chosen light off the list", one)
    dark = rig_of(state.lights) is None
    new = _action(new, desk, "keep-mix", "Keep mix", "The present mix as a light of its own", dark)
    new = _action(new, desk, "compare", "A | B", "These lights beside others, with a divide")
    if state.other is not None:
        new = _action(new, desk, "swap", "Swap", "The lights of both sides change places")
    return new


def _action(
    state: ViewState, desk: Desk, name: str, title: str, what: str, disabled: bool = False
) -> ViewState:
    """A button for an action, beside the last one; lit where it is on."""
    action = BY_NAME[name]
    imgui.same_line(0, desk.px(6))
    on = action.on is not None and action.on(state)
    imgui.begin_disabled(disabled)
    pressed = lit_button(title, on, state.interface.dark)
    imgui.end_disabled()
    desk.note(f"button {name}")
    key = key_text(action)
    tip(f"{what} ({key})" if key else what)
    return desk.done(state, action) if pressed else state
