"""Response of a room to its lights: what stays if their spectra change.

RoomLight -> [response] -> irradiance under any spectra, with any paints

Light is linear, and bands are independent: under spectra S_l the irradiance of patch i is
Σ_l R_li S_l, band by band, where R_li is its irradiance if light l alone shines with 1 in each
band. New spectra are a product; new paints are a solution of the patches (`painted`), or one of
whole surfaces (`estimated`), in closed form as the cube and the brick [1].

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity",
    section 4.3.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.errors import RoomError, nearest
from volspec.room.direct_light import SHADOW_RAYS
from volspec.room.mesh import RoomMesh
from volspec.room.model import Room
from volspec.room.quantities import lux_from_irradiance
from volspec.room.radiosity import RoomLight, direct_on_patches, solve_irradiance
from volspec.spectra import Spectrum, light, light_power

Array = NDArray[np.float64]
# Factor by which an estimate scales reflected light, at most: from black, it is spread evenly.
_MAX_SCALED = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class RoomResponse:
    """Irradiance of N patches by each of L lights alone, per unit of its spectrum.

    Attributes
    ----------
    solved : RoomLight
        The room under its own lights.
    direct : (L, N) array
        What comes from a light without any reflection; the same in all bands.
    irradiance : (L, N, B) array
        All light, after all reflections.
    surface_factors : (S, S) array
        Form factors of whole surfaces.
    """

    solved: RoomLight
    direct: Array
    irradiance: Array
    surface_factors: Array

    @classmethod
    def of(cls, solved: RoomLight, shadow_rays: int = SHADOW_RAYS) -> RoomResponse:
        """Solve a room for each of its lights, with the form factors of its solution."""
        direct = []
        for name in solved.room.lights:
            alone = solved.room.alone(name)
            direct.append(direct_on_patches(alone, solved.rays, solved.mesh, shadow_rays)[0][:, 0])
        mesh = solved.mesh
        belongs = np.zeros((len(mesh.surface), len(mesh.names)))
        belongs[np.arange(len(belongs)), mesh.surface] = 1.0
        between = _surface_means(mesh, solved.factors.factors @ belongs)
        return _solve_response(solved, np.array(direct), between)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the L lights."""
        return tuple(self.solved.room.lights)

    def spectra(self, lights: Mapping[str, Spectrum], weight: float = 1.0) -> Array:
        """Return (L, B) spectra of lights, as bright as the room's own; of others, 0.

        Raises RoomError if the room has no light of a name.
        """
        grid, own_lights = self.solved.room.grid, self.solved.room.lights
        spectra = np.zeros((len(own_lights), grid.size))
        for name, spectrum in lights.items():
            if name not in own_lights:
                raise unknown_light(name, own_lights)
            power = light_power(spectrum, grid)
            lux = lux_from_irradiance(np.array([own_lights[name], power]), grid)
            spectra[self.names.index(name)] = power * (weight * lux[0] / lux[1])
        return spectra

    def under(self, spectra: ArrayLike) -> RoomLight:
        """Return the light of the room under other spectra (L, B) of its lights.

        Raises RoomError if all of them are dark.
        """
        power = np.asarray(spectra, np.float64)
        return replace(
            self.solved,
            room=self.solved.room.with_lights(dict(zip(self.names, power, strict=True))),
            direct=self.direct.T @ power,
            irradiance=np.einsum("lnb,lb->nb", self.irradiance, power),
        )

    def painted(self, paints: Mapping[str, Spectrum | ArrayLike]) -> RoomResponse:
        """Return the response with other reflectances (B,) of some surfaces.

        Raises RoomError as `Room` does.
        """
        room = self.solved.room.painted(paints)
        return _solve_response(replace(self.solved, room=room), self.direct, self.surface_factors)

    def estimated(self, paints: Mapping[str, Spectrum | ArrayLike]) -> RoomResponse:
        """Return `painted` in closed form, at the speed of a slider.

        Reflected light is scaled, surface by surface, as in a room whose surfaces each have one
        irradiance, up to fourfold; what exceeds that is spread evenly. Exact for the present
        paints, and near them. Raises RoomError as `Room` does.
        """
        room = self.solved.room.painted(paints)
        both = self.solved.room.reflectances, room.reflectances
        before, after = (self._reflected(rho) for rho in both)
        factor = np.clip(after / np.maximum(before, 1e-30), 0.0, _MAX_SCALED)
        remainder, surface = np.maximum(after - factor * before, 0.0), self.solved.mesh.surface
        direct = self.direct[:, :, None]
        indirect = (self.irradiance - direct) * factor[:, surface] + remainder[:, surface]
        solved = replace(self.solved, room=room)
        return _under_own_lights(solved, self.direct, direct + indirect, self.surface_factors)

    def _reflected(self, reflectances: Array) -> Array:
        """Return (L, S, B) reflected light on whole surfaces, F ρ E."""
        direct = _surface_means(self.solved.mesh, self.direct.T).T  # (L, S)
        factors = self.surface_factors
        system = np.eye(len(factors)) - factors * reflectances.T[:, None, :]  # (B, S, S)
        total = np.linalg.solve(system, np.broadcast_to(direct.T, (len(system), *direct.T.shape)))
        return total.transpose(2, 1, 0) - direct[:, :, None]


def lamp_powers(room: Room, lamps: Sequence[str]) -> dict[str, Array]:
    """Return spectra (L, B) of a room's lights under each of some lamps, as bright as its own.

    A lamp is a spectrum of all lights, such as ``A``; ``LIGHT=SPECTRUM`` is one light alone. The
    spectrum ``room`` is the light's own. Raises RoomError if there is no such light, SpectrumError
    if a spectrum is unknown.
    """
    powers = {}
    for lamp in lamps:
        name, alone, text = lamp.rpartition("=")
        if alone and name not in room.lights:
            raise unknown_light(name, room.lights)
        power = np.array([E * (not alone or n == name) for n, E in room.lights.items()])
        if text != "room":
            shape = light_power(light(text, room.grid), room.grid)
            lux = lux_from_irradiance(power, room.grid) / lux_from_irradiance(shape, room.grid)
            power = lux[:, None] * shape
        powers[lamp] = power
    return powers


def _surface_means(mesh: RoomMesh, values: Array) -> Array:
    """Return means (S, K) by area of the patches' values (N, K)."""
    totals = np.maximum(mesh.surface_areas.sum(axis=1), 1e-30)
    return np.asarray(mesh.surface_areas @ values / totals[:, None])


def unknown_light(name: str, names: Collection[str]) -> RoomError:
    """Return the error about a light that a room does not have."""
    return RoomError(
        f"no light of the room is named {name!r}",
        f"{nearest(name, names)}there is {', '.join(names)}",
        code="unknown",
    )


def _solve_response(solved: RoomLight, direct: Array, surface_factors: Array) -> RoomResponse:
    """Return the response of a room whose direct light (L, N) is known."""
    bands, count = solved.room.grid.size, len(direct)
    irradiance = solve_irradiance(
        solved.factors.factors,
        solved.mesh.areas_m2,
        np.tile(solved.reflectances, count),
        np.repeat(direct.T, bands, axis=1),
    )
    shaped = irradiance.reshape(-1, count, bands).transpose(1, 0, 2)
    return _under_own_lights(solved, direct, shaped, surface_factors)


def _under_own_lights(
    solved: RoomLight, direct: Array, irradiance: Array, surface_factors: Array
) -> RoomResponse:
    """Return a response whose room is under its own lights."""
    response = RoomResponse(solved, direct, irradiance, surface_factors)
    return replace(response, solved=response.under([*solved.room.lights.values()]))
