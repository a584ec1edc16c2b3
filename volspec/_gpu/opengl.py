"""Headless OpenGL: a context without a window, programs whose errors name real files.

On Linux, EGL needs no display server, and Mesa's llvmpipe draws if there is no GPU; GLX on the
display is tried if EGL fails. macOS (CGL, at most 4.1) and Windows (WGL) offer one API each.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any

from volspec._child import require_own_process
from volspec._gpu.sources import Source
from volspec.errors import OpenGLError, one_line

if TYPE_CHECKING:
    import moderngl

MINIMUM_VERSION = 330
# glcontext's settings for each kind of context, with the names of the runtime libraries: the names
# that glcontext looks for by default belong to development packages.
_EGL = {"backend": "egl", "libgl": "libGL.so.1", "libegl": "libEGL.so.1"}
_GLX = {"libgl": "libGL.so.1", "libx11": "libX11.so.6"}
_REMEDIES = {
    "darwin": "log in at the Mac's own screen: macOS includes OpenGL 4.1 with its graphics",
    "win32": "install the graphics card maker's driver; Windows' own has only OpenGL 1.1",
    "linux": "install EGL and a driver, on Debian or Ubuntu: "
    "apt-get install libegl1 libgl1 libgl1-mesa-dri",
}
# Maximum number of contexts that `give_back_context` caches.
_MAX_IDLE = 4


class ContextLost(OpenGLError):
    """Another library on this thread ended the context; its objects are lost."""


def headless_context() -> moderngl.Context:
    """Make an OpenGL 3.3 core context without a window, current on this thread.

    The caller must release it. Raises OpenGLError with the remedy if moderngl, the system's OpenGL
    or a driver is missing, or the process was forked from one that has called this.
    """
    require_own_process("OpenGL", OpenGLError)
    library = _moderngl()
    failures = []
    for settings in _ways():
        try:
            return library.create_standalone_context(require=MINIMUM_VERSION, **settings)
        except Exception as error:  # moderngl and glcontext raise bare Exception and ImportError
            failures.append(error)
    raise OpenGLError(
        f"OpenGL: no headless context of version 3.3 "
        f"({'; '.join(one_line(error) for error in failures)})",
        f"{_REMEDIES.get(sys.platform, _REMEDIES['linux'])}",
        code="unsupported",
    ) from failures[0]


def _ways() -> list[dict[str, Any]]:
    """Return the settings to try for a headless context, best first."""
    if sys.platform in ("darwin", "win32"):
        return [{}]
    return [_EGL, _GLX] if os.environ.get("DISPLAY") else [_EGL]


def _moderngl() -> Any:
    """Import moderngl, which has to be built on Linux machines other than x86-64."""
    try:
        import moderngl
    except ImportError as error:
        build = "apt-get install g++ python3-dev libx11-dev; " if sys.platform == "linux" else ""
        raise OpenGLError(
            f"OpenGL: moderngl cannot be imported ({one_line(error)})",
            f"{build}pip install moderngl",
            code="missing",
        ) from error
    return moderngl


@cache
def _idle_contexts() -> list[tuple[moderngl.Context, int]]:
    """Return the cache of contexts to lend, 2.4 MB each.

    moderngl 5.13 leaks 40 kB per context. One is enough for pictures made one after another, four
    for a page of pictures.
    """
    return []


@dataclass(frozen=True, slots=True, eq=False)
class Allocation:
    """Resources of a context, and the context itself unless a caller ``lent`` it."""

    context: moderngl.Context
    handle: int  # its `egl_handle`
    lent: bool
    resources: list[Any] = field(default_factory=list)

    def release(self) -> None:
        """Release the resources, the last first, and give our own context back."""
        try:
            with made_current(self.context, self.handle):
                while self.resources:
                    self.resources.pop().release()
        except ContextLost:  # and all in it: the names may now be another library's objects
            self.resources.clear()
        else:
            if not self.lent:
                give_back_context(self.context, self.handle)


@cache
def abandoned_queue() -> deque[Allocation]:
    """Return what garbage collection leaves to `release_abandoned`.

    It runs on any thread, in the middle of calls to other contexts.
    """
    return deque()


def release_abandoned(context: moderngl.Context | None = None) -> None:
    """Release what is `abandoned_queue` in our own contexts, and in one lent on this thread."""
    for _ in range(len(waiting := abandoned_queue())):
        with suppress(IndexError):  # taken by another thread
            allocation = waiting.popleft()
            if allocation.lent and allocation.context is not context:
                waiting.append(allocation)
            else:
                allocation.release()


def lend_context() -> tuple[moderngl.Context, int]:
    """Return a headless context for exclusive use, and its `egl_handle`."""
    idle = _idle_contexts()
    while idle:
        with suppress(IndexError, ContextLost):  # taken by another thread, or lost
            context, handle = idle.pop()
            with made_current(context, handle):
                return context, handle
    context = headless_context()
    with context:
        return context, egl_handle()


def give_back_context(context: moderngl.Context, handle: int) -> None:
    """Take a context from `lend_context` back, after everything made in it has been released."""
    if len(idle := _idle_contexts()) < _MAX_IDLE:
        idle.append((context, handle))
    else:
        context.release()


def window_context() -> moderngl.Context:
    """Wrap the context, 3.3 or newer, that a window has made current on this thread."""
    library = _moderngl()
    try:
        return library.create_context(require=MINIMUM_VERSION)
    except Exception as error:  # as above
        raise OpenGLError(
            f"OpenGL: {one_line(error)}; 3.3 is needed", code="unsupported"
        ) from error


@cache
def pointer_function(library: str, name: str) -> Any:
    """Return a library's pointer-valued function; if either is missing, one that returns 0."""
    try:
        function = getattr(ctypes.CDLL(library), name)
    except (OSError, AttributeError):
        return int
    function.restype = ctypes.c_void_p
    return function


def egl_handle() -> int:
    """Return the EGL context current on this thread; 0 if there is none, or no EGL."""
    return int(pointer_function("libEGL.so.1", "eglGetCurrentContext")() or 0)


@contextmanager
def made_current(context: moderngl.Context, handle: int) -> Iterator[None]:
    """Make a context current, or raise ContextLost; ``handle`` is its `egl_handle`.

    VTK terminates the process's shared EGL display when it opens its first window. Making an older
    context current then fails without an error, and every call would go to VTK's own context.
    """
    require_own_process("OpenGL", ContextLost)
    if handle and egl_handle() == handle:  # already current: leaving it would flush
        yield
        return
    with context:
        if egl_handle() != handle:
            raise ContextLost(
                "OpenGL: another library on this thread ended the context", code="state"
            )
        yield


def compile_program(
    context: moderngl.Context, vertex: Source, fragment: Source
) -> moderngl.Program:
    """Compile and link two shaders in the current context.

    Raises OpenGLError with the compiler's log, which names the real files.
    """
    import moderngl

    try:
        return context.program(vertex_shader=vertex.text, fragment_shader=fragment.text)
    except moderngl.Error as error:
        log = str(error)
        source = vertex if "vertex_shader" in log else fragment
        raise OpenGLError(
            f"OpenGL: {source.files[1]} does not compile on "
            f"{describe(context)['device']}: {source.name_files(log).strip()}",
            code="unsupported",
        ) from error


def describe(context: moderngl.Context) -> dict[str, Any]:
    """Return device, vendor, version, max_layers and max_size of a context."""
    info = context.info
    return {
        "device": info["GL_RENDERER"],
        "vendor": info["GL_VENDOR"],
        "version": info["GL_VERSION"],
        "max_layers": int(info["GL_MAX_ARRAY_TEXTURE_LAYERS"]),
        "max_size": int(info["GL_MAX_TEXTURE_SIZE"]),
    }
