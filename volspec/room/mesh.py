"""Surfaces of a room as triangles.

rectangles, boxes, files -> [mesh] -> form factors, direct light

Lengths are metres, z points up, and a triangle's corners run counter-clockwise as seen from the
side that reflects and emits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from volspec.errors import Code, RoomError

Array = NDArray[np.float64]
# A triangle is degenerate if its height is below this fraction of its longest side.
_MIN_HEIGHT = 1e-6
# Corners coincide if they are closer than this fraction of the room.
_SAME = 1e-6
# Corners of a rectangle's two triangles.
_HALVES = np.array([[0, 1, 2], [0, 2, 3]])
# Names of a box's sides, by axis and end.
SIDES = ("left", "right", "front", "back", "floor", "ceiling")


@dataclass(frozen=True, eq=False)
class RoomMesh:
    """Triangles, and the surface that each belongs to.

    Parameters
    ----------
    corners_m : (N, 3, 3) array
        Three corners of each triangle.
    surface : (N,) array of int
        Index into ``names``.
    names : tuple of str
        Names of the surfaces.

    Raises
    ------
    RoomError
        If there is no triangle, a coordinate is not finite, or a triangle has no area or is there
        twice.
    """

    corners_m: Array
    surface: NDArray[np.intp]
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        corners = np.asarray(self.corners_m, np.float64)
        object.__setattr__(self, "corners_m", corners)
        object.__setattr__(self, "surface", np.asarray(self.surface, np.intp))
        if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not len(corners):
            problem = f"corners have shape {corners.shape}"
            raise RoomError(problem, "give (N, 3, 3), N at least 1", code="shape")
        finite = np.isfinite(corners).all(axis=(1, 2))
        if not finite.all():
            self._refuse(int(finite.argmin()), "is not finite", "repair the mesh", "range")
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=-1).max(axis=1)
        flat = 2.0 * self.areas_m2 <= _MIN_HEIGHT * sides**2
        if flat.any():
            self._refuse(int(flat.argmax()), "has no area", "remove it", "conflict")
        _, first, count = np.unique(
            np.sort(self.corner_numbers(), axis=1), axis=0, return_index=True, return_counts=True
        )
        if (count > 1).any():
            bad = int(first[count.argmax()])
            self._refuse(bad, "is there twice", "keep one of the coincident faces", "duplicate")

    def _refuse(self, triangle: int, problem: str, remedy: str, code: Code) -> None:
        place = ", ".join(f"{x:.4g}" for x in self.corners_m[triangle].mean(axis=0))
        name = self.names[self.surface[triangle]]
        raise RoomError(
            f"{name}: its triangle {triangle} at ({place}) m {problem}",
            remedy,
            code=code,
        )

    def corner_numbers(self) -> NDArray[np.intp]:
        """(N, 3) numbers of the corners, equal if two coincide."""
        points = self.corners_m.reshape(-1, 3)
        cell = _SAME * max(float(np.ptp(points, axis=0).max()), 1e-30)
        _, numbers = np.unique(np.rint(points / cell), axis=0, return_inverse=True)
        return numbers.reshape(-1, 3)

    @property
    def extent(self) -> str:
        """The box around the mesh, for messages: ``x 0 to 4, y 0 to 5, z 0 to 2.7 m``."""
        ends = (self.corners_m.min(axis=(0, 1)), self.corners_m.max(axis=(0, 1)))
        axes = zip("xyz", *ends, strict=True)
        return ", ".join(f"{axis} {low:g} to {high:g}" for axis, low, high in axes) + " m"

    @property
    def cross_m2(self) -> Array:
        """(N, 3) normals with twice the area as their lengths."""
        a, b, c = self.corners_m.transpose(1, 0, 2)
        return np.cross(b - a, c - a)

    @cached_property
    def areas_m2(self) -> Array:
        """(N,) areas."""
        return np.linalg.norm(self.cross_m2, axis=1) / 2.0

    @cached_property
    def normals(self) -> Array:
        """(N, 3) unit normals."""
        cross = self.cross_m2
        return cross / np.linalg.norm(cross, axis=1, keepdims=True)

    @cached_property
    def surface_areas(self) -> csr_array:
        """(S, N) areas, each in the row of its triangle's surface."""
        count = len(self.surface)
        shape = len(self.names), count
        return csr_array((self.areas_m2, (self.surface, np.arange(count))), shape=shape)

    @property
    def centres_m(self) -> Array:
        """(N, 3) centres."""
        return self.corners_m.mean(axis=1)

    def part(self, rows: slice | NDArray[np.intp] | NDArray[np.bool_]) -> RoomMesh:
        """Return some of the triangles."""
        return _trusted_mesh(self.corners_m[rows], self.surface[rows], self.names)

    def points(self, uv: Array) -> Array:
        """Return points of each triangle: (N, P, 3) for (P, 2) or (N, P, 2) in the unit square.

        Uniform ``uv`` give points of uniform density.
        """
        uv = np.broadcast_to(uv, (len(self.corners_m), *uv.shape[-2:]))
        root = np.sqrt(uv[..., :1])
        a, b, c = (self.corners_m[:, None, i] for i in range(3))
        return (1.0 - root) * a + root * (1.0 - uv[..., 1:]) * b + root * uv[..., 1:] * c

    def split(self, halved: NDArray[np.bool_]) -> RoomMesh:
        """Return the mesh with chosen triangles halved across their longest sides.

        Halves follow each other, in place of their parent.
        """
        corners = self.corners_m
        longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1).argmax(axis=1)
        rows = np.arange(len(corners))
        a, b, c = (corners[rows, (longest + i) % 3] for i in range(3))  # the longest side is a-b
        middle = (a + b) / 2.0
        halves = np.stack([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)], axis=1)
        counts = np.where(halved, 2, 1)
        parents = np.repeat(rows, counts)
        second = np.concatenate([[False], parents[1:] == parents[:-1]]).astype(np.intp)
        parts = np.where(halved[parents, None, None], halves[parents, second], corners[parents])
        return _trusted_mesh(parts, self.surface[parents], self.names)

    def with_edges(self, longest_m: float) -> RoomMesh:
        """Return the mesh with triangles halved until no side is longer."""
        mesh = self
        while True:
            corners = mesh.corners_m
            sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=-1).max(axis=1)
            if not (long := sides > longest_m).any():
                return mesh
            mesh = mesh.split(long)

    def __add__(self, other: RoomMesh) -> RoomMesh:
        """Return the triangles of both; surfaces with the same name are one."""
        names = tuple(dict.fromkeys((*self.names, *other.names)))
        numbers = np.array([names.index(name) for name in other.names])
        return RoomMesh(
            np.concatenate([self.corners_m, other.corners_m]),
            np.concatenate([self.surface, numbers[other.surface]]),
            names,
        )


def _trusted_mesh(corners_m: Array, surface: NDArray[np.intp], names: tuple[str, ...]) -> RoomMesh:
    """Return a mesh whose triangles are parts of checked ones."""
    mesh = object.__new__(RoomMesh)
    for name, value in (("corners_m", corners_m), ("surface", surface), ("names", names)):
        object.__setattr__(mesh, name, value)
    return mesh


def rectangle(corner_m: ArrayLike, first_m: ArrayLike, second_m: ArrayLike, name: str) -> RoomMesh:
    """Return the two triangles of a rectangle with two sides from a corner.

    Its front is where first × second points to.
    """
    corner, first, second = (np.asarray(v, np.float64) for v in (corner_m, first_m, second_m))
    ring = np.array([corner, corner + first, corner + first + second, corner + second])
    return RoomMesh(ring[_HALVES], np.zeros(2, np.intp), (name,))


def box(
    low_m: ArrayLike, high_m: ArrayLike, names: str | Sequence[str], *, inside: bool = False
) -> RoomMesh:
    """Return a box whose fronts are outside, as of furniture, or inside, as of a room.

    ``names`` is one for all sides, or those in the order of `SIDES`.
    """
    low, high = np.asarray(low_m, np.float64), np.asarray(high_m, np.float64)
    called = [names] * 6 if isinstance(names, str) else list(names)
    mesh: RoomMesh | None = None
    for axis in range(3):
        first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        for end in range(2):
            corner = low + end * np.eye(3)[axis] * (high - low)
            sides = first * (high - low), second * (high - low)
            one, two = sides if (end == 0) is inside else sides[::-1]
            part = rectangle(corner, one, two, called[2 * axis + end])
            mesh = part if mesh is None else mesh + part
    assert mesh is not None
    return mesh


def panel(
    corner_m: ArrayLike,
    first_m: ArrayLike,
    second_m: ArrayLike,
    name: str,
    openings: Sequence[tuple[str, tuple[float, float, float, float]]] = (),
) -> RoomMesh:
    """Return a rectangle with rectangular parts of other surfaces, such as windows.

    Each opening is a name and its place (x, y, width, height), in metres along both sides. Raises
    RoomError if one is not inside, or two overlap.
    """
    corner, first, second = (np.asarray(v, np.float64) for v in (corner_m, first_m, second_m))
    lengths = [float(np.linalg.norm(first)), float(np.linalg.norm(second))]
    for other, (x, y, width, height) in openings:
        inside = x >= 0 and y >= 0 and x + width <= lengths[0] and y + height <= lengths[1]
        if not (inside and width > 0 and height > 0):
            raise RoomError(
                f"{other}: place_m ({x:g}, {y:g}, {width:g}, {height:g}) m is not within the "
                f"{lengths[0]:g} m × {lengths[1]:g} m of {name}",
                "move it or make it smaller",
                code="range",
            )
    places = [place for _, place in openings]
    across = sorted({0.0, lengths[0], *(x for p in places for x in (p[0], p[0] + p[2]))})
    up = sorted({0.0, lengths[1], *(y for p in places for y in (p[1], p[1] + p[3]))})
    mesh: RoomMesh | None = None
    for x0, x1 in pairwise(across):
        for y0, y1 in pairwise(up):
            middle = (x0 + x1) / 2, (y0 + y1) / 2
            holders = [
                other
                for other, (x, y, width, height) in openings
                if x < middle[0] < x + width and y < middle[1] < y + height
            ]
            if len(holders) > 1:
                problem = f"{holders[0]} and {holders[1]} overlap on {name}"
                raise RoomError(problem, "move one of them", code="conflict")
            right, above = first / lengths[0], second / lengths[1]
            part = rectangle(
                corner + x0 * right + y0 * above,
                (x1 - x0) * right,
                (y1 - y0) * above,
                holders[0] if holders else name,
            )
            mesh = part if mesh is None else mesh + part
    assert mesh is not None
    return mesh
