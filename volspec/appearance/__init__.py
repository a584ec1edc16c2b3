"""What the eye makes of a picture: viewing conditions, CIECAM02, the display's encoding.

    raycast -> relight -> [appearance] -> frame

Scene XYZ seen under the scene's light become the XYZ that look the same on the display.
"""

from volspec.appearance.live import passage_of
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
    "passage_of",
    "surround_at",
]
