"""Casts of many scaled opacities at once, sample by sample: what layers are compared with."""

from __future__ import annotations

import itertools
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.opencl import Compute
from volspec.camera import Camera
from volspec.image.layers import sample_tau
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch.kernel_arguments import LIGHT_MARGIN
from volspec.raycast.launch.layer_stream import LayerStream, Samples, Shadow
from volspec.raycast.launch.light_volume import LightGrid, LightVolume, light_layers, split_width
from volspec.raycast.launch.sampling import Transmittance, cell
from volspec.transfer import TransferTable
from volspec.volume import Volume

Array = NDArray[np.float64]


class ScaledLights:
    """The light volumes of a table's scaled opacities, (C, K) scales, of every source."""

    def __init__(
        self,
        volume: Volume,
        table: TransferTable,
        camera: Camera,
        spec: RaycastSpec,
        scales: Array,
    ) -> None:
        compute = Compute.open()
        self._light = LightVolume(compute, volume, compute.upload(volume.values))
        self._compute, self._given = compute, (spec, camera)
        sources = len(light_layers(spec, volume, camera))
        self.grid = LightGrid.for_spec(volume, spec)
        shape = *self.grid.shape_xyz[::-1], len(scales)
        self._layers = [np.empty(shape, np.uint16) for _ in range(sources)]
        self._number = {each.source: n for n, each in enumerate(light_layers(spec, volume, camera))}
        for c, scale in enumerate(scales):
            for own, one in zip(self._layers, self._of(scaled(table, scale)), strict=True):
                own[..., c] = one

    def _of(self, table: TransferTable, width: int = 0) -> NDArray[np.uint16]:
        """Return (N, nz, ny, nx) light volumes, and of each N ``width`` more, as read by nodes."""
        buffer, grid, wanted = self._light.layers(table, *self._given, split=width > 0)
        layers = np.empty((len(wanted) * (1 + width), *grid.shape_xyz[::-1]), np.uint16)
        self._compute.download(buffer, layers)
        return layers

    def transmittances(self, table: TransferTable) -> reference.Lights:
        """Return the light of a table as `reference.split_transmittances` does, from the device."""
        width, sources = split_width(table), len(self._number)
        layers = self._of(table, width) / 65535
        split = layers[sources:].reshape(sources, *layers.shape[1:], width)

        def each(volumes: Array) -> dict[int, Transmittance]:
            return {
                source: partial(reference.light_at, np.ascontiguousarray(volumes[n]), self.grid)
                for source, n in self._number.items()
            }

        half, whole, *alone = (each(split[..., n]) for n in range(2 + len(table.channels)))
        return each(layers[:sources]), [*alone, half, whole], {}

    def passes(self, shadow: Shadow) -> Array:
        """Return (R, C) what arrives at samples with each scale."""
        layer = self._layers[self._number[shadow.source]]
        at = shadow.point * np.array(self.grid.per_index) + LIGHT_MARGIN
        base, f = cell(layer.shape[:3], at)
        found = np.zeros((len(at), layer.shape[3]))
        for corner in itertools.product((0, 1), repeat=3):
            x, y, z = (base + corner).T
            weight = np.where(corner, f, 1 - f).prod(axis=1)
            found += weight[:, None] * layer[z, y, x]
        return found / 65535


def scaled(table: TransferTable, scales: Array) -> TransferTable:
    """Return a table with each material's optical depth scaled, for the light volume."""

    def opacity(side: TransferTable) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = -np.log1p(-side.opacity) * (side.material_weights @ scales)
        return -np.expm1(-np.nan_to_num(depth, posinf=1e3))

    left = None
    if table.left is not None:
        left = table.left._replace(opacity=opacity(table.left_limits))
    return replace(table, opacity=opacity(table), left=left)


class Truth:
    """The picture of (C, K) scales of a table's materials, sample by sample: a `SampleStream`."""

    def __init__(
        self, rays: int, scales: Array, groups: int = 1, lights: ScaledLights | None = None
    ) -> None:
        self.scales, self.lights = scales, lights
        self.through = np.ones((rays, len(scales)))
        self.channels = np.zeros((rays, len(scales), groups, scales.shape[1] + 1), np.float32)

    def add(self, rays: NDArray[np.int64], samples: Samples) -> None:
        """Composite a sample of each of some rays, in all combinations."""
        _, alpha, weights, factor, highlight, shadows = samples
        tau = sample_tau(alpha)[:, None, None] * weights[:, None, :] * self.scales
        total = tau.sum(axis=2)
        seen = self.through[rays] * -np.expm1(-total)
        part = seen / np.maximum(total, 1e-300)
        lost = {id(each): 1 - self.lights.passes(each) for each in shadows if self.lights}
        for group in range(factor.shape[1]):
            shade, gloss = (
                np.repeat(f[:, group, None], len(self.scales), 1) for f in (factor, highlight)
            )
            for each in shadows:
                if each.slot[0] == group:
                    shade -= each.factor[:, None] * lost[id(each)]
                    gloss -= each.highlight[:, None] * lost[id(each)]
            self.channels[rays, :, group, :-1] += (part * shade)[..., None] * tau
            self.channels[rays, :, group, -1] += seen * gloss
        self.through[rays] -= seen


class Frozen(LayerStream):
    """Layers whose shadows stay those of the cast, to compare with."""

    def add(self, rays: NDArray[np.int64], samples: Samples) -> None:
        """Add a sample to each of some rays."""
        factor, highlight = samples.factor.copy(), samples.highlight.copy()
        for each in samples.shadows:
            factor[:, each.slot[0]] -= each.factor * (1 - each.passes)
            highlight[:, each.slot[0]] -= each.highlight * (1 - each.passes)
        shaded = samples._replace(factor=factor, highlight=highlight, shadows=())
        super().add(rays, shaded)
