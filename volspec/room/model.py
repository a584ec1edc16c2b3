"""A room of triangles: surfaces, lights, and an eye.

mesh, spectra -> [model] -> direct light, radiosity

Spectra are as in `quantities`: reflectances are band means, light is W/m² per band.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from volspec.errors import RoomError
from volspec.room.beam import Beam
from volspec.room.mesh import RoomMesh
from volspec.room.quantities import require_emission, require_reflectance
from volspec.settings import Unit, Vector, settings
from volspec.spectra import DEFAULT_GRID, SpectralGrid, Spectrum, require_no_emission, stack

Array = NDArray[np.float64]
Light = TypeVar("Light", "PointLamp", "SunBeam")
# The smallest grid.
_TWO_BANDS = SpectralGrid(500.0, 510.0, 10.0)
Metres = Annotated[Vector, Unit("m")]


@dataclass(frozen=True, slots=True, eq=False)
class PointLamp:
    """Small lamp that shines alike in all directions, or as a luminaire's file has it."""

    position_m: tuple[float, float, float]
    intensity: Array  # (B,) W/sr per band, the mean over all directions
    name: str = ""
    beam: Beam | None = None


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
        rho = require_reflectance(self.reflectances, names, self.grid)
        object.__setattr__(self, "reflectances", rho)
        for name in self.exitances:
            self.reflectance(name)  # refuses unknown names
        emitting = {name: exitance for name, exitance in self.exitances.items() if np.any(exitance)}
        if emitting:
            require_emission(list(emitting.values()), list(emitting), self.grid)
        powers = (*(lamp.intensity for lamp in self.lamps), *(sun.irradiance for sun in self.suns))
        if not emitting and not any(map(np.any, powers)):
            remedy = "give a surface that emits, a lamp or the sun"
            raise RoomError("the room has no light", remedy, code="missing")
        object.__setattr__(self, "lamps", _name_lights("lamp", self.lamps))
        object.__setattr__(self, "suns", _name_lights("sun", self.suns))
        named = [*self.exitances, *(lamp.name for lamp in self.lamps)]
        named += [sun.name for sun in self.suns]
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
        reflectances = self.reflectances.copy()
        for name, paint in paints.items():
            self.reflectance(name)  # refuses unknown names
            require_no_emission(paint, f"paint of {name}")
            reflectances[self.mesh.names.index(name)] = stack(paint, self.grid)
        return replace(self, reflectances=reflectances)

    @property
    def lights(self) -> dict[str, Array]:
        """Spectra (B,) of all lights by name, in the units of their kinds, per band.

        Panels are named as their surfaces; lamps and suns without a name are numbered.
        """
        return {
            **self.exitances,
            **{lamp.name: lamp.intensity for lamp in self.lamps},
            **{sun.name: sun.irradiance for sun in self.suns},
        }

    def with_lights(self, spectra: Mapping[str, Array]) -> Room:
        """Return the room in which only the given lights shine, with these spectra (B,).

        Raises RoomError if there are none.
        """
        lamps = (lamp for lamp in self.lamps if lamp.name in spectra)
        suns = (sun for sun in self.suns if sun.name in spectra)
        return replace(
            self,
            exitances={name: spectra[name] for name in self.exitances if name in spectra},
            lamps=tuple(replace(source, intensity=spectra[source.name]) for source in lamps),
            suns=tuple(replace(source, irradiance=spectra[source.name]) for source in suns),
        )

    def alone(self, name: str) -> Room:
        """Return the room with one of its lights, which has 1 in each of two bands.

        Direct light does not depend on paints, so that two bands are as good as all.
        """
        one = np.ones(_TWO_BANDS.size)
        lamps = (lamp for lamp in self.lamps if lamp.name == name)
        suns = (sun for sun in self.suns if sun.name == name)
        return replace(
            self,
            reflectances=self.reflectances[:, : _TWO_BANDS.size],
            exitances={name: one} if name in self.exitances else {},
            lamps=tuple(replace(source, intensity=one) for source in lamps),
            suns=tuple(replace(source, irradiance=one) for source in suns),
            grid=_TWO_BANDS,
        )

    @property
    def emission(self) -> Array:
        """(S, B) exitances of all surfaces, W/m² per band."""
        dark = np.zeros(self.grid.size)
        return np.array([self.exitances.get(name, dark) for name in self.mesh.names])


def _name_lights(kind: str, lights: Sequence[Light]) -> tuple[Light, ...]:
    """Return lamps or suns with names; those without one are numbered."""
    numbered = enumerate(lights, 1)
    return tuple(
        light if light.name else replace(light, name=f"{kind} {n}") for n, light in numbered
    )
