"""Colour appearance: viewing conditions, appearance models, the display's encoding.

    raycast -> relight -> [appearance] -> frame

Scene XYZ under the scene's light become the XYZ of equal appearance on the display.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
