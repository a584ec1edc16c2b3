"""``make bench``: print every figure, and write the times behind them to ``build/bench.json``.

``python -m benchmarks --keep`` also writes the figures to ``docs/benchmarks.md``.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime

from benchmarks import (
    cast,
    colour,
    equal_error,
    export,
    fields,
    larger,
    layers,
    limits,
    memory,
    models,
    palette,
    picture,
    reading,
    recompose,
    rooms,
    served,
    session,
    surfaces,
    viewer,
    webpage,
    witness_mitsuba,
)
from benchmarks.measure import PAGE, commit, replaced, report, save
from volspec._gpu.opencl import Compute

# VTK's GPU mapper opens windows, which end other GL contexts, so it runs late.
FIGURES = (
    *(colour.figures, memory.figures, reading.figures, cast.channel_figures, cast.edit_figures),
    *(cast.shadow_figures, palette.figures, limits.figures, models.figures, picture.figures),
    *(
        rooms.figures,
        surfaces.figures,
        fields.figures,
        larger.figures,
        layers.figures,
        recompose.figures,
        witness_mitsuba.figures,
        export.figures,
        cast.figures,
        cast.vtk_gpu_figures,
        equal_error.figures,
    ),
    *(viewer.figures, webpage.figures, webpage.layered_figures, served.figures, session.figures),
)


def keep(table: str) -> None:
    """Write the table to the page, with its device, date and commit."""
    where = f"{Compute.open().info.name}, {datetime.now(UTC).date().isoformat()}, {commit()}"
    content = f"\n```text\n{where}\n{table}\n```\n"
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(text, "figures", content), encoding="utf-8")
    print(f"kept in {PAGE.name}")


def main() -> None:
    """Measure everything, then print the table."""
    figures = [figure for figures_of in FIGURES for figure in figures_of()]
    save(figures)
    table = report(figures)
    print(table)
    if "--keep" in sys.argv[1:]:
        keep(table)


if __name__ == "__main__":
    main()
