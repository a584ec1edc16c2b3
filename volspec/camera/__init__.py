"""Cameras: rays of pixels, orbits around a volume, and where points are seen."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
