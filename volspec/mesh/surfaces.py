"""Rays to meshes: what they see first, sheet after sheet, and the light that passes.

meshes, rays -> [surfaces] -> points seen, light between points -> caster
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from volspec._triangles import TriangleRays
from volspec.mesh.model import Mesh
from volspec.mesh.shading import MeshHits
from volspec.raycast.launch import FAR

Array = NDArray[np.float64]
# Translucent surfaces behind each other.
MAX_SHEETS = 16


def same_surfaces(meshes: Sequence[Mesh], other: Sequence[Mesh]) -> bool:
    """Return True if meshes differ at most in their looks."""
    return len(meshes) == len(other) and all(map(Mesh.has_surface_of, meshes, other))


class MeshSurfaces:
    """Some of the meshes, and what rays see of them; ``numbers`` are theirs among all.

    Rays of one of ``previous`` are used again if those are the same surfaces.
    """

    rays: TriangleRays

    def __init__(
        self, meshes: Sequence[Mesh], numbers: Sequence[int], previous: Sequence[MeshSurfaces] = ()
    ) -> None:
        self.meshes, self.numbers = meshes, numbers
        self._ends = np.cumsum([len(meshes[k].triangles) for k in numbers])
        for surfaces in previous:
            if same_surfaces(self._selected(), surfaces._selected()):
                self.rays = surfaces.rays
                return
        corners = [meshes[k].points_mm[meshes[k].triangles] for k in numbers]
        self.rays = TriangleRays(np.concatenate(corners), "meshes", "use another system")

    def _selected(self) -> list[Mesh]:
        return [self.meshes[number] for number in self.numbers]

    def first(self, origins: Array, directions: Array) -> MeshHits:
        """Return what rays see first."""
        hits = self.rays.hits(origins, directions)
        count = len(directions)
        points, normals = np.zeros((2, count, 3))
        part = np.searchsorted(self._ends, hits.triangle, "right")
        numbers = np.full(count, -1)
        for place, number in enumerate(self.numbers):
            mesh = self.meshes[number]
            rows = np.flatnonzero((part == place) & (hits.triangle >= 0))
            numbers[rows] = number
            hits.triangle[rows] -= self._ends[place] - len(mesh.triangles)
            corners, weights = mesh.triangles[hits.triangle[rows]], hits.shares[rows]
            points[rows] = origins[rows] + hits.along[rows, None] * directions[rows]
            flat = hits.across[rows]
            normals[rows] = _shading_normals(mesh, corners, weights, flat, directions[rows])
        return MeshHits(
            hits.along, points, normals, directions, numbers, hits.triangle, hits.shares
        )

    def sheets(self, origins: Array, directions: Array) -> Iterator[MeshHits]:
        """Yield what rays see first, then second, until nothing is left."""
        depth = np.zeros(len(directions))
        while True:
            # A ray that has seen all goes on from far behind.
            start = np.minimum(depth, FAR)
            view = self.first(origins + start[:, None] * directions, directions)
            if not (view.mesh >= 0).any():
                return
            view = replace(view, along_mm=view.along_mm + depth)
            yield view
            depth = view.along_mm + self.rays.offset

    def passed(self, starts: Array, ends: Array) -> Array:
        """Return the part (K,) of light that passes between two points."""
        ray = ends - starts
        length = np.linalg.norm(ray, axis=1)
        opacity = np.array([*(mesh.opacity for mesh in self.meshes), 0.0])
        transmittance = np.ones(len(ray))
        directions = ray / np.maximum(length, 1e-30)[:, None]
        for view in islice(self.sheets(starts, directions), MAX_SHEETS):
            between = view.along_mm < length - self.rays.offset
            if not between.any():
                break
            transmittance *= 1.0 - opacity[view.mesh] * between
        return transmittance


def trace_visibility(
    opaque: MeshSurfaces | None, translucent: MeshSurfaces | None, starts: Array, ends: Array
) -> Array:
    """Return the part (K,) of light that meshes let pass between points (K, 3) in mm."""
    transmittance = np.ones(len(starts))
    if opaque is not None:
        transmittance *= opaque.rays.clear(starts, ends)
    if translucent is not None:
        transmittance *= translucent.passed(starts, ends)
    return transmittance


def _shading_normals(
    mesh: Mesh, corners: NDArray[np.intp], weights: Array, flat: Array, ways: Array
) -> Array:
    """Return unit normals (K, 3) at points of triangles, towards the eye; ``flat`` are theirs."""
    normals = flat
    if mesh.normals is not None:
        normals = np.einsum("ki,kic->kc", weights, mesh.normals[corners])
        # Files may wind their triangles the other way.
        normals = np.where(np.einsum("kc,kc->k", normals, flat)[:, None] < 0.0, -normals, normals)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    back = np.einsum("kc,kc->k", flat, ways) > 0.0
    return np.where(back[:, None], -normals, normals)
