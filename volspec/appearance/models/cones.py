"""What RLAB and Hunt share: cones of the white, incomplete adaptation, numbers by surround.

    ViewingConditions -> [cones] -> rlab, hunt

References
----------
[1] *Color Appearance Models* (survey 002), eq. 11, 18-23 and 73-81.
"""

from __future__ import annotations

import numpy as np

from volspec.appearance import constants as k
from volspec.appearance.models.base import Array
from volspec.appearance.spec import SURROUND_RATIOS, ViewingConditions
from volspec.appearance.surround import require_conditions
from volspec.errors import ViewingError


def cones_of_white(name: str, conditions: ViewingConditions) -> Array:
    """(3,) Hunt-Pointer-Estévez responses of the adopted white (eq. 11).

    Raises
    ------
    ViewingError
        If one is not above 0, which no real light's is; or these are no `ViewingConditions`.
    """
    require_conditions(f"{name}: conditions", conditions)
    cones = k.HPE_FROM_XYZ @ np.asarray(conditions.white_XYZ)
    if not np.all(cones > 0.0):
        raise ViewingError(
            f"{name}: the white XYZ = {conditions.white_XYZ} has the cone responses "
            f"{cones.round(4).tolist()}; expected all above 0. Is it a real light's?"
        )
    return np.asarray(cones, dtype=np.float64)


def discounting(conditions: ViewingConditions) -> float:
    """How much of the light's colour is known to be the light's: D of eq. 73-75, 0 to 1."""
    if conditions.discount:
        return 1.0
    return 0.0 if conditions.D is None else conditions.D


def adaptation(white_cones: Array, luminance: float, D: float) -> Array:
    """How far the cones follow a coloured white (eq. 18-23, 73-81).

    Parameters
    ----------
    white_cones : (3,) float64
    luminance : float
        Of the adapting field, cd/m².
    D : float
        1 sets all to 1: adaptation is complete.

    Returns
    -------
    (3,) float64
    """
    share = 3.0 * white_cones / white_cones.sum()
    level = 1.0 + np.cbrt(luminance)
    p = (level + share) / (level + 1.0 / share)
    return np.asarray(p + D * (1.0 - p), dtype=np.float64)


def at_surround(surround: str | float, dark: float, dim: float, average: float) -> float:
    """A number that is known for three surrounds, on straight lines between their ratios."""
    ratio = SURROUND_RATIOS[surround] if isinstance(surround, str) else float(surround)
    ratios = [SURROUND_RATIOS[name] for name in ("dark", "dim", "average")]
    return float(np.interp(ratio, ratios, (dark, dim, average)))
