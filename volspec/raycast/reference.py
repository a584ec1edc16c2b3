"""The raycaster's truth: NumPy, float64, every sample, no skipping.

    volume -> transfer -> [raycast] -> relight -> appearance

The ray of a pixel is cut into steps kΔ…(k+1)Δ measured from the camera, clipped to the
volume; each is sampled at its middle and weighs as much as its clipped length. A homogeneous
body therefore has exactly Beer-Lambert's transmittance along any ray. Front to back

    α = 1 − (1 − opacity(v))^(length / reference step)
    C += T α (g s(v) + k_s),   T ← T (1 − α)                               (METHOD §3)

The twin is ``kernels/raycast.cl``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.raycast.spec import Camera, RaycastSpec
from volspec.transfer import TransferTable
from volspec.volume import Volume

Result = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def cast(
    volume: Volume,
    table: TransferTable,
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
    coefficients : (H, W, M)
        Premultiplied by opacity.
    alpha : (H, W)
    depth_mm : (H, W)
        Expected distance from the camera of what is seen; inf where nothing is.
    """
    width, height = size
    origin, direction = _rays(camera, width, height)
    matrix = volume.index_from_world
    start = origin @ matrix[:3, :3].T + matrix[:3, 3]
    along = direction @ matrix[:3, :3].T
    near, far = _clip(start, along, np.array(volume.shape_xyz) - 1.0)
    step = spec.step_of(volume)
    padded = np.pad(volume.values.astype(np.float64), 1, mode="edge")
    opacity = table.step_opacity(step)
    channels = table.coefficients
    low, high = table.domain
    last = len(opacity) - 1

    rays = len(near)
    covered = np.zeros(rays)
    colour = np.zeros((rays, channels.shape[1]))
    through = np.ones(rays)
    depth = np.zeros(rays)
    k = np.floor(near / step)
    while True:
        begin = np.maximum(k * step, near)
        end = np.minimum((k + 1) * step, far)
        live = np.flatnonzero((end > begin) & (through > 1 - spec.alpha_stop))
        if not live.size:
            break
        middle = 0.5 * (begin[live] + end[live])
        point = start[live] + middle[:, None] * along[live]
        value, gradient = _sample(padded, point)
        at = np.clip((value - low) / (high - low) * last, 0, last)
        j = np.minimum(at.astype(int), last - 1)
        f = at - j
        alpha = (1 - f) * opacity[j] + f * opacity[j + 1]
        alpha = 1 - (1 - alpha) ** ((end[live] - begin[live]) / step)
        seen = (1 - f)[:, None] * channels[j] + f[:, None] * channels[j + 1]
        diffuse, specular = _shading(gradient, direction[live], matrix, volume, spec)
        weight = through[live] * alpha
        gloss = specular[:, None] * table.white
        colour[live] += weight[:, None] * (diffuse[:, None] * seen + gloss)
        covered[live] += weight
        depth[live] += weight * middle
        through[live] *= 1 - alpha
        k[live] += 1
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(covered > 0, depth / covered, np.inf)
    shape = (height, width)
    return colour.reshape(*shape, -1), covered.reshape(shape), expected.reshape(shape)


def _rays(
    camera: Camera, width: int, height: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    field = camera.ray_field(width, height)
    y, x = (grid.ravel()[:, None] for grid in np.mgrid[0:height, 0:width].astype(np.float64))
    offset = (x - field.middle[0]) * field.across + (y - field.middle[1]) * field.down
    straight = field.forward * field.distance
    if field.perspective:
        direction = straight + offset
        origin = np.broadcast_to(field.target - straight, direction.shape)
    else:
        direction = np.broadcast_to(straight, offset.shape)
        origin = field.target + offset - straight
    return origin, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _clip(
    start: NDArray[np.float64], along: NDArray[np.float64], top: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where rays enter and leave the box 0…top (index space); empty where near ≥ far."""
    parallel = along == 0
    between = (start >= 0) & (start <= top)
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (0 - start) / along, (top - start) / along
    # A ray parallel to two faces lies between them for ever or never.
    enter = np.where(parallel, np.where(between, -np.inf, np.inf), np.minimum(a, b)).max(axis=1)
    leave = np.where(parallel, np.where(between, np.inf, -np.inf), np.maximum(a, b)).min(axis=1)
    return np.maximum(enter, 0.0), np.maximum(leave, 0.0)


def _sample(
    padded: NDArray[np.float64], point: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Trilinear value and gradient (central differences of the trilinear field, ±1 voxel)."""
    value = _trilinear(padded, point)
    gradient = np.empty_like(point)
    for axis in range(3):
        offset = np.zeros(3)
        offset[axis] = 1
        gradient[:, axis] = 0.5 * (
            _trilinear(padded, point + offset) - _trilinear(padded, point - offset)
        )
    return value, gradient


def _trilinear(padded: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64]:
    top = np.array(padded.shape[::-1]) - 1.0
    inside = np.clip(point + 1, 0, top)
    base = np.minimum(inside.astype(int), np.maximum(top.astype(int) - 1, 0))
    f = inside - base
    x, y, z = base.T
    fx, fy, fz = f.T
    result = np.zeros(len(point))
    for dz, wz in ((0, 1 - fz), (1, fz)):
        for dy, wy in ((0, 1 - fy), (1, fy)):
            for dx, wx in ((0, 1 - fx), (1, fx)):
                result += wx * wy * wz * padded[z + dz, y + dy, x + dx]
    return result


def _shading(
    gradient: NDArray[np.float64],
    direction: NDArray[np.float64],
    index_from_world: NDArray[np.float64],
    volume: Volume,
    spec: RaycastSpec,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Factor of the reflectance and the light-coloured addition; headlight along the ray."""
    if not spec.shaded:
        return np.full(len(gradient), spec.ambient), np.zeros(len(gradient))
    per_spacing = index_from_world[:3, :3] * min(volume.spacing_mm)
    world = (gradient * spec.gradient_scale(volume)) @ per_spacing
    square = (world**2).sum(axis=1)
    trust = square / (square + spec.gradient_floor_squared)
    facing = np.abs((world * direction).sum(axis=1)) / np.sqrt(np.maximum(square, 1e-30))
    lambert = 1 + trust * (facing - 1)
    return (
        spec.ambient + spec.diffuse * lambert,
        spec.specular * trust * facing**spec.shininess,
    )
