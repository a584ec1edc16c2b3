"""The reference raycaster and light volume: NumPy, float64, every sample, no skipping.

    volume -> transfer -> [raycast] -> relight -> appearance

A pixel's ray is divided into steps kΔ…(k+1)Δ measured from the camera and clipped to the visible
part of the volume; each is sampled at its middle and weighted by its clipped length. A homogeneous
body therefore has exactly Beer-Lambert's transmittance along any ray. Front to back

    α = 1 − (1 − opacity(v))^(length / reference step)
    C += T α (g s(v) + k_s),   T ← T (1 − α) (docs/method.md §3)

The light volume holds transmittances T towards a light from the nodes of a coarse grid:

    σ(node) = mean of −log(1 − opacity(v)) / reference step over the voxels nearest to it, or
              between them where nodes are denser
    T(node) = exp(−∫ σ ds) towards the light
    open(node) = min(1, 2 · mean of T over the sphere)

σ is trilinear between nodes and falls to 0 within a cell beyond the outermost ones. The integral
is sampled at the middles of steps of a cell.

Twins: ``kernels/raycast.cl``, those named below, and ``kernels/light_volume.cl``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Camera
from volspec.image import OCCLUSION_GAIN
from volspec.raycast.launch.fields import FieldCast, add_pictures
from volspec.raycast.launch.kernel_arguments import (
    CUT_TOLERANCE,
    LIGHT_MARGIN,
    MIX_OPAQUE,
    check_reach,
)
from volspec.raycast.launch.layer_stream import (
    LayerStream,
    Samples,
    SampleStream,
    Shadow,
    shadow_slots,
)
from volspec.raycast.launch.light_volume import (
    HALF,
    LightGrid,
    Visibility,
    extinction_per_mm,
    light_layers,
    material_tables,
    sphere_directions,
    unblocked_part,
    upsample_values,
)
from volspec.raycast.launch.masks import MaskLattice
from volspec.raycast.launch.sampling import (
    TINY,
    Array,
    CastRays,
    Index,
    Sampler,
    Transmittance,
    classify,
    differences,
    find_entry,
    interpolate,
    make_rays,
    opacity_of_matter,
    shade,
    shade_by_source,
    trilinear,
)
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import (
    SurfaceTable,
    Table,
    Tables,
    TransferTable,
    segment_means,
)
from volspec.volume import Volume

Result = tuple[Array, Array, Array, Array]
# `transmittances`; then those at half of all depths, of each material alone, then of all; and
# unclipped; these without what surfaces keep, which is last.
Lights = tuple[
    dict[int, Transmittance],
    list[dict[int, Transmittance]],
    dict[int, Transmittance],
]


def cast(
    volume: Volume,
    table: Tables,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
    span_mm: NDArray[np.float32] | None = None,
    clear: Visibility | None = None,
) -> Result:
    """Cast every pixel of a picture of (width, height), within ``span_mm`` (H, W, 2), if given.

    ``clear`` is what surfaces keep from the volume, as `Raycaster.cast`.

    Returns coefficients (H, W, L·M), premultiplied by opacity; alpha; depth_mm, the expected
    distance from the camera, and first_mm, the distance of the first hit, both inf in empty pixels.
    """
    check_reach(volume, camera, spec)
    if spec.add_fields:
        alone, args = replace(spec, add_fields=False), (span_mm, clear)
        pictures: Any = [
            cast(volume, one, camera, size, alone, *args) for one in table.split_fields()
        ]
        return tuple(add_pictures(pictures))  # type: ignore[return-value]  # four again

    def clipped_rays(volume: Volume, spec: RaycastSpec) -> CastRays:
        return _within(make_rays(volume, camera, size, spec), span_mm)

    fields = FieldCast.of(volume, table, spec)
    frame, spec = fields.frame, fields.spec
    kind: type[_March] = _March
    if fields.several is not None:
        kind = _Fields
    elif isinstance(table, SurfaceTable):
        kind = _Surfaces
    elif spec.mode != "composite":
        kind = _Projection
    elif spec.preintegrated:
        kind = _Preintegrated
    elif table.filters is not None:
        kind = _Filtered
    arrives = transmittances(frame, table, spec, camera, clear)
    rays = clipped_rays(frame, spec.for_field(None))
    march = kind(frame, table, camera, spec, rays, arrives)
    if isinstance(march, _Fields):
        march.rays_of = {
            name: march.cropped(clipped_rays(frame.by_name[name], of_field))
            for name, of_field in fields.specs.items()
        }
    march.march()
    return march.picture(size)


def cast_layers(
    volume: Volume,
    table: TransferTable,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
    span_mm: NDArray[np.float32] | None = None,
    streams: Sequence[SampleStream] = (),
    lights: Lights | None = None,
    clear: Visibility | None = None,
) -> tuple[Result, Array]:
    """Cast a picture with `RaycastSpec.layers`, as `cast`, and return its layers, too.

    They are (H, W, L, `row_size`), of materials in the table's order, and of whole rays: they do
    not end where the picture's rays do. ``streams`` receive the same samples. ``lights`` are as
    `split_transmittances`, which it are by default.
    """
    check_reach(volume, camera, spec)
    spec = spec.naming_fields(volume).for_field(volume.name)
    rays = _within(make_rays(volume, camera, size, spec), span_mm)
    lights = lights or split_transmittances(volume, table, spec, camera, clear)
    cast = _Layered(volume, table, camera, spec, rays, lights)
    cast.streams = cast.stream, *streams
    cast.march()
    rows = cast.stream.rows()
    return cast.picture(size), rows.reshape(size[1], size[0], *rows.shape[1:])


def _within(rays: CastRays, span_mm: NDArray[np.float32] | None) -> CastRays:
    """Return rays that begin and end within (H, W, 2) distances, if given."""
    if span_mm is None:
        return rays
    begin, end = span_mm.reshape(-1, 2).T
    return replace(rays, near=np.maximum(rays.near, begin), far=np.minimum(rays.far, end))


class _March:
    """Compositing of all rays, step by step; subclasses for other casts override parts."""

    def __init__(
        self,
        volume: Volume,
        table: Any,
        camera: Camera,
        spec: RaycastSpec,
        rays: CastRays,
        arrives: dict[int, Transmittance],
    ) -> None:
        self.volume, self.table, self.camera = volume, table, camera
        self.spec, self.rays = spec, rays
        self.cut_rays = rays  # whose cuts the samples lie behind
        self.arrives = arrives
        self.lift_mm = LightGrid.for_spec(volume, spec).lift_mm(table)
        # Of a step in the matter at each ray's sample, by which physical light is lifted.
        self.matter = np.zeros(len(rays.near))
        self.normals = spec.shaded or bool(self.arrives)
        self.step = spec.step_of(volume)
        count = len(rays.near)
        self.alpha, self.depth = np.zeros(count), np.zeros(count)
        self.first, self.transmittance = np.full(count, np.inf), np.ones(count)
        self.colour = np.zeros((count, len(spec.groups), table.size))

    @cached_property
    def sampler(self) -> Sampler:
        """Field of the volume's values; of several fields, each has its own."""
        return Sampler(self.volume, self.table, self.spec)

    def march(self) -> None:
        """March all rays front to back, one step at a time."""
        rays, step = self.rays, self.step
        k = np.floor((rays.near - rays.shift) / step)
        while True:
            begin = np.maximum(k * step + rays.shift, rays.near)
            end = np.minimum((k + 1) * step + rays.shift, rays.far)
            live = np.flatnonzero((end > begin) & (self.transmittance > self.least_transmittance))
            if not live.size:
                break
            self.step_rays(live, begin[live], end[live])
            k[live] += 1

    @property
    def least_transmittance(self) -> float:
        """Transmittance at which a ray ends."""
        return self.spec.least_transmittance

    def picture(self, size: tuple[int, int]) -> Result:
        """Return the picture of (width, height), after the march."""
        shape = size[::-1]
        with np.errstate(divide="ignore", invalid="ignore"):
            expected = np.where(self.alpha > 0, self.depth / self.alpha, np.inf)
        colour = self.colour.reshape(*shape, -1)
        parts = self.alpha, expected, self.first
        return (colour, *(part.reshape(shape) for part in parts))  # type: ignore[return-value]

    def point(self, rays: Index, distance: Array) -> Array:
        """Return (R, 3) index positions at ``distance`` mm."""
        return self.rays.start[rays] + distance[:, None] * self.rays.index_direction[rays]

    def step_rays(self, live: Index, begin: Array, end: Array) -> None:
        """Take one step of each live ray."""
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        shaded = self.normals or self.table.gradient_top is not None
        gradient = self.sampler.gradient(point) if shaded else None
        opacity, reflectance = classify(self.table, self.sampler, point, gradient, self.step)
        matter = opacity_of_matter(self.table, self.sampler, point, opacity, self.step)
        self.matter[live] = matter
        alpha = 1 - (1 - opacity) ** ((end - begin) / self.step)
        self.composite(live, middle, point, gradient, alpha, reflectance)

    def composite(
        self,
        live: Index,
        distance: Array,
        point: Array,
        gradient: Array | None,
        alpha: Array,
        reflectance: Array,
    ) -> None:
        """Composite samples of opacity alpha."""
        light = self.light(live, distance, point, gradient, reflectance)
        weight = self.transmittance[live] * alpha
        self.colour[live] += weight[:, None, None] * light
        self.add_alpha(live, distance, weight)
        self.transmittance[live] -= weight

    def light(
        self,
        live: Index,
        distance: Array,
        point: Array,
        gradient: Array | None,
        reflectance: Array,
    ) -> Array:
        """Return (R, L, M) the light that samples reflect, by group."""
        factor, highlight = self.shade(live, distance, point, gradient)
        material = factor[:, :, None] * reflectance[:, None, :]
        return material + highlight[:, :, None] * self.table.white

    def shade(
        self, live: Index, distance: Array, point: Array, gradient: Array | None
    ) -> tuple[Array, Array]:
        """Return the factors of the samples' reflectances and the highlights, (R, L) each."""
        return shade(self.arrives, *self.shading(live, distance, point, gradient))

    def shading(self, live: Index, distance: Array, point: Array, gradient: Array | None) -> Any:
        """Return the arguments of `shade_by_source` for samples."""
        lift, direction = np.full(len(live), self.lift_mm), self.rays.direction[live]
        gradient = gradient if self.normals else None
        by_matter = self.spec.physical_light and not isinstance(self.table, SurfaceTable)
        if by_matter:
            per_step = min(self.volume.spacing_mm) / self.step
            lift *= (1 - (1 - self.matter[live]) ** per_step) ** 16
        offset = self.cut_rays.above_cut(live, distance, lift)
        if by_matter:
            # Opaque matter that is cut is seen in the first step.
            stride = (2.001 if self.spec.adaptive else 0.501) * self.step
            first = max(min(self.volume.spacing_mm), stride)
            offset[self.cut_rays.below_cut(live, distance) >= first] = 0.0
        if by_matter and gradient is not None:
            square = (gradient**2).sum(axis=1)
            lift *= np.sqrt(square) / (square + self.spec.gradient_floor_squared)
            eye = np.where((gradient * direction).sum(axis=1) > 0, -1.0, 1.0)
            offset += (eye * lift)[:, None] * gradient
        lift_mm = 0.0 if by_matter else self.lift_mm
        context = self.volume, self.camera, self.spec, lift_mm
        return *context, point, direction, gradient, offset

    def add_alpha(self, live: Index, distance: Array, alpha: Array) -> None:
        """Sum alpha and depth, and find the first hit."""
        self.alpha[live] += alpha
        hit = np.isinf(self.first[live]) & (self.alpha[live] >= self.spec.first_opacity)
        self.first[live[hit]] = distance[hit]
        self.depth[live] += alpha * distance


class _Layered(_March):
    """A picture and its layers of opacity; twin: raycast.cl with LAYERED."""

    def __init__(
        self,
        volume: Volume,
        table: TransferTable,
        camera: Camera,
        spec: RaycastSpec,
        rays: CastRays,
        lights: Lights,
    ) -> None:
        super().__init__(volume, table, camera, spec, rays, lights[0])
        groups, materials = len(spec.groups), len(table.channels)
        slots = shadow_slots(spec)
        self.stream = LayerStream(len(rays.near), spec.layers, groups, materials, slots)
        self.streams: Sequence[SampleStream] = (self.stream,)
        # The table whose channels are the materials themselves.
        weights = np.eye(materials), np.zeros(materials)
        self.weights = replace(table, channels=weights[0], white=weights[1])
        self.split, self.unblocked = lights[1:]

    @property
    def least_transmittance(self) -> float:
        """Return a transmittance below any: layers are of whole rays."""
        return -1.0

    def composite(
        self,
        live: Index,
        distance: Array,
        point: Array,
        gradient: Array | None,
        alpha: Array,
        reflectance: Array,
    ) -> None:
        factor, highlight, shadows = self.unshadowed(live, distance, point, gradient)
        _, weights = classify(self.weights, self.sampler, point, gradient, self.step)
        visible = np.flatnonzero(alpha > 0)
        samples = Samples(distance, alpha, weights, factor, highlight, shadows).of(visible)
        for stream in self.streams:
            stream.add(live[visible], samples)
        reached = self.transmittance[live] > self.spec.least_transmittance
        reached_alpha = np.where(reached, alpha, 0.0)
        super().composite(live, distance, point, gradient, reached_alpha, reflectance)

    def unshadowed(
        self, live: Index, distance: Array, point: Array, gradient: Array | None
    ) -> tuple[Array, Array, list[Shadow]]:
        """Return factors and highlights without shadows, as `shade`, and the shadows."""
        factor = np.zeros((len(live), len(self.spec.groups)))
        highlight, shadows = np.zeros_like(factor), []
        for term in shade_by_source(*self.shading(live, distance, point, gradient)):
            in_front = term.in_front
            if term.number in self.unblocked:
                assert in_front is not None
                part = self.unblocked[term.number](in_front)
                term = term._replace(factor=part * term.factor, highlight=part * term.highlight)
            factor[:, term.group] += term.factor
            highlight[:, term.group] += term.highlight
            if term.number in self.arrives:
                assert in_front is not None
                *alone, half, full = (lights[term.number](in_front) for lights in self.split)
                light = term.factor, term.highlight, in_front, self.arrives[term.number](in_front)
                slot = term.group, term.occluded
                shadows.append(Shadow(term.number, slot, *light, half, full, np.stack(alone, 1)))
        return factor, highlight, shadows


class _Fields(_March):
    """Several fields in one place; twin: fields.cl.

    α = 1 − Π (1 − α_f), and a field's part of it is τ_f / Σ τ, τ_f = −log(1 − α_f)

    With a mask, τ_f = Σ w_r τ_r: the mean of its rows, by weight.
    """

    rays_of: Mapping[str, CastRays]  # of every field in its own index space

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.samplers = {
            name: Sampler(self.volume.by_name[name], one, self.spec)
            for name, one in self.table.tables.items()
        }
        self.masks = {
            name: MaskLattice.of(self.volume, name, mask) for name, mask in self.table.masks.items()
        }

    def cropped(self, rays: CastRays) -> CastRays:
        """Return a field's rays, cut by the frame's crop if there is one."""
        if self.spec.crop_voxels is None:
            return rays
        near, far = np.maximum(rays.near, self.rays.near), np.minimum(rays.far, self.rays.far)
        return replace(rays, near=near, far=far)

    def march(self) -> None:
        self.later_cuts = {name: self._later_cuts(rays) for name, rays in self.rays_of.items()}
        bundles = list(self.rays_of.values())
        meets = [r.near < r.far for r in bundles]
        near = np.min([np.where(m, r.near, np.inf) for r, m in zip(bundles, meets, strict=True)], 0)
        far = np.max([np.where(m, r.far, -np.inf) for r, m in zip(bundles, meets, strict=True)], 0)
        near = np.where(near < far, near, 0.0)
        begin = near - self.rays.shift
        k = np.floor(begin / self.step)
        while True:
            distance = k * self.step + self.rays.shift
            stop = self.spec.least_transmittance
            live = np.flatnonzero((distance < far) & (self.transmittance > stop))
            if not live.size:
                break
            self.step_rays(live, distance[live], distance[live] + self.step)
            k[live] += 1

    def step_rays(self, live: Index, begin: Array, end: Array) -> None:
        passed, parts, passes = np.ones(len(live)), [], np.ones(len(live))
        for name, sampler in self.samplers.items():
            rays = self.rays_of[name]
            first, last = np.maximum(begin, rays.near[live]), np.minimum(end, rays.far[live])
            middle = 0.5 * (first + last)
            point = rays.start[live] + middle[:, None] * rays.index_direction[live]
            gradient = sampler.gradient(point) if self.normals else None
            opacity, reflectance = self._classify(name, point, gradient)
            alpha = 1 - (1 - opacity) ** (np.maximum(last - first, 0.0) / self.step)
            passed *= 1 - alpha
            passes *= np.where(last > first, 1 - opacity, 1.0)
            extinction = -np.log1p(-np.minimum(alpha, 1 - MIX_OPAQUE))
            parts.append((extinction, middle, gradient, reflectance))
        self.matter[live] = 1 - passes
        weight = self.transmittance[live] * (1 - passed)
        total = np.maximum(sum(part[0] for part in parts), TINY)
        distance = np.zeros(len(live))
        for name, (extinction, middle, gradient, reflectance) in zip(
            self.samplers, parts, strict=True
        ):
            self.cut_rays = self.later_cuts[name]
            part = weight * extinction / total
            light = self.light(live, middle, self.point(live, middle), gradient, reflectance)
            self.colour[live] += part[:, None, None] * light
            distance += part * middle
        self.add_alpha(live, distance / np.maximum(weight, TINY), weight)
        self.transmittance[live] -= weight

    def _later_cuts(self, rays: CastRays) -> CastRays:
        """Return the rays with the cuts of a field's own, where these are behind the frame's."""
        later = rays.cut_mm > self.rays.cut_mm
        normal = np.where(later[:, None], rays.cut_normal, self.rays.cut_normal)
        cut_mm = np.maximum(rays.cut_mm, self.rays.cut_mm)
        return replace(self.rays, cut_mm=cut_mm, cut_normal=normal)

    def _classify(self, name: str, point: Array, gradient: Array | None) -> tuple[Array, Array]:
        """Return a field's (R,) opacity of a step and (R, M) reflectance."""
        tables, sampler = self.table.rows(name), self.samplers[name]
        classified = [classify(one, sampler, point, gradient, self.step) for one in tables]
        if name not in self.masks:
            return classified[0]
        opacity, reflectance = (np.stack(part, axis=1) for part in zip(*classified, strict=True))
        weights = self.masks[name].weights(point, len(tables))
        extinction = -weights * np.log1p(-np.minimum(opacity, 1 - MIX_OPAQUE))
        total = extinction.sum(axis=1)
        # A row alone is as opaque as it says.
        alone = weights.max(axis=1) > 1 - 1e-9
        parts = np.where(alone[:, None], weights, extinction / np.maximum(total, TINY)[:, None])
        mixed = np.where(alone, (weights * opacity).sum(axis=1), -np.expm1(-total))
        return mixed, (parts[:, :, None] * reflectance).sum(axis=1)


class _Filtered(_March):
    """Spectral absorption: one transmittance per channel; twin: raycast.cl with FILTERED.

    C_k += T_k (1 − t_k^length) (g s_k(v) + k_s white_k),   T_k ← T_k t_k^length

    so that a channel reflects as much as it loses, and alpha is the mean loss of all channels.
    """

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.channel_transmittance = np.ones((len(self.transmittance), self.table.size))

    def step_rays(self, live: Index, begin: Array, end: Array) -> None:
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        gradient = self.sampler.gradient(point) if self.normals else None
        opacity, reflectance = classify(self.table, self.sampler, point, gradient, self.step)
        self.matter[live] = opacity
        entries = [
            side.step_transmittance(self.step) for side in (self.table, self.table.left_limits)
        ]
        j, f = find_entry(self.table, self.sampler.value(point))
        passed = interpolate(entries, j, f) ** ((end - begin) / self.step)[:, None]
        absorbed = self.channel_transmittance[live] * (1 - passed)
        light = self.light(live, middle, point, gradient, reflectance)
        self.colour[live] += absorbed[:, None, :] * light
        self.channel_transmittance[live] *= passed
        left = self.channel_transmittance[live].mean(axis=1)
        self.add_alpha(live, middle, self.transmittance[live] - left)
        self.transmittance[live] = left


class _Preintegrated(_March):
    """The transfer function integrated between a step's ends; twin: preintegrated.cl."""

    def step_rays(self, live: Index, begin: Array, end: Array) -> None:
        points = [self.point(live, distance) for distance in (begin, end)]
        ends = [self.sampler.value(point) for point in points]
        means = segment_means(self.table, self.step, *ends)
        # A step into opaque matter is a surface, of whichever mean.
        depths = [segment_means(self.table, self.step, end, end)[:, 0] for end in ends]
        self.matter[live] = -np.expm1(-np.max([means[:, 0], *depths], axis=0))
        alpha = -np.expm1(-means[:, 0] * (end - begin) / self.step)
        # No values lie between one and a missing one.
        alpha *= np.all([self.sampler.is_present(point) for point in points], axis=0)
        reflectance = means[:, 1:] / np.maximum(means[:, :1], TINY) @ self.table.channels
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        gradient = self.sampler.gradient(point) if self.normals else None
        self.composite(live, middle, point, gradient, alpha, reflectance)


class _Surfaces(_March):
    """Isosurfaces, cell by cell, in which values along a ray are cubics; twin: surfaces.cl."""

    def step_rays(self, live: Index, begin: Array, end: Array) -> None:
        while live.size:
            leave = np.minimum(self._next_face(live, begin), end)
            distances = begin[:, None] + (leave - begin)[:, None] * (np.arange(4) / 3)
            values = [self.sampler.value(self.point(live, distance)) for distance in distances.T]
            cubic = np.linalg.inv(np.vander(np.arange(4) / 3)) @ values  # highest power first
            knots = [np.zeros(len(live)), *_extrema(cubic), np.ones(len(live))]
            inner = (np.polyval(cubic, knot) for knot in knots[1:3])
            knots_values = [values[0], *inner, values[3]]
            # Missing voxels end a surface and make none.
            present = self.sampler.is_present(self.point(live, 0.5 * (begin + leave)))
            for u, w, front, back in zip(
                knots, knots[1:], knots_values, knots_values[1:], strict=False
            ):
                pieces = u, w, front, np.where(present, back, front)
                self._cross(live, begin, leave - begin, cubic, *pieces)
            more = leave < end
            live, begin, end = live[more], leave[more], end[more]

    def _next_face(self, live: Index, distance: Array) -> Array:
        """Return the distance at which rays leave the cells that they enter at ``distance`` mm."""
        direction, start = self.rays.index_direction[live], self.rays.start[live]
        place = start + distance[:, None] * direction
        face = np.where(direction > 0, np.floor(place) + 1, np.ceil(place) - 1)
        with np.errstate(divide="ignore", invalid="ignore"):
            leave = (face - start) / direction
            leave = np.where(leave > distance[:, None], leave, leave + 1 / np.abs(direction))
        return np.where(direction == 0, np.inf, leave).min(axis=1)

    def _cross(
        self,
        live: Index,
        begin: Array,
        length: Array,
        cubic: Array,
        u: Array,
        w: Array,
        front: Array,
        back: Array,
    ) -> None:
        """Composite the crossings of a monotone piece, from u to w of cells' parts 0…1."""
        table, rising = self.table, back > front
        for s in range(len(table.values)):
            which = np.where(rising, s, len(table.values) - 1 - s)
            level = table.values[which]
            left = self.transmittance[live] > self.spec.least_transmittance
            met = ((front < level) != (back < level)) & left
            if not met.any():
                continue
            rays, which, low, high = live[met], which[met], u[met], w[met]
            for _ in range(40):
                middle = 0.5 * (low + high)
                value = np.polyval(cubic[:, met], middle)
                before = (value < level[met]) == (front[met] < level[met])
                low, high = np.where(before, middle, low), np.where(before, high, middle)
            distance = begin[met] + low * length[met]
            point = self.point(rays, distance)
            gradient = self.sampler.gradient(point) if self.normals else None
            reflectance = (table.material_weights @ table.channels)[which]
            self.composite(rays, distance, point, gradient, table.opacity[which], reflectance)


def _extrema(cubic: Array) -> list[Array]:
    """Return the two places between 0 and 1 at which cubics (4, R) turn; 0 if they do not."""
    a, b, c = cubic[2], cubic[1], cubic[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - 3 * a * c)
        q = -b - np.where(b < 0, -root, root)
        roots = [np.where((u > 0) & (u < 1), u, 0.0) for u in (q / (3 * c), a / q)]
    return [np.minimum(*roots), np.maximum(*roots)]


class _Projection(_March):
    """The greatest or the mean value along a ray, of cells without missing voxels.

    Twin: projection.cl.
    """

    def march(self) -> None:
        count = len(self.rays.near)
        self.best, self.place = np.full(count, -np.inf), np.zeros(count)
        self.sum, self.length = np.zeros(count), np.zeros(count)
        super().march()
        touched = self.rays.far - self.rays.near <= CUT_TOLERANCE * min(self.volume.spacing_mm)
        rays = np.flatnonzero((self.length > 0) & ~touched)
        value, place = self.best[rays], self.place[rays]
        if self.spec.mode == "average":
            value = self.sum[rays] / self.length[rays]
            place = 0.5 * (self.rays.near + self.rays.far)[rays]
        j, f = find_entry(self.table, value)
        sides = self.table, self.table.left_limits
        alpha = interpolate([side.opacity for side in sides], j, f)
        reflectance = interpolate([side.coefficients for side in sides], j, f)
        unshaded = np.array(list(self.spec.strengths().values()))
        light = unshaded[:, None] * reflectance[:, None, :]
        self.colour[rays] = alpha[:, None, None] * light
        self.add_alpha(rays, place, alpha)

    def step_rays(self, live: Index, begin: Array, end: Array) -> None:
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        value, present = self.sampler.value(point), self.sampler.is_present(point)
        live, value, middle = live[present], value[present], middle[present]
        more = live[value > self.best[live]]
        self.place[more] = middle[value > self.best[live]]
        self.best[more] = value[value > self.best[live]]
        length = (end - begin)[present]
        self.sum[live] += length * value
        self.length[live] += length


def layers(
    volume: Volume,
    table: Tables,
    spec: RaycastSpec,
    camera: Camera,
    clear: Visibility | None = None,
    part: float | None = None,
) -> Array:
    """Return (L, nz, ny, nx), the fraction of light that arrives, for each of `light_layers`.

    With ``part``, depths are that part of theirs, and occlusion is the plain mean of directions.
    """
    grid = LightGrid.for_spec(volume, spec)
    sigma = (part or 1.0) * extinction(volume, table, spec, grid)
    gain = OCCLUSION_GAIN if part is None else 1.0
    arrays = []
    for layer in light_layers(spec, volume, camera):
        if layer.kind == "directional":
            arrays.append(_along_direction(sigma, grid, np.array(layer.vector), *layer.steps(grid)))
        elif layer.kind == "point":
            lamps = layer.lamps_mm(grid)
            arrays.append(np.mean([_towards(sigma, grid, lamp) for lamp in lamps], axis=0))
        else:
            steps = layer.steps(grid)
            rays = [_along_direction(sigma, grid, d, *steps) for d in sphere_directions()]
            arrays.append(np.minimum(gain * np.mean(rays, axis=0), 1))
        if clear is not None:
            arrays[-1] = arrays[-1] * unblocked_part(layer, grid, clear).reshape(sigma.shape)
    return np.reshape(arrays, (-1, *sigma.shape))


def transmittances(
    volume: Volume,
    table: Tables,
    spec: RaycastSpec,
    camera: Camera,
    clear: Visibility | None = None,
    part: float | None = None,
) -> dict[int, Transmittance]:
    """Return functions for shadows and occlusion, by index in `numbered_sources`; see `layers`."""
    requested = light_layers(spec, volume, camera)
    if not requested:
        return {}
    grid = LightGrid.for_spec(volume, spec)
    return {
        layer.source: partial(light_at, values, grid)
        for layer, values in zip(
            requested, layers(volume, table, spec, camera, clear, part), strict=True
        )
    }


def split_transmittances(
    volume: Volume,
    table: TransferTable,
    spec: RaycastSpec,
    camera: Camera,
    clear: Visibility | None = None,
) -> Lights:
    """Return the light past a table's materials, together and each alone; twin of ``split``."""
    arrives = transmittances(volume, table, spec, camera, clear)
    if not arrives:
        return arrives, [], {}
    of = partial(transmittances, volume, spec=spec, camera=camera)
    split = [of(single, part=HALF) for single in (*material_tables(table), table)]
    passed: dict[int, Transmittance] = {}
    if clear is not None:
        grid = LightGrid.for_spec(volume, spec)
        for layer in light_layers(spec, volume, camera):
            part = unblocked_part(layer, grid, clear).reshape(grid.shape_xyz[::-1])
            passed[layer.source] = partial(light_at, part, grid)
    return arrives, [*split, of(table, part=1.0)], passed


def light_at(layer: Array, grid: LightGrid, index: Array) -> Array:
    """Interpolate a layer (nz, ny, nx) at voxel indices (P, 3) x, y, z."""
    return trilinear(layer, index * np.array(grid.per_index) + LIGHT_MARGIN)


def extinction(volume: Volume, table: Tables, spec: RaycastSpec, grid: LightGrid) -> Array:
    """Return (nz, ny, nx) σ of each node, 1/mm; of several fields, the sum."""
    total = np.zeros(grid.shape_xyz[::-1])
    for name in table.by_field(volume.name):
        field, field_spec = volume.by_name[name], spec.for_field(name)
        of = partial(_field_extinction, volume=volume, tables=table, name=name)
        if field.has_lattice_of(volume):
            total += _on_nodes(of, field, field_spec, grid, table.labels)
            continue
        other = grid.alike(field)
        uncropped = replace(field_spec, crop_voxels=None)
        resampled = grid.resampled(_on_nodes(of, field, uncropped, other), other)
        total += grid.inside_crop(spec) * resampled
    return total


def _on_nodes(
    extinction_of: Callable[[Volume], Array],
    volume: Volume,
    spec: RaycastSpec,
    grid: LightGrid,
    labels: bool = False,
) -> Array:
    """Return (nz, ny, nx), the mean of voxels (Z, Y, X) that are not cut away."""
    lattice = grid.lattice(volume)
    voxels, dense = np.array(volume.shape_xyz) - 1, np.array(lattice) - 1
    if lattice != volume.shape_xyz:
        values, _ = upsample_values(volume.values, volume.shape_xyz, lattice, labels=labels)
        if volume.missing is not None:
            values = np.where(values < volume.least_present, volume.missing, values)
        matrix = volume.world_from_index @ np.diag([*(voxels / dense), 1.0])
        volume = replace(volume, values=values, spacing_mm=None, world_from_index=matrix, fields=())  # type: ignore[arg-type]
        if spec.crop_voxels is not None:
            i, j, k = (np.array(spec.crop_voxels) * (dense / voxels)[:, None]).tolist()
            spec = replace(spec, crop_voxels=(tuple(i), tuple(j), tuple(k)))
    sigma = np.where(_visible_mask(volume, spec), extinction_of(volume), 0.0)
    x, y, z = (_weights(n, c) for n, c in zip(volume.shape_xyz, grid.shape_xyz, strict=True))
    return np.einsum("zk,kji,yj,xi->zyx", z, sigma, y, x, optimize=True)


def _field_extinction(field: Volume, volume: Volume, tables: Tables, name: str) -> Array:
    """Return (Z, Y, X) σ of a field's voxels, each by the row of its mask that is nearest."""
    sigmas = [_table_extinction(field, one) for one in tables.by_field(name)[name]]
    mask = tables.masks.get(name)
    if mask is None:
        return sigmas[0]
    z, y, x = np.indices(field.values.shape)
    world = np.stack([x, y, z], axis=-1) @ field.world_from_index[:3, :3].T
    index = volume.by_name[name].index_from_world
    position = (world + field.world_from_index[:3, 3]) @ index[:3, :3].T + index[:3, 3]
    rows = MaskLattice.of(volume, name, mask).nearest(position)
    return np.asarray(np.take_along_axis(np.stack(sigmas), rows[None].astype(int), axis=0)[0])


def _table_extinction(volume: Volume, table: Table) -> Array:
    """Return (Z, Y, X) σ of voxels: linear between the table's entries, not between labels."""
    if isinstance(table, SurfaceTable):
        return _surface_extinction(volume, table)
    entries, limits = (
        extinction_per_mm(side.opacity, table.reference_step_mm)
        for side in (table, table.left_limits)
    )
    values = volume.values.astype(np.float64)
    last = entries.shape[-1] - 1
    if table.labels:
        valid = (values >= 0) & (values < last + 1)
        return np.where(valid, entries[np.where(valid, values, 0).astype(int)], 0.0)
    low, high = table.domain
    position = np.clip((values - low) / (high - low) * last, 0, last)
    j = np.minimum(position.astype(int), last - 1)
    f = position - j
    if table.gradient_top is None:
        return entries[j] + f * (limits[j + 1] - entries[j])
    rows = np.clip(_gradient(volume) / table.gradient_top, 0, 1) * (len(entries) - 1)
    r = np.minimum(rows.astype(int), len(entries) - 2)
    g = rows - r
    below = entries[r, j] + f * (limits[r, j + 1] - entries[r, j])
    above = entries[r + 1, j] + f * (limits[r + 1, j + 1] - entries[r + 1, j])
    return below + g * (above - below)


def _gradient(volume: Volume) -> Array:
    """Return (Z, Y, X) gradient magnitudes at voxels, value per mm, equal to those along rays."""
    values = volume.values.astype(np.float64)
    slopes = differences(values, values >= volume.least_present)
    return np.asarray(
        np.linalg.norm(np.moveaxis(slopes, 0, -1) @ volume.index_from_world[:3, :3], axis=-1)
    )


def _surface_extinction(volume: Volume, table: SurfaceTable) -> Array:
    """Return (Z, Y, X) σ of voxels: −log(1 − opacity) times surface area per volume.

    If a level lies between a voxel and the next along an axis, a surface crosses the edge, weighted
    by its normal's component along the axis: the sum over all edges is its area. Each end of an
    edge has the part by which the surface is nearer to it.
    """
    values = volume.values.astype(np.float64)
    present = values >= volume.least_present
    slopes = differences(values, present) / np.reshape(volume.spacing_mm, (3, 1, 1, 1))
    square = (slopes**2).sum(axis=0)
    sigma = np.zeros(values.shape)
    for axis, spacing, slope in zip((2, 1, 0), volume.spacing_mm, slopes, strict=True):
        across = np.maximum(square - slope**2, 0.0)  # of the other axes
        ends = [
            tuple(span if a == axis else slice(None) for a in range(3))
            for span in (slice(None, -1), slice(1, None))
        ]
        for one, other in (ends, ends[::-1]):
            here, following = values[one], values[other]
            rise = np.abs(following - here) / spacing
            steepness = np.sqrt(np.maximum(across[one] + rise**2, TINY))
            for level, opacity in zip(table.values.astype(np.float32), table.opacity, strict=True):
                crossed = present[one] & present[other] & ((here < level) != (following < level))
                change = np.where(crossed, following - here, 1.0)
                part = np.where(crossed, 1.0 - (level - here) / change, 0.0)
                sigma[one] += part * rise / steepness * extinction_per_mm(opacity, spacing)
    return sigma


def _visible_mask(volume: Volume, spec: RaycastSpec) -> NDArray[np.bool_]:
    """Return (Z, Y, X) True for voxels inside the crop and the clip planes."""
    mask = np.ones(volume.values.shape, bool)
    axes = [np.arange(n) for n in volume.shape_xyz]
    if spec.crop_voxels is not None:
        for axis, (low, high) in enumerate(spec.crop_voxels):
            inside = (axes[axis] >= low - CUT_TOLERANCE) & (axes[axis] <= high + CUT_TOLERANCE)
            mask &= inside.reshape([-1 if a == 2 - axis else 1 for a in range(3)])
    z, y, x = np.meshgrid(*axes[::-1], indexing="ij", sparse=True)
    for plane in spec.clip_planes:
        normal = np.array(plane.normal)
        i, j, k, offset = normal @ volume.world_from_index[:3]
        inside_mm = i * x + j * y + k * z + offset - normal @ plane.point_mm
        mask &= inside_mm >= -CUT_TOLERANCE * min(volume.spacing_mm)
    return mask


def _weights(voxels: int, nodes: int) -> Array:
    """Return (nodes, voxels), the weight of each voxel along an axis for each node.

    Nodes have the mean of the voxels nearest to them, of which one in the middle between two is
    half of each; denser nodes are interpolated.
    """
    nodes -= 2 * LIGHT_MARGIN
    if nodes >= voxels:
        offset = np.arange(nodes)[:, None] * (voxels - 1) / (nodes - 1) - np.arange(voxels)
        weights = np.maximum(1 - np.abs(offset), 0)
    else:
        offset = np.abs(np.arange(nodes)[:, None] - np.arange(voxels) * (nodes - 1) / (voxels - 1))
        weights = np.where(np.isclose(offset, 0.5), 0.5, offset < 0.5)
        weights /= weights.sum(axis=1, keepdims=True)
    return np.pad(weights, ((LIGHT_MARGIN, LIGHT_MARGIN), (0, 0)))


def _along_direction(
    sigma: Array, grid: LightGrid, direction: Array, middles: Array, lengths: Array
) -> Array:
    """Return (nz, ny, nx) transmittance from every node along one direction."""
    nodes, padded = _positions(grid), np.pad(sigma, 1)
    step = grid.per_step(direction)
    depth = np.zeros(len(nodes))
    for middle, length in zip(middles, lengths, strict=True):
        depth += length * grid.cell_mm * trilinear(padded, nodes + 1 + middle * step)
    return np.exp(-depth).reshape(sigma.shape)


def _towards(sigma: Array, grid: LightGrid, light_mm: Array) -> Array:
    """Return (nz, ny, nx) transmittance from every node to a point."""
    nodes, padded = _positions(grid), np.pad(sigma, 1)
    offset = grid.grid_from_world[:3, :3] @ light_mm + grid.grid_from_world[:3, 3] - nodes
    world = offset @ np.linalg.inv(grid.grid_from_world[:3, :3]).T
    cells = np.linalg.norm(world, axis=1, keepdims=True) / grid.cell_mm
    step = offset / np.maximum(cells, TINY)
    depth = np.zeros(len(nodes))
    for k in range(grid.diagonal_steps):
        begin = grid.shadow_bias + k
        length = np.clip(cells - begin, 0, 1)
        points = nodes + 1 + (begin + length / 2) * step
        depth += length[:, 0] * grid.cell_mm * trilinear(padded, points)
    return np.exp(-depth).reshape(sigma.shape)


def _positions(grid: LightGrid) -> Array:
    """Return (nodes, 3) grid positions x, y, z of all nodes, x fastest."""
    x, y, z = grid.shape_xyz
    k, j, i = np.mgrid[0:z, 0:y, 0:x].reshape(3, -1).astype(np.float64)
    return np.stack([i, j, k], axis=1)
