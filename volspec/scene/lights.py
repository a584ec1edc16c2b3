"""``[[group]]`` and ``[[light]]``: where light comes from, and what shines from there.

    tables, spectra -> [lights] -> LightGroup, NamedLight

Rows of ``[[light]]`` that share a name are one setting: a light for each group.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator, model_validator

from volspec._tables import Name, Table, Vector
from volspec.raycast import Ambient, Directional, Headlight, LightGroup, Point
from volspec.raycast.lights import Source
from volspec.relight import LightRig
from volspec.scene.keyparts import NotNegative
from volspec.scene.spectra import Given, given_light
from volspec.spectra import SpectralGrid, Spectrum
from volspec.spectra.lamps import lamp_for_light, lamp_illuminance_lux

_AMBIENT, _HEAD = Ambient(), Headlight()
_FAR, _NEAR = Directional((0, 0, 1)), Point((0, 0, 0))
# What parts the groups of a setting on the command line.
PARTING = "=;"
# What a lamp's lux are counted from; the last may be left out.
_COUNTED = ("power_W", "distance_m", "beam_deg")


class _SourceTable(Table):
    """A source of a group; the subclass says which keys it has."""

    row_keys = ("kind",)
    source_type: ClassVar[type]

    def source(self) -> Source:
        """The source as a cast takes it.

        Raises
        ------
        RaycastError
            If a number is out of range.
        """
        settings: dict[str, Any] = self.model_dump(exclude={"kind"})
        return self.source_type(**settings)


class AmbientTable(_SourceTable):
    """Light from everywhere; see `volspec.Ambient`."""

    source_type = Ambient
    kind: Literal["ambient"]
    """What it is."""
    intensity: float = _AMBIENT.intensity
    """Factor of its light."""
    occlusion: bool = _AMBIENT.occlusion
    """Whether what is near takes light away."""
    radius_mm: float | None = _AMBIENT.radius_mm
    """How far occluders reach; left out, a tenth of the volume's diagonal."""


class HeadlightTable(_SourceTable):
    """A light at the camera; see `volspec.Headlight`."""

    source_type = Headlight
    kind: Literal["headlight"]
    """What it is."""
    intensity: float = _HEAD.intensity
    """Factor of its light."""


class DirectionalTable(_SourceTable):
    """A light far away; see `volspec.Directional`."""

    source_type = Directional
    kind: Literal["directional"]
    """What it is."""
    towards: Annotated[Vector, Field(examples=[[1, 0.75, 0.6]])]
    """From the volume to the light."""
    frame: str = _FAR.frame
    """world, or camera: right, up, back; the light moves with the camera."""
    intensity: float = _FAR.intensity
    """Factor of its light."""
    shadows: bool = _FAR.shadows
    """Whether the volume casts shadows."""


class PointLightTable(_SourceTable):
    """A light near by; see `volspec.Point`."""

    source_type = Point
    kind: Literal["point"]
    """What it is."""
    position_mm: Annotated[Vector, Field(examples=[[0, 0, -500]])]
    """Where it stands; of frame camera counted from the camera."""
    frame: str = _NEAR.frame
    """world or camera."""
    intensity: float = _NEAR.intensity
    """Factor of its light."""
    shadows: bool = _NEAR.shadows
    """Whether the volume casts shadows."""
    falloff_mm: float | None = _NEAR.falloff_mm
    """Where the light has its intensity, falling with the distance squared; left out, it stays."""


AnySource = Annotated[
    AmbientTable | HeadlightTable | DirectionalTable | PointLightTable, Field(discriminator="kind")
]


class GroupTable(Table):
    """``[[group]]``: sources that share a spectrum and a weight; see `volspec.LightGroup`."""

    row_keys = ("name",)
    name: Annotated[Name, Field(examples=["lamp"])]
    """Any but = and ;."""
    sources: Annotated[list[AnySource], Field(min_length=1, examples=[[{"kind": "headlight"}]])]
    """What shines."""

    @field_validator("name")
    @classmethod
    def _can_be_written(cls, name: str) -> str:
        if set(name) & set(PARTING):
            raise ValueError("= and ; part groups on the command line; leave them out")
        return name

    def group(self) -> LightGroup:
        """The group as a cast takes it.

        Raises
        ------
        RaycastError
            If a source is out of range.
        """
        return LightGroup(self.name, tuple(row.source() for row in self.sources))


class LightTable(Table):
    """``[[light]]``: a name, a spectrum in `volspec.light`'s notation, and what it shines from.

    ``illuminance_lux`` sets the eye's adapting luminance; ``weight`` multiplies it, which
    shows at ``level = "absolute"``, and is a row's share among those of one setting. In its
    place a lamp's may be counted, from the watts that it takes and how far away it is.
    """

    row_keys = ("name", "group")
    name: Annotated[Name, Field(examples=["day"])]
    """Names the frame's file; rows of one name and different groups are one setting."""
    label: str | None = None
    """Caption; left out, the name."""
    spectrum: Annotated[Given, Field(examples=["D65"])]
    """D65, planck:3200, FILE.csv, a mix D65*0.7+A*0.3, …, or a table of numbers."""
    group: Name | None = None
    """The group it shines from; left out, all of them."""
    weight: NotNegative = 1.0
    """Times its power."""
    illuminance_lux: NotNegative | None = None
    """What it gives a surface that faces every source; sets the eye's adaptation."""
    power_W: float | None = None
    """In its place, of lamp:NAME: what the lamp takes."""
    distance_m: float | None = None
    """With power_W: how far away it is."""
    beam_deg: float | None = None
    """With both: full angle of the cone it shines into; left out, all around."""

    @model_validator(mode="after")
    def _one_measure(self) -> LightTable:
        counted = [key for key in _COUNTED if getattr(self, key) is not None]
        if not counted:
            return self
        if self.illuminance_lux is not None:
            raise ValueError(
                f"illuminance_lux and {' and '.join(counted)} both say how bright it is; give one"
            )
        if missing := [key for key in _COUNTED[:2] if key not in counted]:
            raise ValueError(
                f"{' and '.join(counted)} without {' and '.join(missing)}; a lamp's lux are "
                "counted from power_W and distance_m"
            )
        if not isinstance(self.spectrum, str):
            raise ValueError(
                'power_W is for lamps by name, as spectrum = "lamp:tungsten-2850", not for '
                "numbers; give illuminance_lux"
            )
        return self

    @property
    def has_lux(self) -> bool:
        """Whether it says how bright the light is."""
        return self.illuminance_lux is not None or self.power_W is not None

    def lux(self) -> float | None:
        """Its illuminance as given or as counted; None where neither is.

        Raises
        ------
        SpectrumError
            If it is to be counted, and the spectrum is no lamp, has no known lumens per watt,
            or a number is out of range.
        """
        if self.power_W is None or self.distance_m is None or not isinstance(self.spectrum, str):
            return self.illuminance_lux
        source = lamp_for_light(self.spectrum)
        return lamp_illuminance_lux(source, self.power_W, self.distance_m, self.beam_deg)


@dataclass(frozen=True, slots=True, eq=False)
class NamedLight:
    """A light setting of a scene.

    Parameters
    ----------
    name : str
        What its files are called.
    label : str
        Caption.
    spectrum : Spectrum
        What a surface that faces every source gets.
    rig : LightRig
        What lights the picture.
    """

    name: str
    label: str
    spectrum: Spectrum
    rig: LightRig


def rows_by_name(rows: Sequence[LightTable]) -> dict[str, list[LightTable]]:
    """The rows of each setting, in the order of the file."""
    settings: dict[str, list[LightTable]] = {}
    for row in rows:
        settings.setdefault(row.name, []).append(row)
    return settings


def named_light(
    rows: Sequence[LightTable],
    shares: Mapping[str, float],
    grid: SpectralGrid,
    folder: str | os.PathLike[str],
    known: Mapping[str, Spectrum] = MappingProxyType({}),
) -> NamedLight:
    """The setting that rows of one name make.

    Parameters
    ----------
    rows : sequence of LightTable
        Either all with lux or none.
    shares : {group: float}
        Each group's share of the light (`RaycastSpec.shares`).
    grid : SpectralGrid
    folder : path
        What the names of files start from.
    known : {text: Spectrum}
        Spectra that are no file yet, on the grid.

    Raises
    ------
    SpectrumError, ViewingError
        If a spectrum is unknown, a lamp's light cannot be counted, or the rows give no light.
    """
    spectra = tuple(given_light(row.spectrum, row.name, grid, Path(folder), known) for row in rows)
    lux = tuple(lux for row in rows if (lux := row.lux()) is not None)
    weights, groups = tuple(row.weight for row in rows), tuple(row.group or "" for row in rows)
    rig = LightRig(spectra, weights, lux or None, groups)
    label = next((row.label for row in rows if row.label), rows[0].name)
    facing = rig.facing(shares)  # refuses a setting that gives no light, before the cast
    shown = spectra[0] if len(rows) == 1 else facing.mixed(grid)
    return NamedLight(rows[0].name, label, shown, rig)
