"""Volumes of any size as if they were larger than memory, and their division into parts."""

from dataclasses import replace
from pathlib import Path

import pytest

from volspec.large import level_caster as out_of_core
from volspec.large.conversion import convert
from volspec.volume import Volume, load_volume
from volspec.volume.levels.pyramid import BLOCK, Level, Pyramid, block_ranges
from volspec.volume.out_of_memory import level_of


def pyramid_of(volume: Volume, chunk: int = 32, *, ranges: bool = True, memory=2**31) -> Volume:
    """Return a volume as a pyramid of two levels, of which the finer is read in chunks.

    If the ranges of its blocks are known, and chunks are of whole blocks, it is read by block.
    """
    coarse = volume.downsampled(2)
    axes = (0, 1, 2)
    known = block_ranges(volume.values) if ranges else None
    by_block = ranges and chunk % BLOCK == 0
    finest = Level(
        volume.values, axes, axes, volume.world_from_index, (chunk,) * 3, known, by_block=by_block
    )
    last = Level(coarse.values, axes, axes, coarse.world_from_index, coarse.values.shape)
    dtype = volume.values.dtype
    levels = finest, last
    made = Pyramid(volume.name, levels, dtype, volume.range, volume.missing, memory)
    return replace(coarse, pyramid=made)


def in_parts_of(monkeypatch: pytest.MonkeyPatch, *sides: int) -> None:
    """Divide levels into parts with these cells along z, y and x."""
    z, y, x = sides * 3 if len(sides) == 1 else sides
    monkeypatch.setattr(out_of_core, "sides_for", lambda *given: (z, y, x))


def stored(volume: Volume, folder: Path, memory: str = "2MB") -> Volume:
    """Convert a volume to an OME-Zarr and open it with little memory."""
    path = folder / "v.zarr"
    convert(level_of(volume), path, name="v", labels=dict(volume.labels) or None)
    return load_volume(f"{path}?memory={memory}")
