"""The five scenes that casts are timed on: transfer functions and cameras a user would choose.

Both sides of every comparison get the same points, camera and step. The engine is the demo as it
ships, with its own basis of seven channels; the others are analysed in general-7.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.chest import chest
from volspec._gpu.sources import asset
from volspec.basis import SpectralBasis
from volspec.raycast import Camera
from volspec.scene import Scene
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, load_volume

ROOT = Path(__file__).resolve().parent.parent
Points = tuple[tuple[float, float, str], ...]


@dataclass(frozen=True, slots=True, eq=False)
class BenchScene:
    """A volume on the bench.

    Parameters
    ----------
    name : str
    volume : Volume
    transfer : TransferFunction
    camera : Camera
    """

    name: str
    volume: Volume
    transfer: TransferFunction
    camera: Camera


@dataclass(frozen=True, slots=True)
class Recipe:
    """What makes a scene.

    Parameters
    ----------
    read : callable
        Reads the volume; raises FileNotFoundError where it cannot be had.
    materials : {name: reflectance of the library}
    points : of (value, opacity per smallest spacing, material)
    camera : keywords of `Camera.orbit`
    """

    read: Callable[[], Volume]
    materials: dict[str, str]
    points: Points
    camera: dict[str, Any] = field(default_factory=dict)


def stored(name: str) -> Callable[[], Volume]:
    """A reader of a volume that does not ship: in $VOLSPEC_DATA, or beside the project."""

    def read() -> Volume:
        for folder in (os.environ.get("VOLSPEC_DATA"), ROOT.parent / "shared" / "data"):
            if folder and (path := Path(folder) / f"{name}.nrrd").exists():
                return load_volume(path)
        raise FileNotFoundError(f"no {name}.nrrd; set VOLSPEC_DATA to its folder")

    return read


RECIPES = {
    # Skin and flesh as a veil around the bones.
    "foot": Recipe(
        stored("foot"),
        {"skin": "PMC/Caucasian", "flesh": "PMC/Pork", "bone": "Vrhel/148 sesame seeds"},
        (
            (16, 0.0, "skin"),
            (32, 0.012, "skin"),
            (60, 0.012, "flesh"),
            (85, 0.03, "flesh"),
            (110, 0.12, "bone"),
            (180, 0.5, "bone"),
            (255, 0.8, "bone"),
        ),
        {"azimuth_deg": 30, "elevation_deg": 20, "zoom": 1.4, "up": (0, -1, 0)},
    ),
    # Vessels with the contrast agent, opaque; 99 % of the volume is empty.
    "aneurism": Recipe(
        stored("aneurism"),
        {"small": "PMC/Pork", "vessel": "ColorChecker/red", "core": "ColorChecker/orange yellow"},
        (
            (24, 0.0, "small"),
            (60, 0.2, "small"),
            (110, 0.6, "vessel"),
            (200, 0.8, "vessel"),
            (255, 0.9, "core"),
        ),
        {"azimuth_deg": 20, "elevation_deg": 10, "zoom": 1.5},
    ),
    # The brain's surface, brighter matter within.
    "mrbrain": Recipe(
        stored("mrbrain"),
        {"skin": "PMC/Caucasian", "grey": "Vrhel/161 fabric pink", "white": "PMC/White"},
        (
            (28, 0.0, "skin"),
            (45, 0.06, "skin"),
            (60, 0.3, "grey"),
            (85, 0.45, "grey"),
            (110, 0.5, "white"),
            (160, 0.5, "white"),
        ),
        {"azimuth_deg": 40, "elevation_deg": 30, "zoom": 2.1, "up": (0, 0, -1)},
    ),
    # Air transparent, lung faint, soft tissue low, bone dense.
    "chest": Recipe(
        chest,
        {"lung": "Vrhel/161 fabric pink", "soft": "PMC/Pork", "bone": "Vrhel/148 sesame seeds"},
        (
            (-900, 0.0, "lung"),
            (-800, 0.001, "lung"),
            (-500, 0.001, "lung"),
            (-200, 0.002, "soft"),
            (100, 0.003, "soft"),
            (180, 0.03, "bone"),
            (400, 0.3, "bone"),
            (1500, 0.8, "bone"),
        ),
        {"azimuth_deg": 20, "elevation_deg": 10, "zoom": 1.4},
    ),
}
NAMES = ("engine", *RECIPES)


@cache
def bench_scene(name: str) -> BenchScene:
    """One of `NAMES`.

    Raises
    ------
    FileNotFoundError
        If its volume cannot be had.
    """
    if name == "engine":
        scene = Scene.load(asset("data/scenes/engine.toml"))
        volume = scene.volume()
        return BenchScene(name, volume, scene.transfer, scene.camera(volume))
    recipe = RECIPES[name]
    volume = recipe.read()
    transfer = TransferFunction(
        points=recipe.points,
        materials={key: reflectance(text) for key, text in recipe.materials.items()},
        basis=SpectralBasis.load("general-7"),
    )
    return BenchScene(name, volume, transfer, Camera.orbit(volume, **recipe.camera))


def bench_scenes() -> Iterator[BenchScene | tuple[str, str]]:
    """Every scene; of one that cannot be had its name and why."""
    for name in NAMES:
        try:
            yield bench_scene(name)
        except FileNotFoundError as error:
            yield name, str(error)
