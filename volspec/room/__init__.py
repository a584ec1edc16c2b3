"""Rooms with painted walls: the light that they exchange, and paints that look as wanted."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
