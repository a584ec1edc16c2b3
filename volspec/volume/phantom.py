"""Volumes with known analytic answers, for tests, benchmarks and lessons."""

from __future__ import annotations

import numpy as np

from volspec.volume.model import Volume


def slab(size: int = 32, thickness: int = 16, value: float = 1.0) -> Volume:
    """Make a homogeneous float32 volume, ``thickness`` cells along z and ``size`` across, 1 mm.

    Every sample inside is ``value``, so a ray's transmittance follows from its chord through the
    box by the Beer-Lambert law.
    """
    values = np.full((thickness + 1, size + 1, size + 1), value, np.float32)
    return Volume(values, name="slab")


def ball(size: int = 64, *, spacing_mm: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Volume:
    """Make a float32 volume that falls linearly from 1 at the centre to 0 at the border.

    The field is a cone in world space (millimetres), so its gradient has the same length everywhere
    except at the centre.
    """
    axes = [(np.arange(size) - (size - 1) / 2) * s for s in spacing_mm]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    radius = np.sqrt(x**2 + y**2 + z**2).transpose(2, 1, 0)
    half = (size - 1) / 2 * min(spacing_mm)
    return Volume(
        np.maximum(1 - radius / half, 0).astype(np.float32), spacing_mm=spacing_mm, name="ball"
    )
