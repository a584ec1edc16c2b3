"""Rooms as TOML: a rectangular room with windows, lamps and furniture, or meshes.

ROOM.toml -> [file] -> Room, Eye -> radiosity -> numbers, pictures
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from volspec._parse import parse_toml, read_text, toml_remedy
from volspec._triangles import read_triangles
from volspec.errors import InputError, RoomError, SpectrumError, nearest
from volspec.room.beam import Beam, read_beam
from volspec.room.mesh import SIDES, RoomMesh, box, panel
from volspec.room.model import Eye, Metres, PointLamp, Room, SunBeam
from volspec.room.quantities import irradiance_from_lux
from volspec.settings import (
    FileFaults,
    Finite,
    Name,
    Positive,
    Unit,
    Vector,
    row_names,
    settings,
    try_table,
)
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    Spectrum,
    light,
    reflectance,
    reflectance_from_colour,
)
from volspec.spectra.library import lamp_for_light

WALLS = ("left", "right", "front", "back")
# Between pieces of furniture, as a fraction of the room: several times `form_factors`' offset.
_GAP = 5e-5
# Of a room, so that millimetres are refused.
_MAX_M = 1000.0
Place = Annotated[tuple[Finite, Finite, Positive, Positive], Field(strict=False), Unit("m")]


@settings(RoomError)
@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceSpec:
    """``[[surface]]``: the reflectance of a surface."""

    row_keys: ClassVar = ("name",)
    name: Annotated[Name, Field(examples=["walls"])]
    """left, right, front, back (x, then y), floor, ceiling; walls are the first four; or the name
    of a box or a mesh."""
    reflectance: Annotated[str, Field(examples=["grey:0.5"])]
    """A name (ColorChecker/dark skin, grey:0.5, …) or FILE.csv, in the notation of a scene's
    material; or a colour, #f0d9b5 or a CSS name, under D65."""


@settings(RoomError)
@dataclass(frozen=True, slots=True, kw_only=True)
class LampSpec:
    """``[[light]]``: a window or panel on a side, a small lamp, or the sun."""

    row_keys: ClassVar = ("name",)
    name: Annotated[Name, Field(examples=["window"])]
    """Its name; of a window or panel, the name of its surface, too; panels that are a
    whole side are one, with the side's name."""
    spectrum: Annotated[str, Field(examples=["D65"])]
    """D65, A, tungsten, planck:3000, FILE.csv and others, in the notation of a scene's light."""
    on: Literal["left", "right", "front", "back", "floor", "ceiling"] | None = None
    """The side that a window or panel is part of."""
    place_m: Place | None = None
    """Its x, y (or the first two that the side has), width and height; default: the whole side."""
    position_m: Metres | None = None
    """Place of a small lamp."""
    beam: Annotated[str, Field(examples=["spot.ies"])] | None = None
    """FILE.ies (IES LM-63) or FILE.ldt (EULUMDAT): the intensity of a small lamp by direction. Its
    own lumens are used if neither lumen nor watt is given."""
    aim: Vector | None = None
    """Direction of the beam's middle; default: down, 0, 0, -1."""
    turn_deg: Annotated[Finite, Unit("degrees")] | None = None
    """Turn of the beam about its aim, counter-clockwise seen against it; at 0, C 0 of a lamp that
    aims down is +x, and C 90 +y."""
    azimuth_deg: Annotated[Finite, Unit("degrees")] | None = None
    """Direction of the sun: 0 at −y, 90 at +x."""
    elevation_deg: Annotated[float, Field(ge=-90, le=90), Unit("degrees")] = 45.0
    """Height of the sun."""
    lux: Annotated[Positive, Unit("lx")] | None = None
    """Lumens that leave each square metre of a window or panel; for the sun, lux across its beam,
    which enters through all windows."""
    lumen: Annotated[Positive, Unit("lm")] | None = None
    """All light of a lamp or panel."""
    watt: Annotated[Positive, Unit("W")] | None = None
    """Power of a lamp or panel, with ``lumen_per_watt``."""
    lumen_per_watt: Annotated[Positive, Unit("lm/W")] | None = None
    """Efficacy; can be left out if the spectrum is that of a lamp, such as lamp:tungsten-2850."""

    def __post_init__(self) -> None:
        kinds = [self.on is not None, self.position_m is not None, self.azimuth_deg is not None]
        if sum(kinds) != 1:
            raise RoomError(
                "is neither a panel, nor a lamp, nor the sun, or is several",
                "give one of on, position_m and azimuth_deg",
                code="conflict",
            )
        power = [self.lux is not None, self.lumen is not None, self.watt is not None]
        needed = self.beam is None
        if not needed <= sum(power) <= 1 or (kinds[2] and not power[0]) or (kinds[1] and power[0]):
            lumens = "one of lux, lumen and watt" if kinds[0] else "lumen or watt"
            remedy = f"give {'lux' if kinds[2] else lumens}"
            raise RoomError("has no power, or several, or of another kind", remedy, code="conflict")
        if self.place_m is not None and self.on is None:
            raise RoomError("", "leave place_m out: only panels have one", field="place_m")
        if self.beam is not None and not kinds[1]:
            raise RoomError("", "leave beam out: only small lamps have one", field="beam")
        for key in ("aim", "turn_deg"):
            if getattr(self, key) is not None and self.beam is None:
                raise RoomError("", f"leave {key} out, or give a beam", field=key)
        if self.aim is not None and not any(self.aim):
            raise RoomError.refused("aim", self.aim, "give a direction, such as 0, 0, -1", "range")

    def flux_lumen(self) -> float | None:
        """Return the luminous flux; None if lux are given, or only a beam.

        Raises RoomError if watts are given and the efficacy is not known.
        """
        if self.watt is None:
            return self.lumen
        efficacy = self.lumen_per_watt
        if efficacy is None:
            with suppress(SpectrumError):
                efficacy = lamp_for_light(self.spectrum).efficacy_lm_per_W
        if efficacy is None:
            remedy = "give lumen_per_watt, or a lamp as the spectrum: lamp:tungsten-2850"
            raise RoomError(f"{self.name}: its efficacy is unknown", remedy, code="missing")
        return self.watt * efficacy


@settings(RoomError)
@dataclass(frozen=True, slots=True, kw_only=True)
class BoxSpec:
    """``[[box]]``: furniture with sides along the axes."""

    row_keys: ClassVar = ("name",)
    name: Name
    """Name of its surface."""
    low_m: Metres
    """Its corner with the least x, y and z."""
    high_m: Metres
    """Its opposite corner."""

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low_m, self.high_m, strict=True)):
            raise RoomError.refused("high_m", self.high_m, "give more than low_m on each axis")


@settings(RoomError)
@dataclass(frozen=True, slots=True, kw_only=True)
class MeshSpec:
    """``[[mesh]]``: triangles from a file, as furniture or as the room itself."""

    row_keys: ClassVar = ("name",)
    name: Name
    """Name of its surface."""
    file: Annotated[str, Field(examples=["chair.ply"])]
    """PLY, OBJ, STL, VTP, …; its triangles are counter-clockwise as seen from where light is."""
    unit_m: Annotated[Positive, Unit("m")] = 1.0
    """Length of the file's unit: 0.001 for millimetres."""
    move_m: Metres = (0.0, 0.0, 0.0)
    """Added to its points."""


@settings(RoomError)
@dataclass(frozen=True, slots=True, kw_only=True)
class RoomFile:
    """A room's file; paths are relative to it."""

    title: str = ""
    """Caption."""
    size_m: Metres | None = None
    """Width (x), depth (y) and height (z) of a rectangular room from the origin; without, meshes
    are the room."""
    surface: Annotated[tuple[SurfaceSpec, ...], Field(strict=False, min_length=1)]
    """Reflectances of all surfaces."""
    light: Annotated[tuple[LampSpec, ...], Field(strict=False, min_length=1)]
    """Windows, lamps, the sun."""
    box: Annotated[tuple[BoxSpec, ...], Field(strict=False)] = ()
    """Furniture."""
    mesh: Annotated[tuple[MeshSpec, ...], Field(strict=False)] = ()
    """Furniture, or the room itself."""
    eye: Eye | None = None
    """Place to see the room from; default: near the front, looking at the back."""
    open: bool = False
    """Light may leave the room through gaps."""

    def __post_init__(self) -> None:
        if self.size_m is None and not self.mesh:
            raise RoomError(
                "the room has no surfaces", "give size_m, or a [[mesh]]", code="missing"
            )
        if self.size_m is not None and min(self.size_m) <= 0:
            raise RoomError.refused("size_m", self.size_m, "give three lengths above 0 m", "range")
        if self.size_m is not None and max(self.size_m) > _MAX_M:
            remedy = f"give metres, up to {_MAX_M:g}: 4000 mm are 4"
            raise RoomError.refused("size_m", self.size_m, remedy, "range")
        for kind, rows in (("surface", self.surface), ("light", self.light)):
            names = [row.name for row in rows]
            if twice := next((name for name in names if names.count(name) > 1), None):
                problem = f"two [[{kind}]] are named {twice!r}"
                raise RoomError(problem, "rename one", code="duplicate", field=kind)
        if self.size_m is None and any(lamp.on is not None for lamp in self.light):
            raise RoomError("a panel needs size_m", "give it, or a small lamp", code="missing")


class RoomFaults(FileFaults, RoomError):
    """Faults of a room's file."""


def load_room(path: str | os.PathLike[str], grid: SpectralGrid = DEFAULT_GRID) -> Room:
    """Read a room; docs/rooms.md explains the file.

    Raises
    ------
    RoomError
        If the file is missing, is not TOML, or has unknown keys or wrong values; the message names
        file, field and value.
    """
    name, text = os.fspath(path), read_text(path, RoomError, "a room's file")
    try:
        tables = parse_toml(text)
    except ValueError as error:
        problem = f"{name}: not valid TOML: {error}"
        raise RoomError(problem, toml_remedy(error, text), code="syntax") from error
    if "volume" in tables:
        remedy = f"give a room, a file with size_m and [[surface]], or run volspec view {name}"
        raise RoomError(f"{name}: is a scene, not a room", remedy, code="type")
    file, faults = try_table(RoomFile, tables, RoomError, Path(path).parent)
    if file is None:
        raise RoomFaults(path, faults, row_names(tables))
    try:
        return build_room(file, Path(path).parent, grid)
    except InputError as error:
        raise error.within(name, RoomError) from error


def build_room(file: RoomFile, folder: Path, grid: SpectralGrid = DEFAULT_GRID) -> Room:
    """Return the room of a file's tables; ``folder`` is where its files are."""
    mesh = _mesh(file, folder)
    rows = {}
    for spec in file.surface:
        with _in_row("surface", spec.name):
            rows[spec.name] = paint_named(spec.reflectance, grid, folder)
    if walls := rows.pop("walls", None):
        rows = {side: walls for side in WALLS if side in mesh.names} | rows
    panels = [row.name for row in file.light if row.on is not None]
    spare = [name for name in rows if name not in mesh.names]
    for side in mesh.names:
        if side not in rows and side not in panels:
            names = [side, "walls"] if side in WALLS else [side]
            guess = next(filter(None, (nearest(name, spare) for name in names)), "")
            raise RoomError(
                f"no [[surface]] is named {' or '.join(map(repr, names))}",
                f"{guess}say what it reflects",
                code="missing",
                field="surface",
            )
    for name in spare:  # may belong to furniture that was taken out, unless misspelt
        if guess := nearest(name, mesh.names):
            raise RoomError(
                f"[[surface]] {name}: nothing has this name",
                f"{guess}known: {', '.join(mesh.names)}",
                code="unknown",
                given=name,
            )
    exitances: dict[str, NDArray[np.float64]] = {}
    lamps, suns = [], []
    openings = frozenset(mesh.names.index(name) for name in panels if name in mesh.names)
    for row in file.light:
        with _in_row("light", row.name):
            spectrum = light(row.spectrum, grid, folder=folder)
        per_lux, flux = irradiance_from_lux(spectrum, 1.0, grid), row.flux_lumen()
        if row.on is not None:
            surface = row.name if row.place_m is not None else row.on
            area = float(mesh.areas_m2[mesh.surface == mesh.names.index(surface)].sum())
            lux = row.lux if flux is None else flux / area
            assert lux is not None
            exitances[surface] = exitances.get(surface, 0.0) + per_lux * lux
        elif row.position_m is not None:
            with _in_row("light", row.name):
                beam = _beam(row, folder)
            if flux is None:
                assert beam is not None
                flux = beam.lumen
            intensity = per_lux * (flux / (4.0 * math.pi))
            lamps.append(PointLamp(row.position_m, intensity, row.name, beam))
        else:
            assert row.lux is not None and row.azimuth_deg is not None
            turn, up = math.radians(row.azimuth_deg), math.radians(row.elevation_deg)
            direction = (
                math.cos(up) * math.sin(turn),
                -math.cos(up) * math.cos(turn),
                math.sin(up),
            )
            suns.append(SunBeam(direction, per_lux * row.lux, openings, row.name))
    dark = np.zeros(grid.size)
    return Room(
        mesh,
        np.array([rows[name].values if name in rows else dark for name in mesh.names]),
        exitances,
        tuple(lamps),
        tuple(suns),
        file.eye,
        grid,
        file.open,
        file.title,
    )


def _beam(row: LampSpec, folder: Path) -> Beam | None:
    """Return the light distribution of a small lamp, if it has a file."""
    if row.beam is None:
        return None
    beam = read_beam(folder / row.beam)
    if row.lumen is None and row.watt is None and not beam.lumen:
        remedy = "give lumen or watt"
        raise RoomError(f"{row.beam}: states no luminous flux", remedy, code="missing")
    return beam.aimed(row.aim or beam.aim, row.turn_deg or 0.0)


@contextmanager
def _in_row(key: str, name: str) -> Iterator[None]:
    """Add a row's table and name to an error in the body."""
    try:
        yield
    except InputError as error:
        raise error.within(f"[[{key}]] {name}") from error


def paint_named(text: str, grid: SpectralGrid, folder: Path) -> Spectrum:
    """Return a reflectance by name, or the one that a colour in sRGB has under D65.

    Raises SpectrumError if neither the library nor CSS knows the name.
    """
    if text.startswith("#"):
        return reflectance_from_colour(text, grid=grid)
    try:
        return reflectance(text, grid, folder=folder)
    except SpectrumError as unknown:
        with suppress(SpectrumError):  # a colour's name, such as salmon
            return reflectance_from_colour(text, grid=grid)
        raise unknown


def _mesh(file: RoomFile, folder: Path) -> RoomMesh:
    """Return all surfaces of a room."""
    parts: list[RoomMesh] = []
    if file.size_m is not None:
        parts += _sides(np.array(file.size_m), file.light)
    for row in file.box:
        low, high = np.array(row.low_m), np.array(row.high_m)
        # Clear of floor, walls and other furniture, so that no side lies on another.
        gap = _GAP * max(file.size_m or high - low)
        parts.append(box(low + gap, high - gap, row.name))
    parts += [_from_file(row, folder) for row in file.mesh]
    mesh = parts[0]
    for part in parts[1:]:
        mesh = mesh + part
    return mesh


def _sides(size: NDArray[np.float64], lights: Sequence[LampSpec]) -> list[RoomMesh]:
    """Return the six sides of a room with their windows and panels.

    A side's panels are placed along the two axes that it has, in the order x, y, z.
    """
    parts = []
    for number, side in enumerate(SIDES):
        axis, end = divmod(number, 2)
        first, second = (k for k in range(3) if k != axis)
        panels = [
            (lamp.name, lamp.place_m)
            for lamp in lights
            if lamp.on == side and lamp.place_m is not None
        ]
        right, up = np.eye(3)[first] * size[first], np.eye(3)[second] * size[second]
        part = panel(np.eye(3)[axis] * size[axis] * end, right, up, side, panels)
        inwards = np.eye(3)[axis] * (1 - 2 * end)
        if part.normals[0] @ inwards < 0:
            part = RoomMesh(part.corners_m[:, ::-1], part.surface, part.names)
        parts.append(part)
    return parts


def _from_file(spec: MeshSpec, folder: Path) -> RoomMesh:
    """Return the triangles of a mesh's file."""
    surface = read_triangles(folder / spec.file, RoomError)
    faces = surface.faces.reshape(-1, 4)[:, 1:]
    corners = np.asarray(surface.points, np.float64)[faces] * spec.unit_m + spec.move_m
    return RoomMesh(corners, np.zeros(len(faces), np.intp), (spec.name,))
