"""Memory of a cast besides the volume: the chest CT or the largest available, and 1300³ voxels.

A separate process loads the volume, casts a corner of it (to load compilers and libraries) and then
measures the bytes of live OpenCL buffers and the growth of its resident memory, at the peak and
after. A copy of the volume on the device, if there is one, is subtracted, and so are the images
from the process; buffers that share the host's memory do not count.
"""

from __future__ import annotations

import gc
import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyopencl as cl

from benchmarks.cast import SIZE, STOPPED
from benchmarks.measure import Figure
from benchmarks.scenes import bench_scene
from volspec.camera import Camera
from volspec.pipeline import Raycaster, raycast
from volspec.volume import Volume

ASKED = 30
NAMES = ("chest", "foot", "engine")
# Engines side by side, 2.05 Gi voxels.
LARGE, LARGE_SIDE = "1300³", 1300
_FIRST_CELLS = 24


class Ledger:
    """Bytes of live OpenCL buffers, and their peak."""

    def __init__(self) -> None:
        self.live = self.peak = self.largest = 0

    def watch(self) -> None:
        """Record all buffers from now on."""
        ledger = self

        class Buffer(cl.Buffer):
            _entered = 0

            def __init__(
                self, context: cl.Context, flags: int, *arguments: object, **keywords: object
            ) -> None:
                super().__init__(context, flags, *arguments, **keywords)
                if flags & cl.mem_flags.USE_HOST_PTR:
                    return
                self._entered = self.size
                ledger.live += self.size
                ledger.peak = max(ledger.peak, ledger.live)
                ledger.largest = max(ledger.largest, self.size)

            def __del__(self) -> None:
                ledger.live -= self._entered

        cl.Buffer = Buffer


def resident(field: str) -> int:
    """Return VmRSS (current) or VmHWM (peak) of this process, bytes."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024
    raise OSError(f"no {field} in /proc/self/status")


def measured(name: str) -> dict[str, int]:
    """Return the bytes of one cast, without the volume and the images."""
    scene = bench_scene("engine" if name == LARGE else name)
    if name == LARGE:
        more = [(0, LARGE_SIDE - n) for n in scene.volume.values.shape]
        volume = Volume(np.pad(scene.volume.values, more, mode="wrap"), name=LARGE)
        scene = replace(scene, volume=volume, camera=Camera.orbit(volume))
    volume, spec = scene.volume, STOPPED["shaded"]
    z, y, x = (n // 2 for n in volume.values.shape)
    corner = Volume(
        volume.values[z : z + _FIRST_CELLS, y : y + _FIRST_CELLS, x : x + _FIRST_CELLS].copy(),
        spacing_mm=volume.spacing_mm,
    )
    ledger = Ledger()
    ledger.watch()
    raycast(corner, scene.transfer, scene.camera, SIZE, spec, caster=Raycaster(corner))
    gc.collect()
    ledger.peak, ledger.largest = ledger.live, 0
    Path("/proc/self/clear_refs").write_text("5")  # reset the peak
    before = resident("VmRSS")
    caster = Raycaster(volume)
    image = raycast(volume, scene.transfer, scene.camera, SIZE, spec, caster=caster)
    gc.collect()
    images = image.coefficients.nbytes + image.alpha.nbytes + image.depth_mm.nbytes
    copy = volume.values.nbytes if ledger.largest >= volume.values.nbytes else 0
    tables = {
        "device": ledger.peak - copy,
        "peak": max(0, resident("VmHWM") - before - copy - images),
        "kept": max(0, resident("VmRSS") - before - copy - images),
    }
    return {"volume": volume.values.nbytes, "images": images, **tables}


def figures() -> Iterator[Figure]:
    """Yield memory as percentages of the volume's size."""
    yield from _first(NAMES)
    yield from _first((LARGE,))


def _first(names: Sequence[str]) -> Iterator[Figure]:
    """Yield the figures of the first volume that is there."""
    for name in names:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.memory", name], capture_output=True, text=True
        )
        if done.returncode == 0:
            break
    else:
        why = (done.stderr.strip().splitlines() or ["no output"])[-1]
        yield Figure("memory", None, ASKED, at_most=True, note=why)
        return
    found = json.loads(done.stdout.splitlines()[-1])
    print(f"memory/{name}: " + ", ".join(f"{k} {v / 2**20:.1f} MiB" for k, v in found.items()))
    for key, title in (("device", "device"), ("kept", "process"), ("peak", "process, peak")):
        share = 100 * found[key] / found["volume"]
        yield Figure(f"memory/{name}: {title}", share, ASKED, at_most=True, unit="%")


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1])))
