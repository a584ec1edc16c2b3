"""A room as it is seen behind a volume: coefficients per pixel, for each of the room's lights.

RoomResponse, camera -> [backdrop] -> (H, W, L·M) coefficients -> CoefficientImage

Under light l alone, with 1 in each band, a surface sends ρ R_l + [it is l], R_l its irradiance: a
reflectance, as far as the raycaster's picture is concerned. The picture therefore survives every
change of the lights' spectra. Between the corners of a patch, light is interpolated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from volspec.basis import SpectralBasis
from volspec.room.form_factors import Rays
from volspec.room.mesh import RoomMesh
from volspec.room.response import RoomResponse

Array = NDArray[np.float64]
# Surfaces that turn their backs are invisible; a ray passes through so many of them at most.
_BACKS = 8
# Corners of patches of one surface share their light if their normals differ by less than this.
_SAME_SIDE = 1e-3


def seen_corners(rays: Rays, origins_m: Array, directions: Array) -> csr_array:
    """Return (K, 3N) weights of the corners of N patches that K rays see first.

    A ray that sees nothing has a row of zeros; backs are invisible, as if the eye were in the room.
    """
    mesh = rays.mesh
    normals, corners = mesh.normals, mesh.corners_m
    hit = np.full(len(directions), -1)
    starts, going = origins_m.copy(), np.arange(len(directions))
    for _ in range(_BACKS):
        found = rays.first(starts[going], directions[going])
        going, found = going[found >= 0], found[found >= 0]
        slope = np.einsum("kc,kc->k", directions[going], normals[found])
        hit[going[slope < 0]] = found[slope < 0]
        going, found, slope = going[slope >= 0], found[slope >= 0], slope[slope >= 0]
        if not len(going):
            break
        way = np.einsum("kc,kc->k", corners[found, 0] - starts[going], normals[found])
        way = way / np.maximum(slope, 1e-9) + rays.offset_m
        starts[going] += way[:, None] * directions[going]
    seen = np.flatnonzero(hit >= 0)
    triangle = hit[seen]
    a, b, c = (corners[triangle, i] for i in range(3))
    slope = np.einsum("kc,kc->k", directions[seen], normals[triangle])
    way = np.einsum("kc,kc->k", a - starts[seen], normals[triangle]) / slope
    points = starts[seen] + way[:, None] * directions[seen]
    double = 2.0 * mesh.areas_m2[triangle]
    parts = np.stack(
        [
            np.einsum("kc,kc->k", np.cross(q - p, points - p), normals[triangle]) / double
            for p, q in ((b, c), (c, a), (a, b))
        ],
        axis=1,
    )
    parts = np.clip(parts, 0.0, 1.0)
    parts /= parts.sum(axis=1, keepdims=True)
    counts = np.zeros(len(directions) + 1, np.int64)
    counts[seen + 1] = 3
    columns = (3 * triangle[:, None] + np.arange(3)).ravel()
    weights = np.float32(parts.ravel())
    return csr_array(
        (weights, columns, np.cumsum(counts)), shape=(len(directions), 3 * len(normals))
    )


def corner_owners(mesh: RoomMesh) -> csr_array:
    """Return (3N, N) weights: the mean over the patches of a side that meet at each corner."""
    cells = np.rint(mesh.normals / _SAME_SIDE).astype(np.int64)
    sides = np.concatenate([mesh.surface[:, None], cells], axis=1)
    side = np.unique(sides, axis=0, return_inverse=True)[1].ravel()
    key = np.stack([mesh.corner_numbers().ravel(), np.repeat(side, 3)], axis=1)
    group = np.unique(key, axis=0, return_inverse=True)[1].ravel()
    patch = np.repeat(np.arange(len(mesh.surface)), 3)
    area = mesh.areas_m2[patch]
    sums = csr_array((area, (group, patch)), shape=(int(group.max()) + 1, len(mesh.surface)))
    rows = csr_array((np.ones(len(group)), (np.arange(len(group)), group)))
    weights = rows @ sums
    total = np.asarray(weights.sum(axis=1)).ravel()
    return csr_array(weights.multiply(1.0 / total[:, None]))


@dataclass(frozen=True, slots=True, eq=False)
class CornerColours:
    """Coefficients of what the corners of all patches send to the eye, by light.

    Attributes
    ----------
    all, direct : (3N, L·M) float32
        Everything; and the part of it that reflects light that comes directly from lights, which
        what is in the way takes away.
    """

    all: NDArray[np.float32]
    direct: NDArray[np.float32]

    @classmethod
    def of(
        cls, response: RoomResponse, basis: SpectralBasis, parts: Array, owners: csr_array
    ) -> CornerColours:
        """Compute them, times (L,) ``parts``; ``owners`` are the mesh's `corner_owners`."""
        mesh, reflectances = response.solved.mesh, response.solved.reflectances
        own = basis.analyse(reflectances)
        everything, direct = [], []
        for number, name in enumerate(response.names):
            sent = owners @ basis.analyse(reflectances * response.irradiance[number])
            if name in response.solved.room.exitances:
                sent[np.repeat(mesh.surface == mesh.names.index(name), 3)] += basis.white
            everything.append(parts[number] * sent)
            direct.append(parts[number] * (owners @ (own * response.direct[number][:, None])))
        joined = (np.concatenate(each, axis=1) for each in (everything, direct))
        return cls(*(each.astype(np.float32) for each in joined))
