"""Transfer functions of several fields, composed as media that share one place.

    fields -> {field: TransferFunction} -> [tables in common channels] -> raycast

At a sample, every field f is classified alone, and extinctions add, each by its weight w:

    τ = Σ w_f τ_f(v_f),   α = 1 − e^−τ,   s = Σ w_f τ_f s_f(v_f) / τ   (Beer–Lambert)

with τ_f = −log(1 − opacity) of the step; materials thus mix by extinction, and shading is of each
field's own gradient. The order of fields changes nothing.

A mask replaces a field's function by label of another field, which has a lattice of its own:

    τ_f = Σ_l w_l τ_f,l(v_f)

with w_l the trilinear weight of the corners that have label l, so that boundaries of labels are
smooth and nothing is interpolated between their numbers. Instead of labels, bands of another
field's values choose the function: a joint function of two fields, such as the energies of a CT.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis
from volspec.errors import Code, TransferError, nearest
from volspec.spectra import Spectrum
from volspec.transfer.model import TransferFunction
from volspec.transfer.table import Entries, TransferTable
from volspec.volume import MAX_FIELDS

_WHO = "FieldFunctions"
OWN = ""
"""Name of a volume's own field, whatever it is called."""
Label = int | str | tuple[float, float]
"""A label's number or name, or a band of values."""
MAX_CURVES = 255
"""Most different transfer functions in a mask."""


@dataclass(frozen=True, slots=True, eq=False)
class Mask:
    """Transfer functions by label, or value, of another field, in place of a field's own.

    Parameters
    ----------
    field : str
        Name of the volume's field of labels, which need not be shown itself.
    functions : {label: TransferFunction or None}
        By number, by name in the field's `Volume.labels`, or by a band of its values, (from, to),
        without ``to``. None hides what has the label. Labels and values that are left out, and
        places outside the mask's lattice, have the masked field's own.

    Raises
    ------
    TransferError
        If there is no function or too many, a label is below 0, or a band is empty.
    """

    field: str
    functions: Mapping[Label, TransferFunction | None]

    def __post_init__(self) -> None:
        if not self.functions:
            remedy = "give {label: TransferFunction or None}, at least one"
            raise TransferError.refused("Mask.functions", self.functions, remedy, "missing")
        checked: dict[Label, TransferFunction | None] = {}
        for label, function in self.functions.items():
            where = f"Mask.functions[{label!r}]"
            if isinstance(label, tuple):
                ends = [isinstance(end, int | float | np.number) for end in label]
                if not (ends == [True, True] and label[0] < label[1]):
                    raise TransferError.refused(where, label, "give a band (from, to)", "range")
            elif not isinstance(label, str):
                is_integer = isinstance(label, int | np.integer) and not isinstance(label, bool)
                if not (is_integer and label >= 0):
                    remedy = "give a label's name, or its number from 0"
                    code: Code = "range" if is_integer else "type"
                    raise TransferError.refused(where, label, remedy, code)
                label = int(label)
            checked[label] = function
        if len(self.curves) > MAX_CURVES:
            raise TransferError(
                f"{len(self.curves)} transfer functions, at most {MAX_CURVES} can be cast",
                "give labels that look alike the same one",
                code="size",
                field="Mask.functions",
            )
        object.__setattr__(self, "functions", MappingProxyType(checked))

    @property
    def curves(self) -> tuple[TransferFunction | None, ...]:
        """The different functions, each once, in the labels' order."""
        return tuple({id(function): function for function in self.functions.values()}.values())

    def changed(self, change: Callable[[TransferFunction], TransferFunction]) -> Mask:
        """Return the mask with other functions; labels that share one still do."""
        changed = {id(curve): curve and change(curve) for curve in self.curves}
        return replace(self, functions={k: changed[id(v)] for k, v in self.functions.items()})


@dataclass(frozen=True, slots=True, eq=False)
class FieldFunctions:
    """Transfer functions by field, for a volume of several.

    Parameters
    ----------
    functions : {field: TransferFunction}
        By the fields' names, in one basis; ``""`` is the volume's own. Fields that are left out are
        not shown. Without ``gradient_opacity`` and ``filters``.
    weights : {field: float}, optional
        Factors of the extinction, from 0, which hides a field; 1 for those left out.
    masks : {field: Mask}, optional
        Functions by label of another field, in place of a field's own.

    Raises
    ------
    TransferError
        If there is no function or too many, one is in another basis, or a weight is below 0; if a
        weight or a mask is of an unknown field.

    Examples
    --------
    >>> from volspec.spectra import reflectance
    >>> from volspec.basis import SpectralBasis
    >>> metals, basis = {"gold": reflectance("gold")}, SpectralBasis.load("general-7")
    >>> bone = TransferFunction([(60, 0.0, "gold"), (90, 0.5, "gold")], metals, basis)
    >>> FieldFunctions({"CT": bone, "PET": bone}, weights={"PET": 0.5})
    FieldFunctions(CT, PET × 0.5)

    Organs of a segmentation in their own colours, without the table that the patient lies on:

    >>> organs = Mask("organs", {"liver": bone, 7: None})
    >>> FieldFunctions({"CT": bone}, masks={"CT": organs})
    FieldFunctions(CT by organs)
    """

    functions: Mapping[str, TransferFunction]
    weights: Mapping[str, float] = field(default_factory=dict)
    masks: Mapping[str, Mask] = field(default_factory=dict)

    def __post_init__(self) -> None:
        functions = self.functions
        if not 1 <= len(functions) <= MAX_FIELDS:
            remedy = f"give 1 to {MAX_FIELDS} transfer functions by field"
            raise TransferError.refused(f"{_WHO}.functions", functions, remedy, "shape")
        for name, function in functions.items():
            self._check(function, f"{_WHO}.functions[{name!r}]")
        for name, weight in self.weights.items():
            where = f"{_WHO}.weights[{name!r}]"
            self._require(name, where)
            if not (math.isfinite(weight) and weight >= 0):
                raise TransferError.refused(where, weight, "give 0 or more", "range")
        for name, mask in self.masks.items():
            where = f"{_WHO}.masks[{name!r}]"
            self._require(name, where)
            for label, by_label in mask.functions.items():
                if by_label is not None:
                    self._check(by_label, f"{where}.functions[{label!r}]")
        for key in ("functions", "weights", "masks"):
            object.__setattr__(self, key, MappingProxyType(dict(getattr(self, key))))

    def _require(self, name: str, where: str) -> None:
        """Refuse a field without a function."""
        if name not in self.functions:
            names = ", ".join(map(repr, self.functions))
            remedy = f"{nearest(name, self.functions)}give one of {names}"
            raise TransferError("no such field", remedy, code="unknown", field=where)

    def _check(self, function: TransferFunction, where: str) -> None:
        """Refuse a function that cannot be cast with others."""
        if function.gradient_opacity is not None or function.filters:
            raise TransferError(
                "has gradient_opacity or filters, which several fields cannot have",
                "leave them out",
                code="conflict",
                field=where,
            )
        if function.basis.fingerprint != self.basis.fingerprint:
            raise TransferError(
                f"is in the basis {function.basis.name!r}, others in {self.basis.name!r}",
                "make all in one basis",
                code="conflict",
                field=where,
            )

    def __repr__(self) -> str:
        weighted = [
            (name or "own")
            + (f" × {weight:g}" if weight != 1.0 else "")
            + (f" by {self.masks[name].field}" if name in self.masks else "")
            for name in self.functions
            for weight in [self.weights.get(name, 1.0)]
        ]
        return f"{_WHO}({', '.join(weighted)})"

    @property
    def basis(self) -> Basis:
        """Basis of all functions."""
        return next(iter(self.functions.values())).basis

    @property
    def materials(self) -> dict[str, Spectrum]:
        """Materials of all functions by name."""
        by_label = (curve for mask in self.masks.values() for curve in mask.curves)
        return {
            name: spectrum
            for function in (*self.functions.values(), *filter(None, by_label))
            for name, spectrum in function.materials.items()
        }

    @property
    def shown(self) -> dict[str, float]:
        """Weights of the fields that are not hidden; of all if none is left."""
        weights = {name: self.weights.get(name, 1.0) for name in self.functions}
        return {name: weight for name, weight in weights.items() if weight > 0} or weights


@dataclass(frozen=True, slots=True, eq=False)
class MaskTables:
    """Tables by label of the field of labels, in place of a field's own, which is row 0."""

    field: str
    rows: tuple[TransferTable, ...]  # from row 1 on
    edges: NDArray[np.float64]  # (E,) ascending values at which the row changes
    between: NDArray[np.uint8]  # (E + 1,) rows below the edges, between them and from the last on

    @property
    def key(self) -> tuple[str, bytes, bytes]:
        """Field and rows, equal for equal ones."""
        return self.field, self.edges.tobytes(), self.between.tobytes()

    def rows_at(self, values: NDArray[Any]) -> NDArray[np.uint8]:
        """Return the rows of values.

        >>> MaskTables("MR", (), np.array([2.0, 5.0]), np.array([0, 1, 2])).rows_at([1, 2, 4.9, 5])
        array([0, 1, 1, 2])
        """
        return np.asarray(self.between[np.searchsorted(self.edges, values, side="right")])


@dataclass(frozen=True, slots=True, eq=False)
class FieldTables:
    """Tables by field, all with the same ``channels`` (K, M) and ``white``: see `in_one`."""

    tables: Mapping[str, TransferTable]
    masks: Mapping[str, MaskTables] = field(default_factory=dict)
    labels: ClassVar[bool] = False
    filters: ClassVar[None] = None

    @classmethod
    def in_one(
        cls, tables: Mapping[str, TransferTable], masks: Mapping[str, MaskTables] | None = None
    ) -> FieldTables:
        """Return tables whose weights refer to the materials of all, or to channels if fewer."""
        combined = cls(tables, masks or {})
        channels, number = np.unique(
            np.vstack([table.channels for table in combined.every]), axis=0, return_inverse=True
        )
        few = len(channels) < channels.shape[1]
        numbers = iter(number.ravel())

        def remixed(table: TransferTable, _name: str) -> TransferTable:
            rows = np.eye(len(channels))[[next(numbers) for _ in table.channels]]
            return _remap_materials(table, rows if few else table.channels, channels, few)

        return combined.changed(remixed)

    @property
    def every(self) -> tuple[TransferTable, ...]:
        """All tables, field by field: its own, and those of its mask's rows."""
        return tuple(row for name in self.tables for row in self.rows(name))

    @property
    def opacity_key(self) -> tuple[Any, ...]:
        """Value that is equal for tables of equal opacities and masks."""
        keys = [table.opacity_key for table in self.every]
        return *self.tables, *keys, *((name, *mask.key) for name, mask in self.masks.items())

    def rows(self, name: str) -> tuple[TransferTable, ...]:
        """Return a field's own table, and those of its mask from row 1 on."""
        mask = self.masks.get(name)
        return (self.tables[name], *(mask.rows if mask else ()))

    def by_field(self, _name: str) -> Mapping[str, tuple[TransferTable, ...]]:
        """Return the `rows` of every field."""
        return {name: self.rows(name) for name in self.tables}

    def changed(self, change: Callable[[Any, str], Any], _name: str = OWN) -> FieldTables:
        """Return what a function makes of every table, in the order of `every`, and its field."""
        tables, masks = {}, dict(self.masks)
        for name in self.tables:
            tables[name], *rows = (change(row, name) for row in self.rows(name))
            if rows:
                masks[name] = replace(masks[name], rows=tuple(rows))
        return FieldTables(tables, masks)

    def split_fields(self) -> list[FieldTables]:
        """Return the tables of each field alone."""
        masks = self.masks
        return [
            FieldTables({name: table}, {name: masks[name]} if name in masks else {})
            for name, table in self.tables.items()
        ]

    @property
    def size(self) -> int:
        """M, the channels of the picture."""
        return self.every[0].size

    @property
    def channels(self) -> NDArray[np.float64]:
        """(K, M) channels of all materials."""
        return self.every[0].channels

    @property
    def white(self) -> NDArray[np.float64]:
        """(M,) channels of the perfect diffuser."""
        return self.every[0].white


def _remap_materials(
    table: TransferTable, rows: NDArray[np.float64], channels: NDArray[np.float64], few: bool
) -> TransferTable:
    """Return a table of other materials: a weight of its k-th one is ``rows[k]`` of these."""
    left = table.left
    if left is not None:
        left = Entries(left.opacity, left.material_weights @ rows, None)
    return replace(
        table,
        material_weights=table.material_weights @ rows,
        channels=channels if few else np.eye(channels.shape[1]),
        left=left,
    )


def scale_taus(table: TransferTable, weight: float) -> TransferTable:
    """Return a table whose extinction is multiplied by a weight.

    >>> table = TransferTable((0, 1), [0.0, 0.75], [[1], [1]], reference_step_mm=1)
    >>> scale_taus(table, 0.5).opacity.tolist()
    [0.0, 0.5]
    """
    if weight == 1.0:
        return table
    left = table.left
    if left is not None:
        left = left._replace(opacity=1 - (1 - left.opacity) ** weight)
    return replace(table, opacity=1 - (1 - table.opacity) ** weight, left=left)
