"""Volumes of any size: levels of detail cast part by part, on one machine or a cluster."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
