"""Context of the panels: service results, rectangles, text being edited; all but the state.

    app -> [context] -> panels -> app

It is not part of the state, and undo does not restore it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from imgui_bundle import imgui

from volspec.camera import Projection
from volspec.image import CoefficientImage
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.edit import Change, Command, after
from volspec.viewer.model.light_rows import Rows
from volspec.viewer.model.palette_targets import DesignStatus
from volspec.viewer.model.rendition import Figures, Measured
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.demonstrations import Thumbnails
from volspec.viewer.work.notify import Message
from volspec.viewer.work.probe import PixelProbe
from volspec.viewer.work.screen import ErrorMapTexture
from volspec.viewer.work.session_store import RecentFile
from volspec.viewer.work.slice_pictures import SlicePictures


def tip(text: str, at_once: bool = False, greyed: bool = False) -> None:
    """Show a tooltip for the last item, after a delay or at once; if ``greyed``, even disabled."""
    flags = imgui.HoveredFlags_
    when = flags.none if at_once else flags.delay_normal
    if imgui.is_item_hovered(when | flags.allow_when_disabled if greyed else when):
        imgui.set_tooltip(text)


class Request(NamedTuple):
    """A command for the app to run after the panels are drawn."""

    name: str  # of a `Command`, or "message", "warning", "choose", "step" or "loop"
    # The message, the path that "open" opens without a dialog, "key=value" of a choice, or a step.
    argument: str = ""


@dataclass(slots=True)
class Search:
    """The command palette while it is open."""

    text: str = ""
    row: int = 0  # the row that Enter picks
    fresh: bool = True  # focus the field
    picked: Any = None  # the `volspec.viewer.ui.commands.Entry` to run
    waits: int = 0  # frames until then, so that the palette has disappeared


@dataclass(slots=True)
class LightsPanelState:
    """State of the lights panel from frame to frame."""

    row: int = 0  # the light that was chosen in the last frame
    tab: str = ""
    to_tab: str = ""  # the tab to open; empty for none
    part: int = 0  # the spectrum of the chosen light that the pen edits
    of_mix: bool = False  # rendition is that of the mix
    pen: tuple[float, float] | None = None  # (x, y) in the last frame, while it draws
    top: float = 1.0  # power at the plot's upper edge, which stays while the pen draws
    text: str = ""  # a notation that is being typed,
    text_of: tuple[str, int] = ("", 0)  # and its light and part
    naming: int = -1  # the saved state that is being renamed; -1 for none
    renaming: int = -1  # the light that is being renamed; -1 for none
    name: str = ""  # the new name
    focus: bool = False  # focus the name's field
    complaint: str = ""  # error in the typed notation,
    # with its (light, part) and the lights as they were then
    complaint_of: tuple[tuple[int, int], Rows] = ((0, 0), ())

    def rename(self, index: int, rows: Rows) -> None:
        """Start renaming a light."""
        self.renaming, self.name, self.focus = index, rows[index].name, True
        self.naming, self.row = -1, -1  # one name at a time; scroll to the row

    def complain(self, why: str, place: tuple[int, int], rows: Rows) -> None:
        """Set the error in the notation that was typed for a light's part."""
        self.complaint, self.complaint_of = why, (place, rows)

    def complaint_at(self, place: tuple[int, int], rows: Rows) -> str:
        """Return a part's error; empty after any other edit of the lights."""
        about, then = self.complaint_of
        return self.complaint if about == place and then is rows else ""


@dataclass(slots=True)
class LibraryState:
    """State of the library of lights or of materials from frame to frame."""

    search: str = ""
    complaint: str = ""  # error message if the last choice could not be added
    kelvin: float = 3200.0  # temperature on the slider of lights


@dataclass(frozen=True, slots=True)
class Results:
    """Results of the viewer's services as of this frame."""

    image: CoefficientImage | None = None  # the last cast
    sharp: bool = False  # True if it has the picture's full resolution
    # (left, top, right, bottom) of the picture in the window
    shown_at: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    side_by_side: bool = False  # both eyes' pictures are shown next to each other
    fault: str = ""  # error message if there is no picture; empty while one is awaited
    fps: float = 0.0  # while something moves
    ms: dict[str, float] = field(default_factory=dict)  # last duration of each stage
    under_mouse: PixelProbe | None = None
    error_map: ErrorMapTexture | None = None
    slices: SlicePictures | None = None
    step: int = 0  # the time step that was wanted last
    playing: tuple[bool, bool] = (False, True)  # time steps play, and in a loop
    design: DesignStatus = field(default_factory=DesignStatus)
    recent: tuple[RecentFile, ...] = ()
    messages: tuple[Message, ...] = ()  # the last is the newest
    thumbnails: Thumbnails | None = None
    rendition: tuple[Measured, Figures | None] | None = None  # of the lights measured last


# Frames to ask for a text's focus after a click: imgui takes move, press and release one per frame.
CLICK_FRAMES = 4


@dataclass(slots=True)
class UiContext:
    """The panels' context; the app updates it every frame."""

    scale: float = 1.0  # window pixels per pixel at 96 dpi
    # {name: (x, y, width, height)} of items: for overlays, and for the trace
    areas: dict[str, tuple[int, int, int, int]] = field(default_factory=dict)
    requests: list[Request] = field(default_factory=list)
    results: Results = field(default_factory=Results)
    commands: Search | None = None  # the command palette; None if it is closed
    menu: str = ""  # the open menu
    menu_step: int = 0  # the step to another menu that an arrow was pressed for
    text_wanted: tuple[str, int] = "", 0  # the text to focus, and for how many more frames
    focus_menu: str = ""  # the menu whose title to focus now, and then to open,
    open_menu: str = ""  # and the menu to open now
    start: bool = False  # the start screen is open
    # Where the picture was clicked with the right button in this frame, 0 to 1 of its sides,
    clicked: tuple[float, float] | None = None
    picked: str = ""  # and the material there,
    picked_mm: float | None = None  # and its depth along the camera's axis
    front: str = ""  # the panel to bring to the front now,
    item: str = ""  # and its item to focus
    lights: LightsPanelState = field(default_factory=LightsPanelState)
    labels_search: str = ""
    library: LibraryState = field(default_factory=LibraryState)
    layers_wanted: bool = False  # the panel of opacities is visible, and layers can show them
    # The state that the picture shows instead of the present one, and whether it keeps changing.
    preview: Callable[[ViewState], ViewState] | None = None
    plays: bool = False
    time_bar: float = 0.0  # height of the bar of time steps below the picture; 0 without one
    popup: str = ""  # the popup of the palette to open now,
    member: tuple[str, int] = ("", 0)  # and the (kind, index) of the light or material it is about
    _projected: tuple[Any, Projection] | None = None

    def px(self, size: float) -> float:
        """Convert a size from pixels at 96 dpi to the window's pixels."""
        return size * self.scale

    def request(self, name: str, argument: str = "") -> None:
        """Request a command from the app."""
        self.requests.append(Request(name, argument))

    def notify(self, message: str) -> None:
        """Show the user a message, if there is one."""
        if message:
            self.request("message", message)

    def edited(self, state: ViewState, change: Change) -> ViewState:
        """Return an edited state; show the edit's message and hint, if it has one."""
        new, message, hint = after(change, state)
        if message:
            self.request("warning", message)
        self.notify(hint)
        return new

    def run(self, state: ViewState, command: Command | str) -> ViewState:
        """Run a command, or one by name; it is requested from the app unless it is an edit."""
        if isinstance(command, str):
            command = BY_NAME[command]
        if command.change is None:
            self.request(command.name)
            return state
        return self.edited(state, command.change)

    def projection(self, state: ViewState) -> Projection:
        """Return the projection of the state's camera into the window."""
        of = state.view, state.document.volume, self.areas["picture"]
        if self._projected is None or self._projected[0] != of:
            camera = state.view.camera(state.document.volume)
            self._projected = of, Projection(camera, self.areas["picture"])
        return self._projected[1]

    def note(self, name: str, text: str = "", greyed: bool = False) -> None:
        """Record the rectangle of the last item, and give the item a tooltip, if any."""
        (x, y), (right, bottom) = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.areas[name] = (int(x), int(y), int(right - x), int(bottom - y))
        if text:
            tip(text, greyed=greyed)
