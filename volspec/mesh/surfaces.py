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
from volspec.mesh.shading import Seen
from volspec.raycast.launch import FAR

Array = NDArray[np.float64]
# Translucent surfaces behind each other.
MAX_SHEETS = 16


def same_surfaces(meshes: Sequence[Mesh], others: Sequence[Mesh]) -> bool:
    """Return True if meshes differ at most in their looks."""
    return len(meshes) == len(others) and all(map(Mesh.has_surface_of, meshes, others))


class Surfaces:
    """Some of the meshes, and what rays see of them; ``numbers`` are theirs among all.

    Rays of one of ``like`` are used again if those are the same surfaces.
    """

    rays: TriangleRays

    def __init__(
        self, meshes: Sequence[Mesh], numbers: Sequence[int], like: Sequence[Surfaces] = ()
    ) -> None:
        self.meshes, self.numbers = meshes, numbers
        self._ends = np.cumsum([len(meshes[k].triangles) for k in numbers])
        for each in like:
            if same_surfaces(self._own(), each._own()):
                self.rays = each.rays
                return
        corners = [meshes[k].points_mm[meshes[k].triangles] for k in numbers]
        self.rays = TriangleRays(np.concatenate(corners), "meshes", "use another system")

    def _own(self) -> list[Mesh]:
        return [self.meshes[number] for number in self.numbers]

    def first(self, origins: Array, directions: Array) -> Seen:
        """Return what rays see first."""
        hits = self.rays.hits(origins, directions)
        count = len(directions)
        points, normals = np.zeros((2, count, 3))
        part = np.searchsorted(self._ends, hits.triangle, "right")
        found = np.full(count, -1)
        for place, number in enumerate(self.numbers):
            mesh = self.meshes[number]
            rows = np.flatnonzero((part == place) & (hits.triangle >= 0))
            found[rows] = number
            hits.triangle[rows] -= self._ends[place] - len(mesh.triangles)
            corners, shares = mesh.triangles[hits.triangle[rows]], hits.shares[rows]
            points[rows] = origins[rows] + hits.along[rows, None] * directions[rows]
            flat = hits.across[rows]
            normals[rows] = _facing(mesh, corners, shares, flat, directions[rows])
        return Seen(hits.along, points, normals, directions, found, hits.triangle, hits.shares)

    def sheets(self, origins: Array, directions: Array) -> Iterator[Seen]:
        """Yield what rays see first, then second, until nothing is left."""
        along = np.zeros(len(directions))
        while True:
            # A ray that has seen all goes on from far behind.
            start = np.minimum(along, FAR)
            seen = self.first(origins + start[:, None] * directions, directions)
            if not (seen.mesh >= 0).any():
                return
            seen = replace(seen, along_mm=seen.along_mm + along)
            yield seen
            along = seen.along_mm + self.rays.offset

    def passed(self, starts: Array, ends: Array) -> Array:
        """Return the part (K,) of light that passes between two points."""
        way = ends - starts
        length = np.linalg.norm(way, axis=1)
        opacity = np.array([*(mesh.opacity for mesh in self.meshes), 0.0])
        found = np.ones(len(way))
        directions = way / np.maximum(length, 1e-30)[:, None]
        for seen in islice(self.sheets(starts, directions), MAX_SHEETS):
            between = seen.along_mm < length - self.rays.offset
            if not between.any():
                break
            found *= 1.0 - opacity[seen.mesh] * between
        return found


def passed(
    opaque: Surfaces | None, translucent: Surfaces | None, starts: Array, ends: Array
) -> Array:
    """Return the part (K,) of light that meshes let pass between points (K, 3) in mm."""
    found = np.ones(len(starts))
    if opaque is not None:
        found *= opaque.rays.clear(starts, ends)
    if translucent is not None:
        found *= translucent.passed(starts, ends)
    return found


def _facing(
    mesh: Mesh, corners: NDArray[np.intp], shares: Array, flat: Array, ways: Array
) -> Array:
    """Return unit normals (K, 3) at points of triangles, towards the eye; ``flat`` are theirs."""
    found = flat
    if mesh.normals is not None:
        found = np.einsum("ki,kic->kc", shares, mesh.normals[corners])
        # Files may wind their triangles the other way.
        found = np.where(np.einsum("kc,kc->k", found, flat)[:, None] < 0.0, -found, found)
    found = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)
    away = np.einsum("kc,kc->k", flat, ways) > 0.0
    return np.where(away[:, None], -found, found)
