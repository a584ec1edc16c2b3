"""Readers of volume files, a module for each format: Query -> Reading."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
