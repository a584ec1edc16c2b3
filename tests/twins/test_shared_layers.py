"""``kernels/layers.cl`` packs the very numbers that `pack_layers` does."""

import numpy as np
import pytest

from tests.support.fixtures import slow_each
from volspec._gpu.opencl import Compute
from volspec.relight.texture_planes import band_packer, layer_count, pack_layers

ODD = [np.nan, np.inf, -np.inf, 1e30, -1e30, 3e38, 1e9, -1e9, 7e4, -7e4, 1e-8, 6.1e-5, 0.1]


@pytest.fixture(scope="module")
def compute() -> Compute:
    return Compute.open()


def picture(height: int, width: int, channels: int) -> tuple[np.ndarray, np.ndarray]:
    """Random pixels; every third number is one that a texture must not hold, or just may."""
    rng = np.random.default_rng(channels)
    values = rng.normal(size=(height, width, channels + 1)).astype(np.float32)
    values.reshape(-1)[::3] = rng.choice(np.array(ODD, np.float32), values.size)[::3]
    return np.ascontiguousarray(values[..., :-1]), np.ascontiguousarray(values[..., -1])


def packed_on_the_device(
    compute: Compute, coefficients: np.ndarray, alpha: np.ndarray, lines: int, half: bool = False
) -> np.ndarray:
    """Write bands of so many lines; what no band writes stays NaN."""
    height, width, channels = coefficients.shape
    layers = np.full((layer_count(channels), height, width, 4), np.nan, np.float32)
    buffer = compute.output(layers.nbytes, layers)
    if buffer.hostbuf is None:
        import pyopencl as cl

        cl.enqueue_copy(compute.queue, buffer, layers)
    pack = band_packer(compute, coefficients.shape, buffer, half=half)
    for first in range(0, height, lines):
        band = slice(first, min(first + lines, height))
        pack(compute.upload(coefficients[band]), compute.upload(alpha[band]), band).wait()
    compute.download(buffer, layers)
    return layers


def assert_same(ours: np.ndarray, twin: np.ndarray) -> None:
    differs = ours != twin
    worst = tuple(np.argwhere(differs)[0]) if differs.any() else (0, 0, 0, 0)
    assert not differs.any(), f"{worst}: {ours[worst]} against {twin[worst]}"


# Each compiles a kernel. Four channels make a layer: every remainder, one layer to eight.
@pytest.mark.parametrize("channels", [3, 4, 32, *slow_each(1, 2, 5, 7, 9, 14, 31)])
def test_any_number_of_channels_is_packed_as_the_host_packs_it(compute, channels):
    given = picture(13, 67, channels)
    assert_same(packed_on_the_device(compute, *given, 5), pack_layers(*given))


@pytest.mark.parametrize("size", [(1, 1), (1, 65), (9, 64), (130, 3)])
@pytest.mark.parametrize("lines", [1, 4, 1000])
def test_any_size_and_height_of_bands_is_packed(compute, size, lines):
    given = picture(*size, 7)
    assert_same(packed_on_the_device(compute, *given, lines), pack_layers(*given))


def test_half_pictures_are_rounded_as_they_are_kept(compute):
    coefficients, alpha = picture(31, 65, 7)
    largest = float(np.finfo(np.float16).max)
    rounded = np.clip(coefficients, -largest, largest).astype(np.float16).astype(np.float32)
    ours = packed_on_the_device(compute, coefficients, alpha, 8, half=True)
    assert_same(ours, pack_layers(rounded, alpha))
