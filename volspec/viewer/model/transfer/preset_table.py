"""The presets themselves: points in Hounsfield units, and materials by name.

[preset_table] -> presets -> Transfer
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal


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
