"""Meshes of a scene whose rows change: each file is read once.

MeshSpec -> [meshes] -> MeshCaster -> viewer
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from volspec.basis import Basis
from volspec.scene.tables.specs import MeshSpec
from volspec.spectra import Spectrum

if TYPE_CHECKING:
    from volspec.mesh import Mesh, MeshCaster


class MeshCache:
    """Surfaces of rows of ``[[mesh]]``, relative to a folder; threads may share it.

    ``caster`` has those of ``rows`` that are shown.
    """

    def __init__(
        self, folder: Path, rows: Sequence[MeshSpec] = (), caster: MeshCaster | None = None
    ) -> None:
        self._folder, self._lock = folder, Lock()
        visible = tuple(row for row in rows if row.shown)
        self._last = visible, caster
        meshes = () if caster is None else caster.meshes
        # As files and shapes have them; and those of the last rows, in their places.
        self._read: dict[str, Mesh] = {}
        self._placed = {_place(row): mesh for row, mesh in zip(visible, meshes, strict=True)}

    def mesh(self, row: MeshSpec) -> Mesh:
        """Return the surface of a row; MeshError if a file cannot be used."""
        with self._lock:
            return self._mesh(row)

    def _mesh(self, row: MeshSpec) -> Mesh:
        place, surface = _place(row), _surface(row)
        if place not in self._placed:
            if surface not in self._read:
                self._read[surface] = row.read(self._folder)
            self._placed[place] = row.placed(self._read[surface])
        mesh = self._placed[place]
        look = mesh.material
        if row.material is not None and (mesh.materials or not row.own_colours):
            look = row.material
        return replace(mesh, material=look, opacity=row.opacity, cut=row.cut)

    def caster(
        self, rows: Sequence[MeshSpec], materials: Mapping[str, Spectrum], basis: Basis
    ) -> MeshCaster | None:
        """Return the rows that are shown, in materials and a basis; None without any.

        Raises MeshError if a file, a material or the basis cannot be used.
        """
        visible = tuple(row for row in rows if row.shown)
        if not visible:
            return None
        # Imported late: few scenes have meshes.
        from volspec.mesh import MeshCaster

        with self._lock:
            before, caster = self._last
            if caster is None or visible != before:
                meshes = [self._mesh(row) for row in visible]
                caster = MeshCaster(meshes, materials, basis, caster)
                self._last = visible, caster
                # Also of those that are hidden now.
                places = {_place(row) for row in rows}
                self._placed = {key: mesh for key, mesh in self._placed.items() if key in places}
        return caster.painted(materials, basis)


def _place(row: MeshSpec) -> str:
    """Return a key of the surface in its place: all of a row but its look and cut."""
    material = None if row.material is None else "any"
    return repr(replace(row, material=material, opacity=1.0, shown=True, cut=False))


def _surface(row: MeshSpec) -> str:
    """Return a key of what a file or a shape gives."""
    source = MeshSpec(file=row.file, shape=row.shape, material="any", smooth_deg=row.smooth_deg)
    look = row.texture, row.materials, row.shares, row.own_colours, row.material is None
    return repr((source, look))
