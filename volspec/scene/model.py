"""The scene file: TOML in, frozen specs out.

Tables: ``[volume]``, ``[[material]]``, ``[transfer]``, ``[basis]``, ``[camera]``, ``[raycast]``,
``[[light]]``, ``[viewing]``, ``[output]`` (`volspec.scene.tables`). Paths are relative to the
file.
"""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from volspec.basis import load_basis
from volspec.errors import DeviceError, ImageError, SceneError, VolspecError
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.raycast.gpu import Progress
from volspec.relight import LightRig
from volspec.scene.basis import (
    ChosenBasis,
    SceneSpectra,
    choose_basis,
    grid_of,
    retrained,
    use_of,
)
from volspec.scene.tables import LightTable, SceneFile, ViewingTable, explained
from volspec.spectra import SpectralGrid, Spectrum, light, reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, load_volume


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


@dataclass(frozen=True, slots=True, eq=False)
class NamedLight:
    """A light of a scene: file name, caption, spectrum, and the rig that lights the picture."""

    name: str
    label: str
    spectrum: Spectrum
    rig: LightRig


class Scene:
    """A scene file, checked; everything a picture needs but the volume's voxels.

    Parameters
    ----------
    file : SceneFile
    path : path
        Where it was read, for messages; its folder is what relative paths start from.

    Raises
    ------
    SceneError
        If a spectrum, basis, transfer function or viewing condition cannot be built; the
        message names the table.
    """

    def __init__(self, file: SceneFile, path: str | os.PathLike[str] = "scene") -> None:
        self.file = file
        self.path = Path(path)
        self.folder = self.path.parent
        _named = self._named
        with _named("[basis]"):
            shipped = None
            if file.basis.name is not None:
                shipped = load_basis(self._basis_file(file.basis.name))
            grid = shipped.grid if shipped else grid_of(file.basis)
        with _named("[[material]]"):
            self.materials = {
                row.name: reflectance(row.reflectance, grid, folder=self.folder)
                for row in file.material
            }
        with _named("[[light]]"):
            self.lights = [self._light(row, grid) for row in file.light]
        with _named("[basis]"):
            if shipped:
                chosen = ChosenBasis(shipped, "the scene names it")
            else:
                chosen = choose_basis(
                    file.basis, self._spectra(), self._basis_name(), file.viewing.mode
                )
            self.basis, self.basis_reason = chosen.basis, chosen.reason
        with _named("[transfer]"):
            self.transfer = TransferFunction(
                points=[(p.value, p.opacity, p.material) for p in file.transfer.points],
                materials=self.materials,
                basis=self.basis,
                reference_step_mm=file.transfer.reference_step_mm,
            )
        with _named("[viewing]"):
            self.relight = file.viewing.spec()
        with _named("[raycast]"):
            self.raycast = RaycastSpec(**file.raycast.model_dump())

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
            data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise SceneError(f"{name}: {error.strerror or 'cannot be read'}") from error
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise SceneError(f"{name}: not valid TOML: {error}") from error
        try:
            if basis:
                data["basis"] = retrained(data.get("basis", {}), basis)
            return cls(SceneFile.model_validate(data), path)
        except ValidationError as error:
            raise SceneError(f"{name}: {explained(error)}") from error

    def volume(self) -> Volume:
        """Read the volume."""
        table = self.file.volume
        with self._named("[volume]"):
            volume = load_volume(self._file(table.file))
            return volume.with_spacing(table.spacing_mm) if table.spacing_mm else volume

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
        device: str | None = None,
        progress: Progress | None = None,
        caster: Raycaster | None = None,
    ) -> CoefficientImage:
        """Cast the scene once.

        Parameters
        ----------
        volume : Volume, optional
            The scene's, where it is loaded already.
        device, progress, caster
            As `volspec.raycast`.
        """
        volume = volume or self.volume()
        output = self.file.output
        return raycast(
            volume,
            self.transfer,
            self.camera(volume),
            (output.width, output.height),
            self.raycast,
            device=device,
            progress=progress,
            caster=caster,
            notes={"scene": self.file.title, "viewing": self.file.viewing.model_dump_json()},
        )

    @contextmanager
    def _named(self, table: str) -> Iterator[None]:
        """Put the file's and the table's name before the message of what goes wrong inside."""
        try:
            yield
        except DeviceError:
            raise
        except VolspecError as error:
            raise SceneError(f"{self.path}: {table} {error}") from error

    def _spectra(self) -> SceneSpectra:
        points = self.file.transfer.points
        # A material that no point names is not seen, but may be picked later.
        use = dict.fromkeys(self.materials, min(use_of(points).values(), default=1.0))
        return SceneSpectra(
            [light.spectrum for light in self.lights],
            [row.weight for row in self.file.light],
            self.materials,
            use | use_of(points),
        )

    def _basis_name(self) -> str:
        return self.file.title or self.path.stem

    def _basis_file(self, name: str) -> str:
        return self._file(name) if name.endswith(".json") else name

    def _light(self, row: LightTable, grid: SpectralGrid) -> NamedLight:
        spectrum = light(row.spectrum, grid, folder=self.folder)
        lux = None if row.illuminance_lux is None else (row.illuminance_lux,)
        rig = LightRig((spectrum,), (row.weight,), lux)
        return NamedLight(row.name, row.label or row.name, spectrum, rig)

    def _file(self, name: str) -> str:
        """A file named in the scene: relative to the scene, never to where the program runs."""
        return os.fspath(self.folder / name)
