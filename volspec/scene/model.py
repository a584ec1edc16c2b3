"""The scene file: TOML in, frozen specs out.

Tables: ``[volume]``, ``[[material]]``, ``[transfer]``, ``[basis]``, ``[camera]``, ``[raycast]``,
``[[group]]``, ``[[light]]``, ``[viewing]``, ``[output]``, ``[export]``, ``[[keyframe]]``
(`volspec.scene.file`; for users docs/scenes.md). Paths are relative to the file.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from copy import copy
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from volspec._parse import parse_json
from volspec._tables import explained
from volspec._tables.written import plain
from volspec.errors import ImageError, SceneError, visible
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.raycast.bands import Cancel, Progress
from volspec.scene.basis import ChosenBasis, choose_basis, retrained
from volspec.scene.export import Exported
from volspec.scene.file import SceneFile
from volspec.scene.reading import scene_data, scene_file
from volspec.scene.resolve import Resolver
from volspec.scene.tables import ViewingTable
from volspec.scene.writing import write_scene
from volspec.spectra import Spectrum
from volspec.volume import Volume


def viewing_of(image: CoefficientImage) -> ViewingTable:
    """The ``[viewing]`` of the scene an image was cast from; the defaults where it has none.

    Raises
    ------
    ImageError
        If the image's note cannot be read.
    """
    try:
        return ViewingTable.model_validate(parse_json(image.notes.get("viewing", "{}")))
    except ValueError as error:  # pydantic's and the parser's
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
        self.path = Path(path)
        self.folder = self.path.parent
        self._known = dict(known or {})
        names = Resolver(file, self.path, self._known)
        self._names = names
        shipped = names.shipped_basis()
        grid = names.grid(shipped)
        self.materials = names.reflectances("reflectance", grid)
        filters = names.reflectances("filter", grid)
        self.raycast = names.raycast()
        self.lights = names.lights(grid, self.raycast)
        with names.named("[basis]"):
            if shipped:
                chosen = ChosenBasis(shipped, "the scene names it")
            else:
                spectra = names.spectra(self.lights, self.materials, filters)
                # Files of bases hold names without control characters; a title may have them.
                name = visible(file.title or self.path.stem)
                chosen = choose_basis(file.basis, spectra, name, file.viewing.mode)
            self.basis, self.basis_reason = chosen.basis, chosen.reason
        with names.named("[transfer]"):
            self.transfer = file.transfer.function(self.materials, filters, self.basis)
        self.viewing = names.viewing()
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
        data = scene_data(path)
        if basis:
            data["basis"] = retrained(data.get("basis", {}), basis)
        return cls(scene_file(data, path), path)

    def save(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the scene's file, whole or not at all; `write_scene` says how.

        Parameters
        ----------
        path : path, optional
            Where to; by default where it was read.

        Returns
        -------
        path
        """
        return write_scene(self.file, self.path if path is None else path, self)

    @property
    def known(self) -> Mapping[str, Spectrum]:
        """What texts of the file stand for that are no files yet."""
        return MappingProxyType(self._known)

    def volume(self) -> Volume:
        """Read the volume; its spacing and size as the scene wants them."""
        return self._names.volume()

    def camera(self, volume: Volume) -> Camera:
        """The camera, placed for a volume."""
        table = self.file.camera
        with self._names.named("[camera]"):
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
        with self._names.named():
            return raycast(
                *(volume, self.transfer, camera, size or (output.width, output.height)),
                spec or self.raycast,
                device=device,
                progress=progress,
                cancel=cancel,
                caster=caster,
                notes={"scene": self.file.title, "viewing": self.viewing.model_dump_json()},
            )

    def exporting(self, **changes: Any) -> Scene:
        """The scene with other settings of ``[export]``; None takes one out.

        Raises
        ------
        SceneError
            If one is unknown or wrong; the message names it.
        """
        told = {key: value for key, value in changes.items() if value is not None}
        kept = {key: v for key, v in plain(self.file.export).items() if key not in changes}
        try:
            file = SceneFile.model_validate({**plain(self.file), "export": {**kept, **told}})
        except ValidationError as error:
            raise SceneError(f"{self.path}: {explained(error, SceneFile)}") from error
        scene = copy(self)
        scene.file = file
        return scene

    def export(
        self,
        output: str | os.PathLike[str],
        *,
        size: tuple[int, int] | None = None,
        overwrite: bool = False,
        device: str | None = None,
        tell: Callable[[str, float], object] | None = None,
        volume: Volume | None = None,
        caster: Raycaster | None = None,
        **changes: Any,
    ) -> Exported:
        """Export re-lit frames, or a film; see docs/export.md.

        Parameters
        ----------
        output : path
            A folder; or a film, ``.mp4``, ``.webm`` or ``.gif``.
        size, overwrite, device, tell, volume, caster
            As `volspec.export.exporter.export_scene`.
        **changes
            Keys of ``[export]`` in place of the file's, such as ``turntable={"frames": 36}``.

        Returns
        -------
        Exported

        Raises
        ------
        InputError
            If a setting is wrong, or the output cannot be written to or is of another scene.
        DeviceError
            If there is no device, or a film is asked for and there is no ffmpeg.
        """
        scene = self.exporting(**changes) if changes else self
        # The exporter knows scenes, so that it can only be asked for by name.
        run = import_module("volspec.export.exporter")
        made: Exported = run.export_scene(
            *(scene, output),
            size=size,
            overwrite=overwrite,
            device=device,
            tell=tell,
            volume=volume,
            caster=caster,
        )
        return made
