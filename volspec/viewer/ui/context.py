"""Surroundings of the panels besides the state: results of services, rectangles, text under edit.

    app -> [context] -> panels -> app

Nothing of it is part of a picture, and undo does not know it.
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
    """What is looked for in the command palette.

    Parameters
    ----------
    text : str
    at : int
        The row that Enter takes.
    fresh : bool
        Whether the field is to take the keyboard.
    picked : Any
        The command that was picked; it is done once the window is seen without the palette.
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
    """What the panel of lights keeps from frame to frame.

    Parameters
    ----------
    row : int
        The light that was chosen in the last frame.
    tab : str
        The tab that is open.
    to_tab : str
        The one that shall be; empty where nobody asked.
    part : int
        Of the chosen light's spectra, the one that is drawn.
    pen : (x, y), optional
        Where it was in the last frame, while it draws.
    top : float
        Power at the plot's upper edge, which stays while it draws.
    text, text_of
        A notation that is being typed, and for which light and part.
    naming : int
        The saved state that is being renamed; -1 is none.
    name : str
        What it shall be called.
    focus : bool
        Whether its field waits for the keyboard.
    complaint : str
        What is wrong with what was typed.
    complaint_of : ((light, part), rows)
        For which spectrum that was, and the lights as they were then.
    renaming : int
        The light that is being renamed; -1 is none.
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
        """A notation, of a light's part, was no light."""
        self.complaint, self.complaint_of = why, (place, rows)

    def complaint_at(self, place: tuple[int, int], rows: Rows) -> str:
        """What stands under a part's field; gone once anything else of the lights is edited."""
        about, then = self.complaint_of
        return self.complaint if about == place and then is rows else ""


@dataclass(slots=True)
class LibraryState:
    """What a library, of lights or of materials, keeps from frame to frame.

    Parameters
    ----------
    search : str
        What is looked for.
    complaint : str
        Why it could not be added.
    kelvin : float
        The temperature that the slider of lights shows.
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
        What was cast last.
    whole : bool
        Whether that is as fine as the picture.
    shown_at : (left, top, right, bottom)
        Where the picture was drawn last.
    fault : str
        Why there is no picture; empty while one is there or awaited.
    fps : float
        Frames per second, while something moves.
    ms : {stage: float}
        What each stage took last.
    under_mouse : Reading, optional
        What of the picture is under the mouse.
    error_map : ErrorMapTexture, optional
        The error map.
    slices : SlicePictures, optional
        What the slices are drawn by.
    design : DesignStatus
        What the palette's threads have to say.
    recent : tuple of RecentFile
        Files opened lately.
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
    """The panels' surroundings; new values every frame.

    Parameters
    ----------
    scale : float
        Pixels of the window for each at 96 dpi.
    areas : {name: (x, y, width, height)}
        Where things were drawn: for what stands over them, and for the trace.
    requests : list of str
        Actions that are the app's to do.
    results : Results
    commands : Search, optional
        The command palette; None where it is closed.
    menu : bool
        Whether the first menu is to open now.
    front : str
        The panel that is to come to the front now.
    item : str
        Its item that is to take the keyboard.
    lights : LightsPanelState
    library : LibraryState
    popup : str
        What of the palette is to open now.
    member : (kind, index)
        The light or the material that this is about.
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
        """A size in the window's pixels."""
        return size * self.scale

    def say(self, message: str) -> None:
        """Have a message shown to the user, if there is one."""
        if message:
            self.requests.append(f"say {message}")

    def edited(self, state: ViewState, change: Change) -> ViewState:
        """Return an edited state; say why it is refused, or what it left out."""
        new, message = after(change, state)
        self.say(message)
        return new

    def run(self, state: ViewState, command: Command) -> ViewState:
        """Return a state after a command; what is the app's to do is asked of it."""
        if command.change is None:
            self.requests.append(command.name)
            return state
        return self.edited(state, command.change)

    def projection(self, state: ViewState) -> Projection:
        """Where the state's camera shows things in the window."""
        of = state.view, state.document.volume, self.areas["picture"]
        if self._projected is None or self._projected[0] != of:
            camera = state.view.camera(state.document.volume)
            self._projected = of, Projection(camera, self.areas["picture"])
        return self._projected[1]

    def note(self, name: str) -> None:
        """Note down where the last item is."""
        (x, y), (right, bottom) = imgui.get_item_rect_min(), imgui.get_item_rect_max()
        self.areas[name] = (int(x), int(y), int(right - x), int(bottom - y))
