"""Casts of a volume that is larger than memory: time, memory, bytes read, and two workers.

``python -m benchmarks.larger`` with a sponge of 1 GiB (``--gib 4`` for another), which is made and
converted in ``build/``. Each cast is a process of its own, whose memory is sampled with that of
its children every 20 ms.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil

from benchmarks import large
from benchmarks.measure import Figure, report
from benchmarks.scenes import BUILD, bench_scene
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.large.conversion import convert
from volspec.large.level_caster import LevelCaster
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.spectra import reflectance
from volspec.transfer import TransferFunction
from volspec.volume import Volume, load_volume
from volspec.volume.levels.pyramid import BLOCK, Level
from volspec.volume.load import open_level
from volspec.volume.out_of_memory import level_of

SIZE = 512, 512
_SIDE = 2048
SPEC = RaycastSpec(step_mm=0.5, level=0)


def sponge_store(gib: float) -> Path:
    """Return a sponge's OME-Zarr; it is made if it is not there."""
    depth = round(gib * 2**30 / _SIDE**2)
    store = BUILD / f"sponge-{depth}.zarr"
    if not store.exists():
        raw = BUILD / f"sponge-{depth}.raw"
        large.make(raw, (depth, _SIDE, _SIDE))
        level, name, *_ = open_level(f"{raw}?shape={_SIDE}x{_SIDE}x{depth}&dtype=uint8&memory=1GiB")
        convert(level, store, name=name)
        raw.unlink()
    return store


def sponge_look() -> TransferFunction:
    """Return a transfer function of a sponge: its walls, dense within."""
    materials = {
        "wall": reflectance("PMC/Pork"),
        "core": reflectance("ColorChecker/orange yellow"),
    }
    points = [(40, 0.0, "wall"), (60, 0.3, "wall"), (110, 0.5, "core"), (200, 0.8, "core")]
    return TransferFunction(points, materials, SpectralBasis.load("general-7"))


def cast(address: str, level: int | None = 0, device: str | None = None) -> dict[str, float]:
    """Cast a sponge; return seconds from the file to the picture, of two casts, and what was read.

    Casts of a cluster are preceded by one, for which its workers build the kernel.
    """
    began = time.perf_counter()
    volume = load_volume(address)
    caster = Raycaster(volume, device=device)
    camera = Camera.orbit(volume, azimuth_deg=30, elevation_deg=20, zoom=1.4)
    spec = replace(SPEC, level=level, step_mm=0.5 if level == 0 else None)

    def once() -> CoefficientImage:
        return raycast(volume, sponge_look(), camera, SIZE, spec, caster=caster)

    if device is not None:
        once()
    first = time.perf_counter()
    once()
    seconds = time.perf_counter() - first
    if caster.cluster is not None:
        caster.cluster.close()
    pyramid = volume.pyramid
    found = {"total_s": first + seconds - began, "cast_s": seconds}
    if pyramid is not None:
        counts = pyramid.counts
        found |= {"read": counts.voxel_bytes, "again": counts.again_bytes}
        found["visible"] = visible_bytes(caster, camera, spec)
    return found


def visible_bytes(caster: Raycaster, camera: Camera, spec: RaycastSpec) -> float:
    """Return the bytes of the blocks in view in which a sponge is visible, at a cast's level."""
    level = caster.at(camera, SIZE, spec)
    if not isinstance(level, LevelCaster):
        return math.nan
    table = caster.bake(sponge_look())
    spec = level.with_step(table, camera, SIZE, spec).for_lattice(level.volume)
    blocks = level.visible_blocks(table, spec)
    assert blocks is not None
    seen = np.zeros_like(blocks)
    for part in level.plan(table, camera, SIZE, spec):
        own = Level.blocks_of(tuple(zip(part.low, part.high, strict=True)))
        seen[own] = blocks[own]
    return float(seen.sum()) * BLOCK**3 * level.volume.values.itemsize


def apart(*given: object) -> dict[str, float]:
    """Cast in another process; also return the peak of its memory, in bytes."""
    text = f"import json; from benchmarks.larger import cast; print(json.dumps(cast{given!r}))"
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", text], stdout=subprocess.PIPE, text=True
    )
    watched, peak = psutil.Process(process.pid), 0
    while process.poll() is None:
        try:
            every = (watched, *watched.children(recursive=True))
            peak = max(peak, sum(each.memory_info().rss for each in every))
        except psutil.Error:
            pass
        time.sleep(0.02)
    assert process.stdout is not None
    return {**json.loads(process.stdout.read()), "peak": peak}


def figures(gib: float = 1.0) -> Iterator[Figure]:
    """Compare casts of parts with those of the whole, and two workers with one."""
    store = sponge_store(gib)
    name = f"larger/sponge of {gib:g} GiB"
    if gib < 4:  # as many voxels as a kernel can address
        whole = apart(f"{store}?memory=8GiB")
        parts = apart(f"{store}?memory={round(300 * gib)}MiB")
        note = f"{parts['total_s']:.1f} s of parts, {whole['total_s']:.1f} s of the whole"
        ratio = parts["total_s"] / whole["total_s"]
        yield Figure(f"{name}: from file to picture", ratio, 3.0, True, note=note)
        note = f"{parts['cast_s']:.1f} s with reading, {whole['cast_s']:.1f} s without"
        yield Figure(f"{name}: second cast", parts["cast_s"] / whole["cast_s"], note=note)
    elif gib <= 4:
        parts = apart(f"{store}?memory=1536MiB")
        note = f"{parts['total_s']:.1f} s, {parts['again'] / 2**20:.0f} MiB read again"
        yield Figure(f"{name}: peak", parts["peak"] / 2**30, 2.0, True, "GiB", note=note)
    budget = "1GiB" if gib > 1 else "600MiB"
    natural = apart(f"{store}?memory={budget}", None)
    title = f"{name}: {budget}, natural level"
    note = f"{natural['total_s']:.1f} s, {natural['again'] / 2**20:.0f} MiB read again"
    yield Figure(f"{title}: peak", natural["peak"] / 2**30, 1.3, True, "GiB", note=note)
    note = f"{natural['read'] / 2**20:.0f} MiB are read"
    ratio = natural["read"] / natural["visible"]
    yield Figure(f"{title}: read", ratio, 1.2, True, "of the visible bytes", note=note)
    if gib > 4:
        return
    one, two = (apart(f"{store}?memory={budget}", 0, f"local:{n}")["cast_s"] for n in (1, 2))
    note = f"{one:.1f} s with one, {two:.1f} s with two"
    yield Figure(f"{name}: two workers", one / two, 1.8, note=note)
    yield from sparse_figures()


def sparse_figures() -> Iterator[Figure]:
    """Yield the voxels that are read of vessels in 1024³ voxels."""
    try:
        scene = bench_scene("aneurism")
    except FileNotFoundError as error:
        yield Figure("larger/aneurism 1024³", None, note=str(error))
        return
    store = BUILD / "aneurism-1024.zarr"
    if not store.exists():
        convert(level_of(Volume(np.tile(scene.volume.values, (4, 4, 4)))), store)
    for level in (None, 0):
        volume = load_volume(f"{store}?memory=900MiB")
        assert volume.pyramid is not None
        raycast(volume, scene.transfer, Camera.orbit(volume), SIZE, RaycastSpec(level=level))
        share = volume.pyramid.counts.voxel_bytes / 2**30
        yield Figure(
            f"larger/aneurism 1024³, {'natural level' if level is None else 'level 0'}: read",
            100 * share,
            8.0 if level is None else None,
            True,
            "% of the volume",
        )


# Of the model: bytes per second of a worker's network and of all storage, and seconds of Dask per
# task in a worker and in the scheduler.
NETWORK, STORAGE, TASK_S, SCHEDULER_S = 1.25e9, 5e9, 2e-3, 2e-4
# Bytes that a core composites per second, measured: three arrays are read and one is written.
COMPOSITED = 1e9


def model(cast_s: float, read: float, workers: int, channels: int = 7) -> dict[str, float]:
    """Return a cast's seconds with a number of workers, from those of one and the bytes read.

    Parameters
    ----------
    cast_s : float
        Seconds of one worker.
    read : float
        Bytes that are read, by all together.
    workers : int
    channels : int
        Of the picture, of `SIZE` pixels.
    """
    runs = 6 * workers
    whole = SIZE[0] * SIZE[1] * 4 * (channels + 4)
    levels = math.ceil(math.log2(runs))
    # Pictures of runs that are cubes: each level of the tree covers more of the whole.
    sizes = [whole * min(1.0, (2.0 ** (k + 1) / runs) ** (2 / 3)) for k in range(levels)]
    path_s = sum(size / NETWORK + size / COMPOSITED + TASK_S for size in sizes)
    sent = sum(size * runs / 2 ** (k + 1) for k, size in enumerate(sizes))
    return {
        "messages": 3.0 * runs,
        "sent": sent,
        "cast": max(cast_s / workers, read / STORAGE),
        "tree": path_s,
        "scheduler": 2 * runs * SCHEDULER_S,
    }


def print_model(gib: float) -> None:
    """Print the model for a sponge as measured, and for one of 256 times its voxels."""
    one = apart(f"{sponge_store(gib)}?memory=600MiB", 0, "local:1")
    level = load_volume(f"{sponge_store(gib)}?memory=600MiB").pyramid
    assert level is not None
    read = float(level.levels[0].nbytes)
    print(f"One worker casts {gib:g} GiB in {one['cast_s']:.1f} s.")
    print("  volume  workers  messages  pictures    cast    tree  scheduler   in all  speed-up")
    for times in (1, 256):
        for workers in (1, 16, 1000):
            found = model(one["cast_s"] * times, read * times, workers)
            seconds = found["cast"] + found["tree"] + found["scheduler"]
            faster = one["cast_s"] * times / seconds
            print(
                f"{gib * times:4g} GiB {workers:8} {found['messages']:9.0f} "
                f"{found['sent'] / 1e6:6.0f} MB {found['cast']:6.1f}s {found['tree']:6.2f}s "
                f"{found['scheduler']:9.2f}s {seconds:7.1f}s {faster:8.1f}x"
            )


def main(given: Sequence[str]) -> None:
    """Print the figures of a sponge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--gib", type=float, default=1.0)
    parser.add_argument("--model", action="store_true", help="print the model of many workers")
    wanted = parser.parse_args(given)
    if wanted.model:
        print_model(wanted.gib)
    else:
        print(report([*figures(wanted.gib)]))


if __name__ == "__main__":
    main(sys.argv[1:])
