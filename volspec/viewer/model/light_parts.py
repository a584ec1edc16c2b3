"""Parts of a light: spectra for light groups, each with its lux; drawn by hand.

    lights_edits -> [light_parts] -> rows

A row's rig has one part for each spectrum. Whatever numbers come, a rig that gives no light is
never made: the row stays as it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import SpectralGrid, Spectrum, color_matching_functions
from volspec.viewer.model.light_rows import (
    LightRow,
    Rows,
    effective_weights,
    kelvin_of,
    rig_of,
    spectrum_of,
    unused_name,
)

LUX = (0.01, 200_000.0)
# Of one spectrum beside the others of its row.
MOST_WEIGHT = 2.0


def with_lux(rows: Rows, index: int, lux: float, part: int = 0) -> Rows:
    """A light's illuminance, lux; at 0 or below it has none. A row's parts have all or none."""
    row = row_at(rows, index, part)
    if row is None:
        return rows
    old = row.rig.illuminance_lux
    if not lux > 0:
        return _with_rig(rows, index, illuminance_lux=None)
    lux = min(max(lux, LUX[0]), LUX[1])
    given = list(old) if old else [lux] * len(row.rig.lights)
    given[part] = lux
    return _with_rig(rows, index, illuminance_lux=tuple(given))


def with_part_weight(rows: Rows, index: int, part: int, weight: float) -> Rows:
    """A part's own weight beside the others of its row."""
    row = row_at(rows, index, part)
    if row is None:
        return rows
    weights = list(row.rig.weights)
    weights[part] = min(max(weight, 0.0), max(MOST_WEIGHT, weights[part]))
    return _with_rig(rows, index, weights=tuple(weights))


def with_part_group(rows: Rows, index: int, part: int, group: str) -> Rows:
    """A part that shines from another light group; ``""`` is all of them."""
    row = row_at(rows, index, part)
    if row is None:
        return rows
    groups = list(row.rig.groups)
    groups[part] = group
    return _with_rig(rows, index, groups=tuple(groups))


def with_part_spectrum(
    rows: Rows, index: int, part: int, text: str, grid: SpectralGrid, folder: str = "."
) -> Rows:
    """Another spectrum for a part, in `volspec.light`'s notation.

    Raises
    ------
    SpectrumError
        If there is no such light.
    """
    row = row_at(rows, index, part)
    if row is None or text.strip() == (row.texts[part] or ""):
        return rows
    spectrum, kept = spectrum_of(text, grid, folder)
    lights, texts = list(row.rig.lights), list(row.texts)
    lights[part], texts[part] = spectrum, kept
    name, label, kelvin = row.name, row.label, None
    if len(texts) == 1:
        kelvin = kelvin_of(kept)
        if not row.named:
            name = kept if kelvin is None else f"{kelvin:g} K"
            name = unused_name(name, (*rows[:index], *rows[index + 1 :]))
        label = kept if kelvin is None else "Planck radiator"
    new = replace(row, rig=replace(row.rig, lights=tuple(lights)), texts=tuple(texts))
    return with_row_at(
        rows, index, replace(new, name=name, label=label, kelvin=kelvin, before=None)
    )


def with_part(rows: Rows, index: int, group: str) -> Rows:
    """One more part for a group, with the first part's spectrum, weight and lux."""
    row = row_at(rows, index)
    if row is None:
        return rows
    rig = row.rig
    lux = rig.illuminance_lux
    more = LightRig(
        (*rig.lights, rig.lights[0]),
        (*rig.weights, rig.weights[0] or 1.0),
        (*lux, lux[0]) if lux else None,
        (*rig.groups, group),
    )
    texts = (*row.texts, row.texts[0])
    return with_row_at(rows, index, replace(row, rig=more, texts=texts, kelvin=None, before=None))


def without_part(rows: Rows, index: int, part: int) -> Rows:
    """Without a part; the last one stays."""
    row = row_at(rows, index, part)
    if row is None or len(row.rig.lights) < 2:
        return rows
    kept = [j for j in range(len(row.rig.lights)) if j != part]
    rig, lux = row.rig, row.rig.illuminance_lux
    try:
        less = LightRig(
            tuple(rig.lights[j] for j in kept),
            tuple(rig.weights[j] for j in kept),
            tuple(lux[j] for j in kept) if lux else None,
            tuple(rig.groups[j] for j in kept),
        )
    except VolspecError:  # what is left gives no light
        return rows
    texts = tuple(row.texts[j] for j in kept)
    kelvin = kelvin_of(texts[0]) if len(texts) == 1 else None
    return with_row_at(rows, index, replace(row, rig=less, texts=texts, kelvin=kelvin, before=None))


def split_by_group(rows: Rows, index: int, groups: Sequence[str]) -> Rows:
    """A part for each light group in place of one that shines from all."""
    row = row_at(rows, index)
    if row is None or "" not in row.rig.groups or len(groups) < 2:
        return rows
    rig, lux = row.rig, row.rig.illuminance_lux
    whole = rig.groups.index("")
    order = [(j, g) for j in range(len(rig.lights)) for g in (groups if j == whole else ("",))]
    named = [(j, g or rig.groups[j]) for j, g in order]
    more = LightRig(
        tuple(rig.lights[j] for j, _ in named),
        tuple(rig.weights[j] for j, _ in named),
        tuple(lux[j] for j, _ in named) if lux else None,
        tuple(group for _, group in named),
    )
    texts = tuple(row.texts[j] for j, _ in named)
    return with_row_at(rows, index, replace(row, rig=more, texts=texts, kelvin=None, before=None))


def facing_lux(rig: LightRig, shares: Mapping[str, float]) -> float | None:
    """What a surface that faces every source gets, lux; None where the rig carries none.

    Parameters
    ----------
    rig : LightRig
    shares : {group: float}
        As `volspec.RaycastSpec.shares`.
    """
    try:
        return rig.facing(shares).total_lux
    except VolspecError:  # from groups that are dark, or not there
        return None


def lux_note(rows: Rows, shares: Mapping[str, float], spec: RelightSpec) -> str:
    """What counts as the scene's illuminance, in words."""
    viewing_lux = spec.viewing.illuminance_lux
    lit = [row for row, weight in zip(rows, effective_weights(rows), strict=True) if weight > 0]
    without = [row.name for row in lit if row.rig.illuminance_lux is None]
    if lit and not without:
        rig = rig_of(rows)
        total = facing_lux(rig, shares) if rig else None
        return f"Together {total or 0.0:.4g} lx: what the eye adapts to"
    if without and spec.level == "absolute":
        return f"Level “absolute” needs lux, and {without[0]} has none"
    if len(without) < len(lit):
        names = without[0] + (" …" if len(without) > 1 else "")
        return f"As {names} has no lux, Viewing's {viewing_lux:.4g} lx count for all"
    return f"No lux given: Viewing's {viewing_lux:.4g} lx count"


def row_at(rows: Rows, index: int, part: int = 0) -> LightRow | None:
    """A row that has such a part; None where there is none."""
    if not 0 <= index < len(rows) or not 0 <= part < len(rows[index].rig.lights):
        return None
    return rows[index]


def with_row_at(rows: Rows, index: int, row: LightRow) -> Rows:
    """Another row in one's place."""
    return (*rows[:index], row, *rows[index + 1 :])


def _with_rig(rows: Rows, index: int, **changes: Any) -> Rows:
    row = rows[index]
    if all(getattr(row.rig, name) == value for name, value in changes.items()):
        return rows
    try:
        return with_row_at(rows, index, replace(row, rig=replace(row.rig, **changes)))
    except VolspecError:  # the rig would give no light
        return rows


Place = tuple[float, float]
# Beside a light's mean of 1 to the eye: laser lines reach some hundreds.
MOST_POWER = 1e4
# A light must leave as much to the eye, of what a flat one of ones gives.
_LEAST_SEEN = 1e-6
_EDITED = " edited"


def draw_stroke(values: NDArray[np.float64], start: Place, end: Place) -> NDArray[np.float64]:
    """Bands after a straight stroke of the pen.

    Parameters
    ----------
    values : (N,) float64
        Power of each band.
    start, end : (x, y)
        Where the pen was and is: ``x`` 0 to 1 from the first band's middle to the last one's,
        ``y`` power.

    Returns
    -------
    (N,) float64
        At least 0; bands that the pen did not come over are as they were.

    Examples
    --------
    >>> draw_stroke(np.zeros(5), (0.25, 1.0), (0.75, 2.0)).tolist()
    [0.0, 1.0, 1.5, 2.0, 0.0]
    """
    last = len(values) - 1
    (x0, y0), (x1, y1) = sorted([(start[0] * last, start[1]), (end[0] * last, end[1])])
    bands = np.arange(len(values), dtype=np.float64)
    under = (bands + 0.5 >= x0) & (bands - 0.5 <= x1)
    if x1 - x0 < 1e-9:
        powers = np.full(len(values), end[1])
    else:
        powers = np.interp(bands, [x0, x1], [y0, y1])
    return np.where(under, np.clip(powers, 0.0, MOST_POWER), values)


def with_stroke(rows: Rows, index: int, part: int, start: Place, end: Place) -> Rows:
    """A row whose spectrum a stroke has changed: a light of one's own.

    All as they are where there is no such row, a number is not finite, or nothing that can be
    seen would be left.
    """
    row = row_at(rows, index, part)
    if row is None or not all(map(math.isfinite, (*start, *end))):
        return rows
    old = row.rig.lights[part]
    values = draw_stroke(old.values, start, end)
    V = color_matching_functions(old.grid)[1]
    if np.array_equal(values, old.values) or V @ values < _LEAST_SEEN * V.sum():
        return rows
    original = row.before or row
    name = f"{original.name.removesuffix(_EDITED)}{_EDITED}"
    lights, texts = list(row.rig.lights), list(row.texts)
    lights[part], texts[part] = Spectrum(old.wavelengths_nm, values, name), None
    try:
        rig = replace(row.rig, lights=tuple(lights))
    except VolspecError:  # no light
        return rows
    named = row.name if row.named else unused_name(name, (*rows[:index], *rows[index + 1 :]))
    new = replace(row, name=named, rig=rig, kelvin=None, texts=tuple(texts), before=original)
    return with_row_at(rows, index, new)


def without_strokes(rows: Rows, index: int) -> Rows:
    """A row with the spectrum that it had before it was drawn; its weight stays."""
    row = row_at(rows, index)
    if row is None or row.before is None:
        return rows
    others = (*rows[:index], *rows[index + 1 :])
    name = row.name if row.named else unused_name(row.before.name, others)
    before = replace(row.before, name=name, named=row.named)
    return with_row_at(rows, index, _as_switched(before, row))


def _as_switched(row: LightRow, by: LightRow) -> LightRow:
    return replace(row, weight=by.weight, solo=by.solo, muted=by.muted)
