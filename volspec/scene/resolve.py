"""Look up the names in a scene's file: spectra, groups, lights, basis, volume.

SceneFile -> [resolve] -> Scene, volspec scene check
"""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from volspec.basis import Basis, load_basis
from volspec.errors import InputError, SceneError, VolspecWarning
from volspec.raycast import RaycastSpec
from volspec.scene.basis import SceneSpectra, grid_of, use_of
from volspec.scene.file import SceneFaults, SceneFile
from volspec.scene.lights import NamedLight, named_light, rows_by_name
from volspec.scene.specs import given_reflectance
from volspec.spectra import SpectralGrid, Spectrum
from volspec.volume import Volume, load_volume
from volspec.volume.bundled import locate_volume

# Relative difference of two spacings that causes a warning.
_SPACING_ERROR = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Resolver:
    """Looks up the names in a file; errors name the file, the table and the row.

    Paths are relative to the folder of ``path``; ``known`` are spectra that are not on disk
    yet. With ``faults``, errors are collected there, and names that fail are left out.
    """

    file: SceneFile
    path: Path
    known: Mapping[str, Spectrum] = field(default_factory=dict)
    faults: list[str] | None = None

    @contextmanager
    def at(self, field: str) -> Iterator[None]:
        """Add the file and a field to an error in the body; the field counts rows from 0."""
        try:
            yield
        except InputError as error:
            found = _at_field(error, field)
            rows = {
                key: [row.name for row in getattr(self.file, key)]
                for key in ("material", "group", "light")
            }
            faults = SceneFaults(self.path, [found], rows)
            if self.faults is None:
                raise faults from error
            self.faults.extend(faults.lines)

    def shipped_basis(self) -> Basis | None:
        """Return the basis of ``[basis] name``."""
        name = self.file.basis.name
        found = None
        if name is not None:
            with self.at("basis"):
                found = load_basis(self._path(name) if self.file.basis.file else name)
        return found

    def grid(self, shipped: Basis | None) -> SpectralGrid:
        """Return the grid of the scene's spectra."""
        grid = shipped.grid if shipped else SpectralGrid()
        with self.at("basis"):
            grid = shipped.grid if shipped else grid_of(self.file.basis)
        return grid

    def reflectances(
        self, key: Literal["reflectance", "filter"], grid: SpectralGrid
    ) -> dict[str, Spectrum]:
        """Return the spectra that the materials have for a key, by name."""
        found = {}
        for i, row in enumerate(self.file.material):
            if (given := getattr(row, key)) is not None:
                with self.at(f"material[{i}].{key}"):
                    found[row.name] = given_reflectance(
                        given, row.name, grid, self.path.parent, self.known
                    )
        return found

    def lights(self, grid: SpectralGrid, spec: RaycastSpec) -> list[NamedLight]:
        """Return the light settings, in the order of the file."""
        found = []
        names = [row.name for row in self.file.light]
        for name, rows in rows_by_name(self.file.light).items():
            with self.at(f"light[{names.index(name)}]"):
                shares = spec.shares()
                found.append(named_light(rows, shares, grid, self.path.parent, self.known))
        return found

    def spectra(
        self,
        lights: list[NamedLight],
        materials: Mapping[str, Spectrum],
        filters: Mapping[str, Spectrum],
    ) -> SceneSpectra:
        """Return the spectra to train a basis on."""
        use = use_of(self.file.transfer)
        # A material that the transfer function does not use is invisible, but may be used later.
        unseen = dict.fromkeys(materials, min(use.values(), default=1.0))
        rigs = [light.rig for light in lights]
        return SceneSpectra(
            [spectrum for rig in rigs for spectrum in rig.lights],
            [weight for rig in rigs for weight in rig.weights],
            materials,
            unseen | use,
            filters,
        )

    def volume(self) -> Volume:
        """Load the volume, with the scene's spacing and downsampling.

        Raises SceneError even with ``faults``, as nothing works without the volume.
        """
        table = self.file.volume
        with Resolver(self.file, self.path).at("volume"):
            volume = load_volume(locate_volume(table.file, self.path.parent))
            if table.spacing_mm:
                self._warn_of_spacing(volume, table.spacing_mm)
                volume = volume.with_spacing(table.spacing_mm)
            if table.downsample != 1:
                labels = self.file.transfer.kind == "labels"
                volume = volume.downsampled(table.downsample, labels=labels)
        return volume

    def _warn_of_spacing(self, volume: Volume, given: tuple[float, float, float]) -> None:
        # A file without a spacing loads with a spacing of 1 mm.
        own = volume.spacing_mm
        if own == (1.0, 1.0, 1.0) or np.allclose(given, own, rtol=_SPACING_ERROR, atol=0):
            return
        ours, theirs = (" × ".join(f"{s:g}" for s in spacing) for spacing in (given, own))
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
    owner, _, rest = error.field.partition(".")
    if rest and re.fullmatch(r"[A-Z]\w+", owner):
        field = f"{field}.{rest}"
        problem, remedy = error.problem, error.remedy
    else:
        problem = str(error).removesuffix(f"; {error.remedy}").removeprefix(f"{field}: ")
        remedy = error.remedy if problem != str(error) else ""
    return SceneError(problem, remedy, code=error.code, field=field, given=error.given)
