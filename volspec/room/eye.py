"""Viewing conditions, appearance of surfaces and pictures for an eye in a room.

RoomLight, eye -> [eye] -> Viewing, J C h, XYZ of pixels

    Y_b = mean Y over 1° to 11° around the line of sight           [1, eq. 1]
    L_A = mean luminance over 11° to 90°                           [1, section 2.4]
    S_R = L_A / L_Aw                                               [1, eq. 17]

The white is a perfect diffuser, or a surface of the room, in the light that falls on what the eye
looks at [1, eq. 6, 8 and 9].

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from volspec._triangles import frames
from volspec.appearance import Viewing, forward_for, screen_for_viewing, view_transform
from volspec.appearance.models import Appearance
from volspec.errors import RoomError
from volspec.room.direct_light import direct_irradiance
from volspec.room.form_factors import Rays, sobol
from volspec.room.model import Eye, Room
from volspec.room.quantities import lux_from_irradiance
from volspec.room.radiosity import Progress, RoomLight, no_progress
from volspec.room.wall_paint import appearance_distance, atlas_appearance
from volspec.settings import Vector
from volspec.spectra import Spectrum, XYZ_from_spectra, colour_matching_functions, light

Array = NDArray[np.float64]
# Cones around the line of sight, degrees, and rays between two of them.
_BACKGROUND_DEG, _SURROUND_DEG, _CONE_RAYS = (1.0, 11.0), (11.0, 90.0), 1 << 13
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
    mesh, position = rays.mesh, np.array(eye.position_m)
    forward = np.array(eye.target_m) - position
    forward /= np.linalg.norm(forward)
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
    default a perfect diffuser. Raises RoomError if the eye sees nothing there, or a back.
    """
    hit = seen_triangle(solved.rays, eye)
    grid = solved.room.grid
    irradiance = solved.irradiance[hit]
    lux = float(lux_from_irradiance(irradiance, grid))
    background, L_A = cone_luminances(solved, eye, lux)
    reflectance = np.ones(grid.size) if white is None else solved.room.reflectance(white)
    L_Aw = float(lux_from_irradiance(irradiance * reflectance, grid)) / np.pi
    if not L_Aw > 0:
        raise RoomError(
            "no light falls on what the eye looks at",
            "move its target_m",
            code="impossible",
            field="eye",
        )
    shade = Spectrum(grid.wavelengths_nm, irradiance)
    measured = replace(
        viewing or Viewing(),
        L_A=L_A,
        Y_b=100.0 * background * np.pi / lux,
        surround=min(L_A / L_Aw, 1.0),
    )
    name = solved.mesh.names[solved.mesh.surface[hit]]
    return EyeConditions(measured, XYZ_from_spectra(shade, reflectance), irradiance, name, L_Aw)


def cone_luminances(solved: RoomLight, eye: Eye, lux: float) -> tuple[float, float]:
    """Return the luminances, cd/m², of background and surround; a white gets ``lux``."""
    position = np.array(eye.position_m)
    forward = np.array(eye.target_m) - position
    forward /= np.linalg.norm(forward)
    luminances = lux_from_irradiance(solved.radiosity, solved.room.grid) / np.pi
    luminances = np.minimum(luminances, _BRIGHTEST * lux / np.pi)
    background, surround = (
        _cone_mean(solved, luminances, position, forward, cone)
        for cone in (_BACKGROUND_DEG, _SURROUND_DEG)
    )
    return background, surround


def _cone_mean(
    solved: RoomLight, luminances: Array, eye: Array, forward: Array, cone_deg: tuple[float, float]
) -> float:
    """Return the mean luminance between two cones, by solid angle."""
    hit = _cone_hits(solved.rays, tuple(eye.tolist()), tuple(forward.tolist()), cone_deg)
    return float(np.where(hit >= 0, luminances[hit], 0.0).mean())


# The eye stays while paints change; few, as each keeps a room's rays.
@lru_cache(maxsize=4)
def _cone_hits(
    rays: Rays, eye: Vector, forward: Vector, cone_deg: tuple[float, float]
) -> NDArray[np.intp]:
    """Return the patches, or -1, that an eye sees between two cones."""
    samples = sobol(_CONE_RAYS, 2, seed=0)
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


def surface_appearance(solved: RoomLight, name: str, white: str | None = None) -> SurfaceAppearance:
    """Return how a surface appears in the room, and how its colour was chosen from an atlas.

    ``white`` is a surface that the eye takes for white; by default a perfect diffuser.

    The eye is in front of the surface's lit middle, 2 m away or half way to the next surface.
    """
    mesh, room = solved.mesh, solved.room
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
    eye = Eye(position_m=place, target_m=tuple(centre.tolist()))
    conditions = look(solved, eye, white=white)
    grid, reflectance = room.grid, room.reflectance(name)
    daylight = light("D65", grid)
    atlas_XYZ = XYZ_from_spectra(daylight, reflectance)
    room_XYZ = XYZ_from_spectra(Spectrum(grid.wavelengths_nm, conditions.irradiance), reflectance)
    lux = float(lux_from_irradiance(areas @ solved.irradiance[rows] / areas.sum(), grid))
    return SurfaceAppearance(
        name,
        lux,
        atlas_appearance(atlas_XYZ, grid),
        conditions.appearance(room_XYZ),
        _xy(atlas_XYZ),
        _xy(room_XYZ),
        conditions,
    )


def _xy(XYZ: Array) -> tuple[float, float]:
    total = max(float(XYZ.sum()), 1e-30)
    return float(XYZ[0]) / total, float(XYZ[1]) / total


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
    forward = np.array(eye.target_m) - eye.position_m
    forward /= np.linalg.norm(forward)
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
