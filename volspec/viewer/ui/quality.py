"""The quality panel: projection, steps and jitter of a cast, and detail of its shadows."""

from __future__ import annotations

from functools import partial

from imgui_bundle import imgui

from volspec.raycast import RaycastSpec
from volspec.raycast.quality import TARGETS
from volspec.raycast.spec import MODES
from volspec.viewer.model import quality
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.widgets import describe_field, focus_if_wanted, lit_button, setting_slider

_LABELS = 104
_LOG = imgui.SliderFlags_.logarithmic
SETTINGS = (
    "Projection",
    "Step",
    "Jitter",
    "Adaptive",
    "Light cells",
    "Alpha stop",
    "First opacity",
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
    flipped, _ = imgui.checkbox("Physical", new.shading.physical_light)
    ui.note("physical light", _about("physical_light"))
    new = quality.toggle_physical_light(new) if flipped else new
    imgui.begin_disabled(new.shading.physical_light)
    focus_if_wanted("Light cells", ui)
    moved, cells = imgui.slider_int(
        "Light cells", new.shading.light_cells, *quality.LIGHT_CELLS, "%d", _LOG
    )
    ui.note("light cells", _about("light_cells"))
    new = quality.set_light_cells(new, cells) if moved else new
    imgui.end_disabled()
    imgui.separator_text("Limits")
    new = _limits(new, ui)
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
    picked, at = imgui.combo("Level", now, names)
    ui.note("level", _about("level"))
    return quality.set_level(state, at - 1) if picked else state


def _about(field: str) -> str:
    return describe_field(RaycastSpec, field)


def _projection(state: ViewState, ui: UiContext) -> ViewState:
    focus_if_wanted("Projection", ui)
    names = [_TITLES.get(mode, mode) for mode in MODES]
    imgui.begin_disabled(not quality.can_project(state))
    now = MODES.index(quality.cast_spec(state).mode)
    picked, at = imgui.combo("Projection", now, names)
    imgui.end_disabled()
    ui.note("projection", _about("mode"), greyed=True)
    new = ui.edited(state, partial(quality.project, mode=MODES[at])) if picked else state
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
    spec, new = state.shading, state
    focus_if_wanted("Step", ui)
    text = "%.2f voxels" if spec.step_mm else "by quality"
    moved, voxels = imgui.slider_float(
        "Step", quality.step_voxels(state), *quality.STEPS, text, _LOG
    )
    ui.note("step", _about("step_mm"))
    if moved:
        new = quality.set_step(new, voxels)
    new = setting_slider(new, ui, quality.set_jitter, "Jitter", spec, (0.0, 1.0))
    imgui.begin_disabled(not quality.can_project(state))
    pressed, _ = imgui.checkbox("Pre-integration", quality.cast_spec(state).preintegrated)
    imgui.end_disabled()
    ui.note("pre-integration", _about("preintegrated"), greyed=True)
    if pressed:
        new = ui.edited(new, quality.toggle_preintegration)
    return setting_slider(new, ui, quality.set_adaptive, "Adaptive", spec, (0.0, 0.2), "%.3f", _LOG)


def _limits(state: ViewState, ui: UiContext) -> ViewState:
    spec = state.shading
    focus_if_wanted("Alpha stop", ui)
    text = "%.4f" if spec.alpha_stop else "by quality"
    moved, stop = imgui.slider_float("Alpha stop", 1.0 - spec.least_transmittance, 0.5, 1.0, text)
    ui.note("alpha stop", _about("alpha_stop"))
    new = quality.set_alpha_stop(state, stop) if moved else state
    limits = 0.001, 1.0
    new = setting_slider(new, ui, quality.set_first_opacity, "First opacity", spec, limits)
    focus_if_wanted("Seed", ui)
    moved, seed = imgui.input_int("Seed", spec.seed)
    ui.note("seed", _about("seed"))
    new = quality.set_seed(new, seed) if moved else new
    pressed, _ = imgui.checkbox("Half precision", spec.half)
    ui.note("half", _about("half"))
    return quality.toggle_half(new) if pressed else new
