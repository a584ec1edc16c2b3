"""A room of triangles: surfaces, lights, and an eye.

mesh, spectra -> [model] -> direct light, radiosity

Spectra are as in `quantities`: reflectances are band means, light is W/m² per band.
"""

from __future__ import annotations

from collections.abc import Mapping
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


@dataclass(frozen=True, slots=True, eq=False)
class SunBeam:
    """Parallel light that enters through surfaces, such as windows, or where there is none."""

    direction: tuple[float, float, float]  # unit vector towards the sun
    irradiance: Array  # (B,) W/m² per band, across the beam
    through: frozenset[int] = frozenset()  # indices of surfaces that let it in


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
        If a surface reflects 1 or more in a band or is unknown, emits less than 0, or no light
        is given.
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
    def emission(self) -> Array:
        """(S, B) exitances of all surfaces, W/m² per band."""
        dark = np.zeros(self.grid.size)
        return np.array([self.exitances.get(name, dark) for name in self.mesh.names])
