"""The raycaster's truth: NumPy, float64, every sample, no skipping.

    volume -> transfer -> [raycast] -> relight -> appearance

The ray of a pixel is cut into steps kΔ…(k+1)Δ measured from the camera, clipped to what is kept
of the volume; each is sampled at its middle and weighs as much as its clipped length. A
homogeneous body therefore has exactly Beer-Lambert's transmittance along any ray. Front to back

    α = 1 − (1 − opacity(v))^(length / reference step)
    C += T α (g s(v) + k_s),   T ← T (1 − α) (docs/method.md §3)

The twins are ``kernels/raycast.cl`` and, by name below, those beside it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from volspec.raycast.camera import Camera
from volspec.raycast.light_volume.reference import arrivals
from volspec.raycast.light_volume.spec import LightGrid
from volspec.raycast.packed import ITERATIONS
from volspec.raycast.reach import check_reach
from volspec.raycast.sampling import (
    Array,
    Index,
    Rays,
    Sampler,
    between,
    classified,
    entry_of,
    rays_of,
    shading,
)
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import SurfaceTable, TransferTable, segment_means
from volspec.volume import Volume

Result = tuple[Array, Array, Array, Array]


def cast(
    volume: Volume,
    table: TransferTable | SurfaceTable,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
) -> Result:
    """Cast every pixel of a picture.

    Parameters
    ----------
    size : (width, height)

    Returns
    -------
    coefficients : (H, W, L·M)
        Premultiplied by opacity.
    alpha : (H, W)
    depth_mm, first_mm : (H, W)
        Expected distance from the camera of what is seen, and where it is first hit; inf where
        nothing is.

    Raises
    ------
    RaycastError
        If the step or the crop does not fit the volume, or a light is too far from it.
    CameraError
        If the camera is.
    """
    check_reach(volume, camera, spec)
    width, height = size
    kind: type[_March] = _March
    if isinstance(table, SurfaceTable):
        kind = _Surfaces
    elif spec.mode != "composite":
        kind = _Projection
    elif spec.preintegrated:
        kind = _Preintegrated
    elif table.filters is not None:
        kind = _Filtered
    march = kind(volume, table, camera, spec, rays_of(volume, camera, size, spec))
    march.run()
    shape = (height, width)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(march.covered > 0, march.depth / march.covered, np.inf)
    colour = march.colour.reshape(*shape, -1)
    parts = march.covered, expected, march.first
    return (colour, *(part.reshape(shape) for part in parts))  # type: ignore[return-value]


class _March:
    """Rays under way, compositing; the other ways to cast replace a part of it."""

    def __init__(
        self,
        volume: Volume,
        table: Any,
        camera: Camera,
        spec: RaycastSpec,
        rays: Rays,
    ) -> None:
        self.volume, self.table, self.camera = volume, table, camera
        self.spec, self.rays = spec, rays
        self.sampler = Sampler(volume, table, spec)
        self.arrives = arrivals(volume, table, spec, camera)
        self.lift_mm = LightGrid.of(volume, spec.light_cells).lift_mm
        self.normals = spec.shaded or bool(self.arrives)
        self.step = spec.step_of(volume)
        count = len(rays.near)
        self.covered, self.depth = np.zeros(count), np.zeros(count)
        self.first, self.through = np.full(count, np.inf), np.ones(count)
        self.colour = np.zeros((count, len(spec.groups), table.size))

    def run(self) -> None:
        """Front to back, all rays a step at a time."""
        rays, step = self.rays, self.step
        k = np.floor((rays.near - rays.shift) / step)
        while True:
            begin = np.maximum(k * step + rays.shift, rays.near)
            end = np.minimum((k + 1) * step + rays.shift, rays.far)
            live = np.flatnonzero((end > begin) & (self.through > 1 - self.spec.alpha_stop))
            if not live.size:
                break
            self.take(live, begin[live], end[live])
            k[live] += 1

    def point(self, rays: Index, along: Array) -> Array:
        """(R, 3) index positions at ``along`` mm."""
        return self.rays.start[rays] + along[:, None] * self.rays.along[rays]

    def take(self, live: Index, begin: Array, end: Array) -> None:
        """One step of each live ray."""
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        shaded = self.normals or self.table.gradient_top is not None
        gradient = self.sampler.gradient(point) if shaded else None
        share, seen = classified(self.table, self.sampler, point, gradient, self.step)
        alpha = 1 - (1 - share) ** ((end - begin) / self.step)
        self.reflect(live, middle, point, gradient, alpha, seen)

    def reflect(
        self,
        live: Index,
        along: Array,
        point: Array,
        gradient: Array | None,
        alpha: Array,
        seen: Array,
    ) -> None:
        """Samples of opacity alpha reflect what is seen, and cover what lies behind."""
        light = self.light(live, point, gradient, seen)
        weight = self.through[live] * alpha
        self.colour[live] += weight[:, None, None] * light
        self.cover(live, along, weight)
        self.through[live] -= weight

    def light(self, live: Index, point: Array, gradient: Array | None, seen: Array) -> Array:
        """(R, L, M) what samples reflect of each group's light."""
        factor, gloss = shading(
            *(self.volume, self.camera, self.spec, self.arrives, self.lift_mm, point),
            self.rays.direction[live],
            gradient if self.normals else None,
        )
        return factor[:, :, None] * seen[:, None, :] + gloss[:, :, None] * self.table.white

    def cover(self, live: Index, along: Array, weight: Array) -> None:
        """Count opacity and where it is."""
        self.covered[live] += weight
        hit = np.isinf(self.first[live]) & (self.covered[live] >= self.spec.first_opacity)
        self.first[live[hit]] = along[hit]
        self.depth[live] += weight * along


class _Filtered(_March):
    """Spectral absorption: one transmittance a channel; twin: raycast.cl with FILTERED.

    C_k += T_k (1 − t_k^length) (g s_k(v) + k_s white_k),   T_k ← T_k t_k^length

    so that a channel reflects as much as it loses, and the opacity is what all lose in the mean.
    """

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.passing = np.ones((len(self.through), self.table.size))

    def take(self, live: Index, begin: Array, end: Array) -> None:
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        gradient = self.sampler.gradient(point) if self.normals else None
        _, seen = classified(self.table, self.sampler, point, gradient, self.step)
        entries = self.table.step_transmittance(self.step)
        j, f = entry_of(self.table, self.sampler.value(point))
        passed = between(entries, j, f) ** ((end - begin) / self.step)[:, None]
        taken = self.passing[live] * (1 - passed)
        self.colour[live] += taken[:, None, :] * self.light(live, point, gradient, seen)
        self.passing[live] *= passed
        left = self.passing[live].mean(axis=1)
        self.cover(live, middle, self.through[live] - left)
        self.through[live] = left


class _Preintegrated(_March):
    """The transfer function integrated between a step's ends; twin: preintegrated.cl."""

    def take(self, live: Index, begin: Array, end: Array) -> None:
        front, back = (self.sampler.value(self.point(live, at)) for at in (begin, end))
        means = segment_means(self.table, self.step, front, back)
        alpha = -np.expm1(-means[:, 0] * (end - begin) / self.step)
        seen = means[:, 1:] / np.maximum(means[:, :1], 1e-30) @ self.table.channels
        middle = 0.5 * (begin + end)
        point = self.point(live, middle)
        gradient = self.sampler.gradient(point) if self.normals else None
        self.reflect(live, middle, point, gradient, alpha, seen)


class _Surfaces(_March):
    """Isosurfaces between a step's ends; twin: surfaces.cl."""

    def take(self, live: Index, begin: Array, end: Array) -> None:
        table, stop = self.table, 1 - self.spec.alpha_stop
        front, back = (self.sampler.value(self.point(live, at)) for at in (begin, end))
        rising = back > front
        for s in range(len(table.values)):
            which = np.where(rising, s, len(table.values) - 1 - s)
            level = table.values[which]
            met = ((front < level) != (back < level)) & (self.through[live] > stop)
            if not met.any():
                continue
            rays, which = live[met], which[met]
            along = self._place(rays, begin[met], end[met], front[met], back[met], level[met])
            point = self.point(rays, along)
            gradient = self.sampler.gradient(point) if self.normals else None
            seen = (table.material_weights @ table.channels)[which]
            self.reflect(rays, along, point, gradient, table.opacity[which], seen)

    def _place(
        self, rays: Index, near: Array, far: Array, front: Array, back: Array, level: Array
    ) -> Array:
        """Where the value is the level, by `ITERATIONS` of false position."""
        along = near + (level - front) / (back - front) * (far - near)
        for _ in range(ITERATIONS):
            value = self.sampler.value(self.point(rays, along))
            before = (value < level) == (front < level)
            near, front = np.where(before, along, near), np.where(before, value, front)
            far, back = np.where(before, far, along), np.where(before, back, value)
            rise = back - front
            share = (level - front) / np.where(rise == 0, 1, rise)
            along = np.where(rise == 0, near, near + share * (far - near))
        return along


class _Projection(_March):
    """The greatest or the mean value of a ray; twin: projection.cl."""

    def run(self) -> None:
        count = len(self.rays.near)
        self.best, self.place = np.full(count, -np.inf), np.zeros(count)
        self.sum, self.length = np.zeros(count), np.zeros(count)
        super().run()
        rays = np.flatnonzero(self.rays.near < self.rays.far)
        value, place = self.best[rays], self.place[rays]
        if self.spec.mode == "average":
            value = self.sum[rays] / self.length[rays]
            place = 0.5 * (self.rays.near + self.rays.far)[rays]
        j, f = entry_of(self.table, value)
        alpha = between(self.table.opacity, j, f)
        seen = between(self.table.coefficients, j, f)
        unshaded = np.array(list(self.spec.strengths().values()))
        light = unshaded[:, None] * seen[:, None, :]
        self.colour[rays] = alpha[:, None, None] * light
        self.cover(rays, place, alpha)

    def take(self, live: Index, begin: Array, end: Array) -> None:
        middle = 0.5 * (begin + end)
        value = self.sampler.value(self.point(live, middle))
        more = live[value > self.best[live]]
        self.place[more] = middle[value > self.best[live]]
        self.best[more] = value[value > self.best[live]]
        self.sum[live] += (end - begin) * value
        self.length[live] += end - begin
