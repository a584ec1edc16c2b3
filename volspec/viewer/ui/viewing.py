"""The viewing panel: the observer in the scene, the display, exposure and mode."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from imgui_bundle import imgui

from volspec.appearance import ADAPTING, PER_PIXEL, Viewing
from volspec.appearance.display import PRESETS, SPACES, VISION, ColourSpace, Display
from volspec.spectra import Spectrum
from volspec.viewer.model import viewing as edits
from volspec.viewer.model.light_rows import Rows, facing_light
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.form import Form, FormField, draw_field, draw_fields, list_fields
from volspec.viewer.ui.light_look import white_from_rig
from volspec.viewer.ui.widgets import focus_if_wanted, pick

if TYPE_CHECKING:
    from volspec.scene import SceneRoom

_LABELS = 92
_OWN = "own numbers"
_VIEWING = Form(lambda state: state.relight.viewing, edits.set_viewing)
_SHOWN = Form(lambda state: shown_spec(state).viewing, edits.set_viewing)
_DISPLAY = Form(lambda state: state.relight.viewing.display, edits.set_display)
_RELIGHT = Form(lambda state: state.relight, edits.set_relight)
_TITLES = {"given": "as set below", "picture": "by the picture", "pixel": "by each pixel"}
_ADAPTING = FormField("adapting", "Adapting", titles=_TITLES)
_LUX = FormField("illuminance_lux", "Illuminance", (0.1, 100_000.0), is_logarithmic=True)
_LUMINANCE = FormField(
    "L_A", "##L_A", (0.01, 20_000.0), "adapts to %.4g cd/m²", is_logarithmic=True
)
_SCENE = (
    FormField("Y_b", "Background", (1.0, 100.0), "%.0f %%"),
    FormField("surround", "Surround"),
    FormField("adopted_white", "Adapts to"),
)
_DEGREE = FormField("D", "Adaptation", (-0.01, 1.0), none="automatic")
_SPACE = FormField("space", "Space")
_SCREEN = (
    FormField("white_cd_m2", "White", (1.0, 4000.0), is_logarithmic=True),
    FormField("surround", "Surround##display"),
    FormField("gamut", "Gamut"),
    FormField("mark", "Mark colours out of gamut"),
)
_VISION = FormField("deficiency", "Vision", titles=VISION)
_MODEL, _SEVERITY = FormField("model", "Model"), FormField("severity", "Severity")
_ANGLE = FormField("fov_deg", "Angle", (0.1, 170.0), none="the camera's")
_DISCOUNT = FormField("discount", "Discount the light's colour")
_EXPOSURE = FormField("exposure", "Exposure", (0.1, 10.0), "× %.2f", is_logarithmic=True)
_BACKDROP = FormField("backdrop", "Backdrop")
_FILTER = FormField("filter", "Filter", none=edits.NO_FILTER)
_PLACED = (_MODEL, _ADAPTING, _LUX, _LUMINANCE, *_SCENE, _DEGREE, _DISCOUNT, _VISION, _SEVERITY)
_OTHERS = list_fields(Viewing, *(field.name for field in (*_PLACED, _ANGLE, _EXPOSURE)))
SETTINGS = (
    *("Illuminance", "Background", "Surround", "Adaptation", "Room", "Space", "White", "Gamut"),
    *("Vision", "Exposure", *(field.label for field in _OTHERS), "Backdrop"),
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
    for name, preset in PRESETS.items():
        if preset.display(display.space, display.gamut) == replace(display, mark=False):
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
    new = draw_field(state, ui, _VIEWING, _MODEL)
    measurable = ADAPTING if new.relight.viewing.model in PER_PIXEL else ADAPTING[:2]
    return draw_field(new, ui, _VIEWING, _ADAPTING, names=measurable)


def _level(state: ViewState, ui: UiContext) -> ViewState:
    """Draw L_A, either given or from the light, and the background and surround."""
    viewing, rig = shown_spec(state).viewing, facing_light(state.lights, state.room)
    lux = rig.total_lux if rig is not None else None
    is_set = state.relight.viewing.L_A is not None
    now, greyed = lux or viewing.illuminance_lux, lux is not None or is_set
    new = draw_field(state, ui, _VIEWING, _LUX, now=now, disabled=greyed)
    now = edits.luminance(rig, shown_spec(new).viewing)
    new = draw_field(new, ui, _VIEWING, _LUMINANCE, now=now, disabled=not is_set)
    imgui.same_line()
    pressed, _ = imgui.checkbox("set", is_set)
    tip("Set the adapting luminance L_A; otherwise it follows from light and background")
    if pressed:
        new = edits.toggle_own_luminance(new)
    angle = [_ANGLE] if new.relight.viewing.is_measured else []
    return draw_fields(new, ui, _SHOWN, *_SCENE, *angle)


def _adaptation(state: ViewState, ui: UiContext) -> ViewState:
    discount = state.relight.viewing.discount
    now = 1.0 if discount else None
    new = draw_field(state, ui, _VIEWING, _DEGREE, now=now, disabled=discount)
    return draw_field(new, ui, _VIEWING, _DISCOUNT)


def _display(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the display, and the deficiency that is simulated."""
    display, new = state.relight.viewing.display, state
    focus_if_wanted("Room", ui)
    room = pick("Room", matching_preset(display), PRESETS)
    ui.note("room")
    if room is not None:
        new = edits.set_display(new, "preset", room)
    space = display.space.name if isinstance(display.space, ColourSpace) else str(display.space)
    new = draw_field(new, ui, _DISPLAY, _SPACE, now=space, names=SPACES)
    new = draw_fields(new, ui, _DISPLAY, *_SCREEN)
    new = draw_field(new, ui, _VIEWING, _VISION)
    if new.relight.viewing.deficiency == "none":
        return new
    return draw_field(new, ui, _VIEWING, _SEVERITY)


def _picture(state: ViewState, ui: UiContext) -> ViewState:
    new = draw_fields(state, ui, _VIEWING, _EXPOSURE, *_OTHERS)
    if not isinstance(new.relight.backdrop, Spectrum):
        new = draw_field(new, ui, _RELIGHT, _BACKDROP)
    new = draw_field(new, ui, _RELIGHT, _FILTER, names=edits.FILTERS)
    return draw_fields(new, ui, _RELIGHT, FormField("mode", "Mode"), FormField("level", "Level"))
