"""Open volumes that are larger than memory: a coarse level is read, the finer ones are not.

load_volume -> levels -> [larger] -> Volume with a pyramid
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._gpu import host_free_bytes
from volspec.errors import VolumeError, one_line
from volspec.volume.channels import Channel
from volspec.volume.checks import checked_geometry, missing_value
from volspec.volume.files.query import Query, Reading, Stored
from volspec.volume.levels.pyramid import (
    ASK_ANOTHER,
    DEFAULT_BYTES,
    WITHOUT_PARTS,
    Chunk,
    Level,
    Pyramid,
    Stack,
    cast_dtype,
    coarse_level,
    size_text,
    summarise,
)
from volspec.volume.model import Volume

# Voxels along z and y of a chunk of uncompressed slices, which has whole rows.
_RAW_CHUNK = 16, 128


def stored_stack(query: Query, reading: Reading) -> Stack | None:
    """Return uncompressed voxels that are larger than memory as a level; else None."""
    values = reading.values
    is_stored = isinstance(values, Stored) and len(values.shape) == 3
    if not is_stored or values.nbytes <= query.most_bytes:
        return None
    geometry = reading.spacing_mm, reading.world_from_index
    spacing, world = checked_geometry(*geometry, str(query.path))
    if query.spacing_mm is not None:
        world = world @ np.diag([*np.divide(query.spacing_mm, spacing), 1.0])
    level = Level(values, (0, 1, 2), (0, 0, 0), world, _raw_chunk(values.shape))
    details = reading.channel, reading.labels, reading.notes
    return Stack([level], *details, metadata=reading.metadata)


def _raw_chunk(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Return the voxels of a file of slices that are read together: runs of whole rows."""
    z, y, x = shape
    return min(_RAW_CHUNK[0], z), min(_RAW_CHUNK[1], y), x


def read_coarsest(query: Query, name: str, stack: Stack, notes: list[str]) -> Volume:
    """Return a volume that is larger than memory, and add notes on it.

    Its coarsest level is read now, or made if there is none that memory holds.
    """
    try:
        return _read_coarsest(query, name, stack, notes)
    except VolumeError:
        raise
    except Exception as error:  # whatever the array's library raises
        why = one_line(error)[:120]
        remedy = ASK_ANOTHER if WITHOUT_PARTS in why else "copy it again"
        raise VolumeError(
            f"{query.path}: cannot be read ({why}); {remedy}", code="damaged"
        ) from error


def _read_coarsest(query: Query, name: str, stack: Stack, notes: list[str]) -> Volume:
    memory_bytes = query.memory_bytes or min(DEFAULT_BYTES, host_free_bytes() // 2)
    levels = [*stack.levels]
    number = coarse_level(levels, memory_bytes)
    dtype = cast_dtype(levels[0].dtype)
    damaged: dict[Chunk, str] = {}
    sample = stack.sample
    notes += stack.notes
    if number is None:
        means, factor, finest, sample = summarise(levels[0])
        levels = [finest]
        if dtype.kind in "ui":
            means = np.rint(means)
        values = means.astype(dtype)
        offset = np.diag([factor, factor, factor, 1.0])
        offset[:3, 3] = (factor - 1) / 2
        world = levels[0].world_from_index @ offset
        remedy = "`volspec convert` makes a copy that opens at once"
        if stack.sample is not None:  # it is one
            remedy = "give more memory"
        notes.append(
            f"{query.path}: {size_text(levels[0].nbytes)} are more than memory may take, and it "
            f"has no coarser levels; {remedy}"
        )
    else:
        values, damaged = _read_rest(levels[number], number)
        values = values.astype(dtype, copy=False)
        world = levels[number].world_from_index
        levels = levels[:number]
    channel = stack.channel or Channel()
    metadata = query.completed(stack.metadata)
    coarse = Volume(values, world_from_index=world, name=name, channel=channel, metadata=metadata)
    span, missing = coarse.range, coarse.missing
    if (ranges := levels[0].ranges) is not None:
        low = ranges[0][np.isfinite(ranges[0])].min(initial=ranges[1].max())
        span = float(low), float(ranges[1].max())
    if sample is not None:
        span, finite = sample.range, np.isfinite(sample.voxels)
        voxels = sample.voxels
        if missing is not None or not finite.all():
            missing = missing_value(*span)
            voxels = np.where(finite, voxels, np.float32(missing))
        sample = replace(sample, voxels=voxels.astype(dtype, copy=False))
    if coarse.missing is not None:
        missing = missing_value(*span)
        values = np.where(coarse.values == coarse.missing, np.float32(missing), coarse.values)
        coarse = replace(coarse, values=values, missing=missing)
    coarsest = Level(coarse.values, (0, 1, 2), (0, 0, 0), coarse.world_from_index, values.shape)
    levels.append(coarsest)
    arguments = tuple(levels), dtype, span, missing, memory_bytes, damaged, sample
    pyramid = Pyramid(name, *arguments)
    if damaged:
        notes.append(pyramid.describe_gaps())
    volume = replace(coarse, pyramid=pyramid)
    if query.spacing_mm is not None:
        volume = volume.with_spacing(query.spacing_mm)
    return volume


def _read_rest(level: Level, number: int) -> tuple[NDArray[Any], dict[Chunk, str]]:
    """Read a level, and its damaged chunks with what is wrong; these have its least value.

    Raises the first error if no chunk can be read.
    """
    z, y, x = ((0, n) for n in level.shape)
    with suppress(Exception):  # whatever the array's library raises
        values = level.read((z, y, x))
        if not level.fault((z, y, x), values):
            return values, {}
    values, damaged, first = np.zeros(level.shape, level.dtype), {}, None
    places = level.chunks_in((z, y, x))
    boxes = [level.box_of(place) for place in places]
    for place, box, read in zip(places, boxes, level.read_each(boxes), strict=True):
        if isinstance(read, Exception):
            first = first or read
            damaged[Chunk(number, *place)] = one_line(read)[:200]
        elif fault := level.fault(box, read):
            damaged[Chunk(number, *place)] = fault
        else:
            values[tuple(slice(*ends) for ends in box)] = read
    intact = np.ones(level.shape, np.bool_)
    for chunk in damaged:
        intact[tuple(slice(*ends) for ends in level.box_of(chunk[1:]))] = False
    if not intact.any():
        raise first or VolumeError("none of its chunks is what was written", code="damaged")
    values[~intact] = np.nanmin(values[intact])
    return values, damaged


def level_of(volume: Volume) -> Level:
    """Return a volume in memory as a level; the finest of one that is larger."""
    if volume.pyramid is not None:
        return volume.pyramid.levels[0]
    values = volume.values
    if volume.missing is not None:
        values = volume.nan_if_missing(values).astype(np.float32)
    chunk = _raw_chunk(values.shape)
    return Level(values, (0, 1, 2), (0, 0, 0), volume.world_from_index, chunk)
