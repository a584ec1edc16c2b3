"""Opacities of materials, scaled in a baked table: what a cast of a faded material sees.

    table, {material: scale} -> [opacities] -> table

A scale s_k acts on the optical depth τ_k = w_k τ of a material k, also within mixtures:

    1 − α' = (1 − α)^(Σ s_k w_k / Σ w_k),   w'_k = s_k w_k Σ w_k / Σ s_k w_k

It is what `volspec.CoefficientImage.recompose` does without a cast.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis
from volspec.errors import TransferError, nearest, quote
from volspec.transfer.kinds import Table, Tables
from volspec.transfer.table import Entries

Array = NDArray[np.float64]


def scale_opacities(table: Tables, basis: Basis, opacities: Mapping[str, float]) -> Tables:
    """Return a table with the optical depths of some of its basis' materials scaled.

    Raises TransferError as `check_opacities`.
    """
    check_opacities(basis, opacities)
    if all(scale == 1 for scale in opacities.values()):
        return table
    assert isinstance(basis, MaterialBasis)
    scales = np.array([*(opacities.get(name, 1.0) for name in basis.materials), 1.0])

    def scaled(one: Table, _name: str) -> Table:
        rows = scales[one.channels.argmax(axis=1)]
        opacity, weights = _scale_depths(one.opacity, one.material_weights, rows)
        if one.left is not None:
            limits = _scale_depths(one.left.opacity, one.left.material_weights, rows)
            one = replace(one, left=Entries(*limits, None))
        return replace(one, opacity=opacity, material_weights=weights)

    return table.changed(scaled)


def check_opacities(basis: Basis, opacities: Mapping[str, float]) -> None:
    """Raise TransferError if a name is unknown, or materials are not the basis' channels."""
    if all(scale == 1 for scale in opacities.values()):
        return
    if not isinstance(basis, MaterialBasis):
        raise TransferError(
            f"opacities of materials do not work with basis {basis.name!r}, whose channels are "
            f"{basis.method}",
            'set [basis] method = "materials" (a MaterialBasis), or leave them out',
            code="conflict",
            field="raycast: opacities",
        )
    for name in opacities:
        if name not in basis.materials:
            raise TransferError(
                f"there is no material {quote(name)}; {nearest(name, basis.materials)}"
                f"known: {', '.join(basis.materials)}",
                code="unknown",
                field="raycast: opacities",
            )


def _scale_depths(opacity: Array, weights: Array, scales: Array) -> tuple[Array, Array]:
    """Return (…,) opacities and (…, K) weights with (K,) scales of the optical depths."""
    before, after = weights.sum(axis=-1), weights @ scales
    ratio = np.where(before > 0, after / np.where(before > 0, before, 1), 1.0)
    opacity = 1 - (1 - opacity) ** ratio
    gain = np.where(after > 0, before / np.where(after > 0, after, 1), 0.0)
    kept = np.where(after[..., None] > 0, weights * scales * gain[..., None], weights)
    return opacity, kept
