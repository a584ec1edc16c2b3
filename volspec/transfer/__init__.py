"""Transfer functions: opacity and reflectance by scalar value, baked into a table of channels."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
