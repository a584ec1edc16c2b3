"""Parts of a light, which are spectra for light groups: their lux, and the pen that draws them.

rows -> [light_parts] -> rows, lux, notes
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from volspec.errors import VolspecError
from volspec.relight import LightRig, RelightSpec
from volspec.viewer.model.light_rows import LightRow, Rows, effective_weights, rig_of

LUX = (0.01, 200_000.0)
# Of one spectrum relative to the others of its row.
MOST_WEIGHT = 2.0
# Relative to a light's V-weighted mean of 1: laser lines reach some hundreds.
MOST_POWER = 1e4
Place = tuple[float, float]


def row_at(rows: Rows, index: int, part: int = 0) -> LightRow | None:
    """Return the row if it is there and has such a part."""
    if not 0 <= index < len(rows) or not 0 <= part < len(rows[index].rig.lights):
        return None
    return rows[index]


def facing_lux(rig: LightRig, shares: Mapping[str, float]) -> float | None:
    """Return the illuminance of a surface that faces every source, lux.

    None if the rig has no lux, or shines only from groups that are dark or not there.

    Parameters
    ----------
    shares : {group: float}
        As `volspec.RaycastSpec.shares`.
    """
    try:
        return rig.facing(shares).total_lux
    except VolspecError:
        return None


def lux_note(rows: Rows, shares: Mapping[str, float], spec: RelightSpec) -> str:
    """Return a sentence on what counts as the scene's illuminance."""
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


def draw_stroke(values: NDArray[np.float64], start: Place, end: Place) -> NDArray[np.float64]:
    """Draw a straight stroke of the pen over a spectrum's bands.

    Parameters
    ----------
    values : (N,) float64
        Power of each band.
    start, end : (x, y)
        Ends of the stroke: ``x`` 0 to 1 from the first band's middle to the last one's, ``y``
        power.

    Returns
    -------
    (N,) float64
        At least 0; bands that the pen did not come over are unchanged.

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
