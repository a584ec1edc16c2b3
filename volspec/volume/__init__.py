"""Scalar volumes: values on a regular lattice, its geometry, and file readers."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
