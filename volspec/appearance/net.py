"""The geometry of adapting fields: which part of a picture counts how much, seen from where.

    fov_deg, shape -> [net] -> measured, field

Around each of some lines of sight the background is what lies 1° to 11° from it and the adapting
field what lies 11° to 90° from it. Both are means over solid angle, so they are linear in the
picture: one row of weights a line of sight, worked out once for a size and a field of view, and a
product with the picture whenever its light changes.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 2.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.spec import require_angle

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

INNER_DEG, OUTER_DEG = 1.0, 11.0
# Lines of sight at a time: their temporaries then stay in a cache.
_LINES = 64


def weights(cos: Array, spans: Array) -> tuple[Array, Array]:
    """What parts of a picture count in the fields around lines of sight.

    Parameters
    ----------
    cos : (K, N)
        Cosines between lines of sight and the parts' middles.
    spans : (N,)
        The parts' solid angles, sr.

    Returns
    -------
    parts : (2, K, N) float64
        Of each part in background and adapting field; 0 or more.
    rest : (2, K) float64
        Of all that lies outside of the picture; with the parts' 1.
    """

    def within(degrees: float) -> Array:
        # What the rim of the cone crosses counts by its share inside, across its width √dω.
        edge = math.radians(degrees)
        steep = 1.0 / (math.sin(edge) * np.sqrt(spans))
        share = cos * steep
        share += 0.5 - math.cos(edge) * steep
        return np.clip(share, 0.0, 1.0, out=share)

    parts = np.empty((2, *cos.shape))
    inner, outer, half = (within(degrees) for degrees in (INNER_DEG, OUTER_DEG, 90.0))
    np.subtract(outer, inner, out=parts[0])
    np.subtract(half, outer, out=parts[1])
    parts *= spans
    bounds = np.cos(np.radians([[INNER_DEG, OUTER_DEG], [OUTER_DEG, 90.0]]))
    whole = 2.0 * math.pi * (bounds[:, :1] - bounds[:, 1:])
    seen = parts.sum(axis=-1)
    all_of_it = np.maximum(whole, seen)
    parts /= all_of_it[..., None]
    return parts, (all_of_it - seen) / all_of_it


def sphere(u: Array, v: Array) -> tuple[Array, Array]:
    """Unit directions (..., 3) as right, down, forward; and the solid angle of du dv = 1 there."""
    directions = np.stack([u, v, np.ones_like(u)], axis=-1)
    length = np.linalg.norm(directions, axis=-1)
    return directions / length[..., None], 1.0 / length**3


def pitch(shape: tuple[int, int], fov_deg: float) -> float:
    """Width of a pixel of a picture at distance 1.

    Raises
    ------
    ViewingError
        If the field of view is none.
    """
    require_angle("measured: fov_deg", fov_deg)
    return 2.0 * math.tan(math.radians(fov_deg) / 2.0) / shape[0]


@dataclass(frozen=True, slots=True, eq=False)
class AdaptingNet:
    """Lines of sight and the cells of a picture that they are measured over.

    Parameters
    ----------
    edges : ((cells down + 1,), (cells across + 1,)) int
        The first row and column of each cell of the picture, and its size.
    spans : (N,)
        Solid angles of the cells, row by row, sr.
    parts, rest : (2, K, N), (2, K)
        `weights` of the cells around each line of sight.
    nodes : (R, C)
        How the K lines of sight lie: R rows of C.
    """

    edges: tuple[Indices, Indices]
    spans: Array
    parts: Array
    rest: Array
    nodes: tuple[int, int]

    @classmethod
    def of(
        cls, shape: tuple[int, int], fov_deg: float, cells: int, *, middle: bool = False
    ) -> AdaptingNet:
        """The net of a picture.

        Parameters
        ----------
        shape : (H, W)
            Of the picture, pixels.
        fov_deg : float
            Its height as an angle.
        cells : int
            Along its longer side.
        middle : bool
            One line of sight, through the picture's middle, in place of those to all corners of
            (as nearly as pixels allow) equal cells.

        Raises
        ------
        ViewingError
            If the field of view is none.
        """
        scale = pitch(shape, fov_deg)
        share = min(cells / max(shape), 1.0)
        counts = [max(round(size * share), 1) for size in shape]
        rows, columns = (
            np.rint(np.linspace(0, size, count + 1)).astype(np.intp)
            for size, count in zip(shape, counts, strict=True)
        )

        def seen(down: Array, across: Array) -> tuple[Array, Array]:
            half = shape[0] / 2, shape[1] / 2
            u, v = np.meshgrid((across - half[1]) * scale, (down - half[0]) * scale)
            directions, density = sphere(u.ravel(), v.ravel())
            return directions, density * scale**2

        centres, density = seen((rows[1:] + rows[:-1]) / 2, (columns[1:] + columns[:-1]) / 2)
        spans = density * np.outer(np.diff(rows), np.diff(columns)).ravel()
        nodes = (1, 1) if middle else (counts[0] + 1, counts[1] + 1)
        ends = [
            np.array([size / 2]) if middle else np.linspace(0, size, count)
            for size, count in zip(shape, nodes, strict=True)
        ]
        lines, _ = seen(*ends)
        parts, rest = np.empty((2, len(lines), len(spans))), np.empty((2, len(lines)))
        for start in range(0, len(lines), _LINES):
            some = slice(start, start + _LINES)
            parts[:, some], rest[:, some] = weights(lines[some] @ centres.T, spans)
        return cls((rows, columns), spans, parts, rest, nodes)

    def samples(self, most: int) -> tuple[Indices, Indices]:
        """Rows and columns to look at in place of all: as many in each cell, ``most`` each way."""

        def spread(edges: Indices) -> Indices:
            sizes = np.diff(edges)
            count = min(most, int(sizes.min()))
            within = (np.arange(count) + 0.5) / count * sizes[:, None]
            return (edges[:-1, None] + within.astype(np.intp)).ravel()

        rows, columns = self.edges
        return spread(rows), spread(columns)

    def of_samples(self, Y: Array) -> Array:
        """(N,) mean of each cell, of a picture at the rows and columns of `samples`."""
        down, across = (len(edges) - 1 for edges in self.edges)
        split = Y.reshape(down, Y.shape[0] // down, across, Y.shape[1] // across)
        return np.asarray(split.mean(axis=(1, 3)).ravel())

    def of_picture(self, Y: Array) -> Array:
        """(N,) mean of each cell, of a picture (H, W)."""
        rows, columns = self.edges
        sums = np.add.reduceat(np.add.reduceat(Y, rows[:-1], 0), columns[:-1], 1)
        return np.asarray((sums / np.outer(np.diff(rows), np.diff(columns))).ravel())

    def measured(self, cells: Array, outside: float) -> tuple[Array, Array]:
        """Mean Y of background and adapting field around each line of sight.

        Parameters
        ----------
        cells : (N,)
            Mean Y of each cell, 0 or more.
        outside : float
            Y of all that the picture does not show.

        Returns
        -------
        Y_b, Y_A : (R, C) float64
        """
        # Not BLAS, whose threads would wait for cores that draw: 1 ms against 0.2 to 12.
        Y_b, Y_A = np.einsum("kln,n->kl", self.parts, cells) + self.rest * outside
        return Y_b.reshape(self.nodes), Y_A.reshape(self.nodes)


def between(nodes: int, size: int) -> Array:
    """(size, nodes): linear interpolation from nodes, evenly from edge to edge, to pixels."""
    return _straight((np.arange(size) + 0.5) / size * (nodes - 1), nodes)


def refined(field: Array, times: int) -> Array:
    """A field at nodes (R, C), and straight between them at times - 1 more in each gap."""
    down, across = (
        _straight(np.linspace(0, nodes - 1, (nodes - 1) * times + 1), nodes)
        for nodes in field.shape
    )
    return down @ field @ across.T


def _straight(at: Array, nodes: int) -> Array:
    return np.maximum(1.0 - np.abs(at[:, None] - np.arange(nodes)), 0.0)
