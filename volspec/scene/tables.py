"""The tables of a scene file, as pydantic models: what keys there are and what they may hold.

    TOML -> [tables] -> Scene

Those of transfer functions, of lights and of spectra stand in `volspec.scene.transfer`,
`volspec.scene.lights` and `volspec.scene.spectra`, what palettes have too in `volspec._tables`,
the whole file in `volspec.scene.file`. The keys' meaning is told to users in docs/scenes.md.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from volspec._tables import Box, Name, Table, Vector, ViewedTable
from volspec.appearance import Viewing
from volspec.raycast import ClipPlane, LightGroup, RaycastSpec
from volspec.relight import RelightSpec
from volspec.scene.spectra import Given

_CAST, _VIEW, _SEEN = RaycastSpec(), Viewing(), RelightSpec()


class VolumeTable(Table):
    """``[volume]``: the file, and what is changed of it."""

    file: Annotated[str, Field(examples=["volume.nrrd"])]
    """NRRD, MHD/MHA, NIfTI, VTI/VTK, TIFF, .npy, FILE.raw?shape=256x256x110&dtype=uint8, or a
    folder: DICOM (?series=3 names one of several), TIFF or PNG slices, OME-Zarr."""
    spacing_mm: Vector | None = None
    """x, y, z in place of the file's."""
    downsample: int = 1
    """2 keeps a voxel for every block of 2³: the mean, or of labels the most frequent."""


class MaterialTable(Table):
    """``[[material]]``: a name the transfer function uses, a reflectance and a filter."""

    row_keys = ("name",)
    name: Annotated[Name, Field(examples=["bone"])]
    """What [transfer] calls it."""
    reflectance: Annotated[Given, Field(examples=["copper"])]
    """A name, FILE.csv, PALETTE.toml#name, …, or a table of numbers."""
    filter: Given | None = None
    """The spectrum that passes it at opacity 1; left out, every wavelength is held back alike."""


class BasisTable(Table):
    """``[basis]``: one that ships, one trained on the scene's own spectra, or its materials.

    An empty table takes ``general-7`` where that holds the scene's colours and trains where it
    does not. ``method = "materials"`` makes the materials the channels: exact under any light.
    """

    name: str | None = None
    """A basis that ships, or FILE.json; alone."""
    train: Literal["scene"] | None = None
    """Train for the scene in any case."""
    method: Literal["virtual-sensors", "pca-sharpened", "pca", "reduced-rank", "materials"] = (
        "virtual-sensors"
    )
    """How it is fitted; materials: the materials are the channels, exact under any light."""
    size: Annotated[int, Field(ge=3, le=16)] = 7
    """Channels."""
    positive: bool = False
    """Sensors without negative parts."""
    grid_nm: Vector | None = None
    """First, last, step of the bands; left out, 400 to 700 by 10."""
    observer_deg: Literal[2, 10] = 2
    """The CIE observer's field."""

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

    @property
    def file(self) -> str | None:
        """The file that ``name`` names; None where it is none."""
        return self.name if self.name is not None and self.name.endswith(".json") else None


class CameraTable(Table):
    """``[camera]``: an orbit around the volume, or an explicit position."""

    azimuth_deg: float = 30.0
    """0 stands at −y, 90 at +x."""
    elevation_deg: float = 20.0
    """Towards up."""
    zoom: float = 1.0
    """1 fits the sphere around the volume into the picture's height."""
    fov_deg: float = 30.0
    """The picture's height as an angle."""
    orthographic: bool = False
    """Parallel rays."""
    roll_deg: float = 0.0
    """Turns the picture clockwise."""
    position_mm: Vector | None = None
    """x, y, z, in place of the orbit."""
    target_mm: Vector | None = None
    """What it looks at; left out, the volume's centre."""
    up: Vector = (0.0, 0.0, 1.0)
    """What is above in the picture."""

    @model_validator(mode="after")
    def _one_way(self) -> CameraTable:
        orbit = set(type(self).model_fields) - {"position_mm", "target_mm", "up", "fov_deg"}
        orbit &= self.model_fields_set
        if self.position_mm is not None and orbit:
            raise ValueError(f"give position_mm or {' and '.join(sorted(orbit))}, not both")
        return self


class PlaneTable(Table):
    """One of ``clip_planes``."""

    point_mm: Annotated[Vector, Field(examples=[[0, 0, 0]])]
    """Any point of the plane."""
    normal: Annotated[Vector, Field(examples=[[0, 0, 1]])]
    """Towards what stays."""


class RaycastTable(Table):
    """``[raycast]``: see `volspec.RaycastSpec`."""

    step_mm: float | None = _CAST.step_mm
    """Distance of samples; left out, half the smallest spacing."""
    ambient: float = _CAST.ambient
    """How surfaces reflect light from everywhere."""
    diffuse: float = _CAST.diffuse
    """How they reflect light from a direction."""
    specular: float = _CAST.specular
    """Highlights."""
    shininess: int = _CAST.shininess
    """Their sharpness, 1 to 1024."""
    alpha_stop: float = _CAST.alpha_stop
    """A ray ends at this opacity."""
    flat_gradient: float = _CAST.flat_gradient
    """Gradients below this share of the range per voxel are not shaded."""
    mode: str = _CAST.mode
    """composite, or maximum or average of the values along a ray."""
    jitter: float = _CAST.jitter
    """Share of a step by which rays are shifted at random: no rings."""
    seed: int = _CAST.seed
    """Of the jitter."""
    preintegrated: bool = _CAST.preintegrated
    """Far fewer bands where points are steep."""
    adaptive: float = _CAST.adaptive
    """Longer steps where opacity varies by less than this."""
    crop_voxels: Box | None = _CAST.crop_voxels
    """From and to along x, y, z: what stays, in voxels after downsample."""
    clip_planes: list[PlaneTable] = Field(default_factory=list)
    """Up to six; the normal's side stays."""
    light_cells: int = _CAST.light_cells
    """Of the light volume for shadows and occlusion, along the longest axis."""
    half: bool = _CAST.half
    """Channels as float16: half the memory, three digits."""
    first_opacity: float = _CAST.first_opacity
    """Opacity that counts as the first hit."""

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


class ViewingTable(ViewedTable):
    """``[viewing]``: see `volspec.Viewing`; and the backdrop's reflectance."""

    exposure: float = _VIEW.exposure
    """Factor of all light."""
    adapting: str = _VIEW.adapting
    """given, or picture or pixel: Y_b and L_A measured in the picture."""
    fov_deg: float | None = _VIEW.fov_deg
    """The picture's height as an angle, to measure with; left out, the camera's."""
    backdrop: float = 0.2
    """Reflectance of the diffuser behind."""
    mode: str = _SEEN.mode
    """componentwise, exact or linear-model."""
    level: str = _SEEN.level
    """relative: white has Y = 100; absolute: lights add, and need lux."""

    def spec(self) -> RelightSpec:
        """The settings as `volspec.relight` takes them.

        Raises
        ------
        ViewingError
            If one is out of range.
        """
        settings = self.model_dump(exclude={"display"})
        relit = {key: settings.pop(key) for key in ("backdrop", "mode", "level")}
        return RelightSpec(viewing=self.viewed(settings), **relit)


class OutputTable(Table):
    """``[output]``: the picture's size in pixels."""

    width: Annotated[int, Field(ge=1, le=8192)] = 512
    """Pixels."""
    height: Annotated[int, Field(ge=1, le=8192)] = 512
    """Pixels."""
