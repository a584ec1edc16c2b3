"""The event loop: input and panels make states, states make casts and relights.

    Window -> events, panels -> state -> stale -> Casting | Pictures -> Window

GL stays on this thread; casts and files have their own.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path

from imgui_bundle import imgui, implot

from volspec.errors import InputError, VolspecError
from volspec.raycast import CoefficientImage
from volspec.viewer import style
from volspec.viewer.casting import Casting
from volspec.viewer.document import Document, opened
from volspec.viewer.history import History
from volspec.viewer.inputs import Input
from volspec.viewer.layout import Layout
from volspec.viewer.lighting import rig_of
from volspec.viewer.meter import Meter
from volspec.viewer.mouse import Mouse
from volspec.viewer.opening import Tasks
from volspec.viewer.panels import overlay
from volspec.viewer.panels.desk import Desk
from volspec.viewer.panels.probe import probed
from volspec.viewer.pictures import Pictures
from volspec.viewer.screenshot import cast_for_file, save
from volspec.viewer.stale import stale_stage
from volspec.viewer.state import ViewState
from volspec.viewer.trace import Trace
from volspec.viewer.window import Painted, Window
from volspec.viewer.worker import CastDone

LEAST_PICTURE, MOST_PICTURE = 8, 8192
# imgui needs some frames after an input until everything stands where it belongs.
_SETTLE = 3
# It takes clicks and keys apart, one step a frame.
_FRAMES_EACH, _MOST = 3, 90
_MESSAGE_S = 8.0
_IDLE_S, _BUSY_S = 0.5, 0.02


@dataclass(frozen=True, slots=True)
class Options:
    """What `volspec view` was asked for.

    Parameters
    ----------
    path : str, optional
        A scene or a volume; None is the bundled demo.
    trace : Path, optional
    size : (width, height)
        Of the window.
    screenshot : (width, height), optional
        Of pictures that S writes; None is as shown.
    device : str, optional
    """

    path: str | None = None
    trace: Path | None = None
    size: tuple[int, int] = (1280, 720)
    screenshot: tuple[int, int] | None = None
    device: str | None = None


def view(options: Options) -> None:
    """Open the window; returns when it is closed.

    Raises
    ------
    VolspecError
        If no window can be opened, or what was asked for cannot be.
    """
    with Trace(options.trace) as trace:
        tasks = Tasks(Window.wake)
        # Reading goes on while the window opens.
        tasks.start("open", lambda: opened(options.path, options.device))
        window = Window("volspec", options.size)
        try:
            _App(options, trace, tasks, window).run()
        finally:
            window.close()


class _App:
    def __init__(self, options: Options, trace: Trace, tasks: Tasks, window: Window) -> None:
        self._options, self._trace, self._tasks, self._window = options, trace, tasks, window
        self._pictures = Pictures(window.context)
        self._casting = Casting(Window.wake)
        self._layout, self._mouse = Layout(), Mouse()
        self._desk = Desk(scale=window.scale)
        self._meter = Meter(self._desk, trace)
        self._history: History | None = None
        self._shown: ViewState | None = None  # what casts and relights were last asked for
        self._cast: CastDone | None = None  # what the picture shows
        self._relit = self._coarse = False
        self._message, self._message_until = "", 0.0
        self._asking = False
        self._dark: bool | None = None
        self._settle = _SETTLE

    def run(self) -> None:
        """Until the window closes."""
        try:
            while not self._window.closing:
                inputs = self._window.wait(self._patience())
                news = self._take(time.perf_counter())
                if not self._window.usable:
                    time.sleep(_BUSY_S)
                    continue
                if inputs or news:
                    more = sum(given.name != "move" for given in inputs)
                    self._settle = min(max(self._settle, _SETTLE) + _FRAMES_EACH * more, _MOST)
                if self._settle > 0 or self._message:
                    self._settle -= 1
                    self._draw(inputs)
                self._casting.tick(time.perf_counter(), self._mouse.held)
        finally:
            self._casting.close()
            self._pictures.close()

    def _patience(self) -> float:
        if self._settle > 0:
            return 0.0
        return _BUSY_S if self._casting.busy else _IDLE_S

    def _say(self, text: str) -> None:
        self._message, self._message_until = text, time.perf_counter() + _MESSAGE_S
        self._settle = _SETTLE

    def _take(self, now: float) -> bool:
        """What threads have brought; whether there is anything new."""
        casts, outcomes = self._casting.take(), self._tasks.take()
        for done in casts:
            self._take_cast(done)
        for outcome in outcomes:
            if outcome.error:
                if outcome.kind == "open" and self._history is None:
                    raise InputError(outcome.error)
                self._say(outcome.error)
                self._trace.note("error", message=outcome.error)
            elif outcome.kind == "open":
                self._open(outcome.result)
            else:
                self._save(*outcome.result)
        if self._message and now > self._message_until:
            self._message = ""
            return True
        return bool(casts or outcomes)

    def _open(self, document: Document) -> None:
        interface = self._history.present.interface if self._history else None
        size = self._history.present.size if self._history else (0, 0)
        self._history = History(ViewState.first(document, size, interface))
        if document.caster is not None:
            self._desk.device = document.caster.device
        self._window.name(f"{document.title} – volspec")
        self._trace.note("open", title=document.title)

    def _take_cast(self, done: CastDone) -> None:
        how = "cancel" if done.image is None else "cast"
        size = [-(-side // done.divisor) for side in done.job.size]
        if done.error:
            self._say(done.error)
            how = "error"
        self._trace.note(how, "cast", done.ms, divisor=done.divisor, size=size)
        if done.image is None or self._history is None:
            return
        if done.job.document is not self._history.present.document:
            return
        try:
            self._pictures.show(done.image)
        except VolspecError as error:
            self._say(str(error))
            return
        if done.divisor == 1 and not done.image.alpha.any():
            self._say("Nothing is seen: the opacity is 0 everywhere in view, or the view misses it")
        self._cast, self._relit = done, False
        self._desk.image, self._desk.whole = done.image, done.divisor == 1
        self._desk.ms["cast"] = done.ms

    def _draw(self, inputs: list[Input]) -> None:
        started = time.perf_counter()
        self._window.begin()
        self._set_theme()
        state = self._history.present if self._history else None
        if state is not None:
            self._layout.status(state, self._desk)
        area = self._layout.picture(self._desk, state is not None)
        if state is not None and self._history is not None:
            ratio = self._window.pixel_ratio
            sides = (int(side * ratio) for side in area[2:])
            width, height = (min(max(side, LEAST_PICTURE), MOST_PICTURE) for side in sides)
            state = replace(state, size=(width, height))
            state = self._handle(state, inputs, area)
            state = self._layout.panels(state, self._desk)
            self._history = self._history.then(state, self._mouse.gesture)
            if self._layout.settled:
                self._update(self._history.present, started)
        else:
            self._mouse.take(inputs)
        painted = self._painted(area)
        if self._message:
            overlay.message(self._message, self._desk)
        self._ask_path()
        dark = state is None or state.interface.dark
        self._window.end((0.08, 0.08, 0.08) if dark else (0.75, 0.75, 0.75), painted)
        self._meter.frame(started)

    def _handle(
        self, state: ViewState, inputs: list[Input], area: tuple[int, int, int, int]
    ) -> ViewState:
        """What input makes of a state."""
        io = imgui.get_io()
        for given in inputs:
            if given.name != "move":
                self._trace.note(given.name, key=given.key, button=given.button)
            if given.name == "drop" and given.paths:
                self._start_opening(given.paths[0])
            elif given.name == "key" and not io.want_text_input:
                state = self._command(given.key, state)
        return self._mouse.applied(state, inputs, area)

    def _command(self, key: str, state: ViewState) -> ViewState:
        """Keys that are more than a change of state."""
        if key == "ctrl+o":
            self._asking = True
        elif key == "s":
            self._screenshot()
        elif key in ("ctrl+z", "ctrl+shift+z", "ctrl+y") and self._history is not None:
            back = key == "ctrl+z"
            self._history = self._history.undone() if back else self._history.redone()
            return replace(self._history.present, size=state.size)
        return state

    def _update(self, state: ViewState, now: float) -> None:
        """Have done what a state needs."""
        stage = stale_stage(self._shown, state)
        self._shown = state
        if stage == "cast":
            self._casting.change(state, now, self._mouse.held)
            self._desk.whole = False
        if stage in ("cast", "relight"):
            self._relit = False
        if self._coarse and not self._mouse.held:
            self._relit = False
        if not self._relit and self._pictures.image is not None:
            self._relit = True
            self._coarse = self._mouse.held and self._desk.whole and self._meter.slow
            try:
                other = rig_of(state.other) if state.other else None
                relit = self._pictures.relight(
                    *(rig_of(state.lights), state.seen, other, state.divide, self._coarse)
                )
            except VolspecError as error:
                self._say(" ".join(str(error).split()))
            else:
                self._meter.relights(relit, self._desk.whole and not self._coarse)
        self._desk.under_mouse = self._probe(state)

    def _probe(self, state: ViewState) -> dict[str, str] | None:
        place = self._mouse.over_picture
        right = state.other is not None and place is not None and place[0] > state.divide
        rig = rig_of(state.other if right and state.other else state.lights)
        image = self._pictures.image
        if place is None or rig is None or image is None or self._cast is None:
            return None
        if self._mouse.held or not self._pictures.framebuffer:
            return None
        width, height = image.size
        pixel = min(int(place[0] * width), width - 1), min(int(place[1] * height), height - 1)
        code = self._pictures.code(*pixel)
        said = {"code": "  ".join(str(value) for value in code)}
        return said | dict(probed(image, self._cast.job.camera, rig, state.seen, pixel))

    def _painted(self, area: tuple[int, int, int, int]) -> Painted | None:
        """The picture behind the panels; one of another shape keeps its own."""
        x, y, width, height = area
        image = self._pictures.image
        if not self._pictures.framebuffer or None in (self._cast, self._shown, image):
            text = "Opening …" if self._cast is None else "No light is on"
            size = imgui.calc_text_size(text)
            place = x + (width - size.x) / 2, y + (height - size.y) / 2
            grey = imgui.color_convert_float4_to_u32((0.6, 0.6, 0.6, 1.0))
            imgui.get_background_draw_list().add_text(place, grey, text)
            return None
        assert self._cast is not None and self._shown is not None and image is not None
        of, now = self._cast.job.size, self._shown.size
        wide = width if of == now else height * of[0] / of[1]
        left = x + (width - wide) / 2
        to = left, y, left + wide, y + height
        return Painted(self._pictures.framebuffer, self._pictures.size, to, area)

    def _set_theme(self) -> None:
        dark = self._history is None or self._history.present.interface.dark
        if dark != self._dark:
            self._dark = dark
            style.set_theme(imgui, implot, dark)

    def _ask_path(self) -> None:
        path = overlay.ask_path(self._desk, self._asking)
        self._asking = False
        if path:
            self._start_opening(path)

    def _start_opening(self, path: str) -> None:
        self._say(f"Opening {path} …")
        self._tasks.start("open", lambda: opened(path, self._options.device))

    def _screenshot(self) -> None:
        if self._history is None:
            return
        state = self._history.present
        size = self._options.screenshot or state.size
        self._say(f"Casting {size[0]} × {size[1]} …")
        self._tasks.start("screenshot", lambda: (cast_for_file(state, size), state))

    def _save(self, image: CoefficientImage, state: ViewState) -> None:
        try:
            path = save(self._pictures, image, state)
        except (VolspecError, OSError) as error:
            self._say(" ".join(str(error).split()))
            return
        self._trace.note("screenshot", path=str(path))
        self._say(f"Saved {path}")
