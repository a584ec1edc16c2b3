"""Appearance models by name; each has ``NAME``, ``forward``, ``inverse`` and ``invert_beyond``.

ViewingConditions, XYZ -> [models] -> Appearance -> [models] -> XYZ
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
