"""Lights and viewing of a widget, and their conversion to the state of its page.

texts, spectra, rigs -> NamedLight -> LightRig
Viewing, RelightSpec <-> [settings] <-> the looks of web/state.js
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from volspec.appearance import CLOSED, SURROUND_RATIOS, Display, DisplayOutput, Viewing, forward_for
from volspec.appearance.adaptation import ADAPTATIONS
from volspec.errors import ImageError, SpectrumError, ViewingError, quote
from volspec.export.page import payload
from volspec.image import CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec, mixed_rig
from volspec.scene import stored_relight_spec
from volspec.scene.tables import NamedLight
from volspec.spectra import Spectrum, light

LightLike = str | Spectrum | LightRig

# Lights offered for an image without lights of its own.
DEFAULT_LIGHTS = ("D65", "A", "FL11", "HP1")


@dataclass(frozen=True, slots=True)
class PixelReading:
    """Colour of a pixel."""

    x: int
    y: int  # row 0 is the top
    opacity: float  # 0 to 1
    # Tristimulus values (X, Y, Z) in the scene; Y = 100 for a perfect diffuser.
    XYZ: tuple[float, float, float]
    # Lightness, chroma and hue (degrees) by the viewing's model, or by CIECAM02 if the model only
    # adapts; None if undefined.
    J: float | None
    C: float | None
    h: float | None


def named_lights(
    lights: Mapping[str, LightLike] | Sequence[LightLike | NamedLight] | None,
    image: CoefficientImage,
) -> tuple[NamedLight, ...]:
    """Name the lights of a widget; refuse lights that do not fit the image.

    >>> import numpy as np
    >>> from volspec.basis import SpectralBasis
    >>> one, basis = np.ones((1, 1), np.float32), SpectralBasis.load("general-7")
    >>> image = CoefficientImage(np.ones((1, 1, 7), np.float32), one, one, basis)
    >>> [lamp.name for lamp in named_lights({"day": "D65", "candle": "planck:1900"}, image)]
    ['day', 'candle']
    """
    if lights is None:
        lights = DEFAULT_LIGHTS
    pairs: Iterable[tuple[str | None, LightLike | NamedLight]]
    if isinstance(lights, Mapping):
        pairs = lights.items()
    elif isinstance(lights, Sequence) and not isinstance(lights, str):
        pairs = ((None, lamp_light) for lamp_light in lights)
    else:
        remedy = "give several in a list, such as ['D65', 'A'], or by name in a dict"
        raise ImageError.refused("notebook.lights", lights, remedy, "type")
    named = tuple(_as_named(name, lamp_light, image) for name, lamp_light in pairs)
    if not named:
        raise ImageError.refused("notebook.lights", lights, "give at least one", "missing")
    names = [lamp.name for lamp in named]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise ImageError(
            f"two lights are named {twice[0]!r}",
            "give them names in a dict",
            code="duplicate",
            field="notebook.lights",
            given=lights,
        )
    require_lit(named, image)
    return named


def require_lit(lights: Iterable[NamedLight], image: CoefficientImage) -> None:
    """Refuse lights that do not cover the image's grid, or shine from a group it does not have."""
    for lamp in lights:
        with _naming_light(lamp.name):
            Illumination.of(image.basis, lamp.rig, RelightSpec(), image.groups)


def weighted_rig(lights: Sequence[NamedLight], weights: Sequence[float]) -> LightRig | None:
    """Mix the lights; None if every weight is 0. The mix has lux if all of its lights do."""
    if not any(weights):
        return None
    return mixed_rig([lamp.rig for lamp in lights], weights)


def _as_named(
    name: str | None, source: LightLike | NamedLight, image: CoefficientImage
) -> NamedLight:
    if isinstance(source, NamedLight):
        return source if name is None else replace(source, name=name)
    grid = image.basis.grid
    label = source if isinstance(source, str) else ""
    if isinstance(source, str):
        source = light(source, grid)
        name = label if name is None else name
    if isinstance(source, Spectrum):
        name, rig = source.name if name is None else name, LightRig((source,))
    elif isinstance(source, LightRig):
        rig = source
    else:
        raise SpectrumError.refused(
            "notebook.lights", source, "give a name like 'D65', a Spectrum or a LightRig", "type"
        )
    if not (isinstance(name, str) and name.strip()):
        raise SpectrumError(
            "a light has no name",
            "give lights as {name: light}",
            code="missing",
            field="notebook.lights",
            given=source,
        )
    with _naming_light(name):
        return NamedLight(name, label or name, rig.facing(image.groups).mixed(grid), rig)


@contextmanager
def _naming_light(name: str) -> Iterator[None]:
    """Prefix a light's error with its name."""
    try:
        yield
    except (SpectrumError, ViewingError) as error:
        raise type(error)(f"notebook: light {quote(name)}: {error}", code=error.code) from error


def initial_spec(
    image: CoefficientImage, lights: Sequence[NamedLight], viewing: Viewing | None
) -> RelightSpec:
    """Return a widget's initial settings: as given, else as in the image's scene.

    Settings of the scene that the page does not support are replaced, with a warning.
    """
    stored = stored_relight_spec(image).for_lights(lamp.rig for lamp in lights)
    if viewing is not None:
        return replace(stored, viewing=checked_viewing(viewing))
    look = payload.look_numbers(stored, lights)
    is_sRGB = stored.viewing.display.space == "sRGB"
    display = stored.viewing.display if is_sRGB else Display()
    return replace(stored, viewing=viewing_from_look(look, display))


def checked_viewing(viewing: object) -> Viewing:
    """Refuse a viewing that the page does not support."""
    if not isinstance(viewing, Viewing):
        raise ViewingError.refused(
            "notebook.viewing", viewing, "expected a volspec.Viewing", "type"
        )
    if viewing.model not in CLOSED and viewing.model not in ADAPTATIONS:
        raise ViewingError(
            f"{viewing.model!r} has no closed form, which the page needs",
            f"use {', '.join(CLOSED)}, or volspec.relight",
            code="unsupported",
            field="notebook.viewing.model",
            given=viewing.model,
        )
    usual = replace(viewing.unmeasured(), adopted_white="light")
    for name in ("adapting", "surround", "adopted_white"):
        if (setting := getattr(viewing, name)) != getattr(usual, name):
            raise ViewingError(
                f"{setting!r} is of the picture, or of an eye that the page does not have",
                f"use {getattr(usual, name)!r}, or volspec.relight",
                code="unsupported",
                field=f"notebook.viewing.{name}",
                given=setting,
            )
    if viewing.display.space != "sRGB":
        raise ViewingError(
            f"{viewing.display.colours.name!r} is not supported by the page",
            "use sRGB, or volspec.relight",
            code="unsupported",
            field="notebook.viewing.display.space",
            given=viewing.display.space,
        )
    DisplayOutput.of(
        viewing.display, viewing.model
    )  # refuses a display without a gamut to reduce to
    return viewing


def look_from_viewing(viewing: Viewing, lights: Sequence[NamedLight]) -> dict[str, Any]:
    """Convert a viewing to the page's state."""
    look = payload.look_numbers(RelightSpec(viewing), lights)
    return {key: look[key] for key in (*payload.LOOK.values(), "gamut", "mark")}


def viewing_from_look(look: Mapping[str, Any], display: Display) -> Viewing:
    """Convert the page's state to a viewing on a display."""
    settings: dict[str, Any] = {name: look[key] for name, key in payload.LOOK.items()}
    ratio = settings["surround"]
    names = [name for name, value in SURROUND_RATIOS.items() if value == ratio]
    settings["surround"] = names[0] if names else ratio
    return Viewing(**settings, display=replace(display, gamut=look["gamut"], mark=look["mark"]))


def read_pixel(
    image: CoefficientImage, rig: LightRig, spec: RelightSpec, pixel: tuple[int, int]
) -> PixelReading:
    """Read a pixel like the page's probe."""
    x, y = pixel
    illumination = Illumination.of(image.basis, rig, spec, image.groups)
    opacity = float(image.alpha[y, x])
    XYZ = illumination.scene_XYZ(image.coefficients[y, x], opacity)
    viewing = illumination.viewing
    appearance = forward_for(viewing)(XYZ, viewing.conditions(illumination.white_XYZ))
    J, C, h = (
        (float(appearance.J), float(appearance.C), float(appearance.h))
        if bool(appearance.defined)
        else (None, None, None)
    )
    X, Y, Z = XYZ.tolist()
    return PixelReading(x, y, opacity, (X, Y, Z), J, C, h)
