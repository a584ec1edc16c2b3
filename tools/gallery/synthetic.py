"""Synthetic volumes: a microscope's four channels of cells, and a PET for the chest CT."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

import volspec as vs

# Micrometres of a voxel, and voxels (z, y, x), of the synthetic cells.
_VOXEL_UM, _SHAPE = 0.25, (112, 256, 256)


def cells() -> vs.Volume:
    """Three synthetic cells, 64 µm across: nuclei, actin, mitochondria and vesicles."""
    random = np.random.default_rng(5)
    z, y, x = np.ogrid[: _SHAPE[0], : _SHAPE[1], : _SHAPE[2]]
    stains = {
        name: np.zeros(_SHAPE, np.float32) for name in ("nuclei", "actin", "mito", "vesicles")
    }
    chromatin = gaussian_filter(random.standard_normal(_SHAPE).astype(np.float32), 2.5)
    for middle in ((52, 84, 88), (58, 172, 120), (50, 108, 186)):
        middle = np.array(middle, float)
        size = np.array([20.0, 27.0, 24.0]) * random.uniform(0.9, 1.1)
        away = sum(((a - m) / s) ** 2 for a, m, s in zip((z, y, x), middle, size, strict=True))
        stains["nuclei"] += (away < 1) * (1.0 + 5.0 * chromatin).clip(0.1, 2)
        for _ in range(130):  # fibres from the nucleus to the cell's edge
            way = random.standard_normal(3) * (0.35, 1, 1)
            way /= np.linalg.norm(way)
            steps = np.arange(0, random.uniform(40, 72), 0.5)
            bend = random.standard_normal(3) * (0.1, 0.5, 0.5)
            path = middle + np.outer(steps + 20, way) + np.outer(steps**2 / 90, bend)
            _draw(stains["actin"], path)
        for _ in range(170):  # threads around the nucleus
            start = middle + size * _unit(random) * random.uniform(1.15, 1.9) * (0.8, 1, 1)
            turns = gaussian_filter(random.standard_normal((40, 3)), (6, 0)) * (1.0, 3.0, 3.0)
            _draw(stains["mito"], start + np.cumsum(turns, axis=0), 3)
        for _ in range(90):
            at = middle + size * _unit(random) * random.uniform(1.3, 2.4) * (0.7, 1, 1)
            _draw(stains["vesicles"], at[None], 60)
    blurs = {"nuclei": 1.0, "actin": 0.8, "mito": 1.3, "vesicles": 1.8}
    fields = [
        vs.Volume(
            _bytes(gaussian_filter(stain, blurs[name])),
            spacing_mm=(_VOXEL_UM / 1e3,) * 3,
            name=name,
        )
        for name, stain in stains.items()
    ]
    return fields[0].with_fields(fields[1:])


def _unit(random: np.random.Generator) -> NDArray[np.float64]:
    way = random.standard_normal(3)
    return way / np.linalg.norm(way)


def _draw(stain: NDArray[np.float32], path: NDArray[np.float64], amount: float = 1.0) -> None:
    at = np.rint(path).astype(int)
    at = at[((at >= 0) & (at < _SHAPE)).all(1)]
    stain[tuple(at.T)] += amount


def _bytes(stain: NDArray[np.float32]) -> NDArray[np.uint8]:
    top = np.quantile(stain[stain > 0.02 * stain.max()], 0.97)
    return (255 * (stain / top).clip(0, 1)).astype(np.uint8)


def tracer() -> vs.Volume:
    """A made-up PET, 4 mm a voxel: heart muscle, liver, a nodule in the lung, a lymph node."""
    z, y, x = np.meshgrid(*(4.0 * np.arange(n) for n in (83, 90, 90)), indexing="ij")

    def ball(middle: Sequence[float], radii: Sequence[float]) -> NDArray[np.float64]:
        parts = zip((x, y, z), middle, radii, strict=True)
        return np.sqrt(sum(((at - m) / r) ** 2 for at, m, r in parts))

    heart, liver = ball((232, 152, 160), (42, 40, 40)), ball((112, 165, 92), (52, 62, 48))
    uptake = 0.55 * np.exp(-(((heart - 0.85) / 0.2) ** 2)) + 0.22 * (liver < 1)
    for middle, radius in (((86, 190, 178), 14), ((172, 196, 196), 9)):
        uptake += np.exp(-(ball(middle, [radius] * 3) ** 2))
    random = np.random.default_rng(2)
    noise = gaussian_filter(random.standard_normal(uptake.shape), 1.2)
    blurred = gaussian_filter(uptake, 1.2) * (1 + 0.25 * noise)
    return vs.Volume(blurred.clip(0, 1).astype(np.float32), spacing_mm=(4, 4, 4), name="PET")
