"""A scene that casts in moments: a ball under three lights, in a basis that ships."""

import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from volspec.scene import Scene
from volspec.volume import phantom

SCENE = """
title = "Ball"
version = 2
volume = { file = "ball.npy" }
basis = { name = "general-7" }
material = [
    { name = "gold", reflectance = "gold" },
    { name = "grey", reflectance = "grey:0.5" },
]
[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "grey" },
    { value = 0.6, opacity = 0.5, material = { gold = 0.8, grey = 0.2 } },
]
[[light]]
name = "day"
spectrum = "D65"
[[light]]
name = "lamp"
spectrum = "A"
[[light]]
name = "tube"
spectrum = "FL2"
[output]
width = 32
height = 24
"""

# Materials are its channels.
METALS = SCENE.replace('name = "general-7"', 'method = "materials"')

Make = Callable[..., Scene]


def ffmpeg(*words: object, check: bool = True) -> subprocess.CompletedProcess[bytes]:
    """Run ffmpeg with what it says and gives."""
    from imageio_ffmpeg import get_ffmpeg_exe

    return subprocess.run([get_ffmpeg_exe(), *map(str, words)], capture_output=True, check=check)


@pytest.fixture(scope="session")
def ball_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ball")
    np.save(folder / "ball.npy", phantom.ball(16).values.astype(np.float32))
    return folder


@pytest.fixture
def scene(ball_folder: Path) -> Make:
    """The scene, or another text, with more at its end."""

    def make(more: str = "", name: str = "ball.toml", text: str = SCENE) -> Scene:
        path = ball_folder / name
        path.write_text(text + more, encoding="utf-8")
        return Scene.load(path)

    return make
