"""Coefficients in the engines' layout: checked, finite, four channels per texture layer.

    coefficient image -> [layers] -> cpu | gpu
    kernel -> [SharedLayers] -> gpu

`pack_layers` packs on the host; its twin ``kernels/layers.cl`` packs on an OpenCL device, where a
cast can write into OpenGL's memory without a copy on the host.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sized
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import Compute, Sharing, assemble, prelude
from volspec.errors import RelightError, ShapeError
from volspec.image import CoefficientImage

Pixels32 = NDArray[np.float32]
Shape = tuple[int, ...]

# Far beyond any light; three such channels, times a matrix, still fit the shader's float32.
LIMIT = 1e9
_WORK_GROUP = (64, 1, 1)
# Pixels packed together, so that their channels stay in a core's cache.
_PIXELS_AT_ONCE = 8000


def coefficient_shape(image: CoefficientImage) -> Shape:
    """Return (H, W, L·M) of an image; raise ShapeError if its parts do not fit together."""
    if not hasattr(image, "coefficients"):
        raise RelightError.refused(
            "Relighter.image",
            image,
            "expected a CoefficientImage, from volspec.raycast or CoefficientImage.load",
            "type",
        )
    coefficients, alpha = np.shape(image.coefficients), np.shape(image.alpha)
    size = image.basis.size * len(image.groups)
    if len(coefficients) != 3 or coefficients != alpha + (size,) or not math.prod(alpha):
        raise ShapeError(
            f"coefficients have shape {coefficients}, alpha {alpha}, but the basis and groups have "
            f"{size} channels",
            "expected (H, W, L·M), (H, W) and L·M",
            field="relight",
        )
    return coefficients


def require_fit(shape: Shape, groups: Sized, old: CoefficientImage) -> None:
    """Raise ShapeError unless shape and number of groups are those of a Relighter's image."""
    if shape != old.coefficients.shape:
        raise ShapeError(
            f"the image has shape {shape}, but this Relighter is for {old.coefficients.shape}",
            "make another Relighter",
            field="relight",
            given=shape,
        )
    if len(groups) != len(old.groups):
        raise ShapeError(
            f"the image has {len(groups)} light groups, but this Relighter is for "
            f"{len(old.groups)}",
            "make another Relighter",
            field="relight.groups",
            given=len(groups),
        )


def float32_arrays(image: CoefficientImage) -> tuple[Pixels32, Pixels32]:
    """Return contiguous coefficients (H, W, L·M) and alpha (H, W) of a checked image."""
    coefficient_shape(image)
    coefficients = np.ascontiguousarray(image.coefficients, dtype=np.float32)
    return coefficients, np.ascontiguousarray(image.alpha, dtype=np.float32)


def clamp_finite(values: Pixels32) -> Pixels32:
    """Copy values of any shape, clamped to ±1e9 and with NaN as 0, so that no frame has NaN."""
    return _clamp(np.array(values))


def layer_count(channels: int) -> int:
    """Return the number of RGBA layers for the channels and alpha."""
    return math.ceil((channels + 1) / 4)


def pack_layers(coefficients: Pixels32, alpha: Pixels32) -> Pixels32:
    """Pack channels, alpha and zeros, four per layer: (layers, H, W, 4), as `clamp_finite`."""
    height, width, channels = coefficients.shape
    layers = np.empty((layer_count(channels), height, width, 4), dtype=np.float32)
    last, place = divmod(channels, 4)
    lines = max(1, _PIXELS_AT_ONCE // max(width, 1))
    for first in range(0, height, lines):
        rows = slice(first, first + lines)
        for i in range(channels):
            # Channel by channel: NumPy copies strided single numbers faster than short rows.
            layers[i // 4, rows, :, i % 4] = coefficients[rows, :, i]
        layers[last, rows, :, place] = alpha[rows]
        layers[last, rows, :, place + 1 :] = 0.0
        _clamp(layers[:, rows])
    return layers


def _clamp(values: Pixels32) -> Pixels32:
    """Clamp values in place, to ±1e9 and NaN to 0; return them."""
    # NaN if any value is, and ten times faster than testing each.
    if not (values.min(initial=0.0) >= -LIMIT and values.max(initial=0.0) <= LIMIT):
        np.clip(values, -LIMIT, LIMIT, out=values)
        np.nan_to_num(values, copy=False, nan=0.0)
    return values


@dataclass(frozen=True, slots=True, eq=False)
class TexturePlanes:
    """An image's channels from `pack_layers`: packed on one thread, uploaded on another.

    Layers before the ``first`` are those that the device has.
    """

    layers: Pixels32
    first: int = 0

    @classmethod
    def of(cls, image: CoefficientImage) -> Self:
        """Pack an image, which is most of the work of `Relighter.update`."""
        return cls(pack_layers(*float32_arrays(image)))

    @classmethod
    def last(cls, image: CoefficientImage, channels: int) -> Self:
        """Pack the layers with an image's last channels, in an array of their own."""
        coefficients, alpha = float32_arrays(image)
        first = (coefficients.shape[2] - channels) // 4
        return cls(pack_layers(coefficients[..., 4 * first :], alpha), first)

    def put(self, channel: int, values: Pixels32) -> None:
        """Write channels (H, W, K), the first of which has this number in the image."""
        for i in range(values.shape[2]):
            plane = channel + i - 4 * self.first
            self.layers[plane // 4, ..., plane % 4] = values[..., i]

    def require(self, height: int, width: int, channels: int) -> None:
        """Raise ShapeError unless the layers are for an image (H, W, L·M)."""
        expected = layer_count(channels) - self.first, height, width, 4
        if self.layers.shape != expected:
            raise ShapeError(
                f"the packed layers have shape {self.layers.shape}, but the image needs {expected}",
                "give PackedLayers.of(image)",
                field="relight.packed",
            )


def band_packer(
    compute: Compute, shape: tuple[int, int, int], layers: Any, *, half: bool
) -> Callable[[Any, Any, slice], Any]:
    """Return a function that packs a band of a picture (H, W, L·M) with ``kernels/layers.cl``.

    Its arguments are the band's coefficients (h, W, L·M) and alpha (h, W), both float32 on the
    device, and the band's lines in the picture; it enqueues a launch that writes ``layers`` and
    returns the event. ``half`` rounds channels as for half-float pictures.
    """
    height, width, channels = shape
    constants = {
        "CHANNELS": channels,
        "LIMIT": LIMIT,
        "HALF": half,
        "MAX_HALF": float(np.finfo(np.float16).max),
    }
    source = assemble("kernels/layers.cl", prelude(constants, "opencl"))
    kernel = compute.kernel(source, "pack_layers")
    columns = -(-width // _WORK_GROUP[0]) * _WORK_GROUP[0]

    def pack(coefficients: Any, alpha: Any, lines: slice) -> Any:
        size = columns, lines.stop - lines.start, layer_count(channels)
        numbers = (np.int32(n) for n in (width, height, lines.start))
        return kernel(compute.queue, size, _WORK_GROUP, coefficients, alpha, layers, *numbers)

    return pack


@dataclass(frozen=True, slots=True)
class SharedLayers:
    """An OpenGL buffer for one picture's channels, written by OpenCL.

    The displayed picture does not change until `Relighter.update` receives the buffer.
    """

    sharing: Sharing
    buffer: Any  # moderngl.Buffer: (layers, H, W, 4) float32
    shape: tuple[int, int, int]  # (H, W, L·M) of the picture

    @contextmanager
    def receiving(self, compute: Compute, half: bool) -> Iterator[Callable[[Any, Any, slice], Any]]:
        """Lend the buffer to a cast; yield the `band_packer` for the cast's bands.

        Raises OpenCLError if the driver does not share the buffer, or the kernel does not build.
        """
        with self.sharing.acquired(compute.queue, self.buffer) as layers:
            yield band_packer(compute, self.shape, layers, half=half)
