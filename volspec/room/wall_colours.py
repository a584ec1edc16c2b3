"""A room as it is seen behind a volume: coefficients of what its surfaces send, by light.

RoomResponse, rays of a camera -> [backdrop] -> weights of vertices, their coefficients

Under light l alone, with 1 in each band, a surface sends ρ R_l + [it is l], R_l its irradiance: a
reflectance, as far as the raycaster's picture is concerned. The picture therefore survives every
change of the lights' spectra. Light is interpolated between vertices: of the patches, where it is
indirect, and of smaller triangles, where it comes from panels. Lamps and the sun are found at
each point that is seen, as their shadows have sharp edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack, vstack

from volspec.basis import SpectralBasis
from volspec.room.direct_light import beam_irradiance, panel_irradiance
from volspec.room.form_factors import Rays
from volspec.room.mesh import RoomMesh
from volspec.room.model import Room
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
class WallHits:
    """Points of a room that K rays see first.

    Attributes
    ----------
    weights : (K, V) sparse array
        Of the vertices; a row of zeros where a ray sees nothing.
    surface : (K,) array of int
        Index of each point's surface; -1 where a ray sees nothing.
    points_m, normals : (K, 3) arrays
    direct : (K, L) array
        What comes from each light without any reflection, per unit of its spectrum.
    """

    weights: csr_array
    surface: Index
    points_m: Array
    normals: Array
    direct: Array

    def joined(self, other: WallHits) -> WallHits:
        """Return the points of both."""
        return WallHits(
            vstack([self.weights, other.weights], format="csr"),
            *(
                np.concatenate([getattr(half, name) for half in (self, other)])
                for name in ("surface", "points_m", "normals", "direct")
            ),
        )

    def rows(self, light: int, surfaces: int, shaded: Array) -> csr_array:
        """Return weights (K, V + S) of the `room_colours` of a light, a part (K,) of which is lost.

        Only light that comes directly from it can be lost.
        """
        hit = self.surface >= 0
        direct = self.direct[:, light] * (1.0 - shaded)
        ends = np.concatenate([[0], np.cumsum(hit)]).astype(np.int32)
        columns, shape = self.surface[hit].astype(np.int32), (len(hit), surfaces)
        first_order = csr_array((np.float32(direct[hit]), columns, ends), shape=shape)
        return hstack([self.weights, first_order], format="csr")


@dataclass(frozen=True, slots=True, eq=False)
class LitMesh:
    """Triangles to see a room by, and the light on their V vertices.

    Attributes
    ----------
    room : Room
    rays : Rays
        Of the triangles.
    vertices : (T, 3) array of int
        Of each triangle.
    surface : (V,) array of int
        Index of each vertex's surface.
    patches : (V, N) sparse array
        Weights of the N patches' indirect light.
    panels : (L, V) array
        What comes from each panel without any reflection, as in `RoomResponse`.
    """

    room: Room
    rays: Rays
    vertices: Index
    surface: Index
    patches: csr_array
    panels: Array

    @classmethod
    def of(cls, response: RoomResponse) -> LitMesh:
        """Halve the patches where light of panels is uneven; paints do not matter."""
        solved = response.solved
        mesh, parents, light = solved.mesh, np.arange(len(solved.mesh.surface)), _Panels(response)
        irradiance = light.on_corners(mesh)  # (L, N, 3)
        for _ in range(_ROUNDS):
            left = _FINER * len(solved.mesh.surface) - len(mesh.surface)
            error = light.spread(irradiance) * mesh.areas_m2
            if left <= 0 or not error.any():
                break
            selected = error > 0.0
            selected[np.argsort(error)[: -max(left // _A_ROUND, 1)]] = False
            mesh, counts = mesh.split(selected), np.where(selected, 2, 1)
            new = np.repeat(selected, counts)
            parents, irradiance = np.repeat(parents, counts), np.repeat(irradiance, counts, axis=1)
            irradiance[:, new] = light.on_corners(mesh.part(new))
        vertices = vertices_by_side(mesh)
        first = np.unique(vertices, return_index=True)[1]  # a corner of each vertex
        points, triangles = mesh.corners_m.reshape(-1, 3)[first], first // 3
        weights = barycentric(solved.mesh, parents[triangles], points)
        coarse = vertices_by_side(solved.mesh)
        between = _rows(coarse[parents[triangles]], weights, int(coarse.max()) + 1)
        return cls(
            solved.room,
            Rays(mesh),
            vertices,
            mesh.surface[triangles],
            csr_array(between @ _around(coarse, solved.mesh.areas_m2)),
            irradiance.reshape(len(irradiance), -1)[:, first],
        )

    def trace(self, origins_m: Array, directions: Array) -> WallHits:
        """Return what K rays see first; backs are invisible, as if the eye were inside."""
        mesh = self.rays.mesh
        normals, corners = mesh.normals, mesh.corners_m
        hit = np.full(len(directions), -1)
        starts, going = origins_m.copy(), np.arange(len(directions))
        for _ in range(_BACKS):
            first = self.rays.first(starts[going], directions[going])
            going, first = going[first >= 0], first[first >= 0]
            slope = np.einsum("kc,kc->k", directions[going], normals[first])
            hit[going[slope < 0]] = first[slope < 0]
            going, first, slope = going[slope >= 0], first[slope >= 0], slope[slope >= 0]
            if not len(going):
                break
            t = np.einsum("kc,kc->k", corners[first, 0] - starts[going], normals[first])
            t = t / np.maximum(slope, 1e-9) + self.rays.offset
            starts[going] += t[:, None] * directions[going]
        hits = np.flatnonzero(hit >= 0)
        triangle = hit[hits]
        slope = np.einsum("kc,kc->k", directions[hits], normals[triangle])
        t = np.einsum("kc,kc->k", corners[triangle, 0] - starts[hits], normals[triangle]) / slope
        points = starts[hits] + t[:, None] * directions[hits]
        columns = self.vertices[triangle].astype(np.int32)
        coordinates = barycentric(mesh, triangle, points).astype(np.float32)
        weights = _rows(columns, coordinates, len(self.surface), hit >= 0)
        direct = np.asarray(weights @ self.panels.T)
        direct[hits] += beam_irradiance(self.room, self.rays, points, normals[triangle]).T
        surface, (xyz, across) = np.full(len(hit), -1), np.zeros((2, len(hit), 3))
        surface[hits], xyz[hits], across[hits] = mesh.surface[triangle], points, normals[triangle]
        return WallHits(weights, surface, xyz, across, direct)


class _Panels:
    """Direct light of panels on vertices, and how uneven it is."""

    def __init__(self, response: RoomResponse) -> None:
        room = response.solved.room
        self._rooms = [room.alone(name) for name in response.names]
        self._lux = lux_from_irradiance(np.array([*room.lights.values()]), room.grid)
        self._rays = Rays(room.mesh)

    def on_corners(self, mesh: RoomMesh) -> Array:
        """Return the light (L, T, 3) on the corners of triangles."""
        vertices = vertices_by_side(mesh)
        first = np.unique(vertices, return_index=True)[1]
        normals = mesh.normals[first // 3]
        # In the corner of two walls, each would hide the lamp from the other.
        inwards = _INWARDS * (mesh.centres_m[:, None] - mesh.corners_m)
        points = (mesh.corners_m + inwards).reshape(-1, 3)[first]
        light = []
        for room in self._rooms:
            emitters = int(np.asarray(room.emission.any(axis=1))[room.mesh.surface].sum())
            count = _SHADOWS * max(emitters, 1) * len(points)
            irradiance = panel_irradiance(room, self._rays, points, normals, count)
            light.append(irradiance[:, 0][vertices])
        return np.array(light)

    def spread(self, light: Array) -> Array:
        """Return the range (T,) of the lights' lux within triangles."""
        lux = np.einsum("ltk,l->tk", light, self._lux)
        return np.ptp(lux, axis=1)


def _rows(
    columns: NDArray[Any],
    weights: NDArray[Any],
    count: int,
    mask: NDArray[np.bool_] | None = None,
) -> csr_array:
    """Return (K, count) weights, three in each row of the mask, none in the others."""
    filled = np.ones(len(columns), np.bool_) if mask is None else mask
    ends = np.concatenate([[0], np.cumsum(np.where(filled, 3, 0))]).astype(columns.dtype)
    return csr_array((weights.ravel(), columns.ravel(), ends), shape=(len(filled), count))


def _around(vertices: Index, areas_m2: Array) -> csr_array:
    """Return (V, N) weights: the mean over the patches around each vertex, by area."""
    patch = np.repeat(np.arange(len(vertices)), 3)
    shape = int(vertices.max()) + 1, len(vertices)
    weights = csr_array((areas_m2[patch], (vertices.ravel(), patch)), shape=shape)
    total = np.asarray(weights.sum(axis=1)).ravel()
    return csr_array(weights.multiply(1.0 / total[:, None]))


def room_colours(
    response: RoomResponse, basis: SpectralBasis, parts: Array, mesh: LitMesh
) -> NDArray[np.float32]:
    """Return coefficients (L, V + S, M) of what a room sends to the eye under each light.

    From the vertices: reflected light of other surfaces, and what they emit. From the surfaces:
    what they send in a direct light of 1. All times (L,) ``parts``.
    """
    solved, layers = response.solved, []
    paints = basis.analyse(solved.room.reflectances)
    for number, name in enumerate(response.names):
        indirect = response.irradiance[number] - response.direct[number][:, None]
        sent = mesh.patches @ basis.analyse(solved.reflectances * indirect)
        if name in solved.room.exitances:
            sent[mesh.surface == solved.mesh.names.index(name)] += basis.white
        layers.append(parts[number] * np.concatenate([sent, paints]))
    return np.array(layers, np.float32)
