"""Textures of meshes: materials or colours by texture coordinates.

image files, arrays -> [texture] -> channels of texels, at every size -> caster

Texels of an RGB texture get the reflectances of reference [1] under D65: they are constructed for
a lattice over the cube of sRGB codes, kept in the cache, and interpolated between.

References
----------
[1] Wang, Xu & Sun (2004), "Practical Construction of Reflectances for Spectral Rendering".
[2] Williams (1983), "Pyramidal parametrics", SIGGRAPH '83. doi:10.1145/800059.801126
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._cache import cached_arrays
from volspec._gpu import Compute, assemble, prelude
from volspec.appearance.display import sRGB_CURVE
from volspec.basis import Basis, SpectralBasis
from volspec.errors import Code, MeshError
from volspec.mesh.pictures import P3, P3_FROM_sRGB, read_colours, read_picture
from volspec.spectra import SpectralGrid, Spectrum, light, reflectances_from_colours, white_XYZ
from volspec.spectra.construct import XYZ_from_linear_sRGB, XYZ_from_sRGB

Array = NDArray[np.float64]
Texels = NDArray[np.float16]
SIDE, P3_SIDE = 33, 17
"""Nodes along each side of the lattice of colours: of sRGB, and of Display P3."""
_MAX_CODE = 65535
# Version of the lattice's reflectances in the cache.
_MAKER = "delaunay D65 1"
_MAX_TEXELS = 2**28
_GROUP = 64


@dataclass(frozen=True, eq=False)
class Texture:
    """Materials or colours over texture coordinates; (0, 0) is the lower left corner.

    Parameters
    ----------
    texels : (H, W) array_like of int, (H, W, K) or (H, W, 3) array_like
        Numbers of materials; or the share of each of K materials, which are divided by their sum;
        or without materials, sRGB codes: 8 or 16 bits, or 0 to 1. The first row is the top.
    materials : sequence of str
        Names.
    name : str
        For messages.
    is_p3 : bool
        Codes are of Display P3 instead of sRGB.

    Raises
    ------
    MeshError
        If the shape is another, a number names no material, shares are negative or all 0,
        or codes are out of range.

    Examples
    --------
    >>> Texture([[0, 1], [1, 0]], ("copper", "gold"))
    Texture(2 x 2, copper, gold)
    """

    texels: NDArray[Any]
    materials: Sequence[str] = ()
    name: str = "texture"
    is_p3: bool = False

    def __repr__(self) -> str:
        height, width = self.texels.shape[:2]
        codes = "Display P3" if self.is_p3 else "sRGB"
        return f"Texture({width} x {height}, {', '.join(self.materials) or codes})"

    def __post_init__(self) -> None:
        texels = np.asarray(self.texels)
        object.__setattr__(self, "materials", tuple(self.materials))
        if texels.ndim not in (2, 3) or not texels.size:
            raise self._error(f"texels have shape {texels.shape}", "give (H, W) or (H, W, K)")
        if texels.shape[0] * texels.shape[1] > _MAX_TEXELS:
            raise self._error(f"texels have shape {texels.shape}", "give up to 16384²", "size")
        if not self.materials:
            texels = self._codes(texels)
        elif texels.ndim == 2:
            texels = self._numbers(texels)
        else:
            texels = self._fractions(texels)
        object.__setattr__(self, "texels", texels)

    def _error(self, problem: str, remedy: str, code: Code = "shape") -> MeshError:
        return MeshError(f"{self.name}: {problem}", remedy, code=code)

    def _codes(self, texels: NDArray[Any]) -> NDArray[np.uint16]:
        """Return sRGB codes of 16 bits."""
        if texels.ndim == 2:
            texels = np.repeat(texels[..., None], 3, axis=2)
        if texels.shape[2] == 4:
            opaque = np.iinfo(texels.dtype).max if texels.dtype.kind == "u" else 1.0
            if (texels[..., 3] != opaque).any():
                remedy = "paint it on a background, and use the mesh's opacity"
                raise self._error("has transparent texels", remedy, "unsupported")
            texels = texels[..., :3]
        if texels.shape[2] != 3:
            raise self._error(f"texels have shape {texels.shape}", "give (H, W, 3)")
        if texels.dtype == np.uint8:
            return texels.astype(np.uint16) * np.uint16(257)
        if texels.dtype == np.uint16:
            return np.ascontiguousarray(texels)
        if texels.dtype.kind != "f":
            raise self._error(f"texels are {texels.dtype}", "give uint8, uint16 or 0 to 1", "type")
        if not ((texels >= 0.0) & (texels <= 1.0)).all():
            raise self._error("has codes that are not within 0 to 1", "divide them", "range")
        return np.rint(texels * _MAX_CODE).astype(np.uint16)

    def _numbers(self, texels: NDArray[Any]) -> NDArray[np.intp]:
        if texels.dtype.kind not in "iub":
            raise self._error(f"numbers of materials are {texels.dtype}", "give integers", "type")
        low, high = int(texels.min()), int(texels.max())
        if low < 0 or high >= len(self.materials):
            choices = f"0 to {len(self.materials) - 1} are {', '.join(self.materials)}"
            raise self._error(f"has the number {low if low < 0 else high}", choices, "range")
        return texels.astype(np.intp)

    def _fractions(self, texels: NDArray[Any]) -> NDArray[np.float32]:
        if texels.shape[2] != len(self.materials):
            raise self._error(
                f"texels have shape {texels.shape}", f"give (H, W, {len(self.materials)})"
            )
        fractions = texels.astype(np.float32)
        if not (fractions >= 0.0).all():
            raise self._error("shares are negative or NaN", "clip them", "range")
        total = fractions.sum(axis=2, keepdims=True)
        if not total.all():
            raise self._error("somewhere no material has a share", "give one at least", "range")
        return fractions / total

    def linear(self) -> Texels:
        """Return linear sRGB (H, W, 3) of codes, beyond 0 to 1 if they are of Display P3."""
        linear = sRGB_CURVE.decode(np.arange(_MAX_CODE + 1) / _MAX_CODE).astype(np.float32)
        texels = linear[self.texels]
        return (texels @ np.linalg.inv(P3_FROM_sRGB).T if self.is_p3 else texels).astype(np.float16)

    @classmethod
    def load(cls, path: str | Path, materials: Sequence[str] = ()) -> Texture:
        """Read PNG, JPEG, TIFF or BMP: colours of any profile, or numbers of materials as greys.

        Raises MeshError if the file cannot be read or does not fit.
        """
        name = Path(path).name
        if not materials:
            codes, is_p3 = read_colours(Path(path))
            return cls(codes, (), name, is_p3)
        texels, _ = read_picture(Path(path))
        if texels.ndim == 3:
            raise MeshError(
                f"{name}: has {texels.shape[2]} channels",
                "numbers of materials are grey values; leave out materials for colours",
                code="shape",
            )
        return cls(texels, materials, name)

    @classmethod
    def load_shares(cls, files: Mapping[str, str | Path]) -> Texture:
        """Read the share of each material, {name: file}, from grey values.

        Raises MeshError if a file cannot be read, has colours, or their sizes differ.
        """
        arrays: dict[str, NDArray[Any]] = {}
        for name, path in files.items():
            grey, _ = read_picture(Path(path))
            if grey.ndim != 2:
                channels = f"{path}: has {grey.shape[2]} channels"
                raise MeshError(channels, "shares are grey values", code="shape")
            if arrays and (first := next(iter(arrays.values()))).shape != grey.shape:
                sizes = " and ".join(f"{w} x {h}" for h, w in (first.shape, grey.shape))
                problem = f"{path}: textures of a mesh have {sizes} texels"
                raise MeshError(problem, "give all the same size", code="shape")
            arrays[name] = grey / (np.iinfo(grey.dtype).max if grey.dtype.kind == "u" else 1.0)
        return cls(np.stack([*arrays.values()], axis=2), tuple(arrays), ", ".join(map(str, arrays)))


def reflectance_lattice(grid: SpectralGrid, is_p3: bool = False) -> NDArray[np.float32]:
    """Return reflectances (S, S, S, N) of evenly spaced codes under D65 [1].

    The codes are of sRGB, or of Display P3. The first call takes seconds; then they are
    in the cache.
    """
    key = hashlib.sha256(grid.wavelengths_nm.tobytes()).hexdigest()[:16]

    def make() -> dict[str, NDArray[np.float32]]:
        codes = np.linspace(0.0, 1.0, P3_SIDE if is_p3 else SIDE)
        cube = np.stack(np.meshgrid(codes, codes, codes, indexing="ij"), axis=3)
        white = white_XYZ(light("D65", grid))
        colours = XYZ_from_sRGB(cube, white)
        if is_p3:
            matrix = XYZ_from_linear_sRGB(white) @ np.linalg.inv(P3_FROM_sRGB)
            colours = np.maximum(P3.decode(cube) @ matrix.T, 0.0)
        spectra = reflectances_from_colours(colours, grid=grid)
        return {"reflectances": spectra.values.astype(np.float32)}

    return cached_arrays(f"spectra/{'p3' if is_p3 else 'rgb'}-{key}", _MAKER, make)["reflectances"]


def some_colours(grid: SpectralGrid) -> dict[str, Spectrum]:
    """Return reflectances of 27 colours all over the cube of sRGB, by their codes."""
    step = (SIDE - 1) // 2
    nodes = reflectance_lattice(grid)[::step, ::step, ::step]
    return {
        f"sRGB {', '.join(f'{50 * k}' for k in place)} %": Spectrum(
            grid.wavelengths_nm, nodes[place].astype(np.float64)
        )
        for place in np.ndindex(3, 3, 3)
    }


def channel_lattice(basis: Basis, name: str, is_p3: bool = False) -> NDArray[np.float32]:
    """Return the channels (S, S, S, M) of `reflectance_lattice`.

    Raises MeshError if a basis of materials is given; ``name`` is the texture's.
    """
    if not isinstance(basis, SpectralBasis):
        remedy = "give it a material, or use a spectral basis"
        raise MeshError(f"{name}: a basis of materials has no colours", remedy, code="conflict")
    return basis.analyse(reflectance_lattice(basis.grid, is_p3)).astype(np.float32)


def interpolate(lattice: NDArray[np.float32], codes: NDArray[np.uint16]) -> Texels:
    """Return channels (P, M) of sRGB codes (P, 3), between the nodes of a lattice (S, S, S, M)."""
    side = len(lattice)
    positions = codes * np.float32((side - 1) / _MAX_CODE)
    cell = np.minimum(positions.astype(np.intp), side - 2)
    high = positions - cell
    channels = np.zeros((len(codes), lattice.shape[-1]), np.float32)
    for far in np.ndindex(2, 2, 2):
        weight = np.where(far, high, 1.0 - high).prod(axis=1)
        channels += weight[:, None].astype(np.float32) * lattice[tuple((cell + far).T)]
    return channels.astype(np.float16)


def interpolate_on_device(
    lattice: NDArray[np.float32], codes: NDArray[np.uint16], device: str | None = None
) -> Texels:
    """Return the same by kernels/colour_lattice.cl, to the rounding of half-floats.

    Raises OpenCLError if there is no device or not enough memory.
    """
    compute = Compute.open(device)
    side, channels = lattice.shape[0], lattice.shape[3]
    vectors = -(-channels // 4)
    nodes = np.pad(lattice, (*[(0, 0)] * 3, (0, 4 * vectors - channels)))
    constants = prelude({"SIDE": side, "VECTORS": vectors}, "opencl")
    kernel = compute.kernel(assemble("kernels/colour_lattice.cl", constants), "interpolate")
    values = np.empty((len(codes), 4 * vectors), np.float16)
    compute.require(2 * values.nbytes + codes.nbytes, "a texture", "give a smaller one")
    out = compute.output(values.nbytes, values)
    inputs = compute.upload(codes, share=True), compute.upload(nodes)
    items = -(-len(codes) // _GROUP) * _GROUP
    kernel(compute.queue, (items,), (_GROUP,), *inputs, out, np.uint32(len(codes)))
    compute.download(out, values)
    return values[:, :channels]


def pyramid(texels: Texels) -> list[Texels]:
    """Return texels (H, W, M) and their means at half the size, a quarter and so on, to 1 x 1."""
    levels = [texels]
    while max(levels[-1].shape[:2]) > 1:
        last = levels[-1]
        height, width = last.shape[:2]
        odd = [(0, side % 2 * (side > 1)) for side in (height, width)]
        mean: NDArray[Any] = np.pad(last, (*odd, (0, 0)), "edge").astype(np.float32)
        if height > 1:
            mean = 0.5 * (mean[::2] + mean[1::2])
        if width > 1:
            mean = 0.5 * (mean[:, ::2] + mean[:, 1::2])
        levels.append(mean.astype(np.float16))
    return levels


def sample(levels: Sequence[Texels], uv: Array, texels_wide: Array) -> NDArray[np.float32]:
    """Return channels (K, M) at texture coordinates (K, 2), which repeat [2].

    ``texels_wide`` (K,) is the width of a pixel's footprint, in texels: the mean over so many is
    interpolated between two levels, and within them linearly.
    """
    level = np.log2(np.clip(texels_wide, 1.0, 2.0 ** (len(levels) - 1)))
    below = np.floor(level).astype(np.intp)
    part = level - below
    channels = np.zeros((len(uv), levels[0].shape[2]), np.float32)
    for number in np.unique(np.concatenate([below, below + 1])):
        weight = np.where(below == number, 1.0 - part, np.where(below + 1 == number, part, 0.0))
        rows = np.flatnonzero(weight)
        if rows.size:
            texels = _bilinear(levels[number], uv[rows])
            channels[rows] += weight[rows, None].astype(np.float32) * texels
    return channels


def _bilinear(texels: Texels, uv: Array) -> NDArray[np.float32]:
    height, width = texels.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1.0 - uv[:, 1]) * height - 0.5
    column, row = np.floor(x).astype(np.intp), np.floor(y).astype(np.intp)
    right, low = ((u - cell).astype(np.float32)[:, None] for u, cell in ((x, column), (y, row)))
    flat = texels.reshape(height * width, -1)

    def texel(dx: int, dy: int) -> NDArray[np.float16]:
        return flat[(row + dy) % height * width + (column + dx) % width]

    upper = (1.0 - right) * texel(0, 0) + right * texel(1, 0)
    lower = (1.0 - right) * texel(0, 1) + right * texel(1, 1)
    return (1.0 - low) * upper + low * lower
