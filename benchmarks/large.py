"""A volume of any size, made slab by slab: ``python -m benchmarks.large big.raw --gib 4``.

A sponge in a ball: a gyroid's walls, thinner outwards, with grains in them; two thirds of it are
empty.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# Periods of the gyroid along the longest side.
_PERIODS = 14


class Sponge:
    """Slices of the volume (Z, Y, X); buffers are reused, as most of the time went to new pages."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._z, y, x = (np.linspace(-1, 1, n, dtype=np.float32) for n in shape)
        # Walls of the same thickness in all directions.
        self._wave = [np.float32(np.pi * _PERIODS / 2 * n / max(shape)) for n in shape]
        self._y, self._x = y[:, None], x
        self._radius2 = self._y**2 + self._x**2
        wy, wx = self._wave[1] * self._y, self._wave[2] * self._x
        self._plane = np.sin(wx) * np.cos(wy)
        self._sin_y, self._cos_x = np.sin(wy), np.cos(wx)
        self._value = np.empty(shape[1:], np.float32)
        self._inside = np.empty(shape[1:], np.float32)
        random = np.random.default_rng(0)
        self._grains = random.integers(0, 24, shape[1:], np.uint8)

    def slice(self, k: int) -> NDArray[np.uint8]:
        """Return one slice (Y, X)."""
        z, wz = self._z[k], self._wave[0] * self._z[k]
        value, inside = self._value, self._inside
        np.add(self._plane, self._sin_y * np.cos(wz), out=value)
        value += np.sin(wz) * self._cos_x
        np.abs(value, out=value)
        np.subtract(1 - z * z, self._radius2, out=inside)  # 1 in the middle, 0 at the surface
        value -= np.float32(0.3) * inside
        value *= np.float32(-480)
        value += np.float32(96)
        np.clip(value, 0, 200, out=value)
        value *= inside > 0
        made = value.astype(np.uint8)
        made += np.roll(self._grains, 101 * k) * (made > 60)
        return made


def make(path: Path, shape: tuple[int, int, int]) -> None:
    """Write a volume (Z, Y, X) as raw bytes."""
    sponge = Sponge(shape)
    with path.open("wb") as file:
        for k in range(shape[0]):
            file.write(sponge.slice(k).tobytes())


def main() -> None:
    """Make a volume of 2048 × 2048 slices, or one of another number of GiB."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--gib", type=float, default=4.0)
    given = parser.parse_args()
    shape = round(given.gib * 2**30 / 2048**2), 2048, 2048
    make(given.path, shape)
    print(f"{given.path}?shape=2048x2048x{shape[0]}&dtype=uint8")


if __name__ == "__main__":
    main()
