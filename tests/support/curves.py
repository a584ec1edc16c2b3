"""A caster without tables: curves evaluated in float64 between their points, at every sample."""

import numpy as np
from numpy.typing import NDArray

from volspec.camera import Camera
from volspec.raycast import RaycastSpec
from volspec.raycast.launch.sampling import Sampler, make_rays
from volspec.transfer import TransferFunction
from volspec.volume import Volume

Array = NDArray[np.float64]


def at_values(places: Array, rows: Array, values: Array) -> Array:
    """Interpolate (P, C) rows at (R,) values; of two at one place, the second is there."""
    after = np.searchsorted(places, values, "right")
    low, high = (each.clip(0, len(places) - 1) for each in (after - 1, after))
    gap = places[high] - places[low]
    share = np.divide(values - places[low], gap, out=np.zeros(len(values)), where=gap > 0)
    return rows[low] + share[:, None] * (rows[high] - rows[low])


def cast_curve(
    volume: Volume, transfer: TransferFunction, camera: Camera, size: tuple[int, int], step: float
) -> tuple[Array, Array]:
    """Return coefficients (H, W, M) and alpha (H, W) of an unshaded cast that never ends early."""
    names = list(transfer.materials)
    channels = transfer.basis.channels_for_materials(transfer.materials)
    places = np.array([value for value, _, _ in transfer.points])
    rows = np.array(
        [[opacity, *(mix.get(name, 0.0) for name in names)] for _, opacity, mix in transfer.points]
    )
    spec = RaycastSpec(step_mm=step, ambient=1, diffuse=0, alpha_stop=1)
    rays = make_rays(volume, camera, size, spec)
    values_at = Sampler(volume, transfer.bake(min(volume.spacing_mm)), spec).value
    reference = transfer.reference_step_mm or min(volume.spacing_mm)
    passed, colour = np.ones(len(rays.near)), np.zeros((len(rays.near), transfer.basis.size))
    first, last = np.floor((rays.near - rays.shift) / step), (rays.far - rays.shift) / step
    for k in range(int(first.min()), int(np.ceil(last[np.isfinite(last)].max()))):
        begin = np.maximum(k * step + rays.shift, rays.near)
        end = np.minimum((k + 1) * step + rays.shift, rays.far)
        live = np.flatnonzero(end > begin)
        middle = 0.5 * (begin + end)[live]
        values = values_at(rays.start[live] + middle[:, None] * rays.index_direction[live])
        opacity, *weights = at_values(places, rows, values).T
        left = (1 - opacity) ** ((end - begin)[live] / reference)
        colour[live] += (passed[live] * (1 - left))[:, None] * (np.transpose(weights) @ channels)
        passed[live] *= left
    width, height = size
    return colour.reshape(height, width, -1), 1 - passed.reshape(height, width)
