"""How the scene is looked at: the eye in the scene, the display, and how the picture is made."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from volspec.appearance.display import GAMUTS, Display
from volspec.appearance.presets import PRESETS
from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.appearance.spec import ADAPTING, MODELS, PER_PIXEL, SURROUNDS
from volspec.basis import MODES
from volspec.errors import VolspecError
from volspec.relight import RelightSpec
from volspec.relight.spec import LEVELS
from volspec.spectra import white_XYZ
from volspec.viewer.lighting import Rows, rig_of
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_LUX = (0.1, 100_000.0)
_LUMINANCE = (0.01, 20_000.0)
_WHITE = (1.0, 4000.0)
_EXPOSURE = (0.1, 10.0)
_LABELS = 92
_LOG = imgui.SliderFlags_.logarithmic
_OWN = "own numbers"
SETTINGS = (
    *("Illuminance", "Background", "Surround", "Adaptation", "Room", "Space", "White", "Gamut"),
    *("Exposure", "Backdrop"),
)
"""Labels of what takes the keyboard by `Desk.item`."""


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw the panel."""
    seen = state.seen
    imgui.push_item_width(-desk.px(_LABELS))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (desk.px(8), desk.px(4)))
    new = _eye(seen, desk)
    new = _level(new, state.lights, desk)
    new = _adaptation(new, desk)
    imgui.text_disabled(white_told(state.lights))
    _tip("Of a perfect diffuser in this light, which the eye takes for white")
    imgui.separator_text("Display")
    new = _display(new, desk)
    imgui.separator_text("Picture")
    new = _picture(new, desk)
    imgui.pop_style_var()
    imgui.pop_item_width()
    return None if new is seen else replace(state, seen=new)


def changed(seen: RelightSpec, **changes: Any) -> RelightSpec:
    """Other settings of the viewing; as they are where they do not go together."""
    try:
        return replace(seen, viewing=replace(seen.viewing, **changes))
    except VolspecError:
        return seen


def with_model(seen: RelightSpec, model: str) -> RelightSpec:
    """Another model; one that cannot adapt to each pixel measures the picture."""
    pixel = seen.viewing.adapting == "pixel" and model not in PER_PIXEL
    return changed(seen, model=model, **({"adapting": "picture"} if pixel else {}))


def preset_of(display: Display) -> str:
    """The preset whose conditions a display stands in; none where it has its own."""
    for name, each in PRESETS.items():
        if each.display(display.space, display.gamut) == replace(display, mark=False):
            return name
    return _OWN


def luminance(seen: RelightSpec, lights: Rows) -> float:
    """L_A of the scene, cd/m²: as given, or of the light that shines."""
    given = replace(seen.viewing, adapting="given")
    rig = rig_of(lights)
    if rig is not None and rig.total_lux:
        given = replace(given, illuminance_lux=rig.total_lux)
    return given.adapting_luminance


def white_told(lights: Rows) -> str:
    """The adopted white in words.

    >>> white_told(())
    'Adopted white: none'
    """
    rig = rig_of(lights)
    if rig is None:
        return "Adopted white: none"
    X, Y, Z = white_XYZ(rig.mixed(rig.lights[0].grid)).tolist()
    total = max(X + Y + Z, 1e-12)
    return f"Adopted white: x {X / total:.4f}, y {Y / total:.4f}"


def _eye(seen: RelightSpec, desk: Desk) -> RelightSpec:
    picked = _pick("Model", seen.viewing.model, MODELS)
    desk.note("model")
    if picked is not None:
        seen = with_model(seen, picked)
    measurable = ADAPTING if seen.viewing.model in PER_PIXEL else ADAPTING[:2]
    picked = _pick("Adapting", seen.viewing.adapting, measurable)
    _tip("given: the numbers below; picture, pixel: measured in what is seen")
    return seen if picked is None else changed(seen, adapting=picked)


def _level(seen: RelightSpec, lights: Rows, desk: Desk) -> RelightSpec:
    """L_A, from the light or by itself, background and surround."""
    viewing = seen.viewing
    rig = rig_of(lights)
    lux = rig.total_lux if rig is not None else None
    _reach("Illuminance", desk)
    imgui.begin_disabled(lux is not None or viewing.L_A is not None)
    moved, given = imgui.slider_float(
        "Illuminance", lux or viewing.illuminance_lux, *_LUX, "%.4g lx", _LOG
    )
    desk.note("illuminance")
    imgui.end_disabled()
    _tip("The lights' own lux count" if lux else "What lights without lux of their own give")
    if moved:
        seen = changed(seen, illuminance_lux=max(given, _LUX[0]))
    own = viewing.L_A is not None
    imgui.begin_disabled(not own)
    moved, L_A = imgui.slider_float(
        "##L_A", luminance(seen, lights), *_LUMINANCE, "L_A %.4g cd/m²", _LOG
    )
    imgui.end_disabled()
    if moved and own:
        seen = changed(seen, L_A=L_A)
    imgui.same_line()
    pressed, own = imgui.checkbox("own L_A", own)
    _tip("Luminance that the eye adapts to; else it follows from light and background")
    if pressed:
        seen = changed(seen, L_A=luminance(seen, lights) if own else None)
    _reach("Background", desk)
    moved, Y_b = imgui.slider_float("Background", viewing.Y_b, 1.0, 100.0, "Y_b %.0f %%")
    if moved:
        seen = changed(seen, Y_b=min(max(Y_b, 0.0), 100.0))
    _reach("Surround", desk)
    picked = _pick("Surround", _called(viewing.surround), tuple(SURROUNDS))
    return seen if picked is None else changed(seen, surround=picked)


def _adaptation(seen: RelightSpec, desk: Desk) -> RelightSpec:
    viewing = seen.viewing
    imgui.begin_disabled(viewing.discount)
    share = 1.0 if viewing.discount else viewing.D
    _reach("Adaptation", desk)
    text = "model's D" if viewing.D is None and not viewing.discount else "D %.2f"
    moved, D = imgui.slider_float("Adaptation", -0.01 if share is None else share, -0.01, 1.0, text)
    imgui.end_disabled()
    if moved and not viewing.discount:
        seen = changed(seen, D=None if D < 0 else min(D, 1.0))
    pressed, discount = imgui.checkbox("Discount the light's colour", viewing.discount)
    if pressed:
        seen = changed(seen, discount=discount, D=None)
    return seen


def _display(seen: RelightSpec, desk: Desk) -> RelightSpec:
    display = seen.viewing.display
    _reach("Room", desk)
    picked = _pick("Room", preset_of(display), tuple(PRESETS))
    desk.note("room")
    if picked is not None:
        sources = PRESETS[picked].display(display.space, display.gamut)
        display = replace(sources, mark=display.mark)
    space = display.space.name if isinstance(display.space, ColourSpace) else str(display.space)
    _reach("Space", desk)
    picked = _pick("Space", space, tuple(SPACES))
    if picked is not None:
        display = replace(display, space=picked)
    _reach("White", desk)
    moved, white = imgui.slider_float("White", display.white_cd_m2, *_WHITE, "%.4g cd/m²", _LOG)
    if moved:
        # What the eye adapts to goes up and down with it.
        L_A = None if display.L_A is None else display.L_A * white / display.white_cd_m2
        display = replace(display, white_cd_m2=white, L_A=L_A)
    picked = _pick("Surround##display", _called(display.surround), tuple(SURROUNDS))
    if picked is not None:
        display = replace(display, surround=picked)
    _reach("Gamut", desk)
    picked = _pick("Gamut", display.gamut, GAMUTS)
    if picked is not None:
        display = replace(display, gamut=picked)
    pressed, mark = imgui.checkbox("Mark what it cannot show", display.mark)
    if pressed:
        display = replace(display, mark=mark)
    return seen if display is seen.viewing.display else changed(seen, display=display)


def _picture(seen: RelightSpec, desk: Desk) -> RelightSpec:
    _reach("Exposure", desk)
    moved, exposure = imgui.slider_float(
        "Exposure", seen.viewing.exposure, *_EXPOSURE, "× %.2f", _LOG
    )
    desk.note("exposure")
    if moved:
        seen = changed(seen, exposure=min(max(exposure, _EXPOSURE[0]), _EXPOSURE[1]))
    if isinstance(seen.backdrop, float | int):
        _reach("Backdrop", desk)
        moved, backdrop = imgui.slider_float("Backdrop", seen.backdrop, 0.0, 1.0, "%.2f")
        if moved:
            seen = replace(seen, backdrop=min(max(backdrop, 0.0), 1.0))
    picked = _pick("Mode", seen.mode, MODES)
    _tip("componentwise: channel by channel; exact: the light matrix. E shows the difference")
    if picked is not None:
        seen = replace(seen, mode=picked)
    picked = _pick("Level", seen.level, LEVELS)
    _tip("relative: white stays white; absolute: by the lights' lux")
    return seen if picked is None else replace(seen, level=picked)


def _reach(name: str, desk: Desk) -> None:
    """The next item takes the keyboard where it was asked for, and is scrolled to."""
    if desk.item == name:
        desk.item = ""
        imgui.set_keyboard_focus_here()


def _called(surround: str | float) -> str:
    return surround if isinstance(surround, str) else f"{surround:g}"


def _pick(label: str, now: str, names: tuple[str, ...]) -> str | None:
    """A list to pick from; None where nothing is picked."""
    picked = None
    if imgui.begin_combo(label, now, imgui.ComboFlags_.height_large):
        for name in names:
            if imgui.selectable(name, name == now)[0] and name != now:
                picked = name
        imgui.end_combo()
    return picked


def _tip(text: str) -> None:
    if imgui.is_item_hovered(imgui.HoveredFlags_.delay_normal):
        imgui.set_tooltip(text)
