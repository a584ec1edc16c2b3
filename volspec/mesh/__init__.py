"""Surfaces of triangles: files, materials, textures, gratings, and their coefficient images."""

from typing import Literal

Shape = Literal["plane", "disc", "sphere", "triad"]
"""Shapes that need no file."""
