"""The picture on the screen: relit when something has changed, in bands if that takes long.

    casts, state -> [screen] -> Painted -> window

LUTs of models that no shader draws are made in the background; the old picture stays meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from volspec.errors import TableCancelled, VolspecError, one_line
from volspec.raycast import CoefficientImage
from volspec.relight import LightRig, RelightSpec
from volspec.relight.tables import HostTables, TableKey, is_tabled
from volspec.viewer.model.light_rows import rig_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker
from volspec.viewer.work.casts import CastDone
from volspec.viewer.work.error_map import ErrorMapTexture
from volspec.viewer.work.meter import Meter
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.pictures import Painted, Pictures
from volspec.viewer.work.probe import Reading, read
from volspec.viewer.work.slice_pictures import SlicePictures

# A light must be still for so long before its tables are computed, which may take seconds.
_REST_S = 0.1


class TableWorker(LatestWorker[tuple[TableKey, ...], str]):
    """Computes tables in a thread; its results are error messages, empty if all went well."""

    _name = "volspec-tables"

    def __init__(self, wake: Callable[[], object], tables: HostTables) -> None:
        super().__init__(wake)
        self._tables = tables

    def _answers(self, job: tuple[TableKey, ...]) -> Iterator[str]:
        if not self._rests(_REST_S):
            return
        try:
            for key in job:
                self._tables.texels(key, self._superseded)
        except TableCancelled:
            return
        except MemoryError:
            yield "no memory for the table"
        except VolspecError as error:
            yield one_line(error)
        else:
            yield ""


# The longest that the notice of a table is shown; it goes when the table is there.
_TABLE_S = 60.0
_NOTHING = "Nothing is seen: the opacity is 0 everywhere in view, or the view misses it"
Area = tuple[int, int, int, int]


class Screen:
    """Relights the last cast when something has changed."""

    def __init__(
        self, context: Any, wake: Callable[[], object], meter: Meter, trace: Trace, notice: Notice
    ) -> None:
        self.pictures = Pictures(context)
        self._tabling = TableWorker(wake, self.pictures.tables)
        self._tables: tuple[TableKey, ...] = ()  # those that the picture waits for
        self.slices = SlicePictures(context)
        self.image: CoefficientImage | None = None  # the last cast
        self.whole = False  # whether it has the picture's full resolution
        self.fault = ""  # why there is no picture; empty while one is there or awaited
        self.under_mouse: Reading | None = None
        self.error_map: ErrorMapTexture | None = None  # once it was asked for
        self.shown_at = 0.0, 0.0, 0.0, 0.0  # left, top, right, bottom in the window
        self._meter, self._trace, self._notice = meter, trace, notice
        self._cast: CastDone | None = None
        self._shape = (0, 0)  # size of the cast whose picture is shown
        self._relit = self._coarse = self._drawing = self._hurries = False
        self._band = 0  # the next one to draw
        self._working_out = ""
        self._error_map = ErrorMapTexture(context, wake)
        self._read_of: tuple[Any, ...] | None = None
        self._reading: Reading | None = None

    @property
    def busy(self) -> bool:
        """True while tables or an error map are computed."""
        return self._tabling.busy or self._error_map.busy

    @property
    def ready(self) -> bool:
        """True if the picture is drawn to its end, or there is none."""
        return self._relit or self.pictures.image is None

    def take(self, done: CastDone, state: ViewState | None) -> None:
        """Take a pass of a cast that has ended."""
        how = "cancel" if done.image is None else "cast"
        size = [-(-side // done.divisor) for side in done.job.size]
        if done.error:
            self._notice.say(done.error)
            how = "error"
            if self._cast is None or self._cast.job.document is not done.job.document:
                # The picture that is shown is another document's.
                self.fault = one_line(done.error)
                self._cast = self.image = None
        self._trace.note(how, "cast", done.ms, divisor=done.divisor, size=size)
        if done.image is None or state is None or done.job.document is not state.document:
            return
        try:
            self.pictures.show(done.image, done.packed)
        except VolspecError as error:
            self._notice.say(str(error))
            return
        if done.divisor == 1 and not done.image.alpha.any():
            self._notice.say(_NOTHING)
        # What was packed is in a texture now.
        self._cast, self.fault = replace(done, packed=None), ""
        self.stale()
        self.image, self.whole = done.image, done.divisor == 1
        self._meter.ms["cast"] = done.ms

    def stale(self) -> None:
        """Mark the picture as stale: it no longer shows the state's light."""
        # If lights follow each other, as under a key held down, the last bands would never come.
        self._hurries |= self._band > 0
        self._relit, self._band = False, 0

    def relight(self, state: ViewState, held: bool) -> bool:
        """Begin to draw the picture under the state's lights, unless it shows them.

        GL calls after this wait for the drawing: panels are best made meanwhile. A slow relight
        draws one band a frame, unless the light before was not drawn to its end, and fewer pixels
        while a mouse button is held. Return True if the next frame has something to show.
        """
        self._drawing = False
        if self._coarse and not held:
            self.stale()
        if self._relit or self.pictures.image is None:
            return False
        self._relit = True
        self.pictures.repaint(state.transfer.basis)
        self.image = self.pictures.image
        # Fewer pixels would need tables of their own.
        few = self.whole and self._meter.bands > 1 and not is_tabled(state.relight.viewing.model)
        self._coarse = held and few
        whole = self.whole and not self._coarse
        bands = 1 if held or self._hurries or not whole else self._meter.bands
        first, self._band = self._band % bands, 0
        rig, other = rig_of(state.lights), rig_of(state.other) if state.other else None
        try:
            if self._tables_missing(rig, state.relight, other):
                return False
            band = first / bands, (first + 1) / bands
            relit = self.pictures.relight(
                rig, state.relight, other, state.divide, self._coarse, band
            )
        except VolspecError as error:
            self._notice.say(one_line(error))
            return False
        self._drawing = relit is not None
        self._relit = not self._drawing or first + 1 == bands
        self._band = 0 if self._relit else first + 1
        if self._relit:
            self._hurries = False
            if self._cast is not None:
                self._shape = self._cast.job.size
        self._meter.relights(relit, first == 0, self._relit, whole)
        return True

    def _tables_missing(
        self, rig: LightRig | None, spec: RelightSpec, other: LightRig | None
    ) -> bool:
        """Return True if the light must wait for tables, which are then computed."""
        missing = self.pictures.missing(rig, spec, other)
        if missing:
            self._working_out = f"{spec.viewing.model}: working out its table …"
            self._notice.say(self._working_out, _TABLE_S)
            if missing != self._tables:
                self._tabling.request(missing)
        elif self._tables and self._notice.text == self._working_out:
            self._notice.say("")
        self._tables = missing
        return bool(missing)

    def tabled(self) -> bool:
        """Take computed tables; return True if there are any."""
        errors = self._tabling.take()
        for error in errors:
            if error:
                self._tables = ()
                self._notice.say(error)
            else:
                self._relit = False
        return bool(errors)

    def probe(self, state: ViewState, place: tuple[float, float] | None, held: bool) -> None:
        """Read the pixel under the mouse; none if a button is down.

        While a picture is being drawn the last reading stays, as reading waits for the drawing.
        """
        shown, self.under_mouse = self.under_mouse, None
        image, cast = self.pictures.image, self._cast
        if held or place is None or image is None or cast is None or not self.pictures.framebuffer:
            return
        lights = state.other if state.other and place[0] > state.divide else state.lights
        rig = rig_of(lights)
        if rig is None:
            return
        if self._drawing:
            self.under_mouse = shown
        if self._drawing or not self.pictures.current:
            return
        width, height = image.size
        pixel = min(int(place[0] * width), width - 1), min(int(place[1] * height), height - 1)
        key = image, lights, state.relight, pixel
        if key != self._read_of:
            self._read_of = key
            code = self.pictures.code(*pixel)
            camera, volume = cast.job.camera, cast.job.document.volume
            try:
                self._reading = read(image, camera, volume, rig, state.relight, pixel, code)
            except VolspecError:  # shown when it was relit
                self._reading = None
        self.under_mouse = self._reading

    def update_error_map(self, state: ViewState, held: bool) -> bool:
        """Request the error map if it is on; return True if a new one has come."""
        image = self.pictures.image
        if state.interface.error_map and not held and self.whole and image is not None:
            self.error_map = self._error_map
            self._error_map.want(image, state.lights, state.relight)
        return self._error_map.take()

    def painted(self, area: Area, shown: ViewState | None) -> Painted | None:
        """Return the picture with its place behind the panels; its aspect ratio is kept."""
        x, y, width, height = area
        if not self.pictures.framebuffer or self._cast is None or shown is None:
            return None
        columns, rows = self._shape
        wide = width if self._shape == shown.size else height * columns / rows
        left = x + (width - wide) / 2
        to = self.shown_at = left, y, left + wide, y + height
        return Painted(self.pictures.framebuffer, self.pictures.size, to, area)

    def absence(self, shown: ViewState | None) -> str:
        """Return why no picture is painted of a state."""
        dark = self._cast is not None and shown is not None and rig_of(shown.lights) is None
        return "No light is on" if dark else self.fault or "Opening …"

    def close(self) -> None:
        """Release everything, without waiting for tables."""
        self._tabling.close(0.0)
        self._error_map.close()
        self.pictures.close()
        self.slices.close()
