"""The viewer's state, frozen: every change makes another one, and undo goes back to one.

inputs, panels -> [state] -> cast, relight, frame
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from volspec.raycast import RaycastSpec
from volspec.relight import RelightSpec
from volspec.transfer import Transfer
from volspec.viewer.model.document import Document
from volspec.viewer.model.light_rows import Fade, LightState, Rows
from volspec.viewer.model.palette_targets import PaletteState, Pick
from volspec.viewer.model.view import View


@dataclass(frozen=True, slots=True)
class Aids:
    """Overlays of the picture.

    Parameters
    ----------
    cube, scale : bool
        The orientation cube and the scale bar.
    crop, planes : bool
        The crop's box and the clip planes, with handles; they cut also if they are hidden.
    plane : int
        Index of the chosen clip plane.
    outlines : bool
        The slices' outlines.
    patient : bool, optional
        Name directions by the patient's body; None if the volume decides.
    """

    cube: bool = True
    scale: bool = True
    crop: bool = False
    planes: bool = True
    plane: int = 0
    outlines: bool = True
    patient: bool | None = None


@dataclass(frozen=True, slots=True)
class Slices:
    """Positions of the slices, and how they are shown.

    Parameters
    ----------
    at : (x, y, z)
        Along each axis of the voxels, 0 to 1 of the volume.
    lit : bool
        Shown with the transfer function's materials under the lights; else as greys.
    greys : (low, high), optional
        Values shown black and white, 0 to 1 of the volume's range; None for the range of most
        values.
    """

    at: tuple[float, float, float] = (0.5, 0.5, 0.5)
    lit: bool = True
    greys: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Interface:
    """Settings of the window, which undo leaves as they are.

    Parameters
    ----------
    logarithmic : bool
        Scale of the histogram.
    keys : bool
        The cheat sheet is open.
    light : int
        The chosen row of the lights; a state clamps it to its lights.
    probe : bool
        Show the values under the mouse.
    error_map : bool
        Show the error map over the picture.
    panels : set of str
        Titles of the open panels.
    fade_s : float
        Duration of a fade to a saved light state.
    pick : Pick
        Choices in the palette.
    part : int
        The point, region, surface or label whose details are shown.
    """

    dark: bool = True
    logarithmic: bool = True
    keys: bool = False
    light: int = 0
    probe: bool = True
    error_map: bool = False
    panels: frozenset[str] = frozenset({"Lights", "Viewing", "Transfer", "Palette"})
    aids: Aids = field(default_factory=Aids)
    slices: Slices = field(default_factory=Slices)
    fade_s: float = 1.5
    pick: Pick = field(default_factory=Pick)
    part: int = 0


@dataclass(frozen=True, slots=True)
class ViewState:
    """Everything that a picture is made of.

    Parameters
    ----------
    document : Document
        The scene that is open.
    shift : float
        Sum of the shifts of the transfer function's points.
    size : (width, height)
        Pixels of the whole picture.
    other : tuple of LightRow, optional
        The lights at the right of the divide, to compare with.
    divide : float
        Position of the divide, 0 to 1 of the picture's width.
    fade : Fade, optional
        Start of the fade to this state's lights, as long as it lasts.
    palette : PaletteState
        Targets of the palette; the designed spectra are in ``transfer`` and ``lights``.
    thickness : float
        Factor by which the transfer function was thickened.
    unthickened : (Transfer, thickness, Transfer), optional
        The transfer function before it was thickened, its thickness, and the result: valid as long
        as that is ``transfer``. Opacities that were rounded to 1 come back from it.
    """

    document: Document
    view: View
    transfer: Transfer
    shading: RaycastSpec
    lights: Rows
    relight: RelightSpec
    shift: float = 0.0
    size: tuple[int, int] = (512, 512)
    other: Rows | None = None
    divide: float = 0.5
    interface: Interface = field(default_factory=Interface)
    saved_lights: tuple[LightState, ...] = ()
    fade: Fade | None = None
    palette: PaletteState = field(default_factory=PaletteState)
    thickness: float = 1.0
    unthickened: tuple[Transfer, float, Transfer] | None = None

    def __post_init__(self) -> None:
        chosen = min(max(self.interface.light, 0), max(len(self.lights) - 1, 0))
        if chosen != self.interface.light:
            object.__setattr__(self, "interface", replace(self.interface, light=chosen))

    @classmethod
    def first(cls, document: Document, size: tuple[int, int]) -> ViewState:
        """Return the state of a scene as its file has it."""
        return cls(
            document,
            document.view,
            document.transfer,
            document.shading,
            document.lights,
            document.relight,
            size=size,
        )
