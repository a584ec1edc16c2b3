"""Light by brute force: a ray through the voxels from every sample, in float64, without a grid."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Camera
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch.light_volume import (
    LightLayer,
    extinction_per_mm,
    light_layers,
    sphere_directions,
)
from volspec.raycast.launch.sampling import find_entry, interpolate, trilinear
from volspec.transfer import TransferTable
from volspec.volume import Volume

Array = NDArray[np.float64]
# In smallest spacings: where rays begin, and their steps.
BIAS, STEP = 1.0, 0.5
# Optical depth at which a ray ends.
_DARK = 6.0
# Samples with less part in a pixel are not lit.
_MIN = 1e-3


def transmittance(
    volume: Volume,
    padded: Array,
    table: TransferTable,
    index: Array,
    directions: Array,
    length_mm: float,
) -> Array:
    """Return (D, K) transmittance from places (K, 3), in voxels, along (D, 3) ways in the world.

    ``padded`` are the volume's voxels with one more around.
    """
    unit = min(volume.spacing_mm)
    shape = len(directions), len(index)
    along = np.repeat(directions @ volume.index_from_world[:3, :3].T, len(index), axis=0)
    index = np.tile(index, (len(directions), 1))
    last = np.array(volume.shape_xyz) - 1
    depth, live = np.zeros(len(index)), np.arange(len(index))
    at = BIAS * unit
    while at < length_mm and live.size:
        step = min(STEP * unit, length_mm - at)
        place = index[live] + (at + 0.5 * step) * along[live]
        inside = ((place >= 0) & (place <= last)).all(axis=1)
        j, f = find_entry(table, trilinear(padded, place[inside] + 1))
        opacity = interpolate([table.opacity, table.left_limits.opacity], j, f)
        depth[live[inside]] += step * extinction_per_mm(opacity, table.reference_step_mm)
        near = ((place > -1) & (place < last + 1)).all(axis=1)
        live = live[near & (depth[live] < _DARK)]
        at += step
    return np.exp(-depth).reshape(shape)


def light_of(volume: Volume, table: TransferTable, layer: LightLayer) -> Callable[[Array], Array]:
    """Return the part of a directional light, or of a sky, that arrives at places in voxels."""
    padded = np.pad(volume.values.astype(np.float64), 1, mode="edge")

    def light(index: Array) -> Array:
        if layer.kind == "directional":
            return transmittance(volume, padded, table, index, np.array([layer.vector]), np.inf)[0]
        ways = np.array(sphere_directions())
        rays = transmittance(volume, padded, table, index, ways, layer.radius_mm)
        return np.minimum(2.0 * rays.mean(axis=0), 1.0)

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
        seen = self.transmittance[live] * alpha > _MIN
        across = None if gradient is None else gradient[seen]
        super().composite(
            live[seen], along[seen], point[seen], across, alpha[seen], reflectance[seen]
        )
        self.transmittance[live[~seen]] *= 1 - alpha[~seen]


def cast(
    volume: Volume, table: TransferTable, camera: Camera, size: tuple[int, int], spec: RaycastSpec
) -> tuple[Array, Array]:
    """Return the channels (H·W, L·M) and alpha (H·W,) of a cast with such light."""
    rays = reference.make_rays(volume, camera, size, spec)
    layers = light_layers(spec, volume, camera)
    arrives = {each.source: light_of(volume, table, each) for each in layers}
    march = _March(volume, table, camera, spec, rays, arrives)
    march.lift_mm = 0.0
    march.march()
    return march.colour.reshape(len(march.alpha), -1), march.alpha
