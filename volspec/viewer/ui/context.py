"""Context of the panels besides the state: results of services, rectangles, text under edit.

    app -> [context] -> panels -> app

None of it is part of a picture, and undo does not know it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from imgui_bundle import imgui

from volspec.raycast import CoefficientImage
from volspec.viewer.model.edit import Change, Command, after
from volspec.viewer.model.light_rows import Rows
from volspec.viewer.model.palette_targets import DesignStatus
from volspec.viewer.model.projection import Projection
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.error_map import ErrorMapTexture
from volspec.viewer.work.probe import Reading
from volspec.viewer.work.session_store import RecentFile
from volspec.viewer.work.slice_pictures import SlicePictures


@dataclass(slots=True)
class Search:
    """The command palette while it is open.

    Parameters
    ----------
    at : int
        The row that Enter takes.
    fresh : bool
        Whether the field is to take the keyboard.
    picked : Entry of `volspec.viewer.ui.commands`, optional
        Done once a frame has been shown without the palette.
    waits : int
        Frames until then.
    """

    text: str = ""
    at: int = 0
    fresh: bool = True
    picked: Any = None
    waits: int = 0


@dataclass(slots=True)
class LightsPanelState:
    """State of the lights panel from frame to frame.

    Parameters
    ----------
    row : int
        The light that was chosen in the last frame.
    tab, to_tab : str
        The open tab, and the one to open; empty for none.
    part : int
        The spectrum of the chosen light that is drawn.
    pen : (x, y), optional
        The pen in the last frame, while it draws.
    top : float
        Power at the plot's upper edge, which stays while the pen draws.
    text, text_of
        A notation that is being typed, and its light and part.
    naming, renaming : int
        The saved state and the light that are being renamed; -1 is none.
    name : str
        The new name.
    focus : bool
        Whether the name's field waits for the keyboard.
    complaint : str
        Error in the typed notation.
    complaint_of : ((light, part), rows)
        The spectrum it is about, and the lights as they were then.
    """

    row: int = 0
    tab: str = ""
    to_tab: str = ""
    part: int = 0
    pen: tuple[float, float] | None = None
    top: float = 1.0
    text: str = ""
    text_of: tuple[str, int] = ("", 0)
    naming: int = -1
    name: str = ""
    focus: bool = False
    complaint: str = ""
    complaint_of: tuple[tuple[int, int], Rows] = ((0, 0), ())
    renaming: int = -1

    def rename(self, index: int, rows: Rows) -> None:
        """Begin to rename a light."""
        self.renaming, self.name, self.focus = index, rows[index].name, True
        self.naming, self.row = -1, -1  # a name at a time; the row is scrolled to

    def complain(self, why: str, place: tuple[int, int], rows: Rows) -> None:
        """Set the error of the notation that was typed for a light's part."""
        self.complaint, self.complaint_of = why, (place, rows)

    def complaint_at(self, place: tuple[int, int], rows: Rows) -> str:
        """Return a part's error; empty once anything else of the lights is edited."""
        about, then = self.complaint_of
        return self.complaint if about == place and then is rows else ""


@dataclass(slots=True)
class LibraryState:
    """State of the library of lights or of materials from frame to frame.

    Parameters
    ----------
    complaint : str
        Why the last choice could not be added.
    kelvin : float
        Temperature on the slider of lights.
    """

    search: str = ""
    complaint: str = ""
    kelvin: float = 3200.0


@dataclass(frozen=True, slots=True)
class Results:
    """Results of the viewer's services by this frame.

    Parameters
    ----------
    image : CoefficientImage, optional
        The last cast.
    whole : bool
        Whether it has the picture's full resolution.
    shown_at : (left, top, right, bottom)
        The picture's last place in the window.
    fault : str
        Why there is no picture; empty while one is there or awaited.
    fps : float
        Frames per second, while something moves.
    ms : {stage: float}
        Last duration of each stage.
    recent : tuple of RecentFile
        The newest first.
    """

    image: CoefficientImage | None = None
    whole: bool = False
    shown_at: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    fault: str = ""
    fps: float = 0.0
    ms: dict[str, float] = field(default_factory=dict)
    under_mouse: Reading | None = None
    error_map: ErrorMapTexture | None = None
    slices: SlicePictures | None = None
    design: DesignStatus = field(default_factory=DesignStatus)
    recent: tuple[RecentFile, ...] = ()


@dataclass(slots=True)
class UiContext:
    """The panels' context; the app updates it every frame.

    Parameters
    ----------
    scale : float
        Pixels of the window for each at 96 dpi.
    areas : {name: (x, y, width, height)}
        Rectangles of what was drawn: for overlays, and for the trace.
    requests : list of str
        Names of commands that the app does; ``open PATH`` and ``say TEXT`` have an argument.
    commands : Search, optional
        The command palette; None if it is closed.
    menu : bool
        Whether the first menu is to open now.
    front, item : str
        The panel that is to come to the front now, and its item that is to take the keyboard.
    popup : str
        The popup of the palette that is to open now.
    member : (kind, index)
        The light or the material that it is about.
    """

    scale: float = 1.0
    areas: dict[str, tuple[int, int, int, int]] = field(default_factory=dict)
    requests: list[str] = field(default_factory=list)
    results: Results = field(default_factory=Results)
    commands: Search | None = None
    menu: bool = False
    front: str = ""
    item: str = ""
    lights: LightsPanelState = field(default_factory=LightsPanelState)
    library: LibraryState = field(default_factory=LibraryState)
    popup: str = ""
    member: tuple[str, int] = ("", 0)
    _projected: tuple[Any, Projection] | None = None

    def px(self, size: float) -> float:
        """Return a size in the window's pixels."""
        return size * self.scale

    def say(self, message: str) -> None:
        """Show the user a message, if there is one."""
        if message:
            self.requests.append(f"say {message}")

    def edited(self, state: ViewState, change: Change) -> ViewState:
        """Return an edited state; say why it is refused, or what it left out."""
        new, message = after(change, state)
        self.say(message)
        return new

    def run(self, state: ViewState, command: Command) -> ViewState:
        """Return a state after a command; request it from the app if it is no edit."""
        if command.change is None:
            self.requests.append(command.name)
            return state
        return self.edited(state, command.change)

    def projection(self, state: ViewState) -> Projection:
        """Return the projection of the state's camera into the window."""
        of = state.view, state.document.volume, self.areas["picture"]
        if self._projected is None or self._projected[0] != of:
            camera = state.view.camera(state.document.volume)
            self._projected = of, Projection(camera, self.areas["picture"])
        return self._projected[1]

    def note(self, name: str) -> None:
        """Record the rectangle of the last item."""
        (x, y), (right, bottom) = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.areas[name] = (int(x), int(y), int(right - x), int(bottom - y))
