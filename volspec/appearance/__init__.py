"""Colour appearance: viewing conditions, appearance models, the display's encoding.

    raycast -> relight -> [appearance] -> frame

Scene XYZ under the scene's light become the XYZ of equal appearance on the display.
"""

from volspec.appearance.scene_to_display import view_transform
from volspec.appearance.spec import (
    SURROUNDS,
    Display,
    Surround,
    Viewing,
    ViewingConditions,
    surround_at,
)

__all__ = [
    "SURROUNDS",
    "Display",
    "Surround",
    "Viewing",
    "ViewingConditions",
    "surround_at",
    "view_transform",
]
