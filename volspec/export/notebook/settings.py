"""A widget's settings: which of them its page can draw, and the words it knows them by.

Viewing, RelightSpec <-> [settings] <-> the looks of web/state.js
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from volspec.appearance import Display, Viewing
from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.live import CLOSED
from volspec.appearance.models import MODELS
from volspec.appearance.screen import Screen
from volspec.appearance.spec import SURROUND_RATIOS
from volspec.errors import ViewingError
from volspec.export.page import payload
from volspec.raycast import CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.scene import viewing_of
from volspec.scene.lights import NamedLight

# Of a look in web/state.js, what a Viewing holds.
_LOOK = (
    *("model", "lux", "L_A", "Y_b", "surround", "D", "discount", "exposure"),
    *("gamut", "mark"),
)


@dataclass(frozen=True, slots=True)
class Probed:
    """What a pixel of the picture is.

    Parameters
    ----------
    x, y : int
        Row 0 is the top.
    opacity : float
        0 to 1.
    XYZ : (X, Y, Z)
        In the scene; Y = 100 for a perfect diffuser.
    J, C, h : float or None
        Lightness, chroma, hue in degrees: the viewing's model, CIECAM02 where it only adapts; None
        where it does not define them.
    """

    x: int
    y: int
    opacity: float
    XYZ: tuple[float, float, float]
    J: float | None
    C: float | None
    h: float | None


def opened(
    image: CoefficientImage, lights: Sequence[NamedLight], viewing: Viewing | None
) -> RelightSpec:
    """How a widget looks first: as given, else as the image's scene says.

    What a scene asks of its viewing and no page can draw is replaced, with a warning.

    Raises
    ------
    ImageError
        If the image's note of its viewing cannot be read.
    ViewingError
        If the page cannot draw the viewing that is given.
    """
    noted = viewing_of(image).spec().for_lights(lamp.rig for lamp in lights)
    if viewing is not None:
        return replace(noted, viewing=checked_viewing(viewing))
    look = payload.look_numbers(noted, lights)
    plain = noted.viewing.display.space == "sRGB"
    display = noted.viewing.display if plain else Display()
    return replace(noted, viewing=viewing_from(look, display))


def checked_viewing(viewing: object) -> Viewing:
    """A viewing that the page can draw.

    Raises
    ------
    ViewingError
        If it cannot, or it is none.
    """
    if not isinstance(viewing, Viewing):
        raise ViewingError.refused(
            "notebook.viewing", viewing, "expected a volspec.Viewing", "type"
        )
    if viewing.model not in CLOSED and viewing.model not in ADAPTATIONS:
        raise ViewingError(
            f"notebook: model {viewing.model!r} has no closed form, which the page needs; take "
            f"{', '.join(CLOSED)}, or volspec.relight",
            code="state",
        )
    if viewing.adapting != "given":
        raise ViewingError(
            f"notebook: adapting is {viewing.adapting!r}, but the page measures nothing in its "
            "picture; take 'given', or volspec.relight"
        )
    if viewing.display.space != "sRGB":
        raise ViewingError(
            f"notebook: the display is {viewing.display.colours.name!r}, but the page is made for "
            "sRGB; take that, or volspec.relight"
        )
    Screen.of(viewing.display, viewing.model)  # refuses to reduce what has no colour left
    return viewing


def look_of(viewing: Viewing, lights: Sequence[NamedLight]) -> dict[str, Any]:
    """A viewing as the page's state has it."""
    look = payload.look_numbers(RelightSpec(viewing), lights)
    return {name: look[name] for name in _LOOK}


def viewing_from(look: Mapping[str, Any], display: Display) -> Viewing:
    """What the page's state says, before a display in its room.

    Raises
    ------
    ViewingError
        If a value is out of range.
    """
    settings = {name: look[name] for name in _LOOK}
    display = replace(display, gamut=settings.pop("gamut"), mark=settings.pop("mark"))
    ratio: Any = settings.pop("surround")
    names: list[Any] = [name for name, known in SURROUND_RATIOS.items() if known == ratio]
    return Viewing(
        illuminance_lux=settings.pop("lux"),
        surround=names[0] if names else ratio,
        display=display,
        **settings,
    )


def read_at(
    image: CoefficientImage, rig: LightRig, seen: RelightSpec, pixel: tuple[int, int]
) -> Probed:
    """Look at a pixel, as the page's probe does."""
    x, y = pixel
    lit = Illumination.of(image.basis, rig, seen, image.groups)
    opacity = float(image.alpha[y, x])
    XYZ = lit.scene_XYZ(image.coefficients[y, x], opacity)
    viewing = lit.viewing
    model = MODELS[viewing.model if viewing.model in MODELS else "CIECAM02"]
    look = model.forward(XYZ, viewing.conditions(lit.white_XYZ))
    J, C, h = (
        (float(look.J), float(look.C), float(look.h)) if bool(look.defined) else (None, None, None)
    )
    X, Y, Z = XYZ.tolist()
    return Probed(x, y, opacity, (X, Y, Z), J, C, h)
