"""A mesh: triangles, their normals and what they are made of.

file or arrays -> [Mesh] -> caster
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from volspec._files import captured_output
from volspec.errors import Code, MeshError, VolspecWarning, nearest

if TYPE_CHECKING:
    import pyvista

Array = NDArray[np.float64]
FILES = (".ply", ".obj", ".stl", ".vtp", ".vtk", ".gltf", ".glb")
# Edges are smooth where normals turn by less.
SMOOTH_DEG = 30.0
# A triangle is degenerate if its height is below this part of its longest side.
_LEAST_HEIGHT = 1e-7
# Sizes that differ by more look like a wrong unit.
_UNITS = 100.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with a material, or with shares of several.

    Parameters
    ----------
    points_mm : (N, 3) array_like
        Points of the volume's world.
    triangles : (T, 3) array_like of int
        Indices of points.
    material : str or {str: (N,) or (T,) array_like}
        Name of the material; or the share of each at points, or in triangles. Shares are divided
        by their sum.
    normals : (N, 3) array_like, optional
        Of smooth edges; if left out, triangles are flat.
    name : str
        For messages.

    Raises
    ------
    MeshError
        If there is no triangle, an index is out of range, or numbers are not finite, shares have
        the wrong size, are negative or all 0.

    Warns
    -----
    VolspecWarning
        If triangles have no area; they are left out.

    Examples
    --------
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], "copper")
    >>> mesh
    Mesh(1 triangle, copper)
    """

    points_mm: Array
    triangles: NDArray[np.intp]
    material: str | Mapping[str, ArrayLike] = "white"
    normals: Array | None = None
    name: str = "mesh"

    def __repr__(self) -> str:
        count = len(self.triangles)
        return f"Mesh({count} triangle{'s' * (count != 1)}, {', '.join(self.materials)})"

    def __post_init__(self) -> None:
        points = self._finite("points_mm", self.points_mm)
        triangles = np.asarray(self.triangles)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            raise self._error(f"triangles have shape {triangles.shape}", "give (T, 3) of int")
        triangles = triangles.astype(np.intp)
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(points):
            worst = triangles.max() if triangles.max() >= len(points) else triangles.min()
            raise self._error(f"a triangle has point {worst}", f"there are {len(points)}", "range")
        whole = self._has_area(points[triangles])
        if not whole.any():
            raise self._error("has no triangle with an area", "give a surface", "missing")
        object.__setattr__(self, "points_mm", points)
        object.__setattr__(self, "triangles", triangles[whole])
        if self.normals is not None:
            normals = self._finite("normals", self.normals)
            if normals.shape != points.shape:
                raise self._error(f"normals have shape {normals.shape}", f"give {points.shape}")
            object.__setattr__(self, "normals", normals)
        if not isinstance(self.material, str):
            self._take_shares(whole)
        if lost := int((~whole).sum()):
            text = f"{self.name}: {lost} of its triangles have no area, and are left out"
            warnings.warn(text, VolspecWarning, stacklevel=3)

    def _error(self, problem: str, remedy: str, code: Code = "shape") -> MeshError:
        return MeshError(f"{self.name}: {problem}", remedy, code=code)

    def _finite(self, what: str, given: ArrayLike) -> Array:
        array = np.asarray(given, np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise self._error(f"{what} have shape {array.shape}", "give (N, 3)")
        if not np.isfinite(array).all():
            row = int((~np.isfinite(array)).any(axis=1).argmax())
            raise self._error(f"{what}: number {row} is not finite", "repair the mesh", "range")
        return array

    @staticmethod
    def _has_area(corners: Array) -> NDArray[np.bool_]:
        a, b, c = corners.transpose(1, 0, 2)
        sides = np.stack([b - a, c - b, a - c])
        longest = (sides**2).sum(axis=2).max(axis=0, initial=0.0)
        twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.asarray(twice > _LEAST_HEIGHT * longest)

    def _take_shares(self, whole: NDArray[np.bool_]) -> None:
        """Check and store shares of materials."""
        assert not isinstance(self.material, str)
        found, counts = {}, {"points": len(self.points_mm), "triangles": len(whole)}
        for name, given in self.material.items():
            shares = np.asarray(given, np.float64)
            if shares.ndim != 1 or len(shares) not in counts.values():
                sizes = " or ".join(f"{count} ({what})" for what, count in counts.items())
                raise self._error(f"shares of {name} have shape {shares.shape}", f"give {sizes}")
            if not (shares >= 0.0).all():
                raise self._error(f"shares of {name} are negative or NaN", "clip them", "range")
            found[name] = shares
        if len({len(each) for each in found.values()}) != 1:
            raise self._error("shares of materials differ in size", "give all at points")
        total = np.sum([*found.values()], axis=0)
        per_triangle = len(total) == len(whole) and len(total) != len(self.points_mm)
        used = whole if per_triangle else np.isin(np.arange(len(total)), self.triangles)
        if not total[used].all():
            raise self._error("somewhere no material has a share", "give one at least", "range")
        total = np.where(total > 0.0, total, 1.0)
        kept = whole if per_triangle else slice(None)
        parts = {name: (each / total)[kept] for name, each in found.items()}
        object.__setattr__(self, "material", parts)

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of its materials."""
        return (self.material,) if isinstance(self.material, str) else tuple(self.material)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        material: str = "white",
        *,
        unit_mm: float = 1.0,
        smooth_deg: float = SMOOTH_DEG,
    ) -> Mesh:
        """Read PLY, OBJ, STL, VTP, VTK or glTF.

        Parameters
        ----------
        path : path
        material : str
        unit_mm : float
            Millimetres of the file's unit.
        smooth_deg : float
            Edges at which the surface turns by less look smooth.

        Raises
        ------
        MeshError
            If the file cannot be read or has no triangles.
        """
        surface = _read(Path(path))
        try:
            shaded = surface.compute_normals(
                cell_normals=False,
                split_vertices=True,
                feature_angle=smooth_deg,
                consistent_normals=False,
                auto_orient_normals=False,
            )
        except RuntimeError:  # VTK finds no cell with an area; refused by name below
            shaded = surface
        normals = shaded.point_data.get("Normals")
        points = np.asarray(shaded.points, np.float64) * unit_mm
        triangles = shaded.faces.reshape(-1, 4)[:, 1:]
        return cls(points, triangles, material, normals, Path(path).name)

    @classmethod
    def of(cls, surface: pyvista.DataSet, material: str = "white", name: str = "mesh") -> Mesh:
        """Return a pyvista data set's surface, in mm; its point normals, if any, make it smooth.

        Raises MeshError if it has no triangles.
        """
        faces = surface.extract_surface(algorithm=None).triangulate()
        normals = faces.point_data.get("Normals")
        return cls(faces.points, faces.faces.reshape(-1, 4)[:, 1:], material, normals, name)

    def warn_of_unit(self, around_mm: Array) -> None:
        """Warn if the mesh and what it belongs to (N, 3) differ in size as units do."""
        own, other = (float(np.ptp(each, axis=0).max()) for each in (self.points_mm, around_mm))
        ratio = own / max(other, 1e-30)
        if not 1.0 / _UNITS < ratio < _UNITS:
            times = f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:.3g} of"
            text = f"{self.name}: is {times} the volume's size; is unit_mm right?"
            warnings.warn(text, VolspecWarning, stacklevel=2)

    def placed(self, move_mm: ArrayLike, turn_deg: ArrayLike = (0.0, 0.0, 0.0)) -> Mesh:
        """Return the mesh turned about x, then y, then z, and then moved."""
        rotation = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
        normals = None if self.normals is None else self.normals @ rotation.T
        points = self.points_mm @ rotation.T + np.asarray(move_mm, np.float64)
        return replace(self, points_mm=points, normals=normals)


def _read(path: Path) -> pyvista.PolyData:
    """Return a file's triangles."""
    import pyvista

    if path.suffix.lower() not in FILES:
        known = ", ".join(FILES)
        guess = nearest(path.suffix.lower(), FILES)
        raise MeshError(
            f"{path}: not a known format of meshes", f"{guess}known are {known}", code="unsupported"
        )
    if not path.exists():
        raise MeshError(f"{path}: no such file", "check the path", code="not-found")
    with warnings.catch_warnings(), captured_output([]):
        warnings.simplefilter("ignore")  # what is read is checked below
        try:
            read = pyvista.read(path)
            if isinstance(read, pyvista.MultiBlock):
                read = read.combine()
            surface = read.extract_surface(algorithm=None).triangulate()
        except Exception as error:  # of any of VTK's readers
            raise _no_mesh(path) from error
    if not surface.n_cells:
        raise _no_mesh(path)
    return surface


def _no_mesh(path: Path) -> MeshError:
    return MeshError(
        f"{path}: no triangles can be read from it", "give PLY, OBJ, STL or VTP", code="damaged"
    )
