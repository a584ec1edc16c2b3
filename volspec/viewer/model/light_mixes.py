"""Mixes of all lights: by a place on the dial, and kept as one more light.

rows -> [light_mixes] -> rows
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

from volspec.errors import VolspecError
from volspec.relight import LightRig
from volspec.spectra import SpectralGrid, Spectrum, light
from volspec.spectra.lights import light_terms
from volspec.viewer.model.light_rows import LightRow, Rows, effective_weights, rig_of, with_row

_DIGITS = 4


def mix_text(rows: Rows, group: str = "", folder: str = ".") -> str | None:
    """What shines from a group, as a mix in `volspec.light`'s notation.

    Its weights are shares of the lux where all lights have some. None where nothing shines, or a
    spectrum was drawn.
    """
    rig = rig_of(rows)
    shares: dict[str, float] = {}
    for row, weight in zip(rows, effective_weights(rows), strict=True):
        for j, text in enumerate(row.texts):
            amount = weight * row.rig.weights[j]
            if row.rig.groups[j] != group or amount <= 0:
                continue
            if text is None:
                return None
            if rig and rig.total_lux and row.rig.illuminance_lux:
                amount *= row.rig.illuminance_lux[j] / rig.total_lux
            terms = light_terms(text, folder)
            # Of lux, a mix has its parts' shares: its weights need not sum to 1.
            whole = sum(part for _, part in terms) if rig and rig.total_lux else 1.0
            for name, part in terms:
                shares[name] = shares.get(name, 0.0) + amount * part / whole
    terms_kept = [(name, f"{share:.{_DIGITS}g}") for name, share in shares.items() if share > 0]
    return "+".join(n if s == "1" else f"{n}*{s}" for n, s in terms_kept) or None


def with_mix(rows: Rows, grid: SpectralGrid, folder: str = ".") -> Rows:
    """A row more that alone gives the present mix; all as they are where nothing shines.

    Raises
    ------
    SpectrumError
        If there is no room.
    """
    rig = rig_of(rows)
    if rig is None:
        return rows
    spectra: list[Spectrum] = []
    texts: list[str | None] = []
    lux: list[float] = []
    groups: list[str] = []
    for group in dict.fromkeys(rig.groups):
        part = _from_group(rig, group)
        if part is None:
            continue
        text = mix_text(rows, group, folder)
        try:
            spectrum = light(text, grid, folder=folder) if text else part.mixed(grid)
        except VolspecError:  # a name that does not stand in a mix
            text, spectrum = None, part.mixed(grid)
        spectra.append(spectrum)
        texts.append(text)
        lux.append(part.total_lux or 0.0)
        groups.append(group)
    whole = LightRig(tuple(spectra), (), tuple(lux) if rig.illuminance_lux else None, tuple(groups))
    label = texts[0] if len(texts) == 1 and texts[0] else "a mix that was kept"
    return with_row(rows, LightRow("Mix", label, whole, texts=tuple(texts)))


def _from_group(rig: LightRig, group: str) -> LightRig | None:
    """What is said to shine from a group and from no other; None where that is dark."""
    lux = rig.illuminance_lux
    own = [
        j
        for j, name in enumerate(rig.groups)
        if name == group and rig.weights[j] > 0 and (lux is None or lux[j] > 0)
    ]
    if not own:
        return None
    return LightRig(
        tuple(rig.lights[j] for j in own),
        tuple(rig.weights[j] for j in own),
        tuple(lux[j] for j in own) if lux else None,
    )


@cache
def rim_places(count: int) -> tuple[tuple[float, float], ...]:
    """Where lights stand on the dial's rim, clockwise from the top; y runs down."""
    angles = [2 * math.pi * i / count for i in range(count)]
    return tuple((math.sin(angle), -math.cos(angle)) for angle in angles)


def dial_weights(count: int, x: float, y: float) -> tuple[float, ...]:
    """Weights of a place on the dial, whose rim has radius 1; they sum to 1.

    The polygon of the lights is a fan of triangles around the centre, where all count alike; in
    each triangle weights are linear. Places outside go to its edge.

    >>> dial_weights(4, 0.0, -1.0)
    (1.0, 0.0, 0.0, 0.0)
    >>> dial_weights(3, 0.0, 0.0)
    (0.333..., 0.333..., 0.333...)
    """
    if count < 2:
        return (1.0,) * count
    rim = rim_places(count)
    if count == 2:
        share = min(max((1.0 - y) / 2, 0.0), 1.0)
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
    """Where weights are on the dial: `dial_weights` undone, the lights' centre of gravity."""
    total = sum(weights)
    if total <= 0:
        return 0.0, 0.0
    rim = rim_places(len(weights))
    x, y = (sum(w * p[k] for w, p in zip(weights, rim, strict=True)) / total for k in (0, 1))
    return x, y


def blend_rows(rows: Rows, x: float, y: float) -> Rows:
    """The lights at a place of the dial; the strongest at weight 1, none solo or muted."""
    weights = dial_weights(len(rows), x, y)
    most = max(weights, default=1.0)
    return tuple(
        replace(row, weight=weight / most, solo=False, muted=False)
        for row, weight in zip(rows, weights, strict=True)
    )
