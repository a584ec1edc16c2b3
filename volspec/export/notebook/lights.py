"""The lights of a widget: what was given, by name, and what shines together.

texts, spectra, rigs -> [lights] -> NamedLight -> LightRig
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

from volspec.errors import ImageError, SpectrumError, ViewingError, quoted
from volspec.raycast import CoefficientImage
from volspec.relight import Illumination, LightRig, RelightSpec
from volspec.relight.spec import mixed_rig
from volspec.scene.lights import NamedLight
from volspec.spectra import Spectrum, light

Given = str | Spectrum | LightRig

# What an image is offered, which knows no lights.
DEFAULT_LIGHTS = ("D65", "A", "FL11", "HP1")


def named_lights(
    given: Mapping[str, Given] | Sequence[Given | NamedLight] | None, image: CoefficientImage
) -> tuple[NamedLight, ...]:
    """What was given, by name.

    Raises
    ------
    ImageError
        If there is no light, or two have one name.
    SpectrumError, ViewingError
        If one is unknown, has no name or does not light the image.

    Examples
    --------
    >>> import numpy as np
    >>> from volspec.basis import SpectralBasis
    >>> one, basis = np.ones((1, 1), np.float32), SpectralBasis.load("general-7")
    >>> image = CoefficientImage(np.ones((1, 1, 7), np.float32), one, one, basis)
    >>> [lamp.name for lamp in named_lights({"day": "D65", "candle": "planck:1900"}, image)]
    ['day', 'candle']
    """
    if given is None:
        given = DEFAULT_LIGHTS
    pairs: Iterable[tuple[str | None, Given | NamedLight]]
    if isinstance(given, Mapping):
        pairs = given.items()
    elif isinstance(given, Sequence) and not isinstance(given, str):
        pairs = ((None, each) for each in given)
    else:
        raise ImageError(
            f"notebook: lights are {quoted(given)}; give several in a list, as ['D65', 'A'], or by "
            "name in a dict"
        )
    named = tuple(_named(name, each, image) for name, each in pairs)
    if not named:
        raise ImageError("notebook: there is no light; give at least one")
    names = [lamp.name for lamp in named]
    if twice := [name for name in dict.fromkeys(names) if names.count(name) > 1]:
        raise ImageError(
            f"notebook: two lights are {twice[0]!r}; give them names, as a dict", code="duplicate"
        )
    require_lit(named, image)
    return named


def require_lit(lights: Iterable[NamedLight], image: CoefficientImage) -> None:
    """Refuse lights that an image cannot be lit with.

    Raises
    ------
    SpectrumError
        If one does not cover the basis' grid.
    ViewingError
        If one shines from a group that the image lacks.
    """
    for lamp in lights:
        with _about(lamp.name):
            Illumination.of(image.basis, lamp.rig, RelightSpec(), image.groups)


def rig_of(lights: Sequence[NamedLight], weights: Sequence[float]) -> LightRig | None:
    """What shines together; None where every light is off.

    The lights' lux count where all that shine carry them.
    """
    if not any(weights):
        return None
    return mixed_rig([lamp.rig for lamp in lights], weights)


def _named(name: str | None, given: Given | NamedLight, image: CoefficientImage) -> NamedLight:
    if isinstance(given, NamedLight):
        return given if name is None else replace(given, name=name)
    grid = image.basis.grid
    label = given if isinstance(given, str) else ""
    if isinstance(given, str):
        given = light(given, grid)
        name = label if name is None else name
    if isinstance(given, Spectrum):
        name, rig = given.name if name is None else name, LightRig((given,))
    elif isinstance(given, LightRig):
        rig = given
    else:
        raise SpectrumError.refused(
            "notebook: a light", given, "give a name, as 'D65', a Spectrum or a LightRig"
        )
    if not (isinstance(name, str) and name.strip()):
        raise SpectrumError("notebook: a light has no name; give lights as {name: light}")
    with _about(name):
        return NamedLight(name, label or name, rig.facing(image.groups).mixed(grid), rig)


@contextmanager
def _about(name: str) -> Iterator[None]:
    """Put a light's name before the message of what is wrong with it."""
    try:
        yield
    except (SpectrumError, ViewingError) as error:
        raise type(error)(f"notebook: light {quoted(name)}: {error}") from error
