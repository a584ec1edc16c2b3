"""The viewing panel: the observer in the scene, the display, exposure and mode."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from volspec.appearance.deficiency import VISION
from volspec.appearance.display import GAMUTS, PRESETS, Display
from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.appearance.spec import ADAPTING, MODELS, PER_PIXEL, SURROUNDS, Viewing
from volspec.basis import MODES
from volspec.relight.spec import LEVELS
from volspec.spectra import Spectrum
from volspec.viewer.model import viewing as edits
from volspec.viewer.model.light_rows import Rows, facing_light
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import white_from_rig
from volspec.viewer.ui.widgets import describe_field, focus_if_wanted, pick

if TYPE_CHECKING:
    from volspec.scene.room import SceneRoom

SetText = Callable[[ViewState, str], ViewState]
SetNumber = Callable[[ViewState, float], ViewState]
_LUX = (edits.LEAST_LUX, 100_000.0)
_LUMINANCE = (0.01, 20_000.0)
_WHITE = (1.0, 4000.0)
_LABELS = 92
_LOG = imgui.SliderFlags_.logarithmic
_OWN = "own numbers"
_ADAPTING = {"given": "as set below", "picture": "by the picture", "pixel": "by each pixel"}
SETTINGS = (
    "Illuminance",
    "Background",
    "Surround",
    "Adaptation",
    "Room",
    "Space",
    "White",
    "Gamut",
    "Vision",
    "Exposure",
    "Backdrop",
)
"""Labels of the items that `UiContext.item` can focus."""


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    imgui.push_item_width(-ui.px(_LABELS))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (ui.px(8), ui.px(4)))
    new = _eye(state, ui)
    new = _level(new, ui)
    new = _adaptation(new, ui)
    imgui.text_disabled(white_text(state.lights, state.room))
    tip("White of a perfect diffuser in this light")
    imgui.separator_text("Display")
    new = _display(new, ui)
    imgui.separator_text("Picture")
    new = _picture(new, ui)
    imgui.pop_style_var()
    imgui.pop_item_width()
    return None if new is state else new


def matching_preset(display: Display) -> str:
    """Return the name of the preset that has a display's conditions."""
    for name, each in PRESETS.items():
        if each.display(display.space, display.gamut) == replace(display, mark=False):
            return name
    return _OWN


def white_text(lights: Rows, room: SceneRoom | None = None) -> str:
    """Return the adopted white as text.

    >>> white_text(())
    'Adopted white: none'
    """
    rig = facing_light(lights, room)
    if rig is None:
        return "Adopted white: none"
    X, Y, Z = white_from_rig(rig).tolist()
    total = max(X + Y + Z, 1e-12)
    return f"Adopted white: x {X / total:.4f}, y {Y / total:.4f}"


def _eye(state: ViewState, ui: UiContext) -> ViewState:
    new = _combo(state, ui, edits.set_model, "Model", state.relight.viewing.model, MODELS)
    ui.note("model")
    viewing = new.relight.viewing
    measurable = ADAPTING if viewing.model in PER_PIXEL else ADAPTING[:2]
    titles = {_ADAPTING[each]: each for each in measurable}
    picked = pick("Adapting", _ADAPTING[viewing.adapting], titles)
    tip("What the eye adapts to is set below, or measured in the picture or around each pixel")
    return new if picked is None else edits.set_adapting(new, titles[picked])


def _level(state: ViewState, ui: UiContext) -> ViewState:
    """Draw L_A, either given or from the light, and the background and surround."""
    viewing, rig = shown_spec(state).viewing, facing_light(state.lights, state.room)
    lux = rig.total_lux if rig is not None else None
    own = state.relight.viewing.L_A is not None
    now, greyed = lux or viewing.illuminance_lux, lux is not None or own
    new = _slider(
        state, ui, edits.set_illuminance, "Illuminance", now, _LUX, "%.4g lx", _LOG, greyed
    )
    ui.note("illuminance")
    tip("The lights' own lux are used" if lux else "For lights without lux of their own")
    now, text = edits.luminance(rig, shown_spec(new).viewing), "adapts to %.4g cd/m²"
    new = _slider(new, ui, edits.set_luminance, "##L_A", now, _LUMINANCE, text, _LOG, not own)
    imgui.same_line()
    pressed, _ = imgui.checkbox("set", own)
    tip("Set the adapting luminance L_A; otherwise it follows from light and background")
    if pressed:
        new = edits.toggle_own_luminance(new)
    limits = 1.0, 100.0
    new = _slider(new, ui, edits.set_background, "Background", viewing.Y_b, limits, "%.0f %%")
    tip("Luminance factor Y_b of the background, in per cent of white")
    surround = _surround_text(viewing.surround)
    new = _combo(new, ui, edits.set_surround, "Surround", surround, edits.SCENE_SURROUNDS)
    tip("measured: by the light of what is 11 to 90 degrees from the picture's centre")
    white = viewing.adopted_white
    shown = white if isinstance(white, str) else "X {:.4g}  Y {:.4g}  Z {:.4g}".format(*white)
    new = _combo(new, ui, edits.set_adopted_white, "Adapts to", shown, edits.ADOPTED_WHITES)
    tip(
        "The adopted white. light: of a surface that faces every source;\n"
        "scene: of what the picture shows"
    )
    return new


def _adaptation(state: ViewState, ui: UiContext) -> ViewState:
    viewing = state.relight.viewing
    D, limits = 1.0 if viewing.discount else viewing.D, (-0.01, 1.0)
    now, text = (-0.01, "automatic") if D is None else (D, "%.2f")
    new = _slider(
        state, ui, edits.set_adaptation, "Adaptation", now, limits, text, disabled=viewing.discount
    )
    tip("Degree of adaptation D, 0 to 1; automatic: the model's own, at the slider's left end")
    pressed, _ = imgui.checkbox("Discount the light's colour", viewing.discount)
    return edits.toggle_discount(new) if pressed else new


def _display(state: ViewState, ui: UiContext) -> ViewState:
    display = state.relight.viewing.display
    new = _combo(state, ui, edits.set_room, "Room", matching_preset(display), PRESETS)
    ui.note("room")
    space = display.space.name if isinstance(display.space, ColourSpace) else str(display.space)
    new = _combo(new, ui, edits.set_space, "Space", space, SPACES)
    white = display.white_cd_m2
    new = _slider(new, ui, edits.set_white, "White", white, _WHITE, "%.4g cd/m²", _LOG)
    surround = _surround_text(display.surround)
    new = _combo(new, ui, edits.set_display_surround, "Surround##display", surround, SURROUNDS)
    new = _combo(new, ui, edits.set_gamut, "Gamut", display.gamut, GAMUTS)
    pressed, _ = imgui.checkbox("Mark colours out of gamut", display.mark)
    return _vision(ui.run(new, "mark") if pressed else new, ui)


def _vision(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the colour-vision deficiency that is simulated, and its severity."""
    viewing = state.relight.viewing
    focus_if_wanted("Vision", ui)
    picked = pick("Vision", VISION[viewing.deficiency], VISION.values())
    tip(describe_field(Viewing, "deficiency"))
    names = {title: name for name, title in VISION.items()}
    new = state if picked is None else edits.set_deficiency(state, names[picked])
    if viewing.deficiency == "none":
        return new
    limits = 0.0, 1.0
    new = _slider(new, ui, edits.set_severity, "Severity", viewing.severity, limits, "%.2f")
    tip(describe_field(Viewing, "severity"))
    return new


def _picture(state: ViewState, ui: UiContext) -> ViewState:
    spec, limits = state.relight, edits.EXPOSURE_RANGE
    exposure = spec.viewing.exposure
    new = _slider(state, ui, edits.set_exposure, "Exposure", exposure, limits, "× %.2f", _LOG)
    ui.note("exposure")
    if not isinstance(spec.backdrop, Spectrum):
        new = _slider(new, ui, edits.set_backdrop, "Backdrop", spec.backdrop, (0.0, 1.0), "%.2f")
    new = _combo(new, ui, edits.set_filter, "Filter", spec.filter or edits.NO_FILTER, edits.FILTERS)
    tip("In the eye's path, in nm: it keeps out a laser, so that what it excites is seen")
    new = _combo(new, ui, edits.set_mode, "Mode", spec.mode, MODES)
    tip("fitted: a matrix for each light; componentwise: channel by channel. E shows the error")
    new = _combo(new, ui, edits.set_level, "Level", spec.level, LEVELS)
    tip("relative: white stays white; absolute: by the lights' lux")
    return new


def _combo(
    state: ViewState, ui: UiContext, change: SetText, label: str, now: str, names: Iterable[str]
) -> ViewState:
    focus_if_wanted(label, ui)
    key = pick(label, now, names)
    return state if key is None else change(state, key)


def _slider(
    state: ViewState,
    ui: UiContext,
    change: SetNumber,
    label: str,
    now: float,
    limits: tuple[float, float],
    text: str,
    flags: int = 0,
    disabled: bool = False,
) -> ViewState:
    focus_if_wanted(label, ui)
    imgui.begin_disabled(disabled)
    moved, value = imgui.slider_float(label, now, *limits, text, flags)
    imgui.end_disabled()
    return change(state, value) if moved else state


def _surround_text(surround: str | float) -> str:
    return surround if isinstance(surround, str) else f"{surround:.3g}"
