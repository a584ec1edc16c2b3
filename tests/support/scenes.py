"""Texts of small scenes, and what is read of scene files."""

from __future__ import annotations

import re
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
