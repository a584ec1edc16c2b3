"""Speed of a GPU: ``python -m benchmarks.gpu [--device NAME]``.

Casts the engine with one ray per work-item, and for comparison on PoCL if installed; prints
milliseconds and pictures per second, and writes a row to the table of devices in
``docs/benchmarks.md``. A second run with the same device and commit replaces the row.
"""

from __future__ import annotations

import argparse
from dataclasses import astuple, dataclass
from datetime import UTC, datetime

import numpy as np

from benchmarks.cast import SPECS
from benchmarks.measure import PAGE, between, commit, in_turn, replaced
from benchmarks.scenes import BenchScene, bench_scene
from volspec._gpu.devices import POCL, all_devices, choose_device, devices
from volspec.pipeline import Raycaster, raycast

SIZES = {"512²": (512, 512), "1080p": (1920, 1080)}
TABLE = "devices"
HEAD = (
    "| device | driver | date | commit | "
    + " | ".join(f"{kind} {size}" for size in SIZES for kind in SPECS)
    + " |\n"
    + "|---" * (4 + len(SIZES) * len(SPECS))
    + "|\n"
)


@dataclass(frozen=True, slots=True)
class Record:
    """A row of the table: device, date, commit; a cell for each size and shading."""

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


def measured(
    scene: BenchScene, caster: Raycaster, pocl_caster: Raycaster | None
) -> tuple[str, ...]:
    """Return the cells, with the ratio to the peer if there is one."""
    cells = []
    for label, size in SIZES.items():
        for kind, spec in SPECS.items():

            def cast(which: Raycaster, size=size, spec=spec) -> object:
                return raycast(scene.volume, scene.transfer, scene.camera, size, spec, caster=which)

            pairs = in_turn(
                lambda: cast(caster), lambda: cast(pocl_caster) if pocl_caster else None
            )
            ms = float(np.median(pairs[:, 0]))
            gain = float(np.median(pairs[:, 1] / pairs[:, 0]))
            ratio = f", PoCL × {gain:.1f}" if pocl_caster else ""
            cells.append(f"{ms:.1f} ms, {1e3 / ms:.3g}/s{ratio}")
            print(f"{kind} {label}: {cells[-1]}", flush=True)
    return tuple(cells)


def main() -> None:
    """Measure, print and write the row."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--device", help="part of an OpenCL device's name; default the first GPU")
    wanted = parser.parse_args().device
    scene = bench_scene("engine")
    # By number, as several runtimes may have devices of the same name.
    number, found = choose_device(wanted), devices()
    info = found[number]
    caster = Raycaster(scene.volume, device=str(number), lanes=1)
    pocl = (i for i, d in enumerate(found) if d.platform == POCL and i != number)
    pocl_caster = next((Raycaster(scene.volume, device=str(i)) for i in pocl), None)
    driver = f"{info.platform} {all_devices()[number].driver_version.strip()}"
    print(f"{info.name} ({driver})" + (f" next to {pocl_caster.device}" if pocl_caster else ""))
    cells = measured(scene, caster, pocl_caster)
    date = datetime.now(UTC).date().isoformat()
    record = Record(info.name, driver, date, commit(), cells)
    PAGE.write_text(recorded(PAGE.read_text(encoding="utf-8"), record), encoding="utf-8")
    print(f"kept in {PAGE.name}")


if __name__ == "__main__":
    main()
