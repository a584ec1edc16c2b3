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
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from volspec._triangles import frames
from volspec.basis import SpectralBasis
from volspec.camera import Camera, Projection, level_axes
from volspec.raycast import (
    OpacityCaster,
    SurfaceCaster,
    SurfaceImage,
    edge_sample_points,
    mean_of_points,
    neighbour_pixels,
)
from volspec.raycast.launch import world_rays
from volspec.room.form_factors import sobol
from volspec.room.response import RoomResponse
from volspec.room.wall_colours import LitMesh, WallHits, room_colours
from volspec.settings import Vector

Array = NDArray[np.float64]
Size = tuple[int, int]
# Points of a light from which shadows are cast, and the sides of a shadow map in pixels.
_POINTS, _MAP = 16, 96
# A shadow map's field of view is a little larger than the volume, and never larger than this.
_MARGIN, _WIDEST_DEG = 1.05, 150.0
# Normals are of one side if they agree to so many parts.
_SAME_SIDE = 1e3
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
        to_light = np.asarray(self.projection.camera.position_mm) - points_mm
        cosines = np.einsum("kc,kc->k", to_light, normals), to_light @ -self.normal
        falls, leaves = (np.maximum(cosine, 0.0) for cosine in cosines)
        return falls * leaves / np.einsum("kc,kc->k", to_light, to_light) ** 2

    def shadow(self, points_mm: Array) -> Array:
        """Return the part (K,) of the light that the volume takes from points behind it."""
        camera = self.projection.camera
        offset = points_mm - camera.position_mm
        distance = np.linalg.norm(offset, axis=1)
        if camera.height_mm is not None:
            distance = offset @ camera.frame()[2]
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
        shaded = inside & (distance > self.depth_mm[np.maximum(row, 0), np.maximum(column, 0)])
        return np.where(shaded, (1.0 - down) * above + down * below, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class SeenRoom:
    """A picture of a room as weights of its colours, to see it quickly in other paints."""

    size: Size
    weights: tuple[csr_array, ...]  # (H·W, V + S) of each light

    def layers(self, colours: NDArray[np.float32]) -> list[NDArray[np.float32]]:
        """Return the layer (H, W, M) of each light; ``colours`` as `room_colours`."""
        width, height = self.size
        layers = (rows @ sent for rows, sent in zip(self.weights, colours, strict=True))
        return [np.asarray(layer).reshape(height, width, -1) for layer in layers]

    def through(self, transmission: NDArray[np.float32], stride: int) -> SeenRoom:
        """Return every n-th row and column, as far as (H, W) ``transmission`` lets them be seen."""
        part = transmission[::stride, ::stride]
        kept = np.arange(transmission.size).reshape(transmission.shape)[::stride, ::stride].ravel()
        weights = (csr_array(rows[kept].multiply(part.reshape(-1, 1))) for rows in self.weights)
        return SeenRoom((part.shape[1], part.shape[0]), tuple(weights))


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    """Points that a camera sees: the middle of each pixel, then further points in some."""

    of: tuple[Camera, Size]
    hits: WallHits
    points_mm: Array  # of the volume's world
    mean: csr_array  # (H·W, points): of the points in each pixel


class Backdrop(SurfaceCaster):
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
        self._view: _View | None = None
        self._maps: tuple[object, list[list[ShadowMap]]] | None = None
        self._picture: SeenRoom | None = None

    def repainted(self, response: RoomResponse) -> Backdrop:
        """Return the backdrop of the same room with other paints."""
        colours = self.colours(response)
        backdrop = copy(self)  # with the triangles, which are those of all paints
        backdrop.response, backdrop._colours = response, colours
        return backdrop

    @cached_property
    def _lit_mesh(self) -> LitMesh:
        return LitMesh.of(self.response)

    @cached_property
    def _colours(self) -> NDArray[np.float32]:
        return self.colours(self.response)

    def colours(self, response: RoomResponse) -> NDArray[np.float32]:
        """Return the `room_colours` of the room with other paints."""
        return room_colours(response, self._basis, self._parts, self._lit_mesh)

    def pictures(
        self,
        camera: Camera,
        size: Size,
        opacity: OpacityCaster,
        ends_mm: Sequence[NDArray[np.float32]],
    ) -> list[SurfaceImage]:
        """Return the room, as `SurfaceCaster`; it is seen to its end."""
        layers = self.layers(camera, size, opacity)
        return [SurfaceImage(layers, np.ones(layers.shape[:2], np.float32))]

    def layers(
        self, camera: Camera, size: Size, opacity: OpacityCaster | None = None
    ) -> NDArray[np.float32]:
        """Return (H, W, L·M): the layers of the room's lights, behind those of the volume.

        Without ``opacity``, shadows are those of the last call.
        """
        return np.concatenate(self.seen(camera, size, opacity).layers(self._colours), axis=2)

    def seen(self, camera: Camera, size: Size, opacity: OpacityCaster | None = None) -> SeenRoom:
        """Return the picture for all paints; ``opacity`` as above."""
        view = self._look(camera, size)
        if opacity is not None and (self._maps is None or self._maps[0] != opacity.key):
            self._maps, self._picture = (opacity.key, self._cast_shadows(opacity)), None
        if self._picture is None:
            surfaces = len(self.response.solved.mesh.names)
            weights = (
                csr_array(view.mean @ view.hits.rows(light, surfaces, shadow), dtype=np.float32)
                for light, shadow in enumerate(self._shadowed(view))
            )
            self._picture = SeenRoom(size, tuple(weights))
        return self._picture

    def depths_mm(self, camera: Camera, size: Size) -> list[NDArray[np.float32]]:
        """Return the distances of the room's surfaces, as `SurfaceCaster`."""
        view = self._look(camera, size)
        origins, directions = world_rays(camera, *size)
        count = len(origins)
        distance = np.einsum("kc,kc->k", view.points_mm[:count] - origins, directions)
        width, height = size
        depth = np.where(view.hits.surface[:count] >= 0, distance, np.inf)
        return [depth.astype(np.float32).reshape(height, width)]

    def _look(self, camera: Camera, size: Size) -> _View:
        if self._view is None or self._view.of != (camera, size):
            self._view, self._picture = self._looked(camera, size), None
        return self._view

    def _looked(self, camera: Camera, size: Size) -> _View:
        """Look through the pixels' middles, and at four more points where edges pass."""
        middles = self._lit_mesh.trace(*self._rays(*world_rays(camera, *size)))
        edges = _edges(middles, size)
        further = world_rays(camera, *size, edge_sample_points(edges, size[0]))
        hits = middles.joined(self._lit_mesh.trace(*self._rays(*further)))
        points = (hits.points_m - self._placement.position_m) @ self._placement.axes
        points = points / self._placement.metres_per_mm + self._middle_mm
        return _View((camera, size), hits, points, mean_of_points(edges, len(middles.surface)))

    def _rays(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        """Return rays of the volume's world, (K, 3) each, in the room."""
        place = self._placement
        origins = np.einsum("kc,dc->kd", origins - self._middle_mm, place.axes)
        directions = np.einsum("kc,dc->kd", directions, place.axes)
        return place.metres_per_mm * origins + place.position_m, directions

    def _cast_shadows(self, opacity: OpacityCaster) -> list[list[ShadowMap]]:
        """Return the shadow maps of each of the room's lights."""
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
                towards = np.array(sun.direction) @ place.axes * 4.0 * self._radius_mm
                height_mm = 2.0 * self._radius_mm
                return [(self._light_camera(self._middle_mm + towards, height_mm), None)]
        points: list[tuple[Array, Array | None]] = self._emitting_points(name)
        points += [(np.array(lamp.position_m), None) for lamp in room.lamps if lamp.name == name]
        cameras: list[tuple[Camera, Array | None]] = []
        for point, normal in points:
            offset = (point - place.position_m) @ place.axes / place.metres_per_mm
            if np.linalg.norm(offset) > _NEAREST * self._radius_mm:
                facing = None if normal is None else normal @ place.axes
                cameras.append((self._light_camera(offset + self._middle_mm), facing))
        return cameras

    def _emitting_points(self, name: str) -> list[tuple[Array, Array | None]]:
        """Return points of a panel, evenly by area, m, and its normals there."""
        room = self.response.solved.room
        if name not in room.exitances:
            return []
        mesh = room.mesh
        part = mesh.part(mesh.surface == mesh.names.index(name))
        ends = np.cumsum(part.areas_m2) / part.areas_m2.sum()
        samples = sobol(_POINTS, 3, seed=0)
        triangles = np.minimum(np.searchsorted(ends, samples[:, 0]), len(ends) - 1)
        return [
            (part.part(slice(k, k + 1)).points(sample[None, 1:])[0, 0], part.normals[k])
            for k, sample in zip(triangles.tolist(), samples, strict=True)
        ]

    def _light_camera(self, place_mm: Array, height_mm: float | None = None) -> Camera:
        axis = self._middle_mm - place_mm
        distance = float(np.linalg.norm(axis))
        across, _ = frames(axis / distance)
        half = math.asin(min(self._radius_mm * _MARGIN / distance, 1.0))
        fov_deg = min(2.0 * math.degrees(half), _WIDEST_DEG)
        places = tuple(place_mm.tolist()), tuple(self._middle_mm.tolist())
        return Camera(*places, tuple(across.tolist()), fov_deg, height_mm)

    def _shadowed(self, view: _View) -> Array:
        """Return the part (L, points) of each light that the volume takes away."""
        shadows = np.zeros((len(self.response.names), len(view.points_mm)))
        if self._maps is None:
            return shadows
        normals = view.hits.normals @ self._placement.axes
        for light, maps in enumerate(self._maps[1]):
            if not maps:
                continue
            near = self._near_shadow(view.points_mm, maps)
            points, facing = view.points_mm[near], normals[near]
            weights = np.array([shadow_map.weight(points, facing) for shadow_map in maps])
            taken = np.array([shadow_map.shadow(points) for shadow_map in maps])
            total = np.maximum(weights.sum(axis=0), 1e-30)
            shadows[light, near] = (weights * taken).sum(axis=0) / total
        return shadows

    def _near_shadow(self, points: Array, maps: list[ShadowMap]) -> NDArray[np.intp]:
        """Return the points whose light may pass the sphere around the volume."""
        lights = np.array([shadow_map.projection.camera.position_mm for shadow_map in maps])
        light = lights.mean(axis=0)
        reach = self._radius_mm * _MARGIN + np.linalg.norm(lights - light, axis=1).max()
        offsets = points - light
        fraction = (offsets @ (self._middle_mm - light)) / np.einsum("kc,kc->k", offsets, offsets)
        passed = light + np.clip(fraction, 0.0, 1.0)[:, None] * offsets - self._middle_mm
        return np.flatnonzero(np.einsum("kc,kc->k", passed, passed) < reach * reach)


def _edges(hits: WallHits, size: Size) -> NDArray[np.intp]:
    """Return the pixels next to others that see another side, or another light directly."""
    width, height = size
    cells = np.rint(hits.normals * _SAME_SIDE).astype(np.int64)
    kinds = np.concatenate([hits.surface[:, None], cells, hits.direct > 0.0], axis=1)
    kinds = kinds.reshape(height, width, -1)
    across = (kinds[:, 1:] != kinds[:, :-1]).any(axis=2)
    return neighbour_pixels(across, (kinds[1:] != kinds[:-1]).any(axis=2))
