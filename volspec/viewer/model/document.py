"""An open scene with its volume, and the volume's histograms.

    Scene, Volume -> [document] -> state

References
----------
[1] Kindlmann & Durkin (1998), "Semi-automatic generation of transfer functions for direct
    volume rendering", IEEE Symposium on Volume Visualization, 79-86.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import asset
from volspec.camera import Orbit
from volspec.errors import SceneError
from volspec.image import CoefficientImage, DepthEffects
from volspec.pipeline import Raycaster
from volspec.raycast import RaycastSpec
from volspec.relight import RelightSpec
from volspec.scene import MeshCache, Scene, SceneFile
from volspec.scene.tables import EMPTY, MeshSpec, rows_by_name
from volspec.spectra import SpectralGrid
from volspec.transfer import FieldFunctions, Mask, Transfer, Transfers, presets
from volspec.viewer.model.light_rows import Rows, rows_from_scene
from volspec.viewer.model.view import View
from volspec.volume import PATTERN, Choice, Series, Volume

if TYPE_CHECKING:
    from volspec.raycast import SurfaceCaster
    from volspec.scene import SceneRoom

Samples = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Values, and their gradients."""
_JOINT_BINS = 128, 64
# Number of voxels sampled, which takes two milliseconds.
_SAMPLES = 60_000
# Greater than a gradient of any two values, and less than any to the missing value.
_STEEPEST = 2.0
# The fraction of gradients below the axis' end.
_SHOWN = 0.9995


@dataclass(frozen=True, slots=True, eq=False)
class JointHistogram:
    """Number of voxels by value and gradient magnitude."""

    # (64, 128): rows are gradients from 0, columns values over the volume's range.
    counts: NDArray[np.float64]
    top: float  # gradient at the end of the last row, value per millimetre; above 0

    @classmethod
    def of(cls, samples: Sequence[Samples], span: tuple[float, float]) -> JointHistogram:
        """Count samples of values, over a range, and of gradients."""
        here, gradients = (np.concatenate(parts) for parts in zip(*samples, strict=True))
        if not gradients.size:
            return cls(np.zeros(_JOINT_BINS[::-1]), 1.0)
        top = float(np.quantile(gradients, _SHOWN)) or 1.0
        low, high = span
        fractions = (here - low) / ((high - low) or 1.0)
        columns, rows = _JOINT_BINS
        column = np.minimum((fractions * columns).astype(np.intp), columns - 1)
        row = np.minimum((gradients / top * rows).astype(np.intp), rows - 1)
        counts = np.bincount(row * columns + column, minlength=rows * columns)
        return cls(counts.reshape(rows, columns).astype(np.float64), top)


def _samples(volume: Volume, count: int) -> Samples:
    """Return values and gradients of every n-th voxel, without missing ones and neighbours.

    About ``count`` of them; gradients by central differences.
    """
    values = volume.values
    stride = max(1, round((values.size / count) ** (1 / 3)))
    lattice = [np.arange(min(1, n - 2), max(n - 1, 1), stride) for n in values.shape]
    square = np.zeros([len(indices) for indices in lattice])
    for axis, spacing in enumerate(volume.spacing_mm[::-1]):
        before, after = (_sample_shifted(values, lattice, axis, by) for by in (-1, 1))
        square += ((after - before) / (2 * spacing)) ** 2
    gradients = np.sqrt(square).ravel()
    low, high = volume.typical_range
    valid = gradients <= _STEEPEST * (high - low) / min(volume.spacing_mm)
    here = _sample_shifted(values, lattice, 0, 0).ravel()
    valid &= (here >= low) & (here <= high)
    return here[valid], gradients[valid]


def _sample_shifted(
    values: NDArray[Any], indices: list[NDArray[np.intp]], axis: int, by: int
) -> NDArray[np.float64]:
    """Return the voxels at indices shifted along one axis and clamped to its ends."""
    shifted = [*indices]
    shifted[axis] = np.clip(indices[axis] + by, 0, values.shape[axis] - 1)
    return values[np.ix_(*shifted)].astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FieldData:
    """Values of a field and their histograms."""

    volume: Volume
    histogram: NDArray[np.float64]  # (256,) voxels by value over the volume's range
    joint: JointHistogram

    def at_step(self, volume: Volume) -> FieldData:
        """Return the data with the volume of another time step."""
        return replace(self, volume=volume)


def field_data(steps: Series | tuple[Volume, ...]) -> dict[str, FieldData]:
    """Return the data of all fields by name, over all time steps; "" is the volume's own.

    >>> from volspec.volume import phantom
    >>> data = field_data((phantom.ball(16),))[""]
    >>> data.joint.counts.shape, data.joint.top > 0, int(data.histogram.sum())
    ((64, 128), True, 4096)
    """
    first = steps[0].by_role
    counts = {name: np.zeros(0) for name in first}
    samples: dict[str, list[Samples]] = {name: [] for name in first}
    for step in steps:
        for name, vol in step.by_role.items():
            histogram = presets.histogram(vol)
            counts[name] = counts[name] + histogram if counts[name].size else histogram
            samples[name].append(_samples(vol, max(_SAMPLES // len(steps), 1)))
    return {
        name: FieldData(vol, counts[name], JointHistogram.of(samples[name], vol.typical_range))
        for name, vol in first.items()
    }


@dataclass(frozen=True, slots=True)
class FieldLook:
    """A field's transfer function, factor of its extinction, and whether it is shown.

    The name is ``""`` for the volume's own field. Materials and basis are those of the state, also
    for the functions of the mask, if the field has one; there is no editor of masks.
    """

    name: str
    transfer: Transfer
    weight: float = 1.0
    """Factor of this field's density."""
    shown: bool = True
    """Show this field."""
    mask: Mask | None = None


def _field_looks(transfer: Transfers) -> tuple[Transfer, tuple[FieldLook, ...]]:
    """Return the first field's transfer function, and all fields; none if there is only one."""
    if not isinstance(transfer, FieldFunctions):
        return transfer, ()
    looks = []
    for name, function in transfer.functions.items():
        weight = transfer.weights.get(name, 1.0)
        mask = transfer.masks.get(name)
        looks.append(FieldLook(name, function, weight or 1.0, weight > 0, mask))
    return looks[0].transfer, tuple(looks)


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """Open scene with its volume; its settings are as in the file."""

    title: str
    volume: Volume
    caster: Raycaster | None  # None if nothing will or can be cast
    view: View
    transfer: Transfer
    shading: RaycastSpec
    lights: Rows
    relight: RelightSpec
    file: SceneFile | None = None  # opened, or made for a volume
    path: Path | None = None  # scene or volume; relative file names start from its folder
    fault: str = ""  # why nothing can be cast on this machine; empty if it can
    fields: tuple[FieldLook, ...] = ()  # of a volume of several; `transfer` is the first's
    choices: tuple[Choice, ...] = ()  # of the volume's address, such as its channels
    # Opened instead of a scene: one view of fixed materials. The volume then only takes the place
    # of the one that was cast.
    image: CoefficientImage | None = None
    depth: DepthEffects = field(default_factory=DepthEffects)  # of its scene
    room: SceneRoom | None = None  # the volume is in it; its lamps are the lights
    meshes: MeshCache = field(default_factory=lambda: MeshCache(Path()))
    series: Series | None = None  # the volume's time steps
    step: int = 0  # the one that `volume` is
    opening: object = field(default_factory=object)  # the same at all time steps
    # By the names of `fields`; "" is the volume's own.
    data: Mapping[str, FieldData] = field(init=False)

    def __post_init__(self) -> None:
        data = field_data((self.volume,) if self.series is None else self.series)
        for name, volume in self.volume.by_role.items():
            data[name] = data[name].at_step(volume)
        object.__setattr__(self, "data", data)

    def at_step(self, step: int, volume: Volume, caster: Raycaster | None) -> Document:
        """Return the document at another time step; histograms are of all steps."""
        data = {name: self.data[name].at_step(scalars) for name, scalars in volume.by_role.items()}
        return self._with(step=step, volume=volume, caster=caster, data=data)

    def with_choices(self, choices: tuple[Choice, ...]) -> Document:
        """Return the document with what its address leaves open."""
        return self._with(choices=choices)

    def _with(self, **changes: Any) -> Document:
        """Return a copy with other fields, for which no histogram is made again."""
        document = copy(self)
        for name, value in changes.items():
            object.__setattr__(document, name, value)
        return document

    def is_of(self, other: Document) -> bool:
        """Return True if the other is the same document, at this or another time step."""
        return self.opening is other.opening

    @property
    def step_rate(self) -> float:
        """Time steps per second at which the series plays."""
        return 10.0 if self.file is None else self.file.volume.fps

    def saved(self) -> tuple[SceneFile, Path]:
        """Return the scene's file and its path; raises SceneError if there is none."""
        if self.file is None or self.path is None:
            problem = "not read from a file; save the volume first"
            raise SceneError(f"{self.title}: {problem}", code="missing")
        file = self.file
        if file.volume.step != self.step:
            file = replace(file, volume=replace(file.volume, step=self.step))
        return file, self.path

    def surfaces(self, rows: Sequence[MeshSpec], transfer: Transfers) -> tuple[SurfaceCaster, ...]:
        """Return the meshes shown, if any, in the transfer function's materials.

        Raises MeshError if a file or a material cannot be used.
        """
        caster = self.meshes.caster(rows, transfer.materials, transfer.basis)
        return () if caster is None else (caster,)

    @property
    def folder(self) -> str:
        """Folder that relative file names start from."""
        return "." if self.path is None else str(self.path.parent)

    @property
    def source(self) -> str | None:
        """Path that opens the document again; None for the bundled demo or without a file."""
        if self.file is None or self.path is None or self.path == demo():
            return None
        if self.path.suffix.lower() == ".toml" or self.file.volume.file == EMPTY:
            return str(self.path)
        return f"{self.path.parent / self.file.volume.file}"

    @property
    def field_files(self) -> tuple[str, ...]:
        """Paths of the further fields' files."""
        rows = () if self.file is None else self.file.field
        return tuple(os.path.join(self.folder, row.file) for row in rows if row.file)

    @property
    def own_folder(self) -> Path | None:
        """Folder of the opened file; None for bundled scenes, next to which nothing is saved."""
        if (source := self.source) is None:
            return None
        folders = Path(source.partition("?")[0]).absolute().parents
        folder = next(parent for parent in folders if PATTERN not in parent.name)
        return None if folder.is_relative_to(demo().parents[1]) else folder

    @property
    def grid(self) -> SpectralGrid:
        """Grid of all spectra."""
        return self.transfer.basis.grid

    @classmethod
    def of(
        cls,
        scene: Scene,
        volume: Volume,
        caster: Raycaster | None,
        fault: str = "",
        series: Series | None = None,
    ) -> Document:
        """Make a document of a scene and its volume, or the step of a series that it shows."""
        transfer, fields = _field_looks(scene.transfer)
        return cls(
            title=scene.file.title or scene.path.stem,
            volume=volume,
            caster=caster,
            view=_file_view(scene, volume),
            transfer=transfer,
            fields=fields,
            shading=scene.raycast,
            lights=rows_from_scene(
                scene.lights, rows_by_name(scene.file.light), scene.room, scene.known
            ),
            # Conditions in the room follow from the view.
            relight=scene.file.viewing,
            series=series,
            step=shown_step(scene.file, series),
            file=_with_box(scene.file, volume),
            path=scene.path.absolute(),
            fault=fault,
            room=scene.room,
            meshes=MeshCache(scene.path.absolute().parent, scene.file.mesh, scene.meshes(volume)),
        )


def shown_step(file: SceneFile, series: Series | None) -> int:
    """Return the time step that a file shows; the last one if some that follow were left out."""
    return 0 if series is None else min(file.volume.step, len(series) - 1)


def demo() -> Path:
    """Return the path of the bundled scene, which opens by default."""
    return Path(asset("data/scenes/engine.toml")).absolute()


def _file_view(scene: Scene, volume: Volume) -> View:
    table = scene.file.camera
    if table.position_mm is not None:
        return View.of(scene.camera(volume), volume)
    return View(**{setting.name: getattr(table, setting.name) for setting in fields(Orbit)})


def _with_box(file: SceneFile, volume: Volume) -> SceneFile:
    """Return the file with the box of an empty volume, so that it stays if meshes are added."""
    if file.volume.file != EMPTY:
        return file
    corners = volume.corners_mm
    x, y, z = zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True)
    box_mm = x, y, z
    return replace(file, volume=replace(file.volume, box_mm=box_mm))
