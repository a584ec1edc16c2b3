"""Meshes of simple shapes, with normals and texture coordinates.

size, material -> [shapes] -> Mesh
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from volspec._extras import require_extra
from volspec.errors import MeshError, nearest
from volspec.mesh.model import Mesh
from volspec.mesh.texture import Texture

Array = NDArray[np.float64]
Shape = Literal["plane", "disc", "sphere", "triad"]
"""Shapes that need no file."""
# Divisions of a whole turn.
_TURN = 256


def shape_mesh(shape: Shape, size_mm: float = 1.0, material: str | Texture | None = None) -> Mesh:
    """Return a shape about the origin.

    Parameters
    ----------
    shape : {"plane", "disc", "sphere", "triad"}
        ``plane`` and ``disc`` look to +z; a disc has a hole of an eighth of its size, as a compact
        disc has. ``triad`` is three arrows from the origin, x red, y green and z blue.
    size_mm : float
        Side of the plane, diameter, or length of the arrows.
    material : str or Texture, optional
        ``"white"`` if left out, and the three colours for a triad. Texture coordinates of a
        sphere are those of a map of the world with z up.

    Raises
    ------
    MeshError
        If there is no such shape, or its size is not above 0.

    Examples
    --------
    >>> shape_mesh("plane", 30.0, "copper")
    Mesh(2 triangles, copper)
    """
    builder = {"plane": _plane, "disc": _disc, "sphere": _sphere, "triad": _triad}.get(shape)
    if builder is None:
        names = get_args(Shape)
        remedy = f"{nearest(shape, names)}known: {', '.join(names)}"
        raise MeshError(f"no shape is named {shape!r}", remedy, code="unknown")
    if not size_mm > 0.0:
        raise MeshError(f"{shape}: size_mm is {size_mm:g}", "give a number above 0", code="range")
    points, triangles, normals, uv = builder()
    if material is None:
        material = "white"
        if shape == "triad":
            colours = [[[200, 40, 40], [50, 150, 50], [60, 80, 210]]]
            material = Texture(np.array(colours, np.uint8), name="triad")
    return Mesh(points * size_mm, triangles, material, normals, shape, uv)


Parts = tuple[Array, NDArray[np.intp], Array, Array]


def _plane() -> Parts:
    uv = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    points = np.pad(uv - 0.5, ((0, 0), (0, 1)))
    return points, np.array([[0, 1, 2], [0, 2, 3]]), np.tile([0.0, 0.0, 1.0], (4, 1)), uv


def _grid(rows: int) -> NDArray[np.intp]:
    """Return the triangles of a grid of points (rows, _TURN + 1)."""
    columns = _TURN + 1
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(_TURN)).reshape(-1, 1)
    return np.concatenate(
        [first + [0, 1, columns], first + [1, columns + 1, columns]], axis=0
    ).astype(np.intp)


def _turns(rows: int) -> Array:
    """Return angles (rows, _TURN + 1) of a grid's points."""
    return np.broadcast_to(np.linspace(0.0, 2.0 * np.pi, _TURN + 1), (rows, _TURN + 1))


def _disc() -> Parts:
    turn, radius = _turns(2), np.array([[0.0625], [0.5]])
    flat = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=2).reshape(-1, 2)
    points = np.pad(flat, ((0, 0), (0, 1)))
    return points, _grid(2), np.tile([0.0, 0.0, 1.0], (len(points), 1)), flat + 0.5


def _sphere() -> Parts:
    rows = _TURN // 2 + 1
    turn = _turns(rows)
    down = np.broadcast_to(np.linspace(0.0, np.pi, rows)[:, None], turn.shape)
    sine = np.sin(down)
    normals = np.stack([sine * np.cos(turn), sine * np.sin(turn), np.cos(down)], axis=2)
    uv = np.stack([turn / (2.0 * np.pi), 1.0 - down / np.pi], axis=2)
    triangles = _grid(rows)
    # At the poles, one triangle of each pair has no area.
    corner = normals.reshape(-1, 3)[triangles]
    a, b, c = corner.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    normals = normals.reshape(-1, 3)
    return 0.5 * normals, triangles[area > 1e-12], normals, uv.reshape(-1, 2)


def _triad() -> Parts:
    require_extra("vtk", "the triad")
    import pyvista

    parts, count = [], 0
    for axis in range(3):
        arrow = pyvista.Arrow(
            direction=np.eye(3)[axis], tip_resolution=48, shaft_resolution=48, shaft_radius=0.025,
            tip_radius=0.07, tip_length=0.22,
        ).compute_normals(split_vertices=True, cell_normals=False)  # fmt: skip
        arrow = arrow.triangulate()
        points = np.asarray(arrow.points, np.float64)
        uv = np.tile([(axis + 0.5) / 3.0, 0.5], (len(points), 1))
        triangles = arrow.faces.reshape(-1, 4)[:, 1:].astype(np.intp) + count
        parts.append((points, triangles, np.asarray(arrow.point_data["Normals"], np.float64), uv))
        count += len(points)
    points, triangles, normals, uv = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return points, triangles, normals, uv
