"""Presets of transfer functions, given in Hounsfield units and fitted to a volume's values.

Volume, histogram -> [presets] -> Transfer
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from volspec._gpu import asset
from volspec._parse import parse_toml
from volspec.basis import MaterialBasis
from volspec.errors import InputError, nearest
from volspec.settings import Pair, read_table, settings
from volspec.spectra import Observer, SpectralGrid, reflectance
from volspec.transfer import Isosurfaces, Transfer, TransferFunction
from volspec.volume import Volume
from volspec.volume.levels import BINS, counted_step, histogram_of_values

Points = Annotated[tuple[Pair, ...], Field(strict=False)]


@settings(InputError)
@dataclass(frozen=True, slots=True)
class Preset:
    """A transfer function for one kind of volume, as given in ``data/presets.toml``."""

    name: str
    title: str
    # By material, in the order of their values: a name of `volspec.reflectance`, and the curve's
    # points, or the surfaces, as (HU, opacity).
    parts: dict[str, Annotated[tuple[str, Points], Field(strict=False)]]
    medical: bool = False  # for Hounsfield units, and listed first for volumes that have them
    surfaces: bool = False  # not a curve
    # To show only boundaries: the fraction of the volume's contrast per voxel at which they are at
    # full opacity.
    edges: float | None = None
    words: str = ""  # other names by which it is found

    @property
    def materials(self) -> dict[str, str]:
        """Names of reflectances by material."""
        return {name: reflectance for name, (reflectance, _) in self.parts.items()}


def _load_presets() -> tuple[Preset, ...]:
    table = parse_toml(asset("data/presets.toml").read_text(encoding="utf-8"))
    return tuple(read_table(Preset, row, InputError) for row in table["preset"])


PRESETS = _load_presets()
BY_NAME = {preset.name: preset for preset in PRESETS}
DEFAULT = "soft-hard"


def preset_named(name: str) -> Preset:
    """Return a preset; raises InputError if there is none with that name."""
    if name not in BY_NAME:
        remedy = f"{nearest(name, BY_NAME)}known: {', '.join(BY_NAME)}"
        raise InputError.refused("preset", name, remedy, "unknown")
    return BY_NAME[name]


# Air, half-way to tissue, tissue, dense bone, the greatest 12-bit value.
_MARKS_HU = (-1000.0, -450.0, 40.0, 1000.0, 3071.0)
# Opacities refer to the volume's diagonal divided by this, so that finer voxels look the same.
_STEPS = 440.0
# Quantile of the voxels of matter that counts as its top.
_TOP = 0.998
# Fraction of the variance between the two sides of the threshold from which on they are two groups;
# it is 0.64 for one normal distribution, and 0.75 for a uniform one.
_TWO_GROUPS = 0.8
# The least distance between two landmarks, as a fraction of the range.
_APART = 1 / 24
_NAME = "preset "


def histogram(volume: Volume) -> NDArray[np.float64]:
    """Count voxels in (256,) bins of the typical range; large volumes are subsampled.

    Of a volume larger than memory, those of its finest level, if they are known.
    """
    if volume.pyramid is not None and volume.pyramid.sample is not None:
        sample = volume.pyramid.sample
        if volume.typical_range == sample.range:
            return sample.histogram
        return histogram_of_values(sample.voxels, volume.typical_range)
    stride = counted_step(volume.values.size)
    return histogram_of_values(volume.values[::stride, ::stride, ::stride], volume.typical_range)


def histogram_of(steps: Iterable[Volume]) -> NDArray[np.float64]:
    """Count voxels as `histogram`, of all time steps of a series, which have one range."""
    total = np.zeros(BINS)
    for volume in steps:
        total += histogram(volume)
    return total


def sorted_presets(volume: Volume) -> list[Preset]:
    """Return all presets, those for this kind of volume first."""
    medical = volume.metadata.in_hounsfield
    return sorted(PRESETS, key=lambda preset: (preset.name != DEFAULT, preset.medical != medical))


def value_span(volume: Volume) -> tuple[float, float]:
    """Return a volume's typical range, widened a little if all values are the same."""
    low, high = volume.typical_range
    half = abs(low) / 2 or 0.5
    return (low, high) if high > low else (low - half, high + half)


def landmarks(
    counts: NDArray[np.float64], low: float, high: float, is_masked: bool = False
) -> tuple[float, ...]:
    """Return five rising values: the least, the edge of matter, its middle and top, the greatest.

    Counts are (N,) voxels by value from ``low`` to ``high``. If ``is_masked``, what is not matter
    may have been left out of them: all is matter unless they fall into two groups. The edge is
    Otsu's threshold (1979),
    "A threshold selection method from gray-level histograms", IEEE Trans. SMC 9(1), 62-66.

    >>> landmarks(np.array([90.0, 0, 0, 0, 5, 5, 0, 0, 0, 0]), 0, 100)
    (0.0, 20.0, 50.0, 60.0, 100.0)
    """
    edges = np.linspace(low, high, len(counts) + 1)
    middles = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)[:-1]
    above = counts.sum() - below
    sums = np.cumsum(counts * middles)
    with np.errstate(divide="ignore", invalid="ignore"):
        variance = below * above * (sums[:-1] / below - (sums[-1] - sums[:-1]) / above) ** 2
    variance = np.nan_to_num(variance)
    # Empty bins make many thresholds equally good; the middle one is far from both sides.
    best = np.flatnonzero(variance >= variance.max() * (1 - 1e-9))
    cut = int((best[0] + best[-1]) // 2) + 1
    total = counts.sum()
    spread = (counts * (middles - sums[-1] / total) ** 2).sum() * total
    if is_masked and variance.max() < _TWO_GROUPS * spread:
        cut = 1
    matter = np.cumsum(counts[cut:]) / max(counts[cut:].sum(), 1.0)
    middle, top = (edges[cut + 1 + int(np.searchsorted(matter, q))] for q in (0.5, _TOP))
    # Keep them apart, whatever the histogram.
    marks = np.array([low, edges[cut], middle, top, high])
    gap = (high - low) * _APART
    ramp = gap * np.arange(5)
    marks = np.maximum.accumulate(marks - ramp) + ramp
    return tuple(float(mark) for mark in np.minimum(marks, high - ramp[::-1]))


def fit_preset(
    preset: Preset,
    volume: Volume,
    counts: NDArray[np.float64],
    grid: SpectralGrid,
    observer_deg: Observer = 2,
) -> Transfer:
    """Return a preset's transfer function for a volume, with its materials as the basis.

    Counts are the volume's `histogram`.
    """
    materials = {name: reflectance(text, grid) for name, text in preset.materials.items()}
    basis = MaterialBasis(materials, _NAME + preset.name, grid, observer_deg)
    points = preset_points(preset, volume, counts)
    if preset.surfaces:
        return Isosurfaces(points, materials, basis)
    gradients = None
    if preset.edges is not None:
        low, *_, top, _ = _marks(volume, counts)
        full = preset.edges * (top - low) / (2 * volume.smallest_mm)
        gradients = ((0.1 * full, 0.0), (full, 1.0))
    return TransferFunction(points, materials, basis, step_mm(volume), gradients)


def is_preset(
    transfer: Transfer, preset: Preset, volume: Volume, counts: NDArray[np.float64]
) -> bool:
    """Return True if a transfer function is a preset's for a volume, in any basis, unchanged."""
    if set(transfer.materials) != set(preset.parts):
        return False
    fitted = fit_preset(preset, volume, counts, transfer.basis.grid, transfer.basis.observer_deg)
    if type(transfer) is not type(fitted):
        return False
    names = {field.name for field in fields(fitted)} - {"materials", "basis"}
    return all(getattr(transfer, name) == getattr(fitted, name) for name in names) and all(
        np.array_equal(transfer.materials[name].values, spectrum.values)
        for name, spectrum in fitted.materials.items()
    )


def preset_points(
    preset: Preset, volume: Volume, counts: NDArray[np.float64]
) -> list[tuple[float, float, str]]:
    """Return (value, opacity, material) of a preset's points, within a volume's range."""
    low, high = value_span(volume)
    marks = _marks(volume, counts)
    curve = [
        (min(max(round_to(np.interp(hu, _MARKS_HU, marks), high - low), low), high), opacity, name)
        for name, (_, points) in preset.parts.items()
        for hu, opacity in points
    ]
    if volume.range[1] > high and not preset.surfaces:  # values that fill are above: transparent
        curve += [(high, curve[-1][1], curve[-1][2]), (high, 0.0, curve[-1][2])]
    return curve


def round_to(value: float, span: float) -> float:
    """Return a value of a range that spans so much, rounded for people who read it in a scene."""
    return round(float(value), 3 - math.floor(math.log10(span))) if span else value


def _marks(volume: Volume, counts: NDArray[np.float64]) -> tuple[float, ...]:
    """Return the volume's values at `_MARKS_HU`."""
    if volume.metadata.in_hounsfield:
        return _MARKS_HU
    is_masked = volume.typical_range[0] > volume.range[0]
    return landmarks(counts, *value_span(volume), is_masked)


def step_mm(volume: Volume) -> float:
    """Return the reference step for the opacities of presets."""
    corners = volume.corners_mm
    return float(f"{np.linalg.norm(corners[-1] - corners[0]) / _STEPS:.4g}")


def preset_of(transfer: Transfer) -> Preset | None:
    """Return the preset that a transfer function began as; None if it was none."""
    name = transfer.basis.name
    return BY_NAME.get(name.removeprefix(_NAME)) if name.startswith(_NAME) else None
