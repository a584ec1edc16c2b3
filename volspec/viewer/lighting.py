"""The lights of the viewer: rows with weights, solo and mute, and the dial that blends them.

rows -> [lighting] -> LightRig -> relight

References
----------
[1] Bergner, Möller, Tory & Drew (2005), "A practical approach to spectral volume rendering",
    IEEE TVCG 11(2), 207-216: the light dial.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

from volspec.errors import SpectrumError
from volspec.relight import LightRig
from volspec.scene.lights import NamedLight
from volspec.spectra import SpectralGrid, light

KELVIN = (1000.0, 20000.0)
MOST_ROWS = 24


@dataclass(frozen=True, slots=True)
class LightRow:
    """One light of the list.

    Parameters
    ----------
    name : str
    label : str
        What it is, in words.
    rig : LightRig
        What it shines with at weight 1.
    weight : float
        0 to 1.
    solo, muted : bool
    kelvin : float, optional
        Of a Planck radiator, whose temperature can be changed.
    """

    name: str
    label: str
    rig: LightRig
    weight: float = 0.0
    solo: bool = False
    muted: bool = False
    kelvin: float | None = None


Rows = tuple[LightRow, ...]


def rows_of(lights: Sequence[NamedLight]) -> Rows:
    """A scene's lights, of which the first is on."""
    return tuple(
        LightRow(light.name, light.label, light.rig, 1.0 if i == 0 else 0.0)
        for i, light in enumerate(lights)
    )


def shining(rows: Rows) -> tuple[float, ...]:
    """The weights that count, after solo and mute."""
    solo = any(row.solo for row in rows)
    return tuple(0.0 if row.muted or (solo and not row.solo) else row.weight for row in rows)


def rig_of(rows: Rows) -> LightRig | None:
    """What lights the picture; None where every light is off.

    The lights' lux count where all that shine carry them.
    """
    lit = [(row.rig, weight) for row, weight in zip(rows, shining(rows), strict=True) if weight > 0]
    if not lit:
        return None
    lux = [rig.illuminance_lux for rig, _ in lit]
    return LightRig(
        tuple(light for rig, _ in lit for light in rig.lights),
        tuple(own * weight for rig, weight in lit for own in rig.weights),
        tuple(v for own in lux if own for v in own) if all(lux) else None,
        tuple(group for rig, _ in lit for group in rig.groups),
    )


def changed(rows: Rows, index: int, **changes: object) -> Rows:
    """One row with other settings; all as they are where there is no such row."""
    if not 0 <= index < len(rows):
        return rows
    row = replace(rows[index], **changes)  # type: ignore[arg-type]
    return (*rows[:index], row, *rows[index + 1 :])


def weighted(rows: Rows, index: int, weight: float) -> Rows:
    """One row with another weight, within 0 to 1."""
    return changed(rows, index, weight=min(max(weight, 0.0), 1.0))


def alone(rows: Rows, index: int) -> Rows:
    """One light on, all others off."""
    return tuple(
        replace(row, weight=1.0 if i == index else 0.0, solo=False, muted=False)
        for i, row in enumerate(rows)
    )


def brightest(rows: Rows) -> int:
    """The row that shines most; the first where none does."""
    weights = shining(rows)
    return weights.index(max(weights)) if weights else 0


def heated(rows: Rows, index: int, kelvin: float) -> Rows:
    """A Planck radiator at another temperature."""
    if not (0 <= index < len(rows)) or rows[index].kelvin is None:
        return rows
    kelvin = min(max(round(kelvin), KELVIN[0]), KELVIN[1])
    grid = rows[index].rig.lights[0].grid
    rig = LightRig((light(f"planck:{kelvin:g}", grid),))
    return changed(rows, index, rig=rig, kelvin=kelvin, name=f"{kelvin:g} K")


def added(rows: Rows, text: str, grid: SpectralGrid) -> Rows:
    """A light of the library, in `volspec.light`'s notation, at the end of the list.

    Raises
    ------
    SpectrumError
        If there is no such light, or no room.
    """
    if len(rows) >= MOST_ROWS:
        raise SpectrumError(f"{MOST_ROWS} lights are the most; remove one first")
    spectrum = light(text, grid)
    prefix, _, number = text.partition(":")
    if prefix == "planck":
        kelvin = float(number)
        row = LightRow(f"{kelvin:g} K", "Planck radiator", LightRig((spectrum,)), kelvin=kelvin)
    else:
        row = LightRow(text, spectrum.name or text, LightRig((spectrum,)))
    return alone((*rows, row), len(rows))


def removed(rows: Rows, index: int) -> Rows:
    """Without one row; the last one stays."""
    if len(rows) < 2 or not 0 <= index < len(rows):
        return rows
    rest = (*rows[:index], *rows[index + 1 :])
    return rest if any(shining(rest)) else alone(rest, min(index, len(rest) - 1))


@cache
def corners(count: int) -> tuple[tuple[float, float], ...]:
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
    rim = corners(count)
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
    rim = corners(len(weights))
    x, y = (sum(w * p[k] for w, p in zip(weights, rim, strict=True)) / total for k in (0, 1))
    return x, y


def blended(rows: Rows, x: float, y: float) -> Rows:
    """The lights at a place of the dial; the strongest at weight 1, none solo or muted."""
    weights = dial_weights(len(rows), x, y)
    most = max(weights, default=1.0)
    return tuple(
        replace(row, weight=weight / most, solo=False, muted=False)
        for row, weight in zip(rows, weights, strict=True)
    )
