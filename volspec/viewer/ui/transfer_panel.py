"""The transfer function's panel: preset, kind, shift and thickness, and the kind's editor."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.transfer import LabelFunction, TransferFunction2D, presets
from volspec.viewer.model import fields, transfer_convert, transfer_edits
from volspec.viewer.model.edit import with_interface
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_edits import KIND_TITLES, THICKNESSES
from volspec.viewer.model.transfer_parts import Kind
from volspec.viewer.ui import fields as field_list
from volspec.viewer.ui import labels, transfer_editors
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.widgets import ACCENT, pick

_HELP: dict[Kind, str] = {
    "points": "Drag the points. Double-click adds one, a right click removes it.\n"
    "The vertical axis is opacity per step, on a square-root scale.",
    "regions": "Drag a rectangle, or its edges or corners.\n"
    "A double-click elsewhere adds one, a right click removes it.\n"
    "Background: the joint histogram of values and gradients.",
    "surfaces": "Drag the surfaces to other values and opacities.\n"
    "Double-click adds one, a right click removes it.",
    "labels": "Eyes show and hide labels, S shows one alone.\n"
    "A click on a colour changes the material, a right click on a name removes the label.",
}
_KIND_TIP = (
    "Material and opacity by value, by value and gradient, as isosurfaces, or by label.\n"
    "A message lists the parts that another kind cannot represent;\n"
    "Ctrl+Z restores them"
)
_LOG = imgui.SliderFlags_.logarithmic


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the panel."""
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(6), ui.px(5)))
    new = field_list.draw(state, ui)
    new = _sliders(_kinds(new, ui), ui)
    if isinstance(new.transfer, LabelFunction):
        new = labels.draw(new, ui)
    elif isinstance(new.transfer, TransferFunction2D):
        new = transfer_editors.draw_regions(new, ui)
    else:
        new = transfer_editors.draw_points(new, ui)
    imgui.pop_style_var()
    return new


def _kinds(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the lists of presets and kinds, and the button of the histogram's scale."""
    room = imgui.get_content_region_avail().x - ui.px(70)
    imgui.set_next_item_width(room * 0.5)
    offered = presets.sorted_presets(fields.data(state).volume)
    preset = presets.preset_of(state.transfer)
    title = preset.title if preset else "Presets"
    new = _pick(state, ui, "preset", title, {p.title: f"preset-{p.name}" for p in offered})
    ui.note("presets", "Start from a preset and its materials; Ctrl+Z restores yours")
    imgui.same_line()
    imgui.set_next_item_width(room * 0.5 - ui.px(6))
    kind = transfer_convert.transfer_kind(state.transfer)
    kinds = {title: f"transfer-{name}" for name, title in KIND_TITLES.items()}
    new = _pick(new, ui, "kind", KIND_TITLES[kind], kinds)
    ui.note("kind", _KIND_TIP)
    imgui.same_line()
    on = state.interface.logarithmic
    if on:
        imgui.push_style_color(imgui.Col_.text, ACCENT[state.interface.dark])
    if imgui.button("log", (ui.px(40), 0)):
        new = with_interface(new, logarithmic=not on)
    if on:
        imgui.pop_style_color()
    ui.note("log", "Logarithmic histogram")
    imgui.same_line()
    imgui.align_text_to_frame_padding()
    imgui.text_disabled("?")
    tip(_HELP[kind], at_once=True)
    return new


def _pick(state: ViewState, ui: UiContext, menu: str, now: str, names: dict[str, str]) -> ViewState:
    """Draw a list of commands, given as {title: name}, and run the one that is picked."""

    def note(title: str) -> None:
        ui.note(f"{menu} {names[title].partition('-')[2]}")

    picked = pick(f"##{menu}", now, names, note)
    return state if picked is None else ui.run(state, names[picked])


def _sliders(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the sliders of shift and thickness; labels have no values to shift."""
    new = state
    width = imgui.get_content_region_avail().x
    if not isinstance(state.transfer, LabelFunction):
        low, high = presets.value_span(fields.data(state).volume)
        half = (high - low) / 2
        width = (width - ui.px(6)) / 2
        imgui.set_next_item_width(width)
        changed, shift = imgui.slider_float("##shift", state.shift, -half, half, "shift %.4g")
        ui.note("shift")
        tip("Moves all values. In the picture: Ctrl+drag sideways; up and down spreads them")
        if changed:
            new = transfer_edits.shift(new, shift)
        imgui.same_line()
    imgui.set_next_item_width(width)
    now, words = state.thickness, "opacity × %.3g"
    changed, factor = imgui.slider_float("##thickness", now, *THICKNESSES, words, _LOG)
    ui.note("thickness", "Scales the density of all parts. In the picture: Ctrl+right drag")
    return transfer_edits.thicken(new, factor) if changed else new
