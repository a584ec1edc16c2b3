"""Viewing conditions, appearance of surfaces and pictures for an eye in a room.

RoomLight, eye -> [eye] -> Viewing, J C h, XYZ of pixels

    Y_b = mean Y over 1° to 11° around the line of sight           [1, eq. 1]
    L_A = mean luminance over 11° to 90°                           [1, section 2.4]
    S_R = L_A / L_Aw                                               [1, eq. 17]

The white has the colour of a perfect diffuser, or of a surface of the room, in the mean light on
the white surfaces in view [1, section 3.6, eq. 6 and 8], and L_Aw is its luminance there [1, eq.
9]. As in pictures (`relight.measured_viewing`), background and surround count alike, so that what
is near the line of sight counts most. Y = 100 is a perfect diffuser in the light on what the eye
looks at [1, section 4.4].

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
[2] Kelly & Judd (1976), "Color: Universal Language and Dictionary of Names", NBS SP 440.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from volspec._triangles import frames
from volspec.appearance import Viewing, forward_for, screen_for_viewing, view_transform
from volspec.appearance.models import Appearance, cielab
from volspec.errors import RoomError
from volspec.room.direct_light import direct_irradiance
from volspec.room.form_factors import Rays, sobol
from volspec.room.model import Eye, Room
from volspec.room.quantities import lux_from_irradiance
from volspec.room.radiosity import Progress, RoomLight, no_progress
from volspec.room.wall_paint import appearance_distance, atlas_appearance
from volspec.settings import Vector
from volspec.spectra import (
    SpectralGrid,
    Spectrum,
    XYZ_from_spectra,
    colour_matching_functions,
    light,
)

Array = NDArray[np.float64]
# Cones around the line of sight, degrees, and rays between two of them.
_CONES_DEG, _CONE_RAYS = ((1.0, 11.0), (11.0, 90.0)), 1 << 13
# Rays between two cones to the white surfaces: their light is within 0.1 % (test_eye).
_WHITE_RAYS = 1 << 16
# White is Munsell value 8.5 and more, chroma 1.5 and less [2]: about these in CIELAB under D65.
_WHITE_LIGHTNESS, _WHITE_CHROMA = 85.0, 7.0
# Where an eye is and looks if the room has none, as fractions of its extent.
_FRONT, _BACK = np.array([0.5, 0.06, 0.6]), np.array([0.5, 1.0, 0.45])
# A lamp counts as at most ten white diffusers, as in pictures (`relight.measured_viewing`).
_BRIGHTEST = 10.0
# An eye that is not placed is so far in front of a surface, in metres, or half way to the next.
_AWAY_M = 2.0
# Neighbouring patches between which indirect light is interpolated, and pixels at a time.
_NEIGHBOURS, _PIXELS = 12, 1 << 17


@dataclass(frozen=True, slots=True, eq=False)
class EyeConditions:
    """Conditions of an eye, and the white that it adapts to."""

    viewing: Viewing
    white_XYZ: Array  # (3,), Y = 100 for a perfect diffuser
    irradiance: Array  # (B,) W/m² per band on what it looks at
    surface: str  # what it looks at
    L_Aw: float  # luminance of the white, cd/m²
    note: str = ""  # what was taken if no white was in view

    def appearance(self, XYZ: ArrayLike) -> Appearance:
        """Return the appearance of colours, Y = 100 for a perfect diffuser."""
        conditions = self.viewing.conditions(self.white_XYZ)
        return forward_for(self.viewing)(XYZ, conditions)


def default_eye(room: Room) -> Eye:
    """Return the room's eye, or one near the front that looks at the middle of the back."""
    if room.eye is not None:
        return room.eye
    points = room.mesh.corners_m.reshape(-1, 3)
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    position, target = (tuple((low + fraction * size).tolist()) for fraction in (_FRONT, _BACK))
    return Eye(position_m=position, target_m=target)


def seen_triangle(rays: Rays, eye: Eye) -> int:
    """Return the triangle that an eye looks at; raise RoomError if it sees none, or a back."""
    mesh, position, forward = rays.mesh, np.array(eye.position_m), np.array(_forward(eye))
    hit = int(rays.first(position[None], forward[None])[0])
    if hit < 0 or mesh.normals[hit] @ forward > 0:
        place = ", ".join(f"{x:g}" for x in position)
        raise RoomError(
            f"the eye at ({place}) m sees no surface's front; the room is {mesh.extent}",
            "move its position_m",
            code="range",
            field="eye",
        )
    return hit


def look(
    solved: RoomLight,
    eye: Eye,
    viewing: Viewing | None = None,
    white: str | None = None,
) -> EyeConditions:
    """Measure the conditions of an eye.

    ``viewing`` gives the model and the display; ``white`` is a surface that counts as white, by
    default a perfect diffuser in the light on all `white_surfaces`. Raises RoomError if the eye
    sees nothing there, or a back.
    """
    hit = seen_triangle(solved.rays, eye)
    grid = solved.room.grid
    weights, note = white_weights(solved, [eye], white)
    on_white, irradiance = weights @ solved.irradiance, solved.irradiance[hit]
    lux = float(lux_from_irradiance(irradiance, grid))
    background, L_A = cone_luminances(solved, eye, lux)
    reflectance = np.ones(grid.size) if white is None else solved.room.reflectance(white)
    L_Aw = float(lux_from_irradiance(on_white * reflectance, grid)) / np.pi
    if not min(L_Aw, lux) > 0:
        raise RoomError(
            f"no light falls on {'the white' if lux > 0 else 'what the eye looks at'}",
            "give another surface as white" if lux > 0 else "move its target_m",
            code="impossible",
            field="eye",
        )
    shade = Spectrum(grid.wavelengths_nm, on_white)
    measured = replace(
        viewing or Viewing(),
        L_A=L_A,
        Y_b=100.0 * background * np.pi / lux,
        surround=min(L_A / L_Aw, 1.0),
    )
    name = solved.mesh.names[solved.mesh.surface[hit]]
    white_XYZ = XYZ_from_spectra(shade, reflectance)
    return EyeConditions(measured, white_XYZ, irradiance, name, L_Aw, note)


def white_surfaces(room: Room) -> tuple[str, ...]:
    """Return the surfaces whose paint is white under D65 [2]; Y 66 or more, nearly neutral."""
    daylight = light("D65", room.grid)
    white = XYZ_from_spectra(daylight, np.ones(room.grid.size))
    Lab = cielab(XYZ_from_spectra(daylight, room.reflectances), white)
    pale = (Lab[:, 0] >= _WHITE_LIGHTNESS) & (np.hypot(Lab[:, 1], Lab[:, 2]) <= _WHITE_CHROMA)
    return tuple(np.array(room.mesh.names)[pale].tolist())


def white_weights(
    solved: RoomLight, eyes: Sequence[Eye], white: str | None = None
) -> tuple[Array, str]:
    """Return how much each patch (N,) counts for the white of some eyes, and a note.

    Weights sum to 1. If none of the ``white`` surface is in view, all of it counts; if no surface
    is white, all that reflects does. The note then says so. Raises RoomError if ``white`` is
    unknown.
    """
    room, mesh = solved.room, solved.mesh
    if white is not None:
        room.reflectance(white)  # refuses unknown names
    names = white_surfaces(room) if white is None else (white,)
    is_white = np.isin(mesh.surface, [mesh.names.index(name) for name in names])
    view = np.zeros(len(mesh.surface))
    for eye in eyes:
        for cone in _CONES_DEG:
            hit = _cone_hits(solved.rays, eye.position_m, _forward(eye), cone, _WHITE_RAYS)
            view += np.bincount(hit[hit >= 0], minlength=len(view))
    weights, note = view * is_white, ""
    if not weights.any() and white is not None:
        weights, note = mesh.areas_m2 * is_white, f"{white} is out of view: all of it counts"
    elif not weights.any():
        weights = view * np.any(room.reflectances, axis=1)[mesh.surface]
        note = "no white surface in view: a perfect diffuser in the mean light on all that is seen"
    return weights / max(float(weights.sum()), 1e-30), note


def _forward(eye: Eye) -> Vector:
    """Return the unit vector of an eye's line of sight."""
    forward = np.subtract(eye.target_m, eye.position_m)
    x, y, z = (forward / np.linalg.norm(forward)).tolist()
    return x, y, z


def cone_luminances(solved: RoomLight, eye: Eye, lux: float) -> tuple[float, float]:
    """Return the luminances, cd/m², of background and surround; a white gets ``lux``."""
    line = eye.position_m, _forward(eye)
    luminances = lux_from_irradiance(solved.radiosity, solved.room.grid) / np.pi
    luminances = np.minimum(luminances, _BRIGHTEST * lux / np.pi)
    background, surround = (
        float(np.where(hit >= 0, luminances[hit], 0.0).mean())
        for hit in (_cone_hits(solved.rays, *line, cone, _CONE_RAYS) for cone in _CONES_DEG)
    )
    return background, surround


# The eye stays while paints change; few, as each keeps a room's rays.
@lru_cache(maxsize=4)
def _cone_hits(
    rays: Rays, eye: Vector, forward: Vector, cone_deg: tuple[float, float], count: int
) -> NDArray[np.intp]:
    """Return the patches, or -1, that an eye sees between two cones."""
    samples = sobol(count, 2, seed=0)
    ends = np.cos(np.radians(cone_deg))
    cosine = ends[0] + samples[:, :1] * (ends[1] - ends[0])
    sine, turn = np.sqrt(1.0 - cosine**2), 2.0 * np.pi * samples[:, 1:]
    first, second = frames(np.array(forward))
    directions = cosine * np.array(forward) + sine * (np.cos(turn) * first + np.sin(turn) * second)
    return rays.first(np.broadcast_to(eye, directions.shape), directions)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceAppearance:
    """A surface's colour as it was chosen, and in the room."""

    name: str
    lux: float  # mean over the surface
    chosen: Appearance
    seen: Appearance
    chosen_xy: tuple[float, float]
    seen_xy: tuple[float, float]
    conditions: EyeConditions
    """Conditions of an eye in front of the surface."""

    @property
    def difference(self) -> float:
        """Distance in J, a_C, b_C [1, section 4.4]."""
        return float(appearance_distance(self.seen, self.chosen))


def surface_eye(solved: RoomLight, name: str) -> Eye:
    """Return an eye before a surface's lit middle, 2 m away or half way to the next surface."""
    mesh = solved.mesh
    rows = np.flatnonzero(mesh.surface == mesh.names.index(name))
    areas, centres = mesh.areas_m2[rows], mesh.centres_m[rows]
    middle = areas @ centres / areas.sum()
    patch = rows[int(np.linalg.norm(centres - middle, axis=1).argmin())]
    normal, centre = mesh.normals[patch], mesh.centres_m[patch]
    start = centre + solved.rays.offset * normal
    hit = int(solved.rays.first(start[None], normal[None])[0])
    room_m = _AWAY_M if hit < 0 else abs(float((mesh.centres_m[hit] - centre) @ mesh.normals[hit]))
    distance = min(_AWAY_M, room_m / 2.0)
    place = tuple((centre + distance * normal).tolist())
    return Eye(position_m=place, target_m=tuple(centre.tolist()))


def surface_appearance(solved: RoomLight, name: str, white: str | None = None) -> SurfaceAppearance:
    """Return how a surface appears to `surface_eye`, and how its colour was chosen from an atlas.

    ``white`` is as in `look`.
    """
    conditions = look(solved, surface_eye(solved, name), white=white)
    grid, reflectance = solved.room.grid, solved.room.reflectance(name)
    atlas_XYZ = XYZ_from_spectra(light("D65", grid), reflectance)
    room_XYZ = XYZ_from_spectra(Spectrum(grid.wavelengths_nm, conditions.irradiance), reflectance)
    return SurfaceAppearance(
        name,
        float(lux_from_irradiance(solved.mean_irradiance(name), grid)),
        atlas_appearance(atlas_XYZ, grid),
        conditions.appearance(room_XYZ),
        chromaticity(reflectance, grid),
        chromaticity(reflectance, grid, conditions.irradiance),
        conditions,
    )


def chromaticity(
    reflectance: Array, grid: SpectralGrid, irradiance: Array | None = None
) -> tuple[float, float]:
    """Return x and y of a reflectance (B,) in an irradiance (B,), by default D65."""
    Q = colour_matching_functions(grid)
    E = light("D65", grid).values if irradiance is None else irradiance
    X, Y, Z = (Q @ (reflectance * E)).tolist()
    total = max(X + Y + Z, 1e-30)
    return X / total, Y / total


def room_picture(
    solved: RoomLight,
    eye: Eye,
    conditions: EyeConditions,
    size: tuple[int, int],
    samples: int = 2,
    progress: Progress = no_progress,
) -> Array:
    """Return the codes (H, W, 3), 0 to 1, of a picture for the display of the eye's viewing."""
    XYZ = picture_XYZ(solved, eye, size, conditions.irradiance, samples, progress)
    viewing = conditions.viewing
    displayed = view_transform(viewing, conditions.white_XYZ).apply(viewing.exposure * XYZ)
    return screen_for_viewing(viewing).codes(displayed)


def picture_XYZ(
    solved: RoomLight,
    eye: Eye,
    size: tuple[int, int],
    irradiance: Array,
    samples: int = 2,
    progress: Progress = no_progress,
) -> Array:
    """Return a picture (H, W, 3) of a room; Y = 100 for a perfect diffuser in an irradiance (B,).

    Direct light is computed at each point that is seen; indirect light is interpolated between
    patches. ``size`` is width and height, ``samples``² rays are cast for each pixel.
    """
    grid = solved.room.grid
    Q = colour_matching_functions(grid)
    scale = Q.T * (100.0 / float(irradiance @ Q[1]))
    exitance = solved.room.emission @ scale
    indirect = solved.irradiance - solved.direct
    # Neighbours are patches on the same plane: normals count more than any distance.
    span = float(np.ptp(solved.mesh.centres_m, axis=0).max())
    place = np.concatenate([solved.mesh.centres_m, 4.0 * span * solved.mesh.normals], axis=1)
    tree = cKDTree(place)
    directions = pixel_rays(eye, size, samples)
    picture = np.zeros((len(directions), 3))
    origin = np.array(eye.position_m)
    for start in range(0, len(directions), _PIXELS):
        progress("picture", start / len(directions))
        part = directions[start : start + _PIXELS]
        hit = solved.rays.first(np.broadcast_to(origin, part.shape), part)
        normals = solved.mesh.normals[hit]
        slope = np.einsum("kc,kc->k", part, normals)
        visible = np.flatnonzero((hit >= 0) & (slope < 0))
        hit, normals, slope = hit[visible], normals[visible], slope[visible]
        corners = solved.mesh.corners_m[hit, 0]
        depth = np.einsum("kc,kc->k", corners - origin, normals) / slope
        points = origin + depth[:, None] * part[visible]
        fallen = direct_irradiance(solved.room, solved.rays, points, normals)
        count = min(_NEIGHBOURS, len(place))
        distance, near = tree.query(np.concatenate([points, 4.0 * span * normals], axis=1), count)
        distance, near = distance.reshape(len(points), -1), near.reshape(len(points), -1)
        weight = np.maximum(1.0 - (distance / np.maximum(distance[:, -1:], 1e-30)) ** 2, 1e-6) ** 2
        weight /= weight.sum(axis=1, keepdims=True)
        fallen += np.einsum("kn,knb->kb", weight, indirect[near])
        left = (solved.reflectances[hit] * fallen) @ scale
        picture[start + visible] = left + exitance[solved.mesh.surface[hit]]
    progress("picture", 1.0)
    width, height = size
    cells = picture.reshape(height, samples, width, samples, 3)
    return cells.mean(axis=(1, 3))


def pixel_rays(eye: Eye, size: tuple[int, int], samples: int) -> Array:
    """Return unit directions (H·s·W·s, 3) of the pixels' rays, rows from the top."""
    width, height = size
    forward = np.array(_forward(eye))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6:
        right = np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    half = np.tan(np.radians(eye.fov_deg) / 2.0)
    y = half * (1.0 - 2.0 * (np.arange(height * samples) + 0.5) / (height * samples))
    x = half * width / height * (2.0 * (np.arange(width * samples) + 0.5) / (width * samples) - 1)
    rays = forward + y[:, None, None] * up + x[None, :, None] * right
    rays = rays.reshape(-1, 3)
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)
