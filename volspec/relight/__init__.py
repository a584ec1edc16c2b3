"""Post-illumination: a frame of a coefficient image and a light.

raycast -> [relight] -> appearance -> frame
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
