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
at best, until no other can be among the best. Over several lamps, the worst distance and the mean
are bounded alike. A white surface's light is another such sum.

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import _lru_cache_wrapper, cache, partial
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.models import Appearance
from volspec.errors import RoomError, SpectrumError, nearest
from volspec.room.eye import chromaticity, surface_eye, white_weights
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
    chosen_xy: tuple[float, float]
    seen_xy: tuple[float, float]


Ranked = TypeVar("Ranked")


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


@dataclass(frozen=True, slots=True, eq=False)
class LampPaint:
    """A paint under several lamps."""

    name: str
    worst: float  # distance from the wanted appearance under the lamp where it is largest
    mean: float
    by_lamp: dict[str, RankedPaint]


@dataclass(frozen=True, slots=True, eq=False)
class LampRanking:
    """The best paints under each lamp, and over all lamps by their worst and mean distance."""

    by_lamp: dict[str, PaintRanking]
    by_worst: tuple[LampPaint, ...]
    by_mean: tuple[LampPaint, ...]


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
    white: str | None = None,
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
    white : str, optional
        A surface that the eye takes for white, as seen from before the painted ones; by default a
        perfect diffuser on them.

    Raises
    ------
    RoomError
        If there is no paint, one reflects 1 or more, the surface is unknown, its parts have several
        paints and nothing is ``wanted``, or the white is unknown or painted.
    """
    ranking = rank_paints_by_lamp({"": light}, paints, surface, wanted, top, progress, white)
    return ranking.by_lamp[""]


def rank_paints_by_lamp(
    lights: Mapping[str, RoomLight],
    paints: Sequence[Spectrum],
    surface: str = "walls",
    wanted: Appearance | None = None,
    top: int = 10,
    progress: Progress = no_progress,
    white: str | None = None,
) -> LampRanking:
    """Return the best paints under each of several lamps, and over all of them.

    ``lights`` are the same room by lamp (`RoomResponse.under`). All else, and errors, are as in
    `rank_paints`; the paints over all lamps are exact in the same way.
    """
    first = next(iter(lights.values()))
    room, grid = first.room, first.room.grid
    surfaces = painted_surfaces(room, surface)
    wanted = present_appearance(room, surface) if wanted is None else wanted
    if not paints:
        raise RoomError("no paints", "give one or more", code="missing", field="paints")
    if top < 1:
        raise RoomError.refused("top", top, "give 1 or more", "range")
    if white in surfaces:
        raise RoomError.refused("white", white, "give a surface that is not painted", "conflict")
    rho = require_reflectance(list(paints), [paint.name for paint in paints], grid)
    mesh = first.mesh
    area = mesh.areas_m2 * np.isin(mesh.surface, [mesh.names.index(name) for name in surfaces])
    weights, white_paint = [area / area.sum()], None
    if white is not None:
        white_paint, eyes = room.reflectance(white), [surface_eye(first, n) for n in surfaces]
        weights.append(white_weights(first, eyes, white)[0])

    def irradiance(light: RoomLight, paint: Array) -> Array:
        """On the painted surfaces and on the white, (1, B) or (2, B)."""
        return np.array(weights) @ light.painted(dict.fromkeys(surfaces, paint)).irradiance

    lamps = {
        name: _bound_paints(
            paints, rho, partial(irradiance, light), wanted, white_paint, grid, progress
        )
        for name, light in lights.items()
    }

    def under_all(i: int) -> LampPaint:
        by_lamp = {name: lamp.solve(i) for name, lamp in lamps.items()}
        distances = [paint.distance for paint in by_lamp.values()]
        return LampPaint(paints[i].name, max(distances), float(np.mean(distances)), by_lamp)

    lowest = np.array([lamp.lowest for lamp in lamps.values()])
    best = {
        name: _best(lamp.lowest, lamp.solve, lambda paint: paint.distance, top, progress)
        for name, lamp in lamps.items()
    }
    by_worst = _best(lowest.max(axis=0), under_all, lambda paint: paint.worst, top, progress)
    by_mean = _best(lowest.mean(axis=0), under_all, lambda paint: paint.mean, top, progress)
    by_lamp = {}
    for name, lamp in lamps.items():
        solved = lamp.solve.cache_info().currsize
        counts = len(rho), solved, lamp.greys, lamp.bound
        by_lamp[name] = PaintRanking(best[name], wanted, surfaces, *counts)
    return LampRanking(by_lamp, by_worst, by_mean)


def _best(
    lowest: Array,
    solve: Callable[[int], Ranked],
    distance: Callable[[Ranked], float],
    top: int,
    progress: Progress,
) -> tuple[Ranked, ...]:
    """Return the ``top`` paints by distance; ``lowest`` (N,) is what they can reach at best."""
    exact: dict[int, Ranked] = {}
    for i in np.argsort(lowest, kind="stable").tolist():
        if len(exact) >= top and lowest[i] > sorted(map(distance, exact.values()))[top - 1]:
            break
        progress("best paints", min(len(exact) / top, 0.99))
        exact[i] = solve(i)
    progress("best paints", 1.0)
    return tuple(exact[i] for i in sorted(exact, key=lambda k: (distance(exact[k]), k))[:top])


class _BoundPaints(NamedTuple):
    """N paints under one light."""

    lowest: Array  # (N,) distances that they have at least
    bound: float  # the largest
    greys: int
    solve: _lru_cache_wrapper[RankedPaint]  # by the paint's number


def _bound_paints(
    paints: Sequence[Spectrum],
    rho: Array,
    irradiance: Callable[[Array], Array],
    target: Appearance,
    white: Array | None,
    grid: SpectralGrid,
    progress: Progress,
) -> _BoundPaints:
    """Return the least distances of paints (N, B) under one light, from those of greys."""
    greys = _greys(rho)
    solutions = []
    for number, grey in enumerate(greys):
        progress("light of greys", number / len(greys))
        solutions.append(irradiance(np.full(grid.size, grey)))
    progress("light of greys", 1.0)
    rows, flat = len(solutions[0]), np.array(solutions).reshape(len(greys), -1)
    E, error = interpolated_irradiance(greys, flat, np.tile(rho, (1, rows)))
    lowest, bounds = np.zeros(len(rho)), np.zeros(len(rho))
    for i, paint in enumerate(rho):
        progress("paints", i / len(rho))
        E_i = E[i].reshape(rows, -1).squeeze()
        appearance = wall_appearance(paint, E_i, grid, white=white)
        slopes = np.linalg.norm(irradiance_slopes(paint, E_i, grid, white), axis=0)
        bounds[i] = _CURVATURE * float(slopes @ error[i]) + _ROUNDING
        lowest[i] = float(appearance_distance(appearance, target)) - bounds[i]
    progress("paints", 1.0)

    @cache
    def solve(i: int) -> RankedPaint:
        E_i = irradiance(rho[i])
        appearance = wall_appearance(rho[i], E_i.squeeze(), grid, white=white)
        distance, name = float(appearance_distance(appearance, target)), paints[i].name
        atlas_look = atlas_appearance(Spectrum(grid.wavelengths_nm, rho[i]), grid)
        lux = float(lux_from_irradiance(E_i[0], grid))
        xy = chromaticity(rho[i], grid), chromaticity(rho[i], grid, E_i[0])
        return RankedPaint(name, distance, appearance, atlas_look, lux, paints[i], *xy)

    return _BoundPaints(lowest, float(bounds.max()), len(greys), solve)


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
