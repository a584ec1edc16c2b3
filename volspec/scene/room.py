"""``[room]``: the room that a volume is in, its light on the volume, and its walls behind it.

    ROOM.toml, place -> [room] -> light groups, lights, viewing, backdrop

The lights of the scene are the spectra of the room's lamps and windows. Each group of the cast is a
part of the room's light (`volspec.room.specimen`); the room itself is seen in further groups, one
for each of its lights, which shine on nothing of the volume.
"""

from __future__ import annotations

import hashlib
import math
import os
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec.appearance import MAX_BACKGROUND, Viewing
from volspec.basis import Basis, MaterialBasis
from volspec.camera import level_axes
from volspec.errors import InputError, RoomError, SceneError, SpectrumError, nearest
from volspec.raycast import (
    MAX_GROUPS,
    MAX_NAME,
    Ambient,
    Directional,
    Headlight,
    LightGroup,
    RaycastSpec,
    Source,
)
from volspec.relight import LightRig
from volspec.room import (
    Backdrop,
    Eye,
    Placement,
    Room,
    RoomResponse,
    SpecimenLight,
    cone_luminances,
    load_room,
    lux_from_irradiance,
    paint_named,
    painted_surfaces,
    require_inside,
    solve_room,
    unknown_light,
)
from volspec.scene.tables.lights import LightSpec, NamedLight
from volspec.scene.tables.specs import ROOM_LIGHT, CameraSpec, RoomSpec, resolve_light
from volspec.settings import Vector
from volspec.spectra import SpectralGrid, Spectrum, colour_matching_functions
from volspec.volume import Volume

Array = NDArray[np.float64]
# Rays of a patch: the volume's light needs fewer than a picture of the room.
_RAYS = 1 << 11
# Least part of a group: none may be empty.
_MIN_PART = 1e-4
# Least background of the models, as a part of white.
_MIN_BACKGROUND = 1e-4


@dataclass(frozen=True, slots=True)
class _Unsolved:
    """A room to solve, equal to any other with the same contents."""

    digest: bytes
    patches: int
    room: Room = field(compare=False)


def _digest(room: Room) -> bytes:
    """Return a hash of everything that a room's response depends on."""
    digest = hashlib.blake2b(digest_size=16)
    lights = [*room.lights.values()]
    for array in (room.mesh.corners_m, room.mesh.surface, room.reflectances, *lights):
        digest.update(np.ascontiguousarray(array).tobytes())
    facts = room.mesh.names, room.grid, list(room.lights), room.open
    beams = [(sun.direction, sorted(sun.through)) for sun in room.suns]
    digest.update(repr((facts, beams)).encode())
    digest.update(pickle.dumps(room.lamps))
    return digest.digest()


# A scene is opened again by checks, wizards and the viewer; few, as each takes some 30 MB.
@lru_cache(maxsize=2)
def _respond(unsolved: _Unsolved) -> RoomResponse:
    """Solve a room, and return its response."""
    rays = _RAYS * unsolved.patches
    solved = solve_room(unsolved.room, unsolved.patches, rays=rays)
    return RoomResponse.of(solved, rays // 4)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SceneRoom:
    """A room with a volume in it, solved for all spectra of its lights."""

    spec: RoomSpec
    folder: Path  # paths in `spec` start from it
    placement: Placement
    response: RoomResponse
    specimen: SpecimenLight
    # (G + L,) lux of the groups and of the room's lights over those of the brightest surface, with
    # the paints of the room's file: they scale the layers of a cast, whatever the present paints.
    parts: Array
    # Of an estimate: the room that was solved last.
    estimated_from: SceneRoom | None = None

    def __repr__(self) -> str:
        patches, lights = len(self.response.solved.mesh.surface), ", ".join(self.response.names)
        return f"SceneRoom({self.spec.file!r}, {patches} patches, lights: {lights})"

    @classmethod
    def of(cls, spec: RoomSpec, folder: Path, grid: SpectralGrid, up: Vector) -> SceneRoom:
        """Read and solve a room; ``up`` is the vertical in the volume's world.

        Raises RoomError if it cannot be read or solved, or the place is not in it.
        """
        room = load_room(folder / spec.file, grid)
        paints = _paints(spec.paint, room, folder)
        response = _respond(_Unsolved(_digest(room), spec.patches, room))
        solved, remedy = response.solved, "change position_m"
        require_inside(solved.room, solved.rays, spec.position_m, "the volume", remedy)
        lights = len(room.lights) if spec.walls else 0
        if lights >= MAX_GROUPS:
            raise SceneError(
                f"{os.fspath(folder / spec.file)} has {lights} lights, each a layer of the cast",
                f"leave {MAX_GROUPS - 1} or fewer there, or set walls = false",
                code="size",
                field="walls",
            )
        max_directions = min(spec.directions, MAX_GROUPS - 1 - lights)
        specimen = SpecimenLight.of(response, spec.position_m, max_directions)
        power = np.array([*room.lights.values()])
        groups = np.einsum("lgb,lb->gb", specimen.irradiance, power)
        lux = lux_from_irradiance(np.concatenate([groups, power]), grid)
        parts = np.maximum(lux / specimen.brightest_lux, _MIN_PART)
        if paints:
            response = response.painted(paints)
            specimen = specimen.under(response)
        place = Placement.of(spec.position_m, spec.scale, spec.turn_deg, up)
        return cls(spec, folder, place, response, specimen, parts)

    @property
    def grid(self) -> SpectralGrid:
        """Grid of all spectra."""
        return self.response.solved.room.grid

    @property
    def paints(self) -> dict[str, Spectrum]:
        """Reflectances of the surfaces that reflect, by name."""
        room, nm = self.response.solved.room, self.grid.wavelengths_nm
        rows = zip(room.mesh.names, room.reflectances, strict=True)
        return {name: Spectrum(nm, row, name) for name, row in rows if row.any()}

    # The cast.

    def cast(self, spec: RaycastSpec) -> RaycastSpec:
        """Return the settings of a cast with the groups of the room's light.

        A perfect diffuser in the light of the brightest surface has Y = 100. Under one spectrum for
        all groups, the picture is that of the room with light of that spectrum everywhere.
        """
        shadows, (ambient, *parts) = self.spec.shadows, self.parts.tolist()
        world = self.specimen.directions @ self.placement.axes
        sources: list[tuple[Source, ...]] = [
            (Ambient(ambient, occlusion=shadows),),
            *(
                (Directional(_triple(direction), "world", part, shadows),)
                for direction, part in zip(world, parts, strict=False)
            ),
        ]
        names = self._group_names()
        groups = [LightGroup(*pair) for pair in zip(names, sources, strict=True)]
        if self.spec.walls:
            groups += [LightGroup(name, (Headlight(0.0),)) for name in self.wall_groups()]
        return replace(spec, groups=tuple(groups), ambient=1.0, diffuse=1.0)

    def _group_names(self) -> list[str]:
        ambient, *surfaces = self.specimen.names
        return [ambient, *(_group_name(f"from {name}") for name in surfaces)]

    def wall_groups(self) -> list[str]:
        """Return the groups of the room behind the volume, one for each of its lights."""
        return [_group_name(f"walls: {name}") for name in self.response.names]

    # Lights.

    def light(self, rows: Sequence[LightSpec], unsaved: Mapping[str, Spectrum]) -> NamedLight:
        """Return the setting of the rows with one name: spectra of the room's lights.

        ``unsaved`` holds spectra that are not on disk yet. Raises SpectrumError if a spectrum is
        unknown, RoomError if the room has no light of a group's name, SceneError if a row has lux.
        """
        first, label = rows[0], next((row.label for row in rows if row.label), rows[0].name)
        return NamedLight(first.name, label, *self.rig(self.spectra(self.lamp_rig(rows, unsaved))))

    def lamp_rig(self, rows: Sequence[LightSpec], unsaved: Mapping[str, Spectrum]) -> LightRig:
        """Return the lamps' spectra in a setting; groups are lights of the room. Errors as `light`.

        A spectrum without a group is that of all lights.
        """
        lights: list[Spectrum] = []
        weights: list[float] = []
        groups: list[str] = []
        for row in rows:
            if row.has_lux:
                raise SceneError(
                    "the lights of a room have the lux of its file",
                    "leave illuminance_lux and power_W out; weight scales",
                    code="conflict",
                    field="illuminance_lux",
                )
            for group, spectrum in self.row_spectra(row, unsaved).items():
                lights.append(spectrum)
                weights.append(row.weight)
                groups.append(group)
        return LightRig(tuple(lights), tuple(weights), groups=tuple(groups))

    def row_spectra(self, row: LightSpec, unsaved: Mapping[str, Spectrum]) -> dict[str, Spectrum]:
        """Return the spectra of a row by group."""
        if row.spectrum == ROOM_LIGHT:
            return self.own_spectra(row.group or "")
        try:
            spectrum = resolve_light(row.spectrum, row.name, self.grid, self.folder, unsaved)
        except InputError as error:
            if error.code != "unknown":
                raise
            guess = nearest(str(row.spectrum), [ROOM_LIGHT])
            remedy = f"{guess}{error.remedy}, or {ROOM_LIGHT}: the light of its file"
            raise SpectrumError(error.problem, remedy, code="unknown") from error
        return {row.group or "": spectrum}

    def own_spectra(self, group: str = "") -> dict[str, Spectrum]:
        """Return the spectra of the room's lights as its file gives them, by group.

        Their V-weighted mean is 1. Raises RoomError if no light has the group's name.
        """
        powers = self.response.solved.room.lights
        if group and group not in powers:
            raise unknown_light(group, powers)
        nm, V = self.grid.wavelengths_nm, colour_matching_functions(self.grid)[1]
        names = [group] if group or len(powers) == 1 else list(powers)
        spectra = {}
        for name in names:
            power = powers[name or next(iter(powers))]
            spectra[name] = Spectrum(nm, power * (V.sum() / (V @ power)), ROOM_LIGHT)
        return spectra

    def spectra(self, lamps: LightRig) -> Array:
        """Return the spectra (L, B) of a setting of the room's lights.

        Raises RoomError if the room has no light of a group's name.
        """
        power = np.zeros((len(self.response.names), self.grid.size))
        for spectrum, weight, group in zip(lamps.lights, lamps.weights, lamps.groups, strict=True):
            names = [group] if group else self.response.names
            power += self.response.spectra(dict.fromkeys(names, spectrum), weight)
        return power

    def rig(self, power: Array) -> tuple[Spectrum, LightRig]:
        """Return the light of spectra (L, B), W/m² per band: on the volume, and by group.

        Raises RoomError if no light reaches the volume.
        """
        groups = np.einsum("lgb,lb->gb", self.specimen.irradiance, power)
        if not groups.any():
            raise RoomError(
                "none of this light reaches the volume",
                "light another lamp of the room, or move the lamp or the volume",
                code="impossible",
            )
        names = self._group_names()
        if self.spec.walls:
            groups = np.concatenate([groups, power])
            names += self.wall_groups()
        lux = lux_from_irradiance(groups, self.grid) / self.parts[: len(groups)]
        nm = self.grid.wavelengths_nm
        nonzero = np.flatnonzero(lux > 0.0)
        spectra = tuple(Spectrum(nm, groups[g] / self.grid.step_nm, names[g]) for g in nonzero)
        rig = LightRig(spectra, (), tuple(lux[nonzero].tolist()), tuple(names[g] for g in nonzero))
        return rig.facing(self.shares()).mixed(self.grid), rig

    def shares(self) -> dict[str, float]:
        """Return each group's fraction of the light on a surface that faces all of them."""
        names = self._group_names()
        parts = self.parts[: len(names)]
        fractions = dict(zip(names, (parts / parts.sum()).tolist(), strict=True))
        return fractions | dict.fromkeys(self.wall_groups(), 0.0)

    # The eye.

    def viewing(
        self, viewing: Viewing, camera: CameraSpec, middle_mm: Vector = (0.0, 0.0, 0.0)
    ) -> Viewing:
        """Return viewing conditions in the room, of an eye that looks past the volume [method §8].

        Keys of ``viewing`` that differ from their defaults are kept. The luminances are relative to
        the light, so that a dimmed lamp dims them. ``middle_mm`` is the target of a camera that has
        a position alone.
        """
        place = np.array(self.spec.position_m)
        target = _triple(place - self._towards(camera, middle_mm))
        eye = Eye(position_m=self.spec.position_m, target_m=target)
        lux, default = self.specimen.brightest_lux, Viewing()
        background, L_A = cone_luminances(self.response.solved, eye, lux)
        if viewing.surround == default.surround:
            viewing = replace(viewing, surround=min(L_A * math.pi / lux, 1.0))
        if viewing.adapting != "given":  # measured in each picture
            return viewing
        if viewing.Y_b == default.Y_b:
            viewing = replace(viewing, Y_b=_percent(background * math.pi / lux))
        if viewing.L_A is None and viewing.Y_A is None:
            viewing = replace(viewing, Y_A=_percent(L_A * math.pi / lux))
        return viewing

    def _towards(self, camera: CameraSpec, middle_mm: Vector) -> Array:
        """Return the direction (3,) from the volume to the camera, in the room."""
        if camera.position_mm is not None:
            offset = np.subtract(camera.position_mm, camera.target_mm or middle_mm)
            if not (length := float(np.linalg.norm(offset))) > 0.0:  # refused at the cast
                return np.array([0.0, -1.0, 0.0])
            return np.asarray(self.placement.axes @ (offset / length))
        azimuth, elevation = math.radians(camera.azimuth_deg), math.radians(camera.elevation_deg)
        side, front, axis = level_axes(camera.up)
        around = math.cos(azimuth) * front + math.sin(azimuth) * side
        towards = math.cos(elevation) * around + math.sin(elevation) * axis
        return np.asarray(self.placement.axes @ towards)

    def extent_error(self, volume: Volume) -> float:
        """Return the error of the light on the largest ellipsoid in a volume's extent."""
        place = self.placement
        half_m = 0.5 * place.metres_per_mm * np.ptp(volume.corners_mm, axis=0)
        semi_axes = half_m[:, None] * place.axes.T
        return self.specimen.error_on(self.response.solved, place.position_m, semi_axes)

    # What is behind the volume.

    def behind(self, volume: Volume, basis: Basis) -> Backdrop | None:
        """Return the room behind a volume; None if it is not to be seen.

        Raises SceneError if the basis is of materials.
        """
        if not self.spec.walls:
            return None
        if isinstance(basis, MaterialBasis):
            raise SceneError(
                "walls have no channel in a basis of materials",
                'set walls = false, or another [basis] method, such as "virtual-sensors"',
                code="conflict",
                field="walls",
            )
        corners = volume.corners_mm
        middle = corners.mean(axis=0)
        place = self.placement
        rays = self.response.solved.rays
        for corner in [middle, *corners]:
            position_m = place.position_m + place.metres_per_mm * (place.axes @ (corner - middle))
            remedy = "change position_m or scale"
            require_inside(self.response.solved.room, rays, position_m, "the volume", remedy)
        radius = float(np.linalg.norm(corners - middle, axis=1).max())
        parts = self.parts[len(self.specimen.names) :]
        return Backdrop(self.response, self.placement, basis, parts, middle, radius)

    def with_paint(self, paint: Mapping[str, str], *, estimate: bool = False) -> SceneRoom:
        """Return the room with other paints, which replace those of the same surfaces.

        ``estimate`` takes the closed form (`RoomResponse.estimated`), from the room that was solved
        last. Raises RoomError if there is no such surface, SpectrumError if there is no such paint.
        """
        solved = self.estimated_from or self
        room = self.response.solved.room
        new = {surface for name in paint for surface in painted_surfaces(room, name)}
        before = {
            name: text
            for name, text in self.spec.paint.items()
            if name not in paint and not new.issuperset(painted_surfaces(room, name))
        }
        spec = replace(self.spec, paint={**before, **paint})
        # What was estimated meanwhile is part of the change, too.
        changed = {n: t for n, t in spec.paint.items() if solved.spec.paint.get(n) != t}
        paints = _paints(changed, room, self.folder)
        change = solved.response.estimated if estimate else solved.response.painted
        response = change(paints)
        return replace(
            self,
            spec=spec,
            response=response,
            specimen=self.specimen.under(response),
            estimated_from=solved if estimate else None,
        )

    @property
    def is_solved(self) -> bool:
        """False for an estimate."""
        return self.estimated_from is None

    def solved(self) -> SceneRoom:
        """Return the room, solved if it is an estimate."""
        return self if self.is_solved else self.with_paint({})


def _group_name(name: str) -> str:
    """Return a surface's name without what a light group's must not have."""
    kept = "".join(c if c.isprintable() and c not in "=;" else "-" for c in name)
    return kept.strip()[:MAX_NAME]


def _percent(ratio: float) -> float:
    """Return a luminance factor that the models accept."""
    return 100.0 * min(max(ratio, _MIN_BACKGROUND), MAX_BACKGROUND)


def _triple(vector: Array) -> Vector:
    x, y, z = vector.tolist()
    return x, y, z


def _paints(paint: Mapping[str, str], room: Room, folder: Path) -> dict[str, Spectrum]:
    """Return paints by surface; walls are four."""
    paints: dict[str, Spectrum] = {}
    for name, text in paint.items():
        reflectance = paint_named(text, room.grid, folder)
        paints |= dict.fromkeys(painted_surfaces(room, name), reflectance)
    return paints
