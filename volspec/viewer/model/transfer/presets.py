"""Transfer functions to begin with, fitted to a volume's values.

    preset_table, volume, histogram -> [presets] -> Transfer

A preset says where its points are in Hounsfield units. In volumes of other values these become
landmarks of the histogram: the least value, the edge between air and matter, the middle and the
top of what is matter, the greatest value. Its materials are its basis: no spectrum has to be
fitted to anything, and colours are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis
from volspec.spectra import Spectrum, reflectance
from volspec.transfer import Isosurfaces, Transfer, TransferFunction
from volspec.viewer.model.transfer.preset_table import BY_NAME, DEFAULT, PRESETS, Preset
from volspec.volume import Volume

# Air, half-way to tissue, tissue, dense bone, the most of twelve bits.
_MARKS_HU = (-1000.0, -450.0, 40.0, 1000.0, 3071.0)
# Least and greatest value beyond which values are taken for Hounsfield units.
_HU = (-500.0, 500.0)
# Steps through the volume's diagonal: opacities hold over this length, so that a volume of finer
# voxels looks the same.
_STEPS = 440.0
# Of what is matter, the share below its top.
_TOP = 0.998
# The least distance of two landmarks, as a share of the range.
_APART = 1 / 24
_NAME = "preset "


def in_hounsfield(volume: Volume) -> bool:
    """Whether a volume's values look like Hounsfield units."""
    low, high = volume.range
    return low <= _HU[0] and high >= _HU[1]


def offered(volume: Volume) -> list[Preset]:
    """All presets, those for this sort of volume first."""
    medical = in_hounsfield(volume)
    return sorted(PRESETS, key=lambda preset: (preset.name != DEFAULT, preset.medical != medical))


def span(volume: Volume) -> tuple[float, float]:
    """A volume's range; of one that is the same everywhere, a little more at either side."""
    low, high = volume.range
    half = max(0.5, 1e-6 * abs(low))
    return (low, high) if high > low else (low - half, high + half)


def landmarks(counts: NDArray[np.float64], low: float, high: float) -> tuple[float, ...]:
    """Five rising values: the least, the edge of matter, its middle and its top, the greatest.

    Parameters
    ----------
    counts : (N,)
        Voxels by value from ``low`` to ``high``.

    References
    ----------
    The edge is Otsu's (1979), "A threshold selection method from gray-level histograms",
    IEEE Trans. SMC 9(1), 62-66.

    Examples
    --------
    >>> landmarks(np.array([90.0, 0, 0, 0, 5, 5, 0, 0, 0, 0]), 0, 100)
    (0.0, 20.0, 50.0, 60.0, 100.0)
    """
    edges = np.linspace(low, high, len(counts) + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)[:-1]
    above = counts.sum() - below
    sums = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = below * above * (sums[:-1] / below - (sums[-1] - sums[:-1]) / above) ** 2
    apart = np.nan_to_num(apart)
    # Where bins are empty many thresholds part alike; the middle of them is far from both.
    best = np.flatnonzero(apart >= apart.max() * (1 - 1e-9))
    cut = int((best[0] + best[-1]) // 2) + 1
    matter = np.cumsum(counts[cut:]) / max(counts[cut:].sum(), 1.0)
    middle, top = (edges[cut + 1 + int(np.searchsorted(matter, q))] for q in (0.5, _TOP))
    # They stay apart, whatever the histogram.
    marks = np.array([low, edges[cut], middle, top, high])
    least = (high - low) * _APART
    ramp = least * np.arange(5)
    marks = np.maximum.accumulate(marks - ramp) + ramp
    return tuple(float(mark) for mark in np.minimum(marks, high - ramp[::-1]))


def transfer_of(
    preset: Preset, volume: Volume, counts: NDArray[np.float64], basis: Basis
) -> Transfer:
    """A preset's transfer function for a volume.

    Parameters
    ----------
    preset : Preset
    volume : Volume
    counts : (N,)
        Voxels by value over the volume's range.
    basis : Basis
        Whose grid and observer are taken.
    """
    materials = reflectances(preset, basis)
    own = MaterialBasis(materials, _NAME + preset.name, basis.grid, basis.observer_deg)
    looks = fitted(preset, volume, counts)
    if preset.kind == "surfaces":
        return Isosurfaces(looks, materials, own)
    gradients = None
    if preset.edges is not None:
        low, *_, top, _ = marks_of(volume, counts)
        full = preset.edges * (top - low) / (2 * min(volume.spacing_mm))
        gradients = ((0.1 * full, 0.0), (full, 1.0))
    return TransferFunction(looks, materials, own, step_mm(volume), gradients)


def reflectances(preset: Preset, basis: Basis) -> dict[str, Spectrum]:
    """A preset's materials on a basis' grid."""
    return {name: reflectance(text, basis.grid) for name, text in preset.materials.items()}


def fitted(
    preset: Preset, volume: Volume, counts: NDArray[np.float64]
) -> list[tuple[float, float, str]]:
    """A preset's points at a volume's values, rising and within its range."""
    low, high = span(volume)
    marks = marks_of(volume, counts)
    values = np.interp([point[0] for point in preset.points], _MARKS_HU, marks)
    return [
        (float(min(max(value, low), high)), opacity, material)
        for value, (_, opacity, material) in zip(values, preset.points, strict=True)
    ]


def marks_of(volume: Volume, counts: NDArray[np.float64]) -> tuple[float, ...]:
    """Where a volume has air, the edge of matter, its middle and top, and the most."""
    if in_hounsfield(volume):
        return _MARKS_HU
    return landmarks(counts, *span(volume))


def step_mm(volume: Volume) -> float:
    """The length over which presets' opacities hold."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners[-1] - corners[0])) / _STEPS


def picked(transfer: Transfer) -> str:
    """The title of the preset that a transfer function was made from; empty where of none."""
    name = transfer.basis.name
    preset = BY_NAME.get(name.removeprefix(_NAME)) if name.startswith(_NAME) else None
    return preset.title if preset else ""
