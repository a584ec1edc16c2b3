"""The opacity panel: an eye, the colour and a slider for each material."""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.viewer.model import depth, opacities
from volspec.viewer.model.quality import can_layer, opacity_scales
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.transfer_plot import LIT, material_colours, swatch
from volspec.viewer.ui.widgets import as_one_line, draw_eye, lit_button, shorten, wrap_text

_FLAGS = imgui.TableFlags_.sizing_fixed_fit
_SLIDER = imgui.SliderFlags_.logarithmic | imgui.SliderFlags_.always_clamp
_CLAMPED = imgui.SliderFlags_.always_clamp
_HELP = (
    "Scales of the optical depth: 0 hides a material, 2 is twice as much of it. "
    "Double-click or Ctrl+click to type."
)
_BY_CASTS = (
    "Each change is a new cast here: layers show up to four materials of one curve, and opaque "
    "meshes."
)


def draw(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the panel; while it is visible, the picture is cast with layers."""
    new, names = state, opacities.names(state)
    if not names:
        wrap_text(opacities.NEEDED, imgui.Col_.text_disabled)
        return state
    ui.layers_wanted = can_layer(state)
    if imgui.begin_table("opacities", 4, _FLAGS):
        fixed, stretch = imgui.TableColumnFlags_.width_fixed, imgui.TableColumnFlags_.width_stretch
        imgui.table_setup_column("eye", fixed, ui.px(50))
        imgui.table_setup_column("colour", fixed, imgui.get_frame_height())
        imgui.table_setup_column("name", stretch, 0.4)
        imgui.table_setup_column("opacity", stretch, 0.6)
        colours = material_colours(state)
        for name in names:
            imgui.push_id(name)
            imgui.table_next_row()
            imgui.table_next_column()
            new = _buttons(new, ui, name)
            imgui.table_next_column()
            swatch(ui, colours[name])
            ui.note(f"opacity colour {name}", LIT)
            imgui.table_next_column()
            imgui.align_text_to_frame_padding()
            imgui.text(shorten(name, imgui.get_content_region_avail().x))
            ui.note(f"opacity name {name}", as_one_line(name))
            imgui.table_next_column()
            new = _slider(new, ui, name)
            imgui.pop_id()
        imgui.end_table()
    imgui.begin_disabled(not opacity_scales(state))
    if imgui.button("Reset"):
        new = opacities.reset(new)
    imgui.end_disabled()
    ui.note("opacities reset", "All materials as in the transfer function")
    if depth.can_be_set(state):
        new = _depth(new, ui)
    wrap_text(_HELP if ui.layers_wanted else f"{_HELP} {_BY_CASTS}", imgui.Col_.text_disabled)
    return new


def _depth(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the cuts by distance, the fog and the focus."""
    new, now = state, state.depth
    min_mm, max_mm = depth.limits_mm(state)
    if not min_mm < max_mm:
        return state
    imgui.separator_text("Depth")
    near, far = max(now.near_mm, min_mm), max_mm if now.far_mm is None else now.far_mm
    for name, label, value in (("nearer", "Near", near), ("farther", "Far", far)):
        edited, mm = imgui.slider_float(label, value, min_mm, max_mm, "%.4g mm", _CLAMPED)
        ui.note(f"depth {label.lower()}", f"Nothing {name} is shown; distance from the camera")
        if edited:
            new = depth.set_cut(new, *((mm, far) if label == "Near" else (near, mm)))
    edited, times = imgui.slider_float("Fog", depth.fog(state), 0.0, depth.MAX_FOG, "%.2f", _SLIDER)
    ui.note("depth fog", "Depth of the volume over the visibility in fog; 0 for none")
    if edited:
        new = depth.set_fog(new, times)
    if depth.can_focus(state):
        new = _focus(new, ui, (min_mm, max_mm))
    imgui.begin_disabled(not now.changes)
    if imgui.button("Reset##depth"):
        new = depth.reset(new)
    imgui.end_disabled()
    ui.note("depth reset", "Everything, in focus and without fog")
    return new


def _focus(state: ViewState, ui: UiContext, limits: tuple[float, float]) -> ViewState:
    """Draw the lens, which is shown once nothing moves."""
    new, focus = state, state.depth.focus_mm
    toggled, on = imgui.checkbox("Lens", focus is not None)
    ui.note("depth lens", "Blur what is out of focus, once nothing moves")
    if toggled:
        new = depth.set_focus(new, sum(limits) / 2 if on else None)
    if focus is None:
        return new
    changed, mm = imgui.slider_float("Focus", focus, *limits, "%.4g mm", _CLAMPED)
    ui.note("depth focus", "Distance in focus from the camera; also: right-click into the picture")
    if changed:
        new = depth.set_focus(new, mm)
    lens, (low, high) = depth.aperture_mm(state), (part * focus for part in depth.APERTURES)
    changed, mm = imgui.slider_float("Opening", lens, low, high, f"f/{focus / lens:.3g}", _SLIDER)
    ui.note("depth opening", f"Diameter of the lens, {lens:.3g} mm; less is sharper")
    return depth.set_aperture(new, mm) if changed else new


def _buttons(state: ViewState, ui: UiContext, name: str) -> ViewState:
    """Draw the buttons that hide a material, and all others."""
    new, hidden = state, opacity_scales(state).get(name) == 0
    imgui.begin_disabled(not opacities.is_in_volume(state, name))
    if draw_eye(ui, not hidden, "eye"):
        new = opacities.toggle(new, name)
    imgui.end_disabled()
    ui.note(f"opacity eye {name}", "Show" if hidden else "Hide")
    imgui.same_line(0, ui.px(2))
    side = imgui.get_frame_height()
    all_others = {other: 0.0 for other in opacities.names(state) if other != name}
    alone = bool(all_others) and opacity_scales(state) == all_others
    if lit_button("S", alone, state.interface.dark, (side, side)):
        new = opacities.show_only(new, name)
    ui.note(f"opacity only {name}", "Show all again" if alone else "Show only this material")
    return new


def _slider(state: ViewState, ui: UiContext, name: str) -> ViewState:
    now, fades = opacity_scales(state).get(name, 1.0), opacities.is_in_volume(state, name)
    imgui.set_next_item_width(-1)
    imgui.begin_disabled(not fades)
    changed, scale = imgui.slider_float("##scale", now, 0.0, opacities.MAX_SCALE, "× %.3g", _SLIDER)
    imgui.end_disabled()
    words = "Opacity of {}" if fades else "{}: only meshes have it, and do not fade"
    ui.note(f"opacity {name}", words.format(as_one_line(name)))
    return opacities.set_opacity(state, name, scale) if changed else state
