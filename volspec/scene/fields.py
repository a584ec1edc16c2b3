"""``[[field]]``: further fields in the volume's space, such as a PET in a CT.

[[field]] -> [fields] -> Volume with fields, FieldFunctions -> raycast
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from volspec.basis import Basis
from volspec.errors import SceneError, VolspecWarning, VolumeError, nearest
from volspec.raycast.launch import frame_around
from volspec.scene.tables.specs import fault
from volspec.scene.tables.transfer import TransferSpec
from volspec.settings import Hint, Name, Unit, Vector, settings
from volspec.spectra import Spectrum
from volspec.transfer import (
    OWN,
    FieldFunctions,
    Label,
    Mask,
    MaskLabels,
    TransferFunction,
    Transfers,
)
from volspec.volume import Known, Volume, load_at, load_volume, locate_volume, unique_titles

At = Callable[[str], AbstractContextManager[None]]
"""Adds a place in the scene's file to an error that is raised within."""
Number = Annotated[float, Field(allow_inf_nan=False)]
Row = Annotated[tuple[Number, Number, Number, Number], Field(strict=False)]
Matrix = Annotated[
    tuple[Row, Row, Row, Row],
    Field(strict=False),
    Hint("four rows of four numbers", whole=True),
]


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True)
class FieldSpec:
    """``[[field]]``: a further field in the volume's space, with a transfer function of its own.

    Without one it is not shown itself: a mask, say.
    """

    row_keys: ClassVar = ("name",)
    name: Annotated[Name, Field(examples=["PET"])]
    """Name in lists; without ``file``, of a channel in the volume's file."""
    file: Annotated[str, Field(examples=["pet.nii.gz"])] | None = None
    """File, in the notation of [volume] file, on any lattice."""
    spacing_mm: Annotated[Vector, Unit("mm")] | None = None
    """x, y, z instead of the file's spacing."""
    downsample: int = 1
    """Voxels along a block's edge that become one, in the notation of [volume] downsample."""
    matrix: Matrix | None = None
    """From the file's world to the volume's, in mm, such as a registration found it."""
    transfer: TransferSpec | None = None
    """Opacity and material by value: points. Left out for a field that is not shown itself."""

    def __post_init__(self) -> None:
        if self.file is None:
            for key, setting in (("spacing_mm", self.spacing_mm), ("matrix", self.matrix)):
                if setting is not None:
                    raise fault(key, "is for a field with a file of its own", "add file")
        if self.matrix is not None and self.matrix[3] != (0.0, 0.0, 0.0, 1.0):
            problem = f"has the last row {list(self.matrix[3])}"
            raise fault("matrix", problem, "give [0, 0, 0, 1] there", "range")
        if self.transfer is not None and self.transfer.points is None:
            raise fault("transfer", f"has {self.transfer.kind}", "give points")

    def rebased(self, change: Callable[[str], str]) -> FieldSpec:
        """Return the field with another name of its file."""
        return replace(self, file=self.file and change(self.file))

    def load(self, folder: Path, step: tuple[int, int], cache: Known) -> Volume:
        """Read the field's file, or if it is a series a step of so many; see `load_at`.

        Raises VolumeError if it cannot be read or placed.
        """
        assert self.file is not None
        field = load_at(locate_volume(self.file, folder), *step, cache)
        if self.spacing_mm is not None:
            field = field.with_spacing(self.spacing_mm)
        if self.matrix is not None:
            world = np.array(self.matrix) @ field.world_from_index
            try:
                field = replace(
                    field,
                    spacing_mm=None,  # type: ignore[arg-type]
                    world_from_index=world,
                )
            except VolumeError as error:
                problem = f"matrix: {error.problem}"
                raise VolumeError(problem, "give one that can be inverted", code="range") from error
        if self.downsample != 1:
            labels = bool(field.labels) or self.transfer is None
            field = field.downsampled(self.downsample, labels=labels)
        return replace(field, name=self.name)


def open_fields(paths: Sequence[str]) -> tuple[Volume, dict[str, str]]:
    """Read volumes as the fields of the first without labels; return it, and files by field name.

    The volume's own name is ``""``.

    Raises VolumeError if one cannot be read, or all are labels; RaycastError if one is too far away
    to be cast with the others.

    Warns
    -----
    VolspecWarning
        If one lies outside of the first.
    """
    volumes = [load_volume(path) for path in paths]
    first = next((number for number, v in enumerate(volumes) if not v.labels), None)
    if first is None:
        raise VolumeError(
            f"{paths[0]}: has labels, as all others",
            "add a volume of values, or open them one after the other",
            code="conflict",
        )
    volume = volumes[first]
    names = unique_titles([Path(path).name for path in paths])
    files = {"": paths[first]}
    for number, (name, path, field) in enumerate(zip(names, paths, volumes, strict=True)):
        if number == first:
            continue
        files[name] = path
        volume = volume.with_fields((*volume.fields, replace(field, name=name)))
        if not _overlap(volume, field):
            warnings.warn(
                f"{path}: lies outside of {paths[first]}; if they are to overlap, save the scene "
                "and give `matrix` in [[field]]",
                VolspecWarning,
                stacklevel=2,
            )
    frame_around(volume, volume.by_name)
    return volume, files


def _overlap(one: Volume, two: Volume) -> bool:
    """Return True if the boxes around two volumes overlap."""
    corners = one.corners_mm, two.corners_mm
    low = np.max([corner.min(axis=0) for corner in corners], axis=0)
    return bool((low <= np.min([box.max(axis=0) for box in corners], axis=0)).all())


def with_fields(
    volume: Volume,
    main: TransferSpec,
    rows: tuple[FieldSpec, ...],
    folder: Path,
    in_field: At,
    step: tuple[int, int],
    cache: Known,
) -> Volume:
    """Return a volume with the fields of ``[[field]]``, at a time step, of so many, of series.

    ``in_field`` adds the row to the VolumeError that is raised if a field cannot be read, or the
    volume's file has none of its name; and to the TransferError if ``[transfer]``, ``main``, or
    that of a row has a mask that is not there, or labels that it lacks.
    """
    more = {field.name: field for field in volume.fields}
    for number, row in enumerate(rows):
        with in_field(f"field[{number}]"):
            if row.file is not None:
                more[row.name] = row.load(folder, step, cache)
            elif row.name not in more:
                remedy = f"or one of {', '.join(more)}" if more else "as the volume's file has none"
                raise VolumeError(
                    f"{volume.name} has no field {row.name!r}",
                    f"{nearest(row.name, more)}give its file, {remedy}",
                    code="unknown",
                )
    with in_field("field"):
        volume = volume.with_fields(tuple(more.values())) if rows else volume
    for table, transfer in _tables(main, rows):
        if transfer.mask is None:
            continue
        with in_field(f"{table}.mask"):
            labels = MaskLabels.of(transfer.mask, volume)
        for number, by_label in enumerate(transfer.label or ()):
            with in_field(f"{table}.label[{number}].label"):
                bands = [labels.add(label) for label in by_label.labels]
            if step[0] == 0 and not any(labels.reaches(*band) for band in bands):
                low, high = labels.field.stated(labels.field.range)
                warnings.warn(
                    f"{table}.label[{number}]: no voxel of {labels.field.name!r} "
                    f"({low:g} … {high:g}) has {', '.join(map(repr, by_label.labels))}",
                    VolspecWarning,
                    stacklevel=2,
                )
    return volume


def _tables(main: TransferSpec, rows: tuple[FieldSpec, ...]) -> Iterator[tuple[str, TransferSpec]]:
    """Yield the places and transfer tables of the fields that have one."""
    yield "transfer", main
    for number, row in enumerate(rows):
        if row.transfer is not None:
            yield f"field[{number}].transfer", row.transfer


def scene_transfer(
    main: TransferSpec,
    rows: tuple[FieldSpec, ...],
    materials: Mapping[str, Spectrum],
    filters: Mapping[str, Spectrum],
    basis: Basis,
    in_field: At,
) -> Transfers:
    """Return the transfer function of ``[transfer]``, or of all fields.

    ``in_field`` adds the table to the error that is raised if one cannot be made.
    """
    with in_field("transfer"):
        function = main.function(materials, filters, basis)
        visible_rows = [row for row in rows if row.transfer is not None]
        if not visible_rows and main.mask is None and main.weight == 1.0 and main.shown:
            return function
        if not isinstance(function, TransferFunction):
            problem = f"{main.kind} cannot be cast with other fields or a weight"
            raise fault("", problem, "give points")
    functions: dict[str, TransferFunction] = {}
    weights: dict[str, float] = {}
    masks: dict[str, Mask] = {}
    names = [OWN, *(row.name for row in visible_rows)]
    for name, (table, transfer) in zip(names, _tables(main, rows), strict=True):
        with in_field(table):
            field_function = transfer.function(materials, filters, basis)
            assert isinstance(field_function, TransferFunction)
            FieldFunctions({name: field_function})  # refuses what several fields cannot have
        functions[name] = field_function
        weights[name] = transfer.weight if transfer.shown else 0.0
        if transfer.mask is not None:
            masks[name] = _mask(transfer, transfer.mask, table, materials, basis, in_field)
    with in_field("field"):
        return FieldFunctions(functions, weights, masks)


def _mask(
    transfer: TransferSpec,
    field: str,
    table: str,
    materials: Mapping[str, Spectrum],
    basis: Basis,
    in_field: At,
) -> Mask:
    """Return the functions by label; ``in_field`` adds the row to an error."""
    functions: dict[Label, TransferFunction | None] = {}
    for number, row in enumerate(transfer.label or ()):
        with in_field(f"{table}.label[{number}]"):
            function = transfer.mask_function(row, materials, basis)
            functions |= Mask(field, dict.fromkeys(row.labels, function)).functions
    with in_field(f"{table}.label"):
        return Mask(field, functions)
