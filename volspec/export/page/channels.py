"""Coefficients as a page carries them: few bits at equal steps of the root, predicted, deflated.

    coefficient image -> [channels] -> base64 in the page -> web/channels.js

A channel's value v is the signed square of a root, root = low + code (high - low) / (2^bits - 1):
steps are finest near black, where eyes tell most apart. A plane of codes is written as its
difference to the channel before, since channels of one spectrum resemble each other; and that as
its difference to what the pixels to the left and above predict (the median of west, north and
west + north - corner). Measured on the engine: docs/page.md.
"""

from __future__ import annotations

import base64
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volspec.raycast import CoefficientImage
from volspec.relight.packed import bounded

Codes = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Carried:
    """A view's channels in a page.

    Parameters
    ----------
    text : str
        Base64 of the deflated residuals: plane after plane, above 8 bits high bytes before low.
    low, high : tuple of float
        Roots of the least and the greatest value of each plane; the opacity is the last.
    """

    text: str
    low: tuple[float, ...]
    high: tuple[float, ...]


def carried(image: CoefficientImage, bits: int) -> Carried:
    """Pack an image's channels and its opacity.

    Parameters
    ----------
    image : CoefficientImage
    bits : int
        Of each number, 8 to 12.
    """
    alpha = bounded(np.asarray(image.alpha, np.float32))
    coefficients = bounded(np.asarray(image.coefficients, np.float32))
    planes = np.concatenate([coefficients, alpha[..., None]], axis=-1).astype(np.float64)
    roots = np.copysign(np.sqrt(np.abs(planes)), planes)
    low, high = roots.min(axis=(0, 1)), roots.max(axis=(0, 1))
    steps = np.where(high > low, (high - low) / (2**bits - 1), 1.0)
    codes = np.rint((roots - low) / steps).astype(np.int64)
    packer = zlib.compressobj(9, zlib.DEFLATED, 15, 9, zlib.Z_FILTERED)
    data = packer.compress(residual_bytes(codes, bits)) + packer.flush()
    return Carried(
        base64.b64encode(data).decode("ascii"), tuple(low.tolist()), tuple(high.tolist())
    )


def residual_bytes(codes: Codes, bits: int) -> bytes:
    """(H, W, N) codes as what a page adds to its predictions, modulo 2^bits."""
    parts = []
    before = np.zeros(codes.shape[:2], np.int64)
    for plane in np.moveaxis(codes, -1, 0):
        difference = plane - before
        residuals = (difference - predicted(difference)) % 2**bits
        before = plane
        if bits > 8:
            parts.append((residuals >> 8).astype(np.uint8).tobytes())
        parts.append((residuals & 255).astype(np.uint8).tobytes())
    return b"".join(parts)


def predicted(plane: Codes) -> Codes:
    """(H, W) the median of west, north and west + north - corner; edges take what there is."""
    west, north, corner = (np.zeros_like(plane) for _ in range(3))
    north[1:] = plane[:-1]
    west[:, 1:] = plane[:, :-1]
    west[1:, 0] = north[1:, 0]
    north[0] = west[0]
    corner[1:, 1:] = plane[:-1, :-1]
    corner[1:, 0], corner[0] = north[1:, 0], west[0]
    high, low = np.maximum(west, north), np.minimum(west, north)
    return np.where(corner >= high, low, np.where(corner <= low, high, west + north - corner))
