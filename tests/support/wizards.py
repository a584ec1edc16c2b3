"""Scenes and frames for tests of the wizards."""

from dataclasses import replace

import numpy as np

import volspec as vs
from volspec.appearance.display.monitors import colour_space
from volspec.appearance.models.lab import cielab

SCENE = """# Stays on top.
version = 2
[volume]
file = "ball.npy"

[[material]]
name = "shell"
reflectance = "ColorChecker/blue sky"

[[material]]
name = "core"  # what it is about
reflectance = "ColorChecker/orange"

[[material]]
name = "stone"
reflectance = "ColorChecker/foliage"

[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "shell" },
    { value = 0.4, opacity = 0.2, material = "shell" },
    { value = 0.6, opacity = 0.8, material = "core" },
    { value = 1.0, opacity = 0.9, material = "stone" },
]

[[light]]
name = "day"
spectrum = "D65"

[[light]]
name = "lamp"
spectrum = "A"

[[light]]
name = "tube"
spectrum = "FL11"

[viewing]
exposure = 1.5
backdrop = 0.0

[output]
width = 48
height = 48
"""


def frame_Lab(scene: vs.Scene, light: str, size: tuple[int, int] | None = None) -> np.ndarray:
    """Return (H, W, 3) CIELAB of a scene's frame, cast with its own basis."""
    found = next(each for each in scene.lights if each.name == light)
    shown = vs.relight(scene.render(size=size), found.rig, scene.relight, np.float32)
    space = colour_space("sRGB")
    linear = space.decode(shown.astype(np.float64))
    return cielab(np.linalg.solve(space.RGB_from_XYZ, linear[..., None])[..., 0], space.white_XYZ)


def painted(scene: vs.Scene, material: str, like: str) -> vs.Scene:
    """Return the scene with a material of another's reflectance, to measure hiding by."""
    spectra = {f"{name}!": spectrum for name, spectrum in scene.materials.items()}
    rows = [
        replace(row, reflectance=f"{like if row.name == material else row.name}!")
        for row in scene.file.material
    ]
    spectra |= {f"{light.name}!": light.spectrum for light in scene.lights}
    lights = [replace(row, spectrum=f"{row.name}!") for row in scene.file.light]
    file = replace(scene.file, material=rows, light=lights)
    return vs.Scene(file, scene.path, spectra)
