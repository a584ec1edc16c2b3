"""What a scene's file names, looked up: spectra, groups, lights, basis, volume.

SceneFile -> [resolve] -> Scene, volspec scene check
"""

from __future__ import annotations

import os
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
from volspec.scene.file import SceneFile
from volspec.scene.lights import NamedLight, named_light, rows_by_name
from volspec.scene.spectra import given_reflectance
from volspec.scene.tables import ViewingTable
from volspec.scene.wording import in_keys
from volspec.spectra import SpectralGrid, Spectrum
from volspec.volume import Volume, load_volume

# What two spacings may differ by, relatively, before anyone is told.
_SPACING_ERROR = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Resolver:
    """Looks up what a file names; an error says the file, the table and the row.

    Parameters
    ----------
    file : SceneFile
    path : path
        Its folder is what relative names start from.
    known : {text: Spectrum}
        What texts of the file stand for before they are files.
    faults : list of str, optional
        Where errors go instead of being raised; what cannot be looked up is then left out.
    """

    file: SceneFile
    path: Path
    known: Mapping[str, Spectrum] = field(default_factory=dict)
    faults: list[str] | None = None

    @contextmanager
    def named(self, table: str = "") -> Iterator[None]:
        """Put the file's and the table's name before the message of what goes wrong inside."""
        try:
            yield
        except InputError as error:
            where = f"{self.path}: {table} " if table else f"{self.path}: "
            # "[raycast] raycast: shininess is …" would say it twice.
            said = where + in_keys(str(error).removeprefix(f"{table.strip('[]')}: "))
            if self.faults is None:
                raise SceneError(said) from error
            self.faults.append(said)

    def shipped_basis(self) -> Basis | None:
        """The basis that ``[basis] name`` names."""
        name = self.file.basis.name
        found = None
        if name is not None:
            with self.named("[basis]"):
                found = load_basis(self._path(name) if self.file.basis.file else name)
        return found

    def grid(self, shipped: Basis | None) -> SpectralGrid:
        """What spectra are on."""
        grid = shipped.grid if shipped else SpectralGrid()
        with self.named("[basis]"):
            grid = shipped.grid if shipped else grid_of(self.file.basis)
        return grid

    def reflectances(
        self, key: Literal["reflectance", "filter"], grid: SpectralGrid
    ) -> dict[str, Spectrum]:
        """What the materials have under a key, by name."""
        found = {}
        for row in self.file.material:
            if (given := getattr(row, key)) is not None:
                with self.named(f"[[material]] {row.name}: {key}:"):
                    found[row.name] = given_reflectance(
                        given, row.name, grid, self.path.parent, self.known
                    )
        return found

    def raycast(self) -> RaycastSpec:
        """The settings of the cast, with the groups."""
        groups = []
        for row in self.file.group:
            with self.named(f"[[group]] {row.name}:"):
                groups.append(row.group())
        spec = RaycastSpec()
        with self.named("[raycast]"):
            spec = self.file.raycast.spec(tuple(groups) or spec.groups)
        return spec

    def lights(self, grid: SpectralGrid, spec: RaycastSpec) -> list[NamedLight]:
        """The settings of lights, in the order of the file."""
        found = []
        for name, rows in rows_by_name(self.file.light).items():
            with self.named(f"[[light]] {name}:"):
                shares = spec.shares()
                found.append(named_light(rows, shares, grid, self.path.parent, self.known))
        return found

    def viewing(self) -> ViewingTable:
        """``[viewing]``, with the numbers of a display's profile in place of its name."""
        table = self.file.viewing
        with self.named("[viewing]"):
            table = table.beside(self.path.parent)
            table.spec()
        return table

    def spectra(
        self,
        lights: list[NamedLight],
        materials: Mapping[str, Spectrum],
        filters: Mapping[str, Spectrum],
    ) -> SceneSpectra:
        """What a basis would be trained on."""
        use = use_of(self.file.transfer)
        # A material that the function does not name is not seen, but may be picked later.
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
        """The volume, its spacing and size as the file wants them.

        Raises
        ------
        SceneError
            Always, where there is none: there is no going on without one.
        """
        table = self.file.volume
        with Resolver(self.file, self.path).named("[volume]"):
            volume = load_volume(self._path(table.file))
            if table.spacing_mm:
                self._warn_of_spacing(volume, table.spacing_mm)
                volume = volume.with_spacing(table.spacing_mm)
            if table.downsample != 1:
                labels = self.file.transfer.kind == "labels"
                volume = volume.downsampled(table.downsample, labels=labels)
        return volume

    def _warn_of_spacing(self, volume: Volume, given: tuple[float, float, float]) -> None:
        # A file without a spacing loads with ones.
        own = volume.spacing_mm
        if own == (1.0, 1.0, 1.0) or np.allclose(given, own, rtol=_SPACING_ERROR, atol=0):
            return
        ours, theirs = (" × ".join(f"{s:g}" for s in spacing) for spacing in (given, own))
        warnings.warn(
            f"{self.path}: [volume] spacing_mm is {ours}, {volume.name} says {theirs}; the "
            "scene's is taken, leave it out to take the file's",
            VolspecWarning,
            stacklevel=4,
        )

    def _path(self, name: str) -> str:
        """A file named in the scene: relative to the scene, never to where the program runs."""
        return os.fspath(self.path.parent / name)
