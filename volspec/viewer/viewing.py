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
    """Other settings of the viewing; as they are where they do not go together."""
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


def viewing_under(rig: LightRig | None, viewing: Viewing) -> Viewing:
    """The viewing of an eye adapted to a light: its own lux count, where it carries some."""
    given = replace(viewing, adapting="given")
    if rig is None or not rig.total_lux:
        return given
    return replace(given, illuminance_lux=rig.total_lux)


def luminance(rig: LightRig | None, viewing: Viewing) -> float:
    """L_A of the scene, cd/m²: as given, or of the light that shines."""
    return viewing_under(rig, viewing).adapting_luminance
