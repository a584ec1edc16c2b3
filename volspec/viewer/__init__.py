"""The interactive viewer: a window in which light changes cost a relight, and views a cast.

    input, panels -> state -> cast | relight -> window

    model   frozen states and pure functions on them
    work    threads, files and GL: values in, values out
    ui      drawing and input: draw(state, ui) -> state
    app     the event loop, the only file that uses all layers

To add a panel, see docs/architecture.md.
"""

import lazy_loader

from volspec._extras import require_extra

require_extra("viewer", "the viewer")
import OpenGL  # noqa: E402  # the extra is checked before

# PyOpenGL checks for errors after every call, which takes longer than the call itself, unless that
# is switched off before PyOpenGL is first imported, by imgui's backend.
OpenGL.ERROR_CHECKING = False

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
