"""OpenGL's functions without a query of errors after every call, which takes longer than they do.

The switch works only before the first import of OpenGL, and so before imgui's backend.
"""

import OpenGL

OpenGL.ERROR_CHECKING = False

from OpenGL import GL  # noqa: E402

__all__ = ["GL"]
