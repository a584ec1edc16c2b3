"""A light as the command line writes it: one for all groups, or one for each.

    words -> [setting] -> Spectrum | LightRig

A text that is a LIGHT by itself stays one, whatever its file is called. Else ``;`` parts lights,
and the text before the first ``=`` of a part is the group that it shines from.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from volspec.errors import ImageError, InputError, SpectrumError, ViewingError, nearest

if TYPE_CHECKING:
    from volspec.raycast import CoefficientImage
    from volspec.relight import LightRig
    from volspec.spectra import SpectralGrid, Spectrum


def read_setting(text: str, groups: Mapping[str, float], grid: SpectralGrid) -> Spectrum | LightRig:
    """A light setting.

    Parameters
    ----------
    text : str
        ``LIGHT``, or ``GROUP=LIGHT; GROUP=LIGHT; …``; a part without a group shines from all.
    groups : {name: share}
        The image's.
    grid : SpectralGrid

    Raises
    ------
    InputError
        If a group is unknown, given twice or without light in the cast, or a light is missing.
    SpectrumError
        If a light is unknown.

    Examples
    --------
    >>> from volspec.spectra import DEFAULT_GRID
    >>> groups = {"key": 0.8, "sky": 0.2}
    >>> read_setting("D65*0.7+A*0.3", groups, DEFAULT_GRID).name
    'D65*0.7+A*0.3'
    >>> rig = read_setting("key=A; sky=D65*0.3; FL2", groups, DEFAULT_GRID)
    >>> rig.groups, [light.name for light in rig.lights]
    (('key', 'sky', ''), ['A', 'D65*0.3', 'FL2'])
    """
    from volspec.relight import LightRig

    if (whole := _light(text, grid)) is not None:
        return whole
    lights: dict[str, Spectrum] = {}
    for part in text.split(";"):
        group, spectrum = _part(text, part.strip(), grid)
        if group and group not in groups:
            raise InputError(
                f"--light {text!r}: no light group {group!r}; {nearest(group, groups)}the image "
                f"has {', '.join(groups)}"
            )
        if group in lights:
            twice = f"group {group!r} has" if group else "all groups have"
            raise InputError(f"--light {text!r}: {twice} two lights; mix them, as D65*0.7+A*0.3")
        lights[group] = spectrum
    rig = LightRig(tuple(lights.values()), groups=tuple(lights))
    try:
        rig.facing(groups)
    except ViewingError as error:
        raise InputError(f"--light {text!r}: {str(error).removeprefix('LightRig: ')}") from error
    return rig


def read_image_setting(image: Path, text: str, stored: CoefficientImage) -> Spectrum | LightRig:
    """A light setting for a stored image, which names its scene's lights but not their spectra.

    Parameters
    ----------
    image : Path
        The image's file.
    text : str
        As `read_setting`, whose errors these are.
    stored : CoefficientImage
        What is in the file.

    Raises
    ------
    SpectrumError
        If the text is no light but that of the scene, or near to one of those.
    """
    from volspec.export.compositing import Recipe

    try:
        return read_setting(text, stored.groups, stored.basis.grid)
    except SpectrumError:
        try:
            names = list(Recipe.load(image).lights)
        except ImageError:
            names = []
        # What can be read without the scene is suggested by the library.
        own = [name for name in names if not _readable(name, stored.basis.grid)]
        meant = "" if text in names else nearest(text, own)
        if text not in names and not meant:
            raise
    raise SpectrumError(
        f"light {text!r}: {meant}{image} names its scene's lights ({', '.join(names)}), but does "
        "not hold their spectra; relight the scene: volspec export SCENE.toml --light "
        f"{'NAME' if meant else shlex.quote(text)} -o FOLDER"
    )


def _part(text: str, part: str, grid: SpectralGrid) -> tuple[str, Spectrum]:
    """The group, "" for all, and the light of one part."""
    from volspec.spectra import light

    if part and (alone := _light(part, grid)) is not None:
        return "", alone
    group, equals, word = (word.strip() for word in part.partition("="))
    if not (group and equals and word):
        raise InputError(f"--light {text!r}: write GROUP=LIGHT; GROUP=LIGHT, as key=A; sky=D65")
    return group, light(word, grid)


def _light(text: str, grid: SpectralGrid) -> Spectrum | None:
    """The text as a LIGHT; None where it can only be one for groups.

    Raises
    ------
    SpectrumError
        If nothing in it speaks of groups.
    """
    from volspec.spectra import light

    try:
        return light(text, grid)
    except SpectrumError:
        if set(text) & {"=", ";"}:
            return None
        raise


def _readable(name: str, grid: SpectralGrid) -> bool:
    """Return True if a name alone is a LIGHT."""
    try:
        return _light(name, grid) is not None
    except SpectrumError:
        return False
