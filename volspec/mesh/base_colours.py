"""Base colours of meshes' files: of materials in MTL and glTF, or at points and in triangles.

OBJ and its MTL, glTF, arrays -> [base_colours] -> codes, or factors and textures -> Mesh

References
----------
[1] Khronos Group (2021), glTF 2.0: 3.9.2 base colours, whose factor is linear light and whose
    texture sRGB, whatever its profile says (3.8.3); both are white by default.
[2] Ramey, Rose & Tyerman (1995), MTL material format: Kd, map_Kd.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec.appearance.display import sRGB_CURVE
from volspec.errors import MeshError, VolspecWarning
from volspec.mesh.pictures import read_colours
from volspec.mesh.texture import Texture

Array = NDArray[np.float64]
# Arrays of colours, as files name them, in lower case.
_NAMES = ("rgb", "rgba", "color", "colors", "colour", "colours", "color_0")
# An option of map_Kd, before the file's name.
_OPTION = re.compile(r"-\w+(\s+(on|off|[rgbmlz]|[-+.\d]\S*))*\s+")
_WHITE = np.ones(3)


@dataclass(frozen=True, slots=True, eq=False)
class BaseColours:
    """Base colours of a surface of several materials: products in linear sRGB."""

    factors: Array
    """(G, 3), of materials."""
    textures: Sequence[Texture | None]
    """Base colours of the materials as pictures; None where there is no picture."""
    number: NDArray[np.intp]
    """(T,): the triangles' materials."""
    linear: Array | None = None
    """(N, 3), at points."""


def colour_array(data_set: Any) -> NDArray[Any] | None:
    """Return the colours (N, C) at points, or (T, C) in triangles, of a pyvista data set."""
    for data in (data_set.point_data, data_set.cell_data):
        for name, array in data.items():
            if name.lower() in _NAMES:
                return np.asarray(array)
    return None


def file_colours(path: Path, surface: Any) -> NDArray[Any] | BaseColours | None:
    """Return the colours that a mesh's file has for its triangles; None if it has none.

    ``surface`` is what `read_triangles` returns. Raises MeshError if a picture or an MTL cannot be
    used. Warns of materials and pictures that are missing.
    """
    colours, linear = colour_array(surface), None
    if "Factors" in surface.field_data:
        linear = None if colours is None else np.clip(colours, 0.0, 1.0).astype(np.float64)
        factors, textures = _of_gltf(path, surface.field_data)
    else:
        factors, textures = _of_obj(path, surface.field_data)
        if not len(factors):
            return colours
        if colours is not None:  # in place of Kd
            linear = sRGB_CURVE.decode(Texture(colours[None], name=path.name).texels[0] / 65535.0)
            factors = np.ones_like(factors)
    if len(factors) == 1 and textures[0] is None:
        points = np.ones((surface.n_points, 3)) if linear is None else linear
        return sRGB_CURVE.encode(points * factors[0])
    number = np.asarray(surface.cell_data["MaterialIds"], np.intp)
    return BaseColours(factors, textures, number, linear)


def _of_gltf(path: Path, fields: Mapping[str, Any]) -> tuple[Array, list[Texture | None]]:
    """Return factors and textures of a glTF's parts."""
    numbers = fields["Pictures"].tolist()
    textures: dict[int, Texture | None] = {-1: None}
    for number in {*numbers} - {-1}:
        texels = np.asarray(fields[f"Picture {number}"])
        width = int(fields[f"Width {number}"][0])
        texels = texels.reshape(-1, width, *texels.shape[1:])[::-1]
        textures[number] = Texture(_without_alpha(texels), name=f"{path.name}, texture {number}")
    factors = np.clip(np.asarray(fields["Factors"], np.float64), 0.0, 1.0)
    return factors, [textures[number] for number in numbers]


def _of_obj(path: Path, fields: Mapping[str, Any]) -> tuple[Array, list[Texture | None]]:
    """Return factors and textures of an OBJ's materials, none without an MTL."""
    factors, textures = dict[str, Array](), dict[str, Texture]()
    names = [str(name) for name in fields.get("MaterialNames", ())]
    for line in _lines(path) if names else ():
        if line[0] != "mtllib":
            continue
        library = path.parent / line[1].replace("\\", "/")
        require_inside(library, MeshError)
        if library.is_file():
            _read_mtl(library, factors, textures)
        else:
            _warn(f"{path.name}: its file of materials, {line[1]}, is missing")
            names = []
    if unknown := ", ".join(repr(name) for name in names if name not in (*factors, "NO_MATERIAL")):
        _warn(f"{path.name}: material {unknown} is not in its MTL; it is white")
    rows = [factors.get(name, _WHITE) for name in names]
    return np.array(rows), [textures.get(name) for name in names]


def _read_mtl(path: Path, factors: dict[str, Array], textures: dict[str, Texture]) -> None:
    """Add the materials of an MTL, by the first word of their names, as VTK has them."""
    name = ""
    for key, value in _lines(path):
        if key == "newmtl":
            name = value.partition(" ")[0]
            factors[name] = _WHITE
        elif key == "kd":  # sRGB codes by custom; [2] does not say
            try:
                codes = np.clip(np.array(value.split()[:3], float), 0.0, 1.0) * _WHITE
            except ValueError as error:
                problem = f"{path}: Kd of {name!r} is {value!r}"
                remedy = "give three numbers from 0 to 1"
                raise MeshError(problem, remedy, code="damaged") from error
            factors[name] = sRGB_CURVE.decode(np.nan_to_num(codes))
        elif key == "map_kd":
            picture = path.parent / _OPTION.sub("", value).replace("\\", "/")
            require_inside(picture, MeshError)
            if re.search(r"-[sot]\s", value):
                _warn(f"{path.name}: shifts and scales of {name!r}'s picture are left out")
            if picture.is_file():
                texels, is_p3 = read_colours(picture)
                textures[name] = Texture(_without_alpha(texels), (), str(picture), is_p3)
            else:
                _warn(f"{path.name}: the picture of {name!r}, {picture}, is missing; Kd alone")


def _lines(path: Path) -> list[tuple[str, str]]:
    """Return the lines of an OBJ or MTL: a key, in MTL in lower case, and the rest."""
    text = path.read_bytes().decode("utf-8", "replace")
    pairs = re.findall(r"^[ \t]*(mtllib|newmtl|map_Kd|Kd)[ \t]+(.*\S)", text, re.M | re.I)
    return [(key.lower(), value) for key, value in pairs]


def _without_alpha(texels: NDArray[Any]) -> NDArray[Any]:
    """Return texels (H, W) or (H, W, 3)."""
    if texels.ndim == 2:
        return texels
    return texels[..., 0] if texels.shape[2] < 3 else texels[..., :3]


def _warn(text: str) -> None:
    warnings.warn(text, VolspecWarning, stacklevel=4)
