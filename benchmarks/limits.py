"""Distance of a cast from the machine's limits: ``python -m benchmarks.limits``.

Samples are counted on the host: every step of a ray in a brick that may be visible, until the ray
ends (one pixel in 64). Three small kernels measure the machine's roofs. The cost of a sample is
read off ``kernels/raycast.cl``; change `TAKEN` and `SEEN` with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from benchmarks.cast import SIZE, STOPPED
from benchmarks.measure import Figure, report
from benchmarks.scenes import BenchScene, bench_scenes
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source
from volspec.pipeline import Raycaster
from volspec.raycast import RaycastSpec
from volspec.raycast.launch.bricks import BRICK, brick_ranges, visible_bricks

EVERY = 8


@dataclass(frozen=True, slots=True)
class Need:
    """Cost of a sample: floating-point operations (a fused one is two) and scalar loads."""

    operations: int
    loads: int


# Every sample computes its position (45), interpolates (21), looks up its opacity (10) and
# composites (10); it loads four pairs of voxels and an entry of opacity.
TAKEN = Need(86, 5)
# A visible sample adds four weights (20) of two rows; shading adds gradients from the eight rows
# around (80; the voxels before and after a row are loaded with it), their direction (35) and a
# highlight (15).
SEEN = {"flat": Need(20, 2), "shaded": Need(150, 10)}

_KERNELS = """
__kernel void triad(__global const float8 *a, __global const float8 *b, __global float8 *c) {
    const size_t i = get_global_id(0);
    c[i] = a[i] + 3.0f * b[i];
}
__kernel void fused(__global float8 *out, const int loops) {
    float8 r[10];
    for (int i = 0; i < 10; ++i) r[i] = (float8)(get_global_id(0) + i);
    for (int n = 0; n < loops; ++n)
        _Pragma("unroll") for (int i = 0; i < 10; ++i) r[i] = r[i] * 0.999f + 0.5f;
    float8 sum = 0.0f;
    for (int i = 0; i < 10; ++i) sum += r[i];
    out[get_global_id(0)] = sum;
}
typedef union { int8 v; int s[8]; } int8s;
__kernel void loads(__global const ushort *in, __global int8 *out, const int loops) {
    int8s at, word;
    at.v = (int8)(0, 1, 2, 3, 256, 257, 258, 259) + (int)get_global_id(0);
    int8 sum = 0;
    for (int n = 0; n < loops; ++n) {
        _Pragma("unroll") for (int row = 0; row < 4; ++row) {
            for (int l = 0; l < 8; ++l) word.s[l] = in[(uint)at.s[l] + 67 * row];
            sum += word.v;
        }
        at.v = (at.v + 61) & 8191;
    }
    out[get_global_id(0)] = sum;
}
"""
_LOADS, _FUSED = 4 * 8, 10 * 8 * 2


@dataclass(frozen=True, slots=True)
class Roofs:
    """Rates per second: bytes of memory, operations, loads from the nearest cache into vectors."""

    bytes: float
    operations: float
    loads: float


def roofs() -> Roofs:
    """Measure the device for casts; best of five."""
    compute = Compute.open()
    source = Source(_KERNELS, ("", "benchmarks/limits.py"))
    items, loops, floats = 64 * compute.info.compute_units, 50_000, 1 << 24
    big = [compute.output(4 * floats) for _ in range(3)]
    small = compute.upload(np.zeros(1 << 15, np.uint16))

    def rate(name: str, items: int, arguments: tuple[object, ...], amount: float) -> float:
        kernel = compute.kernel(source, name, ("-cl-mad-enable",))

        def call() -> None:
            kernel(compute.queue, (items,), None, *arguments)
            compute.queue.finish()

        return amount / min(_seconds(call) for _ in range(5))

    loops_argument = np.int32(loops)
    return Roofs(
        rate("triad", floats // 8, tuple(big), 3 * 4 * floats),
        rate("fused", items, (big[0], loops_argument), items * loops * _FUSED),
        rate("loads", items, (small, big[0], loops_argument), items * loops * _LOADS),
    )


def _seconds(call: Callable[[], object]) -> float:
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


def _cast_seconds(caster: Raycaster, scene: BenchScene, spec: RaycastSpec) -> float:
    table = scene.transfer.bake(min(scene.volume.spacing_mm))
    times = [_seconds(lambda: caster.cast(table, scene.camera, SIZE, spec)) for _ in range(6)]
    return median(times[1:])


def samples(scene: BenchScene, spec: RaycastSpec) -> tuple[int, int]:
    """Return the samples of a cast of `SIZE`, in visible bricks until rays end; and the visible."""
    volume = scene.volume
    table = scene.transfer.bake(min(volume.spacing_mm))
    step = spec.step_of(volume)
    opacity = table.step_opacity(step)
    low, high = brick_ranges(volume.values)
    visible = visible_bricks(low, high, table.domain, opacity)
    start, along = _rays(scene, EVERY)
    top = np.array(volume.shape_xyz) - 1.0
    with np.errstate(divide="ignore"):
        ends = np.stack([-start / along, (top - start) / along])
    near, far = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    at = np.linspace(*table.domain, len(opacity))
    left = np.where(far > near, 1.0, 0.0)
    k, taken, seen = np.ceil(np.maximum(near, 0) / step), 0, 0
    while (live := np.flatnonzero((left > spec.least_transmittance) & (k * step < far))).size:
        point = np.clip(start[live] + ((k[live] + 0.5) * step)[:, None] * along[live], 0, top)
        x, y, z = (point // BRICK).astype(int).T
        inside = visible[z, y, x]
        taken += int(inside.sum())
        # The nearest voxel's value is accurate enough for a count.
        i, j, h = np.rint(point[inside]).astype(int).T
        covers = np.interp(volume.values[h, j, i], at, opacity)
        seen += int((covers > 0).sum())
        left[live[inside]] *= 1 - covers
        k[live] += 1
    return taken * EVERY**2, seen * EVERY**2


def _rays(scene: BenchScene, every: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return start and direction (index space, per millimetre) of one pixel in every²."""
    field = scene.camera.ray_field(*SIZE)
    pixels = np.mgrid[every // 2 : SIZE[1] : every, every // 2 : SIZE[0] : every]
    y, x = (grid.reshape(-1, 1) for grid in pixels)
    offset = (x - field.middle[0]) * field.across + (y - field.middle[1]) * field.down
    direction = field.forward * field.distance + offset
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    matrix = scene.volume.index_from_world
    origin = matrix[:3, :3] @ (field.target - field.forward * field.distance) + matrix[:3, 3]
    along = direction @ matrix[:3, :3].T
    return np.broadcast_to(origin, along.shape), np.where(along == 0, 1e-12, along)


def figures() -> Iterator[Figure]:
    """Yield samples per second, and the fraction of the lowest roof."""
    roof = roofs()
    yield Figure("limits/memory", roof.bytes / 1e9, unit="GB/s")
    yield Figure("limits/operations", roof.operations / 1e9, unit="G/s")
    yield Figure("limits/loads", roof.loads / 1e9, unit="G/s")
    for scene in bench_scenes():
        if not isinstance(scene, BenchScene):
            continue  # cast.py says why
        caster = Raycaster(scene.volume)
        for kind, spec in STOPPED.items():
            seconds = _cast_seconds(caster, scene, spec)
            (taken, seen), more = samples(scene, spec), SEEN[kind]
            operations = taken * TAKEN.operations + seen * more.operations
            loads = taken * TAKEN.loads + seen * more.loads
            bounds = {
                "memory": scene.volume.values.nbytes / roof.bytes,
                "operations": operations / roof.operations,
                "loads": loads / roof.loads,
            }
            lowest = max(bounds, key=bounds.__getitem__)
            name = f"limits/{scene.name}/{kind}"
            print(
                f"{name:28s} {seconds * 1e3:7.1f} ms {taken / 1e6:7.2f} M samples, "
                f"{seen / 1e6:7.2f} M seen   "
                + "   ".join(f"{key} {100 * s / seconds:3.0f} %" for key, s in bounds.items()),
                flush=True,
            )
            yield Figure(name, taken / seconds / 1e6, unit="M/s")
            yield Figure(f"{name}: of {lowest}", 100 * bounds[lowest] / seconds, unit="%")


if __name__ == "__main__":
    print(report(list(figures())))
