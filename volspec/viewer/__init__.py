"""The interactive viewer: a window in which light changes cost a relight, and views a cast.

    input, panels -> [state] -> stale -> worker (casts) | pictures (relights) -> window

    model   frozen states and pure functions on them
    work    threads, files and GL: values in, values out
    ui      drawing and input: draw(state, ui) -> state
    app     the event loop, the only file that knows all floors

`volspec.viewer.model.history` says what a change of the state costs. Nothing is imported here.
"""
