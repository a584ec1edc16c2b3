"""Numbers between keyframes: smooth, and never beyond the keys on either side.

    keyframes -> [motion] -> moved, plan

References
----------
[1] Fritsch & Butland (1984), "A method for constructing local monotone piecewise cubic
    interpolants", SIAM J. Sci. Stat. Comput. 5(2), 300-304; scipy's PchipInterpolator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
# times, values of the keys, times asked for -> values there.
Way = Callable[[ArrayLike, ArrayLike, ArrayLike], Array]


def between_keys(times_s: ArrayLike, values: ArrayLike, at_s: ArrayLike) -> Array:
    """Values at any time: a monotone cubic through the keys, the outermost ones beyond them.

    A Catmull-Rom spline would swing past keys that hold still; this one stays between each two.

    Parameters
    ----------
    times_s : (K,) array_like
        Rising.
    values : (K, ...) array_like
    at_s : (F,) array_like

    Returns
    -------
    (F, ...) float64

    Examples
    --------
    >>> between_keys([0, 1, 2], [0, 10, 10], [0, 1, 1.5, 2, 9]).tolist()
    [0.0, 10.0, 10.0, 10.0, 10.0]
    """
    from scipy.interpolate import PchipInterpolator

    keys = np.asarray(values, dtype=np.float64)
    times, at = np.asarray(times_s, dtype=np.float64), np.asarray(at_s, dtype=np.float64)
    if len(times) == 1:
        return np.repeat(keys, len(at), axis=0)
    found: Array = PchipInterpolator(times, keys)(np.clip(at, times[0], times[-1]))
    # The keys themselves to the last bit, so that what holds still is cast once.
    low, high = keys.min(axis=0), keys.max(axis=0)
    found = np.clip(found, low, high)
    for time, key in zip(times, keys, strict=True):
        found[at == time] = key
    return found


def ratios_between_keys(times_s: ArrayLike, values: ArrayLike, at_s: ArrayLike) -> Array:
    """The same for what is seen by its ratio, as zoom and exposure; all above 0.

    >>> ratios_between_keys([0, 1], [1, 4], [0.5]).round(9).tolist()
    [2.0]
    """
    logs = np.log(np.asarray(values, dtype=np.float64))
    found_logs = between_keys(times_s, logs, at_s)
    found = np.exp(found_logs)
    for log, key in zip(logs, np.asarray(values, dtype=np.float64), strict=True):
        found[found_logs == log] = key
    return found


def short_way(angles_deg: ArrayLike) -> Array:
    """Angles counted on so that none is more than half a turn from the one before.

    >>> short_way([350, 10, 350]).tolist()
    [350.0, 370.0, 350.0]
    """
    return np.unwrap(np.asarray(angles_deg, dtype=np.float64), period=360.0)


def angles_between_keys(times_s: ArrayLike, angles_deg: ArrayLike, at_s: ArrayLike) -> Array:
    """The same for angles, each from the one before by the short way.

    >>> angles_between_keys([0, 1], [350, 10], [0.5]).tolist()
    [360.0]
    """
    return between_keys(times_s, short_way(angles_deg), at_s)


def tracks_between(
    keys: Sequence[tuple[float, Any]], ways: Mapping[str, Way], at_s: Array
) -> dict[str, Array]:
    """Every number that some key gives, at every time.

    Parameters
    ----------
    keys : sequence of (time_s, table)
        A table is None, or has an attribute for each way, which may be None.
    ways : {name: way}
    at_s : (F,) array

    Returns
    -------
    {name: (F, ...) array}
        Without the names that no key gives.
    """
    found = {}
    for name, way in ways.items():
        given = [
            (time, getattr(table, name))
            for time, table in keys
            if table is not None and getattr(table, name) is not None
        ]
        if given:
            found[name] = way([time for time, _ in given], [value for _, value in given], at_s)
    return found


def rows_of(tracks: Mapping[str, Array], count: int) -> list[dict[str, Any]]:
    """The numbers of each time, as plain floats and tuples of them."""
    return [
        {
            name: tuple(track[i].tolist()) if track.ndim > 1 else float(track[i])
            for name, track in tracks.items()
        }
        for i in range(count)
    ]
