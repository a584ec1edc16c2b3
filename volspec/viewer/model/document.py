"""An open scene with its volume, and the volume's histograms.

    Scene, Volume -> [document] -> state

References
----------
[1] Kindlmann & Durkin (1998), "Semi-automatic generation of transfer functions for direct
    volume rendering", IEEE Symposium on Volume Visualization, 79-86.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu.sources import asset
from volspec.errors import SceneError
from volspec.pipeline import Raycaster
from volspec.raycast import CoefficientImage, RaycastSpec
from volspec.raycast.camera import Orbit
from volspec.relight import RelightSpec
from volspec.scene import Scene
from volspec.scene.file import SceneFile
from volspec.scene.lights import rows_by_name
from volspec.scene.meshes import MeshCache
from volspec.scene.specs import EMPTY, MeshSpec
from volspec.spectra import SpectralGrid
from volspec.transfer import Transfer, Transfers, presets
from volspec.viewer.model.field_looks import FieldLook, field_looks
from volspec.viewer.model.light_rows import Rows, rows_from_scene
from volspec.viewer.model.view import View
from volspec.volume import Choice, Volume

if TYPE_CHECKING:
    from volspec.raycast.behind import Behind
    from volspec.scene.room import SceneRoom

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


def joint_histogram(volume: Volume) -> JointHistogram:
    """Return the histogram of every n-th voxel along each axis; gradients by central differences.

    >>> from volspec.volume import phantom
    >>> joint = joint_histogram(phantom.ball(16))
    >>> joint.counts.shape, joint.top > 0
    ((64, 128), True)
    """
    values = volume.values
    every = max(1, round((values.size / _SAMPLES) ** (1 / 3)))
    at = [np.arange(min(1, n - 2), max(n - 1, 1), every) for n in values.shape]
    square = np.zeros([len(indices) for indices in at])
    for axis, spacing in enumerate(volume.spacing_mm[::-1]):
        before, after = (_sample_shifted(values, at, axis, by) for by in (-1, 1))
        square += ((after - before) / (2 * spacing)) ** 2
    gradients = np.sqrt(square).ravel()
    # Without missing voxels and their neighbours.
    there = gradients <= _STEEPEST * (volume.range[1] - volume.range[0]) / min(volume.spacing_mm)
    here = _sample_shifted(values, at, 0, 0).ravel()
    there &= here >= volume.range[0]
    gradients, here = gradients[there], here[there]
    if not gradients.size:
        return JointHistogram(np.zeros(_JOINT_BINS[::-1]), 1.0)
    top = float(np.quantile(gradients, _SHOWN)) or 1.0
    low, high = volume.range
    fractions = (here - low) / max(high - low, 1e-30)
    columns, rows = _JOINT_BINS
    column = np.minimum((fractions * columns).astype(np.intp), columns - 1)
    row = np.minimum((gradients / top * rows).astype(np.intp), rows - 1)
    counts = np.bincount(row * columns + column, minlength=rows * columns)
    return JointHistogram(counts.reshape(rows, columns).astype(np.float64), top)


def _sample_shifted(
    values: NDArray[Any], at: list[NDArray[np.intp]], axis: int, by: int
) -> NDArray[np.float64]:
    """Return the voxels at indices shifted along one axis and clamped to its ends."""
    shifted = [*at]
    shifted[axis] = np.clip(at[axis] + by, 0, values.shape[axis] - 1)
    return values[np.ix_(*shifted)].astype(np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class FieldData:
    """Values of a field and their histograms."""

    volume: Volume
    histogram: NDArray[np.float64]  # (256,) voxels by value over the volume's range
    joint: JointHistogram

    @classmethod
    def of(cls, volume: Volume, histogram: NDArray[np.float64] | None = None) -> FieldData:
        """Return a field's data; the histogram if it is not known."""
        counts = presets.histogram(volume) if histogram is None else histogram
        return cls(volume, counts, joint_histogram(volume))


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
    histogram: NDArray[np.float64]  # (256,) voxels by value over the volume's range
    file: SceneFile | None = None  # opened, or made for a volume
    path: Path | None = None  # scene or volume; relative file names start from its folder
    fault: str = ""  # why nothing can be cast on this machine; empty if it can
    fields: tuple[FieldLook, ...] = ()  # of a volume of several; `transfer` is the first's
    choices: tuple[Choice, ...] = ()  # of the volume's address, such as its channels
    # Opened instead of a scene: one view of fixed materials. The volume then only takes the place
    # of the one that was cast.
    image: CoefficientImage | None = None
    room: SceneRoom | None = None  # the volume is in it; its lamps are the lights
    meshes: MeshCache = field(default_factory=lambda: MeshCache(Path()))
    # By the names of `fields`; "" is the volume's own.
    data: Mapping[str, FieldData] = field(init=False)

    def __post_init__(self) -> None:
        data = {"": FieldData.of(self.volume, self.histogram)}
        data |= {each.name: FieldData.of(each) for each in self.volume.fields}
        object.__setattr__(self, "data", data)

    def saved(self) -> tuple[SceneFile, Path]:
        """Return the scene's file and its path; raises SceneError if there is none."""
        if self.file is None or self.path is None:
            problem = "not read from a file; save the volume first"
            raise SceneError(f"{self.title}: {problem}", code="missing")
        return self.file, self.path

    def surfaces(self, rows: Sequence[MeshSpec], transfer: Transfers) -> tuple[Behind, ...]:
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
    def own_folder(self) -> Path | None:
        """Folder of the opened file; None for bundled scenes, next to which nothing is saved."""
        if (source := self.source) is None:
            return None
        folder = Path(source.partition("?")[0]).absolute().parent
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
    ) -> Document:
        """Make a document of a scene and its volume."""
        transfer, fields = field_looks(scene.transfer)
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
            histogram=presets.histogram(volume),
            file=_with_box(scene.file, volume),
            path=scene.path.absolute(),
            fault=fault,
            room=scene.room,
            meshes=MeshCache(scene.path.absolute().parent, scene.file.mesh, scene.meshes(volume)),
        )


def demo() -> Path:
    """Return the path of the bundled scene, which opens by default."""
    return Path(asset("data/scenes/engine.toml")).absolute()


def _file_view(scene: Scene, volume: Volume) -> View:
    table = scene.file.camera
    if table.position_mm is not None:
        return View.of(scene.camera(volume), volume)
    return View(**{each.name: getattr(table, each.name) for each in fields(Orbit)})


def _with_box(file: SceneFile, volume: Volume) -> SceneFile:
    """Return the file with the box of an empty volume, so that it stays if meshes are added."""
    if file.volume.file != EMPTY:
        return file
    corners = volume.corners_mm
    x, y, z = zip(corners.min(axis=0).tolist(), corners.max(axis=0).tolist(), strict=True)
    box_mm = x, y, z
    return replace(file, volume=replace(file.volume, box_mm=box_mm))
