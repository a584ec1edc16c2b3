"""Parts of a kernel launch: arguments, programs, bricks, light volumes, rows."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
