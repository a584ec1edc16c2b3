"""Presets: points in Hounsfield units with materials, fitted to a volume's values.

Volume, histogram -> [presets] -> Transfer
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis
from volspec.spectra import Spectrum, reflectance
from volspec.transfer import Isosurfaces, Transfer, TransferFunction
from volspec.volume import Volume


@dataclass(frozen=True, slots=True)
class Preset:
    """A transfer function for volumes of a sort.

    Parameters
    ----------
    name, title : str
    points : tuple of (hu, opacity, material)
        Of the curve; or the surfaces.
    materials : {name: reflectance}
        Names of `volspec.reflectance`.
    medical : bool
        Whether it is made for Hounsfield units; offered first where a volume has them.
    kind : {"points", "surfaces"}
    edges : float, optional
        Only boundaries are seen: the share of the volume's contrast per voxel at which they are
        at full opacity.
    """

    name: str
    title: str
    points: tuple[tuple[float, float, str], ...]
    materials: Mapping[str, str]
    medical: bool = False
    kind: Literal["points", "surfaces"] = "points"
    edges: float | None = None


_SKIN = "Vrhel/81 skin caucasian light"
_MUSCLE = "Vrhel/138 peach skin red"
_BLOOD = "Vrhel/44 red flower plant had red leaves"
_BONE = "Vrhel/158 fabric white"
_LUNG = "PMC/Pork"
_BRAIN = "Vrhel/89 skin caucasian light"
_GLASS = "ColorChecker/bluish green"

PRESETS: tuple[Preset, ...] = (
    Preset(
        "soft-hard",
        "Soft and hard",
        (
            (-450, 0.0, "soft"),
            (-250, 0.04, "soft"),
            (-50, 0.014, "soft"),
            (120, 0.014, "soft"),
            (260, 0.08, "hard"),
            (600, 0.5, "hard"),
            (1500, 0.9, "hard"),
        ),
        {"soft": _SKIN, "hard": _BONE},
        medical=True,
    ),
    Preset(
        "bone",
        "Bone",
        ((200, 0.0, "bone"), (380, 0.1, "bone"), (650, 0.6, "bone"), (1200, 0.95, "bone")),
        {"bone": _BONE},
        medical=True,
    ),
    Preset(
        "muscle-bone",
        "Muscle and bone",
        (
            (-30, 0.0, "muscle"),
            (40, 0.14, "muscle"),
            (130, 0.3, "muscle"),
            (240, 0.35, "bone"),
            (500, 0.85, "bone"),
        ),
        {"muscle": _MUSCLE, "bone": _BONE},
        medical=True,
    ),
    Preset(
        "skin",
        "Skin",
        ((-500, 0.0, "skin"), (-250, 0.5, "skin"), (0, 0.9, "skin")),
        {"skin": _SKIN},
        medical=True,
    ),
    Preset(
        "lung",
        "Lung",
        (
            (-900, 0.0, "lung"),
            (-820, 0.025, "lung"),
            (-650, 0.06, "lung"),
            (-450, 0.0, "lung"),
            (-60, 0.0, "vessels"),
            (60, 0.005, "vessels"),
            (250, 0.012, "vessels"),
            (450, 0.03, "bone"),
            (900, 0.2, "bone"),
        ),
        {"lung": _LUNG, "vessels": _BLOOD, "bone": _BONE},
        medical=True,
    ),
    Preset(
        "vessels",
        "Vessels and bone",
        (
            (110, 0.0, "vessels"),
            (180, 0.12, "vessels"),
            (320, 0.3, "vessels"),
            (480, 0.4, "bone"),
            (900, 0.8, "bone"),
        ),
        {"vessels": _BLOOD, "bone": _BONE},
        medical=True,
    ),
    Preset(
        "mr-head",
        "MR head",
        (
            (-450, 0.0, "skin"),
            (-250, 0.03, "skin"),
            (-60, 0.1, "brain"),
            (150, 0.45, "brain"),
            (700, 0.8, "bright"),
        ),
        {"skin": _SKIN, "brain": _BRAIN, "bright": "Vrhel/132 corn raw"},
    ),
    Preset(
        "fluorescence",
        "Fluorescence",
        (
            (-700, 0.0, "dim"),
            (-300, 0.006, "dim"),
            (40, 0.022, "dye"),
            (1000, 0.25, "bright"),
        ),
        {
            "dim": "PMC/Unitary blue",
            "dye": "PMC/Unitary green",
            "bright": "Vrhel/70 highlighter pen plastic",
        },
    ),
    Preset(
        "surface",
        "Surface",
        ((-450, 1.0, "surface"),),
        {"surface": "Vrhel/146 barley seeds"},
        kind="surfaces",
    ),
    Preset(
        "shells",
        "Shells",
        ((-450, 0.15, "outer"), (330, 0.3, "middle"), (750, 1.0, "inner")),
        {"outer": _GLASS, "middle": "ColorChecker/orange yellow", "inner": _BONE},
        kind="surfaces",
    ),
    Preset(
        "glass",
        "Glass",
        (
            (-700, 0.0, "glass"),
            (-300, 0.12, "glass"),
            (150, 0.12, "glass"),
            (260, 0.25, "core"),
            (800, 0.6, "core"),
        ),
        {"glass": "Vrhel/63 light green towel", "core": "ColorChecker/orange yellow"},
        edges=0.35,
    ),
    Preset(
        "metal",
        "Metal",
        (
            (-450, 0.0, "iron"),
            (-200, 0.1, "iron"),
            (200, 0.12, "iron"),
            (400, 0.7, "gold"),
            (900, 0.9, "gold"),
        ),
        {"iron": "iron", "gold": "gold"},
    ),
)
BY_NAME = {preset.name: preset for preset in PRESETS}
DEFAULT = "soft-hard"


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


def sorted_presets(volume: Volume) -> list[Preset]:
    """All presets, those for this sort of volume first."""
    medical = in_hounsfield(volume)
    return sorted(PRESETS, key=lambda preset: (preset.name != DEFAULT, preset.medical != medical))


def value_span(volume: Volume) -> tuple[float, float]:
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
    looks = preset_points(preset, volume, counts)
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


def preset_points(
    preset: Preset, volume: Volume, counts: NDArray[np.float64]
) -> list[tuple[float, float, str]]:
    """A preset's points at a volume's values, rising and within its range."""
    low, high = value_span(volume)
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
    return landmarks(counts, *value_span(volume))


def step_mm(volume: Volume) -> float:
    """The length over which presets' opacities hold."""
    corners = volume.corners_mm
    return float(np.linalg.norm(corners[-1] - corners[0])) / _STEPS


def preset_title(transfer: Transfer) -> str:
    """The title of the preset that a transfer function was made from; empty where of none."""
    name = transfer.basis.name
    preset = BY_NAME.get(name.removeprefix(_NAME)) if name.startswith(_NAME) else None
    return preset.title if preset else ""
