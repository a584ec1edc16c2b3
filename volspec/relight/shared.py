"""Coefficients that a cast packs into OpenGL's memory, and the host never sees on their way.

    kernel -> [shared] -> gpu

The twin of ``kernels/layers.cl`` is `volspec.relight.packed.pack_layers`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from volspec._gpu.opencl import Compute
from volspec._gpu.prelude import prelude
from volspec._gpu.sharing import Sharing
from volspec._gpu.sources import assemble
from volspec.relight.packed import LIMIT, layer_count

LOCAL = (64, 1, 1)


def packer(
    compute: Compute, shape: tuple[int, int, int], layers: Any, *, half: bool
) -> Callable[[Any, Any, slice], Any]:
    """What packs a band of a picture (``kernels/layers.cl``).

    Parameters
    ----------
    shape : (H, W, L·M)
        The whole picture's.
    layers : cl.Buffer or cl.GLBuffer
        (layers, H, W, 4) float32, written.
    half : bool
        Round channels as half-float pictures are.

    Returns
    -------
    callable
        Of the band's coefficients (h, W, L·M) and alpha (h, W), both float32 on the device, and
        its lines of the picture; queues a launch and returns its event.
    """
    height, width, channels = shape
    constants = {
        "CHANNELS": channels,
        "LIMIT": LIMIT,
        "HALF": half,
        "LARGEST_HALF": float(np.finfo(np.float16).max),
    }
    source = assemble("kernels/layers.cl", prelude(constants, "opencl"))
    kernel = compute.kernel(source, "pack_layers")
    columns = -(-width // LOCAL[0]) * LOCAL[0]

    def pack(coefficients: Any, alpha: Any, lines: slice) -> Any:
        size = columns, lines.stop - lines.start, layer_count(channels)
        numbers = (np.int32(n) for n in (width, height, lines.start))
        return kernel(compute.queue, size, LOCAL, coefficients, alpha, layers, *numbers)

    return pack


@dataclass(frozen=True, slots=True)
class SharedLayers:
    """A place for one picture's channels; what is shown stays until `Relighter.update` takes it.

    Parameters
    ----------
    sharing : Sharing
        The context that the caster's device shares.
    buffer : moderngl.Buffer
        (layers, H, W, 4) float32.
    shape : (H, W, L·M)
        The picture's.
    """

    sharing: Sharing
    buffer: Any
    shape: tuple[int, int, int]

    @contextmanager
    def receiving(self, compute: Compute, half: bool) -> Iterator[Callable[[Any, Any, slice], Any]]:
        """While a cast runs: what it hands each band to (`packer`).

        Raises
        ------
        OpenCLError
            If the driver does not share the buffer, or the kernel does not build.
        """
        with self.sharing.acquired(compute.queue, self.buffer) as layers:
            yield packer(compute, self.shape, layers, half=half)
