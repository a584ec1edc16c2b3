"""A room as it is seen behind a volume, with the volume's shadows on it.

    RoomResponse, camera, opacity -> [backdrop] -> (H, W, L·M), layers of the room's lights

A shadow is a mean over points of a light: of what a cast from there lets pass, which is looked up
where a pixel's surface is seen from the light (shadow maps [1]). Only light that comes directly
from a light is taken away.

References
----------
[1] Williams (1978), "Casting curved shadows on curved surfaces", SIGGRAPH.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from volspec.basis import SpectralBasis
from volspec.pipeline import OpacityCaster
from volspec.raycast import Camera
from volspec.raycast.camera import level_axes
from volspec.raycast.projection import Projection
from volspec.raycast.sampling import world_rays
from volspec.room.backdrop import LitMesh, VertexColours
from volspec.room.form_factors import frames, sobol
from volspec.room.response import RoomResponse
from volspec.settings import Vector

Array = NDArray[np.float64]
Size = tuple[int, int]
# Points of a light from which shadows are cast, and the sides of a shadow map in pixels.
_POINTS, _MAP = 16, 96
# A shadow map's field of view is a little larger than the volume, and never larger than this.
_MARGIN, _WIDEST_DEG = 1.05, 150.0
# A light nearer to the middle than this part of the volume's radius casts no shadow.
_NEAREST = 0.1


@dataclass(frozen=True, slots=True)
class Placement:
    """Directions and places of a volume's world in a room.

    Rows of ``axes`` are the room's x, y and z in the volume's world.
    """

    axes: Array  # (3, 3)
    position_m: Array  # (3,), of the volume's middle
    metres_per_mm: float

    @classmethod
    def of(cls, position_m: Vector, scale: float, turn_deg: float, up: Vector) -> Placement:
        """Return the placement of a volume whose ``up`` is vertical."""
        side, front, axis = level_axes(up)
        level = np.stack([side, -front, axis])
        turn = math.radians(turn_deg)
        rotation = np.array(
            [
                [math.cos(turn), -math.sin(turn), 0.0],
                [math.sin(turn), math.cos(turn), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        return cls(rotation @ level, np.array(position_m), 1e-3 * scale)


@dataclass(frozen=True, slots=True, eq=False)
class ShadowMap:
    """Opacity of the volume as a point of a light sees it."""

    projection: Projection  # from the volume's world to the map's pixels
    normal: Array | None  # (3,) of the light's surface; None if it has none
    alpha: Array  # (_MAP + 1, _MAP + 1), its last row and column 0
    depth_mm: Array  # the same, of expected distances from the light

    @classmethod
    def of(cls, camera: Camera, normal: Array | None, opacity: OpacityCaster) -> ShadowMap:
        """Cast the opacity from a light."""
        alpha, depth_mm = np.zeros((2, _MAP + 1, _MAP + 1))
        alpha[:-1, :-1], depth_mm[:-1, :-1] = opacity(camera, (_MAP, _MAP))
        return cls(Projection(camera, (0.0, 0.0, _MAP, _MAP)), normal, alpha, depth_mm)

    def weight(self, points_mm: Array, normals: Array) -> Array:
        """Return the light (K,) that surfaces at points would get; 1 if its source is small."""
        if self.normal is None:
            return np.ones(len(points_mm))
        way = np.asarray(self.projection.camera.position_mm) - points_mm
        cosines = np.einsum("kc,kc->k", way, normals), way @ -self.normal
        falls, leaves = (np.maximum(each, 0.0) for each in cosines)
        return falls * leaves / np.einsum("kc,kc->k", way, way) ** 2

    def shadow(self, points_mm: Array) -> Array:
        """Return the part (K,) of the light that the volume takes from points behind it."""
        camera = self.projection.camera
        away = points_mm - camera.position_mm
        along = np.linalg.norm(away, axis=1)
        if camera.height_mm is not None:
            along = away @ camera.frame()[2]
        x, y, depth = self.projection.to_window(points_mm).T
        x, y = x - 0.5, y - 0.5
        # Around the map, nothing is in the way.
        inside = (x > -1) & (x < _MAP) & (y > -1) & (y < _MAP) & (depth > 0)
        x, y = np.where(inside, x, -1.0), np.where(inside, y, -1.0)
        column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
        right, down = x - column, y - row
        alpha = self.alpha
        above = (1.0 - right) * alpha[row, column] + right * alpha[row, column + 1]
        below = (1.0 - right) * alpha[row + 1, column] + right * alpha[row + 1, column + 1]
        behind = inside & (along > self.depth_mm[np.maximum(row, 0), np.maximum(column, 0)])
        return np.where(behind, (1.0 - down) * above + down * below, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class SeenRoom:
    """Pixels of a picture as weights of a room's vertices, to see it quickly in other paints."""

    backdrop: Backdrop
    size: Size
    weights: csr_array  # (P, V) of P pixels
    shaded: NDArray[np.intp]  # pixels on which shadows fall,
    shadows: list[csr_array]  # and what they take away of each light

    def layers(self, response: RoomResponse) -> NDArray[np.float32]:
        """Return the layers (H, W, L·M) of the room's lights, as far as they are seen."""
        colours = self.backdrop.colours(response)
        found = self.weights @ colours.all
        direct = np.split(colours.direct, len(self.shadows), axis=1)
        found[self.shaded] -= np.concatenate(
            [taken @ each for taken, each in zip(self.shadows, direct, strict=True)], axis=1
        )
        width, height = self.size
        return np.asarray(found.reshape(height, width, -1))


class Backdrop:
    """The room's picture behind a volume, for any camera.

    Caches what the last camera sees, and the last shadows.
    """

    def __init__(
        self,
        response: RoomResponse,
        placement: Placement,
        basis: SpectralBasis,
        parts: Array,
        middle_mm: Array,
        radius_mm: float,
    ) -> None:
        self.response, self._placement, self._basis = response, placement, basis
        self._parts = parts  # (L,) factors of the layers
        self._middle_mm, self._radius_mm = middle_mm, radius_mm
        self._seen: tuple[tuple[Camera, Size], csr_array, Array] | None = None
        self._maps: tuple[object, list[list[ShadowMap]]] | None = None
        self._shadows: tuple[object, NDArray[np.intp], Array] | None = None

    def repainted(self, response: RoomResponse) -> Backdrop:
        """Return the backdrop of the same room with other paints."""
        colours = self.colours(response)
        made = copy(self)  # with the triangles, which are those of all paints
        made.response, made._colours = response, colours
        return made

    @cached_property
    def _lit(self) -> LitMesh:
        return LitMesh.of(self.response)

    @cached_property
    def _colours(self) -> VertexColours:
        return self.colours(self.response)

    def colours(self, response: RoomResponse) -> VertexColours:
        """Return what vertices send in a room with other paints."""
        return VertexColours.of(response, self._basis, self._parts, self._lit)

    def seen_through(self, transmission: NDArray[np.float32], every: int = 1) -> SeenRoom:
        """Return what every n-th row and column of the last picture shows, through (H, W)."""
        assert self._seen is not None
        _, seen, points = self._seen
        rows, lost = self._shadows_on(self._seen[0], points)
        kept = np.arange(len(points)).reshape(transmission.shape)[::every, ::every]
        size = kept.shape[1], kept.shape[0]
        place = np.full(len(points), -1)
        place[kept.ravel()] = np.arange(kept.size)
        there = place[rows] >= 0
        rows, lost = rows[there], lost[there]
        part = transmission.reshape(-1, 1)
        shadows = [
            csr_array(seen[rows].multiply(part[rows] * each[:, None]), dtype=np.float32)
            for each in lost.T
        ]
        weights = csr_array(seen[kept.ravel()].multiply(part[kept.ravel()]), dtype=np.float32)
        return SeenRoom(self, size, weights, place[rows], shadows)

    def __call__(
        self, camera: Camera, size: tuple[int, int], opacity: OpacityCaster | None = None
    ) -> NDArray[np.float32]:
        """Return (H, W, L·M): the layers of the room's lights, behind those of the volume.

        Without ``opacity``, shadows are those of the last call.
        """
        seen, points = self._look(camera, size)
        found = np.asarray(seen @ self._colours.all)
        if opacity is not None and (self._maps is None or self._maps[0] != opacity.key):
            self._maps = opacity.key, self._cast_shadows(opacity)
        rows, lost = self._shadows_on((camera, size), points)
        direct = seen[rows] @ self._colours.direct
        channels = direct.shape[1] // max(lost.shape[1], 1)
        found[rows] -= np.repeat(lost, channels, axis=1) * direct
        width, height = size
        return found.reshape(height, width, -1)

    def depth_mm(self, camera: Camera, size: tuple[int, int]) -> NDArray[np.float32]:
        """Return (H, W) distances of the room's surfaces, mm of the volume; inf without one."""
        seen, points = self._look(camera, size)
        origins, directions = world_rays(camera, *size)
        along = np.einsum("kc,kc->k", points - origins, directions)
        width, height = size
        there = np.diff(seen.indptr) > 0
        return np.where(there, along, np.inf).astype(np.float32).reshape(height, width)

    def _look(self, camera: Camera, size: tuple[int, int]) -> tuple[csr_array, Array]:
        """Return the weights of the vertices, and the points that pixels see, mm of the volume."""
        if self._seen is None or self._seen[0] != (camera, size):
            seen = self._lit.seen(*self._rays(camera, size))
            inside = (self._lit.points_m - self._placement.position_m) @ self._placement.axes
            points = seen @ (inside / self._placement.metres_per_mm + self._middle_mm)
            self._seen = (camera, size), seen, points
        return self._seen[1:]

    def _rays(self, camera: Camera, size: tuple[int, int]) -> tuple[Array, Array]:
        """Return origins and directions of the pixels' rays, (H·W, 3), in the room."""
        place, (origins, directions) = self._placement, world_rays(camera, *size)
        origins = np.einsum("kc,dc->kd", origins - self._middle_mm, place.axes)
        directions = np.einsum("kc,dc->kd", directions, place.axes)
        return place.metres_per_mm * origins + place.position_m, directions

    def _cast_shadows(self, opacity: OpacityCaster) -> list[list[ShadowMap]]:
        """Return the shadow maps of each of the room's lights."""
        self._shadows = None
        return [
            [ShadowMap.of(camera, normal, opacity) for camera, normal in self._light_points(name)]
            for name in self.response.names
        ]

    def _light_points(self, name: str) -> list[tuple[Camera, Array | None]]:
        """Return cameras at points of a light that look at the volume, and its normals there.

        None at a light that is in the volume.
        """
        room, place = self.response.solved.room, self._placement
        for sun in room.suns:
            if sun.name == name:
                away = np.array(sun.direction) @ place.axes * 4.0 * self._radius_mm
                height_mm = 2.0 * self._radius_mm
                return [(self._light_camera(self._middle_mm + away, height_mm), None)]
        points: list[tuple[Array, Array | None]] = self._emitting_points(name)
        points += [(np.array(lamp.position_m), None) for lamp in room.lamps if lamp.name == name]
        found: list[tuple[Camera, Array | None]] = []
        for at, normal in points:
            way = (at - place.position_m) @ place.axes / place.metres_per_mm
            if np.linalg.norm(way) > _NEAREST * self._radius_mm:
                facing = None if normal is None else normal @ place.axes
                found.append((self._light_camera(way + self._middle_mm), facing))
        return found

    def _emitting_points(self, name: str) -> list[tuple[Array, Array | None]]:
        """Return points of a panel, evenly by area, m, and its normals there."""
        room = self.response.solved.room
        if name not in room.exitances:
            return []
        mesh = room.mesh
        part = mesh.part(mesh.surface == mesh.names.index(name))
        ends = np.cumsum(part.areas_m2) / part.areas_m2.sum()
        shares = sobol(_POINTS, 3, seed=0)
        triangles = np.minimum(np.searchsorted(ends, shares[:, 0]), len(ends) - 1)
        return [
            (part.part(slice(k, k + 1)).points(share[None, 1:])[0, 0], part.normals[k])
            for k, share in zip(triangles.tolist(), shares, strict=True)
        ]

    def _light_camera(self, place_mm: Array, height_mm: float | None = None) -> Camera:
        way = self._middle_mm - place_mm
        distance = float(np.linalg.norm(way))
        across, _ = frames(way / distance)
        half = math.asin(min(self._radius_mm * _MARGIN / distance, 1.0))
        fov_deg = min(2.0 * math.degrees(half), _WIDEST_DEG)
        places = tuple(place_mm.tolist()), tuple(self._middle_mm.tolist())
        return Camera(*places, tuple(across.tolist()), fov_deg, height_mm)

    def _shadows_on(self, view: object, points: Array) -> tuple[NDArray[np.intp], Array]:
        """Return the pixels on which shadows fall, and the part (K, L) of each light they lose."""
        if self._maps is None:
            return np.zeros(0, np.intp), np.zeros((0, len(self.response.names)))
        if self._shadows is None or self._shadows[0] != view:
            assert self._seen is not None
            normals = self._seen[1] @ (self._lit.normals @ self._placement.axes)
            lost = np.zeros((len(points), len(self.response.names)))
            for light, maps in enumerate(self._maps[1]):
                if not maps:
                    continue
                near = self._near_shadow(points, maps)
                there, facing = points[near], normals[near]
                weights = np.array([each.weight(there, facing) for each in maps])
                taken = np.array([each.shadow(there) for each in maps])
                whole = np.maximum(weights.sum(axis=0), 1e-30)
                lost[near, light] = (weights * taken).sum(axis=0) / whole
            rows = np.flatnonzero(lost.any(axis=1))
            self._shadows = view, rows, lost[rows]
        return self._shadows[1:]

    def _near_shadow(self, points: Array, maps: list[ShadowMap]) -> NDArray[np.intp]:
        """Return the points whose light may pass the sphere around the volume."""
        lights = np.array([each.projection.camera.position_mm for each in maps])
        light = lights.mean(axis=0)
        reach = self._radius_mm * _MARGIN + np.linalg.norm(lights - light, axis=1).max()
        way = points - light
        along = (way @ (self._middle_mm - light)) / np.einsum("kc,kc->k", way, way)
        passed = light + np.clip(along, 0.0, 1.0)[:, None] * way - self._middle_mm
        return np.flatnonzero(np.einsum("kc,kc->k", passed, passed) < reach * reach)
