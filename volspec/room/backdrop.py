"""A room as it is seen behind a volume: coefficients of what its surfaces send, by light.

RoomResponse, rays of a camera -> [backdrop] -> weights of vertices, their coefficients

Under light l alone, with 1 in each band, a surface sends ρ R_l + [it is l], R_l its irradiance: a
reflectance, as far as the raycaster's picture is concerned. The picture therefore survives every
change of the lights' spectra. Light is interpolated between vertices: of the patches, where it is
indirect, and of smaller triangles, where shadows end.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from volspec.basis import SpectralBasis
from volspec.room.direct import direct_irradiance
from volspec.room.form_factors import Rays
from volspec.room.mesh import RoomMesh
from volspec.room.quantities import lux_from_irradiance
from volspec.room.response import RoomResponse

Array = NDArray[np.float64]
Index = NDArray[np.intp]
# Surfaces that turn their backs are invisible; a ray passes through so many of them at most.
_BACKS = 8
# Triangles of one surface share their vertices' light if their normals differ by less than this.
_SAME_SIDE = 1e-3
# Triangles per patch, rounds that halve those with uneven light, the part of those still to come
# that a round makes, and shadow rays from a vertex to each triangle that emits. They begin this far
# from it towards the triangle's centre.
_FINER, _ROUNDS, _A_ROUND, _SHADOWS, _INWARDS = 5, 12, 3, 64, 0.02


def vertices_by_side(mesh: RoomMesh) -> Index:
    """Return (N, 3) numbers of the corners, equal if two coincide on one side of a surface."""
    cells = np.rint(mesh.normals / _SAME_SIDE).astype(np.int64)
    sides = np.concatenate([mesh.surface[:, None], cells], axis=1)
    side = np.unique(sides, axis=0, return_inverse=True)[1].ravel()
    key = np.stack([mesh.corner_numbers().ravel(), np.repeat(side, 3)], axis=1)
    return np.unique(key, axis=0, return_inverse=True)[1].reshape(-1, 3)


def barycentric(mesh: RoomMesh, triangles: Index, points: Array) -> Array:
    """Return (K, 3) barycentric coordinates of points in triangles, within 0 to 1."""
    a, b, c = (mesh.corners_m[triangles, i] for i in range(3))
    normals = mesh.normals[triangles]
    parts = np.stack(
        [
            np.einsum("kc,kc->k", np.cross(q - p, points - p), normals)
            for p, q in ((b, c), (c, a), (a, b))
        ],
        axis=1,
    )
    parts = np.maximum(parts, 0.0)
    return np.asarray(parts / parts.sum(axis=1, keepdims=True))


@dataclass(frozen=True, slots=True, eq=False)
class LitMesh:
    """Triangles to see a room by, and the light on their V vertices.

    Attributes
    ----------
    rays : Rays
        Of the triangles.
    vertices : (T, 3) array of int
        Of each triangle.
    points_m, normals : (V, 3) arrays
    surface : (V,) array of int
        Index of each vertex's surface.
    patches : (V, N) sparse array
        Weights of the N patches' indirect light.
    direct : (L, V) array
        What comes from each light without any reflection, as in `RoomResponse`.
    """

    rays: Rays
    vertices: Index
    points_m: Array
    normals: Array
    surface: Index
    patches: csr_array
    direct: Array

    @classmethod
    def of(cls, response: RoomResponse) -> LitMesh:
        """Halve the patches where direct light is uneven; paints do not matter."""
        solved = response.solved
        mesh, parents, light = solved.mesh, np.arange(len(solved.mesh.surface)), _Direct(response)
        found = light.at(mesh)  # (L, N, 3)
        for _ in range(_ROUNDS):
            left = _FINER * len(solved.mesh.surface) - len(mesh.surface)
            error = light.spread(found) * mesh.areas_m2
            if left <= 0 or not error.any():
                break
            chosen = error > 0.0
            chosen[np.argsort(error)[: -max(left // _A_ROUND, 1)]] = False
            mesh, counts = mesh.split(chosen), np.where(chosen, 2, 1)
            new = np.repeat(chosen, counts)
            parents, found = np.repeat(parents, counts), np.repeat(found, counts, axis=1)
            found[:, new] = light.at(mesh.part(new))
        vertices = vertices_by_side(mesh)
        first = np.unique(vertices, return_index=True)[1]  # a corner of each vertex
        points, triangles = mesh.corners_m.reshape(-1, 3)[first], first // 3
        weights = barycentric(solved.mesh, parents[triangles], points)
        coarse = vertices_by_side(solved.mesh)
        between = _rows(coarse[parents[triangles]], weights, int(coarse.max()) + 1)
        return cls(
            Rays(mesh),
            vertices,
            points,
            mesh.normals[triangles],
            mesh.surface[triangles],
            csr_array(between @ _around(coarse, solved.mesh.areas_m2)),
            found.reshape(len(found), -1)[:, first],
        )

    def seen(self, origins_m: Array, directions: Array) -> csr_array:
        """Return (K, V) weights of the vertices that K rays see first.

        A ray that sees nothing has a row of zeros; backs are invisible, as if the eye were inside.
        """
        mesh = self.rays.mesh
        normals, corners = mesh.normals, mesh.corners_m
        hit = np.full(len(directions), -1)
        starts, going = origins_m.copy(), np.arange(len(directions))
        for _ in range(_BACKS):
            found = self.rays.first(starts[going], directions[going])
            going, found = going[found >= 0], found[found >= 0]
            slope = np.einsum("kc,kc->k", directions[going], normals[found])
            hit[going[slope < 0]] = found[slope < 0]
            going, found, slope = going[slope >= 0], found[slope >= 0], slope[slope >= 0]
            if not len(going):
                break
            way = np.einsum("kc,kc->k", corners[found, 0] - starts[going], normals[found])
            way = way / np.maximum(slope, 1e-9) + self.rays.offset_m
            starts[going] += way[:, None] * directions[going]
        seen = np.flatnonzero(hit >= 0)
        triangle = hit[seen]
        slope = np.einsum("kc,kc->k", directions[seen], normals[triangle])
        way = np.einsum("kc,kc->k", corners[triangle, 0] - starts[seen], normals[triangle]) / slope
        points = starts[seen] + way[:, None] * directions[seen]
        weights = np.zeros((len(directions), 3), np.float32)
        weights[seen] = barycentric(mesh, triangle, points)
        columns = np.zeros((len(directions), 3), np.int32)
        columns[seen] = self.vertices[triangle]
        return _rows(columns, weights, len(self.points_m), hit >= 0)


class _Direct:
    """Direct light on vertices, and how uneven it is."""

    def __init__(self, response: RoomResponse) -> None:
        room = response.solved.room
        self._rooms = [room.alone(name) for name in response.names]
        self._lux = lux_from_irradiance(np.array([*room.lights.values()]), room.grid)
        self._rays = Rays(room.mesh)

    def at(self, mesh: RoomMesh) -> Array:
        """Return the direct light (L, T, 3) on the corners of triangles."""
        vertices = vertices_by_side(mesh)
        first = np.unique(vertices, return_index=True)[1]
        normals = mesh.normals[first // 3]
        # In the corner of two walls, each would hide the lamp from the other.
        inwards = _INWARDS * (mesh.centres_m[:, None] - mesh.corners_m)
        points = (mesh.corners_m + inwards).reshape(-1, 3)[first]
        found = []
        for room in self._rooms:
            emitters = int(np.asarray(room.emission.any(axis=1))[room.mesh.surface].sum())
            count = _SHADOWS * max(emitters, 1) * len(points)
            lit = direct_irradiance(room, self._rays, points, normals, count)
            found.append(lit[:, 0][vertices])
        return np.array(found)

    def spread(self, light: Array) -> Array:
        """Return the range (T,) of the lights' lux within triangles."""
        lux = np.einsum("ltk,l->tk", light, self._lux)
        return np.ptp(lux, axis=1)


def _rows(
    columns: NDArray[Any],
    weights: NDArray[Any],
    count: int,
    there: NDArray[np.bool_] | None = None,
) -> csr_array:
    """Return (K, count) weights, three in each row; none in rows that are not there."""
    held = np.ones(len(columns), np.bool_) if there is None else there
    ends = np.concatenate([[0], np.cumsum(np.where(held, 3, 0))]).astype(columns.dtype)
    inner = columns[held].ravel()
    return csr_array((weights[held].ravel(), inner, ends), shape=(len(columns), count))


def _around(vertices: Index, areas_m2: Array) -> csr_array:
    """Return (V, N) weights: the mean over the patches around each vertex, by area."""
    patch = np.repeat(np.arange(len(vertices)), 3)
    shape = int(vertices.max()) + 1, len(vertices)
    weights = csr_array((areas_m2[patch], (vertices.ravel(), patch)), shape=shape)
    total = np.asarray(weights.sum(axis=1)).ravel()
    return csr_array(weights.multiply(1.0 / total[:, None]))


@dataclass(frozen=True, slots=True, eq=False)
class VertexColours:
    """Coefficients of what the vertices send to the eye, by light.

    Attributes
    ----------
    all, direct : (V, L·M) float32
        Everything; and the part of it that reflects light that comes directly from lights, which
        what is in the way takes away.
    """

    all: NDArray[np.float32]
    direct: NDArray[np.float32]

    @classmethod
    def of(
        cls, response: RoomResponse, basis: SpectralBasis, parts: Array, lit: LitMesh
    ) -> VertexColours:
        """Compute them, times (L,) ``parts``."""
        solved = response.solved
        own = basis.analyse(solved.room.reflectances)[lit.surface]
        everything, direct = [], []
        for number, name in enumerate(response.names):
            indirect = response.irradiance[number] - response.direct[number][:, None]
            sent = lit.patches @ basis.analyse(solved.reflectances * indirect)
            first = own * lit.direct[number][:, None]
            sent += first
            if name in solved.room.exitances:
                sent[lit.surface == solved.mesh.names.index(name)] += basis.white
            everything.append(parts[number] * sent)
            direct.append(parts[number] * first)
        joined = (np.concatenate(each, axis=1) for each in (everything, direct))
        return cls(*(each.astype(np.float32) for each in joined))
