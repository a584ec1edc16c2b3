"""Look up the names in a scene's file: spectra, groups, lights, basis, volume.

SceneFile -> [resolve] -> Scene, volspec scene check
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import cielab, delta_E_2000
from volspec.basis import Basis, SpectralBasis, load_basis, visible_white
from volspec.errors import InputError, SceneError, SpectrumError, VolspecWarning, VolumeError
from volspec.raycast import RaycastSpec
from volspec.scene.basis import MAX_ERROR, SceneSpectra, grating_error, grid_of, use_of
from volspec.scene.fields import with_fields
from volspec.scene.file import SceneFaults, SceneFile
from volspec.scene.tables.lights import NamedLight, named_light, rows_by_name
from volspec.scene.tables.specs import EMPTY, ROOM_LIGHT, given_reflectance, resolve_light
from volspec.spectra import SpectralGrid, Spectrum, XYZ_from_spectra, white_XYZ
from volspec.spectra.files import palette_grid, rebase_address
from volspec.spectra.library import light_terms
from volspec.volume import (
    KEPT_BYTES,
    Known,
    Series,
    Volume,
    load_step,
    locate_volume,
    require_step,
    step_addresses,
    volume_or_steps,
)

if TYPE_CHECKING:
    from volspec.mesh import Mesh, MeshCaster
    from volspec.scene.room import SceneRoom

# Codes of the errors of a step that cannot be read.
_UNREADABLE = ("damaged", "not-found")
# Relative difference of two spacings that causes a warning.
_SPACING_ERROR = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Resolver:
    """Looks up the names in a file; errors name the file, the table and the row.

    Paths are relative to the folder of ``path``; ``unsaved`` are spectra that are not on disk
    yet, ``source`` is the volume if it is no file. With ``faults``, errors are collected there, and
    names that fail are left out.
    """

    file: SceneFile
    path: Path
    unsaved: Mapping[str, Spectrum] = field(default_factory=dict)
    faults: list[str] | None = None
    read: dict[int, Mesh] = field(default_factory=dict)
    source: Volume | Series | None = None

    @contextmanager
    def in_field(self, field: str) -> Iterator[None]:
        """Add the file and a field to an error in the body; the field counts rows from 0."""
        try:
            yield
        except SceneFaults as error:  # which have their places
            if self.faults is None:
                raise
            self.faults.extend(error.lines)
        except InputError as error:
            located = _at_field(error, field)
            rows = {
                key: [row.name for row in getattr(self.file, key)]
                for key in ("material", "group", "light", "field")
            }
            faults = SceneFaults(self.path, [located], rows)
            if self.faults is None:
                raise faults from error
            self.faults.extend(faults.lines)

    def eye_filter(self, grid: SpectralGrid) -> str | None:
        """Return the text of ``[viewing] filter``, checked, with an absolute path of a file."""
        text = self.file.viewing.filter
        if text is not None:
            text = rebase_address(text, self.path.parent, None)
            replace(self.file.viewing, filter=text).seen_through(grid)
        return text

    def shipped_basis(self) -> Basis | None:
        """Return the basis of ``[basis] name``."""
        name = self.file.basis.name
        basis = None
        if name is not None:
            with self.in_field("basis"):
                basis = load_basis(self._path(name) if self.file.basis.file else name)
        return basis

    def grid(self, shipped: Basis | None) -> SpectralGrid:
        """Return the grid of the scene's spectra: that of ``[basis]``, or else of its palettes.

        Of several palettes' grids it is the one with the most bands.
        """
        if shipped:
            return shipped.grid
        if self.file.basis.grid_nm is None and (grids := self.palette_grids().values()):
            return max(grids, key=lambda grid: grid.size)
        grid = SpectralGrid()
        with self.in_field("basis"):
            grid = grid_of(self.file.basis)
        return grid

    def palette_grids(self) -> dict[str, SpectralGrid]:
        """Return the grids of the spectra that the file takes from palettes, by address."""
        folder, grids = self.path.parent, dict[str, SpectralGrid]()
        for role, address in self._addresses():
            with suppress(SpectrumError):  # raised again where its row is looked up
                spectrum = self.unsaved.get(address)
                grid = spectrum.grid if spectrum else palette_grid(address, role, folder)
                if grid is not None:
                    grids[address] = grid
        return grids

    def _addresses(self) -> Iterator[tuple[Literal["light", "reflectance"], str]]:
        """Yield kind and name of all spectra that are given by name, each part of a mix alone."""
        for material in self.file.material:
            for source in (material.reflectance, material.filter):
                if isinstance(source, str):
                    yield "reflectance", source
        for light in self.file.light:
            if isinstance(light.spectrum, str) and light.spectrum in self.unsaved:
                yield "light", light.spectrum
            elif isinstance(light.spectrum, str):
                with suppress(SpectrumError):
                    for name, _ in light_terms(light.spectrum, os.fspath(self.path.parent)):
                        yield "light", name

    def warn_of_palette_grids(self, grid: SpectralGrid, materials: Mapping[str, Spectrum]) -> None:
        """Warn if the colours of palettes differ visibly on the scene's grid from their own.

        ``materials`` are the reflectances on the scene's grid.
        """
        grids = self.palette_grids()
        for native in set(grids.values()) - {grid}:
            designed = [name for name in grids if grids[name] == native]
            error, where = self._colour_change(native, grid, materials)
            if error > MAX_ERROR:
                remedy = f"grid_nm = [{native.start_nm:g}, {native.stop_nm:g}, {native.step_nm:g}]"
                warnings.warn(
                    f"{self.path}: {', '.join(designed)}: designed on {native.size} bands, but the "
                    f"scene has {grid.size}, which changes colours by up to ΔE00 {error:.1f} "
                    f"({where}); give [basis] {remedy}",
                    VolspecWarning,
                    stacklevel=4,
                )

    def warn_of_gratings(self, basis: Basis, spectra: SceneSpectra) -> None:
        """Warn if stripes of gratings differ visibly from those in all bands."""
        if spectra.gratings and isinstance(basis, SpectralBasis):
            error = grating_error(basis, spectra, self.file.viewing.mode, spectra.lights)
            if not error.acceptable:
                warnings.warn(
                    f"{self.path}: basis {basis.name!r} changes colours by {error}; give [basis] "
                    'method = "bands"',
                    VolspecWarning,
                    stacklevel=4,
                )

    def _colour_change(
        self, native: SpectralGrid, grid: SpectralGrid, materials: Mapping[str, Spectrum]
    ) -> tuple[float, str]:
        """Return the largest CIEDE2000 of a material between two grids, and its place."""
        designed = self.reflectances("reflectance", native)
        lights = [self._named_spectra(g) for g in (native, grid)]
        worst = (0.0, "")
        for (name, one), (_, two) in zip(*lights, strict=True):
            Lab = [
                cielab(self.file.viewing.viewing.exposure * XYZ, visible_white(white_XYZ(light)))
                for light, reflectances in ((one, designed), (two, materials))
                for XYZ in [XYZ_from_spectra(light, [reflectances[name] for name in materials])]
            ]
            errors = delta_E_2000(*Lab)
            k = int(errors.argmax())
            worst = max(worst, (float(errors[k]), f"{list(materials)[k]} under {name}"))
        return worst

    def _named_spectra(self, grid: SpectralGrid) -> list[tuple[str, Spectrum]]:
        """Return name and light of every setting; in a room, of every row."""
        if self.file.room is None:
            lights = self.lights(grid, self.file.cast, None)
            return [(light.name, light.spectrum) for light in lights]
        rows = (row for row in self.file.light if row.spectrum != ROOM_LIGHT)
        place = self.path.parent
        return [
            (row.name, resolve_light(row.spectrum, row.name, grid, place, self.unsaved))
            for row in rows
        ]

    def reflectances(
        self, key: Literal["reflectance", "filter"], grid: SpectralGrid
    ) -> dict[str, Spectrum]:
        """Return the spectra that the materials have for a key, by name."""
        spectra = {}
        for i, row in enumerate(self.file.material):
            if (source := getattr(row, key)) is not None:
                with self.in_field(f"material[{i}].{key}"):
                    spectra[row.name] = given_reflectance(
                        source, row.name, grid, self.path.parent, self.unsaved
                    )
        return spectra

    def room(self, grid: SpectralGrid) -> SceneRoom | None:
        """Return the room of ``[room]``, solved; None if there is none."""
        room = None
        if self.file.room is not None:
            # Imported late: ray tracing and statistics take a second, and few scenes have rooms.
            from volspec.scene.room import SceneRoom

            with self.in_field("room"):
                room = SceneRoom.of(self.file.room, self.path.parent, grid, self.file.camera.up)
        return room

    def meshes(
        self, volume: Volume, materials: Mapping[str, Spectrum], basis: Basis
    ) -> MeshCaster | None:
        """Return the surfaces of ``[[mesh]]`` that are shown; None without any."""
        surfaces = self.surfaces()
        if not surfaces:
            return None
        # Imported late: few scenes have meshes.
        from volspec.mesh import MeshCaster

        if self.file.volume.file != EMPTY:
            for mesh in surfaces:
                mesh.warn_of_unit(volume.corners_mm)
        caster = None
        with self.in_field("mesh"):
            caster = MeshCaster(surfaces, materials, basis)
        return caster

    def surfaces(self) -> list[Mesh]:
        """Return the rows of ``[[mesh]]`` that are shown."""
        meshes = []
        for number, row in enumerate(self.file.mesh):
            if row.shown:
                with self.in_field(f"mesh[{number}]"):
                    meshes.append(self._mesh(number))
        return meshes

    def _mesh(self, number: int) -> Mesh:
        """Return the surface of a row of ``[[mesh]]``, which is read once."""
        if number not in self.read:
            self.read[number] = self.file.mesh[number].mesh(self.path.parent)
        return self.read[number]

    def lights(
        self, grid: SpectralGrid, spec: RaycastSpec, room: SceneRoom | None
    ) -> list[NamedLight]:
        """Return the light settings, in the order of the file."""
        lights = []
        names = [row.name for row in self.file.light]
        for name, rows in rows_by_name(self.file.light).items():
            with self.in_field(f"light[{names.index(name)}]"):
                if room is not None:
                    lights.append(room.light(rows, self.unsaved))
                    continue
                if self.file.room is not None:  # which has a fault, reported before
                    folder = self.path.parent
                    for row in rows:
                        if row.spectrum != ROOM_LIGHT:
                            resolve_light(row.spectrum, row.name, grid, folder, self.unsaved)
                    continue
                fractions = spec.shares()
                lights.append(named_light(rows, fractions, grid, self.path.parent, self.unsaved))
        return lights

    def spectra(
        self,
        lights: list[NamedLight],
        materials: Mapping[str, Spectrum],
        filters: Mapping[str, Spectrum],
        room: SceneRoom | None,
    ) -> SceneSpectra:
        """Return the spectra to train a basis on."""
        use = use_of(self.file.transfer, *(row.transfer for row in self.file.field))
        # A material that the transfer function does not use is invisible, but may be used later.
        unseen = dict.fromkeys(materials, min(use.values(), default=1.0))
        rigs = [light.rig for light in lights]
        shone = [
            part for rig in rigs for part in zip(rig.lights, rig.weights, rig.groups, strict=True)
        ]
        walls = room.wall_groups() if room is not None and room.spec.walls else []
        volume_lights = [(light, weight) for light, weight, group in shone if group not in walls]
        return SceneSpectra(
            [light for light, _ in volume_lights],
            [weight for _, weight in volume_lights],
            materials,
            unseen | use,
            filters,
            self._mesh_colours(materials),
            room.paints if room is not None and walls else {},
            [light for light, _, group in shone if group in walls],
            self._gratings(next(iter(materials.values())).grid),
        )

    def _gratings(self, grid: SpectralGrid) -> dict[str, NDArray[np.float64]]:
        """Return reflectances of the gratings of meshes that are shown, by the mesh's name."""
        return {
            row.name: row.grating.spectra(grid)
            for row in self.file.mesh
            if row.grating is not None and row.shown
        }

    def _mesh_colours(self, materials: Mapping[str, Spectrum]) -> dict[str, Spectrum]:
        """Return reflectances of colours all over sRGB, if meshes have some; else nothing."""
        coloured = [
            row.own_colours or (row.texture and not row.materials) for row in self.file.mesh
        ]
        if not any(coloured) or self.file.basis.method == "materials":
            return {}
        # Imported late: few scenes have meshes.
        from volspec.mesh import some_colours

        return some_colours(next(iter(materials.values())).grid)

    def opened(self) -> tuple[Volume, Series | None]:
        """Load the volume, with the scene's spacing and downsampling, and the series it is of.

        Of a series all steps are opened, as they have one range; the volume is ``[volume] step``.
        Raises SceneError even with ``faults``, as nothing works without the volume.
        """
        table = self.file.volume
        if table.file == EMPTY:
            box_mm = table.box_mm
            corners = self._mesh_box() if box_mm is None else np.transpose(box_mm)
            return Volume.empty(*corners), None
        if isinstance(self.source, Series):
            return self.source[table.step], self.source
        with self._reading():
            address = locate_volume(table.file, self.path.parent)
            source = volume_or_steps(address) if self.source is None else self.source
        with self._reading():
            require_step(table.file, table.step, 1 if isinstance(source, Volume) else len(source))
        if isinstance(source, Volume):
            return self._prepared(source, (0, 1), {}), None
        series = self._series(source, KEPT_BYTES)
        return series[min(table.step, len(series) - 1)], series  # some may be left out

    def series(self, kept_bytes: int) -> Series | None:
        """Open the time steps of the volume; None if it has one.

        Raises SceneError even with ``faults``.
        """
        addresses = self.steps()
        return None if len(addresses) == 1 else self._series(addresses, kept_bytes)

    def steps(self) -> tuple[str, ...]:
        """Return the addresses of the volume's time steps; one if it is not a series."""
        table = self.file.volume
        if table.file == EMPTY or self.source is not None:
            return (table.file,) * (len(self.source) if isinstance(self.source, Series) else 1)
        with self._reading():
            return step_addresses(locate_volume(table.file, self.path.parent))

    def _series(self, addresses: tuple[str, ...], kept_bytes: int) -> Series:
        count = len(addresses)
        cache: Known = {}  # a further field that is no series is read once

        def load(number: int) -> Volume:
            try:
                return self._prepared(load_step(addresses[number], number), (number, count), cache)
            except SceneFaults as error:
                cause = error.__cause__
                if isinstance(cause, VolumeError) and cause.code in _UNREADABLE:
                    raise cause from error  # of a field's step, which is left out
                raise

        loads = [partial(load, number) for number in range(len(addresses))]
        with self._reading():
            return Series(loads, addresses, kept_bytes)

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Add the file and ``[volume]`` to an error in the body, even with ``faults``."""
        with Resolver(self.file, self.path).in_field("volume"):
            try:
                yield
            except VolumeError as error:
                if error.code != "not-found":
                    raise
                remedy = f"{error.remedy}, or edit `file` in [volume] of {self.path}"
                raise VolumeError(error.problem, remedy, code=error.code) from error

    def _prepared(self, volume: Volume, step: tuple[int, int], cache: Known) -> Volume:
        """Return a volume with the scene's spacing, downsampling and further fields."""
        table = self.file.volume
        with self._reading():
            if table.spacing_mm:
                if step[0] == 0:
                    self._warn_of_spacing(volume, table.spacing_mm)
                volume = volume.with_spacing(table.spacing_mm)
            if table.downsample != 1:
                labels = self.file.transfer.kind == "labels"
                volume = volume.downsampled(table.downsample, labels=labels)
        strict = Resolver(self.file, self.path)
        file = self.file
        tables = file.transfer, file.field, self.path.parent, strict.in_field
        return with_fields(volume, *tables, step, cache)

    def _mesh_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return two corners of the box around all meshes, also those that are not shown."""
        strict = replace(self, faults=None)
        ends = []
        for number in range(len(self.file.mesh)):
            with strict.in_field(f"mesh[{number}]"):
                points = self._mesh(number).points_mm
                ends.append((points.min(axis=0), points.max(axis=0)))
        low, high = zip(*ends, strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)

    def _warn_of_spacing(self, volume: Volume, scene_mm: tuple[float, float, float]) -> None:
        # A file without a spacing loads with a spacing of 1 mm.
        stored = volume.spacing_mm
        if stored == (1.0, 1.0, 1.0) or np.allclose(scene_mm, stored, rtol=_SPACING_ERROR, atol=0):
            return
        ours, theirs = (" × ".join(f"{s:g}" for s in spacing) for spacing in (scene_mm, stored))
        warnings.warn(
            f"{self.path}: [volume] spacing_mm is {ours}, {volume.name} says {theirs}; the "
            "scene's is used, leave it out to use the file's",
            VolspecWarning,
            stacklevel=4,
        )

    def _path(self, name: str) -> str:
        """Return a path in the scene, relative to the scene and never to the working folder."""
        return os.fspath(self.path.parent / name)


def _at_field(error: InputError, field: str) -> SceneError:
    """Return the error with the file's field in place of Python's class names."""
    owner, _, attribute = error.field.partition(".")
    if attribute and re.fullmatch(r"[A-Z]\w+", owner):
        field = f"{field}.{attribute}"
        problem, remedy = error.problem, error.remedy
    else:
        problem = str(error).removesuffix(f"; {error.remedy}").removeprefix(f"{field}: ")
        remedy = error.remedy if problem != str(error) else ""
    return SceneError(problem, remedy, code=error.code, field=field, given=error.given)
