"""A scene as the beginning of a palette: its lights are columns, its materials rows.

Scene -> [drawing] -> asks -> palette
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from volspec.appearance.spec import Viewing
from volspec.errors import SceneError, nearest
from volspec.palette import PaletteSpectrum
from volspec.scene import NamedLight, Scene
from volspec.spectra import Spectrum

_BEFORE = " before"


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What wizards ask a scene for, and what they say where it has not got it.

    Parameters
    ----------
    scene : Scene

    Raises
    ------
    SceneError
        If the scene sees with the 10° observer, which no palette does.
    """

    scene: Scene

    def __post_init__(self) -> None:
        if self.scene.basis.observer_deg != 2:
            raise SceneError.refused(
                f"{self.scene.path}: [basis] observer_deg",
                self.scene.basis.observer_deg,
                "palettes are designed for the 2° observer, give 2",
            )

    @property
    def viewing(self) -> Viewing:
        """How the scene is looked at; where it measures that in each picture, as by default."""
        return replace(self.scene.relight.viewing, adapting="given", fov_deg=None)

    def material(self, name: str) -> str:
        """A material's name, if there is one.

        Raises
        ------
        SceneError
            If there is none, or no other beside it.
        """
        names = list(self.scene.materials)
        if name not in names:
            raise SceneError(
                f"{self.scene.path}: no material is named {name!r}; {nearest(str(name), names)}"
                f"there is {', '.join(names)}",
                code="unknown",
            )
        return name

    def beside(self, name: str) -> list[str]:
        """The other materials.

        Raises
        ------
        SceneError
            If there are none.
        """
        self.material(name)
        others = [other for other in self.scene.materials if other != name]
        if not others:
            raise SceneError(
                f"{self.scene.path}: {name!r} is the only material; add the [[material]] that it "
                "is compared with"
            )
        return others

    def host(self, name: str) -> str:
        """The material that another is embedded in.

        Of those that lie next to it in the transfer function the one most seen, else of all.
        """
        table, use = self.scene.file.transfer, dict[str, float]()
        mixes = [(amount, shares) for amount, shares in table.seen()]
        for amount, shares in mixes:
            for material, share in shares.items():
                use[material] = use.get(material, 0.0) + amount * share
        others = self.beside(name)
        rows = [row.shares for row in table.points or table.surfaces or ()]
        near = {
            material
            for one, two in pairwise(rows)
            if name in one or name in two
            for material in (*one, *two)
        }
        candidates = [other for other in others if other in near] or others
        return max(candidates, key=lambda other: use.get(other, 0.0))

    def light(self, name: str, hint: str = "") -> NamedLight:
        """A light of the scene.

        Raises
        ------
        SceneError
            If there is none of that name.
        """
        found = next((light for light in self.scene.lights if light.name == name), None)
        if found is None:
            names = [light.name for light in self.scene.lights]
            raise SceneError(
                f"{self.scene.path}: no light of the scene is named {name!r}; "
                f"{nearest(str(name), names)}there is {', '.join(names)}{hint}",
                code="unknown",
            )
        return found

    def new_light(self, name: str) -> str:
        """A name for a light that the scene has not got yet.

        Raises
        ------
        SceneError
            If it has.
        """
        if not name.strip():
            raise SceneError(f"{self.scene.path}: the new light has no name; give it one")
        if any(light.name == name for light in self.scene.lights):
            raise SceneError(
                f"{self.scene.path}: a light is named {name!r} already; name the new one otherwise",
                code="duplicate",
            )
        return name

    def columns(self, light: NamedLight) -> dict[str, Spectrum]:
        """A light's columns: one for each group's own, as what is alike under each is so under all.

        A surface that faces one group more than another is lit by another mix of them.
        """
        rig = light.rig
        if len(rig.lights) == 1:
            return {light.name: light.spectrum}
        return {
            f"{light.name} / {group or number}": spectrum
            for number, (group, spectrum) in enumerate(
                zip(rig.groups, rig.lights, strict=True), start=1
            )
        }

    def lights(self) -> tuple[PaletteSpectrum, ...]:
        """All the scene's, as given columns."""
        return tuple(
            PaletteSpectrum(name, spectrum)
            for light in self.scene.lights
            for name, spectrum in self.columns(light).items()
        )

    def rows(self, opened: Sequence[str], before: bool = True) -> tuple[PaletteSpectrum, ...]:
        """All the scene's materials; some open, and what those are now as rows of their own.

        Raises
        ------
        SceneError
            If a material has the name of such a row.
        """
        rows = []
        taken = [was(name) for name in opened if before and was(name) in self.scene.materials]
        if taken:
            raise SceneError(
                f"{self.scene.path}: a material is named {taken[0]!r}, as wizards call "
                f"{taken[0].removesuffix(_BEFORE)!r} as it was; name it without {_BEFORE!r}"
            )
        for name, spectrum in self.scene.materials.items():
            if name in opened:
                # A measured value above 1 is a fluorescence that no design may count on.
                rows.append(PaletteSpectrum(name, spectrum, open=True, upper=1.0))
                if before:
                    rows.append(PaletteSpectrum(was(name), spectrum))
            else:
                rows.append(PaletteSpectrum(name, spectrum))
        return tuple(rows)


def was(name: str) -> str:
    """What the palette calls a material as it was."""
    return f"{name}{_BEFORE}"
