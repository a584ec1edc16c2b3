"""``[[group]]`` and ``[[light]]``: directions of light, and the spectra that shine from them.

    tables, spectra -> [lights] -> LightGroup, NamedLight

Rows of ``[[light]]`` that share a name form one setting: a light for each group.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, ClassVar

from pydantic import Field

from volspec.errors import SceneError
from volspec.relight import LightRig, RelightSpec
from volspec.scene.tables.specs import SpectrumRef, resolve_light
from volspec.settings import Name, NotNegative, Unit, settings
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra.library import canonical_light, lamp_for_light, lamp_illuminance_lux

# Characters between the groups of a setting on the command line.
PARTING = "=;"
# Keys to compute a lamp's lux from; the last is optional.
_COUNTED = ("power_W", "distance_m", "beam_deg")


@settings(SceneError)
@dataclass(frozen=True, slots=True, kw_only=True)
class LightSpec:
    """``[[light]]``: a name, a spectrum in `volspec.light`'s notation, and its light group.

    ``illuminance_lux`` sets the eye's adapting luminance; ``weight`` scales it, visibly at ``level
    = "absolute"``, and mixes the rows of one setting. A lamp's illuminance may instead be computed
    from its power and distance.
    """

    row_keys: ClassVar = ("name", "group")
    name: Annotated[Name, Field(examples=["day"])]
    """Name, used for the frame's file; rows with one name and different groups form one setting."""
    label: str | None = None
    """Caption; default: the name."""
    spectrum: Annotated[SpectrumRef, Field(examples=["D65"])]
    """D65, tungsten, planck:3200, FILE.csv, a mix D65*0.7+A*0.3, …, or a table of numbers."""
    group: Name | None = None
    """Light group that the light shines from; default: all groups."""
    weight: NotNegative = 1.0
    """Factor of the light's power."""
    illuminance_lux: Annotated[NotNegative, Unit("lux")] | None = None
    """Illuminance of a surface that faces every source; sets the eye's adaptation."""
    power_W: Annotated[float, Unit("W")] | None = None
    """For lamp:NAME, instead of illuminance_lux: the lamp's electrical power."""
    distance_m: Annotated[float, Unit("m")] | None = None
    """With power_W: distance of the lamp."""
    beam_deg: Annotated[float, Unit("degrees")] | None = None
    """With power_W and distance_m: full angle of the beam; default: all directions."""

    def __post_init__(self) -> None:
        counted = [key for key in _COUNTED if getattr(self, key) is not None]
        if not counted:
            return
        if self.illuminance_lux is not None:
            raise SceneError(
                f"given with {' and '.join(counted)}, which also set it",
                "give one of them",
                code="conflict",
                field="illuminance_lux",
                given=self.illuminance_lux,
            )
        if missing := [key for key in _COUNTED[:2] if key not in counted]:
            raise SceneError(
                f"missing, but {' and '.join(counted)} given",
                "a lamp's lux need power_W and distance_m",
                code="missing",
                field=missing[0],
            )
        if not isinstance(self.spectrum, str):
            raise SceneError(
                'only for named lamps, such as spectrum = "lamp:tungsten-2850", not for numbers',
                "give illuminance_lux",
                code="conflict",
                field="power_W",
                given=self.power_W,
            )

    @property
    def has_lux(self) -> bool:
        """True if the light's brightness is given."""
        return self.illuminance_lux is not None or self.power_W is not None

    def lux(self) -> float | None:
        """Illuminance, given or computed from the lamp; None without either.

        Raises SpectrumError if it is to be computed, but the spectrum is not a lamp or has no known
        lumens per watt, or a number is out of range.
        """
        if self.power_W is None or self.distance_m is None or not isinstance(self.spectrum, str):
            return self.illuminance_lux
        source = lamp_for_light(canonical_light(self.spectrum) or self.spectrum)
        return lamp_illuminance_lux(source, self.power_W, self.distance_m, self.beam_deg)


@dataclass(frozen=True, slots=True, eq=False)
class NamedLight:
    """A light setting of a scene.

    Parameters
    ----------
    name : str
        Name, also of its files.
    label : str
        Caption.
    spectrum : Spectrum
        Light on a surface that faces every source.
    rig : LightRig
        The spectra that light the picture, by group.
    """

    name: str
    label: str
    spectrum: Spectrum
    rig: LightRig

    def __repr__(self) -> str:
        lux = self.rig.illuminance_lux
        words = [self.name, self.label, "" if lux is None else f"{sum(lux):g} lx"]
        return f"NamedLight({', '.join(word for word in words if word)})"


class Lights(list[NamedLight]):
    """Light settings of a scene, which are printed one on each line."""

    def __repr__(self) -> str:
        return "\n".join(map(repr, self)) or "[]"


def rows_by_name(rows: Sequence[LightSpec]) -> dict[str, list[LightSpec]]:
    """Return the rows of each setting, in the order of the file."""
    settings: dict[str, list[LightSpec]] = {}
    for row in rows:
        settings.setdefault(row.name, []).append(row)
    return settings


def named_light(
    rows: Sequence[LightSpec],
    fractions: Mapping[str, float],
    grid: SpectralGrid,
    folder: str | os.PathLike[str],
    unsaved: Mapping[str, Spectrum] = MappingProxyType({}),
) -> NamedLight:
    """Return the light setting of the rows with one name, which all have lux or none has.

    ``unsaved`` holds spectra that are not on disk yet. Raises SpectrumError or ViewingError if a
    spectrum is unknown, a lamp's lux cannot be computed, or the rows give no light.
    """
    spectra = tuple(
        resolve_light(row.spectrum, row.name, grid, Path(folder), unsaved) for row in rows
    )
    lux = tuple(lux for row in rows if (lux := row.lux()) is not None)
    weights, groups = tuple(row.weight for row in rows), tuple(row.group or "" for row in rows)
    rig = LightRig(spectra, weights, lux or None, groups)
    label = next((row.label for row in rows if row.label), rows[0].name)
    facing = rig.facing(fractions)  # refuses a setting that gives no light, before the cast
    spectrum = spectra[0] if len(rows) == 1 else facing.mixed(grid)
    return NamedLight(rows[0].name, label, spectrum, rig)


def require_lux(
    lights: Iterable[NamedLight], spec: RelightSpec, path: str | os.PathLike[str]
) -> None:
    """Raise SceneError, before the cast, if the level is absolute and a light has no lux.

    Such a scene still loads: it can be cast, and viewed at the relative level.
    """
    if spec.level != "absolute":
        return
    for light in lights:
        if light.rig.illuminance_lux is None:
            raise SceneError(
                f"{os.fspath(path)}: [[light]] {light.name}: has no illuminance_lux, which "
                '[viewing] level = "absolute" requires of all lights',
                'give it, or set level = "relative"',
                code="missing",
            )
