"""The viewer's frozen state: every change makes a new one, and undo returns to an earlier one.

inputs, panels -> [state] -> cast, relight, frame
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from volspec.image import DepthEffects
from volspec.raycast import RaycastSpec
from volspec.relight import Layout, RelightSpec
from volspec.scene.tables import Annotation, MeshSpec
from volspec.settings import Vector
from volspec.transfer import Transfer
from volspec.viewer.model.document import Document, FieldLook
from volspec.viewer.model.light_rows import Fade, LightState, Rows
from volspec.viewer.model.palette_targets import PaletteState, Pick
from volspec.viewer.model.view import View

if TYPE_CHECKING:
    from volspec.scene import SceneRoom


@dataclass(frozen=True, slots=True)
class Overlays:
    """Overlays of the picture."""

    cube: bool = True  # the orientation cube
    scale: bool = True  # the scale bar
    # The crop box and the clip planes, with handles; they cut even if they are hidden.
    crop: bool = False
    planes: bool = True
    plane: int = 0  # index of the chosen clip plane
    lights: bool = False  # the handles of light sources
    outlines: bool = True  # of the slices
    patient: bool | None = None  # name directions by the patient's body; None: the volume decides


@dataclass(frozen=True, slots=True)
class Slices:
    """Positions of the slices, and how they are shown."""

    # Along the axes x, y and z of the voxels, 0 to 1 of the volume.
    at: tuple[float, float, float] = (0.5, 0.5, 0.5)
    lit: bool = True  # shown with the materials under the lights; else as greys
    # Values shown black and white, 0 to 1 of the volume's range; None: the range of most values.
    greys: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Interface:
    """Settings of the window, which undo leaves as they are."""

    dark: bool = True
    logarithmic: bool = True  # scale of the histogram
    keys: bool = False  # the cheat sheet is open
    light: int = 0  # the chosen row of the lights; a state clamps it to its lights
    source: int = 0  # index of the chosen light source of the cast, counted through its groups
    probe: bool = True  # show the values under the mouse
    error_map: bool = False
    stereo: Layout | Literal[""] = ""  # of both eyes' pictures; empty for one picture
    panels: frozenset[str] = frozenset(
        {"Lights", "Viewing", "Transfer", "Opacity", "Palette", "Lighting", "Room", "Meshes"}
    )  # open
    overlays: Overlays = field(default_factory=Overlays)
    slices: Slices = field(default_factory=Slices)
    fade_s: float = 1.5  # duration of a fade to a saved light state
    pick: Pick = field(default_factory=Pick)
    tool: str = ""  # that picks points: one of `measure.TOOLS`; empty for none
    tool_points: tuple[Vector, ...] = ()  # the points that it has so far, in mm of the world
    mesh: int = 0  # the mesh whose place is shown
    part: int = 0  # the point, region, surface or label whose details are shown

    def for_another(self, light: int) -> Interface:
        """Return this for another document: without places, values and choices of the last one."""
        slices = Slices(lit=self.slices.lit)
        first = replace(self, light=light, source=0, mesh=0, part=0)
        return replace(first, slices=slices, pick=Pick(), tool_points=())


@dataclass(frozen=True, slots=True)
class ViewState:
    """Everything that a picture is made of."""

    document: Document
    view: View
    transfer: Transfer
    shading: RaycastSpec
    lights: Rows
    relight: RelightSpec
    shift: float = 0.0  # sum of the shifts of the transfer function's points
    fields: tuple[FieldLook, ...] = ()  # of a volume of several, the chosen one's as it was
    chosen_field: int = 0  # index of the one, whose transfer function `transfer` is
    size: tuple[int, int] = (512, 512)  # width and height of the whole picture, in pixels
    other: Rows | None = None  # the lights at the right of the divide, to compare with
    divide: float = 0.5  # position of the divide, 0 to 1 of the picture's width
    interface: Interface = field(default_factory=Interface)
    saved_lights: tuple[LightState, ...] = ()
    fade: Fade | None = None  # start of the fade to this state's lights, while it lasts
    # Targets only: the designed spectra are in `transfer` and `lights`.
    palette: PaletteState = field(default_factory=PaletteState)
    annotations: tuple[Annotation, ...] = ()
    meshes: tuple[MeshSpec, ...] = ()  # in and around the volume; paths are as in its file
    depth: DepthEffects = field(default_factory=DepthEffects)  # of a picture with layers
    thickness: float = 1.0  # factor by which the transfer function was thickened
    # The transfer function before it was thickened, its thickness, and the result: valid while the
    # result is `transfer`. Opacities that were rounded to 1 are restored from it.
    unthickened: tuple[Transfer, float, Transfer] | None = None
    room: SceneRoom | None = None  # around the volume, in its present paints; may be an estimate

    def __post_init__(self) -> None:
        index = min(max(self.interface.light, 0), max(len(self.lights) - 1, 0))
        if index != self.interface.light:
            object.__setattr__(self, "interface", replace(self.interface, light=index))

    @classmethod
    def first(cls, document: Document, size: tuple[int, int]) -> ViewState:
        """Return the initial state of a scene, as in its file."""
        return cls(
            document,
            document.view,
            document.transfer,
            document.shading,
            document.lights,
            document.relight,
            fields=document.fields,
            size=size,
            annotations=document.file.annotation if document.file else (),
            meshes=document.file.mesh if document.file else (),
            room=document.room,
            depth=document.file.depth if document.file else document.depth,
        )
