"""Time casts of several fields or a mask against one, and a microscope's file to its picture.

``python -m benchmarks.fields``. The fields are the engine and its mirror images, which show as much
as the engine does, in other places; one is the mean of each alone. The mask's labels are blocks of
32 voxels, and all have the engine's transfer function, so that the picture stays.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import tifffile

from benchmarks.measure import Figure, in_turn, report
from benchmarks.scenes import SPECS, bench_scene
from volspec.pipeline import Raycaster
from volspec.raycast import RaycastSpec
from volspec.transfer import FieldFunctions, Mask
from volspec.volume import Volume

SIZE = 512, 512
MAX = {2: 1.8, 4: 3.2}
MAX_MASKED, BLOCK, LABELS = 3.0, 32, 4
# A file of (Z, C, Y, X): 128 MiB.
CELLS = 64, 4, 512, 512
# From a file to a light's picture: seconds, and bytes of the peak above what a small file left.
_PICTURE = """
import json, sys, time
from pathlib import Path
started = time.perf_counter()
import volspec as vs
def picture(path):
    volume = vs.load_volume(path)
    scene = vs.Scene.from_volume(path, volume=volume, lights=["D65"])
    with vs.Relighter(scene.render(volume, size=(512, 512))) as relighter:
        relighter.frame(vs.light("D65"))
*paths, small = sys.argv[1:]
picture(small)
seconds = time.perf_counter() - started
if paths:
    from benchmarks.memory import resident
    picture(small)  # again, as libraries' buffers come with the second
    Path("/proc/self/clear_refs").write_text("5")  # reset the peak
    before = resident("VmRSS")
    picture(paths.pop())
    print(json.dumps(resident("VmHWM") - before))
else:
    print(json.dumps(seconds))
"""


def figures() -> Iterator[Figure]:
    """Yield the cost of two and four fields, flat and shaded, and of a file's first picture."""
    engine = bench_scene("engine")
    values = engine.volume.values
    mirrored = [values, values[::-1], values[:, ::-1], values[:, :, ::-1]]
    own, *others = (
        Volume(
            np.ascontiguousarray(each), world_from_index=engine.volume.world_from_index, name=f"{k}"
        )
        for k, each in enumerate(mirrored)
    )
    caster = Raycaster(own.with_fields(others))
    for kind, settings in SPECS.items():
        spec = replace(settings, step_mm=min(own.spacing_mm))

        def cast(names: range, spec: RaycastSpec = spec) -> Callable[[], object]:
            table = caster.bake(FieldFunctions({f"{k}": engine.transfer for k in names}))
            return partial(caster.cast, table, engine.camera, SIZE, spec)

        for count, most in MAX.items():
            every = cast(range(count))
            pairs = [in_turn(every, cast(range(k, k + 1)), runs=5).wall for k in range(count)]
            ones = [float(np.median(each[:, 1] / each[:, 0])) for each in pairs]
            ms = np.median(np.concatenate(pairs), axis=0)
            note = f"{ms[0]:.0f} ms, one {ms[1]:.0f} ms"
            yield Figure(f"fields/{count}, {kind}", 1 / float(np.mean(ones)), most, True, note=note)
    yield from _mask_figures()
    yield from _file_figures()


def _mask_figures() -> Iterator[Figure]:
    """Yield the cost of a mask, flat and shaded."""
    engine = bench_scene("engine")
    own = engine.volume
    labels = (np.indices(own.values.shape) // BLOCK).sum(axis=0) % LABELS
    mask = Volume(labels.astype(np.uint8), world_from_index=own.world_from_index, name="blocks")
    caster = Raycaster(own.with_fields([mask]))
    by_label = Mask("blocks", {k: replace(engine.transfer) for k in range(1, LABELS)})
    masked = FieldFunctions({"": engine.transfer}, masks={"": by_label})
    for kind, settings in SPECS.items():
        spec = replace(settings, step_mm=min(own.spacing_mm))
        casts = [
            partial(caster.cast, table, engine.camera, SIZE, spec)
            for table in (caster.bake(masked), caster.bake(engine.transfer))
        ]
        pairs = in_turn(*casts, runs=9).wall
        ms = np.median(pairs, axis=0)
        note = f"{ms[0]:.0f} ms, without {ms[1]:.0f} ms"
        ratio = float(np.median(pairs[:, 0] / pairs[:, 1]))
        yield Figure(f"fields/mask, {kind}", ratio, MAX_MASKED, True, note=note)


def _file_figures() -> Iterator[Figure]:
    """Yield the time from a file to its picture, programs compiled, and the memory it takes."""
    with tempfile.TemporaryDirectory() as folder:
        path, small = Path(folder, "cells.ome.tif"), Path(folder, "small.ome.tif")
        random = np.random.default_rng(1)
        cells = random.integers(90, 130, CELLS, np.uint16)
        z, y, x = np.ogrid[: CELLS[0], : CELLS[2], : CELLS[3]]
        for _ in range(40):
            at = random.uniform((8, 0, 0, 0), (56, 4, 512, 512))
            away = ((z - at[0]) * 2) ** 2 + (y - at[2]) ** 2 + (x - at[3]) ** 2
            cells[:, int(at[1])] += (3000 * (away < 30**2)).astype(np.uint16)
        tifffile.imwrite(path, cells, metadata={"axes": "ZCYX"})
        tifffile.imwrite(small, cells[:16, :, :64, :64], metadata={"axes": "ZCYX"})
        more = _run(path, small)  # compiles, too
        seconds = float(np.median([_run(path) for _ in range(3)]))
    name = "fields/4 channels of 512 x 512 x 64 to the first picture"
    yield Figure(name, seconds, 5.0, True, "s")
    note = f"{more / 2**20:.0f} MiB, data {cells.nbytes >> 20} MiB"
    name = "fields/4 channels: memory by the data"
    yield Figure(name, more / cells.nbytes, 1.3, True, "x", note=note)


def _run(*paths: Path) -> float:
    command = [sys.executable, "-W", "ignore", "-c", _PICTURE, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return float(json.loads(done.stdout.splitlines()[-1]))


if __name__ == "__main__":
    print(report(figures()))
