"""The viewing: edits of its settings, and the luminance that the eye adapts to.

panels, command palette -> [viewing] -> RelightSpec
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from volspec.appearance import Viewing
from volspec.appearance.deficiency import DEFICIENCIES
from volspec.appearance.display import GAMUTS, PRESETS
from volspec.appearance.spaces import SPACES
from volspec.appearance.spec import ADAPTING, MODELS, PER_PIXEL, SURROUNDS
from volspec.basis import MODES
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.relight.spec import LEVELS
from volspec.spectra import Spectrum
from volspec.viewer.model.edit import Command, edit
from volspec.viewer.model.light_rows import facing_light
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import clamp

SCENE_SURROUNDS = (*SURROUNDS, "measured")
ADOPTED_WHITES = ("light", "scene")
LEAST_LUX = 0.1
EXPOSURE_RANGE = (0.1, 10.0)


def with_viewing(spec: RelightSpec, **changes: Any) -> RelightSpec:
    """Change settings of the viewing, unless they contradict each other.

    >>> with_viewing(RelightSpec(), surround="dim").viewing.surround
    'dim'
    """
    try:
        return replace(spec, viewing=replace(spec.viewing, **changes))
    except VolspecError:
        return spec


def with_model(spec: RelightSpec, model: str) -> RelightSpec:
    """Change the appearance model; one that cannot adapt to each pixel measures the picture."""
    adapting = spec.viewing.adapting
    if adapting == "pixel" and model not in PER_PIXEL:
        adapting = "picture"
    return with_viewing(spec, model=model, adapting=adapting)


def given_viewing(viewing: Viewing, lux: float | None) -> Viewing:
    """Return a viewing for single colours, without a picture to measure adaptation in.

    The light's own ``lux`` replaces the viewing's. Raises ViewingError if it is out of range.

    >>> given_viewing(Viewing(adapting="picture"), 500.0).illuminance_lux
    500.0
    """
    return viewing.lit_by(lux).unmeasured()


def luminance(rig: LightRig | None, viewing: Viewing) -> float:
    """Return L_A of the scene, cd/m²: as given, or from the current light."""
    return given_viewing(viewing, rig.total_lux if rig else None).adapting_luminance


def vision_text(viewing: Viewing) -> str:
    """Return the colour vision that a picture simulates; empty for normal vision.

    >>> vision_text(Viewing(deficiency="deutan", severity=0.5)), vision_text(Viewing())
    ('deutan vision 0.5, simulated', '')
    """
    if viewing.deficiency == "none" or viewing.severity == 0.0:
        return ""
    severity = "" if viewing.severity == 1.0 else f" {viewing.severity:.2g}"
    return f"{viewing.deficiency} vision{severity}, simulated"


def _change(state: ViewState, **changes: Any) -> ViewState:
    """Change the spec only if anything differs, as specs are compared by identity."""
    spec = state.relight
    if all(getattr(spec, name) == value for name, value in changes.items()):
        return state
    return replace(state, relight=replace(spec, **changes))


def _set(state: ViewState, **changes: Any) -> ViewState:
    return _change(state, viewing=with_viewing(state.relight, **changes).viewing)


def _set_display(state: ViewState, **changes: Any) -> ViewState:
    return _set(state, display=replace(state.relight.viewing.display, **changes))


def _choice(
    change: Callable[..., ViewState], field: str, known: Collection[str]
) -> Callable[[ViewState, str], ViewState]:
    """Return the edit that sets a field to one of the known names, and ignores others."""

    @edit
    def choose(state: ViewState, name: str) -> ViewState:
        return change(state, **{field: name}) if name in known else state

    return choose


NO_FILTER = "none"
FILTERS = (NO_FILTER, "longpass:420", "longpass:500", "longpass:575", "longpass:655")
"""Filters in the eye's path, beyond the usual lasers of microscopes."""

# Edits that set a named option of the viewing, the display or the spec.
set_adapting = _choice(_set, "adapting", ADAPTING)
set_surround = _choice(_set, "surround", SCENE_SURROUNDS)
set_adopted_white = _choice(_set, "adopted_white", ADOPTED_WHITES)
set_deficiency = _choice(_set, "deficiency", DEFICIENCIES)
set_space = _choice(_set_display, "space", SPACES)
set_display_surround = _choice(_set_display, "surround", SURROUNDS)
set_gamut = _choice(_set_display, "gamut", GAMUTS)
set_mode = _choice(_change, "mode", MODES)
set_level = _choice(_change, "level", LEVELS)


@edit
def set_model(state: ViewState, name: str) -> ViewState:
    """Set the appearance model."""
    if name not in MODELS:
        return state
    return _change(state, viewing=with_model(state.relight, name).viewing)


@edit
def set_illuminance(state: ViewState, lux: float) -> ViewState:
    """Set the illuminance of lights that have none of their own."""
    return _set(state, illuminance_lux=max(lux, LEAST_LUX))


@edit
def toggle_own_luminance(state: ViewState) -> ViewState:
    """Set L_A independently, or let it follow from the light again."""
    rig = facing_light(state.lights, state.room)
    given = state.relight.viewing.L_A is not None
    own = None if given else luminance(rig, shown_spec(state).viewing)
    return _set(state, L_A=own)


@edit
def set_luminance(state: ViewState, L_A: float) -> ViewState:
    """Set L_A in cd/m², if it is independent of the light."""
    return state if state.relight.viewing.L_A is None else _set(state, L_A=L_A)


@edit
def set_background(state: ViewState, Y_b: float) -> ViewState:
    """Set the background's luminance factor, in percent."""
    return _set(state, Y_b=clamp(Y_b, 0.0, 100.0))


@edit
def set_adaptation(state: ViewState, D: float) -> ViewState:
    """Set the degree of adaptation; below 0 it is the model's own."""
    if state.relight.viewing.discount:
        return state
    return _set(state, D=None if D < 0 else min(D, 1.0))


@edit
def toggle_discount(state: ViewState) -> ViewState:
    """Turn discounting of the light's colour on or off."""
    return _set(state, discount=not state.relight.viewing.discount, D=None)


@edit
def set_severity(state: ViewState, severity: float) -> ViewState:
    """Set the severity of the simulated deficiency."""
    return _set(state, severity=clamp(severity, 0.0, 1.0))


@edit
def set_room(state: ViewState, name: str) -> ViewState:
    """Put the display into a preset's room; its colour space and gamut stay."""
    if name not in PRESETS:
        return state
    now = state.relight.viewing.display
    in_room = PRESETS[name].display(now.space, now.gamut)
    return _set(state, display=replace(in_room, mark=now.mark))


@edit
def set_white(state: ViewState, cd_m2: float) -> ViewState:
    """Set the display's white; its adapting luminance changes in proportion."""
    now = state.relight.viewing.display
    L_A = None if now.L_A is None else now.L_A * cd_m2 / now.white_cd_m2
    return _set_display(state, white_cd_m2=cd_m2, L_A=L_A)


@edit
def set_exposure(state: ViewState, factor: float) -> ViewState:
    """Set the exposure."""
    return _set(state, exposure=clamp(factor, *EXPOSURE_RANGE))


@edit
def set_backdrop(state: ViewState, share: float) -> ViewState:
    """Set the backdrop's grey, unless it is a spectrum."""
    if isinstance(state.relight.backdrop, Spectrum):
        return state
    return _change(state, backdrop=clamp(share, 0.0, 1.0))


@edit
def set_filter(state: ViewState, text: str) -> ViewState:
    """Set the filter in the eye's path to one of `FILTERS`."""
    if text not in FILTERS:
        return state
    return _change(state, filter=None if text == NO_FILTER else text)


def _is_marked(state: ViewState) -> bool:
    return state.relight.viewing.display.mark


def _toggle_mark(state: ViewState) -> ViewState:
    return _set_display(state, mark=not _is_marked(state))


COMMANDS = (
    Command(
        "mark", "View", "Mark colours out of the display's gamut", ("m",), _toggle_mark, _is_marked
    ),
)
