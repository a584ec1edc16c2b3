"""The tables of a scene file, as pydantic models: what keys there are and what they may hold.

    TOML -> [tables] -> Scene

Those of transfer functions and of lights stand in `volspec.scene.transfer` and
`volspec.scene.lights`, the whole file in `volspec.scene.file`. The keys' meaning is told to users
in docs/scenes.md.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    model_validator,
)

from volspec.appearance import Display, Viewing
from volspec.appearance.curves import Transfer
from volspec.appearance.presets import preset
from volspec.appearance.profile import read_profile
from volspec.appearance.spaces import ColourSpace
from volspec.errors import require_name
from volspec.raycast import ClipPlane, LightGroup, RaycastSpec
from volspec.relight import RelightSpec

# TOML has lists where Python has tuples; all else is taken as it is written.
Pair = Annotated[tuple[float, float], Field(strict=False)]
Vector = Annotated[tuple[float, float, float], Field(strict=False)]
Box = Annotated[tuple[Pair, Pair, Pair], Field(strict=False)]
Name = Annotated[str, AfterValidator(require_name)]
_CAST, _VIEW, _SEEN = RaycastSpec(), Viewing(), RelightSpec()


class Table(BaseModel):
    """One table of the file; an unknown key is an error, so that no setting is lost in silence."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class VolumeTable(Table):
    """``[volume]``: the file, and what is changed of it."""

    file: str
    spacing_mm: Vector | None = None
    downsample: int = 1


class MaterialTable(Table):
    """``[[material]]``: a name the transfer function uses, a reflectance and a filter."""

    name: Name
    reflectance: str
    filter: str | None = None


class BasisTable(Table):
    """``[basis]``: one that ships, one trained on the scene's own spectra, or its materials.

    An empty table takes ``general-7`` where that holds the scene's colours and trains where it
    does not. ``method = "materials"`` makes the materials the channels: exact under any light.
    """

    name: str | None = None
    train: Literal["scene"] | None = None
    method: Literal["virtual-sensors", "pca-sharpened", "pca", "reduced-rank", "materials"] = (
        "virtual-sensors"
    )
    size: Annotated[int, Field(ge=3, le=16)] = 7
    positive: bool = False
    grid_nm: Vector | None = None
    observer_deg: Literal[2, 10] = 2

    @model_validator(mode="after")
    def _one_source(self) -> BasisTable:
        others = sorted(self.model_fields_set - {"name"})
        if self.name is not None and others:
            raise ValueError(f"give name (a shipped basis) or {' and '.join(others)}, not both")
        fitted = sorted({"size", "positive", "train"} & self.model_fields_set)
        if self.method == "materials" and fitted:
            raise ValueError(
                'method = "materials" makes each material a channel; nothing to fit, leave out '
                f"{' and '.join(fitted)}"
            )
        return self


class CameraTable(Table):
    """``[camera]``: an orbit around the volume, or an explicit position."""

    azimuth_deg: float = 30.0
    elevation_deg: float = 20.0
    zoom: float = 1.0
    fov_deg: float = 30.0
    orthographic: bool = False
    position_mm: Vector | None = None
    target_mm: Vector | None = None
    up: Vector = (0.0, 0.0, 1.0)

    @model_validator(mode="after")
    def _one_way(self) -> CameraTable:
        orbit = {"azimuth_deg", "elevation_deg", "zoom", "orthographic"} & self.model_fields_set
        if self.position_mm is not None and orbit:
            raise ValueError(f"give position_mm or {' and '.join(sorted(orbit))}, not both")
        return self


class PlaneTable(Table):
    """One of ``clip_planes``."""

    point_mm: Vector
    normal: Vector


class RaycastTable(Table):
    """``[raycast]``: see `volspec.RaycastSpec`."""

    step_mm: float | None = _CAST.step_mm
    ambient: float = _CAST.ambient
    diffuse: float = _CAST.diffuse
    specular: float = _CAST.specular
    shininess: int = _CAST.shininess
    alpha_stop: float = _CAST.alpha_stop
    flat_gradient: float = _CAST.flat_gradient
    mode: str = _CAST.mode
    jitter: float = _CAST.jitter
    seed: int = _CAST.seed
    preintegrated: bool = _CAST.preintegrated
    adaptive: float = _CAST.adaptive
    crop_voxels: Box | None = _CAST.crop_voxels
    clip_planes: list[PlaneTable] = Field(default_factory=list)
    light_cells: int = _CAST.light_cells
    half: bool = _CAST.half
    first_opacity: float = _CAST.first_opacity

    def spec(self, groups: tuple[LightGroup, ...]) -> RaycastSpec:
        """The settings as `volspec.raycast` takes them.

        Raises
        ------
        RaycastError
            If one is out of range.
        """
        planes = tuple(ClipPlane(plane.point_mm, plane.normal) for plane in self.clip_planes)
        settings = self.model_dump(exclude={"clip_planes"})
        return RaycastSpec(**settings, clip_planes=planes, groups=groups)


class CurveTable(Table):
    """``transfer`` of a space: see `volspec.appearance.curves.Transfer`."""

    power: float
    gain: float = 1.0
    slope: float = 1.0
    toe: float = 0.0


def _kind(value: object) -> str:
    """Which of a table and a single value is meant; ``<`` keeps it out of messages."""
    return "<table>" if isinstance(value, dict | Table) else "<value>"


class SpaceTable(Table):
    """``space`` of a display in numbers: see `volspec.appearance.spaces.ColourSpace`."""

    name: Name = "display"
    primaries_xy: Box
    white_xy: Pair
    transfer: Annotated[
        Annotated[float, Tag("<value>")] | Annotated[CurveTable, Tag("<table>")],
        Discriminator(_kind),
    ]

    @classmethod
    def of(cls, space: ColourSpace) -> SpaceTable:
        """The table of a space."""
        curve = CurveTable(**asdict(space.transfer))
        return cls(
            name=space.name,
            primaries_xy=space.primaries_xy,
            white_xy=space.white_xy,
            transfer=curve,
        )

    def colours(self) -> ColourSpace:
        """The space.

        Raises
        ------
        ViewingError
            If there is none of these numbers.
        """
        given = self.transfer
        if isinstance(given, CurveTable):
            curve = Transfer(**given.model_dump())
        else:
            curve = Transfer.gamma(given)
        return ColourSpace(self.name, self.primaries_xy, self.white_xy, curve)


class DisplayTable(Table):
    """``[viewing.display]``: see `volspec.Display`; what is left out is the preset's."""

    preset: str = "sRGB"
    space: Annotated[
        Annotated[str, Tag("<value>")] | Annotated[SpaceTable, Tag("<table>")],
        Discriminator(_kind),
    ] = "sRGB"
    gamut: str = "clip"
    mark: bool = False
    white_cd_m2: float | None = None
    L_A: float | None = None
    Y_b: float | None = None
    surround: str | float | None = None

    def display(self) -> Display:
        """The display that is meant.

        Where the white's luminance is given and ``L_A`` is not, that is ``Y_b`` percent of it.

        Raises
        ------
        ViewingError
            If a name is unknown or a number out of range.
        """
        space = self.space if isinstance(self.space, str) else self.space.colours()
        seen = preset(self.preset).display(space, self.gamut)
        given = self.model_dump(exclude={"preset", "space", "gamut"}, exclude_none=True)
        if self.white_cd_m2 is not None and self.L_A is None:
            given["L_A"] = None
        return replace(seen, **given)


class ViewingTable(Table):
    """``[viewing]``: see `volspec.Viewing`; and the backdrop's reflectance."""

    model: str = _VIEW.model
    illuminance_lux: float = _VIEW.illuminance_lux
    L_A: float | None = _VIEW.L_A
    Y_b: float = _VIEW.Y_b
    surround: str | float = _VIEW.surround
    D: float | None = _VIEW.D
    discount: bool = _VIEW.discount
    exposure: float = _VIEW.exposure
    adapting: str = _VIEW.adapting
    fov_deg: float | None = _VIEW.fov_deg
    backdrop: float = 0.2
    mode: str = _SEEN.mode
    level: str = _SEEN.level
    display: DisplayTable = Field(default_factory=DisplayTable)

    def beside(self, scene: Path) -> ViewingTable:
        """The same, with what a display's profile beside the scene says in place of its name.

        So an image's note needs no file.

        Raises
        ------
        ViewingError
            If the profile cannot be used.
        """
        name = self.display.space
        if not (isinstance(name, str) and name.lower().endswith((".icc", ".icm"))):
            return self
        space = SpaceTable.of(read_profile(scene / name))
        display = self.display.model_copy(update={"space": space})
        return self.model_copy(update={"display": display})

    def spec(self) -> RelightSpec:
        """The settings as `volspec.relight` takes them.

        Raises
        ------
        ViewingError
            If one is out of range.
        """
        settings = self.model_dump(exclude={"display"})
        relit = {key: settings.pop(key) for key in ("backdrop", "mode", "level")}
        return RelightSpec(viewing=Viewing(**settings, display=self.display.display()), **relit)


class OutputTable(Table):
    """``[output]``: the picture's size in pixels."""

    width: Annotated[int, Field(ge=1, le=8192)] = 512
    height: Annotated[int, Field(ge=1, le=8192)] = 512
