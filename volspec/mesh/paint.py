"""Reflectances at points of a mesh, in channels: of materials, of their shares, of textures.

mesh, reflectances, basis -> [paint] -> caster
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.display import sRGB_CURVE, to_uint16
from volspec.basis import Basis
from volspec.errors import MeshError, nearest
from volspec.mesh.base_colours import BaseColours
from volspec.mesh.model import Mesh
from volspec.mesh.pictures import P3_FROM_sRGB
from volspec.mesh.texture import (
    Texels,
    Texture,
    channel_lattice,
    interpolate,
    interpolate_on_device,
    pyramid,
    sample,
)
from volspec.spectra import Spectrum

Array = NDArray[np.float64]
Paint = Callable[[NDArray[np.intp], Array, Array], Array]
"""(K,) triangles, (K, 3) weights of their corners and (K,) widths in mm -> channels (K, M)."""


def mesh_paint(mesh: Mesh, materials: Mapping[str, Spectrum], basis: Basis) -> Paint:
    """Return a function of points that returns the channels of what the mesh is made of.

    Raises MeshError if a material is unknown, or a texture's colours do not fit the basis.
    """
    channels = {name: _channels(mesh, name, materials, basis) for name in mesh.materials}
    if isinstance(mesh.material, Texture):
        return _texture_paint(mesh, pyramid(texel_channels(mesh.material, channels, basis)))
    if isinstance(mesh.material, BaseColours):
        return _base_colour_paint(mesh, mesh.material, basis)
    if isinstance(mesh.material, str):
        only = channels[mesh.material]
        return lambda triangle, weights, width_mm: np.tile(only, (len(triangle), 1))
    if isinstance(mesh.material, np.ndarray):
        lattice = channel_lattice(basis, mesh.name)
        values = interpolate_on_device(lattice, mesh.material).astype(np.float64)
    else:
        parts = {name: np.asarray(array, np.float64) for name, array in mesh.material.items()}
        values = np.sum([parts[name][:, None] * channels[name] for name in parts], axis=0)

    def mixed(triangle: NDArray[np.intp], weights: Array, width_mm: Array) -> Array:
        if len(values) != len(mesh.points_mm):
            return np.asarray(values[triangle])
        return np.einsum("ki,kim->km", weights, values[mesh.triangles[triangle]])

    return mixed


def texel_channels(texture: Texture, channels: Mapping[str, Array], basis: Basis) -> Texels:
    """Return the channels (H, W, M) of a texture's texels; ``channels`` are its materials'."""
    if not texture.materials:
        codes = texture.texels.reshape(-1, 3)
        lattice = channel_lattice(basis, texture.name, texture.is_p3)
        values = interpolate_on_device(lattice, codes)
        return values.reshape(*texture.texels.shape[:2], basis.size)
    table = np.array([channels[name] for name in texture.materials])
    if texture.texels.ndim == 2:
        return table.astype(np.float16)[texture.texels]
    return (texture.texels @ table.astype(np.float32)).astype(np.float16)


def _texture_paint(mesh: Mesh, levels: list[Texels]) -> Paint:
    assert mesh.uv is not None
    uv = mesh.uv[mesh.triangles]
    a, b, c = mesh.points_mm[mesh.triangles].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    (du, dv), (eu, ev) = (uv[:, 1] - uv[:, 0]).T, (uv[:, 2] - uv[:, 0]).T
    texels = levels[0].shape[0] * levels[0].shape[1] * np.abs(du * ev - dv * eu)
    per_mm = np.sqrt(texels / np.maximum(area, 1e-30))

    def textured(triangle: NDArray[np.intp], weights: Array, width_mm: Array) -> Array:
        coords = np.einsum("ki,kic->kc", weights, uv[triangle])
        return sample(levels, coords, width_mm * per_mm[triangle]).astype(np.float64)

    return textured


def _base_colour_paint(mesh: Mesh, colours: BaseColours, basis: Basis) -> Paint:
    """Return a function of points: linear light of factors, textures and points is multiplied."""
    is_p3 = any(texture is not None and texture.is_p3 for texture in colours.textures)
    lattice = channel_lattice(basis, mesh.name, is_p3)
    textures = [*dict.fromkeys(colours.textures)]
    paints = [t if t is None else _texture_paint(mesh, pyramid(t.linear())) for t in textures]
    textured = np.array([textures.index(t) for t in colours.textures])

    def coloured(triangle: NDArray[np.intp], weights: Array, width_mm: Array) -> Array:
        numbers = colours.number[triangle]
        linear = colours.factors[numbers]
        if colours.linear is not None:
            corners = colours.linear[mesh.triangles[triangle]]
            linear *= np.einsum("ki,kic->kc", weights, corners)
        for number, paint in enumerate(paints):
            rows = np.flatnonzero(textured[numbers] == number)
            if paint is not None:
                linear[rows] *= paint(triangle[rows], weights[rows], width_mm[rows])
        linear = linear @ P3_FROM_sRGB.T if is_p3 else linear
        codes = to_uint16(sRGB_CURVE.encode(linear))
        return interpolate(lattice, codes).astype(np.float64)

    return coloured


def _channels(mesh: Mesh, name: str, materials: Mapping[str, Spectrum], basis: Basis) -> Array:
    """Return the channels (M,) of a material."""
    if name not in materials:
        raise MeshError(
            f"{mesh.name}: no material is named {name!r}",
            f"{nearest(name, materials)}there is {', '.join(materials) or 'none'}",
            code="unknown",
        )
    return basis.channels_for_materials({name: materials[name]})[0]
