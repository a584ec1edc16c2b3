"""Mixes of all lights: by a place on the dial, and saved as one more light.

rows -> [light_mixes] -> weights, row
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from volspec.errors import VolspecError
from volspec.spectra import SpectralGrid, Spectrum, light
from volspec.spectra.lights import light_terms
from volspec.viewer.model.light_rows import (
    LightRow,
    Rows,
    effective_weights,
    merge_groups,
    rig_of,
)
from volspec.viewer.model.view import clamp

_DIGITS = 4


def mix_row(rows: Rows, grid: SpectralGrid, folder: str = ".") -> LightRow | None:
    """Return a light that alone gives the present mix; None if every light is off."""
    rig = rig_of(rows)
    if rig is None:
        return None
    whole = merge_groups(rig, grid)
    spectra: list[Spectrum] = []
    texts: list[str | None] = []
    for group, mixed in zip(whole.groups, whole.lights, strict=True):
        text = _mix_text(rows, rig.total_lux, group, folder)
        try:
            spectrum = light(text, grid, folder=folder) if text else mixed
        except VolspecError:  # a name that cannot be in a mix
            text, spectrum = None, mixed
        spectra.append(spectrum)
        texts.append(text)
    label = texts[0] if len(texts) == 1 and texts[0] else "a mix that was kept"
    return LightRow("Mix", label, replace(whole, lights=tuple(spectra)), texts=tuple(texts))


def _mix_text(rows: Rows, total_lux: float | None, group: str, folder: str) -> str | None:
    """Return the mix that shines from a group in `volspec.light`'s notation.

    Its weights are shares of ``total_lux`` if that is given. None if nothing shines, or a
    spectrum was drawn.
    """
    shares: dict[str, float] = {}
    for row, weight in zip(rows, effective_weights(rows), strict=True):
        for j, text in enumerate(row.texts):
            amount = weight * row.rig.weights[j]
            if row.rig.groups[j] != group or amount <= 0:
                continue
            if text is None:
                return None
            if total_lux and row.rig.illuminance_lux:
                amount *= row.rig.illuminance_lux[j] / total_lux
            terms = light_terms(text, folder)
            # Of lux, a mix has its parts' shares: its weights need not sum to 1.
            whole = sum(part for _, part in terms) if total_lux else 1.0
            for name, part in terms:
                shares[name] = shares.get(name, 0.0) + amount * part / whole
    rounded = [(name, f"{share:.{_DIGITS}g}") for name, share in shares.items() if share > 0]
    return "+".join(name if share == "1" else f"{name}*{share}" for name, share in rounded) or None


@cache
def rim_places(count: int) -> tuple[tuple[float, float], ...]:
    """Return the lights' places on the dial's rim, clockwise from the top; y runs down."""
    angles = [2 * math.pi * i / count for i in range(count)]
    return tuple((math.sin(angle), -math.cos(angle)) for angle in angles)


def dial_weights(count: int, x: float, y: float) -> tuple[float, ...]:
    """Return the weights of a place on the dial, whose rim has radius 1; they sum to 1.

    The polygon of the lights is a fan of triangles around the centre, where all weights are
    equal; in each triangle weights are linear. Places outside go to its edge.

    >>> dial_weights(4, 0.0, -1.0)
    (1.0, 0.0, 0.0, 0.0)
    >>> dial_weights(3, 0.0, 0.0)
    (0.333..., 0.333..., 0.333...)
    """
    if count < 2:
        return (1.0,) * count
    rim = rim_places(count)
    if count == 2:
        share = clamp((1.0 - y) / 2, 0.0, 1.0)
        return (share, 1.0 - share)
    sector = int(math.atan2(x, -y) % (2 * math.pi) / (2 * math.pi / count)) % count
    after = (sector + 1) % count
    (ax, ay), (bx, by) = rim[sector], rim[after]
    area = ax * by - bx * ay
    first, second = max((x * by - bx * y) / area, 0.0), max((ax * y - x * ay) / area, 0.0)
    total = first + second
    if total > 1.0:
        first, second, total = first / total, second / total, 1.0
    weights = [(1.0 - total) / count] * count
    weights[sector] += first
    weights[after] += second
    return tuple(weights)


def dial_place(weights: Sequence[float]) -> tuple[float, float]:
    """Return the place of weights on the dial, the inverse of `dial_weights`: a weighted mean."""
    total = sum(weights)
    if total <= 0:
        return 0.0, 0.0
    rim = rim_places(len(weights))
    x, y = (sum(w * p[k] for w, p in zip(weights, rim, strict=True)) / total for k in (0, 1))
    return x, y
