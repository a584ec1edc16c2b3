"""How the scene is looked at: model, light level, background, surround, display."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from imgui_bundle import imgui

from volspec.appearance.display import GAMUTS
from volspec.appearance.spec import ADAPTING, MODELS, PER_PIXEL, SURROUNDS
from volspec.errors import VolspecError
from volspec.relight import RelightSpec
from volspec.viewer.panels.desk import Desk
from volspec.viewer.state import ViewState

_LUX = (0.1, 100_000.0)
_EXPOSURE = (0.1, 10.0)
_LABELS = 92
_LOG = imgui.SliderFlags_.logarithmic


def draw(state: ViewState, desk: Desk) -> ViewState | None:
    """Draw the panel."""
    seen = state.seen
    imgui.push_item_width(-desk.px(_LABELS))
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (desk.px(8), desk.px(4)))
    new = _scene(_model(seen, desk), desk)
    new = _display(new, desk)
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


def _model(seen: RelightSpec, desk: Desk) -> RelightSpec:
    viewing = seen.viewing
    picked = _pick("Model", viewing.model, MODELS)
    desk.note("model")
    if picked is not None:
        seen = with_model(seen, picked)
    measurable = ADAPTING if seen.viewing.model in PER_PIXEL else ADAPTING[:2]
    picked = _pick("Adapting", seen.viewing.adapting, measurable)
    return seen if picked is None else changed(seen, adapting=picked)


def _scene(seen: RelightSpec, desk: Desk) -> RelightSpec:
    viewing = seen.viewing
    moved, lux = imgui.slider_float("Illuminance", viewing.illuminance_lux, *_LUX, "%.4g lx", _LOG)
    desk.note("illuminance")
    if moved:
        seen = changed(seen, illuminance_lux=max(lux, _LUX[0]))
    moved, Y_b = imgui.slider_float("Background", viewing.Y_b, 1.0, 100.0, "Y_b %.0f %%")
    if moved:
        seen = changed(seen, Y_b=min(max(Y_b, 0.0), 100.0))
    surround = viewing.surround if isinstance(viewing.surround, str) else f"{viewing.surround:g}"
    picked = _pick("Surround", surround, tuple(SURROUNDS))
    if picked is not None:
        seen = changed(seen, surround=picked)
    own = viewing.D is None
    imgui.begin_disabled(viewing.discount)
    share = 1.0 if viewing.discount else viewing.D
    text = "model's D" if own else "D %.2f"
    moved, D = imgui.slider_float("Adaptation", -0.01 if share is None else share, -0.01, 1.0, text)
    imgui.end_disabled()
    if moved and not viewing.discount:
        seen = changed(seen, D=None if D < 0 else min(D, 1.0))
    pressed, discount = imgui.checkbox("Discount the light's colour", viewing.discount)
    if pressed:
        seen = changed(seen, discount=discount, D=None)
    return seen


def _display(seen: RelightSpec, desk: Desk) -> RelightSpec:
    imgui.separator()
    moved, exposure = imgui.slider_float(
        "Exposure", seen.viewing.exposure, *_EXPOSURE, "× %.2f", _LOG
    )
    desk.note("exposure")
    if moved:
        seen = changed(seen, exposure=min(max(exposure, _EXPOSURE[0]), _EXPOSURE[1]))
    if isinstance(seen.backdrop, float | int):
        moved, backdrop = imgui.slider_float("Backdrop", seen.backdrop, 0.0, 1.0, "%.2f")
        if moved:
            seen = replace(seen, backdrop=min(max(backdrop, 0.0), 1.0))
    display = seen.viewing.display
    picked = _pick("Gamut", display.gamut, GAMUTS)
    if picked is not None:
        seen = changed(seen, display=replace(display, gamut=picked))
    pressed, mark = imgui.checkbox("Mark what the display cannot show", display.mark)
    if pressed:
        seen = changed(seen, display=replace(seen.viewing.display, mark=mark))
    return seen


def _pick(label: str, now: str, names: tuple[str, ...]) -> str | None:
    """A list to pick from; None where nothing is picked."""
    picked = None
    if imgui.begin_combo(label, now, imgui.ComboFlags_.height_large):
        for name in names:
            if imgui.selectable(name, name == now)[0] and name != now:
                picked = name
        imgui.end_combo()
    return picked
