"""The bar of time steps below the picture: play, loop, a slider.

state -> [time_bar] -> requests
"""

from __future__ import annotations

import os

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.overlays import BARE_WINDOW
from volspec.viewer.ui.widgets import as_one_line

_WIDEST, _FROM_LOW = 420.0, 14.0
# The fraction of the picture that the slider takes at most, so that the probe has room.
_SHARE = 0.3
_FLAGS = BARE_WINDOW | imgui.WindowFlags_.always_auto_resize


def draw(state: ViewState, ui: UiContext) -> None:
    """Draw the bar over the picture's lower edge, if there are several time steps."""
    series = state.document.series
    ui.time_bar = 0.0
    if series is None:
        return
    x, y, width, height = ui.areas["picture"]
    place = x + width / 2, y + height - ui.px(_FROM_LOW)
    imgui.set_next_window_pos(place, imgui.Cond_.always, (0.5, 1.0))
    imgui.set_next_window_bg_alpha(0.82)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(5))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(3)))
    if imgui.begin("##time", None, _FLAGS)[0]:
        playing, loops = ui.results.playing
        if imgui.button("Pause" if playing else "Play", (ui.px(56), 0)):
            ui.request("play")
        ui.note("time play")
        tip("Play the time steps (J)")
        imgui.same_line()
        imgui.set_next_item_width(min(ui.px(_WIDEST), _SHARE * width))
        count = len(series)
        flags = imgui.SliderFlags_.always_clamp
        current, text = ui.results.step + 1, f"%d of {count}"  # also while it is read
        changed, step = imgui.slider_int("##step", current, 1, count, text, flags)
        ui.note("time step")
        name = as_one_line(os.path.basename(series.names[ui.results.step]))
        tip(f"{name}\nTime step (comma, full stop)")
        if changed:
            ui.request("step", str(step - 1))
        imgui.same_line()
        if imgui.checkbox("Loop", loops)[0]:
            ui.request("loop")
        ui.note("time loop")
        ui.time_bar = imgui.get_window_height() + ui.px(_FROM_LOW)
    imgui.end()
    imgui.pop_style_var(2)
