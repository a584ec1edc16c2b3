"""Light at points of meshes, by light group: Lambert, Blinn and Phong, gratings, shadows.

points, lights -> [shading] -> factors of the material, what is added -> caster
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from volspec._triangles import cosine_directions
from volspec.basis import Basis, SpectralBasis
from volspec.camera import Camera
from volspec.mesh.grating import Grating
from volspec.raycast import Ambient, Directional, Point, RaycastSpec, Source, lamp_points
from volspec.raycast.launch import (
    FAR,
    Transmittance,
    Visibility,
    numbered_sources,
    source_at,
)

Array = NDArray[np.float64]
# Rays of ambient occlusion from each point, and where some of them are closed: a step of one in 32
# would be seen as a band. Without a radius they reach this part of the meshes.
_RAYS, _MORE_RAYS, _REACH = 32, 128, 0.1
# To a lamp that is partly hidden: within a fiftieth for a straight edge.
_LAMP_RAYS = 256


@dataclass(frozen=True, slots=True, eq=False)
class MeshHits:
    """Points of meshes that K rays see; rows of rays that see nothing are 0."""

    along_mm: Array  # (K,); inf for nothing
    points_mm: Array  # (K, 3)
    normals: Array  # (K, 3), towards the eye
    directions: Array  # (K, 3)
    mesh: NDArray[np.intp]  # (K,); -1 for nothing
    triangle: NDArray[np.intp]  # (K,), of the mesh
    weights: Array  # (K, 3) of the triangle's corners

    def rows(self, rows: NDArray[np.intp] | slice) -> MeshHits:
        """Return some of the points."""
        return MeshHits(*(getattr(self, name)[rows] for name in MeshHits.__slots__))

    @classmethod
    def join(cls, parts: Sequence[MeshHits]) -> MeshHits:
        """Return the points of several, in order."""
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__slots__)
        )

    @classmethod
    def nothing(cls, directions: Array) -> MeshHits:
        """Return what rays (K, 3) see where there is no mesh."""
        count, zeros = len(directions), np.zeros((len(directions), 3))
        none = np.full(count, -1)
        return cls(np.full(count, np.inf), zeros, zeros, directions, none, none, zeros)


@dataclass(frozen=True, slots=True, eq=False)
class Shading:
    """Light that K points reflect."""

    factor: Array  # (K, L) of the material
    added: Array  # (K, L, M): highlights, and what gratings diffract
    sees: NDArray[np.bool_]  # (K, S): no mesh is before a source


@dataclass(frozen=True, eq=False)
class Lighting:
    """The lights of a cast, and what is before them.

    ``arrives`` is what a volume lets pass of a source's light, by number; ``clear`` what meshes
    let pass; ``extent_mm`` the meshes' size.
    """

    camera: Camera
    spec: RaycastSpec
    arrives: Mapping[int, Transmittance]
    clear: Visibility
    extent_mm: float
    basis: Basis

    @cached_property
    def sources(self) -> list[tuple[int, Source]]:
        """Every source with its group's number."""
        return numbered_sources(self.spec)

    def shade(self, view: MeshHits, raised: Array, grating: Grating | None) -> Shading:
        """Return the light that points reflect; ``raised`` (K, 3) is in front of the surface."""
        spec = self.spec
        count, groups = len(raised), len(spec.groups)
        factor = np.zeros((count, groups))
        added = np.zeros((count, groups, self.basis.size))
        sees = np.ones((count, len(self.sources)), np.bool_)
        for number, (group, source) in enumerate(self.sources):
            towards, light = source_at(self.camera, source, view.points_mm, view.directions)
            if number in self.arrives:
                light = light * self.arrives[number](view.points_mm)
            if isinstance(source, Ambient):
                if source.occlusion:
                    light = light * self._open(raised, view.normals, source.radius_mm)
                factor[:, group] += light * spec.ambient
                continue
            cosine = np.einsum("kc,kc->k", view.normals, towards)
            if isinstance(source, Directional | Point) and source.shadows:
                # In front of the side that faces the source.
                side = np.where(cosine < 0.0, -1.0, 1.0)[:, None]
                start = view.points_mm + side * (raised - view.points_mm)
                passed = self._passed(start, towards, source)
                sees[:, number] = passed > 0.0
                light = light * passed
            if not spec.shaded:
                factor[:, group] += light * spec.diffuse
                continue
            # Two-sided, as isosurfaces are.
            diffuse = light * spec.diffuse * np.abs(cosine)
            factor[:, group] += diffuse
            half = towards - view.directions
            half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-6)
            n_dot_h = np.minimum(np.abs(np.einsum("kc,kc->k", view.normals, half)), 1.0)
            shine = light * spec.specular * n_dot_h**spec.shininess
            added[:, group] += shine[:, None] * self.basis.white
            if grating is not None:
                assert isinstance(self.basis, SpectralBasis)
                q = towards - view.directions
                rows, reflected = grating.reflectance(
                    self.basis.grid, view.points_mm, view.normals, q
                )
                front = np.where(cosine[rows] > 0.0, diffuse[rows], 0.0)[:, None]
                added[rows, group] += front * self.basis.analyse(reflected)
        return Shading(factor, added, sees)

    def _passed(self, points: Array, towards: Array, source: Directional | Point) -> Array:
        """Return the part (K,) of a source's light that meshes let pass."""
        if not isinstance(source, Point):
            return self.clear(points, points + FAR * towards)
        place = self.camera.place_mm(source.position_mm, source.frame)
        if source.radius_mm is None:
            return self.clear(points, np.broadcast_to(place, towards.shape))

        radius = source.radius_mm

        def fraction(points: Array, count: int, rim: int = 0) -> Array:
            lamps = lamp_points(place, radius, points, count, rim)
            return np.asarray(sum(self.clear(points, lamp) for lamp in lamps)) / (count + rim)

        # Where the rim is seen whole, and some of the disc, so is all of it.
        passed = fraction(points, _RAYS // 2, _RAYS)
        partly = (passed > 0.0) & (passed < 1.0)
        passed[partly] = fraction(points[partly], _LAMP_RAYS)
        return passed

    def _open(self, points: Array, normals: Array, radius_mm: float | None) -> Array:
        """Return the part (K,) of the hemisphere, by its cosine, that no mesh closes."""
        radius = radius_mm or self.extent_mm * _REACH
        fraction = self._passing(points, normals, radius, _RAYS)
        partly = (fraction > 0.0) & (fraction < 1.0)
        fraction[partly] = self._passing(points[partly], normals[partly], radius, _MORE_RAYS)
        return fraction

    def _passing(self, points: Array, normals: Array, radius: float, rays: int) -> Array:
        """Return the part (K,) of rays, in a spiral of the golden angle, that no mesh closes."""
        total = np.zeros(len(points))
        for k in range(rays):
            uv = np.array([[(k + 0.5) / rays, k * (np.sqrt(5.0) - 1.0) / 2.0]])
            ways = cosine_directions(normals, uv)
            total += self.clear(points, points + radius * ways)
        return total / rays
