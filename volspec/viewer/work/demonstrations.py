"""Demonstrations: bundled scenes that the viewer offers at its first start, with thumbnails.

data/scenes, data/demonstrations -> [demonstrations] -> start screen
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from volspec._gpu import asset


@dataclass(frozen=True, slots=True)
class Demonstration:
    """A bundled scene, and words about it."""

    name: str
    scene: str  # its file's stem in data/scenes
    title: str
    hint: str  # what to try first, shown when the scene is open
    lights: dict[str, str]  # the thumbnail's frames, from left to right: light and caption

    @property
    def path(self) -> Path:
        """The scene's file."""
        return asset(f"data/scenes/{self.scene}.toml").absolute()

    @property
    def thumbnail(self) -> str:
        """The thumbnail: the frames of all `lights` in one row."""
        return f"data/demonstrations/{self.name}.jpg"


DEMONSTRATIONS = (
    Demonstration(
        "head",
        "figure-2",
        "A head that parts into colours",
        "Lights › Dial: drag the handle from D65 to “split 1”, then to “split 2”: one grey parts "
        "into three colours, then five",
        {"D65": "daylight", "split 1": "a designed light", "split 2": "another"},
    ),
    Demonstration(
        "engine",
        "engine",
        "An engine whose inserts appear",
        "Lights › Dial: drag the handle from D65 to A: the inserts, grey in daylight, turn pink",
        {"D65": "daylight", "A": "tungsten lamp", "HP1": "sodium street lamp"},
    ),
    Demonstration(
        "frog",
        "frog",
        "A frog under a lamp and a sky",
        "Lights › Dial: drag the handle from noon to evening: lamp and sky have colours of their "
        "own, without another cast",
        {"noon": "noon", "evening": "evening", "street": "street"},
    ),
)


def demonstration_at(path: str | None) -> Demonstration | None:
    """Return the demonstration whose scene has a path; None if there is none."""
    return next((demo for demo in DEMONSTRATIONS if str(demo.path) == path), None)


class Thumbnails:
    """The demonstrations' thumbnails as textures of the window's context."""

    def __init__(self, context: Any) -> None:
        self._context = context
        self._textures: dict[str, Any] = {}

    def texture(self, demonstration: Demonstration) -> int:
        """Return GL's name of a thumbnail's texture, which is uploaded when it is first shown."""
        name = demonstration.thumbnail
        if name not in self._textures:
            from PIL import Image

            with Image.open(asset(name)) as image:
                size, pixels = image.size, image.convert("RGBA").tobytes()
            self._textures[name] = self._context.texture(size, 4, pixels)
        return int(self._textures[name].glo)

    def close(self) -> None:
        """Release the textures."""
        for texture in self._textures.values():
            texture.release()
        self._textures.clear()
