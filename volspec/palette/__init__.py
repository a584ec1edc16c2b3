"""Palettes: lights and reflectances designed for the colours of their products."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
