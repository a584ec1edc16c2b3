"""Memory shared by OpenCL and OpenGL (cl_khr_gl_sharing), if the device supports it.

Optional: without it pictures pass from one to the other through the host, which works everywhere
(docs/decisions/0010).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from volspec._gpu.device_list import DEVICE_VARIABLE
from volspec._gpu.opengl import describe, egl_handle, made_current, pointer_function
from volspec.errors import OpenCLError, VolspecError, one_line

if TYPE_CHECKING:
    import pyopencl as cl

EXTENSION = "cl_khr_gl_sharing"
BUILD = (
    "PYOPENCL_ENABLE_GL=ON pip install --force-reinstall --no-deps --no-cache-dir "
    "--no-binary pyopencl pyopencl"
)
_HOST = "leave context out, so that pictures go through the host"
# Library, functions for the current context and display, the display's context property.
_APIS = (
    ("libEGL.so.1", "eglGetCurrentContext", "eglGetCurrentDisplay", "EGL_DISPLAY_KHR"),
    ("libGL.so.1", "glXGetCurrentContext", "glXGetCurrentDisplay", "GLX_DISPLAY_KHR"),
)


@dataclass(frozen=True, slots=True)
class Current:
    """The OpenGL context current on this thread, as EGL or GLX identifies it."""

    handle: int
    display: int
    display_property: str


def current() -> Current | None:
    """Return the OpenGL context current on this thread; None if neither EGL nor GLX has one."""
    for library, context, display, name in _APIS:
        if handle := pointer_function(library, context)():
            return Current(handle, pointer_function(library, display)() or 0, name)
    return None


def refusal(device: cl.Device) -> str | None:
    """Return the reason why a device cannot share, and the remedy; None if it has the extension.

    Only the extension's name is reliable: PoCL 3.0 makes a shared context without an error, but
    crashes the process at the first buffer.
    """
    import pyopencl as cl

    if sys.platform in ("darwin", "win32"):
        return f"sharing with OpenGL needs EGL or GLX, which {sys.platform} lacks; {_HOST}"
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
    """The OpenGL context whose buffers an OpenCL context can write."""

    context: Any  # moderngl.Context, owned by the caller
    handle: int  # in EGL or GLX
    egl: int  # its `egl_handle`, for `made_current`
    name: str  # renderer and handle, for messages

    @classmethod
    def open(cls, device: cl.Device, context: Any) -> tuple[cl.Context, Sharing]:
        """Make an OpenCL context that shares a moderngl.Context, or raise OpenCLError."""
        import pyopencl as cl

        if reason := refusal(device):
            raise OpenCLError(reason, code="unsupported")
        with context:
            here = current()
            if here is None:
                raise OpenCLError(
                    "sharing with OpenGL: the context is not an EGL or GLX one, or has ended",
                    "give moderngl.create_standalone_context(backend='egl') or a window's",
                    code="unsupported",
                )
            name = context_name(context, here)
            try:
                shared = cl.Context([device], properties=_properties(device, here))
            except cl.Error as error:
                raise OpenCLError(
                    f"sharing with OpenGL: {device.name.strip()} does not share with {name} "
                    f"({one_line(error)})",
                    f"draw on the device that casts, or {_HOST}",
                    code="unsupported",
                ) from error
            return shared, cls(context, here.handle, egl_handle(), name)

    @contextmanager
    def acquired(self, queue: cl.CommandQueue, buffer: Any) -> Iterator[cl.GLBuffer]:
        """Lend kernels a moderngl.Buffer, which OpenGL must not use meanwhile.

        Without events shared by both APIs, each must finish before the other begins
        (cl_khr_gl_sharing, "Synchronizing OpenCL and OpenGL access").
        """
        import pyopencl as cl

        with self._raising_opencl_error(), made_current(self.context, self.egl):
            self.context.finish()
            memory = cl.GLBuffer(queue.context, cl.mem_flags.WRITE_ONLY, buffer.glo)
            cl.enqueue_acquire_gl_objects(queue, [memory])
        try:
            yield memory
        finally:
            with self._raising_opencl_error(), made_current(self.context, self.egl):
                cl.enqueue_release_gl_objects(queue, [memory])
                queue.finish()
                memory.release()

    @contextmanager
    def _raising_opencl_error(self) -> Iterator[None]:
        import pyopencl as cl

        try:
            yield
        except cl.Error as error:
            raise OpenCLError(
                f"sharing with OpenGL: the driver does not share a buffer of {self.name} "
                f"({one_line(error)})",
                f"{_HOST}",
                code="unsupported",
            ) from error


def context_name(context: Any, here: Current | None) -> str:
    """Return the name of an OpenGL context for messages."""
    return f"{describe(context)['device']} (context {here.handle if here else 0:#x})"


def _properties(device: cl.Device, here: Current) -> list[tuple[Any, Any]]:
    import pyopencl as cl

    names = cl.context_properties
    return [
        (names.PLATFORM, device.platform),
        (names.GL_CONTEXT_KHR, here.handle),
        (getattr(names, here.display_property), here.display),
    ]


def sharing_fault(device: cl.Device, context: Any) -> str | None:
    """Try to share a context with a device; return the reason why it fails, or None."""
    try:
        Sharing.open(device, context)
    except VolspecError as error:
        return str(error)
    return None
