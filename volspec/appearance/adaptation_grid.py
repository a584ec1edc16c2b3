"""Local adaptation: view transforms for an eye that adapts to the surroundings of each pixel.

    fov_deg, shape -> [AdaptationGrid] -> Y_b, L_A -> [ViewTransformGrid] -> cpu | cam.glsl

For each of a set of lines of sight, the background is the part of the picture 1° to 11° from it,
and the adapting field the part 11° to 90° from it. Both are means over solid angle, so they are
linear in the picture: one row of weights per line of sight, computed once for a size and a field of
view, and a product with the picture whenever its light changes.

In CIECAM02's and CAM16's transforms only the scene's side depends on Y_b and L_A: the matrix to
linear responses, w, γ and κ, twelve numbers. These are computed at the nodes of a grid that spans
the picture from edge to edge, and interpolated linearly between them.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 2.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import constants as k
from volspec.appearance.models import cam
from volspec.appearance.models.cam import CamConditions, CamTransform
from volspec.appearance.spec import Viewing, require_angle
from volspec.appearance.surround import surrounds_at

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

INNER_DEG, OUTER_DEG = 1.0, 11.0
# Lines of sight per batch, so that temporaries fit the cache.
_LINES = 64


def field_weights(cos: Array, spans: Array) -> tuple[Array, Array]:
    """Return the weights of a picture's parts in the fields around lines of sight.

    ``cos`` (K, N) are cosines between lines of sight and the parts' centres, ``spans`` (N,) the
    parts' solid angles, sr. Returns (2, K, N) weights of the parts in background and adapting
    field, and (2, K) weights of everything outside of the picture; together they sum to 1.
    """

    def fraction_within(degrees: float) -> Array:
        # A part on the cone's rim is weighted by its fraction inside, taking its width as √dω.
        edge = math.radians(degrees)
        steep = 1.0 / (math.sin(edge) * np.sqrt(spans))
        fraction = cos * steep
        fraction += 0.5 - math.cos(edge) * steep
        return np.clip(fraction, 0.0, 1.0, out=fraction)

    parts = np.empty((2, *cos.shape))
    inner, outer, half = (fraction_within(degrees) for degrees in (INNER_DEG, OUTER_DEG, 90.0))
    np.subtract(outer, inner, out=parts[0])
    np.subtract(half, outer, out=parts[1])
    parts *= spans
    bounds = np.cos(np.radians([[INNER_DEG, OUTER_DEG], [OUTER_DEG, 90.0]]))
    solid_angle = 2.0 * math.pi * (bounds[:, :1] - bounds[:, 1:])
    covered = parts.sum(axis=-1)
    total = np.maximum(solid_angle, covered)
    parts /= total[..., None]
    return parts, (total - covered) / total


def directions_on_sphere(u: Array, v: Array) -> tuple[Array, Array]:
    """Return unit directions (..., 3), right, down, forward; and the solid angle per du dv."""
    directions = np.stack([u, v, np.ones_like(u)], axis=-1)
    length = np.linalg.norm(directions, axis=-1)
    return directions / length[..., None], 1.0 / length**3


def pixel_pitch(shape: tuple[int, int], fov_deg: float) -> float:
    """Return the width of a pixel of a picture (H, W) at distance 1."""
    require_angle("measured.fov_deg", fov_deg)
    return 2.0 * math.tan(math.radians(fov_deg) / 2.0) / shape[0]


@dataclass(frozen=True, slots=True, eq=False)
class AdaptationGrid:
    """Lines of sight, and the picture's cells over which their fields are averaged."""

    edges: tuple[Indices, Indices]  # first row and column of each cell, and the picture's size
    spans: Array  # (N,) solid angles of the cells, row by row, sr
    parts: Array  # (2, K, N) and
    remainder: Array  # (2, K) `field_weights` of the cells around each line of sight
    nodes: tuple[int, int]  # (R, C): the K lines of sight are R rows of C

    @classmethod
    def of(
        cls, shape: tuple[int, int], fov_deg: float, cells: int, *, centre_only: bool = False
    ) -> AdaptationGrid:
        """Make a grid over a picture (H, W), ``fov_deg`` high, ``cells`` along its longer side.

        Lines of sight go to all corners of the (nearly equal) cells, or to the picture's centre
        alone.
        """
        scale = pixel_pitch(shape, fov_deg)
        cells_per_pixel = min(cells / max(shape), 1.0)
        counts = [max(round(size * cells_per_pixel), 1) for size in shape]
        rows, columns = (
            np.rint(np.linspace(0, size, count + 1)).astype(np.intp)
            for size, count in zip(shape, counts, strict=True)
        )

        def directions_at(down: Array, across: Array) -> tuple[Array, Array]:
            half = shape[0] / 2, shape[1] / 2
            u, v = np.meshgrid((across - half[1]) * scale, (down - half[0]) * scale)
            directions, density = directions_on_sphere(u.ravel(), v.ravel())
            return directions, density * scale**2

        centres, density = directions_at(
            (rows[1:] + rows[:-1]) / 2, (columns[1:] + columns[:-1]) / 2
        )
        spans = density * np.outer(np.diff(rows), np.diff(columns)).ravel()
        nodes = (1, 1) if centre_only else (counts[0] + 1, counts[1] + 1)
        ends = [
            np.array([size / 2]) if centre_only else np.linspace(0, size, count)
            for size, count in zip(shape, nodes, strict=True)
        ]
        lines, _ = directions_at(*ends)
        parts, remainder = np.empty((2, len(lines), len(spans))), np.empty((2, len(lines)))
        for start in range(0, len(lines), _LINES):
            some = slice(start, start + _LINES)
            parts[:, some], remainder[:, some] = field_weights(lines[some] @ centres.T, spans)
        return cls((rows, columns), spans, parts, remainder, nodes)

    def samples(self, max_per_cell: int) -> tuple[Indices, Indices]:
        """Return rows and columns that sample the picture: ``max_per_cell`` a cell and axis."""

        def spread(edges: Indices) -> Indices:
            sizes = np.diff(edges)
            count = min(max_per_cell, int(sizes.min()))
            within = (np.arange(count) + 0.5) / count * sizes[:, None]
            return (edges[:-1, None] + within.astype(np.intp)).ravel()

        rows, columns = self.edges
        return spread(rows), spread(columns)

    def means_from_samples(self, Y: Array) -> Array:
        """(N,) mean of each cell, from a picture's values at the rows and columns of `samples`."""
        down, across = (len(edges) - 1 for edges in self.edges)
        split = Y.reshape(down, Y.shape[0] // down, across, Y.shape[1] // across)
        return np.asarray(split.mean(axis=(1, 3)).ravel())

    def means(self, Y: Array) -> Array:
        """(N,) mean of each cell of a picture (H, W)."""
        rows, columns = self.edges
        sums = np.add.reduceat(np.add.reduceat(Y, rows[:-1], 0), columns[:-1], 1)
        return np.asarray((sums / np.outer(np.diff(rows), np.diff(columns))).ravel())

    def measure(self, cells: Array, outside: float) -> tuple[Array, Array]:
        """Return the mean Y (R, C) of background and adapting field around each line of sight.

        ``cells`` (N,) is the mean Y of each cell, ``outside`` the mean Y outside of the picture.
        """
        # Not BLAS: its threads would wait for cores busy drawing, 0.2 to 12 ms instead of 1 ms.
        Y_b, Y_A = np.einsum("kln,n->kl", self.parts, cells) + self.remainder * outside
        return Y_b.reshape(self.nodes), Y_A.reshape(self.nodes)


def pixels_from_nodes(nodes: int, size: int) -> Array:
    """(size, nodes): linear interpolation to pixels from nodes spaced evenly from edge to edge."""
    return _linear_weights((np.arange(size) + 0.5) / size * (nodes - 1), nodes)


def subdivide(field: Array, times: int) -> Array:
    """Interpolate a field at nodes (R, C) linearly, with times - 1 more nodes in each gap."""
    down, across = (
        _linear_weights(np.linspace(0, nodes - 1, (nodes - 1) * times + 1), nodes)
        for nodes in field.shape
    )
    return down @ field @ across.T


def _linear_weights(positions: Array, nodes: int) -> Array:
    return np.maximum(1.0 - np.abs(positions[:, None] - np.arange(nodes)), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class ViewTransformGrid:
    """`CamTransform`s at the nodes of a grid over a picture."""

    transform: CamTransform  # one node's; the display's side is the same at all nodes
    # (R, C, 12), in the order of the texture's layers: a column of `response_from_XYZ` and, fourth,
    # `scene_achromatic`, `lightness_power` and `chroma_gain`.
    numbers: Array

    @classmethod
    def of(
        cls,
        viewing: Viewing,
        white_XYZ: Array,
        Y_b: Array,
        L_A: Array,
        S_R: Array | None = None,
    ) -> ViewTransformGrid:
        """Make the transforms of an eye that is adapted differently at each node.

        ``Y_b`` (percent of the white) and ``L_A`` (cd/m²), both (R, C), replace those of the
        viewing, with a model of `PER_PIXEL`; so does ``S_R``, (R, C), if the viewing's surround
        is to be measured. Raises ViewingError if the white has no lightness at some node.
        """
        model, L_A, Y_b = viewing.model, np.asarray(L_A), np.asarray(Y_b)
        unmeasured = viewing.unmeasured()
        complete = CamConditions.of_viewing(
            replace(unmeasured, D=1.0, discount=False, L_A=0.0).conditions(white_XYZ), model
        )
        white = np.array(complete.white_XYZ)
        if S_R is None or viewing.surround != "measured":
            S_R = None
            F, c, N_c = (np.asarray(factor) for factor in complete.surround)
        else:
            F, c, N_c = surrounds_at(S_R)
        F_L, n = cam.level_factor(L_A), cam.background_ratio(Y_b, white[1])
        if viewing.discount:
            D = np.ones_like(F_L)
        elif viewing.D is not None:
            D = np.full_like(F_L, viewing.D)
        else:
            D = cam.degree_of_adaptation(F, L_A)
        # The gains, and so the matrix, are linear in D.
        at_1 = replace(complete, F_L=1.0).response_from_XYZ()
        at_0 = replace(complete, F_L=1.0, D_RGB=(1.0, 1.0, 1.0)).response_from_XYZ()
        matrix = at_0 + D[..., None, None] * (at_1 - at_0)
        matrix *= F_L[..., None, None]
        achromatic = cam.compress(matrix @ white) @ k.ACHROMATIC
        # The node at which the white has the least lightness is refused if any node is.
        node = np.unravel_index(int(np.argmin(achromatic)), achromatic.shape)
        darkest = replace(unmeasured, L_A=float(L_A[node]), Y_b=float(Y_b[node]))
        if S_R is not None:
            darkest = replace(darkest, surround=float(S_R[node]))
        transform = CamTransform.for_viewing(
            model, darkest.conditions(white_XYZ), viewing.display.conditions
        )
        display = transform.display
        power = c * cam.lightness_exponent(n) / display.lightness_power
        if transform.is_proportional:
            gain = N_c / achromatic * (display.white_achromatic / display.surround.N_c)
        else:
            scale = cam.chroma_scale(n) / display.chroma_scale
            eccentricity = cam.eccentricity_scale(N_c, n) / display.eccentricity_scale
            gain = scale ** (1.0 / k.CHROMA_POWER) * eccentricity
        fourth = np.stack([achromatic, power, gain], axis=-1)
        columns = np.swapaxes(matrix, -1, -2)
        numbers = np.concatenate([columns, fourth[..., None]], axis=-1)
        return cls(transform, numbers.reshape(*achromatic.shape, 12))

    def texels(self) -> NDArray[np.float32]:
        """(3, R, C, 4): the texture array of ``cam.glsl``, a layer for each column."""
        split = self.numbers.reshape(*self.numbers.shape[:2], 3, 4)
        return np.ascontiguousarray(np.moveaxis(split, 2, 0), dtype=np.float32)

    def interpolate(self, size: tuple[int, int], rows: slice = slice(None)) -> CamTransform:
        """Return the transform of each pixel of a picture (H, W), or of some of its rows."""
        down, across = (
            pixels_from_nodes(nodes, pixels)
            for nodes, pixels in zip(self.numbers.shape[:2], size, strict=True)
        )
        columns = np.tensordot(down[rows], self.numbers, 1)
        pixels = np.einsum("xc,ycn->yxn", across, columns, optimize=True)
        split = pixels.reshape(*pixels.shape[:2], 3, 4)
        return replace(
            self.transform,
            response_from_XYZ=np.swapaxes(split[..., :3], -1, -2),
            scene_achromatic=split[..., 0, 3],
            lightness_power=split[..., 1, 3],
            chroma_gain=split[..., 2, 3],
        )
