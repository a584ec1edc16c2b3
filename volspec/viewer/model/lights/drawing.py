"""A light's spectrum drawn with the mouse: bands follow the pen.

pen -> [drawing] -> rows
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecError
from volspec.spectra import Spectrum, color_matching_functions
from volspec.viewer.model.lights.lighting import LightRow, Rows, unused
from volspec.viewer.model.lights.parts import put, row_at

Place = tuple[float, float]
# Beside a light's mean of 1 to the eye: laser lines reach some hundreds.
MOST_POWER = 1e4
# A light must leave as much to the eye, of what a flat one of ones gives.
_LEAST_SEEN = 1e-6
_EDITED = " edited"


def stroke(values: NDArray[np.float64], start: Place, end: Place) -> NDArray[np.float64]:
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
    >>> stroke(np.zeros(5), (0.25, 1.0), (0.75, 2.0)).tolist()
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


def drawn(rows: Rows, index: int, part: int, start: Place, end: Place) -> Rows:
    """A row whose spectrum a stroke has changed: a light of one's own.

    All as they are where there is no such row, a number is not finite, or nothing that can be
    seen would be left.
    """
    row = row_at(rows, index, part)
    if row is None or not all(map(math.isfinite, (*start, *end))):
        return rows
    old = row.rig.lights[part]
    values = stroke(old.values, start, end)
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
    named = row.name if row.named else unused(name, (*rows[:index], *rows[index + 1 :]))
    new = replace(row, name=named, rig=rig, kelvin=None, texts=tuple(texts), before=original)
    return put(rows, index, new)


def undrawn(rows: Rows, index: int) -> Rows:
    """A row with the spectrum that it had before it was drawn; its weight stays."""
    row = row_at(rows, index)
    if row is None or row.before is None:
        return rows
    others = (*rows[:index], *rows[index + 1 :])
    name = row.name if row.named else unused(row.before.name, others)
    before = replace(row.before, name=name, named=row.named)
    return put(rows, index, _as_switched(before, row))


def _as_switched(row: LightRow, by: LightRow) -> LightRow:
    return replace(row, weight=by.weight, solo=by.solo, muted=by.muted)
