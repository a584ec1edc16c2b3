"""First look of a segmentation: each label opaque, in a colour of its own.

    Volume.labels -> [label_look] -> LabelFunction, material rows

Every colour is a mix of eight reflectances (`volspec.reflectance`: sRGB/red … sRGB/yellow, white,
black) with weights by Smits [1]; under D65 it is the display colour exactly. Few labels get a
material each, so that their spectra can be designed one by one; more share the eight, so that
channels remain exact under any light and a cast costs the same for any number of labels.

References
----------
[1] Smits (1999), "An RGB-to-Spectrum Conversion for Reflectances", J. Graphics Tools 4(4), 11-22.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import decode_sRGB, encode_sRGB
from volspec.basis import MaterialBasis
from volspec.errors import VolumeError
from volspec.spectra import Observer, SpectralGrid, reflectance
from volspec.transfer.discrete import LabelFunction
from volspec.volume import Labels, Volume, find_labels

MAX_OWN_MATERIALS = 24
"""Most labels with a material each."""
LABELS = "labels"
"""Name of this look, among those of presets."""
_OPACITY = 0.9
# Grids of hue, chroma and lightness from which colours are chosen, in Oklab.
_HUES, _CHROMAS, _LIGHTNESSES = 36, (0.08, 0.12, 0.16), (0.5, 0.62, 0.74, 0.86)
_DIGITS = 3
# Tables have black, codes 0 to 1, for labels without a colour.
_BLACK = 0.1


def with_labels(volume: Volume) -> Volume:
    """Return the volume with each of its values as a label.

    Raises VolumeError if the values are not whole numbers from 0.
    """
    labels = find_labels(volume.values, volume.range, volume.labels, certain=True)
    if not labels:
        raise VolumeError(
            f"{volume.name}: its values are not whole numbers from 0 to 65535, as labels are",
            "give another preset",
            code="conflict",
        )
    return replace(volume, labels=labels)


def label_function(
    volume: Volume, grid: SpectralGrid, observer_deg: Observer = 2
) -> tuple[LabelFunction, dict[str, str]]:
    """Return a volume's labels as a transfer function, and the reflectance of each material.

    The latter are texts for `volspec.reflectance`. The volume has labels.
    """
    colours = label_colours(volume.labels)
    names = unique_names(volume.labels)
    if len(colours) <= MAX_OWN_MATERIALS:
        texts = {names[n]: mix_text(smits_weights(colour)) for n, colour in colours.items()}
        looks = {number: (_OPACITY, {names[number]: 1.0}) for number in colours}
    else:
        mixes = {number: smits_weights(colour) for number, colour in colours.items()}
        texts = {name: name for name in sorted({name for mix in mixes.values() for name in mix})}
        looks = {number: (_OPACITY, mix) for number, mix in mixes.items()}
    materials = {name: reflectance(text, grid) for name, text in texts.items()}
    basis = MaterialBasis(materials, LABELS, grid, observer_deg)
    label_names = {number: label.name for number, label in volume.labels.items() if label.name}
    step_mm = volume.smallest_mm
    return LabelFunction(looks, materials, basis, step_mm, names=label_names), texts


def unique_names(labels: Labels) -> dict[int, str]:
    """Return a name for each label; its number makes a missing or repeated one unique.

    >>> from volspec.volume.labels import Label
    >>> unique_names({1: Label("rib"), 2: Label("rib"), 5: Label()})
    {1: 'rib', 2: 'rib 2', 5: 'label 5'}
    """
    names: dict[int, str] = {}
    used: set[str] = set()
    for number, label in labels.items():
        name = label.name or f"label {number}"
        if name in used:
            name = f"{name} {number}"
        used.add(name)
        names[number] = name
    return names


def label_colours(labels: Labels) -> dict[int, tuple[float, float, float]]:
    """Return a colour for each label, as sRGB codes 0 to 1: its own, else a distinct one.

    A label that is black in its table has none there.
    """
    distinct = iter(distinct_colours(len(labels)))
    return {
        number: label.colour if label.colour and max(label.colour) > _BLACK else next(distinct)
        for number, label in labels.items()
    }


@lru_cache(maxsize=8)
def distinct_colours(count: int) -> tuple[tuple[float, float, float], ...]:
    """Return sRGB colours, each as far as possible from all before; beyond some 400 they repeat.

    >>> first, second = distinct_colours(2)
    >>> sum((a - b) ** 2 for a, b in zip(first, second)) > 0.3
    True
    """
    lab, codes = _candidates()
    selected = [0]
    nearest = np.full(len(lab), np.inf)
    while len(selected) < min(count, len(lab)):
        nearest = np.minimum(nearest, np.linalg.norm(lab - lab[selected[-1]], axis=1))
        selected.append(int(nearest.argmax()))
    rows = [tuple(codes[selected[k % len(selected)]].tolist()) for k in range(count)]
    return tuple((r, g, b) for r, g, b in rows)


@lru_cache(maxsize=1)
def _candidates() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (N, 3) Oklab coordinates and sRGB codes of colours that sRGB can show.

    Björn Ottosson (2020), "A perceptual color space for image processing".
    """
    hues = np.linspace(0, 2 * np.pi, _HUES, endpoint=False) + np.radians(30)
    L, C, h = (axis.ravel() for axis in np.meshgrid(_LIGHTNESSES, _CHROMAS, hues))
    lab = np.column_stack([L, C * np.cos(h), C * np.sin(h)])
    lms_from_lab = np.array(
        [
            [1, 0.3963377774, 0.2158037573],
            [1, -0.1055613458, -0.0638541728],
            [1, -0.0894841775, -1.2914855480],
        ]
    )
    rgb_from_lms = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    linear = (lab @ lms_from_lab.T) ** 3 @ rgb_from_lms.T
    in_gamut = ((linear >= 0) & (linear <= 1)).all(axis=1)
    return lab[in_gamut], np.asarray(encode_sRGB(linear[in_gamut]))


def smits_weights(codes: Iterable[float]) -> dict[str, float]:
    """Return the weights of the reflectances that have a colour, given as sRGB codes 0 to 1.

    They sum to the greatest of linear red, green and blue; the rest is black.

    >>> smits_weights((1, 0, 0)), smits_weights((1, 1, 0.5))
    ({'sRGB/red': 1.0}, {'white': 0.214, 'sRGB/yellow': 0.785})
    """
    linear = decode_sRGB(np.array([*codes]))
    order = np.argsort(linear, kind="stable")
    low, middle, high = (float(linear[k]) for k in order)
    # The two greater components make a secondary colour; what is left of the greatest a primary.
    secondary = ("cyan", "magenta", "yellow")[order[0]]
    primary = ("red", "green", "blue")[order[2]]
    weights = {
        "white": low,
        f"sRGB/{secondary}": middle - low,
        f"sRGB/{primary}": high - middle,
    }
    # Rounded down, as the sum of a mix is at most 1.
    unit = 10.0**_DIGITS
    rounded = {name: math.floor(weight * unit + 1e-6) / unit for name, weight in weights.items()}
    return {name: weight for name, weight in rounded.items() if weight > 0} or {"black": 1.0}


def mix_text(weights: dict[str, float]) -> str:
    """Return a mix as `volspec.reflectance` reads it.

    >>> mix_text({"white": 0.25, "sRGB/red": 1.0})
    'white*0.25+sRGB/red'
    """
    return "+".join(name if w == 1 else f"{name}*{w:g}" for name, w in weights.items())
