"""Form factors with visibility, and rays between the surfaces of a room.

mesh -> [form_factors] -> radiosity

    F_ij = 1/A_i ∫∫ cos cos / (π r²) V dA dA     the part of i's diffuse light that falls on j

Every patch shoots the same number of cosine-distributed rays (a scrambled Sobol' sequence, shifted
for each patch), so that work and memory grow linearly with the patches. What both patches of a pair
found is joined: A_i F_ij is symmetric, and its row sums are the patch's area times the part of its
rays that hit a front. Scaling to these sums [1] makes reciprocity and closure exact.

References
----------
[1] Knight, Ruiz & Uçar (2014), "A symmetry preserving algorithm for matrix scaling", SIAM J. Matrix
    Anal. Appl. 35(3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.stats import qmc

from volspec._triangles import TriangleRays, cosine_directions
from volspec.room.mesh import RoomMesh

Array = NDArray[np.float64]
# Rays that are shot at once: 20 to 30 MB of origins and directions.
_BLOCK = 1 << 19
_ROUNDS, _CLOSE = 200, 1e-7


class Rays(TriangleRays):
    """Ray queries of a room's mesh, m; raises DeviceError where Embree is not installed."""

    def __init__(self, mesh: RoomMesh) -> None:
        instead = "use a room in closed form (cube or brick), or another system"
        super().__init__(mesh.corners_m, "rooms of triangles", instead)
        self.mesh = mesh


@dataclass(frozen=True, slots=True, eq=False)
class FormFactors:
    """Form factors of N patches, and two independent estimates, whose difference is their error."""

    factors: csr_array  # (N, N)
    halves: tuple[csr_array, csr_array]
    escaped: Array  # (N,) part of the rays that leave the room
    backs: Array  # (N,) part of the rays that hit the back of a triangle


def sobol(count: int, dimensions: int, seed: int) -> Array:
    """Return a scrambled Sobol' sequence; ``count`` is a power of two."""
    engine = qmc.Sobol(dimensions, rng=np.random.default_rng(seed))
    return np.asarray(engine.random_base2(count.bit_length() - 1))


def form_factors(
    rays: Rays,
    per_patch: int,
    seed: int = 0,
    progress: Callable[[float], object] = lambda fraction: None,
) -> FormFactors:
    """Estimate the form factors of a mesh's triangles from ``per_patch`` rays each, a power of two.

    A patch sees nothing of itself; rays that hit a back are lost.
    """
    mesh = rays.mesh
    count, normals, areas = len(mesh.surface), mesh.normals, mesh.areas_m2
    pattern = sobol(per_patch, 4, seed)
    shifts = np.random.default_rng(seed + 1).random((count, 1, 4))
    escaped, backs = np.zeros(count), np.zeros(count)
    hits: list[list[NDArray[np.int64]]] = [[], []]
    numbers: list[list[NDArray[np.int64]]] = [[], []]
    step = max(_BLOCK // per_patch, 1)
    for start in range(0, count, step):
        progress(start / count)
        rows = slice(start, min(start + step, count))
        samples = (pattern + shifts[rows]) % 1.0
        normal = normals[rows, None]
        origins = mesh.part(rows).points(samples[..., :2]) + rays.offset * normal
        directions = cosine_directions(normal, samples[..., 2:])
        hit = rays.first(origins.reshape(-1, 3), directions.reshape(-1, 3)).reshape(-1, per_patch)
        front = np.einsum("nkc,nkc->nk", directions, normals[hit]) < 0
        escaped[rows], backs[rows] = (hit < 0).mean(axis=1), ((hit >= 0) & ~front).mean(axis=1)
        pairs = np.arange(start, rows.stop)[:, None] * np.int64(count) + hit
        visible = front & (hit >= 0)
        for half in range(2):
            columns = slice(half * per_patch // 2, (half + 1) * per_patch // 2)
            key, number = np.unique(pairs[:, columns][visible[:, columns]], return_counts=True)
            hits[half].append(key)
            numbers[half].append(number)
    progress(1.0)
    sums = areas * (1.0 - escaped - backs)
    raw = [
        _raw(np.concatenate(keys), np.concatenate(counts) * (2.0 / per_patch), count)
        for keys, counts in zip(hits, numbers, strict=True)
    ]
    joined = _reciprocal(csr_array((raw[0] + raw[1]) / 2.0), areas, sums)
    return FormFactors(joined, (raw[0], raw[1]), escaped, backs)


def _raw(keys: NDArray[np.int64], values: NDArray[Any], count: int) -> csr_array:
    return csr_array((values, np.divmod(keys, count)), shape=(count, count))


def _reciprocal(raw: csr_array, areas: Array, sums: Array) -> csr_array:
    """Return form factors for which A_i F_ij = A_j F_ji and A_i Σ_j F_ij = ``sums``."""
    coo = raw.tocoo()
    i, j = coo.coords
    # Rays of a small patch are denser: its estimate of A_i F_ij has less variance.
    flow = csr_array((coo.data * areas[i] * areas[j] / (areas[i] + areas[j]), (i, j)), raw.shape)
    flow = csr_array(flow + flow.T)
    scale = np.ones(len(areas))
    for _ in range(_ROUNDS):
        row_sums = scale * (flow @ scale)
        if np.abs(row_sums - sums).max() <= _CLOSE * sums.max():
            break
        scale *= np.sqrt(sums / np.maximum(row_sums, 1e-30))
    flow = flow.tocoo()
    i, j = flow.coords
    data = flow.data * scale[i] * scale[j] / areas[i]
    return csr_array((data, (i, j)), shape=raw.shape)
