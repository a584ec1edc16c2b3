"""Layers of opacity found sample by sample, in one pass and with bounded memory.

    samples of rays -> [LayerStream] -> rows of layers -> OpacityLayers

Layers are equal in mass, the visibility of each material by itself at several scales a,

    M = Σ_k Σ_a (1 − e^(−a T_k)),   T_k the depth from the camera,   a = 1/4, 1, 4

Twins: ``kernels/include/layered.clh``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis
from volspec.errors import OpenCLError, RaycastError
from volspec.image import MAX_LAYER_TAU, MAX_MATERIALS, MIN_TAU, Slot, ratio, sample_tau
from volspec.raycast.lights import Ambient, Headlight
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import FieldTables, SurfaceTable, Tables, TransferTable

Array = NDArray[np.float64]

LIGHT_MASS = 0.5
"""Mass of a change of the light that arrives, so that layers end at the edges of shadows."""
MADE_COST, LIT_COST = 1.0, 3.0
"""Cost of merging layers by the difference of their materials, and of their shades."""


class Shadow(NamedTuple):
    """Light of one source at R samples, and what of it arrives."""

    source: int
    slot: Slot
    factor: Array  # (R,) as of `shade`, without the shadow
    highlight: Array  # (R,)
    point: Array  # (R, 3) index positions at which the light volume is read
    passes: Array  # (R,) fraction that arrives
    # Transmittances at half of the depths, of the full ones, and (R, K) of materials alone at half;
    # of ambient light, means of directions.
    half: Array
    full: Array
    alone: Array

    def of(self, samples: NDArray[np.int64]) -> Shadow:
        """Return some samples' light."""
        return Shadow(self.source, self.slot, *(part[samples] for part in self[2:]))


class Samples(NamedTuple):
    """A sample of each of R rays."""

    distance: Array  # (R,)
    alpha: Array  # (R,)
    weights: Array  # (R, K) of the materials
    factor: Array  # (R, G) as of `shade`, without shadows and occlusion
    highlight: Array  # (R, G)
    shadows: Sequence[Shadow] = ()  # and occlusion, source by source

    def of(self, samples: NDArray[np.int64]) -> Samples:
        """Return some of the samples."""
        arrays = {name: getattr(self, name)[samples] for name in self._fields[:5]}
        return self._replace(**arrays, shadows=[shadow.of(samples) for shadow in self.shadows])


class SampleStream(Protocol):
    """Receiver of the samples of many rays, front to back."""

    def add(self, rays: NDArray[np.int64], samples: Samples) -> None:
        """Add a sample to each of some rays."""


class LayerStream:
    """Layers of many rays, found sample by sample: one pass, 2 L slots a ray.

    A layer ends when its mass passes θ, `least_mass` at first. When 2 L are there, the neighbours
    that cost least merge until L are left, and θ rises to the cost of the cheapest pair; at the end
    L are left. A pair with masses M and M' costs

        2 M M' / (M + M') (1 + d + 3 e),

    d being the difference of what it is made of, 0 to 1, and e that of its shades: the harmonic
    mean, as in Ward's clustering, of what differs.
    """

    def __init__(
        self,
        rays: int,
        layers: int,
        groups: int,
        materials: int,
        shadows: Sequence[Slot] = (),
    ) -> None:
        self.layers, slots = layers, 2 * layers
        self._count = np.zeros(rays, int)  # of complete layers; the next one is open
        self._limit = np.full(rays, least_mass(materials, layers))
        self._total_tau = np.zeros((rays, materials))  # T_k
        self._begun = np.zeros(rays)  # mass in front of the open layer
        self._mass = np.zeros((rays, slots))
        self._tau = np.zeros((rays, slots, materials))
        # Light of each material, weighted by its own transmittance; highlights and depth, by that
        # of all.
        self._shade = np.zeros((rays, slots, groups, materials))
        self._gloss = np.zeros((rays, slots, groups))
        self._depth = np.zeros((rays, slots))
        # Of groups with shadows, weighted as highlights, and all without shadow: diffuse light;
        # that which may have shadow; its highlights; then both times `Shadow.half`, …
        self._slots = tuple(shadows)
        self._shadow = np.zeros((rays, slots, len(shadows), 5 + materials))
        self._arrived = np.full(rays, np.nan)  # shadowed light at the last sample
        self._change = np.zeros(rays)  # mass by changes of it

    def add(self, rays: NDArray[np.int64], samples: Samples) -> None:
        """Add a sample to each of some rays."""
        index = rays, self._count[rays]
        distance, alpha, weights, factor, highlight, shadows = samples
        tau = sample_tau(alpha)[:, None] * weights
        absorbed = np.exp(-self._tau[index]) * -np.expm1(-tau)
        contribution = np.exp(-self._tau[index].sum(axis=1)) * alpha
        self._shade[index] += absorbed[:, None, :] * factor[:, :, None]
        self._gloss[index] += contribution[:, None] * highlight
        self._depth[index] += contribution * distance
        if self._slots:
            self._shadow[index] += contribution[:, None, None] * self._shadow_sums(factor, shadows)
            arrived = sum((shadow.factor + shadow.highlight) * shadow.half for shadow in shadows)
            change = np.nan_to_num(np.abs(arrived - self._arrived[rays]))
            visible = np.exp(-0.25 * self._total_tau[rays].sum(axis=1))
            self._change[rays] += LIGHT_MASS * change * visible
            self._arrived[rays] = arrived
        self._tau[index] += tau
        self._total_tau[rays] += tau
        mass = visibility(self._total_tau[rays]) + self._change[rays]
        self._mass[index] = mass - self._begun[rays]
        ended = self._mass[index] > self._limit[rays]
        rays = rays[ended]
        self._begun[rays] = mass[ended]
        self._count[rays] += 1
        full = rays[self._count[rays] == 2 * self.layers]
        if full.size:
            self._merge(full)
            if self.layers > 1:
                cheapest = self._costs(full).min(axis=1)
                self._limit[full] = np.maximum(self._limit[full], cheapest)

    def _shadow_sums(self, factor: Array, shadows: Sequence[Shadow]) -> Array:
        """Return what samples add to `_shadow`, but for their weight."""
        added = np.zeros((len(factor), *self._shadow.shape[2:]))
        added[:, :, 0] = factor[:, [group for group, _ in self._slots]]
        for shadow in shadows:
            slot_sums = added[:, self._slots.index(shadow.slot)]
            light = shadow.factor + shadow.highlight
            passes = np.stack([shadow.half, shadow.full, *shadow.alone.T], axis=1)
            slot_sums[:, 1] += shadow.factor
            slot_sums[:, 2] += shadow.highlight
            slot_sums[:, 3:] += light[:, None] * passes
        return added

    def rows(self) -> Array:
        """Return (R, L, `row_size`): the layers of all rays; distances as given."""
        pending = self._tau[np.arange(len(self._count)), self._count].any(axis=1)
        self._count[pending] += 1
        self._merge(np.flatnonzero(self._count > self.layers))
        L = self.layers
        tau, total = self._tau[:, :L], self._tau[:, :L].sum(axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            absorbed = -np.expm1(-tau)[:, :, None, :]
            shade = np.where(tau[:, :, None, :] > MIN_TAU, self._shade[:, :L] / absorbed, 0.0)
            opacity = -np.expm1(-total)
            gloss = np.where(total[..., None] > MIN_TAU, self._gloss[:, :L] / opacity[..., None], 0)
            depth = np.where(total > 0, self._depth[:, :L] / opacity, np.inf)
        tau = np.minimum(tau, MAX_LAYER_TAU)
        sums = self._shadow[:, :L]
        all_light, may, bright = sums[..., 0], sums[..., 1], sums[..., 2]
        all_bright = self._gloss[:, :L, [group for group, _ in self._slots]]
        parts = np.stack([ratio(may, all_light), ratio(bright, all_bright)], axis=-1)
        light = (may + bright)[..., None]
        means = np.where(light > 0, ratio(sums[..., 3:], light), 1.0)
        shadow = np.concatenate([parts, means], axis=-1)
        flat = [array.reshape(*tau.shape[:2], -1) for array in (tau, shade, gloss, shadow, depth)]
        return np.concatenate(flat, axis=2)

    def _costs(self, rays: NDArray[np.int64]) -> Array:
        """Return (R, 2 L − 1) costs of merging neighbours; inf beyond the last layer."""
        mass, tau = self._mass[rays], self._tau[rays]
        fraction = ratio(tau, tau.sum(axis=2, keepdims=True))
        mix = 0.5 * np.abs(np.diff(fraction, axis=1)).sum(axis=2)
        opacity = -np.expm1(-tau)
        shade = ratio(self._shade[rays], opacity[:, :, None])
        both = np.minimum(opacity[:, 1:], opacity[:, :-1])
        shading = (np.abs(np.diff(shade, axis=1)) * both[:, :, None]).sum(axis=(2, 3))
        shading = ratio(shading, both.sum(axis=2))
        front, back = mass[:, :-1], mass[:, 1:]
        cost = ratio(2 * front * back, front + back) * (1 + MADE_COST * mix + LIT_COST * shading)
        last = np.arange(cost.shape[1]) >= self._count[rays, None] - 1
        return np.where(last, np.inf, cost)

    def _merge(self, rays: NDArray[np.int64]) -> None:
        """Merge the cheapest neighbours of rays until L layers are left."""
        slots = np.arange(2 * self.layers)
        while rays.size:
            first = self._costs(rays).argmin(axis=1)
            front, back = (rays, first), (rays, first + 1)
            passed = np.exp(-self._tau[front])
            clear = np.exp(-self._tau[front].sum(axis=1))
            self._shade[front] += passed[:, None, :] * self._shade[back]
            self._gloss[front] += clear[:, None] * self._gloss[back]
            self._depth[front] += clear * self._depth[back]
            self._shadow[front] += clear[:, None, None] * self._shadow[back]
            self._tau[front] += self._tau[back]
            self._mass[front] += self._mass[back]
            after = slots > first[:, None]
            source = np.minimum(slots + after, slots[-1])
            sums = self._shade, self._gloss, self._depth, self._shadow
            for array in (self._mass, self._tau, *sums):
                own_rows = array[rays]
                spread = source.reshape(*source.shape, *(1,) * (array.ndim - 2))
                shifted = np.take_along_axis(own_rows, spread, axis=1)
                shifted[:, -1] = 0.0
                array[rays] = shifted
            self._count[rays] -= 1
            rays = rays[self._count[rays] > self.layers]


def least_mass(materials: int, layers: int) -> float:
    """Return the mass at which layers end at first: of 8 a fifth of what the whole gives each.

    Smaller ones cost time and are merged again; twice as large ones double the errors of what is
    nearly empty.
    """
    return 1.2 * materials / layers ** (4 / 3)


def visibility(depth: Array) -> Array:
    """Return the mass M (R,) of depths (R, K): each material by itself, at three scales."""
    return -np.expm1(-depth[..., None] * np.array([0.25, 1.0, 4.0])).sum(axis=(-1, -2))


def row_size(materials: int, groups: int, slots: int = 0) -> int:
    """Return the numbers of a layer: depths, shades by group, highlights, shadows, distance."""
    return materials + groups * materials + groups + slots * (4 + materials) + 1


def empty_rows(
    table: Tables, size: tuple[int, int], spec: RaycastSpec, count: int | None = None
) -> NDArray[np.float32]:
    """Return (H, W, L, `row_size`) zeros for a table's materials, which a cast fills.

    L is ``count``, or that of the cast.

    Raises OpenCLError if there is no memory for them.
    """
    width, height = size
    count = spec.layers if count is None else count
    numbers = row_size(len(table.channels), len(spec.groups), len(shadow_slots(spec)))
    try:
        return np.zeros((height, width, count, numbers), np.float32)
    except MemoryError:
        raise OpenCLError(
            f"raycast: no memory for {count} layers of {width}x{height}",
            "cast it smaller, or with fewer layers",
            code="size",
        ) from None


def shadow_slots(spec: RaycastSpec) -> list[Slot]:
    """Return the groups with shadows or ambient occlusion, in the order of a layer's numbers."""
    slots = set()
    for g, group in enumerate(spec.groups):
        for source in group.sources:
            if isinstance(source, Ambient):
                slots |= {(g, True)} if source.occlusion else set()
            elif not isinstance(source, Headlight) and source.shadows:
                slots.add((g, False))
    return sorted(slots)


def check_layers(
    spec: RaycastSpec, table: Tables, basis: Basis, translucent: Sequence[str]
) -> TransferTable:
    """Return the table, or raise RaycastError for what cannot be cast in layers, or with surfaces.

    ``translucent`` has a text for each surface: what of it is translucent, or "".
    """
    if not isinstance(basis, MaterialBasis):
        raise _conflict(
            spec,
            f"basis {basis.name!r}, whose channels are {basis.method}, not materials",
            'set [basis] method = "materials" (a MaterialBasis), or leave layers out',
        )
    if len(basis.materials) > MAX_MATERIALS:
        raise _conflict(
            spec,
            f"{len(basis.materials)} materials ({', '.join(basis.materials)})",
            f"give up to {MAX_MATERIALS}, or leave layers out",
        )
    if isinstance(table, FieldTables):
        raise _conflict(spec, "several fields or masks", "show one field, or leave layers out")
    if isinstance(table, SurfaceTable):
        raise _conflict(spec, "isosurfaces", "give a curve of opacity, or leave layers out")
    if table.filters is not None:
        raise _conflict(
            spec, "spectral absorption (filters)", "leave the filters out, or leave layers out"
        )
    if translucent and spec.layers == 1:
        raise _conflict(spec, "meshes, which take one", "give 2 or more, or leave the meshes out")
    for name in filter(None, translucent):
        problem = f"a translucent mesh, {name}"
        raise _conflict(spec, problem, "set opacity = 1, or leave layers out")
    return table


def _conflict(spec: RaycastSpec, problem: str, remedy: str) -> RaycastError:
    return RaycastError(
        f"{spec.layers} layers do not work with {problem}",
        remedy,
        code="conflict",
        field="raycast: layers",
        given=spec.layers,
    )


def refuse_layers(spec: RaycastSpec, problem: str, remedy: str) -> None:
    """Raise RaycastError if a cast has layers and meets what they cannot show."""
    if spec.layers:
        raise _conflict(spec, problem, remedy)


def materials_without_opacity(table: TransferTable, basis: Basis) -> list[str]:
    """Return the names of the basis' materials of which a table shows nothing."""
    assert isinstance(basis, MaterialBasis)
    opacity = np.maximum(table.opacity, table.left_limits.opacity)
    weights = np.maximum(table.material_weights, table.left_limits.material_weights)
    visible = (opacity[..., None] * weights).reshape(-1, weights.shape[-1]).max(axis=0) > 0
    present = table.channels[visible].any(axis=0) if visible.any() else np.zeros(basis.size, bool)
    return [name for name, used in zip(basis.materials, present, strict=False) if not used]
