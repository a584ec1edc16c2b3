"""Deep OpenEXR files of layers of opacity: holdouts and merges by depth in a compositor.

    CoefficientImage with layers, lights -> [deep] -> FILE.exr -> Nuke, OpenImageIO, …

A used layer of a pixel is a deep sample, near to far: ``Z``, ``ZBack``, ``A``, ``R``, ``G`` and
``B`` under the first light, and the coefficients ``key.c00.V``, …, all premultiplied by the
sample's own ``A``. Samples are slabs, as those of `volspec.image.depth`, that do not overlap.
Flattened by over they are the recomposed picture: what both differ by, the residual at scale 1
included, is spread over a pixel's samples in proportion, and a ray that ended early has no samples
behind its end.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from volspec._exr import chromaticities, to_half, write_deep_exr
from volspec._files import require_suffix
from volspec.errors import ImageError
from volspec.export.compositing import Recipe
from volspec.export.exr import PRIMARIES
from volspec.image import CoefficientImage, axis_cosine, channel_names, extents

_CLEAR = 2.0**-24  # alpha of a sample that half floats do not show
_MAX_DEPTH = 16.0  # optical depth of an opaque pixel
_DIGITS = np.float32(2**13)  # of distances
_MAX_CHANGE = 2.0  # of a sample, to agree with the picture


@dataclass(frozen=True, slots=True, eq=False)
class DeepSamples:
    """Samples of a picture, pixel by pixel and near to far: N together."""

    counts: NDArray[np.int64]
    """(H, W) samples of each pixel."""
    depth_mm: NDArray[np.float32]
    """(N,) distance from the camera's plane; along the ray if the field of view is unknown."""
    back_mm: NDArray[np.float32]
    """(N,) where they end, likewise."""
    alpha: NDArray[np.float32]
    """(N,) opacity of each sample by itself."""
    coefficients: NDArray[np.float32]
    """(N, L·M), premultiplied by the sample's own opacity."""

    @classmethod
    def of(cls, image: CoefficientImage, opacities: Mapping[str, float] | None = None) -> Self:
        """Return the samples of an image with layers, with other opacities of its materials.

        Errors as in `save_deep`.
        """
        picture = image.recompose(opacities or {})
        scales = image.opacity_scales(opacities or {})
        assert image.opacity_layers is not None
        layers = image.opacity_layers.lit(scales)
        tau = layers.scaled(scales)
        used = tau.sum(axis=-1) > 0
        pixel = np.arange(used[..., 0].size).repeat(used.sum(axis=2).ravel())
        tau, total = tau[used], tau[used].sum(axis=-1)
        depth = np.bincount(pixel, total, used[..., 0].size)
        with np.errstate(divide="ignore"):
            target = np.minimum(-np.log1p(-picture.alpha.ravel().astype(np.float64)), _MAX_DEPTH)
        total *= np.clip(target / np.maximum(depth, 1e-12), 1, _MAX_CHANGE)[pixel]
        reached = np.minimum(_sum_to(total, pixel), target[pixel])
        total = reached - np.minimum(_sum_to(total, pixel) - total, target[pixel])
        alpha = -np.expm1(-total)
        fraction = tau / tau.sum(axis=-1, keepdims=True)
        shade, gloss = layers.shade[used], layers.gloss[used]
        samples = np.concatenate([fraction[:, None] * shade, gloss[..., None]], axis=-1)
        samples = alpha[:, None] * samples.reshape(len(samples), picture.coefficients.shape[-1])
        front = np.exp(total - reached)
        sums = np.stack([np.bincount(pixel, front * row, depth.size) for row in samples.T], axis=-1)
        channels = picture.coefficients.reshape(sums.shape)
        ratio = np.divide(channels, sums, out=np.ones(sums.shape), where=sums > 0)
        samples *= ratio.clip(0, _MAX_CHANGE)[pixel]
        begin, width = extents(
            layers.tau.astype(np.float32).sum(axis=-1).reshape(-1, layers.count),
            layers.depth_mm.astype(np.float32).reshape(-1, layers.count),
            layers.solid,
        )
        cosine = axis_cosine(image.size, image.fov_deg)[..., None]
        cosines = np.broadcast_to(cosine, used.shape)[used]
        front_mm, back_mm = (
            _round_mm(edge.reshape(used.shape)[used] * cosines) for edge in (begin, begin + width)
        )
        visible = alpha > _CLEAR
        counts = np.bincount(pixel[visible], minlength=depth.size).reshape(picture.alpha.shape)
        front_mm, pixel = _spread_mm(front_mm[visible], pixel[visible]), pixel[visible]
        last = np.r_[pixel[1:] != pixel[:-1], True][: len(pixel)]
        following = np.where(last, np.inf, np.r_[front_mm[1:], np.inf][: len(pixel)])
        back_mm = np.maximum(front_mm, np.minimum(back_mm[visible], following))
        return cls(
            counts,
            front_mm,
            back_mm.astype(np.float32),
            alpha[visible].astype(np.float32),
            samples[visible].astype(np.float32),
        )


def save_deep(
    image: CoefficientImage,
    path: str | os.PathLike[str],
    recipe: Recipe,
    opacities: Mapping[str, float] | None = None,
) -> DeepSamples:
    """Write a deep OpenEXR file of an image with layers, lit by the first light of a recipe.

    Returns the samples. Raises ImageError if the file cannot be written, the image was cast without
    layers, or the opacities are refused, as by `CoefficientImage.recompose`.
    """
    require_suffix(path, "deep images", ".exr")
    samples = DeepSamples.of(image, opacities)
    light = next(iter(recipe.lights.values()))
    size = image.basis.size
    RGB = np.zeros((len(samples.alpha), 3), np.float32)
    for number, group in enumerate(image.groups):
        if (M := light.matrices.get(group)) is not None:
            channels = samples.coefficients[:, number * size : (number + 1) * size]
            RGB += channels @ M.T.astype(np.float32)
    names = channel_names(image.groups, size)
    values = {
        **dict(zip("RGB", to_half(RGB).T, strict=True)),
        "A": to_half(samples.alpha),
        **dict(zip(names, to_half(samples.coefficients).T, strict=True)),
        "Z": samples.depth_mm,
        "ZBack": samples.back_mm,
    }
    space = PRIMARIES["Rec. 709"]
    header: dict[str, Any] = {f"volspec:{name}": text for name, text in recipe.texts().items()}
    header["chromaticities"] = chromaticities(space.primaries_xy, space.white_xy)
    write_deep_exr(path, header, samples.counts, values, ImageError)
    return samples


def _sum_to(values: NDArray[np.float64], pixel: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the sums of each pixel's values from its first to each, itself included."""
    running = np.cumsum(values, dtype=np.float64)
    first = np.r_[True, pixel[1:] != pixel[:-1]]
    before = np.where(first, running - values, 0)
    return running - np.maximum.accumulate(before) if len(values) else running


def _round_mm(depth_mm: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return distances with 13 binary digits, as layers have 11: more make files larger."""
    fraction, exponent = np.frexp(depth_mm)
    return np.asarray(np.ldexp(np.rint(fraction * _DIGITS) / _DIGITS, exponent), np.float32)


def _spread_mm(depth_mm: NDArray[np.float32], pixel: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return distances that rise within each pixel: samples at one distance have no order."""
    depth_mm = depth_mm.copy()
    later = np.flatnonzero(pixel[1:] == pixel[:-1]) + 1
    while (late := later[depth_mm[later] <= depth_mm[later - 1]]).size:
        depth_mm[late] = np.nextafter(depth_mm[late - 1], np.float32(np.inf))
    return depth_mm
