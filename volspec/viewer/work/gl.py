"""OpenGL's functions, which do not ask the driver after every call whether it went well.

To ask takes longer than the calls. The switch works before OpenGL's first import alone, and so this
module comes before imgui's backend, which imports OpenGL, too.
"""

import OpenGL

OpenGL.ERROR_CHECKING = False

from OpenGL import GL  # noqa: E402

__all__ = ["GL"]
