"""The quality panel: projection, steps and jitter of a cast, and detail of its shadows."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from imgui_bundle import imgui

from volspec.raycast import MODES, TARGETS, RaycastSpec
from volspec.viewer.model import quality
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.form import Form, FormField, draw_field, draw_fields
from volspec.viewer.ui.widgets import describe_field, focus_if_wanted, lit_button

_LABELS = 104
CAST = Form(lambda state: state.shading, quality.set_cast)
_BY_VOXELS = Form(CAST.read, lambda state, _, voxels: quality.set_step(state, voxels))
_STEP = FormField("step_mm", "Step", quality.STEPS, "%.2f voxels", is_logarithmic=True)
_PREINTEGRATION = FormField("preintegrated", "Pre-integration")
_JITTER, _ADAPTIVE = (
    FormField("jitter", "Jitter"),
    FormField("adaptive", "Adaptive", (0.0, 0.2), "%.3f", is_logarithmic=True),
)
_CELLS = FormField("light_cells", "Light cells", (8, 512), is_logarithmic=True)
_STOP = FormField("alpha_stop", "Alpha stop", (0.5, 1.0), "%.4f")
_LIMITS = (
    FormField("first_opacity", "First opacity", (0.001, 1.0)),
    FormField("seed", "Seed", None),
    FormField("half", "Half precision"),
)
SETTINGS = (
    *("Projection", "Step", "Jitter", "Adaptive", "Light cells", "Alpha stop", "First opacity"),
    "Seed",
)
"""Labels of the items that `UiContext.item` can focus."""
_TITLES = {"maximum": "maximum (MIP)"}


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    imgui.push_item_width(-ui.px(_LABELS))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(4)))
    new = _projection(state, ui)
    new = _sampling(_presets(new, ui), ui)
    new = _level(new, ui)
    imgui.separator_text("Shadows")
    new = draw_field(new, ui, CAST, FormField("physical_light", "Physical"))
    new = draw_field(new, ui, CAST, _CELLS, disabled=new.shading.physical_light)
    imgui.separator_text("Limits")
    spec = new.shading
    stop = _STOP if spec.alpha_stop else replace(_STOP, text="by quality")
    new = draw_field(new, ui, CAST, stop, now=1.0 - spec.least_transmittance)
    new = draw_fields(new, ui, CAST, *_LIMITS)
    imgui.pop_style_var()
    imgui.pop_item_width()
    return None if new is state else new


def _level(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the choice of a level of detail, for a volume larger than memory."""
    pyramid = state.document.volume.pyramid
    if pyramid is None:
        return state
    names = ["as fine as pixels"]
    for number, level in enumerate(pyramid.levels):
        names.append(f"{number}: {' × '.join(map(str, level.shape[::-1]))}")
    now = 0 if state.shading.level is None else 1 + min(state.shading.level, len(names) - 2)
    picked, index = imgui.combo("Level", now, names)
    ui.note("level", _about("level"))
    return quality.set_cast(state, "level", index - 1 if index else None) if picked else state


def _about(field: str) -> str:
    return describe_field(RaycastSpec, field)


def _projection(state: ViewState, ui: UiContext) -> ViewState:
    focus_if_wanted("Projection", ui)
    names = [_TITLES.get(mode, mode) for mode in MODES]
    imgui.begin_disabled(not quality.can_project(state))
    now = MODES.index(quality.cast_spec(state).mode)
    picked, number = imgui.combo("Projection", now, names)
    imgui.end_disabled()
    ui.note("projection", _about("mode"), greyed=True)
    new = ui.edited(state, partial(quality.project, mode=MODES[number])) if picked else state
    if quality.wants_greys(new):
        if imgui.button("Grey ramp"):
            new = ui.run(new, "preset-grey")
        ui.note("grey ramp", "Opacity and grey by value, instead of the transfer function in use")
    return new


def _presets(state: ViewState, ui: UiContext) -> ViewState:
    new, dark, now = state, state.interface.dark, quality.quality_name(state)
    for name in quality.QUALITIES:
        if lit_button(name.capitalize(), name == now, dark):
            new = quality.set_quality(new, name)
        error = TARGETS[name].error
        ui.note(f"quality {name}", f"Steps as long as an error of {error:g} allows (RMS, white 1)")
        imgui.same_line()
    imgui.align_text_to_frame_padding()
    imgui.text("Quality")
    return new


def _sampling(state: ViewState, ui: UiContext) -> ViewState:
    step = _STEP if state.shading.step_mm else replace(_STEP, text="by quality")
    new = draw_field(state, ui, _BY_VOXELS, step, now=quality.step_voxels(state))
    new = draw_field(new, ui, CAST, _JITTER)
    form = Form(CAST.read, lambda old, *_: ui.edited(old, quality.toggle_preintegration))
    now, no = quality.cast_spec(state).preintegrated, not quality.can_project(state)
    new = draw_field(new, ui, form, _PREINTEGRATION, now=now, disabled=no)
    return draw_field(new, ui, CAST, _ADAPTIVE)
