"""The interactive viewer: a window in which light changes cost a relight, and views a cast.

    input, panels -> state -> cast | relight -> window

    model   frozen states and pure functions on them
    work    threads, files and GL: values in, values out
    ui      drawing and input: draw(state, ui) -> state
    app     the event loop, the only file that knows all floors

Nothing is imported here. A new panel: docs/architecture.md.
"""
