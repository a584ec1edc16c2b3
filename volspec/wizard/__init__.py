"""Wizards: hide, reveal, merge or keep a scene's materials, or show it in another light."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
