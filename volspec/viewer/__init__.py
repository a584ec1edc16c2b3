"""The interactive viewer: a window in which light changes cost a relight, and views a cast.

    input, panels -> [state] -> stale -> worker (casts) | pictures (relights) -> window

States are frozen; `volspec.viewer.model.stale` says what a change costs. Nothing is imported here:
a window, and what draws it, is loaded by `volspec.viewer.app`.
"""
