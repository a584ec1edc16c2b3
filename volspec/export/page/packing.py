"""Pack a view's channels and its layers of opacity for a page: quantise, predict, deflate.

CoefficientImage, OpacityLayers -> [packing] -> bytes -> web/channels.js
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.image import CoefficientImage, OpacityLayers, Slot
from volspec.relight import are_filled, clamp_finite, layer_extents, layer_slots, shadow_constants

Codes = NDArray[np.integer[Any]]

# Codes of a shade of 1 and of a highlight of 1: finer ones cost more bytes than they save error
# (docs/layers.md). Depths have all 255.
_SHADE_CODES, _GLOSS_CODES = 127, 48
# Optical depth that hides what is behind it also at the least scale but 0 of a page, 1/8.
_MAX_TAU = 32.0


@dataclass(frozen=True, slots=True)
class PackedView:
    """Channels of a view in a page, or sent to one."""

    # Deflated residuals, plane by plane; above 8 bits, high bytes before low bytes.
    data: bytes
    size: tuple[int, int]
    # Roots of the least and the greatest value of each plane; opacity is the last plane.
    low: tuple[float, ...]
    high: tuple[float, ...]

    @property
    def text(self) -> str:
        """The data in base64."""
        return base64.b64encode(self.data).decode("ascii")

    def numbers(self) -> dict[str, Any]:
        """Return what unpacking takes besides the data, for JSON."""
        width, height = self.size
        return {"width": width, "height": height, "low": self.low, "high": self.high}


def pack_view(image: CoefficientImage, bits: int) -> PackedView:
    """Quantise an image's channels and opacity to 8 to 12 bits, predict, and deflate.

    A channel's value v is the signed square of a root, root = low + code (high - low) / (2^bits -
    1): steps are finest near black, where differences are most visible. A plane of codes is
    replaced by its difference from the previous channel, as channels of a spectrum are similar;
    that in turn is written as its difference from the prediction by its neighbours (the median of
    west, north and west + north - corner). Measured on the engine: docs/page.md.
    """
    alpha = clamp_finite(np.asarray(image.alpha, np.float32))
    coefficients = clamp_finite(np.asarray(image.coefficients, np.float32))
    planes = np.concatenate([coefficients, alpha[..., None]], axis=-1)
    roots = np.copysign(np.sqrt(np.abs(planes)), planes)
    low, high = roots.min(axis=(0, 1)), roots.max(axis=(0, 1))
    steps = np.where(high > low, (high - low) / (2**bits - 1), 1.0)
    codes = np.rint((roots - low) / steps).astype(np.int32)
    data = _deflate_bytes(residual_bytes(codes, bits))
    return PackedView(data, image.size, tuple(low.tolist()), tuple(high.tolist()))


@dataclass(frozen=True, slots=True)
class PackedLayers:
    """Layers of opacity of a view in a page.

    ``data`` are deflated residuals, plane by plane: each number of a layer, as
    shaders/recompose.frag counts them, in all layers. ``present`` is true of those of the K
    materials that have opacity; ``tau``, ``shade``, ``gloss``, ``path`` and ``bend`` (these of the
    ``shadows``), ``begin`` and ``width`` (from ``nearest`` on, mm) are the values of a texel of 1;
    ``surface`` is that of the begin of surfaces, in both bytes.
    """

    data: bytes
    count: int
    present: tuple[bool, ...]
    groups: int
    tau: float
    shade: float
    gloss: float
    nearest: float
    begin: float
    width: float
    shadows: tuple[Slot, ...] = ()
    path: float = 1.0
    bend: float = 1.0
    solid: bool = False
    filled: bool = False
    surface: float = 1.0

    @property
    def text(self) -> str:
        """The data in base64."""
        return base64.b64encode(self.data).decode("ascii")

    def constants(self) -> dict[str, float]:
        """Return the constants compiled into shaders/recompose.frag."""
        materials = len(self.present)
        return {
            **shadow_constants(materials, self.groups, self.shadows),
            "COUNT": self.count,
            "SOLID": int(self.solid),
            "FILLED": int(self.filled),
            "MATERIALS": materials,
            "GROUPS": self.groups,
            "TEXELS": layer_slots(materials, self.groups, len(self.shadows), extents=True)[1],
            "CODED": 1,
            "BEGIN_CODE": self.begin,
            "SURFACE_CODE": self.surface,
            "WIDTH_CODE": self.width,
            "TAU_CODE": self.tau,
            "PATH_CODE": self.path,
            "BEND_CODE": self.bend,
        }

    def numbers(self) -> dict[str, Any]:
        """Return what unpacking takes besides the data, for JSON."""
        slots, texels = layer_slots(len(self.present), self.groups, len(self.shadows), extents=True)
        return {
            "count": self.count,
            "slots": slots,
            "texels": texels,
            "present": self.present,
            "shade": self.shade,
            "gloss": self.gloss,
            "nearest_mm": self.nearest,
            "begin_mm": self.begin,
            "width_mm": self.width,
            "surface_mm": self.surface if self.solid else 0.0,
        }


def layer_bytes(layers: OpacityLayers) -> int:
    """Return the bytes of a page's texture of layers."""
    height, width, count, materials = layers.tau.shape
    texels = layer_slots(materials, layers.groups, len(layers.slots), extents=True)[1]
    return 4 * height * width * count * texels


def pack_layers(layers: OpacityLayers) -> PackedLayers:
    """Quantise layers of opacity to up to 8 bits a number, predict, and deflate.

    Codes c of a number from 0 to 1: τ ∝ c³, shade ∝ c, highlight ∝ c², and of shadows E ∝ c³,
    b ∝ c³, parts c; a slab's begin ∝ c, width ∝ c². Neighbouring layers are not similar enough to
    predict each other; a plane is predicted by its neighbouring pixels.
    Shades of absent materials and highlights of unused layers repeat the pixel to their left.
    """
    extents, nearest = layer_extents(layers)
    arrays = layers.tau, layers.shade, layers.gloss, extents, *map(layers.slot, layers.slots)
    tau, shade, gloss, extents, *casts = (
        clamp_finite(np.asarray(array, np.float32)) for array in arrays
    )
    total = tau.sum(axis=-1, keepdims=True)
    tau *= _MAX_TAU / np.maximum(total, _MAX_TAU)
    tau_codes, most_tau = _encode_roots(tau, 255, 3)
    visible: NDArray[np.bool_] = tau_codes > 0
    fading = visible[:, :, : layers.count - layers.solid]
    used: NDArray[np.bool_] = np.any(visible, axis=-1)
    shade_codes, most_shade = _encode_roots(shade * visible[:, :, :, None], _SHADE_CODES, 1)
    gloss_codes, most_gloss = _encode_roots(gloss * used[..., None], _GLOSS_CODES, 2)
    shade_codes = _coarsen_codes(shade_codes, tau[:, :, :, None])
    gloss_codes = _coarsen_codes(gloss_codes, tau.sum(axis=-1)[..., None])
    planes = [tau_codes[..., k] for k in range(layers.materials)]
    for g in range(layers.groups):
        for k in range(layers.materials):
            planes.append(_fill_absent(shade_codes[..., g, k], visible[..., k]))
    planes += [_fill_absent(gloss_codes[..., g], used) for g in range(layers.groups)]
    # A light reaches far; what is darker than by this depth is black also at the least scale.
    paths = [np.minimum(array[..., 3:], _MAX_TAU) for array in casts]
    path = max((float(array.max(initial=0)) for array in paths), default=1.0) or 1.0
    bend = max((float(array[..., 2].max(initial=0)) for array in casts), default=1.0) or 1.0
    for cast, depths in zip(casts, paths, strict=True):
        roots = np.cbrt(depths / path), cast[..., :2], np.cbrt(cast[..., 2:3] / bend)
        codes = np.rint(255 * np.concatenate(roots, axis=-1).clip(0, 1)).astype(np.int32)
        planes += [_fill_absent(codes[..., n], used) for n in range(codes.shape[-1])]
    slabs = np.s_[:, :, : layers.count - layers.solid]
    begin_codes, begin = _encode_roots((extents[..., 0] * used)[slabs], 255, 1)
    width_codes, width = _encode_roots((extents[..., 1] * used)[slabs], 255, 2)
    width_codes = width_codes // 2 * 2  # even: a slab's width matters only where it is cut
    surface = 1.0
    if layers.solid:
        # Floors reach far, and have no width: two bytes of their distance.
        far = extents[:, :, -1:, 0] * used[:, :, -1:]
        surface = float(far.max(initial=0)) or 1.0
        codes = np.rint(65535 * far / surface).astype(np.int32)
        begin_codes = np.concatenate([begin_codes, codes >> 8], axis=2)
        width_codes = np.concatenate([width_codes, codes & 255], axis=2)
    planes += [_fill_absent(codes, used) for codes in (begin_codes, width_codes)]
    parts = [residual_bytes(p[..., [i]], 8) for p in planes for i in range(layers.count)]
    return PackedLayers(
        _deflate_bytes(b"".join(parts)),
        layers.count,
        tuple(bool(fading[..., k].any()) for k in range(layers.materials)),
        layers.groups,
        most_tau,
        most_shade,
        most_gloss,
        nearest,
        begin,
        width,
        tuple(layers.slots),
        path,
        bend,
        layers.solid,
        are_filled(used, layers.solid),
        surface,
    )


def _encode_roots(values: NDArray[np.float32], codes: int, root: int) -> tuple[Codes, float]:
    """Return codes of values' roots, and the value of code 255.

    A value of 1 has code ``codes``, or less if 255 were not enough for the greatest value; the
    greatest has 255 if ``codes`` is that.
    """
    maximum = float(values.max(initial=0)) or 1.0
    top = maximum if codes == 255 else max((255 / codes) ** root, maximum)
    coded = np.rint(255 * (np.maximum(values, 0) / top) ** (1 / root))
    return coded.astype(np.int32), top


def _coarsen_codes(codes: Codes, depth: NDArray[np.float32]) -> Codes:
    """Return codes in coarser steps where depths are faint, and errors hardly seen."""
    step = np.select([depth > 0.12, depth > 0.03], [1, 2], 4)
    return np.minimum(np.rint(codes / step).astype(np.int32) * step, 255)


def _fill_absent(codes: Codes, present: NDArray[np.bool_]) -> Codes:
    """Return (H, W, L) codes in which absent pixels repeat those to their left."""
    columns = np.arange(codes.shape[1])[:, None]
    nearest = np.maximum.accumulate(np.where(present, columns, 0), axis=1)
    return np.take_along_axis(codes, nearest, axis=1)


def _deflate_bytes(residuals: bytes) -> bytes:
    # Residuals hardly repeat: runs alone are smaller than what level 9 finds, in 1/50 of its time.
    packer = zlib.compressobj(9, zlib.DEFLATED, 15, 9, zlib.Z_RLE)
    return packer.compress(residuals) + packer.flush()


def residual_bytes(codes: Codes, bits: int) -> bytes:
    """Return the residuals of (H, W, N) codes from their predictions, modulo 2^bits."""
    parts = []
    before = np.zeros(codes.shape[:2], codes.dtype)
    for plane in np.ascontiguousarray(np.moveaxis(codes, -1, 0)):
        difference = plane - before
        residuals = (difference - median_prediction(difference)) & (2**bits - 1)
        before = plane
        if bits > 8:
            parts.append((residuals >> 8).astype(np.uint8).tobytes())
        parts.append((residuals & 255).astype(np.uint8).tobytes())
    return b"".join(parts)


def median_prediction(plane: Codes) -> Codes:
    """Predict (H, W) codes by the median of west, north and west + north - corner."""
    west, north, corner = (np.zeros_like(plane) for _ in range(3))
    north[1:] = plane[:-1]
    west[:, 1:] = plane[:, :-1]
    west[1:, 0] = north[1:, 0]
    north[0] = west[0]
    corner[1:, 1:] = plane[:-1, :-1]
    corner[1:, 0], corner[0] = north[1:, 0], west[0]
    high, low = np.maximum(west, north), np.minimum(west, north)
    return np.where(corner >= high, low, np.where(corner <= low, high, west + north - corner))
