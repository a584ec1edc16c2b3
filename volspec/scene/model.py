"""The scene file: TOML in, frozen specs out.

Tables: ``[volume]``, ``[[material]]``, ``[transfer]``, ``[basis]``, ``[camera]``, ``[raycast]``,
``[[group]]``, ``[[light]]``, ``[viewing]``, ``[output]`` (`volspec.scene.file`; for users
docs/scenes.md). Paths are relative to the file.
"""

from __future__ import annotations

import json
import os
import tomllib
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from volspec.basis import load_basis
from volspec.errors import ImageError, InputError, SceneError, VolspecWarning
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.raycast.bands import Cancel, Progress
from volspec.scene.basis import (
    ChosenBasis,
    SceneSpectra,
    choose_basis,
    grid_of,
    retrained,
    use_of,
)
from volspec.scene.file import SceneFile, explained
from volspec.scene.lights import named_light, rows_by_name
from volspec.scene.tables import ViewingTable
from volspec.spectra import SpectralGrid, Spectrum, reflectance
from volspec.volume import Volume, load_volume

# What two spacings may differ by, relatively, before anyone is told.
_SPACING_ERROR = 1e-4


def viewing_of(image: CoefficientImage) -> ViewingTable:
    """The ``[viewing]`` of the scene an image was cast from; the defaults where it has none.

    Raises
    ------
    ImageError
        If the image's note cannot be read.
    """
    try:
        return ViewingTable.model_validate(json.loads(image.notes.get("viewing", "{}")))
    except (ValueError, TypeError) as error:  # pydantic's and json's errors are ValueErrors
        raise ImageError(
            "the image's viewing note cannot be read; was it made by a later version? Render again"
        ) from error


class Scene:
    """A scene file, checked; everything a picture needs but the volume's voxels.

    Parameters
    ----------
    file : SceneFile
    path : path
        Where it was read, for messages; its folder is what relative paths start from.
    known : {address: Spectrum}, optional
        What texts of the file stand for before they are files: spectra just designed.

    Raises
    ------
    SceneError
        If a spectrum, basis, transfer function or viewing condition cannot be built; the
        message names the table.
    """

    def __init__(
        self,
        file: SceneFile,
        path: str | os.PathLike[str] = "scene",
        known: Mapping[str, Spectrum] | None = None,
    ) -> None:
        self.file = file
        self._known = dict(known or {})
        self.path = Path(path)
        self.folder = self.path.parent
        _named = self._named
        with _named("[basis]"):
            shipped = None
            if file.basis.name is not None:
                shipped = load_basis(self._basis_file(file.basis.name))
            grid = shipped.grid if shipped else grid_of(file.basis)
        self.materials = self._reflectances("reflectance", grid)
        filters = self._reflectances("filter", grid)
        groups = []
        for row in file.group:
            with _named(f"[[group]] {row.name}:"):
                groups.append(row.group())
        with _named("[raycast]"):
            self.raycast = file.raycast.spec(tuple(groups) or RaycastSpec().groups)
        self.lights = []
        for name, rows in rows_by_name(file.light).items():
            with _named(f"[[light]] {name}:"):
                shares = self.raycast.shares()
                self.lights.append(named_light(rows, shares, grid, self.folder, self._known))
        with _named("[basis]"):
            if shipped:
                chosen = ChosenBasis(shipped, "the scene names it")
            else:
                spectra = self._spectra(filters)
                chosen = choose_basis(file.basis, spectra, self._basis_name(), file.viewing.mode)
            self.basis, self.basis_reason = chosen.basis, chosen.reason
        with _named("[transfer]"):
            self.transfer = file.transfer.function(self.materials, filters, self.basis)
        with _named("[viewing]"):
            self.viewing = file.viewing.beside(self.folder)
            self.relight = self.viewing.spec()

    @classmethod
    def load(cls, path: str | os.PathLike[str], basis: Mapping[str, object] | None = None) -> Scene:
        """Read and check a scene file.

        Parameters
        ----------
        path : path
        basis : {key: value}, optional
            Keys of ``[basis]`` to try instead of the file's, such as ``{"size": 9}``; the scene
            is then trained for, or cast by its materials where ``method`` says so.

        Raises
        ------
        SceneError
            If the file is missing, is no TOML, or a field is unknown or wrong; the message
            names file, field and value.
        """
        name = os.fspath(path)
        try:
            data = tomllib.loads(Path(path).read_text(encoding="utf-8-sig"))
        except FileNotFoundError:
            raise SceneError(f"{name}: no such file; check the path") from None
        except IsADirectoryError:
            raise SceneError(f"{name}: is a folder; give a scene file") from None
        except OSError as error:
            raise SceneError(
                f"{name}: cannot be read: {error.strerror or error}; check the path and its "
                "permissions"
            ) from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise SceneError(f"{name}: not valid TOML: {error}") from error
        try:
            if basis:
                data["basis"] = retrained(data.get("basis", {}), basis)
            return cls(SceneFile.model_validate(data), path)
        except ValidationError as error:
            raise SceneError(f"{name}: {explained(error)}") from error

    def volume(self) -> Volume:
        """Read the volume; its spacing and size as the scene wants them."""
        table = self.file.volume
        with self._named("[volume]"):
            volume = load_volume(self._file(table.file))
            if table.spacing_mm:
                self._warn_of_spacing(volume, table.spacing_mm)
                volume = volume.with_spacing(table.spacing_mm)
            if table.downsample == 1:
                return volume
            return volume.downsampled(table.downsample, labels=self.file.transfer.kind == "labels")

    def camera(self, volume: Volume) -> Camera:
        """The camera, placed for a volume."""
        table = self.file.camera
        with self._named("[camera]"):
            if table.position_mm is None:
                return Camera.orbit(volume, **table.model_dump(exclude={"position_mm"}))
            target = table.target_mm or tuple(volume.corners_mm.mean(axis=0))
            return Camera(table.position_mm, target, table.up, table.fov_deg)

    def render(
        self,
        volume: Volume | None = None,
        *,
        size: tuple[int, int] | None = None,
        spec: RaycastSpec | None = None,
        device: str | None = None,
        progress: Progress | None = None,
        cancel: Cancel | None = None,
        caster: Raycaster | None = None,
    ) -> CoefficientImage:
        """Cast the scene once.

        Parameters
        ----------
        volume : Volume, optional
            The scene's, where it is loaded already.
        size, spec : optional
            In place of the scene's (width, height) and ``[raycast]``.
        device, progress, cancel, caster
            As `volspec.raycast`.

        Raises
        ------
        SceneError
            If volume, transfer function and settings cannot be cast together.
        OpenCLError
            If there is no device or it lacks memory.
        CastCancelled
            If ``cancel`` ended it.
        """
        volume = volume or self.volume()
        output = self.file.output
        camera = self.camera(volume)
        with self._named():
            return raycast(
                *(volume, self.transfer, camera, size or (output.width, output.height)),
                spec or self.raycast,
                device=device,
                progress=progress,
                cancel=cancel,
                caster=caster,
                notes={"scene": self.file.title, "viewing": self.viewing.model_dump_json()},
            )

    @contextmanager
    def _named(self, table: str = "") -> Iterator[None]:
        """Put the file's and the table's name before the message of what goes wrong inside."""
        try:
            yield
        except InputError as error:
            where = f"{self.path}: {table} " if table else f"{self.path}: "
            # "[raycast] raycast: shininess is …" would say it twice.
            said = str(error).removeprefix(f"{table.strip('[]')}: ")
            raise SceneError(f"{where}{said}") from error

    def _reflectances(self, key: str, grid: SpectralGrid) -> dict[str, Spectrum]:
        """What the materials have under a key, by name."""
        found = {}
        for row in self.file.material:
            if (text := getattr(row, key)) is not None:
                with self._named(f"[[material]] {row.name}: {key}:"):
                    known = self._known.get(text)
                    found[row.name] = known or reflectance(text, grid, folder=self.folder)
        return found

    def _spectra(self, filters: Mapping[str, Spectrum]) -> SceneSpectra:
        use = use_of(self.file.transfer)
        # A material that the function does not name is not seen, but may be picked later.
        unseen = dict.fromkeys(self.materials, min(use.values(), default=1.0))
        rigs = [light.rig for light in self.lights]
        return SceneSpectra(
            [spectrum for rig in rigs for spectrum in rig.lights],
            [weight for rig in rigs for weight in rig.weights],
            self.materials,
            unseen | use,
            filters,
        )

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
            stacklevel=3,
        )

    def _basis_name(self) -> str:
        return self.file.title or self.path.stem

    def _basis_file(self, name: str) -> str:
        return self._file(name) if name.endswith(".json") else name

    def _file(self, name: str) -> str:
        """A file named in the scene: relative to the scene, never to where the program runs."""
        return os.fspath(self.folder / name)
