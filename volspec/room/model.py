"""A room of triangles: surfaces, lights, and an eye.

mesh, spectra -> [model] -> direct light, radiosity

Spectra are as in `quantities`: reflectances are band means, light is W/m² per band.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from volspec.errors import RoomError
from volspec.room.mesh import RoomMesh
from volspec.room.quantities import require_emission, require_reflectance
from volspec.settings import Unit, Vector, settings
from volspec.spectra.grid import DEFAULT_GRID, SpectralGrid
from volspec.spectra.spectrum import Spectrum, stack

Array = NDArray[np.float64]
Metres = Annotated[Vector, Unit("m")]


@dataclass(frozen=True, slots=True, eq=False)
class PointLamp:
    """Small lamp that shines alike in all directions."""

    position_m: tuple[float, float, float]
    intensity: Array  # (B,) W/sr per band
    name: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class SunBeam:
    """Parallel light that enters through surfaces, such as windows, or where there is none."""

    direction: tuple[float, float, float]  # unit vector towards the sun
    irradiance: Array  # (B,) W/m² per band, across the beam
    through: frozenset[int] = frozenset()  # indices of surfaces that let it in
    name: str = ""


@settings(RoomError)
@dataclass(frozen=True, slots=True, kw_only=True)
class Eye:
    """``[eye]``: a place to see the room from."""

    position_m: Metres
    """Place of the eye."""
    target_m: Metres
    """Point that it looks at; the white of its conditions is there."""
    fov_deg: Annotated[float, Field(gt=0, lt=180), Unit("degrees")] = 60.0
    """The picture's height."""

    def __post_init__(self) -> None:
        if self.position_m == self.target_m:
            raise RoomError.refused("target_m", self.target_m, "give another point than position_m")


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """A room: its surfaces, what they reflect and emit, its lamps and the sun.

    Parameters
    ----------
    mesh : RoomMesh
        Triangles with their fronts inside.
    reflectances : (S, B) array
        Of each of the mesh's surfaces.
    exitances : mapping of str to (B,) array
        Diffuse light that leaves each square metre of a surface, W/m² per band.
    lamps : tuple of PointLamp
    suns : tuple of SunBeam
    eye : Eye or None
        Place to see the room from.
    grid : SpectralGrid
        B bands.
    open : bool
        Light may leave the room through gaps.
    title : str

    Raises
    ------
    RoomError
        If a surface reflects 1 or more in a band or is unknown, emits less than 0, no light is
        given, or two lights have one name.
    """

    mesh: RoomMesh
    reflectances: Array
    exitances: Mapping[str, Array] = field(default_factory=dict)
    lamps: tuple[PointLamp, ...] = ()
    suns: tuple[SunBeam, ...] = ()
    eye: Eye | None = None
    grid: SpectralGrid = DEFAULT_GRID
    open: bool = False
    title: str = ""

    def __post_init__(self) -> None:
        names = self.mesh.names
        found = require_reflectance(self.reflectances, names, self.grid)
        object.__setattr__(self, "reflectances", found)
        for name in self.exitances:
            self.reflectance(name)  # refuses unknown names
        if self.exitances:
            require_emission(list(self.exitances.values()), list(self.exitances), self.grid)
        if not (self.exitances or self.lamps or self.suns):
            remedy = "give a surface that emits, a lamp or the sun"
            raise RoomError("the room has no light", remedy, code="missing")
        named = (*self.exitances, *_named("lamp", self.lamps), *_named("sun", self.suns))
        if twice := next((name for name in named if named.count(name) > 1), None):
            raise RoomError(f"two lights are named {twice!r}", "rename one", code="duplicate")

    def reflectance(self, name: str) -> Array:
        """(B,) reflectance of a surface; raises RoomError if there is none of that name."""
        if name not in self.mesh.names:
            remedy = f"there is {', '.join(self.mesh.names)}"
            raise RoomError(f"no surface is named {name!r}", remedy, code="unknown")
        return self.reflectances[self.mesh.names.index(name)]

    def painted(self, paints: Mapping[str, Spectrum | ArrayLike]) -> Room:
        """Return the room with other reflectances (B,) of some of its surfaces."""
        found = self.reflectances.copy()
        for name, paint in paints.items():
            self.reflectance(name)  # refuses unknown names
            found[self.mesh.names.index(name)] = stack(paint, self.grid)
        return replace(self, reflectances=found)

    @property
    def lights(self) -> dict[str, Array]:
        """Spectra (B,) of all lights by name, in the units of their kinds, per band.

        Panels are named as their surfaces; lamps and suns without a name are numbered.
        """
        lamps = zip(_named("lamp", self.lamps), self.lamps, strict=True)
        suns = zip(_named("sun", self.suns), self.suns, strict=True)
        return {
            **self.exitances,
            **{name: lamp.intensity for name, lamp in lamps},
            **{name: sun.irradiance for name, sun in suns},
        }

    def with_lights(self, spectra: Mapping[str, Array]) -> Room:
        """Return the room in which only the given lights shine, with these spectra (B,)."""
        lamps = zip(_named("lamp", self.lamps), self.lamps, strict=True)
        suns = zip(_named("sun", self.suns), self.suns, strict=True)
        return replace(
            self,
            exitances={name: spectra[name] for name in self.exitances if name in spectra},
            lamps=tuple(replace(e, intensity=spectra[n]) for n, e in lamps if n in spectra),
            suns=tuple(replace(e, irradiance=spectra[n]) for n, e in suns if n in spectra),
        )

    @property
    def emission(self) -> Array:
        """(S, B) exitances of all surfaces, W/m² per band."""
        dark = np.zeros(self.grid.size)
        return np.array([self.exitances.get(name, dark) for name in self.mesh.names])


def _named(kind: str, lights: Sequence[PointLamp | SunBeam]) -> tuple[str, ...]:
    """Return the names of lamps or suns; those without one are numbered."""
    return tuple(each.name or f"{kind} {number}" for number, each in enumerate(lights, 1))
