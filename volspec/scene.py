"""The scene file: TOML in, frozen specs out.

Tables: ``[volume]``, ``[[material]]``, ``[transfer]``, ``[basis]``, ``[camera]``, ``[raycast]``,
``[[light]]``, ``[viewing]``, ``[output]``. Paths are relative to the file. An unknown key is an
error, so that a misspelt setting never passes silently.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from volspec.appearance import Viewing
from volspec.basis import SpectralBasis
from volspec.errors import SceneError, VolspecError
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.raycast.gpu import Progress
from volspec.relight import RelightSpec
from volspec.spectra import Spectrum, light, reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, load_volume

Vector = tuple[float, float, float]
_CAST = RaycastSpec()


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class VolumeTable(_Table):
    """``[volume]``: the file, and spacing where the file has none."""

    file: str
    spacing_mm: Vector | None = None


class MaterialTable(_Table):
    """``[[material]]``: a name the transfer function uses, and a reflectance."""

    name: str
    reflectance: str


class PointTable(_Table):
    """One point of the transfer function."""

    value: float
    opacity: float
    material: str | dict[str, float]


class TransferTable(_Table):
    """``[transfer]``: points, and the length over which an opacity holds."""

    points: Annotated[list[PointTable], Field(min_length=1)]
    reference_step_mm: float | None = None


class BasisTable(_Table):
    """``[basis]``: one that ships, or one trained on the scene's own spectra."""

    name: str | None = None
    train: Literal["scene"] | None = None
    method: Literal["virtual-sensors", "pca-sharpened"] = "virtual-sensors"
    size: int = 7

    @model_validator(mode="after")
    def _one_source(self) -> BasisTable:
        if self.name is not None and self.train is not None:
            raise ValueError("give name (a shipped basis) or train, not both")
        return self


class CameraTable(_Table):
    """``[camera]``: an orbit around the volume, or an explicit position."""

    azimuth_deg: float = 30.0
    elevation_deg: float = 20.0
    zoom: float = 1.0
    fov_deg: float = 30.0
    orthographic: bool = False
    position_mm: Vector | None = None
    target_mm: Vector | None = None
    up: Vector = (0.0, 0.0, 1.0)


class RaycastTable(_Table):
    """``[raycast]``: see `volspec.RaycastSpec`."""

    step_mm: float | None = None
    ambient: float = _CAST.ambient
    diffuse: float = _CAST.diffuse
    specular: float = _CAST.specular
    shininess: int = _CAST.shininess
    flat_gradient: float = _CAST.flat_gradient


class LightTable(_Table):
    """``[[light]]``: a name and a spectrum in `volspec.light`'s notation."""

    name: str
    spectrum: str
    label: str | None = None
    weight: float = 1.0
    illuminance_lux: float | None = None


class ViewingTable(_Table):
    """``[viewing]``: see `volspec.Viewing`; and the backdrop's reflectance."""

    model: str = "CIECAM02"
    L_A: float | None = None
    Y_b: float = 20.0
    surround: str = "average"
    D: float | None = None
    backdrop: float = 0.2
    mode: str = "componentwise"


class OutputTable(_Table):
    """``[output]``: the picture's size in pixels."""

    width: Annotated[int, Field(ge=1, le=8192)] = 512
    height: Annotated[int, Field(ge=1, le=8192)] = 512


class SceneFile(_Table):
    """The whole file."""

    title: str = ""
    volume: VolumeTable
    material: Annotated[list[MaterialTable], Field(min_length=1)]
    transfer: TransferTable
    basis: BasisTable = BasisTable(name="general-7")
    camera: CameraTable = CameraTable()
    raycast: RaycastTable = RaycastTable()
    light: Annotated[list[LightTable], Field(min_length=1)]
    viewing: ViewingTable = ViewingTable()
    output: OutputTable = OutputTable()

    @model_validator(mode="after")
    def _names_are_unique(self) -> SceneFile:
        for kind, rows in (("material", self.material), ("light", self.light)):
            names = [row.name for row in rows]
            twice = next((name for name in names if names.count(name) > 1), None)
            if twice is not None:
                raise ValueError(f"two [[{kind}]] are named {twice!r}; rename one")
        return self


class NamedLight(BaseModel):
    """A light of a scene: file name, caption and spectrum."""

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)

    name: str
    label: str
    spectrum: Spectrum
    illuminance_lux: float | None


class Scene:
    """A scene file, checked; everything a picture needs but the volume's voxels.

    Parameters
    ----------
    file : SceneFile
    folder : path
        What relative paths start from.

    Raises
    ------
    SceneError
        If a spectrum, basis, transfer function or viewing condition cannot be built; the
        message names the table.
    """

    def __init__(self, file: SceneFile, folder: str | os.PathLike[str] = ".") -> None:
        self.file = file
        self.folder = Path(folder)
        with _named("[[material]]"):
            self.materials = {
                row.name: reflectance(self._local(row.reflectance)) for row in file.material
            }
        with _named("[[light]]"):
            self.lights = [
                NamedLight(
                    name=row.name,
                    label=row.label or row.name,
                    spectrum=light(self._local(row.spectrum)) * row.weight,
                    illuminance_lux=row.illuminance_lux,
                )
                for row in file.light
            ]
        with _named("[basis]"):
            self.basis = self._basis()
        with _named("[transfer]"):
            self.transfer = TransferFunction(
                points=[(p.value, p.opacity, p.material) for p in file.transfer.points],
                materials=self.materials,
                basis=self.basis,
                reference_step_mm=file.transfer.reference_step_mm,
            )
        with _named("[viewing]"):
            settings = file.viewing.model_dump()
            relit = {key: settings.pop(key) for key in ("backdrop", "mode")}
            self.relight = RelightSpec(viewing=Viewing(**settings), **relit)
        with _named("[raycast]"):
            self.raycast = RaycastSpec(**file.raycast.model_dump())

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Scene:
        """Read and check a scene file.

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
            return cls(SceneFile.model_validate(data), Path(path).parent)
        except ValidationError as error:
            first = error.errors()[0]
            field = ".".join(str(part) for part in first["loc"]) or "scene"
            what = first["msg"].removeprefix("Value error, ")
            value = "" if first["type"] == "missing" else f" (it is {first['input']!r:.60})"
            raise SceneError(f"{name}: {field}: {what}{value}") from error
        except SceneError as error:
            raise SceneError(f"{name}: {error}") from error

    def volume(self) -> Volume:
        """Read the volume."""
        table = self.file.volume
        volume = load_volume(self._local(table.file))
        if table.spacing_mm is None:
            return volume
        with _named("[volume]"):
            return Volume(volume.values, spacing_mm=table.spacing_mm, name=volume.name)

    def camera(self, volume: Volume) -> Camera:
        """The camera, placed for a volume."""
        table = self.file.camera
        with _named("[camera]"):
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
        )

    def _basis(self) -> SpectralBasis:
        table = self.file.basis
        if table.train == "scene":
            return SpectralBasis.fit(
                [row.spectrum for row in self.lights],
                list(self.materials.values()),
                size=table.size,
                method=table.method,
            )
        return SpectralBasis.load(self._local(table.name or "general-7"))

    def _local(self, text: str) -> str:
        """A file name relative to the scene's folder where there is such a file, else as is."""
        local = self.folder / text.partition("?")[0]
        is_file = local.suffix and local.is_file()
        return os.fspath(self.folder / text) if is_file else text


class _named:
    """Put the table's name before the message of what goes wrong inside."""

    def __init__(self, table: str) -> None:
        self.table = table

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, VolspecError) and not isinstance(error, SceneError):
            raise SceneError(f"{self.table} {error}") from error
