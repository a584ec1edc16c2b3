"""The scene file: TOML in, frozen specs out.

Tables: ``[volume]``, ``[[material]]``, ``[transfer]``, ``[basis]``, ``[camera]``, ``[raycast]``,
``[[group]]``, ``[[light]]``, ``[viewing]``, ``[output]``, ``[export]``, ``[[keyframe]]``
(`volspec.scene.file`; for users docs/scenes.md). Paths are relative to the file.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import asdict, fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from volspec._parse import parse_json
from volspec.basis import Basis, MaterialBasis, SpectralBasis, require_reflective
from volspec.camera import Camera, Orbit
from volspec.errors import ImageError, MeshError, SceneError, VolspecWarning, visible
from volspec.image import CoefficientImage, DepthEffects
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec, framing
from volspec.raycast.launch import Cancel, Progress
from volspec.relight import Look, RelightSpec
from volspec.scene.basis import ChosenBasis, choose_basis, grid_of, update_table, with_samples
from volspec.scene.fields import scene_transfer
from volspec.scene.file import SceneFile, scene_data, scene_file
from volspec.scene.from_volume import fit_frame, mesh_file, of_own_colours, volume_file, volume_path
from volspec.scene.resolve import Resolver
from volspec.scene.tables.lights import Lights
from volspec.scene.tables.specs import CameraSpec
from volspec.scene.writing import write_scene
from volspec.settings import plain, read_table
from volspec.spectra import Spectrum
from volspec.transfer import LABELS, presets, with_labels
from volspec.volume import KEPT_BYTES, Series, Volume, locate_volume, open_volume

if TYPE_CHECKING:
    from volspec.mesh import Mesh, MeshCaster
    from volspec.raycast import SurfaceCaster
    from volspec.scene.room import SceneRoom

Spec = TypeVar("Spec")


def stored_relight_spec(image: CoefficientImage) -> RelightSpec:
    """Return the ``[viewing]`` of the scene an image was cast from; the default if it has none.

    Raises
    ------
    ImageError
        If the image's note cannot be read.
    """
    return _read_note(image, "viewing", RelightSpec)


def stored_look(image: CoefficientImage) -> Look:
    """Return the look of the scene an image was cast from: its ``[viewing]``, and ``[depth]``.

    An image without layers has no depth to change. Raises ImageError if a note cannot be read.
    """
    depth = DepthEffects()
    if image.opacity_layers is not None:
        depth = _read_note(image, "depth", DepthEffects)
    return Look(stored_relight_spec(image), depth=depth)


def cast_notes(file: SceneFile, relight: RelightSpec) -> dict[str, str]:
    """Return a scene's title, viewing conditions and ``[depth]`` as notes of its images.

    They need no other file.
    """
    viewing = {
        field.name: getattr(relight.viewing, field.name) for field in fields(relight.viewing)
    }
    settings = {name: getattr(relight, name) for name in ("backdrop", "mode", "level", "filter")}
    notes = {"scene": file.title, "viewing": _note(viewing | settings)}
    return notes | ({"depth": _note(asdict(file.depth))} if file.depth.changes else {})


def _note(values: Mapping[str, Any]) -> str:
    return json.dumps({key: plain(value) for key, value in values.items()})


def _read_note(image: CoefficientImage, name: str, kind: type[Spec]) -> Spec:
    try:
        note = _without_nulls(parse_json(image.notes.get(name, "{}")))
        return read_table(kind, note, ImageError)
    except ValueError as error:  # ours and the parser's
        raise ImageError(
            f"the image's {name} note cannot be read",
            "render again, or install a later version if one made it",
            code="damaged",
        ) from error


def _without_nulls(value: Any) -> Any:
    """Return JSON without the nulls in notes of earlier versions."""
    if isinstance(value, dict):
        return {key: _without_nulls(child) for key, child in value.items() if child is not None}
    return value


class Scene:
    """A scene file, checked; everything a picture needs but the volume's voxels.

    Parameters
    ----------
    file : SceneFile
    path : path
        Path of the file, for messages; paths in the file are relative to its folder.
    known : {address: Spectrum}, optional
        Newly designed spectra that the file names but that are not on disk yet.
    basis : SpectralBasis or MaterialBasis, optional
        Basis instead of the file's.
    room : SceneRoom, optional
        The file's room, if already solved.

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
        basis: Basis | None = None,
        room: SceneRoom | None = None,
    ) -> None:
        self.file = file
        self.path = Path(path)
        self.folder = self.path.parent
        self._known = dict(known or {})
        self._series: Series | None = None  # if it was open before the scene was made
        names = Resolver(file, self.path, self._known)
        self._resolver = names
        shipped = basis or names.shipped_basis()
        grid = names.grid(shipped)
        self.materials = names.reflectances("reflectance", grid)
        filters = names.reflectances("filter", grid)
        self.room = names.room(grid) if room is None else room
        self.raycast = file.cast if self.room is None else self.room.cast(file.cast)
        self.lights = Lights(names.lights(grid, self.raycast, self.room))
        with names.in_field("basis"):
            spectra = names.spectra(self.lights, self.materials, filters, self.room)
            if shipped:
                if isinstance(shipped, SpectralBasis):
                    shipped = with_samples(shipped, spectra)
                choice = ChosenBasis(shipped, "the scene names it")
            else:
                # A title may have control characters; the name of a basis must not.
                name = visible(file.title or self.path.stem)
                bands = grid.start_nm, grid.stop_nm, grid.step_nm
                same = grid == grid_of(file.basis)
                table = file.basis if same else replace(file.basis, grid_nm=bands)
                choice = choose_basis(table, spectra, name, file.viewing.mode)
                if not same:
                    reason = f"{choice.reason}, on its palettes' {grid.size} bands"
                    choice = replace(choice, reason=reason)
            self.basis, self.basis_reason = choice.basis, choice.reason
        names.warn_of_palette_grids(grid, self.materials)
        names.warn_of_gratings(self.basis, spectra)
        if not isinstance(self.basis, MaterialBasis):
            with names.in_field("basis"):
                require_reflective(self.materials, self.basis.name)
        self.transfer = scene_transfer(
            file.transfer, file.field, self.materials, filters, self.basis, names.in_field
        )
        with names.in_field("viewing.filter"):
            self.filter = names.eye_filter(grid)
        self.relight = self._seen_in_room()

    @classmethod
    def load(cls, path: str | os.PathLike[str], basis: Mapping[str, object] | None = None) -> Scene:
        """Read and check a scene file.

        Parameters
        ----------
        path : path
        basis : {key: value}, optional
            Keys of ``[basis]`` to try instead of the file's, such as ``{"size": 9}``; a basis is
            then trained for the scene, or made of its materials if ``method`` says so.

        Raises
        ------
        SceneError
            If the file is missing or not TOML, or a field is unknown or wrong; the message names
            file, field and value.
        """
        data = scene_data(path)
        if basis:
            data["basis"] = update_table(data.get("basis", {}), basis)
        return cls(scene_file(data, path), path)

    @classmethod
    def from_volume(
        cls,
        path: str | os.PathLike[str] | Volume | Series | ArrayLike,
        *,
        preset: str | None = None,
        lights: Sequence[str] = (),
        camera: Orbit | None = None,
        volume: Volume | None = None,
        series: Series | None = None,
    ) -> Scene:
        """Make a scene for a volume alone, as the viewer opens it.

        Parameters
        ----------
        path : path
            A volume or a series, as for `volspec.load_volume` and `volspec.load_series`; the
            scene's paths are relative to its folder. Or a Volume, an array (Z, Y, X), a pyvista
            ``ImageData`` or a Series, of which a saved scene has no more than the name.
        preset : str, optional
            Name of a transfer function in ``data/presets.toml``, or labels; default: labels if
            the volume has some, a colour per field if it has several, else soft-hard.
        lights : sequence of str, optional
            In `volspec.light`'s notation; default: D65, A, FL2, HP1 and two whites of LEDs under
            which most materials look very different.
        camera : Orbit, optional
            Its zoom and target are replaced: it frames what the transfer function shows.
        volume : Volume, optional
            The voxels, if already loaded.
        series : Series, optional
            All time steps, if already open.

        Raises
        ------
        VolumeError
            If the volume cannot be read, or labels are asked for and its values are not whole.
        InputError
            If there is no such preset.
        SceneError
            If a light is unknown.

        Examples
        --------
        >>> import volspec as vs
        >>> scene = vs.Scene.from_volume("data/engine.nrrd", preset="surface", lights=["A"])
        >>> [light.name for light in scene.lights], scene.file.transfer.kind
        (['A'], 'surfaces')
        """
        source: Volume | Series | None = None
        if isinstance(path, Series):
            source = series = path
        elif not isinstance(path, str | os.PathLike):
            source = volume = Volume.of(path)
        name = source.name or "volume" if source is not None else os.fspath(path)  # type: ignore[arg-type]
        address = locate_volume(name)
        if volume is None and series is None:
            volume, series = open_volume(address)
        steps: Sequence[Volume] = series or ()
        if volume is not None:
            steps = steps or (volume,)
        volume = steps[0]
        if preset == LABELS and not volume.labels:
            volume = with_labels(volume)
            steps = (volume,)
        # A look of its own: of labels, or of several fields.
        custom = preset == LABELS or (preset is None and (volume.labels or volume.fields))
        look = None if custom else presets.preset_named(preset or presets.DEFAULT)
        file = volume_file(address, steps, look, lights, camera)
        scene = cls(file, volume_path(address))
        scene._series = series
        if source is not None:
            scene._resolver = replace(scene._resolver, source=source)
        scene.file = fit_frame(file, volume, framing.shown_mm(steps, scene.transfer, scene.raycast))
        return scene

    @classmethod
    def from_mesh(
        cls,
        path: str | os.PathLike[str],
        *,
        lights: Sequence[str] = (),
        camera: Orbit | None = None,
    ) -> Scene:
        """Make a scene for a mesh alone, in its own colours or copper, as the viewer opens it.

        Parameters
        ----------
        path : path
            PLY, OBJ, STL, VTP, VTK or glTF.
        lights, camera
            As for `from_volume`.

        Raises
        ------
        SceneError
            If the mesh cannot be read, or a light is unknown.

        Warns
        -----
        VolspecWarning
            If the mesh has no colours, and is shown as copper.

        Examples
        --------
        >>> from tempfile import TemporaryDirectory
        >>> from warnings import catch_warnings, simplefilter
        >>> import pyvista
        >>> import volspec as vs
        >>> with TemporaryDirectory() as folder, catch_warnings():
        ...     simplefilter("ignore", vs.VolspecWarning)  # a cone has no colours
        ...     pyvista.Cone().save(f"{folder}/cone.ply")
        ...     vs.Scene.from_mesh(f"{folder}/cone.ply", lights=["D65"]).render(size=(64, 64))
        CoefficientImage(64x64, 2 channels)
        """
        path = Path(os.path.abspath(path))
        # Read before the scene is made, as its basis depends on the colours.
        names = Resolver(mesh_file(path, lights, camera), path, {})
        try:
            surfaces = names.surfaces()
        except SceneError as error:
            cause = error.__cause__
            if not isinstance(cause, MeshError):
                raise
            # The scene is the mesh's file, which the message names.
            raise SceneError(cause.problem, cause.remedy, code=cause.code) from cause
        points_mm = np.concatenate([mesh.points_mm for mesh in surfaces])
        scene = cls(of_own_colours(names.file, surfaces), path)
        scene._resolver.read.update(names.read)
        scene.file = fit_frame(scene.file, scene.volume(), points_mm)
        return scene

    def save(self, path: str | os.PathLike[str] | None = None) -> Path:
        """Write the scene's file atomically; see `write_scene`.

        Parameters
        ----------
        path : path, optional
            Output path; default: the file that was read.

        Returns
        -------
        path

        Warns
        -----
        VolspecWarning
            If the volume was given as an array, which no file has.
        """
        target = write_scene(self.file, self.path if path is None else path, self)
        file = self.file.volume.file
        if self._resolver.source is not None and not volume_path(f"{self.folder / file}").exists():
            remedy = "save the array, such as with numpy.save, and name that file in [volume]"
            text = f"{target}: its volume {file!r} is no file, and the scene cannot be loaded"
            warnings.warn(f"{text}; {remedy}", VolspecWarning, stacklevel=2)
        return target

    @property
    def known(self) -> Mapping[str, Spectrum]:
        """Spectra that the file names and that are not on disk yet."""
        return MappingProxyType(self._known)

    def volume(self) -> Volume:
        """Read the volume, or the step of a series, with the scene's spacing and downsampling."""
        return self._resolver.opened()[0]

    def opened(self) -> tuple[Volume, Series | None]:
        """Read the volume; of a series open all steps, and return the one that is shown."""
        return self._resolver.opened()

    def step_count(self) -> int:
        """Return the number of the volume's time steps, which are not read; 1 without a series."""
        return len(self._resolver.steps())

    def series(self, kept_bytes: int = KEPT_BYTES) -> Series | None:
        """Open the volume's time steps; None if it has one.

        Parameters
        ----------
        kept_bytes : int
            Bytes of voxels that stay in memory; other steps are read again when they are needed.

        Raises
        ------
        SceneError
            If no step can be read, or steps have different lattices.
        """
        return self._series or self._resolver.series(kept_bytes)

    def camera(self, volume: Volume) -> Camera:
        """The camera, placed for a volume."""
        table = self.file.camera
        with self._resolver.in_field("camera"):
            if table.position_mm is None:
                return table.camera(volume)
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
            The scene's volume, if already loaded.
        size, spec : optional
            Replace the scene's (width, height) and ``[raycast]``.
        device, progress, cancel, caster
            See `volspec.raycast`.

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
        camera, behind = self.camera(volume), self.behind(volume)
        with self._resolver.in_field("raycast"):
            return raycast(
                *(volume, self.transfer, camera, size or (output.width, output.height)),
                self.raycast if spec is None else self.room.cast(spec) if self.room else spec,
                device=device,
                progress=progress,
                cancel=cancel,
                caster=caster,
                behind=behind,
                notes=cast_notes(self.file, self.relight),
            )

    def behind(self, volume: Volume) -> tuple[SurfaceCaster, ...]:
        """Return the meshes, and the room as it is seen behind a volume.

        Raises SceneError if a mesh cannot be read, the volume is not within the room, or the basis
        has no channels for it.
        """
        meshes = self.meshes(volume)
        casters: tuple[SurfaceCaster, ...] = () if meshes is None else (meshes,)
        with self._resolver.in_field("room"):
            room = None if self.room is None else self.room.behind(volume, self.basis)
        return casters if room is None else (*casters, room)

    def surfaces(self) -> list[Mesh]:
        """Return the shown meshes. Raises SceneError if one cannot be read."""
        return self._resolver.surfaces()

    def meshes(self, volume: Volume) -> MeshCaster | None:
        """Return the shown meshes; None without any. Raises SceneError if one cannot be read."""
        return self._resolver.meshes(volume, self.materials, self.basis)

    def with_camera(self, camera: CameraSpec) -> Scene:
        """Return the scene with another ``[camera]``."""
        scene = copy(self)
        scene.file = replace(self.file, camera=camera)
        scene.relight = scene._seen_in_room()
        return scene

    def _seen_in_room(self) -> RelightSpec:
        """Return the file's viewing, or that of an eye in its room."""
        spec, camera = replace(self.file.viewing, filter=self.filter), self.file.camera
        if self.room is None:
            return spec
        middle = (0.0, 0.0, 0.0)
        if camera.position_mm is not None and camera.target_mm is None:
            middle = tuple(self.volume().corners_mm.mean(axis=0).tolist())
        return replace(spec, viewing=self.room.viewing(spec.viewing, camera, middle))

    def exporting(self, **changes: Any) -> Scene:
        """Return the scene with other settings of ``[export]``; None removes one.

        Raises
        ------
        SceneError
            If a setting is unknown or wrong; the message names it.
        """
        settings = {key: value for key, value in changes.items() if value is not None}
        unchanged = {key: v for key, v in plain(self.file.export).items() if key not in changes}
        file = scene_file({**plain(self.file), "export": {**unchanged, **settings}}, self.path)
        scene = copy(self)
        scene.file = file
        return scene

    def casting(self, **changes: Any) -> Scene:
        """Return the scene with other settings of its cast, fields of `RaycastSpec`.

        Raises RaycastError if a setting is wrong.
        """
        scene = copy(self)
        scene.raycast = replace(self.raycast, **changes)
        scene.file = replace(self.file, raycast=replace(self.file.raycast, **changes))
        return scene
