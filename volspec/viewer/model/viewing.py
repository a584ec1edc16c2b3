"""How the scene is looked at: settings that go together, and the light that the eye adapts to.

state, lights -> [viewing] -> RelightSpec
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import fields, replace
from typing import Any

from volspec.appearance import Viewing
from volspec.appearance.display import GAMUTS
from volspec.appearance.presets import PRESETS
from volspec.appearance.spaces import SPACES
from volspec.appearance.spec import ADAPTING, MODELS, PER_PIXEL, SURROUNDS
from volspec.basis import MODES
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.relight.spec import LEVELS
from volspec.spectra import Spectrum
from volspec.viewer.model.event import Event, Reducer
from volspec.viewer.model.lights import rig_of
from volspec.viewer.model.state import ViewState


def changed(seen: RelightSpec, **changes: Any) -> RelightSpec:
    """Other settings of the viewing; as they are where they do not go together.

    >>> changed(RelightSpec(), surround="dim").viewing.surround
    'dim'
    """
    try:
        return replace(seen, viewing=replace(seen.viewing, **changes))
    except VolspecError:
        return seen


def with_display(seen: RelightSpec, **changes: Any) -> RelightSpec:
    """Other settings of the display; as they are where they do not go together."""
    try:
        display = replace(seen.viewing.display, **changes)
    except VolspecError:
        return seen
    return changed(seen, display=display)


def with_model(seen: RelightSpec, model: str) -> RelightSpec:
    """Another model; one that cannot adapt to each pixel measures the picture."""
    pixel = seen.viewing.adapting == "pixel" and model not in PER_PIXEL
    return changed(seen, model=model, **({"adapting": "picture"} if pixel else {}))


def given_viewing(viewing: Viewing, lux: float | None) -> Viewing:
    """A viewing for single colours, which are no picture to measure an eye's adaptation in.

    Parameters
    ----------
    viewing : Viewing
    lux : float, optional
        Of the light that shines, where it has its own: it counts in place of the viewing's.

    Raises
    ------
    ViewingError
        If such a light cannot be.

    >>> given_viewing(Viewing(adapting="picture"), 500.0).illuminance_lux
    500.0
    """
    given = replace(viewing, adapting="given")
    return replace(given, illuminance_lux=lux) if lux else given


def luminance(rig: LightRig | None, viewing: Viewing) -> float:
    """L_A of the scene, cd/m²: as given, or of the light that shines."""
    return given_viewing(viewing, rig.total_lux if rig else None).adapting_luminance


LEAST_LUX = 0.1
EXPOSURE_RANGE = (0.1, 10.0)


def _number(change: Callable[[RelightSpec, float], RelightSpec]) -> Reducer:
    """A setting that is the event's ``x``."""

    def reducer(state: ViewState, event: Event) -> ViewState:
        return _with(state, change(state.seen, event.x))

    return reducer


def _word(known: Collection[str], change: Callable[[RelightSpec, str], RelightSpec]) -> Reducer:
    """A setting that is the event's ``key``, one of the known."""

    def reducer(state: ViewState, event: Event) -> ViewState:
        return _with(state, change(state.seen, event.key)) if event.key in known else state

    return reducer


def _with(state: ViewState, seen: RelightSpec) -> ViewState:
    """The state itself where nothing is set otherwise: specs are told apart by identity."""
    names = [field.name for field in fields(seen)]
    if all(getattr(seen, name) == getattr(state.seen, name) for name in names):
        return state
    return replace(state, seen=seen)


def _own_luminance(state: ViewState, _: Event) -> ViewState:
    """L_A by itself from now on, or from the light again."""
    viewing = state.seen.viewing
    own = luminance(rig_of(state.lights), viewing) if viewing.L_A is None else None
    return _with(state, changed(state.seen, L_A=own))


def _luminance(seen: RelightSpec, L_A: float) -> RelightSpec:
    return seen if seen.viewing.L_A is None else changed(seen, L_A=L_A)


def _adaptation(seen: RelightSpec, D: float) -> RelightSpec:
    """D; the model's own below 0."""
    if seen.viewing.discount:
        return seen
    return changed(seen, D=None if D < 0 else min(D, 1.0))


def _discount(state: ViewState, _: Event) -> ViewState:
    """Discount the light's colour, or no longer."""
    discount = not state.seen.viewing.discount
    return _with(state, changed(state.seen, discount=discount, D=None))


def _room(seen: RelightSpec, name: str) -> RelightSpec:
    """The display where a preset has it; what it can show stays."""
    now = seen.viewing.display
    there = PRESETS[name].display(now.space, now.gamut)
    return changed(seen, display=replace(there, mark=now.mark))


def _white(seen: RelightSpec, cd_m2: float) -> RelightSpec:
    """The display's white; what the eye adapts to goes up and down with it."""
    now = seen.viewing.display
    L_A = None if now.L_A is None else now.L_A * cd_m2 / now.white_cd_m2
    return with_display(seen, white_cd_m2=cd_m2, L_A=L_A)


def _backdrop(seen: RelightSpec, share: float) -> RelightSpec:
    """A grey; a spectrum of the scene's own stays."""
    if isinstance(seen.backdrop, Spectrum):
        return seen
    return replace(seen, backdrop=min(max(share, 0.0), 1.0))


EVENTS: dict[str, Reducer] = {
    "model": _word(MODELS, with_model),
    "adapting": _word(ADAPTING, lambda seen, key: changed(seen, adapting=key)),
    "illuminance": _number(lambda seen, x: changed(seen, illuminance_lux=max(x, LEAST_LUX))),
    "own-luminance": _own_luminance,
    "luminance": _number(_luminance),
    "background": _number(lambda seen, x: changed(seen, Y_b=min(max(x, 0.0), 100.0))),
    "surround": _word(SURROUNDS, lambda seen, key: changed(seen, surround=key)),
    "adaptation": _number(_adaptation),
    "discount": _discount,
    "room": _word(PRESETS, _room),
    "space": _word(SPACES, lambda seen, key: with_display(seen, space=key)),
    "white": _number(_white),
    "display-surround": _word(SURROUNDS, lambda seen, key: with_display(seen, surround=key)),
    "gamut": _word(GAMUTS, lambda seen, key: with_display(seen, gamut=key)),
    "exposure": _number(
        lambda seen, x: changed(seen, exposure=min(max(x, EXPOSURE_RANGE[0]), EXPOSURE_RANGE[1]))
    ),
    "backdrop": _number(_backdrop),
    "mode": _word(MODES, lambda seen, key: replace(seen, mode=key)),
    "level": _word(LEVELS, lambda seen, key: replace(seen, level=key)),
}
