"""The window: glfw, its OpenGL context, and imgui drawn into it.

glfw -> [window] -> inputs -> app
"""

from __future__ import annotations

import sys

import glfw
from imgui_bundle import imgui, implot
from imgui_bundle.python_backends.glfw_backend import GlfwRenderer
from OpenGL import GL

from volspec._gpu import window_context
from volspec.errors import OpenGLError
from volspec.viewer.ui import widgets
from volspec.viewer.ui.inputs import Input, Inputs
from volspec.viewer.work.pictures import Painted

INSTEAD = (
    "without a window: volspec export SCENE-or-VOLUME -o FOLDER for pictures, or volspec page "
    "SCENE-or-VOLUME -o PAGE.html to swap lights in a browser"
)
# Pixels; nothing is drawn into a smaller window.
_MIN_SIDE = 16

_HINTS = (
    (glfw.CONTEXT_VERSION_MAJOR, 3),
    (glfw.CONTEXT_VERSION_MINOR, 3),
    (glfw.OPENGL_PROFILE, glfw.OPENGL_CORE_PROFILE),
    (glfw.OPENGL_FORWARD_COMPAT, 1),
    (glfw.SCALE_TO_MONITOR, 1),
    # Unused buffers would take time to clear.
    (glfw.DEPTH_BITS, 0),
    (glfw.STENCIL_BITS, 0),
    (glfw.ALPHA_BITS, 0),
)


class Window:
    """A window that is open until `close`; its size (width, height) is at 96 dpi.

    Raises
    ------
    OpenGLError
        If there is no display, or its OpenGL is below 3.3.
    """

    def __init__(self, title: str, size: tuple[int, int]) -> None:
        errors: list[str] = []
        glfw.ERROR_REPORTING = "ignore"
        glfw.set_error_callback(lambda _, text: errors.append(_decode(text)))
        if not glfw.init():
            why = " ".join(errors) or "glfw does not start"
            problem = f"view: no window can be opened ({why})"
            raise OpenGLError(problem, INSTEAD, code="unsupported")
        for hint, value in _HINTS:
            glfw.window_hint(hint, value)
        size, self.note = _fit_screen(size)  # a message, empty if there is room
        self._window = glfw.create_window(*size, title, None, None)
        if not self._window:
            glfw.terminate()
            why = " ".join(errors) or "no reason given"
            problem = f"view: no window with OpenGL 3.3 can be opened ({why})"
            raise OpenGLError(problem, INSTEAD, code="unsupported")
        glfw.make_context_current(self._window)
        glfw.swap_interval(1)
        try:
            self.context = window_context()
        except OpenGLError as error:
            glfw.terminate()
            raise OpenGLError(f"view: {error}", INSTEAD, code=error.code) from error
        self._start_imgui()
        self._inputs = Inputs(self._window, self._renderer.keyboard_callback)
        glfw.focus_window(self._window)

    def _start_imgui(self) -> None:
        imgui.create_context()
        implot.create_context()
        io = imgui.get_io()
        io.set_ini_filename("")
        io.config_flags |= imgui.ConfigFlags_.docking_enable
        io.config_windows_move_from_title_bar_only = True
        io.mouse_double_click_time = 0.45  # about as long as elsewhere
        widgets.load_font(imgui)
        widgets.set_sizes(imgui, implot)
        self.scale = 1.0  # window coordinates per pixel at 96 dpi; 1 if they are not pixels
        self._rescale()
        self._renderer = GlfwRenderer(self._window, attach_callbacks=False)

    def _rescale(self) -> None:
        """Follow the window's size, and the scale of the monitor that it is on."""
        self._measure()
        scale = max(1.0, glfw.get_window_content_scale(self._window)[0] / self.pixel_ratio)
        if scale != self.scale:
            widgets.set_scale(imgui, implot, scale, self.scale)
            self.scale = scale

    def _measure(self) -> None:
        """Read the window's size, for which the X server is asked."""
        width, height = glfw.get_window_size(self._window)
        self.size = int(width), int(height)  # in window coordinates
        pixel_width, _ = glfw.get_framebuffer_size(self._window)
        # Framebuffer pixels per window coordinate.
        self.pixel_ratio = float(pixel_width / width) if pixel_width and width else 1.0

    @property
    def usable(self) -> bool:
        """True if there is room to draw: the window is neither minimised nor too small."""
        visible = not glfw.get_window_attrib(self._window, glfw.ICONIFIED)
        return visible and min(glfw.get_framebuffer_size(self._window)) >= _MIN_SIDE

    @property
    def closing(self) -> bool:
        """True if the window is to close."""
        return bool(glfw.window_should_close(self._window))

    def wait(self, seconds: float) -> list[Input]:
        """Wait for input, but no longer than this; return it, one gesture at a time."""
        if seconds > 0 and not self._inputs.waiting:
            glfw.wait_events_timeout(seconds)
        else:
            glfw.poll_events()
        return self._inputs.take()

    @staticmethod
    def wake() -> None:
        """End a `wait`, from any thread."""
        glfw.post_empty_event()

    def begin(self) -> None:
        """Start a frame."""
        self._rescale()
        self._renderer.process_inputs()
        imgui.new_frame()

    @property
    def error(self) -> str:
        """OpenGL's error since the last call; empty if there is none."""
        error = self.context.error
        return "" if error == "GL_NO_ERROR" else str(error)

    @property
    def lags(self) -> bool:
        """True while imgui has inputs that it leaves to further frames."""
        return len(imgui.get_current_context().input_events_queue) > 0

    def end(self, background: tuple[float, float, float], picture: Painted | None = None) -> None:
        """Draw the frame over a picture and show it."""
        imgui.render()
        self.context.screen.use()
        if picture is None or not picture.fills:
            self.context.screen.clear(*background)
        if picture is not None:
            self._copy(picture)
        self._renderer.render(imgui.get_draw_data())
        glfw.swap_buffers(self._window)

    def _copy(self, picture: Painted) -> None:
        """Copy a picture: imgui would blend it, which takes twice as long on a CPU."""
        ratio, window_height = self.pixel_ratio, self.size[1]
        left, top, right, bottom = (round(edge * ratio) for edge in picture.to)
        x, y, width, height = (round(edge * ratio) for edge in picture.within)
        low = round(window_height * ratio)
        exact = (right - left, bottom - top) == picture.size
        GL.glEnable(GL.GL_SCISSOR_TEST)
        GL.glScissor(x, low - y - height, width, height)
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, picture.framebuffer)
        # The picture's first row is its top, the window's is its bottom.
        GL.glBlitFramebuffer(
            0,
            0,
            *picture.size,
            left,
            low - top,
            right,
            low - bottom,
            GL.GL_COLOR_BUFFER_BIT,
            GL.GL_NEAREST if exact else GL.GL_LINEAR,
        )
        GL.glDisable(GL.GL_SCISSOR_TEST)
        self.context.screen.use()

    def name(self, title: str) -> None:
        """Set the title."""
        glfw.set_window_title(self._window, title)

    def leave(self) -> None:
        """Close the window after this frame."""
        glfw.set_window_should_close(self._window, True)

    def close(self) -> None:
        """Release everything."""
        self._renderer.shutdown()
        implot.destroy_context()
        imgui.destroy_context()
        self.context.release()
        glfw.terminate()


def _fit_screen(size: tuple[int, int]) -> tuple[tuple[int, int], str]:
    """Return a size that fits the screen, and a message if it differs from the one wanted."""
    monitor = glfw.get_primary_monitor()
    if not monitor:
        return size, ""
    room = glfw.get_monitor_workarea(monitor)[2:]
    # glfw multiplies the size by the monitor's scale, except on macOS.
    scale = (
        1.0 if sys.platform == "darwin" else max(1.0, glfw.get_monitor_content_scale(monitor)[0])
    )
    width, height = (
        min(side, int(max_side / scale)) if max_side > 0 else side
        for side, max_side in zip(size, room, strict=True)
    )
    if (width, height) == size:
        return size, ""
    target = f"{size[0]} × {size[1]}"
    return (width, height), f"The screen has no room for {target}; the size is {width} × {height}"


def _decode(text: bytes | str) -> str:
    return text.decode(errors="replace") if isinstance(text, bytes) else text
