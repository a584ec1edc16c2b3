"""The event loop: inputs and panels make states, states make casts and relights.

    Window -> inputs, panels -> state -> CastScheduler | Screen -> Window

GL stays on this thread; casts and files have threads of their own.
"""

from __future__ import annotations

import sys
import time
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from imgui_bundle import imgui, implot

from volspec.errors import InputError
from volspec.viewer.model import measure, rules
from volspec.viewer.model.commands import BY_KEY, MENUS
from volspec.viewer.model.depth import left_out, needs_layers
from volspec.viewer.model.edit import bind
from volspec.viewer.model.effects import EFFECT
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import Fade
from volspec.viewer.model.light_states import after_fade, during_fade
from volspec.viewer.model.rendition import chosen_lights
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import menus, messages, start
from volspec.viewer.ui.context import CLICK_FRAMES, Results, UiContext
from volspec.viewer.ui.file_commands import FileCommands
from volspec.viewer.ui.inputs import Input
from volspec.viewer.ui.layout import Docks
from volspec.viewer.ui.mouse import Focus, Mouse
from volspec.viewer.ui.widgets import as_one_line, set_theme
from volspec.viewer.ui.window import Window
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.casts import CastScheduler
from volspec.viewer.work.demonstrations import Thumbnails
from volspec.viewer.work.designs import DesignService
from volspec.viewer.work.documents import OpenResult, open_path
from volspec.viewer.work.notify import SHORT_SECONDS, Notice, Trace, WarningQueue, collect_warnings
from volspec.viewer.work.pictures import Painted, return_large_blocks
from volspec.viewer.work.rendition import RenditionService
from volspec.viewer.work.screen import Area, Meter, Screen
from volspec.viewer.work.session import SUFFIX
from volspec.viewer.work.time_steps import TimeSteps

MIN_PICTURE, MAX_PICTURE = 8, 8192
# Frames that imgui needs after an input, or a change of its layout, until the layout is final.
_SETTLE = 3
_IDLE_S, _BUSY_S = 0.5, 0.02
# A mouse that is still for this long gets a tooltip, for which imgui needs frames, too.
_STILL_S = 0.6
# The longest that another thread computes before this one may continue; each GL or glfw call
# lets the others run, and a frame has many such calls.
_TURN_S = 5e-4


@dataclass(frozen=True, slots=True)
class ViewerOptions:
    """Options of `volspec view`."""

    path: str | None = None  # a scene, a volume or a session; None for the bundled demo
    trace: Path | None = None
    size: tuple[int, int] = (1280, 720)  # of the window, at 96 dpi
    screenshot: tuple[int, int] | None = None  # pixels of pictures that S saves; None for as shown
    device: str | None = None
    restore: bool = False  # resume the last session, if there is one

    @property
    def resumes(self) -> bool:
        """True if the viewer resumes a session."""
        return self.restore or (self.path or "").lower().endswith(SUFFIX)

    @property
    def is_first(self) -> bool:
        """True if nothing was asked for."""
        return self.path is None and not self.restore


def view(options: ViewerOptions) -> None:
    """Open the window; return when it is closed.

    Raises VolspecError if the window or the path cannot be opened.
    """
    return_large_blocks()
    turn = sys.getswitchinterval()
    sys.setswitchinterval(_TURN_S)
    try:
        with Trace(options.trace) as trace, collect_warnings() as warned:
            tasks = Tasks(Window.wake)
            path = options.path
            if not options.resumes:
                # The file is read while the window opens.
                tasks.start("open", lambda: open_path(path, options.device))
            with closing(Window("volspec", options.size)) as window:
                App(options, trace, tasks, window, warned).run()
    finally:
        sys.setswitchinterval(turn)


class App:
    """The viewer in a window, until that is closed."""

    def __init__(
        self,
        options: ViewerOptions,
        trace: Trace,
        tasks: Tasks,
        window: Window,
        warned: WarningQueue,
    ) -> None:
        self._trace, self._window, self._warned = trace, window, warned
        self._ui = UiContext()
        self._meter, self._notice = Meter(trace), Notice(trace)
        if window.note:
            self._notice.show_warning(window.note)
        self._screen = Screen(window.context, Window.wake, self._meter, self._notice)
        self._thumbnails = Thumbnails(window.context)
        self._designs = DesignService(Window.wake, self._notice)
        self._renditions = RenditionService(Window.wake)
        self._steps = TimeSteps(Window.wake, self._notice)
        self._file_commands = FileCommands(
            tasks,
            self._screen.pictures,
            self._ui,
            self._notice,
            device=options.device,
            size=options.screenshot,
            palette=self._designs.file,
            steps=self._steps,
        )
        if options.restore:
            self._file_commands.documents.resume_last(options.path)
        elif options.resumes:
            self._file_commands.documents.open(options.path)
        # At the first start there is nothing of the user's own to go on with.
        self._ui.start = options.is_first and not self._file_commands.documents.recent
        self._scheduler = CastScheduler(Window.wake)
        self._services = self._designs, self._renditions, self._steps, self._scheduler, self._screen
        self._docks, self._mouse = Docks(), Mouse()
        self._focus = Focus()
        self._fade: Fade | None = None
        self._fade_began = 0.0
        self._fading = False  # more frames are needed
        self._history: History | None = None
        self._drawn: ViewState | None = None  # the last state that was cast or relit
        self._dark: bool | None = None
        self._settle = _SETTLE
        self._early: list[Input] = []  # dropped before anything is open
        self._clicks: list[tuple[str, tuple[float, float]]] = []  # into a picture that is coarse
        self._still: float | None = None  # when the mouse will have been still for _STILL_S
        self._rested = False

    @property
    def _present(self) -> ViewState | None:
        """The state to draw and to save; None until something is open."""
        return self._history.present if self._history else None

    @property
    def _moves(self) -> bool:
        """True if more changes are likely: a mouse button is down, or lights fade."""
        return self._mouse.held or self._fading or self._ui.plays or self._steps.playing

    def run(self) -> None:
        """Draw frames until the window closes; raise InputError if nothing could be opened."""
        try:
            if self._ui.start and self._window.usable:
                self._draw([])  # first, also if the demonstration is read already
            while not self._window.closing:
                self.cycle()
        finally:
            self.close(isinstance(sys.exception(), Exception))
        if self._history is None and self._file_commands.documents.problem:
            raise InputError(self._file_commands.documents.problem, code="impossible")

    def cycle(self) -> None:
        """Wait for input or results, use them, and draw a frame if something has changed."""
        waited, patience = time.perf_counter(), self._patience()
        inputs = self._window.wait(patience)
        began = time.perf_counter()
        news = self._take()
        if not self._window.usable:
            time.sleep(_BUSY_S)
            return
        if inputs:
            self._still = began + _STILL_S
        elif self._still is not None and began >= self._still:
            self._still, news = None, True
        if inputs or news:
            self._settle = max(self._settle, _SETTLE)
        if self._settle > 0 or self._notice.text:
            self._settle -= 1
            self._draw(inputs)
        ended = time.perf_counter()
        if not self._steps.playing:  # each step is cast once, coarsely
            self._scheduler.tick(ended, self._mouse.held)
        if self._history is not None:
            self._screen.tick(self._history.present, ended, self._mouse.held)
            if not (self._moves or self._scheduler.busy) and self._screen.idle.wants_cast():
                self._scheduler.cast_opacities(self._history.present)
            self._steps.tick(self._history.present, self._screen.document, ended)
            self._file_commands.documents.tick(self._history.present, ended, self._moves)
        self._meter.note_wait(began - waited - patience, time.perf_counter() - began)
        self._note_rest()

    def close(self, faulty: bool) -> None:
        """End all threads, and save the session."""
        self._file_commands.close(self._present, faulty)
        for service in (self._thumbnails, *self._services):
            service.close()

    def _patience(self) -> float:
        if self._settle > 0:
            return 0.0
        now = time.perf_counter()
        longest = min(
            _BUSY_S if self._scheduler.busy or self._screen.idle.loading else _IDLE_S,
            self._steps.patience(now),
        )
        remaining_s = longest if self._still is None else max(self._still - now, 0.0)
        return min(remaining_s, longest)

    def _note_rest(self) -> None:
        """Note in the trace when everything is done and drawn."""
        moves = self._settle > 0 or self._moves or self._file_commands.busy
        rests = not moves and not any(service.busy for service in self._services)
        if rests and not self._rested:
            self._trace.note("rest")
        self._rested = rests

    def _take(self) -> bool:
        """Take the threads' results; return True if there are any."""
        casts = self._scheduler.take(self._steps.playing)
        pictures = bool(casts)
        for done in casts:
            self._screen.take(done, self._present, self._scheduler.is_newest(done))
            if done.error:
                self._steps.stop()
        if casts and self._drawn is not None:
            self._relight(self._drawn)  # now, so that it is shown a frame earlier
        news, opened = self._file_commands.take(first=self._history is None)
        if self._history is not None:
            history = self._file_commands.add_meshes(self._designs.take(self._history))
            news, self._history = news or history is not self._history, history
        if opened is not None:
            self._open(opened)
        if self._history is not None:
            stepped = self._steps.take(self._history.present.document)
            if stepped is not None:
                stepped_state = replace(self._history.present, document=stepped)
                self._history, pictures = self._history.amend(stepped_state), True
        if (solved := self._screen.take_room(self._present)) is not None:
            assert self._history is not None
            self._history = self._history.amend(replace(self._history.present, room=solved))
            news = True
        warned = self._warned.take()
        for message in warned:
            self._notice.show_warning(message)
            self._trace.note("warning", message=message)
        if self._history is not None:
            news |= self._screen.update_error_map(self._history.present, self._mouse.held)
        news |= self._screen.take_tables() | self._screen.idle.take() | self._renditions.take()
        if pictures and self._steps.playing:
            # Steps leave the layout as it is; more frames would take the casts' time.
            self._settle, pictures = max(self._settle, 1), False
        return self._notice.expire(time.perf_counter()) or news or pictures or bool(warned)

    def _open(self, opened: OpenResult) -> None:
        before = self._present
        self._warned.forget()
        self._steps.forget()
        self._clicks = []
        opened = opened.after(before)
        self._file_commands.documents.begin(opened, before)
        self._history = History(opened.state)
        self._screen.forget()
        title = opened.state.document.title
        self._window.name(f"{as_one_line(title)} – volspec")
        self._trace.note("open", title=title)
        if omitted := left_out(opened.state):
            self._notice.show_warning(f"{title}: this picture cannot have its {omitted}")

    def _draw(self, inputs: list[Input]) -> None:
        started = time.perf_counter()
        self._window.begin()
        self._ui.scale = self._mouse.scale = self._window.scale
        self._ui.layers_wanted = False
        self._ui.results = self._results()
        self._focus.frame()
        self._set_theme()
        if self._history is None:
            area = self._docks.picture(self._ui, False, None)
            self._mouse.take(inputs)
            self._wait_for_file(inputs)
        else:
            area = self._draw_panels(self._history, inputs, started)
        painted = self._screen.painted_picture(area, self._drawn)
        self._draw_messages(painted)
        self._file_commands.draw(self._present)
        self._window.end((0.08, 0.08, 0.08) if self._is_dark else (0.75, 0.75, 0.75), painted)
        if problem := self._window.error:
            self._trace.note("gl-error", message=problem)
        areas_moved = self._meter.note_frame(started, self._ui.areas)
        # imgui processes one step of a click or key per frame.
        if areas_moved or self._window.lags or self._ui.text_wanted[1]:
            self._settle = max(self._settle, _SETTLE)
        if self._drawn is not None:
            # A software renderer then draws it while the next frame's panels are made.
            self._relight(self._drawn)

    def _draw_panels(self, history: History, inputs: list[Input], now: float) -> Area:
        """Draw the panels, and use what they and the inputs edit; return the picture's area."""
        present, image = history.present, history.present.document.image
        displayed = self._during_fade(present, now)
        state = menus.draw_menu(menus.draw_status(displayed, self._ui), self._ui)
        area = self._docks.picture(self._ui, True, image)
        state = self._next(state, [*self._early, *inputs], area)
        self._early = []
        if self._ui.preview is not None:
            # The dialog leaves no other edits.
            state = present if state.size == present.size else replace(present, size=state.size)
        elif displayed is not present:
            state = after_fade(present, displayed, state)
        state, refusals = rules.hold(present, state)
        for text in refusals:
            if text not in rules.ONCE or text != self._notice.text:
                self._notice.show_warning(text)
        self._history = history.then(state, self._mouse.gestures.number)
        self._do_requests()
        self._follow(state, now)
        return area

    def _follow(self, state: ViewState, now: float) -> None:
        """Have the services follow the history, after a frame with a state."""
        assert self._history is not None
        needed = self._ui.layers_wanted or needs_layers(state)
        self._scheduler.layers_wanted = needed and state.document.image is None
        if self._ui.lights.tab == "Rendition":
            self._renditions.follow(chosen_lights(state, self._ui.lights.of_mix))
        if self._docks.settled:
            self._designs.follow(self._history.present)  # the fade's end
            displayed = self._during_fade(self._history.present, now)
            change = self._history.difference
            if change is None or change.old is not self._drawn or change.new is not displayed:
                change = Difference.between(self._drawn, displayed)  # a fade, or several steps
            self._update(change, now)
            if change.fields - {"document"}:  # time steps leave the layout as it is
                self._settle = max(self._settle, _SETTLE)
        if self._fading or self._ui.plays:
            self._settle = max(self._settle, _SETTLE)

    def _draw_messages(self, painted: Painted | None) -> None:
        """Draw the message in place of the picture, or on it, and the latest one."""
        problem = "" if self._history else self._file_commands.documents.problem
        text = problem or self._screen.missing_message(self._drawn, painted)
        if text and (self._history or problem or not self._ui.start):
            fault = bool(problem or self._screen.fault)
            messages.draw_centred(text, fault, bool(problem), self._ui)
        toast = self._notice.current
        if toast is not None and toast.text != text and messages.draw_toast(toast, self._ui):
            self._notice.hide()

    def _wait_for_file(self, inputs: list[Input]) -> None:
        """Use inputs while nothing is open: the start screen's, and the keys once that failed."""
        start.draw(None, self._ui)
        failed = bool(self._file_commands.documents.problem)
        for event in inputs:
            command = BY_KEY.get(event.key) if event.name == "key" else None
            if event.name == "drop" and event.paths and not failed:
                self._early.append(event)
            elif event.name == "drop" and event.paths:
                self._file_commands.drop(event.paths, None)
            elif failed and command is not None and command.name in ("open", "quit"):
                self._ui.request(command.name)
        requests, self._ui.requests = self._ui.requests, []
        for request in requests:
            if request.name == "quit":
                self._window.leave()
            else:
                self._file_commands.run(request, None)

    def _during_fade(self, state: ViewState, now: float) -> ViewState:
        """Return a state as it is shown, in a preview or a fade; a new fade's clock starts now."""
        if state.fade is not self._fade:
            self._fade, self._fade_began = state.fade, now
        if self._ui.preview is not None:
            return self._ui.preview(state)
        if self._fade is None:
            self._fading = False
            return state
        faded = during_fade(state, now - self._fade_began)
        self._fading = faded is not state
        return faded

    def _results(self) -> Results:
        screen, meter = self._screen, self._meter
        return Results(
            image=screen.image,
            sharp=screen.sharp,
            shown_at=screen.shown_at,
            side_by_side=screen.side_by_side,
            fault=screen.fault,
            fps=meter.fps,
            ms=meter.ms,
            under_mouse=screen.under_mouse,
            error_map=screen.error_map,
            slices=screen.slices,
            step=0 if self._present is None else self._steps.requested(self._present.document),
            playing=(self._steps.playing, self._steps.loops),
            design=self._designs.status,
            recent=self._file_commands.documents.recent,
            messages=self._notice.messages,
            thumbnails=self._thumbnails,
            rendition=self._renditions.latest,
        )

    def _next(self, state: ViewState, inputs: list[Input], area: Area) -> ViewState:
        """Return the state after input and panels."""
        ratio = self._window.pixel_ratio
        sides = (int(side * ratio) for side in area[2:])
        width, height = (min(max(side, MIN_PICTURE), MAX_PICTURE) for side in sides)
        state = replace(state, size=(width, height))
        writing = imgui.get_io().want_text_input
        for event in inputs:
            if event.name != "move":
                self._trace.note(event.name, key=event.key, button=event.button)
            if event.name == "drop" and event.paths:
                self._file_commands.drop(event.paths, state)
                continue
            # The command palette takes keys before its field has the focus, too.
            typing = writing or self._ui.commands is not None
            if event.name != "key" or typing or self._focus.takes(event.key, bool(self._ui.menu)):
                continue
            if event.key in BY_KEY:
                state = self._ui.run(state, BY_KEY[event.key])
        state = self._mouse.apply(state, inputs, area)
        if self._mouse.clicked is not None:
            self._clicks.append(self._mouse.clicked)
        if self._clicks and self._measures_later(state):
            self._notice.show("The point is set once the picture is whole", SHORT_SECONDS)
        else:
            for clicked in self._clicks:
                state = self._click(state, *clicked)
            self._clicks = []
        self._focus_text()
        return self._docks.panels(state, self._ui)

    def _measures_later(self, state: ViewState) -> bool:
        """Return True if a finer picture, with other places, is awaited; a label is typed now."""
        works = self._scheduler.busy or self._screen.busy
        measures = state.interface.tool in ("distance", "angle")
        return measures and works and self._screen.refines(state)

    def _click(self, state: ViewState, button: str, place: tuple[float, float]) -> ViewState:
        """Return the state after a click into the picture, which opens a menu or picks a point."""
        if button == "right":
            self._ui.clicked = place
        if button != "left" or not state.interface.tool:
            return state
        if state.interface.tool not in measure.TOOLS:  # a flashlight, which is laid down
            return measure.stop(state)
        point = self._screen.point_mm(place)
        if point is None:
            self._notice.show("Nothing is there; click a surface", SHORT_SECONDS)
            return state
        new = self._ui.edited(state, bind(measure.pick, point))
        if state.interface.tool == "label" and len(new.annotations) > len(state.annotations):
            # The next keys are the label's text, not commands.
            self._ui.text_wanted = f"annotation text {len(state.annotations)}", CLICK_FRAMES
        return new

    def _focus_text(self) -> None:
        """Focus the text that a click made, also after imgui has seen the click."""
        item, frames = self._ui.text_wanted
        if frames and not imgui.is_any_item_active():
            self._ui.front, self._ui.item = measure.PANEL, item
        self._ui.text_wanted = item, max(frames - 1, 0)

    def _do_requests(self) -> None:
        """Run the commands that are not edits of the state."""
        requests, self._ui.requests = self._ui.requests, []
        assert self._history is not None
        for request in requests:
            name = request.name
            if name in ("undo", "redo"):
                self._step_history(self._history, back=name == "undo")
            elif name == "quit":
                self._window.leave()
            elif name in self._designs.commands:
                effect = request.argument == EFFECT
                self._designs.run(name, self._history.present, effect)
            elif name == "focus":
                self._focus.next(self._docks.open_panels(self._history.present))
            elif name == "menu":
                self._ui.focus_menu = MENUS[0]
                self._focus.enter(menu=True)
            elif name == "copy-picture" and not self._screen.ready:
                self._ui.requests.append(request)  # until it is
            else:
                self._file_commands.run(request, self._history.present)

    def _step_history(self, history: History, back: bool) -> None:
        """Undo or redo a step."""
        self._history = history.undo() if back else history.redo()
        if self._history is history:
            message = f"Nothing to {'undo' if back else 'redo'}"
        else:
            assert self._history.difference is not None
            message = f"{'Undone' if back else 'Redone'}: {self._history.difference.name}"
        self._notice.show(message, SHORT_SECONDS)
        self._designs.forget()

    def _update(self, change: Difference, now: float) -> None:
        """Start what a change needs: a cast, or a relight."""
        self._drawn = change.new
        recomposes = change.stage == "recompose" and self._screen.idle.recomposes(change.new)
        if recomposes:
            self._scheduler.follow(change.new)
        elif change.stage in ("cast", "recompose"):
            playing = self._steps.playing
            self._scheduler.change(change.new, now, self._moves, playing, change.turns)
            self._screen.await_cast()
        if change.relights or recomposes:
            self._screen.mark_stale()

    def _relight(self, state: ViewState) -> None:
        """Draw the picture of a state for the next frame."""
        dragging = self._moves
        draws = self._screen.relight(state, dragging)
        if self._screen.probe(state, self._mouse.over_picture, dragging) or draws:
            self._settle = max(self._settle, 1)

    @property
    def _is_dark(self) -> bool:
        return self._history is None or self._history.present.interface.dark

    def _set_theme(self) -> None:
        if self._is_dark != self._dark:
            self._dark = self._is_dark
            set_theme(imgui, implot, self._dark)
