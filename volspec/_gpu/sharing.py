"""Memory that OpenCL and OpenGL share (cl_khr_gl_sharing), where a device offers it.

An option: pictures otherwise go from one to the other through the host, which works everywhere
(docs/decisions/0010).
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from volspec._gpu.devices import DEVICE_VARIABLE
from volspec._gpu.opengl import describe, egl_handle, made_current
from volspec.errors import OpenCLError, VolspecError, one_line

if TYPE_CHECKING:
    import pyopencl as cl

EXTENSION = "cl_khr_gl_sharing"
BUILD = (
    "PYOPENCL_ENABLE_GL=ON pip install --force-reinstall --no-deps --no-cache-dir "
    "--no-binary pyopencl pyopencl"
)
_HOST = "leave context out, and pictures go through the host"
# Library, who is current and where, and the display's name among pyopencl's context properties.
_WAYS = (
    ("libEGL.so.1", "eglGetCurrentContext", "eglGetCurrentDisplay", "EGL_DISPLAY_KHR"),
    ("libGL.so.1", "glXGetCurrentContext", "glXGetCurrentDisplay", "GLX_DISPLAY_KHR"),
)


@dataclass(frozen=True, slots=True)
class Current:
    """The OpenGL context current on this thread, as EGL or GLX knows it."""

    handle: int
    display: int
    display_property: str


@cache
def _asker(library: str, function: str) -> Any:
    try:
        found = getattr(ctypes.CDLL(library), function)
    except (OSError, AttributeError):
        return int
    found.restype = ctypes.c_void_p
    return found


def current() -> Current | None:
    """What is current on this thread; None where neither EGL nor GLX has a context."""
    for library, context, display, name in _WAYS:
        if handle := _asker(library, context)():
            return Current(handle, _asker(library, display)() or 0, name)
    return None


def refusal(device: cl.Device) -> str | None:
    """Why a device cannot share, with the remedy; None where it says that it can.

    The extension has to be asked for: PoCL 3.0 makes a shared context without a word, and ends
    the process at the first buffer.
    """
    import pyopencl as cl

    if sys.platform in ("darwin", "win32"):
        return f"sharing with OpenGL is for EGL and GLX, which {sys.platform} has not; {_HOST}"
    if not cl.have_gl():
        return (
            "sharing with OpenGL: this pyopencl was built without it; build it with OpenCL's and "
            f"OpenGL's headers there: {BUILD}"
        )
    if EXTENSION not in device.extensions.split():
        return (
            f"sharing with OpenGL: {device.name.strip()} lacks {EXTENSION}; choose another device "
            f"with {DEVICE_VARIABLE}, or {_HOST}"
        )
    return None


@dataclass(frozen=True, slots=True)
class Sharing:
    """The OpenGL context whose buffers an OpenCL context can write.

    Parameters
    ----------
    context : moderngl.Context
        Its owner's.
    handle : int
        What EGL or GLX calls it.
    egl : int
        `egl_handle` of it, for `made_current`.
    name : str
        The renderer's, and the handle: for messages.
    """

    context: Any
    handle: int
    egl: int
    name: str

    @classmethod
    def open(cls, device: cl.Device, context: Any) -> tuple[cl.Context, Sharing]:
        """Make an OpenCL context that shares a moderngl.Context.

        Raises
        ------
        OpenCLError
            If pyopencl, the device or its driver do not share, or the context is none of EGL
            or GLX.
        """
        import pyopencl as cl

        if told := refusal(device):
            raise OpenCLError(told)
        with context:
            here = current()
            if here is None:
                raise OpenCLError(
                    "sharing with OpenGL: the context given is none of EGL or GLX, or has ended; "
                    "give moderngl.create_standalone_context(backend='egl') or a window's"
                )
            name = named(context, here)
            try:
                shared = cl.Context([device], properties=_properties(device, here))
            except cl.Error as error:
                raise OpenCLError(
                    f"sharing with OpenGL: {device.name.strip()} does not share with {name} "
                    f"({one_line(error)}); draw on the device that casts, or {_HOST}"
                ) from error
            return shared, cls(context, here.handle, egl_handle(), name)

    @contextmanager
    def acquired(self, queue: cl.CommandQueue, buffer: Any) -> Iterator[cl.GLBuffer]:
        """A moderngl.Buffer as kernels write it; OpenGL must leave it alone meanwhile.

        Without events that both sides know, each must have finished before the other begins
        (cl_khr_gl_sharing, "Synchronizing OpenCL and OpenGL access").

        Raises
        ------
        OpenCLError
            If the driver does not share the buffer.
        """
        import pyopencl as cl

        with self._told(), made_current(self.context, self.egl):
            self.context.finish()
            memory = cl.GLBuffer(queue.context, cl.mem_flags.WRITE_ONLY, buffer.glo)
            cl.enqueue_acquire_gl_objects(queue, [memory])
        try:
            yield memory
        finally:
            with self._told(), made_current(self.context, self.egl):
                cl.enqueue_release_gl_objects(queue, [memory])
                queue.finish()
                memory.release()

    @contextmanager
    def _told(self) -> Iterator[None]:
        import pyopencl as cl

        try:
            yield
        except cl.Error as error:
            raise OpenCLError(
                f"sharing with OpenGL: the driver does not share a buffer of {self.name} "
                f"({one_line(error)}); {_HOST}"
            ) from error


def named(context: Any, here: Current | None) -> str:
    """An OpenGL context, in a message."""
    return f"{describe(context)['device']} (context {here.handle if here else 0:#x})"


def _properties(device: cl.Device, here: Current) -> list[tuple[Any, Any]]:
    import pyopencl as cl

    names = cl.context_properties
    return [
        (names.PLATFORM, device.platform),
        (names.GL_CONTEXT_KHR, here.handle),
        (getattr(names, here.display_property), here.display),
    ]


def why_not(device: cl.Device, context: Any) -> str | None:
    """Why a device does not share with a context, tried in earnest; None where it does."""
    try:
        Sharing.open(device, context)
    except VolspecError as error:
        return str(error)
    return None
