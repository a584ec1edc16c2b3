"""Make the beating heart of docs/time.md: ``python -m tools.gallery.heart [--keep FOLDER]``.

synthetic 4-D OME-TIFF -> scene -> film, page -> [heart] -> docs/images/heart.webp, page-heart.jpg

A phantom: three channels, muscle, blood and coronary arteries, at twenty times of a beat. With
``--keep`` the scene, its volumes and the page stay in a folder, to be opened in the viewer.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from tests.support.browser import chromium
from tools.gallery.film import save_loop
from tools.gallery.studio import ROOT
from tools.gallery.webpage import save, screens, strip
from volspec.export.exporter import export
from volspec.export.page import PageSpec, scene_views, write_page
from volspec.scene import Scene

Field = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Path3 = NDArray[np.float64]
Vector = tuple[float, float, float]
Place = tuple[float, float]

FOLDER = ROOT / "docs" / "images"
STEPS, SIDE, MM = 20, 96, 1.35
_BYTES = 1_200_000
_SCENE = """
version = 2
title = "A beating heart"

[volume]
file = "heart.ome.tif"
fps = 16

[[material]]
name = "muscle"
reflectance = "PMC/Orange"

[[material]]
name = "blood"
reflectance = "Vrhel/44 red flower plant had red leaves"

[[material]]
name = "artery"
reflectance = "gold"

[transfer]
points = [
  { value = 60, opacity = 0, material = "muscle" },
  { value = 180, opacity = 0.055, material = "muscle" },
]

[[field]]
name = "blood"
[field.transfer]
points = [
  { value = 90, opacity = 0, material = "blood" },
  { value = 160, opacity = 0.6, material = "blood" },
]

[[field]]
name = "arteries"
[field.transfer]
points = [
  { value = 60, opacity = 0, material = "artery" },
  { value = 160, opacity = 0.9, material = "artery" },
]

[basis]
method = "materials"
grid_nm = [400, 700, 10]

[raycast]
ambient = 0.3
specular = 0.25
jitter = 1

[[group]]
name = "all"
sources = [
  { kind = "directional", towards = [-1, 1.2, 1], frame = "camera", shadows = true },
  { kind = "ambient", intensity = 0.6 },
]

[[light]]
name = "day"
spectrum = "D65"

[[light]]
name = "tungsten"
spectrum = "A"

[[light]]
name = "LEDs"
spectrum = "led:470*0.068+led:510*0.645+led:670*0.287"

[camera]
azimuth_deg = 26
elevation_deg = 8
zoom = 1.75

[viewing]
mode = "componentwise"
backdrop = 0.01
exposure = 1.5
"""


def heart(phase: float, side: int = SIDE, mm: float = MM) -> list[Bytes]:
    """Return muscle, blood and coronary arteries (side³) at a phase of the beat, 0 to 1."""
    axis = np.linspace(-0.5, 0.5, side) * side * mm
    z, y, x = np.meshgrid(axis, axis, axis, indexing="ij")
    at = np.stack([x - 4, y, z + 14], axis=-1)
    shape = Shape(0.5 - 0.5 * np.cos(2 * np.pi * phase**0.8))
    u, v, w = np.moveaxis(at @ _frame().T, -1, 0)
    walls, rooms, base = shape.walls(u, v, w), shape.rooms(u, v, w), u - shape.base
    atria = shape.atria(u, v, w)
    vessels = np.min([_tube(at, *path) for path in shape.vessels()], axis=0)
    blood = np.minimum(np.minimum(np.maximum(rooms, base), vessels), atria)
    muscle = np.maximum(np.minimum(np.maximum(walls, base), atria - 2.0), -blood)
    arteries = np.min([_tube(at, *path) for path in shape.arteries()], axis=0)
    return [_filled(each, mm) for each in (muscle, blood, arteries)]


@dataclass(frozen=True)
class Shape:
    """The heart squeezed by a part from 0 to 1: distances in mm, negative inside.

    The walls keep their volume: they grow as the chambers shrink.
    """

    squeeze: float

    @property
    def base(self) -> float:
        """Height of the valves along the axis from the apex."""
        return 22 - 4 * self.squeeze

    def walls(self, u: Field, v: Field, w: Field) -> Field:
        """Return the distance from the outside of both ventricles."""
        s = self.squeeze
        left = _ellipsoid(u, v, w, (0, 0, 0), 46 - 2 * s, 30 - 2.5 * s)
        right = _ellipsoid(u, v, w, (7, 22, 5), 40 - 3 * s, 26 - 4 * s)
        return np.minimum(left, right)

    def rooms(self, u: Field, v: Field, w: Field) -> Field:
        """Return the distance from both chambers, which the septum divides."""
        s = self.squeeze
        left = _ellipsoid(u, v, w, (1, 0, 0), 39 - 4 * s, 21 - 8 * s)
        right = _ellipsoid(u, v, w, (7, 22, 5), 36 - 4 * s, 22.5 - 6 * s)
        septum = _ellipsoid(u, v, w, (0, 0, 0), 46, 30)
        return np.minimum(left, np.maximum(right, -septum))

    def atria(self, u: Field, v: Field, w: Field) -> Field:
        """Return the distance from both atria, which fill while the ventricles empty."""
        s = self.squeeze
        sizes = 14 + 3 * s, 16 + 3 * s
        left = _ellipsoid(u, v, w, (33 - 3 * s, -4, -10), *sizes)
        return np.minimum(left, _ellipsoid(u, v, w, (32 - 3 * s, 26, -8), *sizes))

    def vessels(self) -> list[tuple[Path3, float]]:
        """Return the aorta and the pulmonary trunk, as paths in the patient's frame and radii."""
        s, t = self.squeeze, np.linspace(0, 1, 80)
        root = np.array([self.base - 8, 6, -2]) @ _frame()
        rise = root + np.stack([-6 * t, -3 * np.sin(np.pi * t), 34 * t], axis=1)
        turn = np.pi * t
        arch = np.stack([8 - 8 * np.cos(turn), 13 - 13 * np.cos(turn), 12 * np.sin(turn)], axis=1)
        down = rise[-1] + arch[-1] - np.stack([0 * t, -2 * t, 46 * t], axis=1)
        out = np.array([self.base - 6, 20, 16]) @ _frame()
        lung = out + np.stack([14 * t + 10 * t**3, 22 * t**2, 26 * t - 8 * t**3], axis=1)
        return [(np.vstack([rise, rise[-1] + arch, down]), 8.5 + 0.8 * s), (lung, 8 + 0.7 * s)]

    def arteries(self) -> list[tuple[Path3, float]]:
        """Return the coronary arteries, as paths in the patient's frame and radii."""
        return [(self._on_surface(*ends), radius) for *ends, radius in _TREE]

    def _on_surface(self, start: Place, end: Place) -> Path3:
        """Return a path on the walls between two places, angles from the base and around it."""
        t = np.linspace(0, 1, 160)
        wave = 2.5 * np.sin(14 * t + start[1]) * np.sin(np.pi * t)
        polar, around = (
            np.radians(one + (two - one) * t + wave) for one, two in zip(start, end, strict=True)
        )
        across = np.sin(polar)
        ways = np.stack([np.cos(polar), across * np.cos(around), across * np.sin(around)])
        near, far = np.full(len(t), 5.0), np.full(len(t), 80.0)
        middle = np.array([2.0, 10.0, 2.0])[:, None]
        for _ in range(30):  # of the distance to the wall
            half = 0.5 * (near + far)
            inside = self.walls(*(middle + half * ways)) < 0.6
            near, far = np.where(inside, half, near), np.where(inside, far, half)
        return (middle + near * ways).T @ _frame()


# Coronary arteries: degrees from the base and around the axis, at both ends; radius in mm.
_TREE = (
    ((50, 92), (150, 108), 1.7),
    ((72, 95), (112, 150), 1.2),
    ((96, 99), (132, 160), 1.1),
    ((118, 102), (146, 152), 0.9),
    ((50, 92), (64, 190), 1.5),
    ((60, 160), (118, 196), 1.1),
    ((62, 70), (72, -60), 1.7),
    ((70, 5), (128, 40), 1.2),
    ((71, -30), (120, -10), 1.0),
    ((72, -60), (140, -110), 1.2),
)


def _frame() -> NDArray[np.float64]:
    """Return the directions from the apex to the base, to the right chamber and across, as rows.

    In the patient's frame: x to the left, y to the back, z up.
    """
    base = np.array([-0.5, 0.5, 0.71])
    base /= np.linalg.norm(base)
    right = np.array([-0.7, -0.7, 0.0])
    right -= right @ base * base
    right /= np.linalg.norm(right)
    return np.stack([base, right, np.cross(base, right)])


def _ellipsoid(u: Field, v: Field, w: Field, middle: Vector, along: float, across: float) -> Field:
    """Return about the distance from an ellipsoid around the u axis."""
    a, b, c = middle
    away = np.sqrt(((u - a) / along) ** 2 + ((v - b) ** 2 + (w - c) ** 2) / across**2)
    return (away - 1) * across


def _tube(at: Field, path: Path3, radius: float) -> Field:
    """Return the distance from a tube around a path (N, 3)."""
    return cKDTree(path).query(at.reshape(-1, 3))[0].reshape(at.shape[:3]) - radius


def _filled(distance: Field, mm: float) -> Bytes:
    """Return 200 inside and 0 outside, with an edge of two voxels."""
    return np.rint(200 * np.clip(0.5 - distance / (2 * mm), 0, 1)).astype(np.uint8)


def write(folder: Path) -> Scene:
    """Write the volumes and their scene into a folder; return the scene."""
    import tifffile

    folder.mkdir(parents=True, exist_ok=True)
    steps = np.array([heart(step / STEPS) for step in range(STEPS)])
    tifffile.imwrite(
        folder / "heart.ome.tif",
        steps,
        metadata={
            "axes": "TCZYX",
            "Channel": {"Name": ["muscle", "blood", "arteries"]},
            **{f"PhysicalSize{axis}": MM for axis in "XYZ"},
            **{f"PhysicalSize{axis}Unit": "mm" for axis in "XYZ"},
        },
    )
    (folder / "heart.toml").write_text(_SCENE.lstrip())
    return Scene.load(folder / "heart.toml")


def main() -> None:
    """Make the animated picture and the strip of the page."""
    parser = argparse.ArgumentParser(prog="python -m tools.gallery.heart", description=__doc__)
    parser.add_argument("--keep", type=Path, metavar="FOLDER")
    kept = parser.parse_args().keep
    with tempfile.TemporaryDirectory() as temporary:
        folder = (kept or Path(temporary)).absolute()
        scene = write(folder)
        frames = film(scene, folder / "frames")
        save_loop(frames, FOLDER / "heart.webp", 62, _BYTES)
        path = folder / "heart.html"
        views = scene_views(scene, size=(560, 560), series=scene.series())
        size = write_page(
            path, views, scene.lights, scene.relight, PageSpec(scene.file.title, fps=16)
        )
        print(f"{path.name}: {size / 1e6:.1f} MB")
        with chromium() as browser:
            shots = screens(browser, path, [0, 1, 2])
        print(f"page-heart.jpg: {save(strip(shots), FOLDER / 'page-heart.jpg') / 1000:.0f} kB")


def film(scene: Scene, folder: Path) -> list[Image.Image]:
    """Return the frames of three beats, while each light fades into the next."""
    made = export(
        scene,
        folder,
        size=(440, 440),
        play={"loops": 3},
        sweep={"frames": 3 * STEPS, "closed": True},
        samples=2,
        sheet=False,
        overwrite=True,
    )
    return [Image.open(made.output / name).convert("RGB") for name in made.files]


if __name__ == "__main__":
    main()
