"""Plausible reflectances for a colour, or for every colour of a picture, by several methods.

colours, base, search -> [construct] -> scenes, command line
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
