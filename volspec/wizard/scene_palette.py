"""Scenes as palettes: lights are columns, materials are rows.

Scene -> [scene_palette] -> operations, result
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from volspec.appearance import Viewing
from volspec.errors import SceneError, nearest
from volspec.palette import Cell, DesignState, Palette, PaletteSpectrum, Place, Triple
from volspec.scene import NamedLight, Scene
from volspec.spectra import SpectralGrid, Spectrum

_BEFORE = " before"


@dataclass(frozen=True, slots=True, eq=False)
class ScenePalette:
    """A scene's materials and lights as rows and columns, looked up by name."""

    scene: Scene

    def __post_init__(self) -> None:
        if self.scene.basis.observer_deg != 2:
            degrees = self.scene.basis.observer_deg
            problem = f"{self.scene.path} has the {degrees}° observer"
            remedy, field = "give 2, as palettes use the 2° observer", "basis.observer_deg"
            raise SceneError(problem, remedy, code="unsupported", field=field, given=degrees)

    @property
    def viewing(self) -> Viewing:
        """The scene's viewing without what is measured in the picture."""
        return self.scene.relight.viewing.unmeasured()

    @property
    def grid(self) -> SpectralGrid:
        """Bands of the scene's basis."""
        return self.scene.basis.grid

    def require_material(self, name: str) -> str:
        """Return the name; refuse one that is not a material's."""
        return _require_name(self.scene, "material", name, self.scene.materials)

    def other_materials(self, name: str) -> list[str]:
        """Return all materials but one; refuse if there are no others."""
        self.require_material(name)
        names = [other for other in self.scene.materials if other != name]
        if not names:
            problem = f"{name!r} is the scene's only material"
            remedy = "add the [[material]] to compare it with"
            raise SceneError(problem, remedy, code="missing", field="material", given=name)
        return names

    def surrounding_material(self, name: str) -> str:
        """Return the most visible neighbour in the transfer function, or if none, of all others."""
        transfer, visible = self.scene.file.transfer, dict[str, float]()
        for amount, mix in transfer.visible_mixes():
            for material, fraction in mix.items():
                visible[material] = visible.get(material, 0.0) + amount * fraction
        names = self.other_materials(name)
        rows = [row.material_weights for row in transfer.points or transfer.surfaces or ()]
        near = {
            material
            for one, two in pairwise(rows)
            if name in one or name in two
            for material in (*one, *two)
        }
        candidates = [other for other in names if other in near] or names
        return max(candidates, key=lambda other: visible.get(other, 0.0))

    def light(self, name: str, field: str = "under", hint: str = "") -> NamedLight:
        """Return a light of the scene; ``field`` is the argument that names it, for errors."""
        lights = {light.name: light for light in self.scene.lights}
        return lights[_require_name(self.scene, "light", name, lights, field, hint)]

    def require_new_light(self, name: str) -> None:
        """Refuse a new light's name that is blank or already used in the scene."""
        if not name.strip():
            problem = "the new light has no name; give it one"
            raise SceneError(problem, code="missing", field="light")
        if any(light.name == name for light in self.scene.lights):
            problem = f"{name!r} is already a light of the scene; give the new one another name"
            raise SceneError(problem, code="duplicate", field="light", given=name)

    def light_columns(self, light: NamedLight) -> dict[str, Spectrum]:
        """Return a light's columns, one per group: equal under each is equal under any mixture.

        Surfaces face each group differently, so each is lit by a different mixture of them.
        """
        rig = light.rig
        # A room's groups are parts of one light, which have nearly the same spectrum.
        if len(rig.lights) == 1 or self.scene.room is not None:
            return {light.name: light.spectrum}
        return {
            f"{light.name} / {group or number}": spectrum
            for number, (group, spectrum) in enumerate(
                zip(rig.groups, rig.lights, strict=True), start=1
            )
        }

    def columns(self) -> tuple[PaletteSpectrum, ...]:
        """Return the columns of all lights, as given spectra."""
        return tuple(
            PaletteSpectrum(name, spectrum)
            for light in self.scene.lights
            for name, spectrum in self.light_columns(light).items()
        )

    def rows(self, free: Sequence[str], originals: bool = True) -> tuple[PaletteSpectrum, ...]:
        """Return the rows of all materials; ``originals`` adds each free material's present one."""
        rows = []
        for name, spectrum in self.scene.materials.items():
            if name not in free:
                rows.append(PaletteSpectrum(name, spectrum))
                continue
            # A measured value above 1 is fluorescence, on which no design may rely.
            rows.append(PaletteSpectrum(name, spectrum, free=True, upper=1.0))
            if originals and original_name(name) in self.scene.materials:
                taken = original_name(name)
                problem = f"{taken!r} is the name that wizards give to the original {name!r}"
                remedy = f"rename it without {_BEFORE!r}"
                raise SceneError(problem, remedy, code="duplicate", field="material", given=taken)
            if originals:
                rows.append(PaletteSpectrum(original_name(name), spectrum))
        return tuple(rows)

    def display_codes(self) -> dict[Place, Triple]:
        """Return the colour of every material under every column, clipped to the display."""
        names = list(self.scene.materials)
        rows, columns = self.rows(names[:1], originals=False), self.columns()
        # A palette needs a free row and a cell; the initial state is the scene's present one.
        black = {(names[0], columns[0].name): Cell("black")}
        state = DesignState.start(Palette(rows, columns, black, self.viewing, self.grid))
        models = state.colour_models()
        codes = models[0].space.encode(np.clip(state.RGB(models), 0.0, 1.0))
        return {
            (row.name, column.name): tuple(codes[i, j].tolist())
            for i, row in enumerate(rows)
            for j, column in enumerate(columns)
        }


def original_name(name: str) -> str:
    """Return the name of the row of a free material's original reflectance."""
    return f"{name}{_BEFORE}"


def _require_name(
    scene: Scene, kind: str, name: str, names: Mapping[str, object], field: str = "", hint: str = ""
) -> str:
    if name not in names:
        remedy = f"{nearest(str(name), names)}known: {', '.join(names)}{hint}"
        problem, field = f"{name!r} is unknown", field or kind
        raise SceneError(problem, remedy, code="unknown", field=field, given=name)
    return name
