"""What the eye makes of a picture: viewing conditions, CIECAM02, the display's encoding.

    raycast -> relight -> [appearance] -> frame

Scene XYZ seen under the scene's light become the XYZ that look the same on the display.
"""

from volspec.appearance.conditions import Conditions, Transport
from volspec.appearance.spec import SURROUNDS, Display, Surround, Viewing

__all__ = ["SURROUNDS", "Conditions", "Display", "Surround", "Transport", "Viewing"]
