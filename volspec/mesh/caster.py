"""Cast meshes: what pixels see of them, its material, and the light that arrives there.

meshes, camera -> [cast] -> channels by light group, opacity, depth -> CoefficientImage

Light is that of the raycaster: Lambert's and Blinn and Phong's laws, by light group, on the side
that faces the eye, with shadows and ambient occlusion by rays. Mirrors multiply channels, and
gratings give each light group its own reflectance: lights change without a new cast.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import chain, islice, repeat
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec._checks import checked_size
from volspec.basis import Basis, SpectralBasis
from volspec.camera import NEAR, Camera, Projection
from volspec.errors import MeshError, VolspecWarning
from volspec.image import APPROXIMATED, CoefficientImage
from volspec.mesh.model import Mesh
from volspec.mesh.paint import Paint, mesh_paint
from volspec.mesh.shading import Lighting, MeshHits
from volspec.mesh.surfaces import MAX_SHEETS, MeshSurfaces, same_surfaces, trace_visibility
from volspec.raycast import (
    POINTS,
    OpacityCaster,
    RaycastSpec,
    SurfaceImage,
    composite_under,
    edge_sample_points,
    empty_result,
    neighbour_pixels,
)
from volspec.raycast.launch import Transmittance, Visibility, world_rays
from volspec.spectra import Spectrum
from volspec.volume import Volume

Array = NDArray[np.float64]
Size = tuple[int, int]
_Part = TypeVar("_Part")
# An edge passes between pixels whose normals' cosine is less, or whose distances differ by more.
_SAME_SIDE, _SAME_DEPTH = 0.9, 0.02
# Mirrors in mirrors.
_BOUNCES = 3
# Rays of a strip: its arrays stay in a core's cache.
_STRIP = 16384


class _Window(NamedTuple):
    """Rectangle of a picture's pixels, beyond which no mesh is seen."""

    left: int
    top: int
    width: int
    height: int

    @classmethod
    def around(cls, boxes: Sequence[Array], camera: Camera, size: Size) -> _Window:
        """Return the rectangle of boxes' corners (8, 3); all if one is behind the camera."""
        x, y, depth = Projection(camera, (0, 0, *size)).to_window(np.concatenate(boxes)).T
        if (depth < NEAR).any():
            return cls(0, 0, *size)
        # One more pixel around, as an edge is between two.
        (left, top), (right, bottom) = (
            np.clip((further, lower), 0, size).astype(int)
            for further, lower in ((x.min() - 2, y.min() - 2), (x.max() + 2, y.max() + 2))
        )
        return cls(int(left), int(top), int(right - left), int(bottom - top))

    @property
    def size(self) -> Size:
        """Width and height in pixels."""
        return self.width, self.height

    @property
    def part(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)

    def pixels(self) -> Array:
        """(R, 2) x and y of its pixels, row by row."""
        down, across = np.mgrid[self.part]
        return np.stack([across.ravel(), down.ravel()], axis=1).astype(np.float64)

    def framed(self, along_mm: Array, size: Size) -> NDArray[np.float32]:
        """Return a picture (H, W) with distances (R,) of its pixels; inf around them."""
        width, height = size
        picture = np.full((height, width), np.inf, np.float32)
        picture[self.part] = along_mm.reshape(self.height, self.width)
        return picture


class MeshCaster:
    """Meshes around and in a volume.

    Parameters
    ----------
    meshes : sequence of Mesh
    materials : {str: Spectrum}
        Reflectances of their materials.
    basis : SpectralBasis or MaterialBasis
        For colours of textures and for gratings a SpectralBasis.
    like : MeshCaster, optional
        What was computed for its surfaces is used again for those that are the same.

    Raises
    ------
    MeshError
        If there is no mesh, a material is unknown, or the basis does not fit.
    DeviceError
        Where Embree is not installed.
    OpenCLError
        If a texture has colours and there is no device, or it does not fit there.
    """

    _opaque: MeshSurfaces | None
    _translucent: MeshSurfaces | None

    def __init__(
        self,
        meshes: Sequence[Mesh],
        materials: Mapping[str, Spectrum],
        basis: Basis,
        previous: MeshCaster | None = None,
    ) -> None:
        if isinstance(meshes, Mesh) or not all(isinstance(mesh, Mesh) for mesh in meshes):
            raise MeshError.refused("meshes", meshes, "give a list of volspec.Mesh", "type")
        if not meshes:
            raise MeshError("no meshes are given", "give one at least", code="missing")
        self.meshes = tuple(meshes)
        # The last paint of each mesh and what it was made from; also that of `painted` ones.
        self._cached_paints: dict[int, tuple[object, Paint]] = {}
        self._take(materials, basis)
        opaque = [k for k, mesh in enumerate(meshes) if mesh.opacity == 1.0]
        translucent = [k for k, mesh in enumerate(meshes) if mesh.opacity < 1.0]
        parts: list[MeshSurfaces | None] = (
            [previous._opaque, previous._translucent] if previous else []
        )
        before = [part for part in parts if part is not None]
        self._opaque = MeshSurfaces(self.meshes, opaque, before) if opaque else None
        self._translucent = MeshSurfaces(self.meshes, translucent, before) if translucent else None
        # One object also for `painted` ones, as what is cached by it does not depend on paint.
        self.clear: Visibility = partial(trace_visibility, self._opaque, self._translucent)
        self._offset = 2.0 * max(
            part.rays.offset for part in (self._opaque, self._translucent) if part is not None
        )
        ends = [(mesh.points_mm.min(axis=0), mesh.points_mm.max(axis=0)) for mesh in meshes]
        self._boxes = [
            np.array([np.where(far, high, low) for far in np.ndindex(2, 2, 2)])
            for low, high in ends
        ]
        self._extent = float(np.linalg.norm(np.ptp(np.concatenate(self._boxes), axis=0)))
        # What the last camera sees, opaque and then sheets; also that of `painted` ones.
        self._views: dict[tuple[Camera, Size], tuple[_Window, list[MeshHits]]] = {}
        # What the last planes left; likewise.
        self._within: dict[bytes, MeshCaster | None] = {}
        if previous is not None and same_surfaces(self.meshes, previous.meshes):
            opacities = [mesh.opacity for mesh in previous.meshes]
            if [opacity < 1.0 for opacity in opacities] == [mesh.opacity < 1.0 for mesh in meshes]:
                self._views = previous._views
            if opacities == [mesh.opacity for mesh in meshes]:
                self.clear = previous.clear

    def _take(self, materials: Mapping[str, Spectrum], basis: Basis) -> None:
        for mesh in self.meshes:
            if mesh.grating is not None and not isinstance(basis, SpectralBasis):
                remedy = "use SpectralBasis.bands(), in scenes [basis] method = 'bands'"
                problem = f"{mesh.name}: a basis of materials cannot store what gratings diffract"
                raise MeshError(problem, remedy, code="conflict")
        self.basis, self._spectra, self._paints = basis, materials, []
        for number, mesh in enumerate(self.meshes):
            spectra = [materials.get(name) for name in mesh.materials]
            key = (
                basis.fingerprint,
                *(
                    (spectrum.wavelengths_nm.tobytes(), spectrum.values.tobytes())
                    for spectrum in spectra
                    if spectrum
                ),
            )
            cached = self._cached_paints.get(number)
            if cached is None or cached[0] != key:
                cached = self._cached_paints[number] = key, mesh_paint(mesh, materials, basis)
            self._paints.append(cached[1])

    def painted(self, materials: Mapping[str, Spectrum], basis: Basis) -> MeshCaster:
        """Return the same meshes with other reflectances, or in another basis.

        Raises as the constructor does.
        """
        caster = copy(self)
        caster._take(materials, basis)
        return caster

    @property
    def materials(self) -> list[str]:
        """Return the meshes' materials, as `SurfaceCaster`."""
        return [name for mesh in self.meshes for name in mesh.materials]

    @property
    def translucent(self) -> str:
        """Return the first translucent mesh, as `SurfaceCaster`."""
        meshes = [mesh for mesh in self.meshes if mesh.opacity < 1.0]
        return f"{meshes[0].name} of opacity {meshes[0].opacity:g}" if meshes else ""

    @property
    def approximated(self) -> str:
        """Return what gratings diffract in a basis without all bands, as `SurfaceCaster`."""
        names = [mesh.name for mesh in self.meshes if mesh.grating is not None]
        return f"light that {', '.join(names)} diffracts" * (self.basis.method != "bands")

    def within(self, volume: Volume | None, spec: RaycastSpec) -> MeshCaster | None:
        """Return what cuts leave of meshes with ``cut``, as `SurfaceCaster`."""
        planes = spec.world_planes(volume)
        if not len(planes) or not any(mesh.cut for mesh in self.meshes):
            return self
        key = planes.tobytes()
        if key not in self._within:
            parts = [mesh.within(planes) if mesh.cut else mesh for mesh in self.meshes]
            left = [part for part in parts if part is not None]
            self._within.clear()
            caster = MeshCaster(left, self._spectra, self.basis, self) if left else None
            self._within[key] = caster
        remainder = self._within[key]
        return None if remainder is None else remainder.painted(self._spectra, self.basis)

    def depths_mm(self, camera: Camera, size: Size) -> list[NDArray[np.float32]]:
        """Return (H, W) distances, as `SurfaceCaster`."""
        window, views = self._look(camera, size)
        return [window.framed(view.along_mm, size) for view in views]

    def pictures(
        self,
        camera: Camera,
        size: Size,
        opacity: OpacityCaster,
        ends_mm: Sequence[NDArray[np.float32]],
    ) -> list[SurfaceImage]:
        """Return pictures of the meshes, as `SurfaceCaster`."""
        arrives = opacity.transmittances(camera, self.clear)
        return self._pictures(camera, size, opacity.spec, arrives, ends_mm)

    def alone(self, camera: Camera, size: Size, spec: RaycastSpec) -> CoefficientImage:
        """Return a picture of the meshes without a volume."""
        width, height = size
        shape = height, width, len(spec.groups) * self.basis.size
        image = empty_result(shape, np.float16 if spec.half else np.float32)
        far = np.broadcast_to(np.float32(np.inf), (height, width))
        if (cut := self.within(None, spec)) is not None:
            opaque, *sheets = cut._pictures(camera, size, spec, {}, repeat(far))
            for picture in (*sheets, opaque):
                composite_under(image, picture)
        notes = {"camera": repr(camera), "raycast": repr(spec)}
        if self.approximated:
            notes[APPROXIMATED] = self.approximated
        return CoefficientImage(
            *image[:3],
            self.basis,
            notes,
            groups=spec.shares(),
            first_mm=image.first_mm,
            fov_deg=None if camera.height_mm is not None else camera.fov_deg,
            camera=camera,
        )

    def _pictures(
        self,
        camera: Camera,
        size: Size,
        spec: RaycastSpec,
        arrives: Mapping[int, Transmittance],
        ends_mm: Iterable[NDArray[np.float32]],
    ) -> list[SurfaceImage]:
        """Return what is opaque, and sheets of what is translucent in front of that.

        ``arrives`` is what a volume lets pass of a source's light, by number; ``ends_mm`` (H, W)
        as in `pictures`.
        """
        light = Lighting(camera, spec, arrives, self.clear, self._extent, self.basis)
        field = camera.ray_field(*size)
        pixel_mm = float(np.linalg.norm(field.down))
        # Width of a pixel, and its growth by distance.
        beam = (0.0, pixel_mm / field.distance) if field.perspective else (pixel_mm, 0.0)
        window, views = self._look(camera, size)
        # What sheets let pass to the next, at each of a pixel's points: they share a silhouette.
        transmittance = np.ones((len(views[0].along_mm), POINTS), np.float32)
        stack = []
        for number, (view, end_mm) in enumerate(zip(views, ends_mm, strict=False)):
            ends = end_mm[window.part].ravel()
            if number > 0:
                ends = np.minimum(ends, views[0].along_mm)
            channels, sees = self._send_all(view, ends, light, beam)
            edges = _edges(view, sees, view.along_mm <= ends, window.size)
            edges = edges[ends[edges] > 0.0]
            places = edge_sample_points(edges, window.width) + (window.left, window.top)
            further = self._see_all(number, *world_rays(camera, *size, places))
            sent, _ = self._send_all(further, np.repeat(ends[edges], POINTS), light, beam)
            by_point = sent.reshape(len(edges), POINTS, channels.shape[1])
            passes = transmittance[edges]
            seen_part = passes / np.maximum(passes.mean(axis=1, keepdims=True), 1e-30)
            channels[edges] = (seen_part[:, :, None] * by_point).mean(axis=1)
            if number > 0:
                alpha = np.repeat(channels[:, -1:], POINTS, axis=1)
                alpha[edges] = by_point[..., -1]
                transmittance *= 1.0 - alpha
            picture = channels.reshape(window.height, window.width, channels.shape[1])
            # Where a pixel's middle sees nothing, its nearest point is where the surface is.
            depth = view.along_mm.astype(np.float32)
            nearest = further.along_mm.reshape(-1, POINTS).min(axis=1)
            depth[edges] = np.where(np.isinf(depth[edges]), nearest, depth[edges])
            depth = depth.reshape(picture.shape[:2])
            stack.append(SurfaceImage(picture[..., :-1], picture[..., -1], depth, part=window.part))
        return stack

    def _look(self, camera: Camera, size: Size) -> tuple[_Window, list[MeshHits]]:
        """Return the window of the meshes, and what the middles of its pixels see.

        The latter is what is opaque, then sheets.
        """
        entry = self._views.get((camera, size))
        if entry is None:
            self._warn_of_unseen(camera, size)
            window = _Window.around(self._boxes, camera, size)
            rays = world_rays(camera, *size, window.pixels())
            views = [self._see_all(0, *rays)]
            if self._translucent is not None:
                for sheet in islice(self._translucent.sheets(*rays), MAX_SHEETS):
                    if not (sheet.along_mm < views[0].along_mm).any():
                        break
                    views.append(sheet)
            self._views.clear()
            entry = self._views[camera, size] = window, views
        return entry

    def _warn_of_unseen(self, camera: Camera, size: Size) -> None:
        projection = Projection(camera, (0, 0, *size))
        for mesh, corners in zip(self.meshes, self._boxes, strict=True):
            if not projection.shows(corners):
                place = ", ".join(f"{x:.4g}" for x in corners.mean(axis=0))
                text = f"{mesh.name}: is outside the view, around ({place}) mm"
                warnings.warn(f"{text}; check unit_mm and move_mm", VolspecWarning, stacklevel=2)

    def _see_all(self, number: int, origins: Array, directions: Array) -> MeshHits:
        """Do as `_see`, in threads."""
        origins = np.broadcast_to(origins, directions.shape)
        return MeshHits.join(
            _in_strips(
                lambda rows: self._see(number, origins[rows], directions[rows]), len(origins)
            )
        )

    def _send_all(
        self, view: MeshHits, stops: NDArray[Any], light: Lighting, beam: tuple[float, float]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Do as `_send`, in threads."""
        parts = _in_strips(
            lambda rows: self._send(view.rows(rows), stops[rows], light, beam), len(stops)
        )
        channels, sees = zip(*parts, strict=True)
        return np.concatenate(channels), np.concatenate(sees)

    def _see(self, number: int, origins: Array, directions: Array) -> MeshHits:
        """Return what rays see: what is opaque, or the sheet of a number from 1."""
        if number == 0:
            if self._opaque is None:
                return MeshHits.nothing(directions)
            return self._opaque.first(origins, directions)
        assert self._translucent is not None
        sheets = self._translucent.sheets(origins, directions)
        return next(islice(sheets, number - 1, None), MeshHits.nothing(directions))

    def _send(
        self,
        view: MeshHits,
        stops: NDArray[Any],
        light: Lighting,
        beam: tuple[float, float],
        bounces: int = _BOUNCES,
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return channels and opacity (K, L·M + 1) of points, and what lights see them (K, S)."""
        reached = np.flatnonzero(view.along_mm <= stops)
        groups, size = len(light.spec.groups), self.basis.size
        channels = np.zeros((len(stops), groups * size + 1), np.float32)
        sees = np.zeros((len(stops), len(light.sources)), np.bool_)
        for number, mesh in enumerate(self.meshes):
            rows = reached[view.mesh[reached] == number]
            if not rows.size:
                continue
            hits = view.rows(rows)
            raised = hits.points_mm + self._offset * hits.normals
            shading = light.shade(hits, raised, mesh.grating)
            sees[rows] = shading.sees
            cosine = np.abs(np.einsum("kc,kc->k", hits.normals, hits.directions))
            # The mean of a pixel's two widths on the surface.
            width = (beam[0] + beam[1] * hits.along_mm) / np.sqrt(np.maximum(cosine, 1e-4))
            material = self._paints[number](hits.triangle, hits.weights, width)
            if mesh.grating is not None:
                material = material * (1.0 - mesh.grating.part)
            sent = (1.0 - mesh.mirror) * shading.factor[:, :, None] * material[:, None]
            sent += shading.added
            if mesh.mirror and bounces:
                mirrored = self._mirrored(hits, raised, light, beam, bounces)
                sent += mesh.mirror * mirrored.reshape(sent.shape)
            channels[rows, :-1] = mesh.opacity * sent.reshape(len(rows), -1)
            channels[rows, -1] = mesh.opacity
        return channels, sees

    def _mirrored(
        self,
        view: MeshHits,
        raised: Array,
        light: Lighting,
        beam: tuple[float, float],
        bounces: int,
    ) -> NDArray[np.float32]:
        """Return the channels (K, L·M) of the meshes that points mirror."""
        cosine = np.einsum("kc,kc->k", view.directions, view.normals)[:, None]
        ways = view.directions - 2.0 * cosine * view.normals
        opaque = self._see(0, raised, ways)
        sheets = () if self._translucent is None else self._translucent.sheets(raised, ways)
        channels = np.zeros((len(raised), len(light.spec.groups) * self.basis.size), np.float32)
        transmittance = np.ones((len(raised), 1), np.float32)
        stops = opaque.along_mm + view.along_mm
        for met in chain(islice(sheets, MAX_SHEETS), (opaque,)):
            far = replace(met, along_mm=met.along_mm + view.along_mm)
            sent, _ = self._send(far, stops, light, beam, bounces - 1)
            channels += transmittance * sent[:, :-1]
            transmittance *= 1.0 - sent[:, -1:]
        return channels


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
    MeshError, DeviceError, OpenCLError
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
    return MeshCaster(meshes, materials, basis).alone(camera, checked_size(size), spec)


def _in_strips(work: Callable[[slice], _Part], count: int) -> list[_Part]:
    """Return what a function returns for strips of rays, one at least, in order, by threads."""
    strips = [slice(start, start + _STRIP) for start in range(0, max(count, 1), _STRIP)]
    if len(strips) == 1:
        return [work(strips[0])]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(work, strips))


def _edges(
    view: MeshHits, sees: NDArray[np.bool_], reached: NDArray[np.bool_], size: Size
) -> NDArray[np.intp]:
    """Return the pixels next to others that see another mesh, side, distance or light.

    ``sees`` (K, S) is known of pixels that are ``reached`` (K,).
    """
    width, height = size
    lights, valid = sees.reshape(height, width, sees.shape[1]), reached.reshape(height, width)
    mesh = view.mesh.reshape(height, width)
    normals = view.normals.reshape(height, width, 3)
    depth = np.where(view.mesh < 0, 0.0, view.along_mm).reshape(height, width)

    def differ(one: tuple[slice, slice], other: tuple[slice, slice]) -> NDArray[np.bool_]:
        turned = np.einsum("yxc,yxc->yx", normals[one], normals[other]) < _SAME_SIDE
        depth_step = np.abs(depth[one] - depth[other]) > _SAME_DEPTH * depth[one]
        here = mesh[one] >= 0
        shadow = (lights[one] != lights[other]).any(axis=2) & valid[one] & valid[other]
        return (mesh[one] != mesh[other]) | (here & (turned | depth_step | shadow))

    full = slice(None)
    across = differ((full, slice(None, -1)), (full, slice(1, None)))
    return neighbour_pixels(across, differ((slice(None, -1), full), (slice(1, None), full)))
