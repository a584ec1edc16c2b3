"""Light of a room on a small specimen: an ambient light and a few directional ones.

RoomResponse, place -> [specimen] -> light groups, their spectra

    E(n) ≈ E_0 + Σ_k E_k max(0, n · ω_k)        per band, all E ≥ 0

as a raycaster shades. Directions are chosen once, for the room's own lights: at each step the one
that leaves the least error. Spectra are then a least-squares fit per band.

References
----------
[1] Cuttle (1997), "Cubic Illumination", Lighting Research and Technology 29(1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, count, product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from volspec.errors import RoomError
from volspec.room.direct_light import direct_irradiance
from volspec.room.quantities import lux_from_irradiance
from volspec.room.radiosity import RoomLight, require_inside
from volspec.room.response import RoomResponse
from volspec.spectra import colour_matching_functions

Array = NDArray[np.float64]
# Normals at which the light is fitted, and rays to what they see.
_NORMALS, _RAYS = 160, 1 << 14
# A further direction has to take this part of the error that is left, at least.
_WORTH = 0.03
# Besides the directions of the lights: to the sides, edges and corners of a cube.
_CUBE = np.array([corner for corner in product((-1.0, 0.0, 1.0), repeat=3) if any(corner)])


@dataclass(frozen=True, slots=True, eq=False)
class SpecimenLight:
    """Light on a specimen: G groups, the first of them ambient.

    Attributes
    ----------
    directions : (G - 1, 3) array
        Unit vectors towards the directional lights.
    names : tuple of str
        Of the G groups: ambient, then the surface in each direction.
    irradiance : (L, G, B) array
        On a surface that faces a group, per unit of each light's spectrum.
    error : float
        Root mean square over all normals, as a part of the mean lux, under the room's own lights.
    brightest_lux : float
        On the surface that gets the most, under the room's own lights.
    """

    directions: Array
    names: tuple[str, ...]
    irradiance: Array
    error: float
    brightest_lux: float
    _view_factors: Array  # (P, N) parts of the patches' reflected light on each of P normals
    _direct: Array  # (L, P)

    @classmethod
    def of(cls, response: RoomResponse, point_m: ArrayLike, directions: int = 5) -> SpecimenLight:
        """Fit the light at a point, with up to so many directional lights.

        Raises RoomError if the point is in a wall or outside of the room, or gets no light.
        """
        solved = response.solved
        require_inside(solved.room, solved.rays, point_m, "the specimen")
        point, normals = np.asarray(point_m, np.float64), _sphere(_NORMALS)
        ways = _sphere(_RAYS)
        hit = solved.rays.first(np.broadcast_to(point, ways.shape), ways)
        front = (hit >= 0) & (np.einsum("kc,kc->k", ways, solved.mesh.normals[hit]) < 0)
        cosines = np.maximum(normals @ ways[front].T, 0.0) * (4.0 / _RAYS)
        place = csr_array(
            (np.ones(front.sum()), (np.arange(front.sum()), hit[front])),
            shape=(int(front.sum()), len(solved.mesh.surface)),
        )
        view_factors = np.asarray(cosines @ place)
        points = np.broadcast_to(point, normals.shape)
        direct = [
            direct_irradiance(solved.room.alone(name), solved.rays, points, normals)
            for name in response.names
        ]
        unit_direct = np.array(direct)[..., 0]
        empty = np.zeros((0, 3))
        specimen = cls(empty, ("ambient",), np.zeros(0), 0.0, 0.0, view_factors, unit_direct)
        selected = specimen._directions(response, directions)
        hit = solved.rays.first(np.broadcast_to(point, selected.shape), selected)
        surfaces = solved.mesh.names
        names = ["outside" if k < 0 else surfaces[solved.mesh.surface[k]] for k in hit]
        return replace(specimen, directions=selected, names=("ambient", *_distinct(names))).under(
            response
        )

    def under(self, response: RoomResponse) -> SpecimenLight:
        """Return the light of the same groups in a room with other paints."""
        target = self._irradiances(response)  # (L, P, B)
        columns = _columns(self.directions)
        lights, _, bands = target.shape
        flat = target.transpose(1, 0, 2).reshape(len(columns), -1)
        fitted = np.asarray(np.linalg.lstsq(columns, flat)[0])
        for k in np.flatnonzero((fitted < 0.0).any(axis=0)):
            fitted[:, k] = _fit(columns, flat[:, k])[0]
        power = np.array([*response.solved.room.lights.values()])
        grid = response.solved.room.grid
        target_lux = lux_from_irradiance(np.einsum("lpb,lb->pb", target, power), grid)
        groups = fitted.reshape(-1, lights, bands).transpose(1, 0, 2)
        brightest = float(target_lux.max())
        if not brightest > 0.0:
            raise RoomError(
                "no light reaches the specimen",
                "move it, or add a light to the room",
                code="impossible",
            )
        fitted_lux = lux_from_irradiance(columns @ np.einsum("lgb,lb->gb", groups, power), grid)
        error = math.sqrt(np.mean((fitted_lux - target_lux) ** 2)) / float(target_lux.mean())
        return replace(self, irradiance=groups, error=error, brightest_lux=brightest)

    def error_on(self, solved: RoomLight, centre_m: Array, semi_axes_m: Array) -> float:
        """Return the `error` on an ellipsoid, whose rows of semi-axes (3, 3) are orthogonal."""
        sphere, grid = _sphere(_NORMALS), solved.room.grid
        normals = sphere @ np.linalg.inv(semi_axes_m).T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        lux = lux_from_irradiance(
            solved.irradiance_at(centre_m + sphere @ semi_axes_m, normals), grid
        )
        power = np.array([*solved.room.lights.values()])
        groups = lux_from_irradiance(np.einsum("lgb,lb->gb", self.irradiance, power), grid)
        fitted = groups[0] + np.maximum(normals @ self.directions.T, 0.0) @ groups[1:]
        return math.sqrt(np.mean((fitted - lux) ** 2)) / float(lux.mean())

    def _irradiances(self, response: RoomResponse) -> Array:
        """Return (L, P, B) irradiances of surfaces with P normals."""
        reflected = response.solved.reflectances * response.irradiance
        return np.array(
            [
                d[:, None] + self._view_factors @ patches
                for d, patches in zip(self._direct, reflected, strict=True)
            ]
        )

    def _directions(self, response: RoomResponse, maximum: int) -> Array:
        """Return the directions (K, 3) that leave the least error, K up to ``maximum``."""
        room = response.solved.room
        power = np.array([*room.lights.values()])
        E = np.einsum("lpb,lb->pb", self._irradiances(response), power)
        target = E @ colour_matching_functions(room.grid).T
        normals = _sphere(_NORMALS)
        vectors = self._direct @ normals  # towards each light
        candidates = np.concatenate([vectors[np.linalg.norm(vectors, axis=1) > 0], _CUBE])
        candidates /= np.linalg.norm(candidates, axis=1, keepdims=True)
        picked: list[int] = []
        left = _misfit(_columns(candidates[picked]), target)
        while len(picked) < maximum:
            errors = [
                _misfit(_columns(candidates[[*picked, k]]), target) for k in range(len(candidates))
            ]
            best = int(np.argmin(errors))
            if errors[best] >= (1.0 - _WORTH) * left:
                break
            picked.append(best)
            left = errors[best]
        return candidates[picked]


def _distinct(names: Sequence[str]) -> list[str]:
    """Return names, numbered where they repeat.

    >>> _distinct(["wall", "table 2", "wall", "wall 2"])
    ['wall', 'table 2', 'wall (2)', 'wall 2']
    """
    unique: list[str] = []
    for name in names:
        numbered = (f"{name} ({number})" for number in count(2))
        unique.append(next(label for label in chain((name,), numbered) if label not in unique))
    return unique


def _columns(directions: Array) -> Array:
    """Return (P, 1 + K): what each group of 1 gives on P normals."""
    cosines = np.maximum(_sphere(_NORMALS) @ directions.T, 0.0)
    return np.concatenate([np.ones((_NORMALS, 1)), cosines], axis=1)


def _misfit(columns: Array, target: Array) -> float:
    return math.sqrt(sum(_fit(columns, column)[1] ** 2 for column in target.T))


def _fit(columns: Array, target: Array) -> tuple[Array, float]:
    """Return the least-squares solution without negative parts, and its residual's length."""
    from scipy.optimize import nnls  # imported late: it takes a third of a second

    solution, left = nnls(columns, target)
    return solution, left


def _sphere(count: int) -> Array:
    """Return unit vectors (count, 3), evenly over the sphere: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, math.pi * (1.0 + math.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
