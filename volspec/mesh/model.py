"""A mesh: triangles, their normals and what they are made of.

file, shapes or arrays -> [Mesh] -> caster
"""

from __future__ import annotations

import hashlib
import os
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._extras import require_extra
from volspec._triangles import read_triangles
from volspec.errors import Code, MeshError, VolspecWarning, quote
from volspec.mesh.base_colours import BaseColours, colour_array, file_colours
from volspec.mesh.grating import Grating
from volspec.mesh.texture import Texture

if TYPE_CHECKING:
    import pyvista

Array = NDArray[np.float64]
# Edges are smooth where normals turn by less.
SMOOTH_DEG = 30.0
# A triangle is degenerate if its height is below this part of its longest side.
_MIN_HEIGHT = 1e-7
# Sizes that differ by more look like a wrong unit.
_UNITS = 100.0


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles and what they are made of.

    Parameters
    ----------
    points_mm : (N, 3) array_like
        Points of the volume's world.
    triangles : (T, 3) array_like of int
        Indices of points.
    material : str, {str: (N,) or (T,) array_like}, Texture, (N, 3) or (T, 3) array, or BaseColours
        Name of the material; or the share of each at points, or in triangles, which are divided
        by their sum; or a texture; or sRGB codes at points or in triangles, as of a texture; or
        the colours of a file's materials.
    normals : (N, 3) array_like, optional
        Of smooth edges; if left out, triangles are flat.
    uv : (N, 2) array_like, optional
        Texture coordinates; (0, 0) is the lower left corner. Needed for a texture.
    opacity : float
        Below 1, what is behind shines through, volumes included.
    mirror : float
        Part of the light that is reflected as by a mirror, in which other meshes are seen.
    grating : Grating, optional
        Lines that diffract light.
    name : str
        For messages.
    cut : bool
        Cut by the planes and the crop that cut the volume, instead of whole; it is hollow there.

    Raises
    ------
    MeshError
        If there is no triangle, an index is out of range, or numbers are not finite, shares have
        the wrong size, are negative or all 0; colours do not fit; or a texture has no coordinates.

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
    material: str | Mapping[str, ArrayLike] | Texture | NDArray[Any] | BaseColours = "white"
    normals: Array | None = None
    name: str = "mesh"
    uv: Array | None = None
    opacity: float = 1.0
    mirror: float = 0.0
    grating: Grating | None = None
    cut: bool = False

    def __repr__(self) -> str:
        count = len(self.triangles)
        look = self.material if isinstance(self.material, Texture) else ", ".join(self.materials)
        look = look or "sRGB"
        return f"Mesh({count} triangle{'s' * (count != 1)}, {look})"

    def __post_init__(self) -> None:
        points = self._finite("points_mm", self.points_mm, 3)
        triangles = np.asarray(self.triangles)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or triangles.dtype.kind not in "iu":
            raise self._error(f"triangles have shape {triangles.shape}", "give (T, 3) of int")
        triangles = triangles.astype(np.intp, copy=False)
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(points):
            worst = triangles.max() if triangles.max() >= len(points) else triangles.min()
            raise self._error(f"a triangle has point {worst}", f"there are {len(points)}", "range")
        valid = self._has_area(points[triangles])
        if not valid.any():
            raise self._error("has no triangle with an area", "give a surface", "missing")
        object.__setattr__(self, "points_mm", points)
        object.__setattr__(self, "triangles", triangles if valid.all() else triangles[valid])
        for name, columns in (("normals", 3), ("uv", 2)):
            if (value := getattr(self, name)) is not None:
                array = self._finite(name, value, columns)
                if len(array) != len(points):
                    shape = f"{name} have shape {array.shape}"
                    raise self._error(shape, f"give {(len(points), columns)}")
                object.__setattr__(self, name, array)
        colours = self.material if isinstance(self.material, BaseColours) else None
        textured = isinstance(self.material, Texture) or (colours and any(colours.textures))
        if textured and self.uv is None:
            remedy = "unwrap it where it was made, or give uv"
            raise self._error("has no texture coordinates", remedy, "missing")
        if colours is not None:
            object.__setattr__(self, "material", replace(colours, number=colours.number[valid]))
        elif isinstance(self.material, Mapping):
            object.__setattr__(self, "material", self._fractions(self.material, valid))
        elif isinstance(self.material, np.ndarray):
            object.__setattr__(self, "material", self._colours(self.material, valid))
        elif not isinstance(self.material, str | Texture):
            remedy = "give a name, shares of names, a Texture or an array of colours"
            raise self._error(f"material is {quote(self.material)}", remedy, "type")
        for name, minimum in (("opacity", 1e-3), ("mirror", 0.0)):
            value = getattr(self, name)
            if not minimum <= value <= 1.0:
                raise self._error(f"{name} is {value:g}", "give 0 to 1", "range")
        if empty := int((~valid).sum()):
            text = f"{self.name}: {empty} of its triangles have no area, and are left out"
            warnings.warn(text, VolspecWarning, stacklevel=3)

    def _error(self, problem: str, remedy: str, code: Code = "shape") -> MeshError:
        return MeshError(f"{self.name}: {problem}", remedy, code=code)

    def _finite(self, name: str, values: ArrayLike, columns: int) -> Array:
        array = np.asarray(values, np.float64)
        if array.ndim != 2 or array.shape[1] != columns:
            raise self._error(f"{name} have shape {array.shape}", f"give (N, {columns})")
        if not np.isfinite(array).all():
            row = int((~np.isfinite(array)).any(axis=1).argmax())
            raise self._error(f"{name}: number {row} is not finite", "repair the mesh", "range")
        return array

    @staticmethod
    def _has_area(corners: Array) -> NDArray[np.bool_]:
        a, b, c = corners.transpose(1, 0, 2)
        sides = np.stack([b - a, c - b, a - c])
        longest = (sides**2).sum(axis=2).max(axis=0, initial=0.0)
        twice = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return np.asarray(twice > _MIN_HEIGHT * longest)

    def _fractions(
        self, material: Mapping[str, ArrayLike], valid: NDArray[np.bool_]
    ) -> dict[str, Array]:
        """Return checked shares of materials; triangles without an area are left out."""
        counts = {"points": len(self.points_mm), "triangles": len(valid)}
        arrays = {name: np.asarray(values, np.float64) for name, values in material.items()}
        for name, fractions in arrays.items():
            if fractions.ndim != 1 or len(fractions) not in counts.values():
                sizes = " or ".join(f"{count} ({place})" for place, count in counts.items())
                raise self._error(f"shares of {name} have shape {fractions.shape}", f"give {sizes}")
            if not (fractions >= 0.0).all():
                raise self._error(f"shares of {name} are negative or NaN", "clip them", "range")
        if len({len(part) for part in arrays.values()}) != 1:
            raise self._error("shares of materials differ in size", "give all at points")
        total = np.sum([*arrays.values()], axis=0)
        at_points = len(total) == len(self.points_mm)
        used = np.isin(np.arange(len(total)), self.triangles) if at_points else valid
        if not total[used].all():
            raise self._error("somewhere no material has a share", "give one at least", "range")
        total = np.where(total > 0.0, total, 1.0)
        return {name: (part / total)[... if at_points else valid] for name, part in arrays.items()}

    def _colours(self, array: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.uint16]:
        """Return checked sRGB codes; triangles without an area are left out."""
        at_points = len(array) == len(self.points_mm)
        if array.ndim != 2 or not (at_points or len(array) == len(valid)):
            sizes = f"({len(self.points_mm)}, 3) or ({len(valid)}, 3)"
            raise self._error(f"colours have shape {array.shape}", f"give {sizes}")
        if array.shape[1] == 4:
            text = f"{self.name}: alpha of its colours is left out; opacity is that of the mesh"
            warnings.warn(text, VolspecWarning, stacklevel=4)
            array = array[:, :3]
        codes: NDArray[np.uint16] = Texture(array[None], name=f"{self.name}'s colours").texels[0]
        return codes if at_points else codes[valid]

    @property
    def materials(self) -> tuple[str, ...]:
        """Names of its materials."""
        if isinstance(self.material, Texture):
            return tuple(self.material.materials)
        if isinstance(self.material, np.ndarray | BaseColours):
            return ()
        return (self.material,) if isinstance(self.material, str) else tuple(self.material)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        material: str | Texture = "white",
        *,
        own_colours: bool = False,
        unit_mm: float = 1.0,
        smooth_deg: float = SMOOTH_DEG,
    ) -> Mesh:
        """Read PLY, OBJ, STL, VTP, VTK or glTF, with texture coordinates.

        Parameters
        ----------
        path : path
        material : str or Texture
        own_colours : bool
            Prefer the file's own colours, of its materials, at points or in triangles, where it
            has some.
        unit_mm : float
            Millimetres of the file's unit.
        smooth_deg : float
            Edges at which the surface turns by less look smooth.

        Raises
        ------
        MeshError
            If the file cannot be read or has no triangles, or no coordinates for a texture.
        """
        path = Path(path)
        surface = read_triangles(path, MeshError)
        with suppress(RuntimeError):  # VTK finds no cell with an area; refused by name below
            surface = surface.compute_normals(
                cell_normals=False,
                split_vertices=True,
                feature_angle=smooth_deg,
                consistent_normals=False,
                auto_orient_normals=False,
            )
        colours = file_colours(path, surface) if own_colours else None
        look = material if colours is None else colours
        mesh = cls.of(surface, look, path.name)
        uv, is_gltf = mesh.uv, path.suffix.lower() in (".gltf", ".glb")
        if uv is not None and is_gltf:
            uv = uv * (1.0, -1.0) + (0.0, 1.0)  # from the upper left corner
        return replace(mesh, points_mm=mesh.points_mm * unit_mm, uv=uv)

    @classmethod
    def of(
        cls,
        surface: pyvista.DataSet,
        material: str | Texture | NDArray[Any] | BaseColours = "white",
        name: str = "mesh",
        own_colours: bool = False,
    ) -> Mesh:
        """Return a pyvista data set's surface, in mm; its point normals, if any, make it smooth.

        With ``own_colours`` the data set's colours, if any, replace the material. Raises MeshError
        if it has no triangles.
        """
        faces = surface.extract_surface(algorithm=None).triangulate()
        normals, uv = faces.point_data.get("Normals"), faces.active_texture_coordinates
        triangles = faces.faces.reshape(-1, 4)[:, 1:]
        colours = colour_array(faces) if own_colours else None
        look = material if colours is None else colours
        return cls(faces.points, triangles, look, normals, name, uv)

    def has_surface_of(self, other: Mesh) -> bool:
        """Return True if another mesh has the same arrays, as one made from it by a new look."""
        names = ("points_mm", "triangles", "normals", "uv")
        return all(getattr(self, name) is getattr(other, name) for name in names)

    def digest(self) -> bytes:
        """Return a hash of its arrays and texels."""
        digest = hashlib.blake2b(digest_size=16)
        arrays: list[NDArray[Any] | None]
        arrays = [self.points_mm, self.triangles, self.normals, self.uv]
        if isinstance(self.material, Texture):
            arrays.append(self.material.texels)
        elif isinstance(self.material, np.ndarray):
            arrays.append(self.material)
        elif isinstance(self.material, BaseColours):
            look = self.material
            arrays += [look.factors, look.number, look.linear]
            arrays += [texture.texels for texture in look.textures if texture is not None]
        for array in arrays:
            digest.update(b"" if array is None else np.ascontiguousarray(array).tobytes())
        return digest.digest()

    def warn_of_unit(self, around_mm: Array) -> None:
        """Warn if the mesh and what it belongs to (N, 3) differ in size as units do."""
        size, other = (float(np.ptp(cloud, axis=0).max()) for cloud in (self.points_mm, around_mm))
        ratio = size / max(other, 1e-30)
        if not 1.0 / _UNITS < ratio < _UNITS:
            times = f"{ratio:.3g} times" if ratio > 1.0 else f"1/{1.0 / ratio:.3g} of"
            text = f"{self.name}: is {times} the volume's size; is unit_mm right?"
            warnings.warn(text, VolspecWarning, stacklevel=2)

    def placed(
        self, move_mm: ArrayLike, turn_deg: ArrayLike = (0.0, 0.0, 0.0), scale: float = 1.0
    ) -> Mesh:
        """Return the mesh scaled, turned about x, then y, then z, and then moved.

        ``move_mm`` and ``turn_deg`` are (3,), counter-clockwise as seen from the axis' end.
        """
        from scipy.spatial.transform import Rotation

        rotation = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
        move = np.asarray(move_mm, np.float64)
        normals = None if self.normals is None else self.normals @ rotation.T
        grating = None if self.grating is None else self.grating.placed(scale, rotation, move)
        points = scale * self.points_mm @ rotation.T + move
        return replace(self, points_mm=points, normals=normals, grating=grating)

    def within(self, planes: Array) -> Mesh | None:
        """Return what lies on the positive side of planes (P, 4); None if nothing does.

        A point p, mm, does if n · p ≥ d for a plane (n, d).
        """
        if (self.points_mm @ planes[:, :3].T >= planes[:, 3]).all():
            return self
        require_extra("vtk", f"a cut of mesh {self.name!r}")
        import pyvista
        from vtkmodules.vtkCommonDataModel import vtkNonMergingPointLocator, vtkPlane
        from vtkmodules.vtkFiltersCore import vtkClipPolyData

        faces = pyvista.PolyData.from_regular_faces(self.points_mm, self.triangles)
        looks: dict[str, NDArray[Any] | None] = {"normals": self.normals, "uv": self.uv}
        if isinstance(self.material, Mapping):
            looks |= {f"of {name}": np.asarray(array) for name, array in self.material.items()}
        elif isinstance(self.material, np.ndarray):
            looks["colours"] = self.material
        elif isinstance(self.material, BaseColours):
            looks |= {"colours": self.material.linear, "number": self.material.number}
        for name, array in looks.items():
            if array is not None:
                at_points = len(array) == len(self.points_mm) and name != "number"
                (faces.point_data if at_points else faces.cell_data)[name] = array
        for *normal, offset in planes:
            origin = offset * np.array(normal) / np.dot(normal, normal)
            # Corners that differ in texture coordinates or normals stay apart.
            plane, clip = vtkPlane(), vtkClipPolyData()
            plane.SetOrigin(origin)
            plane.SetNormal(normal)
            clip.SetClipFunction(plane)
            clip.SetLocator(vtkNonMergingPointLocator())
            clip.SetInputData(faces)
            clip.Update()
            faces = pyvista.wrap(clip.GetOutput()).triangulate()
            if faces.n_cells == 0:
                return None
        corners = faces.regular_faces
        valid = self._has_area(np.asarray(faces.points)[corners])
        if not valid.any():
            return None

        def clipped(name: str) -> Array:
            values = faces.point_data.get(name)
            return np.asarray(faces.cell_data[name][valid] if values is None else values)

        changes: dict[str, Any] = {n: clipped(n) for n in ("normals", "uv") if looks[n] is not None}
        if isinstance(self.material, Mapping):
            changes["material"] = {name: clipped(f"of {name}") for name in self.material}
        elif isinstance(self.material, np.ndarray):
            changes["material"] = clipped("colours")
        elif isinstance(self.material, BaseColours):
            linear = None if self.material.linear is None else clipped("colours")
            number = np.asarray(clipped("number"), np.intp)
            changes["material"] = replace(self.material, number=number, linear=linear)
        points = np.asarray(faces.points)
        return replace(self, points_mm=points, triangles=corners[valid], **changes)
