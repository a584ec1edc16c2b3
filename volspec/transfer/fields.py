"""Transfer functions of several fields, composed as media that share one place.

    fields -> {field: TransferFunction} -> [tables in common channels] -> raycast

At a sample, every field f is classified alone, and extinctions add, each by its weight w:

    τ = Σ w_f τ_f(v_f),   α = 1 − e^−τ,   s = Σ w_f τ_f s_f(v_f) / τ   (Beer–Lambert)

with τ_f = −log(1 − opacity) of the step; materials thus mix by extinction, and shading is of each
field's own gradient. The order of fields changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis
from volspec.errors import TransferError, nearest
from volspec.spectra import Spectrum
from volspec.transfer.model import TransferFunction
from volspec.transfer.table import Entries, TransferTable
from volspec.volume.channels import MAX_FIELDS

_WHO = "FieldFunctions"
OWN = ""
"""Name of a volume's own field, whatever it is called."""


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

    Raises
    ------
    TransferError
        If there is no function or too many, one is of another kind or in another basis, or a
        weight is below 0 or of an unknown field.

    Examples
    --------
    >>> from volspec.spectra import reflectance
    >>> from volspec.basis import SpectralBasis
    >>> metals, basis = {"gold": reflectance("gold")}, SpectralBasis.load("general-7")
    >>> bone = TransferFunction([(60, 0.0, "gold"), (90, 0.5, "gold")], metals, basis)
    >>> FieldFunctions({"CT": bone, "PET": bone}, weights={"PET": 0.5})
    FieldFunctions(CT, PET × 0.5)
    """

    functions: Mapping[str, TransferFunction]
    weights: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        functions = self.functions
        if not isinstance(functions, Mapping) or not 1 <= len(functions) <= MAX_FIELDS:
            remedy = f"give 1 to {MAX_FIELDS} transfer functions by field"
            raise TransferError.refused(f"{_WHO}.functions", functions, remedy, "type")
        for name, function in functions.items():
            where = f"{_WHO}.functions[{name!r}]"
            if not isinstance(function, TransferFunction):
                remedy = "give a TransferFunction"
                raise TransferError.refused(where, function, remedy, "type")
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
        for name, weight in self.weights.items():
            where = f"{_WHO}.weights[{name!r}]"
            if name not in functions:
                raise TransferError(
                    "no such field",
                    f"{nearest(name, functions)}give one of {', '.join(map(repr, functions))}",
                    code="unknown",
                    field=where,
                )
            if not (isinstance(weight, int | float) and math.isfinite(weight) and weight >= 0):
                raise TransferError.refused(where, weight, "give 0 or more", "range")
        object.__setattr__(self, "functions", MappingProxyType(dict(functions)))
        object.__setattr__(self, "weights", MappingProxyType(dict(self.weights)))

    def __repr__(self) -> str:
        weighted = [
            (name or "own") + (f" × {weight:g}" if weight != 1.0 else "")
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
        return {
            name: spectrum
            for function in self.functions.values()
            for name, spectrum in function.materials.items()
        }

    @property
    def shown(self) -> dict[str, float]:
        """Weights of the fields that are not hidden; of all if none is left."""
        weights = {name: self.weights.get(name, 1.0) for name in self.functions}
        return {name: weight for name, weight in weights.items() if weight > 0} or weights


@dataclass(frozen=True, slots=True, eq=False)
class FieldTables:
    """Tables by field, all with the same ``channels`` (K, M) and ``white``: see `in_one`."""

    tables: Mapping[str, TransferTable]

    @classmethod
    def in_one(cls, tables: Mapping[str, TransferTable]) -> FieldTables:
        """Return tables whose weights refer to the materials of all, or to channels if fewer."""
        channels, number = np.unique(
            np.vstack([table.channels for table in tables.values()]), axis=0, return_inverse=True
        )
        few = len(channels) < channels.shape[1]
        made, first = {}, 0
        for name, table in tables.items():
            count = len(table.channels)
            rows = np.eye(len(channels))[number.ravel()[first : first + count]]
            first += count
            made[name] = _remixed(table, rows if few else table.channels, channels, few)
        return cls(MappingProxyType(made))

    @property
    def _first(self) -> TransferTable:
        return next(iter(self.tables.values()))

    @property
    def size(self) -> int:
        """M, the channels of the picture."""
        return self._first.size

    @property
    def channels(self) -> NDArray[np.float64]:
        """(K, M) channels of all materials."""
        return self._first.channels

    @property
    def white(self) -> NDArray[np.float64]:
        """(M,) channels of the perfect diffuser."""
        return self._first.white


def _remixed(
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


def weighted(table: TransferTable, weight: float) -> TransferTable:
    """Return a table whose extinction is multiplied by a weight.

    >>> table = TransferTable((0, 1), [0.0, 0.75], [[1], [1]], reference_step_mm=1)
    >>> weighted(table, 0.5).opacity.tolist()
    [0.0, 0.5]
    """
    if weight == 1.0:
        return table
    left = table.left
    if left is not None:
        left = left._replace(opacity=1 - (1 - left.opacity) ** weight)
    return replace(table, opacity=1 - (1 - table.opacity) ** weight, left=left)
