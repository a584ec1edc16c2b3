"""Spectral bases: map N bands to m channels that multiply componentwise, light by surface."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
