"""The transfer function: presets, shift, thickness, and the editor of its kind."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.transfer import LabelFunction, TransferFunction2D
from volspec.viewer.model.actions import BY_NAME
from volspec.viewer.model.events import Event, reduced
from volspec.viewer.model.events.curve import KIND_TITLES, THICKNESSES
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer import converting, presets
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.transfer import labels, points, regions
from volspec.viewer.ui.panels.widgets import AT_ONCE, pick, tip
from volspec.viewer.ui.window.style import ACCENT

_HELP: dict[converting.Kind, str] = {
    "points": "Drag the points. Double-click adds one, a right click removes it.\n"
    "The upright axis is opacity per step; it is drawn as its square root.",
    "regions": "Drag a rectangle, its edges and corners.\n"
    "A double-click beside them adds one, a right click removes it.\n"
    "Behind: how often values and gradients come together.",
    "surfaces": "Drag the surfaces to other values and opacities.\n"
    "Double-click adds one, a right click removes it.",
}
_KIND_TIP = (
    "How a place looks follows from its value, from its value and gradient,\n"
    "or from surfaces of one value. What another kind has no room for is told, and\n"
    "Ctrl+Z brings it back"
)
_LOG = imgui.SliderFlags_.logarithmic


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    new = state
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(6), ui.px(5)))
    if not isinstance(new.transfer, LabelFunction):
        new = _kinds(new, ui)
    new = _sliders(new, ui)
    if isinstance(new.transfer, LabelFunction):
        new = labels.draw(new, ui)
    elif isinstance(new.transfer, TransferFunction2D):
        new = regions.draw(new, ui)
    else:
        new = points.draw(new, ui)
    imgui.pop_style_var()
    return None if new is state else new


def _kinds(state: ViewState, ui: UiContext) -> ViewState:
    """Presets, what is edited, and the histogram's scale."""
    room = imgui.get_content_region_avail().x - ui.px(70)
    imgui.set_next_item_width(room * 0.5)
    new = _presets(state, ui)
    tip("Begin anew with a named look and its materials; Ctrl+Z brings yours back")
    imgui.same_line()
    imgui.set_next_item_width(room * 0.5 - ui.px(6))
    kind = converting.kind_of(state.transfer)
    kinds = {title: other for other, title in KIND_TITLES.items()}
    chosen = pick("##kind", KIND_TITLES[kind], kinds, lambda each: ui.note(f"kind {kinds[each]}"))
    if chosen is not None:
        new = ui.done(new, BY_NAME[f"transfer-{kinds[chosen]}"])
    ui.note("kind")
    tip(_KIND_TIP)
    imgui.same_line()
    on = state.interface.logarithmic
    if on:
        imgui.push_style_color(imgui.Col_.text, ACCENT[state.interface.dark])
    if imgui.button("log", (ui.px(40), 0)):
        new = reduced(new, Event("logarithmic"))
    if on:
        imgui.pop_style_color()
    ui.note("log")
    tip("Logarithmic histogram")
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    imgui.text_disabled("?")
    tip(_HELP[kind], AT_ONCE)
    return new


def _presets(state: ViewState, ui: UiContext) -> ViewState:
    """A list of named looks; the present one, picked again, is as it was at first."""
    offered = {preset.title: preset.name for preset in presets.offered(state.document.volume)}
    title = presets.picked(state.transfer) or "Presets"
    chosen = pick("##preset", title, offered, lambda each: ui.note(f"preset {offered[each]}"))
    ui.note("presets")
    return state if chosen is None else ui.done(state, BY_NAME[f"preset-{offered[chosen]}"])


def _sliders(state: ViewState, ui: UiContext) -> ViewState:
    new = state
    wide = imgui.get_content_region_avail().x
    if not isinstance(state.transfer, LabelFunction):
        low, high = presets.span(state.document.volume)
        half = (high - low) / 2
        wide = (wide - ui.px(6)) / 2
        imgui.set_next_item_width(wide)
        moved, shift = imgui.slider_float("##shift", state.shift, -half, half, "shift %.4g")
        ui.note("shift")
        tip("Moves all values. In the picture: Ctrl+drag sideways; up and down spreads them")
        if moved:
            new = reduced(new, Event("shift", shift))
        imgui.same_line()
    imgui.set_next_item_width(wide)
    moved, factor = imgui.slider_float(
        "##thickness", state.thickness, *THICKNESSES, "opacity × %.3g", _LOG
    )
    ui.note("thickness")
    tip("Multiplies all opacities, great ones near 1. In the picture: Ctrl+right drag")
    return reduced(new, Event("thicken", factor)) if moved else new
