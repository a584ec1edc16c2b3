"""Casts with layers of opacity: their rows of numbers, and what cannot be cast so.

RaycastSpec, tables -> [layer_casts] -> rows that a cast fills
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.basis import Basis, MaterialBasis
from volspec.errors import OpenCLError, RaycastError
from volspec.raycast.layered import MAX_MATERIALS, Slot
from volspec.raycast.lights import Ambient, Headlight
from volspec.raycast.spec import RaycastSpec
from volspec.transfer import FieldTables, SurfaceTable, Tables

if TYPE_CHECKING:
    from volspec.raycast.behind import Behind


def row_size(materials: int, groups: int, slots: int = 0) -> int:
    """Return the numbers of a layer: depths, shades by group, highlights, shadows, distance."""
    return materials + groups * materials + groups + slots * (4 + materials) + 1


def empty_rows(
    table: Tables, size: tuple[int, int], spec: RaycastSpec, count: int | None = None
) -> NDArray[np.float32]:
    """Return (H, W, L, `row_size`) zeros for a table's materials, which a cast fills.

    L is ``count``, or that of the cast.

    Raises OpenCLError if there is no memory for them.
    """
    assert not isinstance(table, FieldTables)
    width, height = size
    count = spec.layers if count is None else count
    numbers = row_size(len(table.channels), len(spec.groups), len(shadow_slots(spec)))
    try:
        return np.zeros((height, width, count, numbers), np.float32)
    except MemoryError:
        raise OpenCLError(
            f"raycast: no memory for {count} layers of {width}x{height}",
            "cast it smaller, or with fewer layers",
            code="size",
        ) from None


def shadow_slots(spec: RaycastSpec) -> list[Slot]:
    """Return the groups with shadows or ambient occlusion, in the order of a layer's numbers."""
    found = set()
    for g, group in enumerate(spec.groups):
        for source in group.sources:
            if isinstance(source, Ambient):
                found |= {(g, True)} if source.occlusion else set()
            elif not isinstance(source, Headlight) and source.shadows:
                found.add((g, False))
    return sorted(found)


def check_layers(spec: RaycastSpec, table: Tables, basis: Basis, behind: Sequence[Behind]) -> None:
    """Refuse what cannot be cast in layers, or with what is ``behind``. Raises RaycastError."""
    if not isinstance(basis, MaterialBasis):
        raise _refused(
            spec,
            f"basis {basis.name!r}, whose channels are {basis.method}, not materials",
            'set [basis] method = "materials" (a MaterialBasis), or leave layers out',
        )
    if len(basis.materials) > MAX_MATERIALS:
        raise _refused(
            spec,
            f"{len(basis.materials)} materials ({', '.join(basis.materials)})",
            f"give up to {MAX_MATERIALS}, or leave layers out",
        )
    if isinstance(table, FieldTables):
        raise _refused(spec, "several fields or masks", "show one field, or leave layers out")
    if isinstance(table, SurfaceTable):
        raise _refused(spec, "isosurfaces", "give a curve of opacity, or leave layers out")
    if table.filters is not None:
        raise _refused(
            spec, "spectral absorption (filters)", "leave the filters out, or leave layers out"
        )
    if behind and spec.layers == 1:
        raise _refused(spec, "meshes, which take one", "give 2 or more, or leave the meshes out")
    for each in behind:
        if each.translucent:
            problem = f"a translucent mesh, {each.translucent}"
            raise _refused(spec, problem, "set opacity = 1, or leave layers out")


def _refused(spec: RaycastSpec, problem: str, remedy: str) -> RaycastError:
    return RaycastError(
        f"{spec.layers} layers do not work with {problem}",
        remedy,
        code="conflict",
        field="raycast: layers",
        given=spec.layers,
    )


def refuse_layers(spec: RaycastSpec, problem: str, remedy: str) -> None:
    """Raise RaycastError if a cast has layers and meets what they cannot show."""
    if spec.layers:
        raise _refused(spec, problem, remedy)


def materials_without_opacity(table: Tables, basis: Basis) -> list[str]:
    """Return the names of the basis' materials of which a table shows nothing."""
    assert isinstance(basis, MaterialBasis)
    assert not isinstance(table, FieldTables | SurfaceTable)
    opacity = np.maximum(table.opacity, table.left_limits.opacity)
    weights = np.maximum(table.material_weights, table.left_limits.material_weights)
    shown = (opacity[..., None] * weights).reshape(-1, weights.shape[-1]).max(axis=0) > 0
    present = table.channels[shown].any(axis=0) if shown.any() else np.zeros(basis.size, bool)
    return [name for name, there in zip(basis.materials, present, strict=False) if not there]
