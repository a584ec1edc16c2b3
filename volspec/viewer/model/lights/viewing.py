"""How the scene is looked at: settings that go together, and the light that the eye adapts to.

state, lights -> [viewing] -> RelightSpec
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from volspec.appearance import Viewing
from volspec.appearance.spec import PER_PIXEL
from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec


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
