"""Settings only in scene files: volume, materials, basis, camera, picture size.

    TOML -> [specs] -> Scene

Lights are in `volspec.scene.tables.lights`, transfer functions in
`volspec.scene.tables.transfer` and exports in `volspec.scene.tables.export`; all other tables are
the specs of the Python API.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from volspec.camera import Orbit
from volspec.errors import Code, SceneError, SpectrumError
from volspec.mesh import Grating, Shape
from volspec.settings import (
    Box,
    Finite,
    Hint,
    Name,
    Positive,
    Unit,
    Vector,
    settings,
    value_or_table,
)
from volspec.spectra import Observer, SpectralGrid, Spectrum, light, reflectance
from volspec.spectra.library import as_light, as_reflectance

if TYPE_CHECKING:
    from volspec.mesh import Mesh

Numbers = Annotated[tuple[float, ...], Field(strict=False)]


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True)
class SpectrumNumbers:
    """A spectrum as numbers instead of a name: an edited spectrum without a file of its own.

    Values on the scene's bands are used unchanged; others are averaged over the bands, as from a
    file: a light is scaled, a reflectance checked.
    """

    name: str = ""
    """Caption; default: the name of the light or material."""
    wavelengths_nm: Annotated[Numbers, Field(examples=[[400, 700]]), Unit("nm")]
    """At least two, increasing."""
    values: Annotated[Numbers, Field(examples=[[0.2, 0.8]])]
    """One per wavelength: relative power for a light, 0 to 1 for a reflectance or filter."""
    notes: dict[str, str] = field(default_factory=dict)
    """Facts about its origin, such as designed, manufacturer or instrument; a scene with designed
    spectra trains its basis."""

    def __post_init__(self) -> None:
        try:
            self.spectrum()
        except SpectrumError as error:
            raise SpectrumError(str(error), code=error.code) from error

    @classmethod
    def of(cls, spectrum: Spectrum) -> SpectrumNumbers:
        """Return a spectrum's numbers, which read back exactly."""
        return cls(
            name=spectrum.name,
            wavelengths_nm=tuple(spectrum.wavelengths_nm.tolist()),
            values=tuple(spectrum.values.tolist()),
            notes=dict(spectrum.notes),
        )

    def spectrum(self, name: str = "") -> Spectrum:
        """Return the spectrum, with the given name if it has none.

        Raises SpectrumError if the numbers are not a spectrum.
        """
        numbers = np.array(self.wavelengths_nm), np.array(self.values)
        return Spectrum(*numbers, self.name or name, self.notes)


SpectrumRef = Annotated[
    Annotated[str, Tag("<value>")] | Annotated[SpectrumNumbers, Tag("<table>")],
    Discriminator(value_or_table),
    Hint("a name, or a table of numbers", whole=True),
]
"""A name as `volspec.light` or `volspec.reflectance` takes it, or numbers."""


ROOM_LIGHT = "room"
"""The spectrum of a room's lights, as its file gives it."""


def resolve_light(
    source: str | SpectrumNumbers,
    name: str,
    grid: SpectralGrid,
    folder: Path,
    unsaved: Mapping[str, Spectrum],
) -> Spectrum:
    """Return the light of a row, whose paths are relative to ``folder``.

    ``unsaved`` holds spectra that are not on disk yet. Raises SpectrumError if the name is unknown,
    or the numbers are not a light.
    """
    if source == ROOM_LIGHT and source not in unsaved:
        raise SpectrumError(
            f"spectrum = {ROOM_LIGHT!r} is the light of a room, and the scene has none",
            "add [room], or give a light such as D65",
            code="missing",
        )
    if isinstance(source, SpectrumNumbers):
        return as_light(source.spectrum(name), grid, "spectrum.values")
    return unsaved.get(source) or light(source, grid, folder=folder)


def given_reflectance(
    source: str | SpectrumNumbers,
    name: str,
    grid: SpectralGrid,
    folder: Path,
    unsaved: Mapping[str, Spectrum],
) -> Spectrum:
    """Return the reflectance or filter of a row; parameters and errors as for `resolve_light`."""
    if isinstance(source, SpectrumNumbers):
        return as_reflectance(source.spectrum(name), grid, "values")
    return unsaved.get(source) or reflectance(source, grid, folder=folder)


EMPTY = "empty"
"""The file of a volume with nothing in it, around meshes."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class VolumeSpec:
    """``[volume]``: the file, and changes to it; left out in a scene of meshes alone."""

    file: Annotated[str, Field(examples=["volume.nrrd"])] = EMPTY
    """NRRD, MHD/MHA, NIfTI, MGH, AFNI, MRC, VTI/VTK, TIFF, HDF5, .npy,
    FILE.raw?shape=256x256x110&dtype=uint8, or a folder: DICOM (?series=3 selects one of several),
    slices of TIFF, PNG, BMP or JPEG, OME-Zarr; of time steps and channels ?time=2&channel=0;
    ?labels=FILE is a table of a segmentation's labels, ?unit=HU the unit of values that a file
    leaves out, ?scale=log takes their logarithms; or the name of a bundled volume: engine, head,
    frog; or empty, around meshes. Without ?time= a file of several time steps is a series, and so
    are files of one step each: beat/*.nrrd."""
    step: Annotated[int, Field(ge=0)] = 0
    """Time step of a series that is shown, from 0."""
    fps: Annotated[float, Field(gt=0, le=240, allow_inf_nan=False)] = 10.0
    """Time steps per second at which a series plays in the viewer and in pages."""
    spacing_mm: Annotated[Vector, Unit("mm")] | None = None
    """x, y, z instead of the file's spacing; there is a warning if they differ."""
    assumed: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """Assumptions on what the file leaves out, when the scene was made; a note for readers."""
    downsample: int = 1
    """2 keeps one voxel per block of 2³: the mean, or for labels the most frequent."""
    box_mm: Annotated[Box, Unit("mm")] | None = None
    """x, y, z from and to of an empty volume, around which the camera orbits; default: those of the
    meshes."""

    def __post_init__(self) -> None:
        if self.file != EMPTY and self.box_mm is not None:
            raise fault("box_mm", f"is of an {EMPTY} volume, not of {self.file}", "leave it out")


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class MaterialSpec:
    """``[[material]]``: a name for the transfer function, a reflectance and a filter."""

    row_keys: ClassVar = ("name",)
    name: Annotated[Name, Field(examples=["bone"])]
    """Name in [transfer]."""
    reflectance: Annotated[SpectrumRef, Field(examples=["copper"])]
    """A name (copper, ColorChecker/dark skin, grey:0.18, …), FILE.csv, FILE.ti3#sample,
    FILE.cxf#object, FILE.exr#X,Y, a palette's OUT.toml#name, or a table of numbers."""
    filter: SpectrumRef | None = None
    """Transmitted spectrum at opacity 1, in the same notation; by default all wavelengths are
    absorbed equally. Only with points, and not with method = "materials"."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class BasisSpec:
    """``[basis]``: a shipped basis, one trained on the scene's own spectra, or its materials.

    An empty table uses ``general-7`` if that reproduces the scene's colours, else trains a basis.
    Scenes with gratings get the bands. ``method = "materials"`` makes the materials the channels,
    ``"bands"`` the bands: both are exact under any light.
    """

    name: str | None = None
    """A shipped basis, or FILE.json; excludes all other keys."""
    train: Literal["scene"] | None = None
    """Always train for the scene."""
    method: Literal[
        "virtual-sensors", "pca-sharpened", "pca", "reduced-rank", "materials", "bands"
    ] = "virtual-sensors"
    """Fitting method; with materials, the materials are the channels, with bands, the grid's bands:
    both are exact under any light."""
    size: Annotated[int, Field(ge=3, le=16)] = 7
    """Number of channels."""
    positive: bool = False
    """Sensors without negative parts."""
    grid_nm: Annotated[Vector, Unit("nm")] | None = None
    """First, last and step of the bands; default: those of the palettes that spectra are from, else
    380 to 780 by 5."""
    observer_deg: Observer = 2
    """Standard observer: 2° (CIE 1931), 10° (CIE 1964), or those of CIE 2015, of cones."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
        """Refuse keys that exclude each other, unless they equal their defaults."""
        other_keys = sorted(set(table) - {"name"})
        if "name" in table and other_keys:
            problem = f"a shipped basis, with {' and '.join(other_keys)}"
            raise fault("name", problem, "give one of them")
        fitted = sorted({"size", "positive", "train"} & set(table))
        one = {"materials": "material", "bands": "band"}.get(table.get("method", ""))
        if one is not None and fitted:
            problem = f'"{table["method"]}" makes each {one} a channel, with nothing to fit'
            raise fault("method", problem, f"leave out {' and '.join(fitted)}")
        return table

    @property
    def file(self) -> str | None:
        """The file in ``name``; None if it is not a file."""
        return self.name if self.name is not None and self.name.endswith(".json") else None


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class CameraSpec(Orbit):
    """``[camera]``: an orbit around the volume, or an explicit position."""

    position_mm: Annotated[Vector, Unit("mm")] | None = None
    """x, y, z, instead of the orbit."""

    @staticmethod
    def from_table(table: Mapping[str, Any], folder: Path | None) -> Mapping[str, Any]:
        """Refuse an orbit together with a position."""
        orbit = {row.name for row in fields(Orbit)} - {"target_mm", "up", "fov_deg"}
        if "position_mm" in table and (orbital := sorted(orbit & set(table))):
            raise fault("position_mm", f"given with {' and '.join(orbital)}", "give one of them")
        return table


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSpec:
    """``[[mesh]]``: a surface in the volume's world, lit as the volume is."""

    file: Annotated[str, Field(examples=["implant.stl"])] | None = None
    """PLY, OBJ, STL, VTP, VTK or glTF."""
    shape: Shape | None = None
    """Instead of a file: a plane or a disc that looks to +z, a sphere, or a triad of axes, about
    the origin."""
    size_mm: Annotated[Positive, Unit("mm")] = 10.0
    """Side, diameter or length of a shape."""
    material: Annotated[Name, Field(examples=["titanium"])] | None = None
    """Name of a [[material]]."""
    own_colours: bool = False
    """The file's own colours, of its materials, at points or in triangles, where it has some,
    instead of the material."""
    texture: Annotated[str, Field(examples=["photo.png"])] | None = None
    """PNG, JPEG, TIFF or BMP over the texture coordinates: colours, or with ``materials``
    numbers."""
    materials: Annotated[tuple[Name, ...], Field(strict=False)] = ()
    """Names of [[material]]s, whose numbers from 0 are the texture's grey values."""
    shares: dict[str, str] = field(default_factory=dict)
    """Shares of materials, as grey images: copper = "copper.png"."""
    unit_mm: Annotated[Positive, Unit("mm")] = 1.0
    """Millimetres of the file's unit; 1000 for metres."""
    move_mm: Annotated[Vector, Unit("mm")] = (0.0, 0.0, 0.0)
    """Offset in the volume's world, after ``unit_mm`` and ``turn_deg``."""
    turn_deg: Annotated[Vector, Unit("degrees")] = (0.0, 0.0, 0.0)
    """Turns about x, then y, then z, counter-clockwise as seen from the axis' end."""
    smooth_deg: Annotated[float, Field(ge=0.0, le=180.0), Unit("degrees")] = 30.0
    """Edges at which the surface turns by less look smooth."""
    opacity: Annotated[float, Field(gt=0.0, le=1.0)] = 1.0
    """Below 1, the volume and other meshes behind and within shine through."""
    mirror: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Part of the light that is reflected as by a mirror, in which other meshes are seen."""
    grating: Grating | None = None
    """Lines that diffract light, such as a disc's: {spacing_um = 1.6}."""
    shown: bool = True
    """False leaves it out: it is not seen and casts no shadow."""
    cut: bool = False
    """Cut by the clip planes and the crop, as the volume is, and hollow there."""

    def __post_init__(self) -> None:
        if (self.file is None) == (self.shape is None):
            several = "no surface" if self.file is None else "both a file and a shape"
            raise fault("", f"has {several}", "give one of file and shape")
        looks = [self.material is not None, self.texture is not None, bool(self.shares)]
        if self.own_colours and (self.file is None or self.material is None):
            remedy = "give file and material, or leave it out"
            raise fault("own_colours", "is of a file, and in place of a material", remedy)
        if sum(looks) > 1:
            names = " and ".join(n for n in ("material", "texture", "shares") if getattr(self, n))
            raise fault("", f"has {names}", "give one of them")
        if not any(looks) and self.shape != "triad":
            raise fault("", "has no look", "give one of material, texture and shares")
        if self.materials and self.texture is None:
            raise fault("materials", "number a texture", "give texture, or material alone")

    @property
    def used(self) -> tuple[str, ...]:
        """Names of its materials."""
        one = () if self.material is None else (self.material,)
        return (*one, *self.materials, *self.shares)

    @property
    def name(self) -> str:
        """Name for messages and lists: the file's, or the shape."""
        return Path(self.file).name if self.file is not None else str(self.shape)

    def rebased(self, change: Callable[[str], str]) -> MeshSpec:
        """Return the mesh with other names of files."""
        file, texture = (path and change(path) for path in (self.file, self.texture))
        share_files = {name: change(path) for name, path in self.shares.items()}
        return replace(self, file=file, texture=texture, shares=share_files)

    def mesh(self, folder: Path) -> Mesh:
        """Return the surface in its place.

        Raises MeshError if a file cannot be used.
        """
        return self.placed(self.read(folder))

    def read(self, folder: Path) -> Mesh:
        """Return the surface as its file or shape has it; raises as `mesh`."""
        # Imported late: few scenes have meshes.
        from volspec.mesh import Mesh, Texture, shape_mesh

        look: str | Texture | None = self.material
        if self.texture is not None:
            look = Texture.load(folder / self.texture, self.materials)
        elif self.shares:
            look = Texture.load_shares({name: folder / file for name, file in self.shares.items()})
        if self.shape is not None:
            return shape_mesh(self.shape, material=look)
        assert self.file is not None and look is not None
        return Mesh.load(
            folder / self.file, look, own_colours=self.own_colours, smooth_deg=self.smooth_deg
        )

    def placed(self, mesh: Mesh) -> Mesh:
        """Return a surface as `read` gives it in its place."""
        scale = self.unit_mm if self.shape is None else self.size_mm
        looks = replace(
            mesh, opacity=self.opacity, mirror=self.mirror, grating=self.grating, cut=self.cut
        )
        return looks.placed(self.move_mm, self.turn_deg, scale)


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True)
class RoomSpec:
    """``[room]``: a room with the volume in it.

    Its lights replace ``[[group]]``; ``[[light]]`` gives them spectra, and ``group`` names one of
    them. Y_b, Y_A and surround are those of an eye in the room, unless ``[viewing]`` gives others
    than their defaults.
    """

    file: Annotated[str, Field(examples=["room.toml"])]
    """A room (docs/rooms.md)."""
    position_m: Annotated[Vector, Unit("m")]
    """Place of the volume's middle in the room."""
    scale: Positive = 1.0
    """Size in the room over size in the file."""
    turn_deg: Annotated[Finite, Unit("degrees")] = 0.0
    """Turns the volume about the room's vertical, counter-clockwise from above, and the camera with
    it; the camera's ``up`` is vertical, and without a turn azimuth 0 is at the room's front."""
    paint: dict[str, str] = field(default_factory=dict)
    """Other reflectances of surfaces, such as walls = "#f4b8a0", "salmon" or "grey:0.5"."""
    directions: Annotated[int, Field(ge=1, le=5)] = 3
    """Directional lights that replace the room's, at most, besides ambient light."""
    shadows: bool = True
    """The volume casts shadows into itself; without them, light also passes through it to the
    other side."""
    walls: bool = True
    """The room is seen behind the volume."""
    patches: Annotated[int, Field(ge=100, le=100_000)] = 2000
    """Triangles, about, that the room is divided into."""


@settings(SceneError)
@dataclass(frozen=True, slots=True)
class OutputSpec:
    """``[output]``: the picture's size in pixels."""

    width: Annotated[int, Field(ge=1, le=8192)] = 512
    """Pixels across."""
    height: Annotated[int, Field(ge=1, le=8192)] = 512
    """Pixels down."""


def fault(
    field: str, problem: str, remedy: str, code: Code = "conflict", given: object = None
) -> SceneError:
    """Return an error about a field."""
    return SceneError(problem, remedy, code=code, field=field, given=given)
