"""First look of a volume of several fields: each a haze of one colour, by its file's metadata.

    Volume.fields -> [channel_look] -> FieldFunctions, material rows

A channel has the colour and the limits that its file states, else the colour of its emission, or
one of a list, and limits that most of its voxels lie below and a few above.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from volspec.basis import MaterialBasis
from volspec.spectra import Observer, SpectralGrid, reflectance
from volspec.transfer.fields import OWN, FieldFunctions
from volspec.transfer.label_look import mix_text, smits_weights
from volspec.transfer.model import TransferFunction
from volspec.transfer.presets import histogram_of, round_to, step_mm
from volspec.volume import Channel, Volume, unique_titles

Colour = tuple[float, float, float]
# sRGB codes of channels without a colour, and up to which emission, in nm, each is meant.
_COLOURS: tuple[tuple[float, Colour], ...] = (
    (480.0, (0.2, 0.4, 1.0)),
    (505.0, (0.1, 0.9, 1.0)),
    (560.0, (0.2, 1.0, 0.2)),
    (590.0, (1.0, 0.9, 0.1)),
    (620.0, (1.0, 0.5, 0.1)),
    (2000.0, (1.0, 0.2, 0.2)),
)
# Of several without an emission: they differ even where they mix.
_IN_ORDER: tuple[Colour, ...] = (
    (0.2, 1.0, 0.2),
    (1.0, 0.2, 1.0),
    (0.1, 0.9, 1.0),
    (1.0, 0.9, 0.1),
    (1.0, 0.2, 0.2),
    (0.2, 0.4, 1.0),
    (1.0, 0.5, 0.1),
    (0.9, 0.9, 0.9),
)
# Quantiles of a channel's values where it begins to be seen, and is seen fully.
_QUANTILES = 0.75, 0.999
# Opacity of the reference step at limits, and where it is in between.
_FULL, _MIDDLE, _MIDDLE_OPACITY = 0.3, 0.4, 0.05


def channel_functions(
    steps: Sequence[Volume], grid: SpectralGrid, observer_deg: Observer = 2
) -> tuple[FieldFunctions, dict[str, str]]:
    """Return the transfer functions of a volume's fields, and the reflectance of each material.

    The latter are texts for `volspec.reflectance`. ``steps`` are a series, or a volume alone.
    """
    texts, points = {}, {}
    volume = steps[0]
    fields = volume, *volume.fields
    titles = unique_titles([field.title for field in fields])
    for number, (field, material) in enumerate(zip(fields, titles, strict=True)):
        name = field.name if number else OWN
        texts[material] = mix_text(smits_weights(channel_colour(field.channel, number)))
        role = name
        low, high = channel_limits(field, (step.by_role[role] for step in steps))
        middle = round_to(low + _MIDDLE * (high - low), high - low)
        points[name] = [
            (low, 0.0, material),
            (middle, _MIDDLE_OPACITY, material),
            (high, _FULL, material),
        ]
    materials = {name: reflectance(text, grid) for name, text in texts.items()}
    basis = MaterialBasis(materials, "channels", grid, observer_deg)
    step = step_mm(volume)
    functions = {
        name: TransferFunction(curve, materials, basis, step) for name, curve in points.items()
    }
    return FieldFunctions(functions), texts


def channel_colour(channel: Channel, number: int) -> Colour:
    """Return the colour of a channel, the ``number``-th: stated, by emission, or of a list.

    >>> channel_colour(Channel(emission_nm=460.0), 3), channel_colour(Channel(), 1)
    ((0.2, 0.4, 1.0), (1.0, 0.2, 1.0))
    """
    if channel.colour is not None and max(channel.colour) > 0:
        return channel.colour
    if channel.emission_nm is None:
        return _IN_ORDER[number % len(_IN_ORDER)]
    emission_nm = channel.emission_nm
    return next(colour for up_to_nm, colour in _COLOURS if emission_nm <= up_to_nm)


def channel_limits(field: Volume, steps: Iterable[Volume] | None = None) -> tuple[float, float]:
    """Return the values between which a field is shown: stated, or by its labels or histogram.

    ``steps`` are the field at all time steps.
    """
    minimum, maximum = field.typical_range
    limits = field.channel.limits
    if limits is not None and limits[0] < maximum and limits[1] > minimum:
        return limits
    if numbers := [number for number in field.labels if number]:
        return min(numbers) - 0.5, float(min(numbers))
    below = np.cumsum(histogram_of([field] if steps is None else steps))
    edges = np.linspace(minimum, maximum, len(below) + 1)
    low, high = (edges[np.searchsorted(below, q * below[-1]) + 1] for q in _QUANTILES)
    if high <= low:
        low = minimum
    return round_to(low, high - low), round_to(high, high - low)
