"""Light by brute force: a ray through the voxels from every sample, in float64, without a grid."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import Camera, RaycastSpec, reference
from volspec.raycast.light_volume import (
    LightLayer,
    extinction_per_mm,
    light_layers,
    sphere_directions,
)
from volspec.raycast.sampling import find_entry, interpolate, trilinear
from volspec.transfer import TransferTable
from volspec.volume import Volume

Array = NDArray[np.float64]
# In smallest spacings: where rays begin, and their steps.
BIAS, STEP = 1.0, 0.5
# Optical depth at which a ray ends.
_DARK = 6.0
# Samples with less part in a pixel are not lit.
_LEAST = 1e-3


def transmittance(
    volume: Volume, table: TransferTable, index: Array, direction: Array, length_mm: float
) -> Array:
    """Return (K,) transmittance from places (K, 3), in voxels, along a direction of the world."""
    unit = min(volume.spacing_mm)
    along = volume.index_from_world[:3, :3] @ direction
    last = np.array(volume.shape_xyz) - 1
    padded = np.pad(volume.values.astype(np.float64), 1, mode="edge")
    depth, live = np.zeros(len(index)), np.arange(len(index))
    at = BIAS * unit
    while at < length_mm and live.size:
        step = min(STEP * unit, length_mm - at)
        place = index[live] + (at + 0.5 * step) * along
        inside = ((place >= 0) & (place <= last)).all(axis=1)
        j, f = find_entry(table, trilinear(padded, place[inside] + 1))
        opacity = interpolate([table.opacity, table.left_limits.opacity], j, f)
        depth[live[inside]] += step * extinction_per_mm(opacity, table.reference_step_mm)
        near = ((place > -1) & (place < last + 1)).all(axis=1)
        live = live[near & (depth[live] < _DARK)]
        at += step
    return np.exp(-depth)


def light_of(volume: Volume, table: TransferTable, layer: LightLayer) -> Callable[[Array], Array]:
    """Return the part of a directional light, or of a sky, that arrives at places in voxels."""

    def light(index: Array) -> Array:
        if layer.kind == "directional":
            return transmittance(volume, table, index, np.array(layer.vector), np.inf)
        rays = [
            transmittance(volume, table, index, way, layer.radius_mm) for way in sphere_directions()
        ]
        return np.minimum(2.0 * np.mean(rays, axis=0), 1.0)

    return light


class _March(reference._March):
    def composite(
        self,
        live: NDArray[np.intp],
        along: Array,
        point: Array,
        gradient: Array | None,
        alpha: Array,
        reflectance: Array,
    ) -> None:
        seen = self.transmittance[live] * alpha > _LEAST
        across = None if gradient is None else gradient[seen]
        super().composite(
            live[seen], along[seen], point[seen], across, alpha[seen], reflectance[seen]
        )
        self.transmittance[live[~seen]] *= 1 - alpha[~seen]


def cast(
    volume: Volume,
    table: TransferTable,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
) -> tuple[Array, Array]:
    """Return the channels (H·W, L·M) and alpha (H·W,) of a cast with such light."""
    rays = reference.make_rays(volume, camera, size, spec)
    layers = light_layers(spec, volume, camera)
    arrives = {each.source: light_of(volume, table, each) for each in layers}
    march = _March(volume, table, camera, spec, rays, arrives)
    march.lift_mm = 0.0
    march.march()
    return march.colour.reshape(len(march.alpha), -1), march.alpha
