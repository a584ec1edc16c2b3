"""The transfer function: presets, shift, thickness, and the editor of its kind."""

from __future__ import annotations

from dataclasses import replace

from imgui_bundle import imgui

from volspec.transfer import LabelFunction, TransferFunction2D
from volspec.viewer import bands, presets
from volspec.viewer.actions import BY_NAME
from volspec.viewer.events import Event, reduced
from volspec.viewer.events.curve import KIND_TITLES, THICKNESSES
from volspec.viewer.panels.desk import Desk
from volspec.viewer.panels.transfer import labels, points, regions
from volspec.viewer.panels.transfer.detail import tip
from volspec.viewer.state import ViewState
from volspec.viewer.style import ACCENT

_HELP: dict[bands.Kind, str] = {
    "points": "Drag the points. Double-click adds one, a right click removes it.\n"
    "The upright axis is opacity per step; it is drawn as its square root.",
    "regions": "Drag a rectangle, its edges and corners.\n"
    "A double-click beside them adds one, a right click removes it.\n"
    "Behind: how often values and gradients come together.",
    "surfaces": "Drag the surfaces to other values and opacities.\n"
    "Double-click adds one, a right click removes it.",
}
_LOG = imgui.SliderFlags_.logarithmic


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw the panel."""
    new = state
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (desk.px(6), desk.px(5)))
    if not isinstance(new.transfer, LabelFunction):
        new = _kinds(new, desk)
    new = _sliders(new, desk)
    if isinstance(new.transfer, LabelFunction):
        new = labels.draw(new, desk)
    elif isinstance(new.transfer, TransferFunction2D):
        new = regions.draw(new, desk)
    else:
        new = points.draw(new, desk)
    imgui.pop_style_var()
    return None if new is state else new


def _kinds(state: ViewState, desk: Desk) -> ViewState:
    """Presets, what is edited, and the histogram's scale."""
    new = state
    room = imgui.get_content_region_avail().x - desk.px(70)
    imgui.set_next_item_width(room * 0.5)
    title = presets.picked(state.transfer)
    if imgui.begin_combo("##preset", title or "Presets", imgui.ComboFlags_.height_largest):
        for preset in presets.offered(state.document.volume):
            change = BY_NAME[f"preset-{preset.name}"].change
            if imgui.selectable(preset.title, preset.title == title)[0] and change is not None:
                new = change(new)
            desk.note(f"preset {preset.name}")
        imgui.end_combo()
    desk.note("presets")
    tip("Begin anew with a named look and its materials; Ctrl+Z brings yours back")
    imgui.same_line()
    imgui.set_next_item_width(room * 0.5 - desk.px(6))
    kind = bands.kind_of(state.transfer)
    if imgui.begin_combo("##kind", KIND_TITLES[kind]):
        for other, name in KIND_TITLES.items():
            change = BY_NAME[f"transfer-{other}"].change
            if imgui.selectable(name, other == kind)[0] and change is not None:
                new = change(new)
            desk.note(f"kind {other}")
        imgui.end_combo()
    desk.note("kind")
    tip(
        "How a place looks follows from its value, from its value and gradient,\n"
        "or from surfaces of one value. Another kind keeps no filters of materials and no opacity\n"
        "over gradients of a curve, and back to it brings none; Ctrl+Z does"
    )
    imgui.same_line()
    on = state.interface.logarithmic
    if on:
        imgui.push_style_color(imgui.Col_.text, ACCENT[state.interface.dark])
    if imgui.button("log", (desk.px(40), 0)):
        new = replace(new, interface=replace(new.interface, logarithmic=not on))
    if on:
        imgui.pop_style_color()
    desk.note("log")
    tip("Logarithmic histogram")
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    imgui.text_disabled("?")
    if imgui.is_item_hovered():
        imgui.set_tooltip(_HELP[kind])
    return new


def _sliders(state: ViewState, desk: Desk) -> ViewState:
    new = state
    wide = imgui.get_content_region_avail().x
    if not isinstance(state.transfer, LabelFunction):
        low, high = presets.span(state.document.volume)
        half = (high - low) / 2
        wide = (wide - desk.px(6)) / 2
        imgui.set_next_item_width(wide)
        moved, shift = imgui.slider_float("##shift", state.shift, -half, half, "shift %.4g")
        desk.note("shift")
        tip("Moves all values. In the picture: Ctrl+drag sideways; up and down spreads them")
        if moved:
            new = reduced(new, Event("shift", shift))
        imgui.same_line()
    imgui.set_next_item_width(wide)
    moved, factor = imgui.slider_float(
        "##thickness", state.thickness, *THICKNESSES, "opacity × %.3g", _LOG
    )
    desk.note("thickness")
    tip("Multiplies all opacities, great ones near 1. In the picture: Ctrl+right drag")
    return reduced(new, Event("thicken", factor)) if moved else new
