"""How bright a palette's lights must be, so that its colours need no reflectance above 1.

model -> [exposure] -> model

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 5, after Smits (1999).
"""

from __future__ import annotations

from dataclasses import replace

from volspec.palette.model import Palette
from volspec.palette.solve import design


def fitted_exposure(palette: Palette) -> float:
    """The exposure at which the reflectances that the colours ask for stay within their bounds.

    The palette is designed without upper bounds; where a reflectance then rises above its own,
    the light is raised by as much [1]. A colour is the same under twice the light on half the
    reflectance, so this loses nothing.

    Parameters
    ----------
    palette : Palette

    Returns
    -------
    float
        At least the palette's own exposure; for `Palette.with_exposure`.

    Raises
    ------
    PaletteError
        As `design`.
    """
    rows = palette.reflectances
    unbounded = tuple(replace(row, upper=None) if row.open else row for row in rows)
    S = design(replace(palette, reflectances=unbounded)).state.S
    ratios = [
        values.max() / row.upper
        for row, values in zip(rows, S, strict=True)
        if row.open and row.upper
    ]
    return palette.viewing.exposure * max(1.0, *(float(ratio) for ratio in ratios), 1.0)
