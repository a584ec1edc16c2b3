"""Rays, samples and shading of the reference raycaster: NumPy, float64.

Twins: ``kernels/include/rays.clh``, ``field.clh`` and ``shade.clh``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Camera
from volspec.raycast.launch.kernel_arguments import (
    CUT_TOLERANCE,
    PRESENT,
    gradient_scale,
    needs_powers,
    numbered_sources,
)
from volspec.raycast.lights import NEAR_LAMP, Ambient, Directional, Point, Source, Spot
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, TransferTable
from volspec.volume import Volume

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# (R, 3) index -> (R,) fraction of a source's light that arrives there.
Transmittance = Callable[[Array], Array]
# Least divisor: of 0, which nothing sees.
TINY = float(np.finfo(np.float64).tiny)


@dataclass(frozen=True, slots=True, eq=False)
class CastRays:
    """R rays of a picture, row by row: world and index space, clipped to the visible part.

    ``start`` (R, 3) index at the camera, ``index_direction`` (R, 3) index per mm, ``direction``
    (R, 3) unit vectors of the world, ``near`` and ``far`` (R,) mm from the camera, ``shift`` (R,)
    mm by which the steps are jittered; ``cut_mm`` (R,) where it enters through a cut, whose unit
    normal in the world, out of the volume, is ``cut_normal`` (R, 3), 0 without one.
    """

    start: Array
    index_direction: Array
    direction: Array
    near: Array
    far: Array
    shift: Array
    cut_mm: Array
    cut_normal: Array

    def above_cut(self, rays: Index, distance: Array, height_mm: Array) -> Array:
        """Return the offset (R, 3), mm, of points at ``distance`` mm to a height above the cut."""
        height = np.maximum(height_mm - self.below_cut(rays, distance), 0.0)
        return height[:, None] * self.cut_normal[rays]

    def below_cut(self, rays: Index, distance: Array) -> Array:
        """Return the depth (R,), mm, of points at ``distance`` mm below their cut."""
        slope = -(self.cut_normal[rays] * self.direction[rays]).sum(axis=1)
        return (distance - self.cut_mm[rays]) * slope


def make_rays(volume: Volume, camera: Camera, size: tuple[int, int], spec: RaycastSpec) -> CastRays:
    """Return the rays of a picture."""
    width, height = size
    origin, direction = world_rays(camera, width, height)
    matrix = volume.index_from_world
    start = origin @ matrix[:3, :3].T + matrix[:3, 3]
    index_direction = direction @ matrix[:3, :3].T
    near, far, face = clip_rays(start, index_direction, *spec.kept(volume))
    outwards = -np.sign(index_direction) * np.eye(3)[:, None]  # of the three faces, in index space
    cut = np.where(face[:, None] >= 0, outwards[face, np.arange(len(face))], 0.0)
    for plane in spec.index_planes(volume):
        toward, inside = index_direction @ plane[:3], start @ plane[:3] - plane[3]
        with np.errstate(divide="ignore", invalid="ignore"):
            meet = -inside / toward
        enters = (toward > 0) & (meet > near)
        cut[enters] = -plane[:3]
        near = np.where(enters, meet, near)
        far = np.where(toward < 0, np.minimum(far, meet), far)
        near = np.where((toward == 0) & (inside < 0), np.inf, near)
    cut[near <= CUT_TOLERANCE * min(volume.spacing_mm)] = 0.0  # the eye is on it
    normal = cut @ matrix[:3, :3]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), TINY)
    cut_mm = near.copy()
    gone = near >= far
    near, far = np.where(gone, 0.0, near), np.where(gone, 0.0, far)
    y, x = (grid.ravel() for grid in np.mgrid[0:height, 0:width])
    shift = spec.jitter * spec.step_of(volume) * _hash(x, y, spec.seed)
    return CastRays(start, index_direction, direction, near, far, shift, cut_mm, normal)


def world_rays(
    camera: Camera, width: int, height: int, pixels: Array | None = None
) -> tuple[Array, Array]:
    """Return (R, 3) origins in mm and unit directions, row by row; or through (R, 2) pixels."""
    field = camera.ray_field(width, height)
    if pixels is None:
        pixels = np.mgrid[0:height, 0:width].reshape(2, -1)[::-1].T.astype(np.float64)
    x, y = np.split(pixels, 2, axis=1)
    offset = (x - field.middle[0]) * field.across + (y - field.middle[1]) * field.down
    straight = field.forward * field.distance
    if field.perspective:
        direction = straight + offset
        origin = np.broadcast_to(field.target - straight, direction.shape)
    else:
        direction = np.broadcast_to(straight, offset.shape)
        origin = field.target + offset - straight
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def clip_rays(start: Array, vector: Array, low: Array, high: Array) -> tuple[Array, Array, Index]:
    """Clip rays to the box low…high (index space); a ray misses it if near ≥ far.

    Also returns the axis of the face that a ray enters through; -1 if it begins inside.
    """
    parallel = vector == 0
    between = (start >= low) & (start <= high)
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - start) / vector, (high - start) / vector
    # A ray parallel to two faces lies between them entirely or not at all.
    enter = np.where(parallel, np.where(between, -np.inf, np.inf), np.minimum(a, b))
    leave = np.where(parallel, np.where(between, np.inf, -np.inf), np.maximum(a, b)).min(axis=1)
    face = np.where(enter.max(axis=1) > 0.0, enter.argmax(axis=1), -1)
    return np.maximum(enter.max(axis=1), 0.0), np.maximum(leave, 0.0), face


def _hash(x: NDArray[np.int64], y: NDArray[np.int64], seed: int) -> Array:
    """Return a hash of pixel and seed, 0…1; bit for bit the same as in rays.clh."""
    with np.errstate(over="ignore"):
        h = x.astype(np.uint32) * np.uint32(0x8DA6B343) ^ y.astype(np.uint32) * np.uint32(
            0xD8163841
        )
        h ^= np.uint32(seed) * np.uint32(0xCB1AB31F)
        h = (h ^ (h >> np.uint32(16))) * np.uint32(0x7FEB352D)
        h = (h ^ (h >> np.uint32(15))) * np.uint32(0x846CA68B)
        h ^= h >> np.uint32(16)
    return (h >> np.uint32(8)) * 2.0**-24


class Sampler:
    """Trilinear field of a volume's values, or of opacities if the values are labels."""

    def __init__(
        self, volume: Volume, table: TransferTable | SurfaceTable, spec: RaycastSpec
    ) -> None:
        values = volume.values.astype(np.float64)
        self.labels: NDArray[np.int64] | None = None
        if isinstance(table, TransferTable) and table.labels:
            # One more entry, transparent, for labels that the table lacks.
            opacity = np.append(table.step_opacity(spec.step_of(volume)), 0.0)
            unknown = len(opacity) - 1
            valid = (values >= 0) & (values < unknown)
            self.labels = np.where(valid, values, unknown).astype(np.int64)
            values = opacity[self.labels]
        self._values = values
        self._least_present = volume.least_present if self.labels is None else -np.inf
        self._scale = gradient_scale(table, volume, spec)
        self._world = volume.index_from_world[:3, :3] * min(volume.spacing_mm)
        # Value per mm -> fraction of the range per smallest spacing, the unit of gradients.
        self.fraction_per_mm = max(spec.gradient_scale(volume) * min(volume.spacing_mm), TINY)

    def value(self, point: Array) -> Array:
        """Return (R,) values at (R, 3) index positions."""
        return trilinear(self._values, point)

    def is_present(self, point: Array) -> NDArray[np.bool_]:
        """Return (R,) True for samples of which no missing voxel is a part."""
        if self._least_present == -np.inf:
            return np.ones(len(point), np.bool_)
        return trilinear(self._present.astype(np.float64), point) > PRESENT

    @cached_property
    def _present(self) -> NDArray[np.bool_]:
        return self._values >= self._least_present

    @cached_property
    def _slopes(self) -> Array:
        return differences(self._values, self._present) * self._present

    def gradient(self, point: Array) -> Array:
        """Return (R, 3) gradients in the world, fraction of the range per smallest spacing.

        They are trilinear in `differences`, by the weights of the voxels that are there.
        """
        gradient = np.stack([trilinear(slope, point) for slope in self._slopes], axis=1)
        present = trilinear(self._present.astype(np.float64), point)
        gradient /= np.where(present > 0, present, 1.0)[:, None]
        return self._scale * gradient @ self._world

    def label(self, point: Array) -> NDArray[np.int64]:
        """Return (R,) labels with the greatest sum of trilinear weight times opacity."""
        assert self.labels is not None
        base, f = cell(self.labels.shape, point)
        labels, covers = [], []
        for row in range(4):
            y, z = base[:, 1] + (row & 1), base[:, 2] + (row >> 1)
            wy = f[:, 1] if row & 1 else 1 - f[:, 1]
            wz = f[:, 2] if row >> 1 else 1 - f[:, 2]
            for side, wx in ((0, 1 - f[:, 0]), (1, f[:, 0])):
                x = base[:, 0] + side
                labels.append(self.labels[z, y, x])
                covers.append(self._values[z, y, x] * wx * wy * wz)
        best, best_total = labels[0], np.full(len(point), -1.0)
        for one in labels:
            total = sum(
                np.where(other == one, cover, 0.0)
                for other, cover in zip(labels, covers, strict=True)
            )
            more = total > best_total * 1.000001
            best, best_total = np.where(more, one, best), np.where(more, total, best_total)
        return best


def differences(values: Array, present: NDArray[np.bool_]) -> Array:
    """Return (3, Z, Y, X) slopes per voxel along x, y, z of the voxels that are present.

    They are over ± 1 voxel, or from a voxel to the one neighbour that it has.
    """
    slopes = np.zeros((3, *values.shape))
    for axis, slope in zip((2, 1, 0), slopes, strict=True):
        by_axis = np.moveaxis(slope, axis, 0)
        rises = np.moveaxis(np.diff(values, axis=axis), axis, 0)
        flags = np.moveaxis(present, axis, 0)
        both = flags[1:] & flags[:-1]
        count = np.zeros(by_axis.shape)
        for side in (slice(1, None), slice(None, -1)):
            by_axis[side] += np.where(both, rises, 0.0)
            count[side] += both
        by_axis /= np.maximum(count, 1.0)
    return slopes


def cell(shape: tuple[int, ...], point: Array) -> tuple[NDArray[np.int64], Array]:
    """Return (R, 3) first voxels of the cells around points (x, y, z), and positions within."""
    top = np.array(shape[::-1]) - 1.0
    inside = np.clip(point, 0, top)
    base = np.minimum(inside.astype(int), np.maximum(top.astype(int) - 1, 0))
    return base, inside - base


def trilinear(values: Array, point: Array) -> Array:
    """Interpolate values[z, y, x] at (R, 3) index positions, clamped to the grid."""
    base, f = cell(values.shape, point)
    x, y, z = base.T
    fx, fy, fz = f.T
    near, far = (
        lerp(
            lerp(values[k, y, x], values[k, y, x + 1], fx),
            lerp(values[k, y + 1, x], values[k, y + 1, x + 1], fx),
            fy,
        )
        for k in (z, z + 1)
    )
    return lerp(near, far, fz)


def shade(
    arrives: dict[int, Transmittance],
    volume: Volume,
    camera: Camera,
    spec: RaycastSpec,
    lift_mm: float,
    point: Array,
    direction: Array,
    gradient: Array | None,
    offset: Array,
) -> tuple[Array, Array]:
    """Shade samples by group: factors of the reflectance, and white highlights to add, (R, L).

    ``arrives`` holds the shadows and occlusion of sources that have them, numbered as by
    `numbered_sources`. The rest are arguments of `shade_by_source`.
    """
    factor = np.zeros((len(point), len(spec.groups)))
    highlight = np.zeros_like(factor)
    for term in shade_by_source(volume, camera, spec, lift_mm, point, direction, gradient, offset):
        lights = term.factor, term.highlight
        if term.number in arrives:
            assert term.in_front is not None
            passes = arrives[term.number](term.in_front)
            lights = passes * term.factor, passes * term.highlight
        factor[:, term.group] += lights[0]
        highlight[:, term.group] += lights[1]
    return factor, highlight


class SourceShade(NamedTuple):
    """Shade of R samples by one source, without shadow or occlusion."""

    number: int  # of the source, and of its group
    group: int
    occluded: bool  # not shadowed: light from all directions
    factor: Array  # (R,) of the reflectance
    highlight: Array  # (R,)
    in_front: Array | None  # (R, 3) index positions at which its shadow is read


def shade_by_source(
    volume: Volume,
    camera: Camera,
    spec: RaycastSpec,
    lift_mm: float,
    point: Array,
    direction: Array,
    gradient: Array | None,
    offset: Array,
) -> Iterator[SourceShade]:
    """Yield the unshadowed shade of samples by every source.

    Shadows are read ``lift_mm`` in front of surfaces and ``offset`` (R, 3), mm, from there.
    ``point`` (R, 3) is in index space, ``direction`` the ray's unit vector in the world;
    ``gradient`` is None if nothing is shaded or shadowed.
    """
    world = point @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3]
    if gradient is not None:
        square = (gradient**2).sum(axis=1)
        confidence = square / (square + spec.gradient_floor_squared)
        normal = gradient / np.sqrt(np.maximum(square, TINY))[:, None]
    for number, (group, source) in enumerate(numbered_sources(spec)):
        towards, light = source_at(camera, source, world, direction)
        in_front = None
        if gradient is not None:
            n_dot_l = (normal * towards).sum(axis=1)
            side = np.where(n_dot_l < 0, -1.0, 1.0) * confidence * lift_mm
            lift = side[:, None] * normal + offset
            in_front = point + lift @ volume.index_from_world[:3, :3].T
        highlight = np.zeros(len(point))
        if isinstance(source, Ambient):
            factor = light * spec.ambient
        elif not spec.shaded:
            factor = light * spec.diffuse
        else:
            half = towards - direction
            half = half / np.maximum(np.linalg.norm(half, axis=1, keepdims=True), 1e-6)
            n_dot_h = np.minimum(np.abs((normal * half).sum(axis=1)), 1.0)
            factor = light * spec.diffuse * (1 + confidence * (np.abs(n_dot_l) - 1))
            highlight = light * spec.specular * confidence * n_dot_h**spec.shininess
        yield SourceShade(number, group, isinstance(source, Ambient), factor, highlight, in_front)


def source_at(
    camera: Camera, source: Source, world: Array, direction: Array
) -> tuple[Array, Array]:
    """Return (R, 3) unit vectors towards a source (ambient: the eye), and (R,) intensities.

    ``world`` are the points in mm, ``direction`` unit vectors from the eye.
    """
    light = np.full(len(world), source.intensity)
    if isinstance(source, Directional):
        towards = camera.to_world(source.towards, source.frame)
        return np.broadcast_to(towards, world.shape), light
    if not isinstance(source, Point):
        return -direction, light
    towards = camera.place_mm(source.position_mm, source.frame) - world
    distance = np.linalg.norm(towards, axis=1)
    if source.falloff_mm is not None:
        squared = source.falloff_mm**2
        light = light * squared / np.maximum(distance**2, NEAR_LAMP**2 * squared)
    towards = towards / np.maximum(distance, TINY)[:, None]
    if isinstance(source, Spot):
        *plane, height = source.beam(camera)
        inside = np.clip(towards @ plane + height, 0.0, 1.0)
        light = light * inside**2 * (3.0 - 2.0 * inside)
    return towards, light


def classify(
    table: TransferTable, sampler: Sampler, point: Array, gradient: Array | None, step_mm: float
) -> tuple[Array, Array]:
    """Return (R,) opacity of a step and (R, M) reflectance of samples; missing ones have none."""
    opacity, reflectance = _classify(table, sampler, point, gradient, step_mm)
    return np.where(sampler.is_present(point), opacity, 0.0), reflectance


def _classify(
    table: TransferTable, sampler: Sampler, point: Array, gradient: Array | None, step_mm: float
) -> tuple[Array, Array]:
    value = sampler.value(point)
    if table.labels:
        channels = np.vstack([table.coefficients, np.zeros(table.size)])
        return value, channels[sampler.label(point)]
    j, f = find_entry(table, value)
    sides = table, table.left_limits
    coefficients = [side.coefficients for side in sides]
    if needs_powers(table):
        alone = interpolate([side.opacity for side in sides], j, f)
        power = step_mm / table.reference_step_mm
        return 1 - (1 - alone) ** power, interpolate(coefficients, j, f)
    opacity = [side.step_opacity(step_mm) for side in sides]
    if table.gradient_top is None:
        return interpolate(opacity, j, f), interpolate(coefficients, j, f)
    assert gradient is not None
    rows, entries = len(table.opacity) - 1, table.opacity.shape[1]
    steepness = np.linalg.norm(gradient, axis=1) / sampler.fraction_per_mm
    height = np.clip(steepness / table.gradient_top * rows, 0, rows)
    row = np.minimum(height.astype(int), rows - 1)
    g = height - row
    flat = [
        [array.reshape(-1, *array.shape[2:]) for array in both] for both in (opacity, coefficients)
    ]
    low, high = row * entries + j, (row + 1) * entries + j
    step_opacity, reflectance = (
        lerp(interpolate(array, low, f), interpolate(array, high, f), g) for array in flat
    )
    return step_opacity, reflectance


def opacity_of_matter(
    table: TransferTable, sampler: Sampler, point: Array, opacity: Array, step_mm: float
) -> Array:
    """Return (R,) opacity of a step in the matter at samples: the labels', else as it is there."""
    if not table.labels:
        return opacity
    return np.append(table.step_opacity(step_mm), 0.0)[sampler.label(point)]


def find_entry(table: TransferTable, value: Array) -> tuple[Index, Array]:
    """Return the entry before each value, and the position between it and the next, 0…1."""
    low, high = table.domain
    last = table.opacity.shape[-1] - 1
    position = np.clip((value - low) / (high - low) * last, 0, last)
    j = np.minimum(position.astype(int), last - 1)
    return j, position - j


def interpolate(sides: Sequence[Array], j: Index, f: Array) -> Array:
    """Interpolate at j + f: entries, and their left limits, from an entry to the next's limit."""
    entries, limits = sides
    return lerp(entries[j], limits[j + 1], f)


def lerp(a: Array, b: Array, f: Array) -> Array:
    """Interpolate (R, …) from a to b: exact if a equals b, within 0…1 if both are."""
    f = f.reshape(-1, *(1,) * (a.ndim - 1))
    return a + f * (b - a)
