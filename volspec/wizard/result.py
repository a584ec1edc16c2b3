"""A scene that a wizard has redesigned: its new scene, the palette, and what was reached.

Scene, Design -> [result] -> writing
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from volspec.basis import MaterialBasis
from volspec.palette import Design, PaletteSpectrum
from volspec.scene import NamedLight, Scene
from volspec.scene.lights import LightTable
from volspec.scene.tables import BasisTable
from volspec.spectra import Spectrum
from volspec.wizard.reached import Reached, off, reached
from volspec.wizard.writing import Changes, write

# What addresses in the new scene begin with until it is saved beside a palette of its own name.
_PALETTE = "palette.toml"
# CIEDE2000 between a basis and all bands from which on it is not good enough.
_BLUR = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Redesigned:
    """What a wizard made.

    Parameters
    ----------
    scene : Scene
        With the designed spectra in place.
    design : Design
    materials : tuple of str
        Those that were designed.
    reached : tuple of Reached
        Figures of every light, as its frames show them.
    changes : Changes
        What is new in the scene's file.
    """

    scene: Scene
    design: Design
    materials: tuple[str, ...]
    reached: tuple[Reached, ...]
    changes: Changes

    def delta_e(self, light: str, one: str, other: str) -> float:
        """CIEDE2000 between two materials under a light, as its frames show them."""
        own = next(row for row in self.reached if row.light == light)
        return own.apart[(one, other) if (one, other) in own.apart else (other, one)]

    def save(self, path: str | os.PathLike[str]) -> tuple[Path, Path]:
        """Write the scene's file, comments kept, and beside it ``…-palette.toml``.

        Returns
        -------
        (scene, palette) : paths

        Raises
        ------
        SceneError
            If it is the scene itself, or it or the palette beside it is there and no wizard's.
        InputError
            If they cannot be written there.
        """
        return write(self.scene, self.design, self.changes, Path(path))


@dataclass(frozen=True, slots=True, eq=False)
class NewLight:
    """A light that a wizard designs.

    Parameters
    ----------
    member : PaletteSpectrum
        Open.
    like : NamedLight
        The one of the scene that it resembles.
    """

    member: PaletteSpectrum
    like: NamedLight


def redesigned(
    scene: Scene, made: Design, materials: Sequence[str], light: NewLight | None
) -> Redesigned:
    """Put a design into a scene and measure what it shows."""
    spectra = {f"{_PALETTE}#{name}": made.reflectance(name) for name in materials}
    spectra = {**scene.known, **spectra}
    rows = [
        row.model_copy(update={"reflectance": f"{_PALETTE}#{row.name}"})
        if row.name in materials
        else row
        for row in scene.file.material
    ]
    update: dict[str, object] = {"material": rows}
    name = None
    if light is not None:
        name = light.member.name
        lux = light.like.rig.facing(scene.raycast.shares()).total_lux
        address = f"{_PALETTE}#{name}"
        spectra[address] = made.light(name)
        row = LightTable(name=name, spectrum=address, illuminance_lux=lux)
        update["light"] = [*scene.file.light, row]
    file = scene.file.model_copy(update=update)
    after, exact = _well_based(Scene(file, scene.path, spectra), spectra)
    changes = Changes(tuple(materials), name, exact)
    figures = reached(scene, after, materials, light.like if light else None)
    return Redesigned(after, made, tuple(materials), figures, changes)


def _well_based(scene: Scene, spectra: dict[str, Spectrum]) -> tuple[Scene, bool]:
    """The scene, or one cast by its materials where its basis blurs what was designed."""
    filters = any(row.filter is not None for row in scene.file.material)
    if filters or isinstance(scene.basis, MaterialBasis):
        return scene, False
    table = BasisTable(
        method="materials",
        **scene.file.basis.model_dump(include={"grid_nm"}, exclude_none=True),
    )
    other = Scene(scene.file.model_copy(update={"basis": table}), scene.path, spectra)
    if off(scene, other) < _BLUR:
        return scene, False
    return other, True
