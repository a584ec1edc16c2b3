"""Headless OpenGL: a context without a window, programs whose errors name real files.

EGL needs no display server; Mesa's llvmpipe draws where there is no GPU.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from typing import TYPE_CHECKING, Any

from volspec._gpu.sources import Source
from volspec.errors import OpenGLError, one_line

if TYPE_CHECKING:
    import moderngl

MINIMUM_VERSION = 330
# moderngl 5.13 keeps 40 kB of every context for the rest of the process, so that those given back
# are lent again: one serves pictures made one after the other, four a page of them. Each is 2.4 MB.
_MOST_IDLE = 4
_IDLE: list[tuple[moderngl.Context, int]] = []


class ContextLost(OpenGLError):
    """Another library on this thread ended the context; what was in it is gone."""


def headless_context() -> moderngl.Context:
    """Make an OpenGL 3.3 core context on EGL.

    Returns
    -------
    moderngl.Context
        Current on the calling thread. Release it with ``.release()``.

    Raises
    ------
    OpenGLError
        If moderngl, EGL or a driver is missing; the message holds the remedy.
    """
    try:
        import moderngl

        # The names of the runtime libraries; the defaults belong to development packages.
        settings: dict[str, Any] = {"backend": "egl"}
        if sys.platform == "linux":
            settings |= {"libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
        return moderngl.create_standalone_context(require=MINIMUM_VERSION, **settings)
    except Exception as error:  # moderngl and glcontext raise bare Exception and ImportError
        raise OpenGLError(
            f"OpenGL: no headless context of version 3.3 ({one_line(error)}); install EGL and a "
            "driver, on Debian or Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri"
        ) from error


def lend_context() -> tuple[moderngl.Context, int]:
    """Return a headless context that nobody else draws in, and its `egl_handle`.

    Raises
    ------
    OpenGLError
        As `headless_context`.
    """
    while _IDLE:
        with suppress(IndexError, ContextLost):  # another thread's now, or gone
            context, handle = _IDLE.pop()
            with made_current(context, handle):
                return context, handle
    context = headless_context()
    with context:
        return context, egl_handle()


def give_back_context(context: moderngl.Context, handle: int) -> None:
    """Take a context from `lend_context` back, after everything made in it has been released."""
    if len(_IDLE) < _MOST_IDLE:
        _IDLE.append((context, handle))
    else:
        context.release()


def window_context() -> moderngl.Context:
    """Take over the context that a window has made current on this thread.

    Raises
    ------
    OpenGLError
        If it is older than 3.3.
    """
    import moderngl

    try:
        return moderngl.create_context(require=MINIMUM_VERSION)
    except Exception as error:  # as above
        raise OpenGLError(f"OpenGL: {one_line(error)}; 3.3 is needed") from error


@cache
def _egl() -> ctypes.CDLL | None:
    try:
        library = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return None
    library.eglGetCurrentContext.restype = ctypes.c_void_p
    return library


def egl_handle() -> int:
    """The EGL context current on this thread; 0 where there is none, or no EGL."""
    egl = _egl()
    return int(egl.eglGetCurrentContext() or 0) if egl else 0


@contextmanager
def made_current(context: moderngl.Context, handle: int) -> Iterator[None]:
    """Draw in a context, and be sure that it is this one.

    VTK ends the EGL display that it shares with everyone when it opens its first window; making
    a context of before current then fails without an error, and every call would land in VTK's
    own context.

    Parameters
    ----------
    handle : int
        `egl_handle` when the context was made.

    Raises
    ------
    ContextLost
        If the context is gone.
    """
    if handle and egl_handle() == handle:  # an owner's, or entered before: leaving would flush it
        yield
        return
    with context:
        if egl_handle() != handle:
            raise ContextLost("OpenGL: another library on this thread ended the context")
        yield


def compile_program(
    context: moderngl.Context, vertex: Source, fragment: Source
) -> moderngl.Program:
    """Compile and link two shaders.

    Parameters
    ----------
    context : moderngl.Context
        Current on the calling thread.
    vertex, fragment : Source
        From `volspec._gpu.sources.assemble` with a GLSL version.

    Raises
    ------
    OpenGLError
        If the driver refuses; the compiler's log with the real files' names.
    """
    import moderngl

    try:
        return context.program(vertex_shader=vertex.text, fragment_shader=fragment.text)
    except moderngl.Error as error:
        log = str(error)
        source = vertex if "vertex_shader" in log else fragment
        raise OpenGLError(
            f"OpenGL: {source.files[1]} does not compile on "
            f"{describe(context)['device']}: {source.name_files(log).strip()}"
        ) from error


def describe(context: moderngl.Context) -> dict[str, Any]:
    """What draws: ``device``, ``vendor``, ``version``, ``max_layers``, ``max_size``."""
    info = context.info
    return {
        "device": info["GL_RENDERER"],
        "vendor": info["GL_VENDOR"],
        "version": info["GL_VERSION"],
        "max_layers": int(info["GL_MAX_ARRAY_TEXTURE_LAYERS"]),
        "max_size": int(info["GL_MAX_TEXTURE_SIZE"]),
    }
