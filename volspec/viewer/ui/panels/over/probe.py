"""What is under the mouse: value, place, colour, and its spectrum beside the light's."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.lights.look import fill, outline
from volspec.viewer.ui.panels.widgets import text_width
from volspec.viewer.work.picture.reading import Reading

_FLAGS = (
    imgui.WindowFlags_.no_decoration
    | imgui.WindowFlags_.no_inputs
    | imgui.WindowFlags_.no_docking
    | imgui.WindowFlags_.always_auto_resize
    | imgui.WindowFlags_.no_focus_on_appearing
    | imgui.WindowFlags_.no_nav
)
_SIZE = (196.0, 74.0)
_HEADROOM = 1.06


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it over the picture's lower left corner."""
    reading = ui.results.under_mouse
    if reading is None or not state.interface.probe:
        return None
    x, y, _, height = ui.areas["picture"]
    corner = x + ui.px(12), y + height - ui.px(12)
    imgui.set_next_window_pos(corner, imgui.Cond_.always, (0.0, 1.0))
    imgui.set_next_window_bg_alpha(0.82)
    imgui.push_style_var(imgui.StyleVar_.window_rounding, ui.px(5))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(3)))
    if imgui.begin("##probe", None, _FLAGS)[0]:
        widest = max(text_width(name) for name, _ in reading.rows)
        label = widest + ui.px(14) + imgui.get_style().window_padding.x
        for name, value in reading.rows:
            imgui.text_disabled(name)
            imgui.same_line(label)
            imgui.text(value)
        _spectra(reading, ui)
    imgui.end()
    imgui.pop_style_var(2)
    return None


def _spectra(reading: Reading, ui: UiContext) -> None:
    """The light as a line, what comes back filled with its colours."""
    x, y = imgui.get_cursor_screen_pos()
    width, height = (ui.px(side) for side in _SIZE)
    imgui.dummy((width, height))
    rect = x, y + ui.px(4), width, height - ui.px(4)
    draw_list = imgui.get_window_draw_list()
    fill(draw_list, rect, reading.reflected, _HEADROOM, reading.grid)
    text = imgui.get_color_u32(imgui.Col_.text)
    outline(draw_list, rect, reading.light, _HEADROOM, text, ui.px(1.2))
