"""Mixtures of base spectra around a colour, and the smoothest reflectances beyond their hull.

    [search] -> construct

Between the hull of the base colours and the object-colour solid (every reflectance within 0 to 1),
the reflectance with the smallest second differences is used: its own, or those of its difference
from a mixture on the hull. Beyond the solid there is none; the nearest colour's is used.

References
----------
[1] Wang, Xu & Sun (2004), section 4: P = sum k_i P_i with k_i >= 0 and sum k_i = 1 (eq. 7)
    makes sum k_i I_i (eq. 8) a spectrum with colour P.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Surrounded = tuple[Indices, Array]
"""(n, 4) indices of base colours, -1 if none surround the colour, and (n, 4) weights."""

# The paper's eight points by octant, as bits x + 2y + 4z. Its figure 2 has ABCD below and EFGH
# above, each in a ring: the five tetrahedra then fill a cube.
_A, _B, _C, _D, _E, _F, _G, _H = 0, 1, 3, 2, 4, 5, 7, 6
_TETRAHEDRA = ((_A, _B, _C, _F), (_A, _C, _D, _H), (_A, _E, _F, _H), (_C, _F, _G, _H),
               (_A, _C, _F, _H))  # fmt: skip
# Shares down to this far below 0 are rounding error.
_ROUNDING = 1e-9
# Lattice cell in which colours are merged, relative to white; far below a visible difference.
_CELL = 1e-3
# A tetrahedron flatter than this, relative to its edges, has no reliable interior.
_FLATTEST = 1e-12
# Range of greys safely between black and white.
_GREYS = (1e-3, 0.98)
# Distances in memory at a time: 32 MB.
_AT_ONCE = 4_000_000


def select_distinct(points: Array) -> Indices:
    """Return the rows of the first base colour in every cell of a fine lattice, increasing.

    ``points`` (K, 3) are relative to white. Clusters of nearly equal colours, such as near black,
    which high powers of dark paints approach, make flat tetrahedra of dissimilar spectra, on which
    the triangulation breaks down.
    """
    _, first = np.unique(np.floor(points / _CELL), axis=0, return_index=True)
    return np.sort(first)


@dataclass(frozen=True, slots=True, eq=False)
class Tetrahedra:
    """Tetrahedra between base colours."""

    points: Array  # (K, 3) the colours
    # None if there are no tetrahedra: with one or two wavelengths all colours lie in a plane.
    delaunay: Any | None
    planes: Array  # (F, 4) of the hull: n . P + d, above 0 outside

    @classmethod
    def of(cls, points: Array) -> Tetrahedra:
        """Triangulate base colours."""
        from scipy.spatial import ConvexHull, Delaunay, QhullError

        try:
            delaunay, planes = Delaunay(points), ConvexHull(points).equations
        except QhullError:
            return cls(points, None, np.empty((0, 4)))
        # About 15,000 factorisations of 3 x 3, at each of which threads would wait for each other.
        with threadpool_limits(1):
            _ = delaunay.transform  # computed once, on first use
        return cls(points, delaunay, planes)


def locate_tetrahedra(mesh: Tetrahedra, XYZ: Array) -> Surrounded:
    """Find the Delaunay tetrahedron around every colour (n, 3), in one walk through the mesh.

    Weights are at least 0 and sum to 1; outside of the hull, vertices are -1 and weights 0.
    """
    delaunay = mesh.delaunay
    if delaunay is None:
        return np.full((len(XYZ), 4), -1, dtype=np.intp), np.zeros((len(XYZ), 4))
    simplex = delaunay.find_simplex(XYZ, tol=_ROUNDING)
    affine = delaunay.transform[simplex]
    three = np.einsum("nij,nj->ni", affine[:, :3], XYZ - affine[:, 3])
    weights = np.concatenate([three, 1.0 - three.sum(1, keepdims=True)], axis=1)
    # Tetrahedra without volume have no affine map.
    inside = (simplex >= 0) & np.isfinite(weights).all(1)
    vertices = np.where(inside[:, None], delaunay.simplices[simplex], -1).astype(np.intp)
    return vertices, np.where(inside[:, None], np.maximum(weights, 0.0), 0.0)


def clip_to_hull(mesh: Tetrahedra, XYZ: Array) -> Array:
    """Return the points (n, 3), just inside, at which lines from grey leave the hull.

    Each line runs from the grey with a colour's Y to the colour, which is relative to white; the
    mesh contains black and white.
    """
    on_edge = np.empty_like(XYZ)
    rows = max(1, _AT_ONCE // max(len(mesh.planes), 1))
    for start in range(0, len(XYZ), rows):
        part = slice(start, start + rows)
        grey = np.repeat(np.clip(XYZ[part, 1:2], *_GREYS), 3, axis=1)
        direction = XYZ[part] - grey
        room = -(grey @ mesh.planes[:, :3].T + mesh.planes[:, 3])
        speed = direction @ mesh.planes[:, :3].T
        # The line ends at the first plane that it meets.
        reach = np.where(speed > 0, room / np.where(speed > 0, speed, 1.0), np.inf)
        fraction = np.clip(reach.min(1, initial=1.0), 0.0, 1.0) * (1.0 - _ROUNDING)
        on_edge[part] = grey + fraction[:, None] * direction
    return on_edge


def search_octants(points: Array, XYZ: Array) -> Surrounded:
    """Search as in the paper: nearest base colour in each octant, first tetrahedron around P.

    Returns arrays as `locate_tetrahedra`; vertices are -1 if an octant that a tetrahedron needs is
    empty, or none of the five contains P, which happens even inside of the hull.
    """
    vertices = np.full((len(XYZ), 4), -1, dtype=np.intp)
    weights = np.zeros((len(XYZ), 4))
    rows = max(1, _AT_ONCE // len(points))
    with threadpool_limits(1):
        for start in range(0, len(XYZ), rows):
            part = slice(start, start + rows)
            vertices[part], weights[part] = _octants(points, XYZ[part])
    return vertices, weights


def _octants(points: Array, XYZ: Array) -> Surrounded:
    offsets = points[None] - XYZ[:, None]
    octant = ((offsets >= 0) * np.array([1, 2, 4])).sum(-1)
    distance = np.einsum("nki,nki->nk", offsets, offsets)
    near = np.empty((len(XYZ), 8), dtype=np.intp)
    occupied = np.empty((len(XYZ), 8), dtype=bool)
    for code in range(8):
        in_octant = np.where(octant == code, distance, np.inf)
        near[:, code] = in_octant.argmin(1)
        occupied[:, code] = np.isfinite(in_octant.min(1))
    vertices = np.full((len(XYZ), 4), -1, dtype=np.intp)
    weights = np.zeros((len(XYZ), 4))
    open_ = np.ones(len(XYZ), dtype=bool)
    for corners in _TETRAHEDRA:
        candidates = near[:, corners]
        inside, corner_weights = _barycentric(points[candidates], XYZ)
        hit = open_ & inside & occupied[:, corners].all(1)
        vertices[hit], weights[hit] = candidates[hit], corner_weights[hit]
        open_ &= ~hit
    return vertices, weights


def _barycentric(corners: Array, XYZ: Array) -> tuple[NDArray[np.bool_], Array]:
    """Test whether tetrahedra (n, 4, 3) contain points (n, 3); return also the corners' weights."""
    edges = np.swapaxes(corners[:, :3] - corners[:, 3:], 1, 2)
    size = np.linalg.norm(edges, axis=1).prod(1)
    solid = np.abs(np.linalg.det(edges)) > _FLATTEST * np.maximum(size, 1e-300)
    edges = np.where(solid[:, None, None], edges, np.eye(3))
    three = np.linalg.solve(edges, (XYZ - corners[:, 3])[..., None])[..., 0]
    weights = np.concatenate([three, 1.0 - three.sum(1, keepdims=True)], axis=1)
    return solid & (weights >= -_ROUNDING).all(1), np.maximum(weights, 0.0)


# XYZ / 100. The solver meets constraints to 1e-9; a colour missed by more is outside of the solid.
_REACHED = 1e-6
_TOLERANCE = 1e-10
# Weight of smoothness if the colour is unreachable: it only breaks ties.
_TIES = 1e-7


def smoothest_reflectances(
    XYZ: Array,
    Q: Array,
    start: Array | None = None,
    progress: Callable[[float], None] | None = None,
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the smoothest reflectances: min |D2 (x - start)|^2, Q x = XYZ, 0 <= x <= 1.

    ``XYZ`` (n, 3) have Y = 100 for white; ``Q`` (3, N) maps reflectances to XYZ, including the
    light. The difference from ``start`` (n, N), by default flat, is smooth. Returns (n, N) values,
    and (n,) False if no reflectance has the colour: the values then have the nearest colour, in
    X/X_n, Y/Y_n, Z/Z_n.
    """
    solve = _smoothest_solver(Q / 100.0)
    values = np.empty((len(XYZ), Q.shape[1]))
    reached = np.ones(len(XYZ), dtype=bool)
    for row, colour in enumerate(XYZ / 100.0):
        x = solve(colour, None if start is None else start[row])
        if np.abs(Q @ x / 100.0 - colour).max() > _REACHED:
            x = _nearest(Q, 100.0 * colour)
            reached[row] = np.abs(Q @ x / 100.0 - colour).max() <= _REACHED
        values[row] = x
        if progress is not None and (row % 64 == 63 or row + 1 == len(XYZ)):
            progress((row + 1) / len(XYZ))
    return values, reached


def _second_differences(size: int) -> Array:
    return np.diff(np.eye(size), 2, axis=0) if size > 2 else np.diff(np.eye(size), axis=0)


def _smoothest_solver(Q: Array) -> Callable[[Array, Array | None], Array]:
    """Make one interior-point solver for all colours: only ``q`` and ``b`` change."""
    N = Q.shape[1]
    D = _second_differences(N)
    P, q = 2.0 * D.T @ D, np.zeros(N)
    solver, b = _solver(P, q, Q)

    def solve(colour: Array, start: Array | None) -> Array:
        b[:3] = colour
        solver.update(q=q if start is None else -P @ start, b=b)
        return np.clip(solver.solve().x, 0.0, 1.0)

    return solve


def _nearest(Q: Array, colour: Array) -> Array:
    """Minimise |(Q x - colour) / white|^2 within 0 to 1."""
    white = Q.sum(1)
    rows, target = Q / white[:, None], colour / white
    D = _second_differences(Q.shape[1])
    solver, _ = _solver(2.0 * (rows.T @ rows + _TIES * D.T @ D), -2.0 * rows.T @ target, None)
    return np.clip(solver.solve().x, 0.0, 1.0)


def _solver(P: Array, q: Array, equal: Array | None) -> tuple[Any, Array]:
    """Return a clarabel solver of min x'Px/2 + q'x within 0 to 1, and its right-hand side."""
    import clarabel
    from scipy.sparse import csc_matrix

    N = len(P)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False  # presolve would rule out a new right-hand side
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = _TOLERANCE
    rows = [-np.eye(N), np.eye(N)]
    b = np.concatenate([np.zeros(N), np.ones(N)])
    cones = [clarabel.NonnegativeConeT(2 * N)]
    if equal is not None:
        rows.insert(0, equal)
        b = np.concatenate([np.zeros(len(equal)), b])
        cones.insert(0, clarabel.ZeroConeT(len(equal)))
    A = csc_matrix(np.vstack(rows))
    return clarabel.DefaultSolver(csc_matrix(np.triu(P)), q, A, b, cones, settings), b
