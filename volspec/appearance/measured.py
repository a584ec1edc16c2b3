"""Viewing conditions measured from a picture: the surroundings of the line of sight.

    relight -> [measured] -> ViewingConditions -> appearance

`Viewing.adapting` does this for frames (`volspec.relight.measured_viewing`).

Means over the solid angle around the line of sight (`volspec.appearance.adaptation_grid`):

    Y_b = ∫ Y dω / ∫ dω      1° to 11°,         L_A = L_w / Y_w · ∫ Y dω / ∫ dω      11° to 90°

A picture fills only part of these fields: everything outside of it has one luminance factor, the
picture's mean unless another is given (the backdrop's, or 0 for a dark room). A pixel at (u, v),
the tangents of its angles, spans the solid angle du dv / (1 + u² + v²)^(3/2).

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 2.4, eq. 1, and section 7.1, eq. 17.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.adaptation_grid import (
    AdaptationGrid,
    directions_on_sphere,
    field_weights,
    pixel_pitch,
    pixels_from_nodes,
)
from volspec.appearance.surround import SurroundOrRatio, ViewingConditions
from volspec.errors import ShapeError, ViewingError

Array = NDArray[np.float64]

# Cells along a picture's longer side, for `adapting_fields`.
_CELLS = 48
_LUMINANCE = "cd/m² above 0, E_v/π of the light"


def measured_conditions(
    Y: ArrayLike,
    white_XYZ: ArrayLike,
    fov_deg: float,
    luminance_of_white: float,
    at: tuple[float, float] | None = None,
    *,
    outside: float | None = None,
    surround: SurroundOrRatio | None = "average",
) -> ViewingConditions:
    """Return the conditions of an eye that looks at one point of a picture.

    Raises ShapeError if Y is not (H, W), and ViewingError if a number is out of range.

    Parameters
    ----------
    Y : (H, W) array_like
        Luminance factors on the white's scale; below 0 counts as 0.
    white_XYZ : (3,) array_like
        The adopted white.
    fov_deg : float
        The picture's height as an angle, as `Camera.fov_deg`.
    luminance_of_white : float
        Luminance of a perfect diffuser, cd/m²: E_v/π.
    at : (x, y), optional
        The pixel looked at, (0, 0) the centre of the top left one; None is the picture's centre.
    outside : float, optional
        Y of everything outside of the picture; None is the picture's mean.
    surround : str or float or None
        As in `surround_at`; None is the measured ratio L_A / luminance_of_white, at most 1 [1].
    """
    picture = _factors(Y)
    white = np.asarray(white_XYZ, dtype=np.float64)
    if white.shape != (3,):
        raise ShapeError(
            f"has shape {white.shape}", "expected (3,)", field="measured.white_XYZ", given=white_XYZ
        )
    _require_above_0("white_XYZ[1]", white[1], "above 0, as 100")
    _require_above_0("luminance_of_white", luminance_of_white, _LUMINANCE)
    height, width = picture.shape
    x, y = _pixel(at, (height, width))
    scale = pixel_pitch((height, width), fov_deg)
    across = (np.arange(width) - (width - 1) / 2) * scale
    down = (np.arange(height) - (height - 1) / 2) * scale
    directions, density = directions_on_sphere(*np.meshgrid(across, down))
    spans = (density * scale**2).ravel()
    elsewhere = _outside_or_mean(outside, picture.ravel(), spans)
    line = np.array([(x - (width - 1) / 2) * scale, (y - (height - 1) / 2) * scale, 1.0])
    cos = directions @ (line / np.linalg.norm(line))
    parts, remainder = field_weights(cos.reshape(1, -1), spans)
    Y_b, Y_A = parts @ picture.ravel() + remainder * elsewhere
    L_A = float(Y_A[0]) / float(white[1]) * luminance_of_white
    if surround is None:
        surround = min(L_A / luminance_of_white, 1.0)
    X_w, Y_w, Z_w = white.tolist()
    return ViewingConditions((X_w, Y_w, Z_w), L_A, float(Y_b[0]), surround)


def adapting_fields(
    Y: ArrayLike,
    fov_deg: float,
    luminance_of_white: float = 100.0,
    Y_w: float = 100.0,
    *,
    outside: float | None = None,
) -> tuple[Array, Array]:
    """Return Y_b, on Y's scale, and L_A, cd/m², of every pixel, (H, W) each.

    Averages over cones of 11° change slowly: they are computed for a grid of lines of sight over
    cells of the picture, 48 along its longer side, and interpolated in between. Cones and solid
    angles are spherical, also at the edges; cells above 2° (in a picture of 90°) blur the rim.
    Parameters and errors are those of `measured_conditions`; ``Y_w`` is the white's Y.
    """
    picture = _factors(Y)
    _require_above_0("luminance_of_white", luminance_of_white, _LUMINANCE)
    _require_above_0("Y_w", Y_w, "the white's Y, such as 100")
    height, width = picture.shape
    grid = AdaptationGrid.of((height, width), fov_deg, _CELLS)
    cells = grid.means(picture)
    fields = grid.measure(cells, _outside_or_mean(outside, cells, grid.spans))
    down = pixels_from_nodes(grid.nodes[0], height)
    across = pixels_from_nodes(grid.nodes[1], width)
    Y_b, Y_A = (down @ field @ across.T for field in fields)
    return Y_b, Y_A / Y_w * luminance_of_white


def _factors(Y: ArrayLike) -> Array:
    picture = np.asarray(Y, dtype=np.float64)
    if picture.ndim != 2 or picture.size == 0:
        raise ShapeError(f"has shape {picture.shape}", "expected (H, W)", field="measured.Y")
    if not np.all(np.isfinite(picture)):
        raise ViewingError(
            "has values that are not finite (NaN or infinity)", code="range", field="measured.Y"
        )
    return np.maximum(picture, 0.0)


def _pixel(pixel: tuple[float, float] | None, shape: tuple[int, int]) -> tuple[float, float]:
    """Return the pixel looked at, (x, y)."""
    height, width = shape
    if pixel is None:
        return (width - 1) / 2, (height - 1) / 2
    x, y = pixel
    if not (-0.5 <= x <= width - 0.5 and -0.5 <= y <= height - 0.5):
        raise ViewingError.refused(
            "measured.at", pixel, f"expected a pixel within {width} × {height}", "range"
        )
    return float(x), float(y)


def _outside_or_mean(outside: float | None, picture: Array, spans: Array) -> float:
    if outside is None:
        return float(np.average(picture, weights=spans))
    if not (math.isfinite(outside) and outside >= 0.0):
        raise ViewingError.refused(
            "measured.outside", outside, "expected a Y of 0 or more", "range"
        )
    return float(outside)


def _require_above_0(name: str, value: float, meaning: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise ViewingError.refused(f"measured.{name}", value, f"expected {meaning}", "range")
