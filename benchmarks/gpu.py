"""Speed of a GPU: ``python -m benchmarks.gpu [--device NAME]``.

Casts the engine with one ray per work-item, changes its light, and turns it with the picture passed
from OpenCL to OpenGL through the host and in shared memory; where PoCL is installed, casts there
for comparison. Prints milliseconds and pictures per second, and writes a row to the table of
devices in ``docs/benchmarks.md``. A second run with the same device and commit replaces the row.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass
from datetime import UTC, datetime
from itertools import chain, count, cycle
from typing import Any

import numpy as np

from benchmarks.measure import PAGE, between, commit, in_turn, replaced
from benchmarks.scenes import SPECS, BenchScene, bench_scene
from volspec._gpu.device_list import POCL, all_devices, choose_device, devices
from volspec._gpu.opengl import headless_context
from volspec._gpu.sharing import sharing_fault
from volspec._gpu.sources import asset
from volspec.camera import Camera
from volspec.pipeline import Raycaster, Relighter, raycast
from volspec.scene import Scene

FULL_HD = (1920, 1080)
SIZES = {"512²": (512, 512), "1080p": FULL_HD}
RELIT = ("light 1080p", "turn 1080p, through host", "turn 1080p, shared")
COLUMNS = (*(f"{kind} {size}" for size in SIZES for kind in SPECS), *RELIT)
TABLE = "devices"
HEAD = (
    "| device | driver | date | commit | "
    + " | ".join(COLUMNS)
    + " |\n"
    + "|---" * (4 + len(COLUMNS))
    + "|\n"
)


@dataclass(frozen=True, slots=True)
class Record:
    """A row of the table: device, driver, date, commit; a cell for each of `COLUMNS`."""

    device: str
    driver: str
    date: str
    commit: str
    cells: tuple[str, ...]

    def line(self) -> str:
        """Markdown."""
        *words, cells = astuple(self)
        return "| " + " | ".join(word.replace("|", "/") for word in (*words, *cells)) + " |"

    def replaces(self, line: str) -> bool:
        """Return True if a row of the table has this device and commit."""
        cells = [cell.strip() for cell in line.split("|")]
        return len(cells) > 4 and (cells[1], cells[4]) == (self.device, self.commit)


def recorded(text: str, record: Record) -> str:
    """Return the page with the record in its table of devices."""
    rows = between(text, TABLE).strip().splitlines()[2:]
    kept = [row for row in rows if not record.replaces(row)]
    return replaced(text, TABLE, "\n" + HEAD + "\n".join([*kept, record.line()]) + "\n")


def cell(milliseconds: float) -> str:
    """Return milliseconds and pictures per second."""
    return f"{milliseconds:.1f} ms, {1e3 / milliseconds:.3g}/s"


def cast_cells(
    scene: BenchScene, caster: Raycaster, pocl_caster: Raycaster | None
) -> Iterator[str]:
    """Yield the times of casts, with the ratio to the peer if there is one."""
    for size in SIZES.values():
        for spec in SPECS.values():

            def cast(which: Raycaster | None, size=size, spec=spec) -> object:
                return which and raycast(
                    scene.volume, scene.transfer, scene.camera, size, spec, caster=which
                )

            pairs = in_turn(lambda: cast(caster), lambda: cast(pocl_caster)).wall
            gain = float(np.median(pairs[:, 1] / pairs[:, 0]))
            ratio = f", PoCL × {gain:.1f}" if pocl_caster else ""
            yield cell(float(np.median(pairs[:, 0]))) + ratio


def relit_cells(
    bench: BenchScene, context: Any, caster: Raycaster, sharing: Raycaster | None
) -> Iterator[str]:
    """Yield the times of a light change and of a turn, which wait for OpenGL to finish.

    ``sharing`` shares the moderngl.Context, if the device can. Nothing is read back: as in the
    viewer, whose window draws the result.
    """
    scene = Scene.load(asset("data/scenes/engine.toml"))
    lights = cycle([light.rig for light in scene.lights])
    views = (Camera.orbit(bench.volume, azimuth_deg=7 * n) for n in count())

    def cast(which: Raycaster, into: Relighter | None = None) -> Any:
        return raycast(
            bench.volume,
            bench.transfer,
            next(views),
            FULL_HD,
            SPECS["shaded"],
            caster=which,
            into=into,
        )

    with Relighter(cast(caster), "gl", context=context) as relighter:

        def draw() -> None:
            with context:
                relighter.draw(next(lights), scene.relight.viewing)
                context.finish()

        def turn(which: Raycaster) -> None:
            cast(which, into=relighter)
            draw()

        yield cell(median_ms(draw))
        yield cell(median_ms(lambda: turn(caster)))
        yield cell(median_ms(lambda: turn(sharing))) if sharing else "–"


def median_ms(call: Callable[[], object]) -> float:
    """Return the median time of a call after another."""
    return float(np.median(in_turn(call, lambda: None, runs=15).wall[:, 0]))


def main() -> None:
    """Measure, print and write the row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", help="part of an OpenCL device's name; default the first GPU")
    wanted = parser.parse_args().device
    scene = bench_scene("engine")
    # By number, as several runtimes may have devices of the same name.
    number, found = choose_device(wanted), devices()
    info, device = found[number], all_devices()[number]
    caster = Raycaster(scene.volume, device=str(number), lanes=1)
    pocl = (i for i, d in enumerate(found) if d.platform == POCL and i != number)
    pocl_caster = next((Raycaster(scene.volume, device=str(i)) for i in pocl), None)
    context = headless_context()
    fault = sharing_fault(device, context)
    sharing = None if fault else Raycaster(scene.volume, device=str(number), context=context)
    driver = f"{info.platform} {device.driver_version.strip()}"
    print(f"{info.name} ({driver})" + (f" next to {pocl_caster.device}" if pocl_caster else ""))
    print(f"OpenGL: {context.info['GL_RENDERER']}{f'; {fault}' if fault else ''}")
    casts = cast_cells(scene, caster, pocl_caster)
    relit = relit_cells(scene, context, caster, sharing)
    cells = []
    for column, text in zip(COLUMNS, chain(casts, relit), strict=True):
        print(f"{column}: {text}", flush=True)
        cells.append(text)
    date = datetime.now(UTC).date().isoformat()
    record = Record(info.name, driver, date, commit(), tuple(cells))
    PAGE.write_text(recorded(PAGE.read_text(encoding="utf-8"), record), encoding="utf-8")
    print(f"kept in {PAGE.name}")


if __name__ == "__main__":
    main()
