"""Outputs: frames, films, contact sheets, recipes for compositors, web pages, and notebooks."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
