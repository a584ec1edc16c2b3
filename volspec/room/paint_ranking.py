"""Rank paints by how they will look in a room.

RoomLight, paints -> [paint_ranking] -> paints in the order of their distance from what is wanted

A surface's appearance is `wall_appearance`'s [1, section 4.4]: the white and the level are those of
the mean light E on the surface, and it is its own background. Bands are independent, so that E in a
band is a function of the paint's reflectance r in this band alone, a sum over reflections

    E(r) = Σ c_k r^k,   c_k ≥ 0

whose every derivative is 0 or more. It is solved for a few greys r_0 < … < r_n, and interpolated
for all paints. Then E is between the polynomial through all greys and that without the last one, as
their errors, divided differences times Π(r - r_i), have opposite signs. This bounds how far each
paint's distance can be from its estimate, and paints are solved in the order of what they can reach
at best, until no other can be among the best.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import Appearance
from volspec.errors import RoomError, SpectrumError, nearest
from volspec.room.file import WALLS
from volspec.room.model import Room
from volspec.room.quantities import lux_from_irradiance, require_reflectance
from volspec.room.radiosity import Progress, RoomLight, no_progress
from volspec.room.wall_paint import (
    appearance_distance,
    atlas_appearance,
    irradiance_slopes,
    wall_appearance,
)
from volspec.spectra import DEFAULT_GRID, SpectralGrid, Spectrum, reflectance, reflectance_names
from volspec.spectra.files import fold_name, split_address

Array = NDArray[np.float64]
# Greys for which the room is solved.
_GREYS = 8
# The appearance's derivatives hold at the estimate: bounds by them are taken so many times.
_CURVATURE = 2.0
# Distances below this are the solver's rounding.
_ROUNDING = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class RankedPaint:
    """A paint, and its look in the room."""

    name: str
    distance: float  # from the wanted appearance in J, a_C, b_C
    seen: Appearance  # in the room
    chosen: Appearance  # its own in an atlas
    lux: float  # on the painted surfaces, mean
    reflectance: Spectrum


@dataclass(frozen=True, slots=True, eq=False)
class PaintRanking:
    """The best of some paints, and how many were compared."""

    best: tuple[RankedPaint, ...]  # by distance
    wanted: Appearance
    surfaces: tuple[str, ...]  # that were painted
    candidates: int
    solved: int  # candidates for which the room was solved
    greys: int  # solutions besides
    bound: float  # largest difference of a distance from its estimate that was allowed for


def painted_surfaces(room: Room, name: str) -> tuple[str, ...]:
    """Return the surfaces that one name means: itself, or ``walls``, left, right, front and back.

    Raises RoomError if there is none, or it gives light.
    """
    names = room.mesh.names
    surfaces: tuple[str, ...] = (name,) if name in names else ()
    if name == "walls" and not surfaces:
        surfaces = tuple(other for other in WALLS if other in names and other not in room.exitances)
    paintable = [other for other in names if other not in room.exitances]
    if all(other in paintable for other in WALLS):
        paintable.insert(0, "walls")
    remedy = f"give {', '.join(paintable)}"
    if not surfaces:
        raise RoomError(
            f"no surface is named {name!r}",
            nearest(name, paintable) + remedy,
            code="unknown",
            field="surface",
            given=name,
        )
    if name in room.exitances:
        raise RoomError(
            f"{name!r} gives light, and has no paint", remedy, code="conflict", field="surface"
        )
    return surfaces


def wanted_appearance(colour: str, grid: SpectralGrid = DEFAULT_GRID) -> Appearance:
    """Return the appearance in an atlas of a colour or of a reflectance, by name.

    ``colour`` is ``#rrggbb``, a name of CSS Color 3, X Y Z, or a reflectance as of a scene's
    material. Raises SpectrumError if it is none of them.
    """
    named = fold_name(colour) in map(fold_name, reflectance_names())
    if named or split_address(colour) or any(mark in colour for mark in "/:*"):
        return atlas_appearance(reflectance(colour, grid), grid)
    try:
        return atlas_appearance(colour, grid)
    except SpectrumError as error:
        raise error.at("wanted") from None


def present_appearance(room: Room, surface: str) -> Appearance:
    """Return the appearance in an atlas of the paint that a surface has now.

    ``surface`` is as in `painted_surfaces`. Raises RoomError if its parts have several paints.
    """
    paints = np.array([room.reflectance(name) for name in painted_surfaces(room, surface)])
    if (paints != paints[0]).any():
        raise RoomError(
            f"{surface} have several paints",
            "give the colour that is wanted",
            code="missing",
            field="wanted",
        )
    return atlas_appearance(Spectrum(room.grid.wavelengths_nm, paints[0]), room.grid)


def rank_paints(
    light: RoomLight,
    paints: Sequence[Spectrum],
    surface: str = "walls",
    wanted: Appearance | None = None,
    top: int = 10,
    progress: Progress = no_progress,
) -> PaintRanking:
    """Return the paints with which a surface of a room looks most as wanted.

    The first ``top`` are those of a ranking that solves the room with every paint, in the same
    order. Their light is solved; for others, bounds show that they are worse. Bounds of the light
    are proven, and taken twice where the appearance is linearised.

    Parameters
    ----------
    light : RoomLight
        The room; direct light and form factors stay.
    paints : sequence of Spectrum
        Reflectances below 1.
    surface : str
        As in `painted_surfaces`.
    wanted : Appearance, optional
        By default, that of the surface's present paint in an atlas.
    top : int
        Number of paints to return.

    Raises
    ------
    RoomError
        If there is no paint, one reflects 1 or more, the surface is unknown, or its parts have
        several paints and nothing is ``wanted``.
    """
    room, grid = light.room, light.room.grid
    surfaces = painted_surfaces(room, surface)
    wanted = present_appearance(room, surface) if wanted is None else wanted
    if not paints:
        raise RoomError("no paints", "give one or more", code="missing", field="paints")
    if top < 1:
        raise RoomError.refused("top", top, "give 1 or more", "range")
    rho = require_reflectance(list(paints), [paint.name for paint in paints], grid)

    def irradiance(paint: Array) -> Array:
        painted = light.painted(dict.fromkeys(surfaces, paint))
        return painted.mean_irradiance(*surfaces)

    greys = _greys(rho)
    solutions = []
    for number, grey in enumerate(greys):
        progress("light of greys", number / len(greys))
        solutions.append(irradiance(np.full(grid.size, grey)))
    progress("light of greys", 1.0)
    E, error = interpolated_irradiance(greys, np.array(solutions), rho)
    lowest, bounds = np.zeros(len(rho)), np.zeros(len(rho))
    for i, paint in enumerate(rho):
        progress("paints", i / len(rho))
        estimate = float(appearance_distance(wall_appearance(paint, E[i], grid), wanted))
        slopes = np.linalg.norm(irradiance_slopes(paint, E[i], grid), axis=0)
        bounds[i] = _CURVATURE * float(slopes @ error[i]) + _ROUNDING
        lowest[i] = estimate - bounds[i]
    progress("paints", 1.0)
    exact: dict[int, tuple[float, Array, Appearance]] = {}
    for i in np.argsort(lowest, kind="stable").tolist():
        distances = sorted(distance for distance, _, _ in exact.values())
        if len(exact) >= top and lowest[i] > distances[top - 1]:
            break
        progress("best paints", min(len(exact) / top, 0.99))
        E_i = irradiance(rho[i])
        appearance = wall_appearance(rho[i], E_i, grid)
        exact[i] = float(appearance_distance(appearance, wanted)), E_i, appearance
    progress("best paints", 1.0)
    best = []
    for i in sorted(exact, key=lambda k: (exact[k][0], k))[:top]:
        distance, E_i, appearance = exact[i]
        atlas_look = atlas_appearance(Spectrum(grid.wavelengths_nm, rho[i]), grid)
        lux = float(lux_from_irradiance(E_i, grid))
        best.append(RankedPaint(paints[i].name, distance, appearance, atlas_look, lux, paints[i]))
    return PaintRanking(
        tuple(best), wanted, surfaces, len(rho), len(exact), len(greys), float(bounds.max())
    )


def _greys(reflectances: Array) -> Array:
    """Return the reflectances for which the room is solved: extrema of a Chebyshev polynomial."""
    low, high = float(reflectances.min()), float(reflectances.max())
    if low == high:
        return np.array([low])
    points = 0.5 - 0.5 * np.cos(np.pi * np.arange(_GREYS) / (_GREYS - 1))
    return low + (high - low) * points


def interpolated_irradiance(greys: Array, solutions: Array, paints: Array) -> tuple[Array, Array]:
    """Return the irradiance (N, B) of paints (N, B), and bounds of its error.

    ``solutions`` (G, B) are the irradiances of ``greys`` (G,), in increasing order. By Newton's
    divided differences; the last term is the difference from the polynomial without the last grey.
    """
    differences = np.array(solutions, np.float64)
    for k in range(1, len(greys)):
        span = greys[k:] - greys[:-k]
        differences[k:] = np.diff(differences[k - 1 :], axis=0) / span[:, None]
    estimate, product = np.broadcast_to(differences[0], paints.shape).copy(), np.ones(paints.shape)
    term = np.zeros(paints.shape)
    for grey, difference in zip(greys[:-1], differences[1:], strict=True):
        product = product * (paints - grey)
        term = difference * product
        estimate += term
    return estimate, np.abs(term)
