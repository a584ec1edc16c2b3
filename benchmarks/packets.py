"""Packets of rays on every OpenCL device that works: ``python -m benchmarks.packets``.

CPU time of both cores of a cast, 512², step of half a voxel, medians of alternating runs.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from statistics import median

import numpy as np

from benchmarks.cast import SIZE, STOPPED
from benchmarks.scenes import BenchScene, bench_scenes
from volspec._gpu import device_list as devices
from volspec.pipeline import Raycaster, raycast
from volspec.raycast.launch.packets import SAFE, Packet, choose_packet

RUNS = 7


def others(index: int) -> list[Packet]:
    """Return the packets to compare with `SAFE`."""
    # A compiler may end the process at what the trial has not seen to work.
    wide = choose_packet(index).lanes == 16
    return [Packet(8, True), *([Packet(16), Packet(16, True)] if wide else [])]


def rows(index: int, scene: BenchScene) -> Iterator[str]:
    """Yield a line of the table for each kind of cast."""
    known = others(index)
    casters = {
        packet: Raycaster(scene.volume, device=str(index), packet=packet)
        for packet in (SAFE, *known)
    }
    for kind, spec in STOPPED.items():
        given = scene.volume, scene.transfer, scene.camera, SIZE, spec
        times: dict[Packet, list[float]] = {packet: [] for packet in casters}
        pictures = {p: raycast(*given, caster=caster) for p, caster in casters.items()}
        for _ in range(RUNS):
            for packet, caster in casters.items():
                start = time.process_time()
                raycast(*given, caster=caster)
                times[packet].append(time.process_time() - start)
        ms = {packet: 1e3 * median(each) for packet, each in times.items()}
        off = max(
            float(np.abs(each.coefficients - pictures[SAFE].coefficients).max())
            for each in pictures.values()
        )
        gains = " | ".join(f"{ms[packet]:.0f} ({ms[SAFE] / ms[packet]:.2f})" for packet in known)
        yield f"| {scene.name}, {kind} | {ms[SAFE]:.0f} | {gains} | {off:.1g} |"


def main() -> None:
    """Print a table for each device."""
    found = devices.devices()
    for index, info in enumerate(found):
        if not info.is_cpu or devices.fault(index, found):
            continue
        print(f"\n{info.name}, {info.platform} {info.driver}: {choose_packet(index)}\n")
        known = others(index)
        print(f"| CPU ms (gain) | {SAFE} | {' | '.join(map(str, known))} | difference |")
        print("|---" * (len(known) + 3) + "|")
        for scene in bench_scenes():
            if isinstance(scene, tuple):
                print(f"| {scene[0]} | {scene[1]} |")
                continue
            for row in rows(index, scene):
                print(row, flush=True)


if __name__ == "__main__":
    main()
