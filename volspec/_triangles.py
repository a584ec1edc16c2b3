"""Triangles: files of them, rays to them by Embree, directions about their normals.

file -> [triangles] -> first hits, free ways -> room, mesh
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from volspec._child import child_command
from volspec._confine import require_inside
from volspec._extras import require_extra
from volspec._parse import parse_json
from volspec.errors import InputError, nearest

if TYPE_CHECKING:
    import pyvista

Array = NDArray[np.float64]
FILES = (".ply", ".obj", ".stl", ".vtp", ".vtk", ".gltf", ".glb")
"""Suffixes of `read_triangles`."""
MESHES = tuple(suffix for suffix in FILES if suffix != ".vtk")
"""Suffixes of meshes alone; see `is_mesh_file` for a ``.vtk``."""
# Rays begin this fraction of the triangles' extent in front of theirs, and shadow rays end so.
_OFFSET = 1e-5


# In a process of its own, which VTK's readers may end at damaged files.
_READER = """
import os, sys, warnings
warnings.simplefilter("ignore")
import numpy, pyvista
reader = pyvista.get_reader(sys.argv[2])
read = reader.read()
if isinstance(read, pyvista.MultiBlock):
    # Of glTF: combining keeps only what all parts have.
    parts = [part for part in read.recursive_iterator(skip_none=True) if part.n_points]
    rows = [dict(part.field_data.items()) for part in parts]
    pictures = [int(row.get("BaseColorTextureIndex", [-1])[0]) for row in rows]
    coloured = any("COLOR_0" in part.point_data for part in parts)
    for number, (part, row) in enumerate(zip(parts, rows)):
        part.cell_data["MaterialIds"] = numpy.full(part.n_cells, number, numpy.int32)
        if coloured:
            colour = part.point_data.get("COLOR_0", numpy.ones((part.n_points, 3)))[:, :3]
            scale = numpy.iinfo(colour.dtype).max if colour.dtype.kind == "u" else 1
            part.point_data["COLOR_0"] = numpy.float32(colour / scale)
        if max(pictures) >= 0:
            uv = f"TEXCOORD_{int(row.get('BaseColorTexCoordIndex', [0])[0])}"
            uv = part.point_data.get(uv, numpy.zeros((part.n_points, 2), numpy.float32))
            part.active_texture_coordinates = uv
        part.field_data.clear()
    read = read.combine()
    white = [[1, 1, 1, 1]]
    read.field_data["Factors"] = numpy.float32(
        [row.get("BaseColorMultiplier", white)[0][:3] for row in rows] or white
    )
    read.field_data["Pictures"] = numpy.int32(pictures)
    for number in {*pictures} - {-1}:
        image = pyvista.wrap(reader.reader.GetTexture(number).GetVTKTexture().GetInput())
        read.field_data[f"Picture {number}"] = image.point_data.values()[0]
        read.field_data[f"Width {number}"] = [image.dimensions[0]]
elif "MaterialNames" in read.field_data:
    # Of OBJ: texture coordinates are an array for each material, the file's first 'NO_MATERIAL'.
    names, polys = read.field_data["MaterialNames"].tolist(), read.GetPolys()
    names = [names[0] if name == "NO_MATERIAL" else name for name in names]
    read.field_data["MaterialNames"] = names
    arrays = {name: read.point_data.pop(name) for name in {*names, "TCoords"} & {*read.point_data}}
    corners = pyvista.convert_array(polys.GetConnectivityArray())
    counts = numpy.diff(pyvista.convert_array(polys.GetOffsetsArray()))
    ids = numpy.repeat(read.cell_data["MaterialIds"][-len(counts):], counts)
    uv = numpy.zeros((read.n_points, 2), numpy.float32)
    for number, name in enumerate(names if arrays else ()):
        used = corners[ids == number]
        uv[used] = arrays.get(name, arrays.get("TCoords", uv))[used]
        read.active_texture_coordinates = uv
if isinstance(read, pyvista.PolyData):
    cells = [read.GetPolys(), read.GetStrips()]
    used = [pyvista.convert_array(each.GetConnectivityArray()) for each in cells]
else:
    used = [read.cell_connectivity] if isinstance(read, pyvista.UnstructuredGrid) else []
used = numpy.concatenate([*used, numpy.zeros(0, int)])
if used.size and not 0 <= used.min() <= used.max() < read.n_points:
    sys.exit("a face has a point that is not there")
surface = read.extract_surface(algorithm=None).triangulate()
if surface.n_cells:
    surface.save(sys.argv[3] + ".vtp")
    os.rename(sys.argv[3] + ".vtp", sys.argv[3])
elif read.n_points:
    sys.exit(f"has {read.n_points} points and no faces")
else:
    sys.exit("has no points: empty, damaged or of another format")
"""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """First hits of M rays.

    Attributes
    ----------
    triangle : (M,) array of int
        -1 for nothing.
    along : (M,) array
        Distance from the origin; inf for nothing.
    shares : (M, 3) array
        Barycentric coordinates: shares of the triangle's three corners.
    across : (M, 3) array
        Across the triangle, by the right hand; its length is twice the area, 0 for nothing.
    """

    triangle: NDArray[np.intp]
    along: Array
    shares: Array
    across: Array


class TriangleRays:
    """Ray queries of triangles (N, 3, 3), all in one unit of length.

    Raises DeviceError where Embree is not installed; ``feature`` needs it, and ``instead`` is the
    remedy.
    """

    def __init__(self, corners: Array, feature: str, instead: str) -> None:
        try:
            from embreex.mesh_construction import TriangleMesh  # type: ignore[import-untyped]  # has no types
            from embreex.rtcore_scene import EmbreeScene  # type: ignore[import-untyped]  # has no types
        except ImportError:
            require_extra("rooms", feature, f"where it has no wheel, {instead}")
            raise
        self.corners = corners
        self._given = corners, feature, instead
        a, b, c = corners.transpose(1, 0, 2)
        self._across = np.cross(b - a, c - a)
        points = corners.reshape(-1, 3)
        # Single precision is finest around 0.
        self._middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
        self.offset = _OFFSET * float(np.ptp(points, axis=0).max())
        self._scene = EmbreeScene(robust=True)
        TriangleMesh(self._scene, np.float32(corners - self._middle))

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "_scene"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        TriangleRays.__init__(self, *self._given)

    def first(self, origins: Array, directions: Array) -> NDArray[np.intp]:
        """(M,) triangles that rays hit first; -1 for none."""
        triangles = self._scene.run(np.float32(origins - self._middle), np.float32(directions))
        return np.asarray(triangles, np.intp)

    def hits(self, origins: Array, directions: Array) -> Hits:
        """Return what rays hit first, where; ``directions`` are unit vectors."""
        hit = self._scene.run(
            np.float32(origins - self._middle), np.float32(directions), output=True
        )
        triangle = np.asarray(hit["primID"], np.intp)
        across = np.where(triangle[:, None] >= 0, self._across[triangle], 0.0)
        # In double precision, for which Embree's distances would be too coarse.
        speed = np.einsum("kc,kc->k", directions, across)
        valid = speed != 0.0
        triangle[~valid] = -1
        height = np.einsum("kc,kc->k", self.corners[triangle, 0] - origins, across)
        distance = np.full(len(triangle), np.inf)
        np.divide(height, speed, out=distance, where=valid)
        second, third = np.float64(hit["u"]) * valid, np.float64(hit["v"]) * valid
        barycentric = np.stack([valid - second - third, second, third], axis=1)
        return Hits(triangle, distance, barycentric, across)

    def clear(self, origins: Array, ends: Array) -> NDArray[np.bool_]:
        """(M,) True where nothing is between two points."""
        offset = ends - origins
        length = np.linalg.norm(offset, axis=-1)
        reach = np.float32(np.maximum(length - 2.0 * self.offset, 0.0))
        directions = np.float32(offset / np.maximum(length, 1e-30)[:, None])
        occluded = self._scene.run(
            np.float32(origins - self._middle), directions, reach, query="OCCLUDED"
        )
        return np.asarray(occluded) != 0


def is_mesh_file(path: Path) -> bool:
    """Return True if a file is a mesh: a ``.vtk`` may also be a volume, as its head says."""
    if path.suffix.lower() != ".vtk":
        return path.suffix.lower() in MESHES
    try:
        with path.open("rb") as file:
            return re.search(rb"^DATASET\s+POLYDATA", file.read(1024), re.M | re.I) is not None
    except OSError:
        return False


def read_triangles(path: Path, refused: type[InputError]) -> pyvista.PolyData:
    """Return the triangles of a PLY, OBJ, STL, VTP, VTK or glTF file.

    Raises ``refused`` if the file is missing, of another format, or has no triangles.
    """
    require_extra("vtk", str(path))
    import pyvista

    if path.suffix.lower() not in FILES:
        formats = ", ".join(FILES)
        guess = nearest(path.suffix.lower(), FILES)
        problem = f"{path}: not a known format of meshes"
        raise refused(problem, f"{guess}known are {formats}", code="unsupported")
    require_inside(path, refused)
    if not path.exists():
        raise refused(f"{path}: no such file", "check the path", code="not-found")
    _require_parts_inside(path, refused)
    with tempfile.TemporaryDirectory() as folder:
        surface_file = Path(folder, "surface.vtp")
        command = [*child_command(_READER), str(path.absolute()), str(surface_file)]
        child = subprocess.run(command, capture_output=True, check=False, text=True)
        if surface_file.exists():
            return pyvista.read(surface_file)
    if not path.stat().st_size:
        problem = "is empty"
    elif child.returncode == 1 and "Traceback" not in child.stderr and child.stderr:
        problem = child.stderr.strip().splitlines()[-1]
    else:
        problem = f"cannot be read as {path.suffix.lower()}: damaged, or of another format"
    raise refused(f"{path}: {problem}", "save it again where it was made", code="damaged")


def _require_parts_inside(path: Path, refused: type[InputError]) -> None:
    """Raise ``refused`` if a glTF file names files that are missing or must not be opened."""
    if path.suffix.lower() not in (".gltf", ".glb"):
        return
    data = path.read_bytes()
    if data[:4] == b"glTF":
        data = data[20 : 20 + int.from_bytes(data[12:16], "little")]
    try:
        tables = parse_json(data.decode("utf-8-sig"))
        rows = [*tables.get("buffers", ()), *tables.get("images", ())]
        named = [row["uri"] for row in rows if "uri" in row]
        for uri in (u for u in named if not u.startswith("data:")):
            for name in (uri, unquote(uri)):
                require_inside(path.parent / name, refused)
            if not (path.parent / unquote(uri)).exists():
                problem = f"{path}: names {unquote(uri)}, which is missing"
                raise refused(problem, "put it there", code="not-found")
    except (ValueError, TypeError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise refused(f"{path}: is damaged", "save it again", code="damaged") from error


def frames(normals: Array) -> tuple[Array, Array]:
    """Return two unit vectors (..., 3) across each normal."""
    helper = np.where(np.abs(normals[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(normals, first)


def cosine_directions(normals: Array, uv: Array) -> Array:
    """Return directions (..., 3) about normals, with the density of their cosine, by squares."""
    first, second = frames(normals)
    radius, turn = np.sqrt(uv[..., :1]), 2.0 * np.pi * uv[..., 1:]
    height = np.sqrt(np.maximum(1.0 - uv[..., :1], 0.0))
    return radius * (np.cos(turn) * first + np.sin(turn) * second) + height * normals
