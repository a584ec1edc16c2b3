"""Layers of opacity: one cast in six states above six casts.

``python -m tools.gallery.layers`` makes README.md's picture of them, docs/images/fading.jpg.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from PIL import Image

import volspec as vs
from tests.support.browser import differences
from tools.gallery.studio import FILL, KEY, READERS, ROOT, STUDIO, Picture, cast, materials, show

OPEN_SKY = vs.LightGroup("sky", (vs.Ambient(0.5), *FILL.sources))
TWO_GROUPS = replace(STUDIO, groups=(KEY, OPEN_SKY), alpha_stop=1)
EVENING = vs.LightRig((vs.light("A"), vs.light("daylight:15000")), groups=("key", "sky"))
Array = NDArray[np.float64]
State = tuple[dict[str, float], vs.Spectrum | vs.LightRig | str]

SHARED = ("OPEN_SKY", "TWO_GROUPS", "EVENING", "pairs")  # printed
SHARED += ("foot_function", "foot_camera", "plate", "disc")

_STRIP = ROOT / "docs" / "images" / "fading.jpg"
_TILE = (920, 840)  # cast; a tile has half of it


def pairs(
    volume: vs.Volume,
    transfer: vs.TransferFunction,
    camera: vs.Camera,
    states: Mapping[str, State],
    exposure: float = 1.1,
    meshes: Sequence[vs.MeshCaster] = (),
) -> dict[str, Picture]:
    """Recompose one cast, above new casts of the same opacities, and compare the pictures."""
    spec = replace(TWO_GROUPS, step_mm=volume.finest_mm / 2)
    image = cast(volume, transfer, camera, replace(spec, layers=8), meshes=meshes)
    shown = {}
    for name, (opacities, light) in states.items():
        own = replace(spec, opacities=opacities)
        new = cast(volume, transfer, camera, own, meshes=meshes)
        both = image.recompose(opacities), new
        pair = [show(each, light, exposure) for each in both]
        alpha = np.maximum(*(each.alpha for each in both))
        height, width = pair[0].shape[:2]
        covered = alpha.reshape(height, 2, width, 2).max(axis=(1, 3)) > 0.01
        off = differences(*pair)[covered]
        figures = f"CIEDE2000 {off.mean():.2f}, 99 % {np.percentile(off, 99):.1f}"
        shown[f"{name}\n{figures}"] = np.concatenate(pair)
    return shown


def engine_block(engine: vs.Volume) -> dict[str, Picture]:
    """The block fades from copper inserts, and its shadow with it: the plate gets brighter, and the
    shadows of the inserts are left on it. Pairs differ most along the borders of these shadows,
    where layers have a faint grain.
    """
    looks = materials(block="Vrhel/64 light blue towel", inserts="copper")
    points = [
        *((88, 0.0, "block"), (108, 0.045, "block"), (128, 0.045, "block")),
        *((140, 0.03, "block"), (165, 0.03, "block")),
        *((180, 0.12, "inserts"), (200, 0.5, "inserts"), (255, 0.9, "inserts")),
    ]
    transfer = vs.TransferFunction(points, looks, vs.MaterialBasis(looks))
    pose = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}
    camera = vs.Camera.orbit(engine, **pose, zoom=1.73, target_mm=(134, 141, 67))
    states: dict[str, State] = {
        "block × 4, daylight": ({"block": 4}, "D65"),
        "as cast, daylight": ({}, "D65"),
        "block × ¼, daylight": ({"block": 0.25}, "D65"),
        "no block, tungsten and sky": ({"block": 0}, EVENING),
        "block × ¼, inserts × 4, tungsten and sky": ({"block": 0.25, "inserts": 4}, EVENING),
        "no inserts, tungsten and sky": ({"inserts": 0}, EVENING),
    }
    return pairs(engine, transfer, camera, states, exposure=0.95)


def skin_and_flesh(foot: vs.Volume) -> dict[str, Picture]:
    """Skin and flesh fade from the bones. Hidden, they shade nothing: the bones get their full
    light, and show the shadows of one another.
    """
    transfer, camera = foot_function(), foot_camera(foot)
    states: dict[str, State] = {
        "as cast, daylight": ({}, "D65"),
        "skin × ¼, daylight": ({"skin": 0.25}, "D65"),
        "no skin, daylight": ({"skin": 0}, "D65"),
        "no skin, flesh × ¼, tungsten and sky": ({"skin": 0, "flesh": 0.25}, EVENING),
        "bones, tungsten and sky": ({"skin": 0, "flesh": 0}, EVENING),
        "skin × 2, no flesh, tungsten and sky": ({"skin": 2, "flesh": 0}, EVENING),
    }
    return pairs(foot, transfer, camera, states)


def a_plate_on_a_bone(foot: vs.Volume) -> dict[str, Picture]:
    """A gold-coloured plate with four screws, a mesh, is the last of the layers. It stays, its
    shadow on the bone with it, while what is in front of it fades and takes its shadow off it.
    """
    transfer = foot_function(plate="gold")
    camera = foot_camera(foot, zoom=2.5, target_mm=(138, 62, 134))
    bone, along = np.array((135.0, 44.0, 133.0)), np.array((0.12, 0.99, -0.11))
    mesh = vs.Mesh.of(plate(bone, along, np.array(camera.position_mm) - bone), "plate")
    meshes = [vs.MeshCaster([mesh], transfer.materials, transfer.basis)]
    states: dict[str, State] = {
        "as cast, daylight": ({}, "D65"),
        "skin × ¼, daylight": ({"skin": 0.25}, "D65"),
        "no skin, daylight": ({"skin": 0}, "D65"),
        "bones, tungsten and sky": ({"skin": 0, "flesh": 0}, EVENING),
        "bones × ⅒, tungsten and sky": ({"skin": 0, "flesh": 0, "bone": 0.1}, EVENING),
        "the plate, tungsten and sky": ({"skin": 0, "flesh": 0, "bone": 0}, EVENING),
    }
    return pairs(foot, transfer, camera, states, meshes=meshes)


def plate(bone: Array, along: Array, out: Array) -> pv.PolyData:
    """Return a bone plate of 62 mm with four screws; its place, its axis and where it faces."""
    box = pv.Box((-31, 31, -5.5, 5.5, -1.25, 1.25)).triangulate()
    parts = [disc(x, 0.0, 5.5, 2.5) for x in (-31, 31)]
    for x in (-26, -11, 11, 26):
        parts += [disc(x, -9.0, 2.0, 18.0), disc(x, 1.85, 3.8, 1.2)]
    axes = np.eye(4)
    x = along / np.linalg.norm(along)
    z = out - (out @ x) * x
    z /= np.linalg.norm(z)
    axes[:3] = np.stack([x, np.cross(z, x), z, bone + 17.0 * z], axis=1)
    return box.merge(parts).transform(axes, inplace=False)


def disc(x: float, z: float, radius: float, height: float) -> pv.PolyData:
    """Return a cylinder along z."""
    made = pv.Cylinder(
        center=(x, 0.0, z), direction=(0.0, 0.0, 1.0), radius=radius, height=height, resolution=64
    )
    return made.triangulate()


def foot_function(**more: str) -> vs.TransferFunction:
    """Return skin, flesh and bone of the foot, and perhaps materials of meshes."""
    looks = materials(
        skin="Vrhel/81 skin caucasian light",
        flesh="PMC/Pork",
        bone="Vrhel/158 fabric white",
        **more,
    )
    points = [
        *((24, 0.0, "skin"), (34, 0.12, "skin"), (46, 0.12, "skin")),
        *((60, 0.02, "flesh"), (85, 0.03, "flesh")),
        *((105, 0.15, "bone"), (150, 0.6, "bone")),
    ]
    return vs.TransferFunction(points, looks, vs.MaterialBasis(looks))


def foot_camera(
    foot: vs.Volume, zoom: float = 1.4, target_mm: tuple[float, float, float] = (148, 111, 138)
) -> vs.Camera:
    """Return the camera of all pictures of the foot."""
    pose = {"azimuth_deg": 75, "elevation_deg": 35, "up": (-1, 0, 0)}
    return vs.Camera.orbit(foot, **pose, zoom=zoom, target_mm=target_mm)


def main() -> None:
    """Cast the foot once, and save four states side by side."""
    volume = READERS["foot"]()
    spec = replace(TWO_GROUPS, layers=8)
    image = cast(volume, foot_function(), foot_camera(volume), spec, _TILE)
    states: tuple[State, ...] = (
        ({}, "D65"),
        ({"skin": 0.2}, "D65"),
        ({"skin": 0.0}, EVENING),
        ({"skin": 0.0, "flesh": 0.0}, EVENING),
    )
    tiles = [show(image.recompose(opacities), light) for opacities, light in states]
    Image.fromarray(np.hstack(tiles)).save(_STRIP, quality=90)
    print(f"{_STRIP.name}: {_STRIP.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
