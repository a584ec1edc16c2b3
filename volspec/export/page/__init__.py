"""Relightable web pages: one file, no network, the desktop's shaders on WebGL 2.

scene -> cast -> [page] -> PAGE.html
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
