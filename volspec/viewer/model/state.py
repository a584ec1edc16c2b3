"""The viewer's state, frozen: every change makes another one.

    inputs, panels -> [state] -> cast, relight, frame

A state is what undo goes back to; window, threads and GPU handles are elsewhere.
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

# Open at first.
PANELS = frozenset({"Lights", "Viewing", "Transfer", "Palette"})


@dataclass(frozen=True, slots=True)
class Aids:
    """What stands over the picture.

    Parameters
    ----------
    cube, scale : bool
        The orientation cube and the scale bar.
    crop, planes : bool
        The crop's box and the clip planes, with handles; they cut whether seen or not.
    plane : int
        The clip plane that stands out.
    outlines : bool
        Where the slices lie.
    patient : bool, optional
        Whether directions are named by the patient's body; None where the volume says.
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
    """Where the slices lie and how they are shown.

    Parameters
    ----------
    at : (x, y, z)
        Along each axis of the voxels, 0 to 1 of the volume.
    lit : bool
        Shown with the transfer function's materials under the lights; else as greys.
    greys : (low, high), optional
        Values shown black and white, 0 to 1 of the volume's range; None where most values lie.
    """

    at: tuple[float, float, float] = (0.5, 0.5, 0.5)
    lit: bool = True
    greys: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Interface:
    """The window itself.

    Parameters
    ----------
    dark : bool
        Which theme.
    logarithmic : bool
        Scale of the histogram.
    keys : bool
        Whether the cheat sheet is open.
    light : int
        The row that is chosen, and whose spectrum stands out; a state keeps it within its lights.
    probe : bool
        Whether what is under the mouse is told.
    error_map : bool
        Whether it is laid over the picture.
    panels : set of str
        The panels that are open, by their titles.
    aids : Aids
        What stands over the picture.
    slices : Slices
    fade_s : float
        How long the lights take to become those of a saved state.
    pick : Pick
        What is chosen in the palette.
    part : int
        The point, region, surface or label whose details are shown.
    """

    dark: bool = True
    logarithmic: bool = True
    keys: bool = False
    light: int = 0
    probe: bool = True
    error_map: bool = False
    panels: frozenset[str] = PANELS
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
    view : View
    transfer : Transfer
        As edited.
    shift : float
        By how much its points have been shifted.
    shading : RaycastSpec
    size : (width, height)
        Pixels of the whole picture.
    lights : tuple of LightRow
    relight : RelightSpec
        Viewing, mode, backdrop and level.
    other : tuple of LightRow, optional
        The lights at the right of the divide, to compare with.
    divide : float
        Where that is, 0 to 1 of the picture's width.
    interface : Interface
    saved_lights : tuple of LightState
        Lights that were saved under a name.
    fade : Fade, optional
        Where the lights come from, as long as they fade to those of this state.
    palette : PaletteState
        What the palette asks for; its spectra stand in ``transfer`` and ``lights``.
    thickness : float
        By how much its opacities have been thickened.
    unthickened : (Transfer, thickness, Transfer), optional
        What ``transfer`` was thickened from, how thick that is, and what it became: valid as long
        as the last is ``transfer``. Opacities rounded to 1 come back from it.
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
    def first(
        cls, document: Document, size: tuple[int, int], interface: Interface | None = None
    ) -> ViewState:
        """A scene as its file has it."""
        return cls(
            document,
            document.view,
            document.transfer,
            document.shading,
            document.lights,
            document.relight,
            size=size,
            interface=interface or Interface(),
        )
