"""Does memory grow over a day's work? ``python -m benchmarks.drift [LOADS]``, without a window.

Each of five shipped scenes is loaded in turn, cast with changing cameras, transfer functions and
settings, and relit with a new light and viewing for every frame, on OpenGL and with NumPy. Kinds of
lights, models and settings repeat in the same order at every load, with new numbers: one-time
allocations (a kernel, a shader, a library's code) are over after the fifth load.

A line per load separates leaks from fragmentation: leaks grow heap blocks in use and resident
memory, fragmentation only the latter. Counts of Python blocks, cache entries and OpenCL buffers
show the owner.
"""

from __future__ import annotations

import ctypes
import gc
import random
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import _lru_cache_wrapper
from itertools import cycle, product
from typing import Any

import numpy as np

import volspec as vs
from benchmarks.measure import Figure, report
from benchmarks.memory import Ledger, resident
from volspec._gpu.sources import asset
from volspec.appearance.lut3d import needs_host_lut
from volspec.appearance.spec import MODELS, SURROUNDS, Viewing
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.pipeline import Raycaster, Relighter, raycast
from volspec.raycast import ClipPlane
from volspec.relight import LightRig, RelightSpec
from volspec.scene import Scene
from volspec.spectra import SpectralGrid, Spectrum
from volspec.viewer.work.pictures import return_large_blocks

ASKED = 1.0
LOADS, WARM = 20, 5
SCENES = ("engine", "engine-cut", "engine-groups", "engine-surfaces", "figure-6")
# For each load: views of two casts, and frames for each cast. NumPy relights one in ten.
VIEWS, FRAMES = 25, 20
_SIZES = ((96, 72), (128, 96), (64, 64), (160, 120), (48, 96))
_SETTINGS: tuple[dict[str, Any], ...] = (
    *({}, {"half": True}, {"jitter": 1.0}, {"step_mm": 1.0}, {"ambient": 1.0, "diffuse": 0.0}),
    *({"crop_voxels": ((20, 200), (20, 200), (10, 100))}, {"light_cells": 32}),
    {"clip_planes": (ClipPlane((128, 128, 64), (1, 1, 0)),)},
)
# The host computes LUTs for Hunt and Nayatani 95 in a second each, so only NumPy uses them.
_CLOSED = [model for model in MODELS if not needs_host_lut(model)]


class _Heap(ctypes.Structure):
    """mallinfo2(3) of glibc."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


def heap_in_use() -> int:
    """Return the bytes in malloc blocks that are in use; 0 if the C library does not count them."""
    count = getattr(ctypes.CDLL(None), "mallinfo2", None)
    if count is None:
        return 0
    count.restype = _Heap
    heap = count()
    return int(heap.uordblks + heap.hblkhd)


def cache_entries() -> int:
    """Return the number of entries in all function caches of the process."""
    caches = (each for each in gc.get_objects() if isinstance(each, _lru_cache_wrapper))
    return sum(each.cache_info().currsize for each in caches)


class Cycle:
    """The work of one load after the other."""

    def __init__(self, seed: int = 5) -> None:
        self._dice = random.Random(seed)
        self._names = cycle(SCENES)
        self._sizes = cycle(_SIZES)
        self._settings = cycle(_SETTINGS)
        self._kinds = cycle(range(4))
        looks = (SURROUNDS, (np.uint8, np.float32))
        self._looks = {
            "gl": cycle(product(_CLOSED, *looks)),
            "numpy": cycle(product(MODELS, *looks)),
        }
        self._adapting = cycle((*("given",) * 30, "picture", "pixel"))
        self.casts = self.frames = 0

    def load(self, views: int = VIEWS, frames: int = FRAMES) -> str:
        """Load a scene, cast and relight it, and free everything; return its name."""
        name = next(self._names)
        scene = Scene.load(asset(f"data/scenes/{name}.toml"))
        caster = Raycaster(scene.volume())
        for _ in range(views):
            size = next(self._sizes)
            with ExitStack() as stack:
                image = self._cast(scene, caster, size)
                relighters = {
                    backend: stack.enter_context(Relighter(image, backend))
                    for backend in self._looks
                }
                self._relight(scene, image, relighters, frames)
                image = self._cast(scene, caster, size)
                for relighter in relighters.values():
                    relighter.update(image)
                self._relight(scene, image, relighters, frames)
        return name

    def _cast(self, scene: Scene, caster: Raycaster, size: tuple[int, int]) -> CoefficientImage:
        volume, uniform = caster.volume, self._dice.uniform
        camera = Camera.orbit(
            volume,
            azimuth_deg=uniform(0, 360),
            elevation_deg=uniform(-60, 60),
            zoom=uniform(1.0, 2.0),
        )
        changes = {"light_cells": 24, "alpha_stop": uniform(0.9, 1.0)} | next(self._settings)
        spec = replace(scene.raycast, **changes)
        part = "surfaces" if hasattr(scene.transfer, "surfaces") else "points"
        rows = getattr(scene.transfer, part)
        paler = [(value, opacity * uniform(0.5, 1.0), mix) for value, opacity, mix in rows]
        self.casts += 1
        transfer = replace(scene.transfer, **{part: paler})
        return raycast(volume, transfer, camera, size, spec, caster=caster)

    def _relight(
        self,
        scene: Scene,
        image: CoefficientImage,
        relighters: dict[str, Relighter],
        frames: int,
    ) -> None:
        for number in range(frames):
            backend = "numpy" if number % 10 == 9 else "gl"
            model, surround, dtype = next(self._looks[backend])
            adapting = next(self._adapting)
            viewing = Viewing(
                model=model if adapting == "given" else "CAM16",
                surround=surround,
                exposure=self._dice.uniform(0.5, 2.0),
                adapting=adapting,
            )
            rig = self._rig(scene.basis.grid, list(image.groups))
            level = "absolute" if number % 7 == 6 else "relative"
            backdrop = self._dice.random()
            relighters[backend].frame(
                rig, RelightSpec(viewing, backdrop=backdrop, level=level), dtype
            )
            self.frames += 1

    def _rig(self, grid: SpectralGrid, groups: list[str]) -> LightRig:
        """Return one to three lights with new spectra, weights, lux and light groups."""
        lights = tuple(self._light(grid) for _ in range(self._dice.randint(1, 3)))
        return LightRig(
            lights,
            [self._dice.uniform(0.1, 1.0) for _ in lights],
            [self._dice.uniform(50, 5000) for _ in lights],
            # The first shines from all groups, so that none is dark.
            ["", *(self._dice.choice(["", *groups]) for _ in lights[1:])],
        )

    def _light(self, grid: SpectralGrid) -> Spectrum:
        kind, uniform = next(self._kinds), self._dice.uniform
        if kind == 0:
            return vs.light(f"planck:{uniform(1500, 20000)}", grid)
        if kind == 1:
            return vs.light(f"daylight:{uniform(4000, 25000)}", grid)
        if kind == 2:
            return vs.light(f"D65*{uniform(0, 1):.6f}+FL2*{uniform(0.1, 1):.6f}", grid)
        nm = grid.wavelengths_nm
        line = np.exp(-(((nm - uniform(420, 680)) / uniform(8, 60)) ** 2))
        return Spectrum(nm, 0.01 + line, f"line {uniform(0, 1)}")


def figures(loads: int = LOADS) -> Iterator[Figure]:
    """Compare memory after the last load with memory after the fifth.

    Resident memory can hide a leak for a while, as freed blocks in the heap are used up first;
    blocks in use have the same limit.
    """
    if loads <= WARM or loads % len(SCENES):
        raise ValueError(
            f"drift: {loads} loads; give 10, 15, 20 or more, as a scene is compared with itself"
        )
    return_large_blocks()  # as the viewer does
    ledger, work, began = Ledger(), Cycle(), time.perf_counter()
    ledger.watch()
    rows = [_row()]
    print("load     s  resident MiB  heap MiB  Python blocks  cached  buffers  scene")
    for number in range(1, loads + 1):
        name = work.load()
        rows.append(_row())
        size, heap, blocks = rows[-1]
        print(
            f"{number:4d} {time.perf_counter() - began:5.0f} {size / 2**20:13.1f}"
            f" {heap / 2**20:9.2f} {blocks:14d} {cache_entries():7d} {ledger.live:8d}  {name}",
            flush=True,
        )
    start, warm, end = rows[0], rows[WARM], rows[-1]
    begin, then, now = (f"{size / 2**20:.1f} MiB" for size, *_ in (start, warm, end))
    print(
        f"{work.casts} casts, {work.frames} lights, {loads} loads: resident {begin} at the start,"
    )
    print(f"{then} after load {WARM}, {now} at the end")
    for what, before, after in zip(("resident", "heap", "Python"), warm, end, strict=True):
        grown = 100.0 * (after / before - 1.0) if before else None
        note = "" if before else "the C library does not count its blocks"
        yield Figure(f"drift: {what} grown", grown, ASKED, at_most=True, unit="%", note=note)


def _row() -> tuple[int, int, int]:
    """Return resident bytes, heap bytes in use and the number of Python's blocks."""
    gc.collect()
    return resident("VmRSS"), heap_in_use(), sys.getallocatedblocks()


if __name__ == "__main__":
    found = list(figures(int(sys.argv[1]) if len(sys.argv) > 1 else LOADS))
    print(report(found))
    sys.exit(any(figure.met is False for figure in found))
