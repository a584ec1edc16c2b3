"""Cast meshes: what pixels see of them, its material, and the light that arrives there.

meshes, camera -> [cast] -> channels by light group, opacity, depth -> CoefficientImage

Light is that of the raycaster: Lambert's and Blinn and Phong's laws, by light group, on the side
that faces the eye, with shadows and ambient occlusion by rays. Surfaces are opaque.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._rays import TriangleRays
from volspec.basis import Basis
from volspec.errors import MeshError, nearest
from volspec.mesh.model import Mesh
from volspec.raycast.behind import BehindImage, OpacityCaster
from volspec.raycast.camera import Camera
from volspec.raycast.checks import checked_size
from volspec.raycast.edges import further_points, mean_of_points, next_to
from volspec.raycast.image import CoefficientImage
from volspec.raycast.kernel_arguments import numbered_sources
from volspec.raycast.light_volume import FAR, Arrives, Clear
from volspec.raycast.lights import Ambient, Directional, Point, Source
from volspec.raycast.sampling import source_at, world_rays
from volspec.raycast.spec import RaycastSpec
from volspec.spectra import Spectrum

Array = NDArray[np.float64]
Size = tuple[int, int]
# An edge passes between pixels whose normals' cosine is less, or whose distances differ by more.
_SAME_SIDE, _SAME_DEPTH = 0.9, 0.02
# Rays of ambient occlusion from each point.
_OCCLUSION = 32


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Points of meshes that K rays see first; rows of rays that see nothing are 0."""

    along_mm: Array  # (K,); inf for nothing
    points_mm: Array  # (K, 3)
    normals: Array  # (K, 3), towards the eye
    directions: Array  # (K, 3)
    mesh: NDArray[np.intp]  # (K,); -1 for nothing
    triangle: NDArray[np.intp]  # (K,), of the mesh
    shares: Array  # (K, 3) of the triangle's corners


class MeshCaster:
    """Opaque meshes around and in a volume.

    Parameters
    ----------
    meshes : sequence of Mesh
    materials : {str: Spectrum}
        Reflectances of their materials.
    basis : SpectralBasis or MaterialBasis

    Raises
    ------
    MeshError
        If there is no mesh, or a material is unknown.
    DeviceError
        Where Embree is not installed.
    """

    def __init__(
        self, meshes: Sequence[Mesh], materials: Mapping[str, Spectrum], basis: Basis
    ) -> None:
        if not meshes:
            raise MeshError("no meshes are given", "give one at least", code="missing")
        self.meshes, self.basis = tuple(meshes), basis
        self._channels = _channels(meshes, materials, basis)
        self._ends = np.cumsum([len(mesh.triangles) for mesh in meshes])
        corners = [mesh.points_mm[mesh.triangles] for mesh in meshes]
        self._rays = TriangleRays(np.concatenate(corners), "meshes", "use another system")
        # What the last camera sees; also that of `painted` ones.
        self._views: dict[tuple[Camera, Size], Seen] = {}

    def painted(self, materials: Mapping[str, Spectrum], basis: Basis) -> MeshCaster:
        """Return the same meshes with other reflectances, or in another basis.

        Raises MeshError if a material is unknown.
        """
        made = copy(self)
        made.basis, made._channels = basis, _channels(self.meshes, materials, basis)
        return made

    @property
    def clear(self) -> Clear:
        """(K, 3) starts and ends in mm -> (K,), True where no mesh is between them."""
        return self._rays.clear

    def depth_mm(self, camera: Camera, size: Size) -> NDArray[np.float32]:
        """Return (H, W) distances from the camera; inf where no mesh is seen."""
        width, height = size
        return np.float32(self._look(camera, size).along_mm).reshape(height, width)

    def __call__(
        self, camera: Camera, size: Size, opacity: OpacityCaster, stop_mm: NDArray[np.float32]
    ) -> BehindImage:
        """Return the meshes, as `volspec.raycast.behind.Behind`."""
        arrives = opacity.caster.arrivals(opacity.table, opacity.spec, camera, self.clear)
        channels, alpha = self.layers(camera, size, opacity.spec, arrives, stop_mm)
        return BehindImage(channels, alpha, self.depth_mm(camera, size))

    def layers(
        self,
        camera: Camera,
        size: Size,
        spec: RaycastSpec,
        arrives: Mapping[int, Arrives] | None = None,
        stop_mm: NDArray[np.float32] | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return channels (H, W, L·M), premultiplied by opacity, and opacity (H, W).

        ``arrives`` is what a volume lets pass of a source's light, by number; meshes behind
        ``stop_mm`` (H, W) are hidden.
        """
        width, height = size
        given = camera, spec, arrives or {}
        seen = self._look(camera, size)
        stops = np.full(width * height, np.inf) if stop_mm is None else stop_mm.ravel()
        channels, clear = self._send(seen, stops, *given)
        edges = _edges(seen, clear, size)
        further = self._seen(*world_rays(camera, *size, further_points(edges, width)))
        more = np.repeat(stops[edges], len(further.mesh) // max(len(edges), 1))
        channels = np.concatenate([channels, self._send(further, more, *given)[0]])
        found = (mean_of_points(edges, width * height) @ channels).reshape(height, width, -1)
        return found[..., :-1], found[..., -1]

    def _send(
        self,
        seen: Seen,
        stops: NDArray[Any],
        camera: Camera,
        spec: RaycastSpec,
        arrives: Mapping[int, Arrives],
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return channels and opacity (K, L·M + 1) of points, and what lights see them (K, S)."""
        lit = np.flatnonzero(seen.along_mm <= stops * (1.0 + _SAME_DEPTH))
        lit = lit[seen.mesh[lit] >= 0]
        factor, highlight, clear = self._shade(seen, lit, camera, spec, arrives)
        light = factor[:, :, None] * self._materials(seen, lit)[:, None]
        light += highlight[:, :, None] * self.basis.white
        width = light.shape[1] * light.shape[2]
        channels = np.zeros((len(stops), width + 1), np.float32)
        channels[lit, :-1], channels[lit, -1] = light.reshape(len(lit), width), 1.0
        sees = np.zeros((len(stops), clear.shape[1]), np.bool_)
        sees[lit] = clear
        return channels, sees

    def _look(self, camera: Camera, size: Size) -> Seen:
        """Return what the middles of pixels see."""
        found = self._views.get((camera, size))
        if found is None:
            found = self._seen(*world_rays(camera, *size))
            self._views.clear()
            self._views[camera, size] = found
        return found

    def _seen(self, origins: Array, directions: Array) -> Seen:
        hits = self._rays.hits(origins, directions)
        count = len(directions)
        points, normals = np.zeros((2, count, 3))
        number = np.where(
            hits.triangle < 0, -1, np.searchsorted(self._ends, hits.triangle, "right")
        )
        for k, mesh in enumerate(self.meshes):
            rows = np.flatnonzero(number == k)
            hits.triangle[rows] -= self._ends[k] - len(mesh.triangles)
            corners, shares = mesh.triangles[hits.triangle[rows]], hits.shares[rows]
            points[rows] = np.einsum("ki,kic->kc", shares, mesh.points_mm[corners])
            normals[rows] = _facing(mesh, corners, shares, directions[rows])
        return Seen(hits.along, points, normals, directions, number, hits.triangle, hits.shares)

    def _materials(self, seen: Seen, rows: NDArray[np.intp]) -> Array:
        """Return the channels (K, M) of the materials at points."""
        found = np.zeros((len(rows), self.basis.size))
        for k, mesh in enumerate(self.meshes):
            own = np.flatnonzero(seen.mesh[rows] == k)
            if isinstance(mesh.material, str):
                found[own] = self._channels[mesh.material]
                continue
            triangle, shares = seen.triangle[rows[own]], seen.shares[rows[own]]
            for name, given in mesh.material.items():
                values = np.asarray(given)
                at_points = len(values) == len(mesh.points_mm)
                part = values[triangle]
                if at_points:
                    part = (values[mesh.triangles[triangle]] * shares).sum(axis=1)
                found[own] += part[:, None] * self._channels[name]
        return found

    def _shade(
        self,
        seen: Seen,
        rows: NDArray[np.intp],
        camera: Camera,
        spec: RaycastSpec,
        arrives: Mapping[int, Arrives],
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return factors of the reflectance, and highlights to add, (K, L); and who sees whom.

        The last, (K, S), is True where no mesh is before a source.
        """
        points, normals, directions = (
            each[rows] for each in (seen.points_mm, seen.normals, seen.directions)
        )
        factor, highlight = np.zeros((2, len(rows), len(spec.groups)))
        sources = numbered_sources(spec)
        sees = np.ones((len(rows), len(sources)), np.bool_)
        raised = points + 2.0 * self._rays.offset * normals
        for number, (group, source) in enumerate(sources):
            towards, light = source_at(camera, source, points, directions)
            if number in arrives:
                light = light * arrives[number](points)
            if isinstance(source, Ambient):
                if source.occlusion:
                    light = light * self._open(raised, normals, source.radius_mm)
                factor[:, group] += light * spec.ambient
                continue
            cosine = np.einsum("kc,kc->k", normals, towards)
            if isinstance(source, Directional | Point) and source.shadows:
                sees[:, number] = self._sees(raised, cosine, towards, camera, source)
                light = light * sees[:, number]
            if not spec.shaded:
                factor[:, group] += light * spec.diffuse
                continue
            half = towards - directions
            half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-6)
            n_dot_h = np.clip(np.einsum("kc,kc->k", normals, half), 0.0, 1.0)
            factor[:, group] += light * spec.diffuse * np.maximum(cosine, 0.0)
            highlight[:, group] += light * spec.specular * (cosine > 0) * n_dot_h**spec.shininess
        return factor, highlight, sees

    def _sees(
        self, points: Array, cosine: Array, towards: Array, camera: Camera, source: Source
    ) -> NDArray[np.bool_]:
        """Return (K,) True where a source is above the horizon and no mesh is before it."""
        facing = np.flatnonzero(cosine > 0.0)
        if isinstance(source, Point):
            ends = np.broadcast_to(camera.place_mm(source.position_mm, source.frame), towards.shape)
        else:
            ends = points + FAR * towards
        found = np.zeros(len(points), np.bool_)
        found[facing] = self._rays.clear(points[facing], ends[facing])
        return found

    def _open(self, points: Array, normals: Array, radius_mm: float | None) -> Array:
        """Return the part (K,) of the hemisphere, by its cosine, that no mesh closes."""
        corners = self._rays.corners.reshape(-1, 3)
        radius = radius_mm or float(np.linalg.norm(np.ptp(corners, axis=0))) / 10.0
        found = np.zeros(len(points))
        for share in _hemisphere(_OCCLUSION):
            ways = _around(normals, share)
            found += self._rays.clear(points, points + radius * ways)
        return found / _OCCLUSION


def cast_meshes(
    meshes: Sequence[Mesh],
    materials: Mapping[str, Spectrum],
    basis: Basis,
    camera: Camera,
    size: Size = (512, 512),
    spec: RaycastSpec | None = None,
) -> CoefficientImage:
    """Cast meshes alone, once, for every light to come.

    Parameters
    ----------
    meshes : sequence of Mesh
    materials : {str: Spectrum}
        Reflectances of their materials.
    basis : SpectralBasis or MaterialBasis
    camera : Camera
    size : (width, height)
        Pixels.
    spec : RaycastSpec, optional
        Shading and light groups; by default a headlight.

    Returns
    -------
    CoefficientImage

    Raises
    ------
    MeshError, DeviceError
        As `MeshCaster`; RaycastError if the picture's size is wrong.

    Examples
    --------
    >>> import volspec as vs
    >>> basis = vs.SpectralBasis.load("general-7")
    >>> roof = vs.Mesh([[-9, 0, 0], [9, 0, 0], [0, 0, 9]], [[0, 1, 2]], "copper")
    >>> camera = vs.Camera((0, -40, 0), (0, 0, 0))
    >>> copper = {"copper": vs.reflectance("copper")}
    >>> image = vs.cast_meshes([roof], copper, basis, camera, (64, 48))
    >>> bool(image.alpha.max() == 1.0)
    True
    """
    spec = RaycastSpec() if spec is None else spec
    width, height = checked_size(size)
    caster = MeshCaster(meshes, materials, basis)
    channels, alpha = caster.layers(camera, (width, height), spec)
    depth = caster.depth_mm(camera, (width, height))
    return CoefficientImage(
        channels.astype(np.float16 if spec.half else np.float32),
        alpha,
        depth,
        basis,
        {"camera": repr(camera), "raycast": repr(spec)},
        groups=spec.shares(),
        first_mm=depth,
        fov_deg=None if camera.height_mm is not None else camera.fov_deg,
    )


def _channels(
    meshes: Sequence[Mesh], materials: Mapping[str, Spectrum], basis: Basis
) -> dict[str, Array]:
    """Return the channels (M,) of the meshes' materials."""
    found = {}
    for mesh in meshes:
        for name in mesh.materials:
            if name not in materials:
                raise MeshError(
                    f"{mesh.name}: no material is named {name!r}",
                    f"{nearest(name, materials)}there is {', '.join(materials)}",
                    code="unknown",
                )
            found[name] = basis.channels_for_materials({name: materials[name]})[0]
    return found


def _facing(mesh: Mesh, corners: NDArray[np.intp], shares: Array, ways: Array) -> Array:
    """Return unit normals (K, 3) at points of triangles, towards the eye."""
    a, b, c = mesh.points_mm[corners].transpose(1, 0, 2)
    flat = np.cross(b - a, c - a)
    found = flat
    if mesh.normals is not None:
        found = np.einsum("ki,kic->kc", shares, mesh.normals[corners])
        # Files may wind their triangles the other way.
        found = np.where(np.einsum("kc,kc->k", found, flat)[:, None] < 0.0, -found, found)
    found = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30)
    away = np.einsum("kc,kc->k", flat, ways) > 0.0
    return np.where(away[:, None], -found, found)


def _hemisphere(count: int) -> Array:
    """Return (count, 3) directions about z with the density of their cosine."""
    k = np.arange(count) + 0.5
    radius, turn = np.sqrt(k / count), np.pi * (1.0 + np.sqrt(5.0)) * k
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - k / count)], 1)


def _around(normals: Array, share: Array) -> Array:
    """Return a direction about z (3,) as it is about each normal (K, 3) [Duff et al. 2017]."""
    x, y, z = normals.T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1)
    second = np.stack([b, sign + y * y * a, -y], axis=1)
    return share[0] * first + share[1] * second + share[2] * normals


def _edges(seen: Seen, sees: NDArray[np.bool_], size: Size) -> NDArray[np.intp]:
    """Return the pixels next to others that see another mesh, side, distance or light."""
    width, height = size
    lights = sees.reshape(height, width, -1)
    mesh = seen.mesh.reshape(height, width)
    normals = seen.normals.reshape(height, width, 3)
    along = np.where(seen.mesh < 0, 0.0, seen.along_mm).reshape(height, width)

    def differ(one: tuple[slice, slice], other: tuple[slice, slice]) -> NDArray[np.bool_]:
        turned = np.einsum("yxc,yxc->yx", normals[one], normals[other]) < _SAME_SIDE
        apart = np.abs(along[one] - along[other]) > _SAME_DEPTH * along[one]
        here = mesh[one] >= 0
        lit = (lights[one] != lights[other]).any(axis=2)
        return (mesh[one] != mesh[other]) | (here & (turned | apart | lit))

    whole = slice(None)
    across = differ((whole, slice(None, -1)), (whole, slice(1, None)))
    return next_to(across, differ((slice(None, -1), whole), (slice(1, None), whole)))
