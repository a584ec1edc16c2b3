"""The picture on the screen, relit when something has changed; its error map and timings.

    casts, state -> [screen] -> Painted -> window

A slow relight draws one band per frame. LUTs for models without a shader are made in the
background; the old picture stays meanwhile.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from volspec.appearance import LutCache, LutKey, needs_host_lut
from volspec.errors import LutCancelled, RelightError, VolspecError, one_line
from volspec.image import CoefficientImage
from volspec.relight import ErrorMap, Look, error_map
from volspec.settings import Vector
from volspec.viewer.model.depth import shown_look
from volspec.viewer.model.document import Document
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.room import has_walls, shown_spec
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import vector
from volspec.viewer.work.background import LatestWorker, Tasks
from volspec.viewer.work.cast_job import CastDone
from volspec.viewer.work.idle_views import IdleViews, can_show
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.pictures import Painted, Pictures, Relit
from volspec.viewer.work.probe import PixelProbe, place_mm, read
from volspec.viewer.work.room import RoomJob, RoomWorker, Walls
from volspec.viewer.work.slice_pictures import SlicePictures

if TYPE_CHECKING:
    from volspec.scene import SceneRoom

# Frames further apart do not count as movement.
_APART_S = 0.25
# The window must check for input more often than this.
_UNANSWERED_MS = 40.0
# A whole relight that takes longer leaves no time for the rest of a frame.
SLOW_MS = 18.0
_MAX_BANDS = 4
# Rooms in other paints are coarser if a relight takes more bands than this.
_SLOW_BANDS = 1


class Meter:
    """Measures frames and relights."""

    def __init__(self, trace: Trace) -> None:
        self._trace = trace
        self.ms: dict[str, float] = {}  # last time of each stage
        self.fps = 0.0  # frames per second, while something moves
        self._last = 0.0
        # Number of frames over which to relight a whole picture, so that none takes long; more than
        # one if a relight is too slow while a light is dragged.
        self.bands = 1
        self._relit: Relit | None = None
        self._relit_ms = 0.0
        self._ended: bool | None = None  # True if a whole picture ends here, False for a part
        self._areas: dict[str, tuple[int, int, int, int]] = {}

    def forget(self) -> None:
        """Forget the times, and that of a relight in progress, which belong to another document."""
        self.ms, self.fps, self._relit, self._ended = {}, 0.0, None, None

    def note_relight(self, relit: Relit | None, first: bool, ends: bool, full: bool) -> None:
        """Note that a picture, or a band of it, is being relit; its time arrives a frame later.

        The band may be the picture's ``first`` one, or its last (``ends``); a ``full`` picture
        has all pixels.
        """
        self._relit = relit
        if first:
            self._relit_ms = 0.0
        self._ended = full if ends else None

    def note_wait(self, late_s: float, busy_s: float) -> None:
        """Note if the wait for input ended too late, or the work that followed took too long."""
        if (ms := 1e3 * max(late_s, busy_s)) > _UNANSWERED_MS:
            self._trace.note("unanswered", None, ms)

    def note_frame(self, began: float, areas: dict[str, tuple[int, int, int, int]]) -> bool:
        """Note a shown frame, and the (x, y, width, height) of its panels by name.

        Return True if one of them has changed.
        """
        if self._relit is not None:
            self._relit_ms += self._relit.ms
            self._relit = None
            if self._ended:
                self.bands = min(max(math.ceil(self._relit_ms / SLOW_MS), 1), _MAX_BANDS)
            if self._ended is not None:
                self.ms["relight"] = self._relit_ms
                self._trace.note("relight", "relight", self._relit_ms, whole=self._ended)
        now = time.perf_counter()
        self.ms["frame"] = 1e3 * (now - began)
        self._trace.note("frame", "frame", self.ms["frame"])
        if now - self._last < _APART_S:
            self.fps += 0.1 * (1.0 / (now - self._last) - self.fps)
        self._last = now
        if self._areas == areas:
            return False
        self._areas = dict(areas)
        self._trace.note("layout", areas=self._areas)
        return True


# Approximate number of pixels compared, which takes a fraction of a second and is fine enough.
_PIXELS = 60_000
# The map's opacity over the picture, of 255.
_ALPHA = 230


class ErrorMapTexture:
    """The error map of the picture; computed again when the image or the light changes."""

    def __init__(self, context: Any, wake: Callable[[], object]) -> None:
        self._context, self._tasks = context, Tasks(wake)
        self._of: tuple[Any, ...] | None = None  # the picture and lights asked for last
        self._made_of: tuple[Any, ...] | None = None  # and those of the map
        self._texture: Any = None
        self.map: ErrorMap | None = None
        self.problem = ""  # error message if there is no map

    @property
    def busy(self) -> bool:
        """True while a map is in progress."""
        return self._tasks.busy

    def want(self, image: CoefficientImage, state: ViewState) -> None:
        """Start a picture's map, unless it was the last one started."""
        rig, spec = light_rig(state.lights, state.room), state.relight
        key = self._key(image, state)
        if key == self._of:
            return
        self._of = key
        stride = max(1, round((image.alpha.size / _PIXELS) ** 0.5))

        def compute() -> ErrorMap:
            if rig is None:
                raise RelightError("No light is on, so no colour has an error", code="missing")
            return error_map(image, rig, spec.mode, spec.backdrop, stride)

        self._tasks.start("map", compute)

    @staticmethod
    def _key(image: CoefficientImage | None, state: ViewState) -> tuple[Any, ...]:
        """Return all that a map depends on."""
        spec = state.relight
        return image, state.lights, state.room, spec.mode, spec.backdrop

    def shows(self, image: CoefficientImage | None, state: ViewState) -> bool:
        """Return True if the map, or the message in its place, is of a picture under its lights."""
        return self._made_of == self._key(image, state)

    def take(self) -> bool:
        """Take new maps; return True if there are any."""
        outcomes = self._tasks.take()
        for outcome in outcomes:
            self.problem, self.map, self._made_of = outcome.error, outcome.result, self._of
            self.close()
            if self.map is not None:
                alpha = np.where(self.map.alpha > 0, _ALPHA, 0).astype(np.uint8)
                rgba = np.dstack([self.map.heat(), alpha])
                size = rgba.shape[1], rgba.shape[0]
                self._texture = self._context.texture(size, 4, rgba.tobytes())
        return bool(outcomes)

    @property
    def texture(self) -> int:
        """GL's name of the map; 0 if there is none."""
        return 0 if self._texture is None else int(self._texture.glo)

    def close(self) -> None:
        """Release the texture."""
        if self._texture is not None:
            self._texture.release()
            self._texture = None


# A light must be unchanged for this long before its tables are computed, which may take seconds.
_REST_S = 0.1
# A paint must, before the room is solved, which would slow down the drag.
_PAINT_REST_S = 0.3


class TableWorker(LatestWorker[tuple[LutKey, ...], str]):
    """Computes tables in a thread; its results are error messages, empty if all went well."""

    _name = "volspec-tables"

    def __init__(self, wake: Callable[[], object], tables: LutCache, notice: Notice) -> None:
        super().__init__(wake)
        self._tables, self._notice = tables, notice
        self._missing: tuple[LutKey, ...] = ()  # those that the picture waits for
        self._text = ""

    def lacks(self, missing: tuple[LutKey, ...], model: str) -> bool:
        """Return True if a model's light must wait for tables, which are then computed."""
        if missing:
            self._text = f"{model}: computing its colour table …"
            self._notice.show(self._text, _TABLE_S)
            if missing != self._missing:
                self.request(missing)
        elif self._missing:
            self._notice.hide(self._text)
        self._missing = missing
        return bool(missing)

    def take(self) -> list[str]:
        """Return messages since the last call, empty where tables are ready; show the others."""
        messages = super().take()
        for error in filter(None, messages):
            self._missing = ()
            self._notice.show(error, kind="error")
        return messages

    def _results(self, job: tuple[LutKey, ...]) -> Iterator[str]:
        if not self._wait_idle(_REST_S):
            return
        try:
            for key in job:
                self._tables.texels(key, self._is_superseded)
        except LutCancelled:
            return
        except MemoryError:
            yield "no memory for the colour table"
        except VolspecError as error:
            yield one_line(error)
        else:
            yield ""


# The longest time that a table's notice is shown; it disappears when the table is ready.
_TABLE_S = 60.0
_DARK = "No light is on; turn one on in the Lights panel"
_NOTHING = "Nothing is visible: opacity is 0 everywhere in view, or the view misses the volume"
Area = tuple[int, int, int, int]


class Screen:
    """Relights the last cast when something has changed."""

    def __init__(
        self, context: Any, wake: Callable[[], object], meter: Meter, notice: Notice
    ) -> None:
        self.pictures = Pictures(context)
        self.idle = IdleViews(self.pictures, wake, self.mark_stale, notice)
        self._tabling = TableWorker(wake, self.pictures.tables, notice)
        self.slices = SlicePictures(context)
        self.sharp = False  # True if it has the picture's full resolution
        self.fault = ""  # error message if there is no picture; empty while one is awaited
        self.under_mouse: PixelProbe | None = None
        self.error_map: ErrorMapTexture | None = None  # once it was requested
        self.shown_at = 0.0, 0.0, 0.0, 0.0  # left, top, right, bottom in the window
        self._meter, self._notice = meter, notice
        self._cast: CastDone | None = None
        self._blank = False  # nothing is visible in it
        self._shape = (0, 0)  # size of the cast whose picture is shown
        self._band: int | None = 0  # the next one to draw; None once the picture is drawn
        self._hurries = False  # draw all bands at once, as the last picture lacks some
        self._drawing = False  # since the last call of `relight`
        self._coarse = False
        self._error_map = ErrorMapTexture(context, wake)
        self._painting = RoomWorker(wake)
        self._walls: Walls | None = None  # in the picture
        self._new_room: tuple[SceneRoom, float] | None = None  # a new room, and since when
        self._reading: tuple[tuple[Any, ...], PixelProbe | None] | None = None  # with what it is of

    @property
    def busy(self) -> bool:
        """True while tables, an error map, a room or a picture to be read are computed."""
        services = self._tabling, self._error_map, self._painting, self.idle
        return any(service.busy for service in services)

    @property
    def ready(self) -> bool:
        """True if the picture is fully drawn, or there is none."""
        return self._band is None or self.pictures.image is None

    def take(self, done: CastDone, state: ViewState | None, newest: bool = True) -> None:
        """Take a pass of a cast that has ended, of the ``newest`` request or an earlier one."""
        how = "cancel" if done.image is None else "cast"
        if done.cast_pass.steps == "none":
            how = "reproject"
        divisor, steps = done.cast_pass.divisor, done.cast_pass.steps
        size = [-(-side // divisor) for side in done.job.size]
        if done.error:
            self._notice.show(done.error, kind="error")
            how = "error"
            if self._cast is None or not self._cast.job.document.is_of(done.job.document):
                # The picture that is shown belongs to another document.
                self.fault = one_line(done.error)
                self._cast = None
        stage = "reproject" if how == "reproject" else "cast"
        self._notice.trace.note(how, stage, done.ms, divisor=divisor, steps=steps, size=size)
        if done.image is None or state is None or not done.job.document.is_of(state.document):
            return
        layered = newest and done.image.opacity_layers is not None
        if layered and not can_show(done, state):
            return  # it hides what is shown again by now
        self.idle.hide()
        try:
            if not layered:
                self.pictures.show(done.image, done.packed)
                self.idle.begin(Look(opacities=done.job.shading.opacities))
            elif not self.idle.take_cast(done, shown_look(state), self.sharp):
                return  # the picture is a cast with these opacities
        except VolspecError as error:
            self._notice.show(str(error), kind="error")
            return
        # The packed layers are in a texture now.
        self._cast, self.fault = replace(done, packed=None, opacity=None), ""
        self._walls, self._new_room = done.walls, None
        self.mark_stale()
        self.sharp = divisor == 1 and stage == "cast"
        self._blank = not done.image.alpha.any()
        self._meter.ms[stage] = done.ms

    @property
    def image(self) -> CoefficientImage | None:
        """The last cast, with its opacities as soon as it is recomposed; None without one."""
        return None if self._cast is None else self.idle.readable() or self.pictures.image

    @property
    def document(self) -> Document | None:
        """The document, at its time step, of the picture; None without one."""
        return None if self._cast is None else self._cast.job.document

    def forget(self) -> None:
        """Stop showing the picture, which belongs to another document."""
        self._cast = self._walls = None
        self.sharp, self.fault = False, ""
        self.idle.forget_document()
        self.pictures.forget()
        self._meter.forget()

    def await_cast(self) -> None:
        """Expect a cast, without which a change is not shown."""
        self.sharp = False
        self.idle.forget()

    def mark_stale(self) -> None:
        """Mark the picture as stale: it no longer shows the state's light."""
        # If lights keep changing, as with a key held down, the last bands would never be drawn.
        self._hurries |= bool(self._band)
        self._band = 0

    def relight(self, state: ViewState, held: bool) -> bool:
        """Start drawing the picture under the state's lights, unless it already shows them.

        GL calls after this wait for the drawing, so the panels are best made meanwhile. A slow
        relight draws one band per frame, unless the previous light was not fully drawn, and fewer
        pixels while a mouse button is held. Return True if the next frame has something to show.
        """
        self._drawing = False
        painted = self._repaint(state)
        if self.idle.recompose(state):
            self._cast, self.sharp = self.idle.cast, True
        if self._coarse and not held and not painted:
            self.mark_stale()
        if self.ready or self._awaits_groups(state):
            return False
        next_band, self._band = self._band or 0, None
        self.pictures.repaint(state.transfer.basis)
        # Coarse pictures would need tables of their own.
        few = (
            self.sharp and self._meter.bands > 1 and not needs_host_lut(state.relight.viewing.model)
        )
        self._coarse = (held and few) or painted
        full = self.sharp and not self._coarse
        bands = 1 if held or self._hurries or not full else self._meter.bands
        first = next_band % bands
        rig, look = light_rig(state.lights, state.room), self.idle.look
        look = replace(look, relight=shown_spec(state))
        other = light_rig(state.other, state.room) if state.other else None
        try:
            missing = self.pictures.missing(rig, look, other)
            if self._tabling.lacks(missing, look.relight.viewing.model):
                return False
            band = first / bands, (first + 1) / bands
            relit = self.pictures.relight(rig, look, other, state.divide, self._coarse, band)
        except VolspecError as error:
            self._notice.show(one_line(error), kind="error")
            return False
        self._drawing = relit is not None
        if self._drawing and first + 1 < bands:
            self._band = first + 1
        else:
            self._hurries = False
            if self._cast is not None:
                self._shape = self._cast.job.size
        self._meter.note_relight(relit, first == 0, self.ready, full)
        return True

    def _repaint(self, state: ViewState) -> bool:
        """Show other paints than the picture's, until `tick` paints all; return True if it has."""
        room, walls = state.room, self._walls
        if room is None or walls is None or walls.room is room or not has_walls(state):
            return False
        if self._new_room is None or self._new_room[0] is not room:
            self.pictures.show_walls(walls, room, 3 if self._meter.bands > _SLOW_BANDS else 2)
            self._new_room = room, time.perf_counter()
            self.mark_stale()
        return True

    def tick(self, state: ViewState, now: float, held: bool) -> None:
        """Solve the room, paint the whole picture, and read opacities, once it rests."""
        self.idle.tick(state, held)
        room, walls = state.room, self._walls
        if room is None or ((walls is None or walls.room is room) and room.is_solved):
            return
        rests = not held or self._new_room is None or now - self._new_room[1] >= _PAINT_REST_S
        if rests:
            self._painting.want(RoomJob(room, self.image, walls))

    def take_room(self, state: ViewState | None) -> SceneRoom | None:
        """Take the state's room once it is solved, with its picture."""
        solved = None
        for done in self._painting.take():
            if done.error:
                self._notice.show(done.error, kind="error")
            elif state is not None and state.room is done.job.room:
                solved = done.room
                if done.image is not None and done.job.walls is self._walls:
                    self.pictures.show(done.image, done.packed)
                    self._walls = done.walls
                    self.mark_stale()
        return solved

    def _awaits_groups(self, state: ViewState) -> bool:
        """Return True if the lights shine from groups that the next cast will bring."""
        rigs = (light_rig(rows, state.room) for rows in (state.lights, state.other or ()))
        light_groups = {group for rig in rigs if rig is not None for group in rig.groups if group}
        image, cast = self.pictures.image, {group.name for group in state.shading.groups}
        awaits = image is not None and not light_groups <= {*image.groups} and light_groups <= cast
        if awaits:
            self.pictures.current = False
        return awaits

    def take_tables(self) -> bool:
        """Take computed tables; return True if there are any."""
        messages = self._tabling.take()
        if "" in messages:
            self._band = self._band or 0
        return bool(messages)

    def probe(self, state: ViewState, place: tuple[float, float] | None, held: bool) -> bool:
        """Read the pixel under the mouse; nothing if a button is down.

        Return True if the values have changed, so that the next frame has others to show.
        """
        before, self.under_mouse = self.under_mouse, self._reading_at(state, place, held)
        return self.under_mouse is not before

    def _reading_at(
        self, state: ViewState, place: tuple[float, float] | None, held: bool
    ) -> PixelProbe | None:
        """Return the values at a place of the picture; None if there are none.

        While a picture is being drawn, the last reading stays, as a new one would wait for it.
        """
        image, cast = self.idle.readable(), self._cast
        if self.pictures.idle is not None and self.pictures.idle.stereo:
            return None
        if self.pictures.image is not None and image is None:
            return self.under_mouse  # until it is recomposed
        if held or place is None or image is None or cast is None or not self.pictures.framebuffer:
            return None
        lights = state.other if state.other and place[0] > state.divide else state.lights
        rig, spec = light_rig(lights, state.room), shown_spec(state)
        if rig is None:
            return None
        if self._drawing or self._coarse:
            return self.under_mouse
        if not self.pictures.current:
            return None
        width, height = image.size
        pixel = min(int(place[0] * width), width - 1), min(int(place[1] * height), height - 1)
        patient = state.interface.overlays.patient
        key = image, lights, spec, pixel, patient
        if self._reading is None or key != self._reading[0]:
            code, reading = self.pictures.code(*pixel), None
            camera, document = cast.job.camera, cast.job.document
            volume = document.volume if document.image is None else None
            estimated = self.idle.is_estimated
            with suppress(VolspecError):  # reported when it was relit
                reading = read(image, camera, volume, rig, spec, pixel, code, patient, estimated)
            self._reading = key, reading
        return self._reading[1]

    def refines(self, state: ViewState) -> bool:
        """Return True if the picture is of the state's view, and coarse or not recomposed yet."""
        cast = self._cast
        if cast is None or cast.job.camera != state.view.camera(cast.job.document.volume):
            return False
        return not self.sharp or cast.cast_pass.steps != "own" or self.idle.readable() is None

    def point_mm(self, place: tuple[float, float]) -> Vector | None:
        """Return the first hit at a place of the picture in the world; None if there is none."""
        image, cast = self.idle.readable() or self.pictures.image, self._cast
        if image is None or cast is None or self.side_by_side:
            return None
        width, height = image.size
        pixel = min(int(place[0] * width), width - 1), min(int(place[1] * height), height - 1)
        position = place_mm(image, cast.job.camera, pixel)
        return None if position is None else vector(position)

    def update_error_map(self, state: ViewState, held: bool) -> bool:
        """Request the error map if it is on; return True if a new one has come."""
        image = self.idle.readable()
        if state.interface.error_map and not held and self.sharp and image is not None:
            self.error_map = self._error_map
            self._error_map.want(image, state)
        return self._error_map.take()

    def painted_picture(self, area: Area, displayed: ViewState | None) -> Painted | None:
        """Return the picture and its place behind the panels; its aspect ratio stays."""
        x, y, width, height = area
        if not self.pictures.framebuffer or self._cast is None or displayed is None:
            return None
        columns, rows = self._shape
        if self.pictures.idle is not None:
            columns, rows = self.pictures.idle.size
        fit_width = width if self._shape == displayed.size else height * columns / rows
        high = float(height)
        if self.side_by_side:
            fit_width = min(width, height * columns / rows)
            high = fit_width * rows / columns
        left, top = x + (width - fit_width) / 2, y + (height - high) / 2
        to = self.shown_at = left, top, left + fit_width, top + high
        return Painted(self.pictures.framebuffer, self.pictures.size, to, area)

    @property
    def side_by_side(self) -> bool:
        """True if both eyes' pictures are next to each other."""
        idle = self.pictures.idle
        return idle is not None and idle.size != idle.images[0].size

    def missing_message(self, displayed: ViewState | None, painted: Painted | None) -> str:
        """Return the message in place of a picture, or on an empty one; empty for no message."""
        if painted is not None:
            # Not while it is coarse: a small object may lie between its rays.
            return _NOTHING if self.sharp and self._blank else ""
        if self.fault:
            return self.fault
        if self._cast is not None and displayed is not None and light_rig(displayed.lights) is None:
            return _DARK
        return "Opening …" if displayed is None else "Casting …"

    def close(self) -> None:
        """Release everything, without waiting for tables."""
        self._tabling.close(0.0)
        self._painting.close(0.0)
        self.idle.close()
        self._error_map.close()
        self.pictures.close()
        self.slices.close()
