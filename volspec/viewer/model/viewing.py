"""The viewing: edits of its settings, and the luminance that the eye adapts to.

panels, command palette -> [viewing] -> RelightSpec
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.appearance import PER_PIXEL, Viewing
from volspec.appearance.display import preset
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.viewer.model.edit import Command, edit, with_field, with_values
from volspec.viewer.model.light_rows import facing_light
from volspec.viewer.model.room import shown_spec
from volspec.viewer.model.state import ViewState


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


NO_FILTER = "none"
FILTERS = (NO_FILTER, "longpass:420", "longpass:500", "longpass:575", "longpass:655")
"""Filters in the eye's path, beyond the usual lasers of microscopes."""


@edit
def set_viewing(state: ViewState, name: str, value: object) -> ViewState:
    """Set a field of the viewing; a model or a discount replaces what contradicts it."""
    viewing = state.relight.viewing
    if name == "model":
        return _with_viewing(state, with_model(state.relight, str(value)).viewing)
    if name == "discount":
        viewing = replace(viewing, D=None)
    return _with_viewing(state, with_field(viewing, name, value))


@edit
def set_display(state: ViewState, name: str, value: object) -> ViewState:
    """Set a field of the display; ``preset`` puts it into a room by name.

    In the room of a preset, colour space and gamut stay. The adapting luminance is in proportion
    to the display's white.
    """
    now = state.relight.viewing.display
    display = with_field(now, name, value)
    if name == "preset":
        display = replace(preset(str(value)).display(now.space, now.gamut), mark=now.mark)
    if name == "white_cd_m2" and now.L_A is not None:
        display = replace(display, L_A=now.L_A * display.white_cd_m2 / now.white_cd_m2)
    viewing = state.relight.viewing
    return _with_viewing(state, viewing if display == now else replace(viewing, display=display))


@edit
def set_relight(state: ViewState, name: str, value: object) -> ViewState:
    """Set a field of the settings for making the picture, such as its mode."""
    return with_values(state, relight=with_field(state.relight, name, value))


def _with_viewing(state: ViewState, viewing: Viewing) -> ViewState:
    """Change the spec only if anything differs, as specs are compared by identity."""
    if viewing == state.relight.viewing:
        return state
    return replace(state, relight=replace(state.relight, viewing=viewing))


@edit
def toggle_own_luminance(state: ViewState) -> ViewState:
    """Set L_A independently, or let it follow from the light again."""
    rig = facing_light(state.lights, state.room)
    is_set = state.relight.viewing.L_A is not None
    value = None if is_set else luminance(rig, shown_spec(state).viewing)
    return set_viewing(state, "L_A", value)


def _is_marked(state: ViewState) -> bool:
    return state.relight.viewing.display.mark


def _toggle_mark(state: ViewState) -> ViewState:
    return set_display(state, "mark", not _is_marked(state))


COMMANDS = (
    Command(
        "mark", "View", "Mark colours out of the display's gamut", ("m",), _toggle_mark, _is_marked
    ),
)
