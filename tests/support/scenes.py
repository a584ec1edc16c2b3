"""Texts of small scenes, and what is read of scene files."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from volspec.scene import SceneFile
from volspec.scene.file import scene_data, scene_file
from volspec.volume import phantom

BALL = """
version = 2
[volume]
file = "ball.npy"
[[material]]
name = "ball"
reflectance = "copper"
[transfer]
points = [
    { value = 0.1, opacity = 0.0, material = "ball" },
    { value = 0.6, opacity = 0.4, material = "ball" },
]
"""
DAY = """[[light]]
name = "day"
spectrum = "D65"
"""
SMALL = """[output]
width = 24
height = 16
"""


def scene_text(
    materials: Mapping[str, str],
    points: Sequence[tuple[float, float, str]] = (),
    *,
    file: str = "ball.npy",
    lights: Mapping[str, str] = {"day": "D65"},
    more: str = "",
) -> str:
    """Return the text of a scene.

    Parameters
    ----------
    materials, lights : mapping of str to str
        Reflectances and spectra by name.
    points : sequence of tuple
        Value, opacity and material, a name or the text of a mix, of the transfer function.
    file : str
        The volume's; none if empty.
    more : str
        Tables above the lights.
    """
    rows = ""
    for value, opacity, material in points:
        mix = material if material.startswith("{") else f'"{material}"'
        rows += f"    {{ value = {value}, opacity = {opacity}, material = {mix} }},\n"
    return "".join(
        (
            "version = 2\n",
            f'[volume]\nfile = "{file}"\n' if file else "",
            *(f'[[material]]\nname = "{n}"\nreflectance = "{r}"\n' for n, r in materials.items()),
            f"[transfer]\npoints = [\n{rows}]\n" if rows else "",
            more,
            *(f'[[light]]\nname = "{n}"\nspectrum = "{s}"\n' for n, s in lights.items()),
        )
    )


def write_scene_text(folder: Path, text: str, size: int = 12) -> Path:
    """Write ``scene.toml`` and the ball of ``size`` voxels a side that it names."""
    np.save(folder / "ball.npy", phantom.ball(size).values)
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    return folder / "scene.toml"


def lines(path: Path) -> list[str]:
    """Return a file's lines."""
    return path.read_text(encoding="utf-8").splitlines()


def comments(text: str) -> list[str]:
    """Return the comments of a TOML text."""
    return re.findall(r"(?:^|\s)(# .*)$", text, re.MULTILINE)


def read(path: Path) -> SceneFile:
    """Return a scene file's tables, checked."""
    return scene_file(scene_data(path), path)
