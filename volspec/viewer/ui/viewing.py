"""The viewing's panel: the eye in the scene, the display, and how the picture is made."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from imgui_bundle import imgui

from volspec.appearance.display import GAMUTS, Display
from volspec.appearance.presets import PRESETS
from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.appearance.spec import ADAPTING, MODELS, PER_PIXEL, SURROUNDS
from volspec.basis import MODES
from volspec.relight.spec import LEVELS
from volspec.spectra import Spectrum
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.light_rows import Rows, rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.viewing import (
    EXPOSURE_RANGE,
    LEAST_LUX,
    luminance,
    set_adaptation,
    set_adapting,
    set_backdrop,
    set_background,
    set_display_surround,
    set_exposure,
    set_gamut,
    set_illuminance,
    set_level,
    set_luminance,
    set_mode,
    set_model,
    set_room,
    set_space,
    set_surround,
    set_white,
    toggle_discount,
    toggle_own_luminance,
)
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import white_of
from volspec.viewer.ui.widgets import pick, tip

_LUX = (LEAST_LUX, 100_000.0)
_LUMINANCE = (0.01, 20_000.0)
_WHITE = (1.0, 4000.0)
_LABELS = 92
_LOG = imgui.SliderFlags_.logarithmic
_OWN = "own numbers"
SETTINGS = (
    *("Illuminance", "Background", "Surround", "Adaptation", "Room", "Space", "White", "Gamut"),
    *("Exposure", "Backdrop"),
)
"""Labels of what takes the keyboard by `UiContext.item`."""


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    imgui.push_item_width(-ui.px(_LABELS))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(4)))
    new = _eye(state, ui)
    new = _level(new, ui)
    new = _adaptation(new, ui)
    imgui.text_disabled(white_text(state.lights))
    tip("Of a perfect diffuser in this light, which the eye takes for white")
    imgui.separator_text("Display")
    new = _display(new, ui)
    imgui.separator_text("Picture")
    new = _picture(new, ui)
    imgui.pop_style_var()
    imgui.pop_item_width()
    return None if new is state else new


def preset_of(display: Display) -> str:
    """The preset whose conditions a display stands in; none where it has its own."""
    for name, each in PRESETS.items():
        if each.display(display.space, display.gamut) == replace(display, mark=False):
            return name
    return _OWN


def white_text(lights: Rows) -> str:
    """The adopted white in words.

    >>> white_text(())
    'Adopted white: none'
    """
    rig = rig_of(lights)
    if rig is None:
        return "Adopted white: none"
    X, Y, Z = white_of(rig).tolist()
    total = max(X + Y + Z, 1e-12)
    return f"Adopted white: x {X / total:.4f}, y {Y / total:.4f}"


def _eye(state: ViewState, ui: UiContext) -> ViewState:
    viewing = state.relight.viewing
    new = _picked(state, set_model, "Model", viewing.model, MODELS)
    ui.note("model")
    viewing = new.relight.viewing
    measurable = ADAPTING if viewing.model in PER_PIXEL else ADAPTING[:2]
    new = _picked(new, set_adapting, "Adapting", viewing.adapting, measurable)
    tip("given: the numbers below; picture, pixel: measured in what is seen")
    return new


def _level(state: ViewState, ui: UiContext) -> ViewState:
    """L_A, from the light or by itself, background and surround."""
    viewing, rig, new = state.relight.viewing, rig_of(state.lights), state
    lux = rig.total_lux if rig is not None else None
    _reach("Illuminance", ui)
    imgui.begin_disabled(lux is not None or viewing.L_A is not None)
    moved, given = imgui.slider_float(
        "Illuminance", lux or viewing.illuminance_lux, *_LUX, "%.4g lx", _LOG
    )
    ui.note("illuminance")
    imgui.end_disabled()
    tip("The lights' own lux count" if lux else "What lights without lux of their own give")
    if moved:
        new = set_illuminance(new, given)
    own = viewing.L_A is not None
    imgui.begin_disabled(not own)
    moved, L_A = imgui.slider_float(
        "##L_A", luminance(rig, new.relight.viewing), *_LUMINANCE, "L_A %.4g cd/m²", _LOG
    )
    imgui.end_disabled()
    if moved:
        new = set_luminance(new, L_A)
    imgui.same_line()
    pressed, _ = imgui.checkbox("own L_A", own)
    tip("Luminance that the eye adapts to; else it follows from light and background")
    if pressed:
        new = toggle_own_luminance(new)
    _reach("Background", ui)
    moved, Y_b = imgui.slider_float("Background", viewing.Y_b, 1.0, 100.0, "Y_b %.0f %%")
    if moved:
        new = set_background(new, Y_b)
    _reach("Surround", ui)
    return _picked(new, set_surround, "Surround", _surround_text(viewing.surround), SURROUNDS)


def _adaptation(state: ViewState, ui: UiContext) -> ViewState:
    viewing, new = state.relight.viewing, state
    imgui.begin_disabled(viewing.discount)
    share = 1.0 if viewing.discount else viewing.D
    _reach("Adaptation", ui)
    text = "model's D" if viewing.D is None and not viewing.discount else "D %.2f"
    moved, D = imgui.slider_float("Adaptation", -0.01 if share is None else share, -0.01, 1.0, text)
    imgui.end_disabled()
    if moved:
        new = set_adaptation(new, D)
    pressed, _ = imgui.checkbox("Discount the light's colour", viewing.discount)
    return toggle_discount(new) if pressed else new


def _display(state: ViewState, ui: UiContext) -> ViewState:
    display = state.relight.viewing.display
    _reach("Room", ui)
    new = _picked(state, set_room, "Room", preset_of(display), PRESETS)
    ui.note("room")
    space = display.space.name if isinstance(display.space, ColourSpace) else str(display.space)
    _reach("Space", ui)
    new = _picked(new, set_space, "Space", space, SPACES)
    _reach("White", ui)
    moved, white = imgui.slider_float("White", display.white_cd_m2, *_WHITE, "%.4g cd/m²", _LOG)
    if moved:
        new = set_white(new, white)
    surround = _surround_text(display.surround)
    new = _picked(new, set_display_surround, "Surround##display", surround, SURROUNDS)
    _reach("Gamut", ui)
    new = _picked(new, set_gamut, "Gamut", display.gamut, GAMUTS)
    pressed, _ = imgui.checkbox("Mark what it cannot show", display.mark)
    return ui.run(new, BY_NAME["mark"]) if pressed else new


def _picture(state: ViewState, ui: UiContext) -> ViewState:
    spec, new = state.relight, state
    _reach("Exposure", ui)
    moved, exposure = imgui.slider_float(
        "Exposure", spec.viewing.exposure, *EXPOSURE_RANGE, "× %.2f", _LOG
    )
    ui.note("exposure")
    if moved:
        new = set_exposure(new, exposure)
    if not isinstance(spec.backdrop, Spectrum):
        _reach("Backdrop", ui)
        moved, backdrop = imgui.slider_float("Backdrop", spec.backdrop, 0.0, 1.0, "%.2f")
        if moved:
            new = set_backdrop(new, backdrop)
    new = _picked(new, set_mode, "Mode", spec.mode, MODES)
    tip("componentwise: channel by channel; exact: the light matrix. E shows the difference")
    new = _picked(new, set_level, "Level", spec.level, LEVELS)
    tip("relative: white stays white; absolute: by the lights' lux")
    return new


def _picked(
    state: ViewState,
    change: Callable[[ViewState, str], ViewState],
    label: str,
    now: str,
    names: Iterable[str],
) -> ViewState:
    """A list of settings; the state after what was picked."""
    key = pick(label, now, names)
    return state if key is None else change(state, key)


def _reach(name: str, ui: UiContext) -> None:
    """The next item takes the keyboard where it was asked for, and is scrolled to."""
    if ui.item == name:
        ui.item = ""
        imgui.set_keyboard_focus_here()


def _surround_text(surround: str | float) -> str:
    return surround if isinstance(surround, str) else f"{surround:g}"
