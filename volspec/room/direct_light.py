"""Direct light of a room: the first shot of [1], from surfaces that emit, lamps and the sun.

emitting triangles, lamps, sun -> [direct] -> irradiance at points

The irradiance from a Lambertian triangle is exact (Lambert's polygon formula [2], clipped at the
horizon); shadow rays find the part of it that is visible.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity", section
    4.2, equations 11 and 12.
[2] Baum, Rushmeier & Winget (1989), "Improving Radiosity Solutions through the Use of Analytically
    Determined Form-Factors", SIGGRAPH.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.room.form_factors import Rays, sobol
from volspec.room.mesh import RoomMesh
from volspec.room.model import Room

Array = NDArray[np.float64]
# Shadow rays from a point to a triangle, at most, and of all points and triangles at once.
_RAYS_OF_POINT, SHADOW_RAYS = 1 << 10, 1 << 22


def direct_irradiance(
    room: Room, rays: Rays, points: Array, normals: Array, shadow_rays: int = SHADOW_RAYS
) -> Array:
    """Return the irradiance (P, B), W/m² per band, that comes directly from a room's lights.

    ``points`` and unit ``normals`` are (P, 3); ``shadow_rays`` are shot in all, about.
    """
    irradiance = panel_irradiance(room, rays, points, normals, shadow_rays)
    power = np.array([*room.lights.values()])
    return np.asarray(irradiance + beam_irradiance(room, rays, points, normals).T @ power)


def panel_irradiance(
    room: Room, rays: Rays, points: Array, normals: Array, shadow_rays: int = SHADOW_RAYS
) -> Array:
    """Return the part (P, B) of `direct_irradiance` that comes from surfaces that emit."""
    emission = room.emission
    emitters = room.mesh.part(np.asarray(emission.any(axis=1))[room.mesh.surface])
    exitance = emission[emitters.surface]
    return _from_surfaces(rays, points, normals, emitters, exitance, shadow_rays)


def beam_irradiance(room: Room, rays: Rays, points: Array, normals: Array) -> Array:
    """Return (L, P): light of lamps, I cos / d², and suns, E cos, per unit of a light's spectrum.

    I is 1, or a lamp's `Beam` with a mean of 1. Rows are the room's lights; those of panels are 0.
    """
    raised, names = points + rays.offset * normals, list(room.lights)
    irradiance = np.zeros((len(names), len(points)))
    for lamp in room.lamps:
        to_light = np.asarray(lamp.position_m) - raised
        distance = np.linalg.norm(to_light, axis=1)
        cosine = np.einsum("pc,pc->p", to_light, normals) / distance
        facing = np.flatnonzero(cosine > 0)
        clear = rays.clear(raised[facing], raised[facing] + to_light[facing])
        if lamp.beam is not None:
            cosine[facing] *= lamp.beam.relative(-to_light[facing])
        irradiance[names.index(lamp.name), facing] += cosine[facing] / distance[facing] ** 2 * clear
    for sun in room.suns:
        direction = np.asarray(sun.direction)
        cosine = normals @ direction
        facing = np.flatnonzero(cosine > 0)
        hit = rays.first(raised[facing], np.broadcast_to(direction, (len(facing), 3)))
        clear = np.isin(rays.mesh.surface[hit], list(sun.through)) & (hit >= 0) | (hit < 0)
        irradiance[names.index(sun.name), facing] += cosine[facing] * clear
    return irradiance


def seen_part(points: Array, normals: Array, triangle: Array) -> Array:
    """(P,) form factors of a triangle (3, 3) seen from points with normals, (P, 3) each.

    0 behind the triangle; what is below a point's horizon does not count.
    """
    corners = triangle[None] - points[:, None]  # (P, 3, 3)
    height = np.einsum("pic,pc->pi", corners, normals)
    total = np.zeros(len(points))
    leaves, enters = np.zeros((2, len(points), 3))
    crossed = np.zeros(len(points), np.bool_)
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        ha, hb = height[:, i], height[:, (i + 1) % 3]
        crosses = (ha > 0) != (hb > 0)
        fraction = np.where(crosses, ha / np.where(crosses, ha - hb, 1.0), 0.0)[:, None]
        on = a + fraction * (b - a)
        out, into = crosses & (ha > 0), crosses & (hb > 0)
        leaves[out], enters[into] = on[out], on[into]
        crossed |= crosses
        start, end = np.where(into[:, None], on, a), np.where(out[:, None], on, b)
        above = (ha > 0) | (hb > 0)
        total += np.where(above, _edge(start, end, normals), 0.0)
    total += np.where(crossed, _edge(leaves, enters, normals), 0.0)
    front = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    faces = np.einsum("pc,c->p", corners[:, 0], front) < 0
    return np.where(faces, np.abs(total) / (2.0 * np.pi), 0.0)


def _edge(a: Array, b: Array, normals: Array) -> Array:
    """Return an edge's angle at the point, times the cosine of its plane."""
    cross = np.cross(a, b)
    length = np.linalg.norm(cross, axis=1)
    angle = np.arctan2(length, np.einsum("pc,pc->p", a, b))
    return angle * np.einsum("pc,pc->p", cross, normals) / np.maximum(length, 1e-30)


def _from_surfaces(
    rays: Rays,
    points: Array,
    normals: Array,
    emitters: RoomMesh,
    exitance: Array,
    shadow_rays: int,
) -> Array:
    """Return the irradiance (P, B) from triangles with an exitance (N, B), W/m² per band."""
    irradiance = np.zeros((len(points), exitance.shape[1]))
    count = shadow_rays // max(len(points) * len(emitters.surface), 1)
    count = 1 << int(np.clip(count, 1, _RAYS_OF_POINT)).bit_length() - 1
    pattern = sobol(count, 2, seed=0)
    shifts = np.random.default_rng(1).random((len(points), 1, 2))
    raised = points + rays.offset * normals
    for i, corners in enumerate(emitters.corners_m):
        part = seen_part(points, normals, corners)
        facing = np.flatnonzero(part > 0)
        if not len(facing):
            continue
        ends = emitters.part(slice(i, i + 1)).points(
            ((pattern + shifts[facing]) % 1.0).reshape(1, -1, 2)
        )[0]
        starts = np.repeat(raised[facing], count, axis=0)
        clear = rays.clear(starts, ends)
        # Each ray counts by what its end would add.
        offset = ends - starts
        square = np.einsum("kc,kc->k", offset, offset)
        cosines = np.einsum("kc,kc->k", offset, np.repeat(normals[facing], count, axis=0)) * np.abs(
            offset @ emitters.normals[i]
        )
        weight = np.maximum(cosines, 0.0) / np.maximum(square, 1e-30) ** 2
        weight = weight.reshape(-1, count)
        visible = (weight * clear.reshape(-1, count)).sum(axis=1)
        visible /= np.maximum(weight.sum(axis=1), 1e-30)
        irradiance[facing] += (part[facing] * visible)[:, None] * exitance[i]
    return irradiance
