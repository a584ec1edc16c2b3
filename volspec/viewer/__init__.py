"""The interactive viewer: a window in which light changes cost a relight, and views a cast.

    input, panels -> state -> cast | relight -> window

    model   frozen states and pure functions on them
    work    threads, files and GL: values in, values out
    ui      drawing and input: draw(state, ui) -> state
    app     the event loop, the only file that knows all floors

A new panel: docs/architecture.md.
"""

import OpenGL

# PyOpenGL asks for errors after every call, which takes longer than the call itself, unless that
# is switched off before its first import, which is that of imgui's backend.
OpenGL.ERROR_CHECKING = False
