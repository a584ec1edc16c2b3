"""Does halving the step at least halve the error? ``python -m benchmarks.convergence``.

RMS and maximum error of the channels against a very fine step, without jitter or early ray
termination; the order is log2 of the error ratio when the step is halved. The table goes into
``docs/benchmarks.md``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.measure import PAGE, replaced
from benchmarks.scenes import bench_scene
from volspec.pipeline import Raycaster
from volspec.raycast import Camera, RaycastSpec
from volspec.transfer import TransferTable
from volspec.volume import Volume, phantom

SIZE = (256, 256)
STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
FINEST = 1 / 64
SPECS = {
    "flat": RaycastSpec(ambient=1, diffuse=0, alpha_stop=1),
    "shaded": RaycastSpec(ambient=0.3, diffuse=0.7, alpha_stop=1),
}


@dataclass(frozen=True, slots=True)
class Error:
    """Error of one step size, in voxels, against the finest."""

    step: float
    rms: float
    most: float


def ball() -> tuple[Volume, TransferTable, Camera]:
    """Return a smooth phantom: opacity and grey are linear in a value that is a cone in space."""
    volume = phantom.ball(64)
    rise = np.linspace(0, 1, 1024)
    return volume, TransferTable((0, 1), 0.1 * rise, rise[:, None], 1.0), Camera.orbit(volume)


def engine() -> tuple[Volume, TransferTable, Camera]:
    """Return the demo: metal edges, a transfer function with corners."""
    scene = bench_scene("engine")
    return scene.volume, scene.transfer.bake(min(scene.volume.spacing_mm)), scene.camera


def errors(
    volume: Volume, table: TransferTable, camera: Camera, spec: RaycastSpec
) -> Iterator[Error]:
    """Halve the step."""
    caster, unit = Raycaster(volume), min(volume.spacing_mm)

    def channels(step: float) -> np.ndarray:
        stepped = replace(spec, step_mm=step * unit)
        return caster.cast(table, camera, SIZE, stepped)[0].astype(np.float64)

    truth = channels(FINEST)
    for step in STEPS:
        off = np.abs(channels(step) - truth)
        yield Error(step, float(np.sqrt(np.mean(off**2))), float(off.max()))


def table() -> str:
    """Return the table for the page."""
    lines = [
        "| volume | shading | step, voxels | RMS | greatest | order |",
        "|---|---|---|---|---|---|",
    ]
    for make in (ball, engine):
        for kind, spec in SPECS.items():
            last = None
            for error in errors(*make(), spec):
                order = f"{math.log2(last.rms / error.rms):.2f}" if last else ""
                lines.append(
                    f"| {make.__name__} | {kind} | {error.step:g} | {error.rms:.1e} | "
                    f"{error.most:.1e} | {order} |"
                )
                last = error
    return "\n".join(lines)


if __name__ == "__main__":
    found = table()
    print(found)
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(text, "convergence", f"\n{found}\n"), encoding="utf-8")
