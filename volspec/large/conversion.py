"""Write a volume of any size as a multiscale OME-Zarr, in bounded memory.

    file -> Level -> [convert] -> OME-Zarr 0.5 (folder)

In addition to the levels, the least and greatest value of every block of 16³ cells is stored
(``volspec/ranges``), by which casts know what not to read; and the range, the histogram and a
sample of all voxels, by which the volume is framed and given its colours. Work is divided into
blocks that are written one after the other: a conversion that was cut off goes on where it ended.

References
----------
[1] Moore et al. (2023), "OME-Zarr: a cloud-optimized bioimaging file format", Histochem Cell Biol
    160, 223-251. doi:10.1007/s00418-023-02209-1; ngff.openmicroscopy.org/0.5
"""

from __future__ import annotations

import errno
import json
import math
import os
import pickle
import shutil
import time
import zlib
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from volspec._files import exclusive_folder, require_writable_folder
from volspec.errors import InputError, VolumeError, one_line
from volspec.volume import Labels, Metadata, block_modes, downsample
from volspec.volume.files import fast_array, import_zarr
from volspec.volume.levels import (
    BLOCK,
    Box,
    Index,
    Level,
    VoxelSample,
    VoxelSampler,
    boxes_in,
    cast_dtype,
    halve,
    ranges_of,
    with_next,
)

CHUNK = 64
"""Voxels along the edge of a file, whose blocks can be read by themselves."""
# Levels are halved until none is longer.
_SHORTEST = 128
_STATE = "unfinished.json"
# Folder, in the new one, of the output that it replaces.
_REPLACED = "replaced"
_VERSION = 3
# Seconds until writes of a conversion that failed have ended; only a hang takes longer.
_PATIENCE_S = 60.0
# Errors of deleting a folder in which a file comes or goes meanwhile.
_LATE = errno.ENOTEMPTY, errno.ENOENT


@dataclass(frozen=True, slots=True)
class Block:
    """Voxels of a level that are written together: whole chunks."""

    level: int
    box: Box

    @property
    def voxels(self) -> int:
        """Number of voxels."""
        return math.prod(high - low for low, high in self.box)


def convert(
    source: Level,
    output: Path,
    *,
    name: str = "",
    labels: Labels | None = None,
    metadata: Metadata | None = None,
    progress: Callable[[float], object] | None = None,
) -> None:
    """Write the levels of a volume; an existing output is replaced when all of it is written.

    Raises InputError if the output cannot be written, VolumeError if the source cannot be read.

    Parameters
    ----------
    source : Level
        From `volspec.volume.load.open_level`.
    output : Path
        A folder, ending in ``.zarr``.
    name : str
        Of the picture, in the metadata.
    labels : {number: Label}, optional
        Of a segmentation: levels hold the most frequent label instead of the mean.
    metadata : Metadata, optional
        Statements of the source, which the output repeats.
    progress : callable, optional
        Called with the finished fraction, 0…1.
    """
    zarr = import_zarr(output)
    _require_replaceable(output)
    require_writable_folder(output.parent)
    shapes = level_shapes(source.shape)
    dtype = cast_dtype(source.dtype)
    rows = source.chunk[1], *[1] * (len(shapes) - 1)  # of the source, whole chunks are read
    blocks = [
        Block(level, box)
        for level, (shape, row) in enumerate(zip(shapes, rows, strict=True))
        for box in boxes_in(shape, CHUNK, row)
    ]
    partial = output.with_name(f"{output.name}.unfinished")
    key = {"version": _VERSION, "shape": source.shape, "dtype": dtype.name, "name": name}
    key |= {"world": source.world_from_index.tolist(), "source": _fingerprint(source)}
    key |= {"labels": labels is not None}
    _require_own(partial)
    with exclusive_folder(partial, "another conversion"):
        try:
            if _done(output, key) == len(blocks):  # it was killed while it cleaned up
                _clean(output)
                partial.rmdir()
                return
            done = _done(partial, key)
            if not done:
                _begin(partial, output, key)
            root = zarr.open_group(str(partial), mode="a", zarr_format=3)
            arrays = _arrays(root, shapes, dtype, create=not done)
            total, written = sum(block.voxels for block in blocks), 0
            sampler = VoxelSampler(source.shape, dtype)
            for number, block in enumerate(blocks):
                if number >= done:
                    _write(block, source, arrays, labels, sampler)
                    _save_state(partial, key, number + 1)
                elif block.level == 0:  # before the conversion was cut off
                    sampler.add(arrays[0][0][_index(block.box)], block.box)
                written += block.voxels
                if progress is not None:
                    progress(written / total)
            sample = sampler.sample()
            if sample is not None:
                root.create_array("volspec/sample", data=sample.voxels, overwrite=True)
            attributes = _attributes(source, shapes, sample, name, labels, metadata or Metadata())
            root.attrs.update(attributes)
            if output.exists():
                output.replace(partial / _REPLACED)
            partial.replace(output)
            _clean(output)
        except OSError as error:
            first = _REMEDIES.get(error.errno or 0, "check the folder and the disk")
            raise InputError(
                f"{output}: cannot be written: {error.strerror or one_line(error)}",
                f"{first} and repeat the command, which goes on where it ended",
                code="unwritable",
            ) from error


_REMEDIES = dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG), "make room on the disk")


def _require_replaceable(output: Path) -> None:
    """Refuse an output that is not a Zarr, and holds something."""
    wrong = "a file" if output.is_file() else ""
    if output.is_dir() and not (output / "zarr.json").exists() and any(output.iterdir()):
        wrong = "a folder with other files in it"
    if wrong:
        raise InputError(f"{output}: is {wrong}", "give another name", code="conflict")


def _require_own(partial: Path) -> None:
    """Refuse a folder for what is unfinished that no conversion has made."""
    if os.path.isdir(partial) and ((partial / _STATE).exists() or not any(partial.iterdir())):
        return
    if os.path.lexists(partial):
        raise InputError(
            f"{partial}: is not from a conversion, which needs that name for what is unfinished",
            "move it away, or give another output",
            code="conflict",
        )


def _begin(partial: Path, output: Path, key: dict[str, Any]) -> None:
    """Empty the folder of a conversion, which is this one's from now on."""
    if (partial / _REPLACED).exists() and not output.exists():
        (partial / _REPLACED).replace(output)
    _save_state(partial, key, 0)
    for entry in partial.iterdir():
        if entry.is_dir() and not entry.is_symlink():
            # After one write failed, others may still end in threads, and leave files behind.
            end = time.monotonic() + _PATIENCE_S
            while entry.exists():
                try:
                    shutil.rmtree(entry)
                except OSError as error:
                    if error.errno not in _LATE or time.monotonic() > end:
                        raise
                    time.sleep(0.01)
        elif entry.name != _STATE:
            entry.unlink()


def _clean(output: Path) -> None:
    """Delete what a conversion needed only itself."""
    shutil.rmtree(output / _REPLACED, ignore_errors=True)
    (output / _STATE).unlink(missing_ok=True)


def level_shapes(shape: Index) -> list[Index]:
    """Return the shapes (Z, Y, X) of a volume's levels, halved until they are small.

    >>> level_shapes((100, 300, 9))
    [(100, 300, 9), (50, 150, 5), (25, 75, 3)]
    """
    shapes = [shape]
    while max(shapes[-1]) > _SHORTEST and min(shapes[-1]) > 2:
        z, y, x = (-(-n // 2) for n in shapes[-1])
        shapes.append((z, y, x))
    return shapes


def _fingerprint(source: Level) -> list[Any]:
    """Return what changes if a source's voxels do: what is read of which files, of which state."""
    if isinstance(source.array, np.ndarray):
        return [zlib.crc32(np.ascontiguousarray(source.array))]
    # Arrays that read files are their paths and options, as processes of a cluster get them.
    try:
        read = pickle.dumps((source.array, source.axes, source.at))
    except (TypeError, AttributeError, pickle.PicklingError):
        read = repr((source.array, source.axes, source.at)).encode()
    paths = [] if source.place is None else [source.place, *source.place.rglob("*")]
    stats = [(str(path), path.stat()) for path in sorted(paths) if path.exists()]
    files = [(name, stat.st_size, stat.st_mtime_ns) for name, stat in stats]
    return [zlib.crc32(read), zlib.crc32(repr(files).encode())]


def _done(folder: Path, key: dict[str, Any]) -> int:
    """Return the number of blocks that a conversion of the same source has written."""
    try:
        state = json.loads((folder / _STATE).read_text())
        done = state.pop("done")
    except (OSError, ValueError, KeyError, AttributeError):
        return 0
    return int(done) if state == json.loads(json.dumps(key, default=list)) else 0


def _save_state(folder: Path, key: dict[str, Any], done: int) -> None:
    """Write how many blocks a conversion has written, to go on from there."""
    temporary = (folder / _STATE).with_suffix(".part")
    temporary.write_text(json.dumps({**key, "done": done}, default=list))
    temporary.replace(folder / _STATE)


def _arrays(
    root: Any, shapes: list[Index], dtype: np.dtype[Any], create: bool
) -> list[tuple[Any, Any]]:
    """Return each level's array and that of its blocks' ranges."""
    from zarr.codecs import BloscCodec, Crc32cCodec

    shuffle = "shuffle" if dtype.itemsize > 1 else "noshuffle"
    # With a checksum for each chunk: most damage to compressed bytes decompresses to others.
    codecs = BloscCodec(cname="zstd", clevel=1, shuffle=shuffle), Crc32cCodec()
    options = {"dtype": dtype, "compressors": codecs, "config": {"write_empty_chunks": True}}
    layout: dict[str, Any] = {"chunks": (BLOCK,) * 3, "shards": (CHUNK,) * 3}
    arrays = []
    for number, shape in enumerate(shapes):
        names = str(number), f"volspec/ranges/{number}"
        if create:
            root.create_array(names[0], shape=shape, dimension_names=[*"zyx"], **layout, **options)
            z, y, x = (-(-n // BLOCK) for n in shape)
            rows = CHUNK // BLOCK
            root.create_array(names[1], shape=(2, z, y, x), chunks=(2, rows, rows, x), **options)
        values, ranges = (fast_array(root[name], complete=True) for name in names)
        arrays.append((values, ranges))
    return arrays


def _write(
    block: Block,
    source: Level,
    arrays: list[tuple[Any, Any]],
    labels: Labels | None,
    sampler: VoxelSampler,
) -> None:
    """Write a block and its ranges, from the source, whose sample is taken, or the level before."""
    values, ranges = arrays[block.level]
    box = with_next(block.box, values.shape)
    if block.level == 0:
        try:
            voxels = source.read(box).astype(values.dtype, copy=False)
        except Exception as error:  # whatever the array's library raises
            z, y, x = (f"{low} to {high}" for low, high in box)
            where = f"{source.place}: its" if source.place else "its"
            raise VolumeError(
                f"{where} voxels z {z}, y {y}, x {x} cannot be read ({one_line(error)[:200]}); "
                "copy it again",
                code="damaged",
            ) from error
    else:
        finer = arrays[block.level - 1][0]
        ends = zip(box, finer.shape, strict=True)
        read = np.asarray(finer[tuple(slice(2 * a, min(2 * b, n)) for (a, b), n in ends)])
        if labels is not None:
            voxels = downsample(read, 2, block_modes)
        else:
            means = halve(read)
            voxels = (np.rint(means) if read.dtype.kind in "ui" else means).astype(read.dtype)
    inner = voxels[tuple(slice(high - low) for low, high in block.box)]
    if block.level == 0:
        sampler.add(inner, block.box)
    values[_index(block.box)] = inner
    ranges[(slice(None), *Level.blocks_of(block.box))] = ranges_of(voxels, block.box)


def _index(box: Box) -> tuple[slice, ...]:
    return tuple(slice(*ends) for ends in box)


def _attributes(
    source: Level,
    shapes: list[Index],
    sample: VoxelSample | None,
    name: str,
    labels: Labels | None,
    metadata: Metadata,
) -> dict[str, Any]:
    """Return the metadata of the group."""
    world = source.world_from_index
    spacing = np.linalg.norm(world[:3, :3], axis=0)
    is_straight = np.allclose(np.eye(3), world[:3, :3] / spacing)
    origin = world[:3, 3] if is_straight else np.zeros(3)
    datasets = []
    for number in range(len(shapes)):
        shift = origin + spacing * (2**number - 1) / 2
        steps = [
            {"type": "scale", "scale": (spacing * 2**number)[::-1].tolist()},
            {"type": "translation", "translation": shift[::-1].tolist()},
        ]
        datasets.append({"path": str(number), "coordinateTransformations": steps})
    axes = [{"name": axis, "type": "space", "unit": "millimeter"} for axis in "zyx"]
    picture = {"name": name, "axes": axes, "datasets": datasets, "type": "mean"}
    ome: dict[str, Any] = {"version": "0.5", "multiscales": [picture]}
    if labels is not None:
        picture["type"] = "mode"
        codes = {n: [round(255 * c) for c in label.colour or ()] for n, label in labels.items()}
        ome["image-label"] = {
            "properties": [{"label-value": n, "name": label.name} for n, label in labels.items()],
            "colors": [{"label-value": n, "rgba": [*rgb, 255]} for n, rgb in codes.items() if rgb],
        }
    volspec_attrs: dict[str, Any] = {
        "version": _VERSION,
        "block": BLOCK,
        "ranges": [f"volspec/ranges/{number}" for number in range(len(shapes))],
        "complete": True,
        "metadata": asdict(metadata),
    }
    if sample is not None:
        counts = [int(count) for count in sample.histogram]
        volspec_attrs |= {"range": [*sample.range], "histogram": counts, "sample": "volspec/sample"}
    if not is_straight:
        volspec_attrs["world_from_picture"] = (world @ np.diag([*1 / spacing, 1])).tolist()
    return {"ome": ome, "volspec": volspec_attrs}
