"""Radiosity of a room of triangles: all bands at once.

mesh, reflectances, lights -> [radiosity] -> irradiance of patches, of points; radiosity

    E_i = E_direct,i + Σ_j F_ij ρ_j E_j,     B_i = S_i + ρ_i E_i              [1, eq. 8 and 10]

Direct light is computed by itself (`direct`), so that small lamps need no more rays than large
windows. The rest is solved by conjugate gradients in y = √(ρ A) E, where the system is symmetric.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
[2] Cuttle (1997), "Cubic Illumination", Lighting Research and Technology 29(1).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array, diags_array

from volspec._gpu import host_free_bytes
from volspec._triangles import cosine_directions
from volspec.errors import RoomError
from volspec.room.direct_light import direct_irradiance
from volspec.room.form_factors import FormFactors, Rays, form_factors, sobol
from volspec.room.mesh import RoomMesh
from volspec.room.model import Room
from volspec.room.quantities import lux_from_irradiance
from volspec.spectra import SpectralGrid, Spectrum

Array = NDArray[np.float64]
Progress = Callable[[str, float], object]


def no_progress(step: str, fraction: float) -> None:
    """Ignore progress."""


# Rays of a patch, at least and at most.
_RAYS_OF_PATCH = 1 << 10, 1 << 17
# Bytes of a form factor: of both halves, of what they are joined to, and of the solver's matrix.
_BYTES = 64
# Points of a patch at which direct light is computed, by squares of the triangle.
_POINTS = np.array([[0.25, 0.25], [0.25, 0.75], [0.75, 0.25], [0.75, 0.75]])
# Part of the patches before those with uneven light are halved; most rounds of that, and the part
# of those still to come that a round makes, so that the worst are halved again.
_COARSE, _ROUNDS, _A_ROUND = 0.5, 12, 3
_MAX_STEPS, _CLOSE = 2000, 1e-8
# Rays of a triangle that look for gaps and backs, and what part of them may be lost to rounding.
_LOOKS, _LOST = 256, 5e-3
# Rays of form factors for each shadow ray.
_SHADOWS = 4
# Rays of `RoomLight.irradiance_at`.
_GATHERED = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class RoomLight:
    """Light of a room: the solution for each patch, and for any point.

    Attributes
    ----------
    mesh : RoomMesh
        The N patches.
    irradiance, direct, radiosity : (N, B) arrays
        W/m² per band: all light that falls on a patch, what comes directly from lights, and what
        leaves it.
    sampling_error, patch_error : float
        Relative errors of the luminous irradiance, root mean square over the area: by rays, from
        two independent halves of them, and by direct light that is uneven within patches.
    """

    room: Room
    mesh: RoomMesh
    irradiance: Array
    direct: Array
    sampling_error: float
    patch_error: float
    rays: Rays
    factors: FormFactors

    @property
    def reflectances(self) -> Array:
        """(N, B) reflectances of the patches."""
        return self.room.reflectances[self.mesh.surface]

    @property
    def radiosity(self) -> Array:
        """(N, B) light that leaves each patch, W/m² per band."""
        return self.room.emission[self.mesh.surface] + self.reflectances * self.irradiance

    def mean_irradiance(self, *names: str) -> Array:
        """Return the irradiance (B,) of one or more surfaces, mean over their area."""
        rows = np.isin(self.mesh.surface, [self.mesh.names.index(name) for name in names])
        weights = self.mesh.areas_m2[rows]
        return weights @ self.irradiance[rows] / weights.sum()

    def light_at(self, point_m: ArrayLike) -> Spectrum:
        """Return the light on a small specimen, W/(m² nm): the mean over the faces of a cube [2].

        Raises RoomError if the point is not in the room.
        """
        require_inside(self.room, self.rays, point_m, "the specimen")
        faces = np.concatenate([np.eye(3), -np.eye(3)])
        point = np.broadcast_to(np.asarray(point_m, np.float64), faces.shape)
        grid = self.room.grid
        mean = self.irradiance_at(point, faces).mean(axis=0) / grid.step_nm
        return Spectrum(grid.wavelengths_nm, mean, name=self.room.title or "room")

    def painted(self, paints: Mapping[str, Spectrum | ArrayLike]) -> RoomLight:
        """Return the light of the room with other reflectances (B,) of some of its surfaces.

        Direct light and form factors stay. Raises RoomError as `Room` does.
        """
        room = self.room.painted(paints)
        return _solve_light(room, self.mesh, self.direct, self.patch_error, self.rays, self.factors)

    def irradiance_at(self, points_m: ArrayLike, normals: ArrayLike) -> Array:
        """Return the irradiance (P, B), W/m² per band, of small surfaces at points with normals.

        Both are (P, 3). The surfaces neither reflect nor cast shadows.
        """
        points = np.atleast_2d(np.asarray(points_m, np.float64))
        normal = np.atleast_2d(np.asarray(normals, np.float64))
        normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        irradiance = direct_irradiance(self.room, self.rays, points, normal)
        reflected = self.reflectances * self.irradiance
        samples = sobol(_GATHERED, 2, seed=0)
        for i, (point, up) in enumerate(zip(points, normal, strict=True)):
            directions = cosine_directions(up, samples)
            hit = self.rays.first(np.broadcast_to(point, directions.shape), directions)
            front = np.einsum("kc,kc->k", directions, self.mesh.normals[hit]) < 0
            counts = np.bincount(hit[front & (hit >= 0)], minlength=len(reflected))
            irradiance[i] += counts @ reflected / _GATHERED
        return irradiance


def solve_room(
    room: Room,
    patches: int = 5000,
    progress: Progress = no_progress,
    *,
    rays: int = 1 << 24,
    seed: int = 0,
) -> RoomLight:
    """Solve the radiosity of a room.

    Parameters
    ----------
    room : Room
        What is solved.
    patches : int
        Triangles, about: half of them at first, then those are halved in which direct light is most
        uneven.
    progress : callable
        Called with a step and the part of it that is done.
    rays : int
        Rays for all form factors, about; a patch has at least 1024. Each round of direct light
        takes a quarter of them for shadows.
    seed : int
        Of the rays.

    Raises
    ------
    RoomError
        If the room is open or inside-out, a lamp is inside a wall, or memory does not suffice.
    DeviceError
        If Embree is not installed.
    """
    if not patches > 0:
        raise RoomError.refused("patches", patches, "give 1 or more", "range")
    look_around(room)
    per_patch = int(np.clip(rays // max(patches, 1), *_RAYS_OF_PATCH))
    per_patch = 1 << per_patch.bit_length() - 1
    needed, free = _BYTES * patches * per_patch // 2, host_free_bytes()
    if needed > free:
        raise RoomError(
            f"{patches} patches take up to {needed / 2**30:.3g} GiB, and {free / 2**30:.3g} GiB "
            "are free",
            f"give {int(free / (_BYTES * per_patch // 2))} patches or fewer",
            code="size",
            field="patches",
            given=patches,
        )
    progress("direct light", 0.0)
    mesh, direct, patch_error = _refine_patches(room, patches, rays // _SHADOWS)
    progress("direct light", 1.0)
    shot = Rays(mesh)
    factors = form_factors(shot, per_patch, seed, lambda part: progress("form factors", part))
    progress("interreflections", 0.0)
    solved = _solve_light(room, mesh, direct, patch_error, shot, factors)
    progress("interreflections", 1.0)
    return solved


def _solve_light(
    room: Room,
    mesh: RoomMesh,
    direct: Array,
    patch_error: float,
    rays: Rays,
    factors: FormFactors,
) -> RoomLight:
    """Return the light of a room whose direct light and form factors are known."""
    reflectances = room.reflectances[mesh.surface]
    irradiance = solve_irradiance(factors.factors, mesh.areas_m2, reflectances, direct)
    sampling = _sampling_error(room.grid, factors, mesh.areas_m2, reflectances, irradiance)
    return RoomLight(room, mesh, irradiance, direct, sampling, patch_error, rays, factors)


def look_around(room: Room) -> None:
    """Refuse a room that is open or inside-out, or a lamp that is inside a wall."""
    rays, mesh = Rays(room.mesh), room.mesh
    samples = sobol(_LOOKS, 4, seed=0)
    escaped, backs = _looks(rays, samples)
    if escaped.sum() > _LOST and not room.open:
        flipped = RoomMesh(mesh.corners_m[:, ::-1], mesh.surface, mesh.names)
        if _looks(Rays(flipped), samples)[0].sum() <= _LOST:
            raise RoomError(
                "the room is inside-out: its surfaces' fronts are outside",
                "turn the order of the corners around",
                code="conflict",
                field="mesh",
            )
        worst = mesh.names[int(escaped.argmax())]
        raise RoomError(
            f"the room is open: {100 * escaped.sum():.2g} % of its light leaves through gaps, most "
            f"of it from {worst}",
            "close them, or set open = true",
            code="conflict",
            field="open",
        )
    if backs.sum() > _LOST:
        raise RoomError(
            f"{100 * backs.max():.2g} % of the room's light falls on its back",
            "turn the order of its corners around: they run counter-clockwise seen from its front",
            code="conflict",
            field=mesh.names[int(backs.argmax())],
        )
    for lamp in room.lamps:
        require_inside(room, rays, lamp.position_m, "the lamp")


def require_inside(
    room: Room, rays: Rays, point_m: ArrayLike, thing: str, remedy: str = "move it"
) -> None:
    """Raise RoomError if a point is inside furniture or a wall, or outside of a closed room."""
    samples, up = sobol(_LOOKS, 2, seed=0), np.array([0.0, 0.0, 1.0])
    directions = np.concatenate([cosine_directions(sign * up, samples) for sign in (1, -1)])
    hit = rays.first(np.broadcast_to(point_m, directions.shape), directions)
    back = (np.einsum("kc,kc->k", directions, rays.mesh.normals[hit]) > 0) & (hit >= 0)
    if back.mean() > _LOST or ((hit < 0).any() and not room.open):
        place = ", ".join(f"{x:g}" for x in np.asarray(point_m))
        raise RoomError(
            f"{thing} at ({place}) m is inside a wall or furniture, or outside of the room "
            f"({rays.mesh.extent})",
            remedy,
            code="range",
        )


def _looks(rays: Rays, samples: Array) -> tuple[Array, Array]:
    """(S,) parts of all rays that leave the room from a surface, and that hit its back."""
    mesh, count = rays.mesh, len(rays.mesh.names)
    normal = mesh.normals[:, None]
    origins = mesh.points(samples[:, :2]) + rays.offset * normal
    directions = cosine_directions(normal, samples[None, :, 2:])
    hit = rays.first(origins.reshape(-1, 3), directions.reshape(-1, 3)).reshape(len(normal), -1)
    back = (np.einsum("nkc,nkc->nk", directions, mesh.normals[hit]) > 0) & (hit >= 0)
    weights = np.repeat(mesh.areas_m2 / mesh.areas_m2.sum() / len(samples), len(samples))
    source, other = np.repeat(mesh.surface, len(samples)), mesh.surface[hit.ravel()]
    return (
        np.bincount(source, weights * (hit.ravel() < 0), count).astype(np.float64),
        np.bincount(other, weights * back.ravel(), count).astype(np.float64),
    )


def _refine_patches(room: Room, patches: int, shadow_rays: int) -> tuple[RoomMesh, Array, float]:
    """Return patches, the direct light (N, B) on them, and how uneven it is within them."""
    area = float(room.mesh.areas_m2.sum())
    mesh = room.mesh.with_edges(float(np.sqrt(4.0 * area / max(_COARSE * patches, 1))))
    rays = Rays(room.mesh)  # what is in the way: halves are where their parents are
    direct, spread = direct_on_patches(room, rays, mesh, shadow_rays)
    for _ in range(_ROUNDS):
        left = patches - len(direct)
        error = spread * mesh.areas_m2
        if left <= 0 or not error.any():
            break
        selected = error > error.mean()
        selected[np.argsort(error)[: -max(left // _A_ROUND, 1)]] = False
        mesh = mesh.split(selected)
        new = np.repeat(selected, np.where(selected, 2, 1))
        kept = direct[~selected], spread[~selected]
        direct, spread = np.zeros((len(new), room.grid.size)), np.zeros(len(new))
        direct[~new], spread[~new] = kept
        direct[new], spread[new] = direct_on_patches(room, rays, mesh.part(new), shadow_rays)
    areas = mesh.areas_m2
    mean = float(areas @ lux_from_irradiance(direct, room.grid) / areas.sum())
    uneven = np.sqrt(areas @ (spread / 4.0) ** 2 / areas.sum()) / max(mean, 1e-30)
    return mesh, direct, float(uneven)


def direct_on_patches(
    room: Room, rays: Rays, mesh: RoomMesh, shadow_rays: int
) -> tuple[Array, Array]:
    """Return the direct light on patches (N, B), and its range within each (N,), lux."""
    points = mesh.points(_POINTS)
    normals = np.repeat(mesh.normals, len(_POINTS), axis=0)
    irradiance = direct_irradiance(room, rays, points.reshape(-1, 3), normals, shadow_rays)
    irradiance = irradiance.reshape(len(points), len(_POINTS), -1)
    return irradiance.mean(axis=1), np.ptp(lux_from_irradiance(irradiance, room.grid), axis=1)


def solve_irradiance(factors: csr_array, areas: Array, reflectances: Array, direct: Array) -> Array:
    """Return the irradiance (N, B): conjugate gradients for every band, with one matrix."""
    root = np.sqrt(areas)
    symmetric = csr_array(diags_array(root) @ factors @ diags_array(1.0 / root))
    shine = np.sqrt(reflectances)

    def applied(y: Array) -> Array:
        return y - shine * (symmetric @ (shine * y))

    target = shine * root[:, None] * direct
    y = np.zeros_like(target)
    residual = target.copy()
    step = residual.copy()
    square = start = np.einsum("nb,nb->b", residual, residual)
    for _ in range(_MAX_STEPS):
        if (square <= _CLOSE**2 * start).all():
            break
        product = applied(step)
        length = square / np.maximum(np.einsum("nb,nb->b", step, product), 1e-300)
        y += length * step
        residual -= length * product
        last, square = square, np.einsum("nb,nb->b", residual, residual)
        step = residual + square / np.maximum(last, 1e-300) * step
    reflected = shine * y / root[:, None]
    return direct + factors @ reflected


def _sampling_error(
    grid: SpectralGrid, factors: FormFactors, areas: Array, reflectances: Array, irradiance: Array
) -> float:
    """Return the relative error of the irradiance by rays, from the difference of two halves."""
    reflected = lux_from_irradiance(reflectances * irradiance, grid)
    one, two = (half @ reflected for half in factors.halves)
    mean = float(areas @ lux_from_irradiance(irradiance, grid) / areas.sum())
    return float(np.sqrt(areas @ ((one - two) / 2.0) ** 2 / areas.sum())) / max(mean, 1e-30)
