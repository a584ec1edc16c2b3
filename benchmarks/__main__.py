"""``make bench``: every figure on screen, the times behind them in ``build/bench.json``.

``python -m benchmarks --keep`` puts the figures into ``docs/benchmarks.md``, too.
"""

from __future__ import annotations

import sys
from datetime import UTC, datetime

from benchmarks import (
    cast,
    channels,
    edit,
    export,
    gl_mapper,
    light,
    limits,
    memory,
    models,
    palette,
    picture,
    reading,
    session,
    shadows,
    viewer,
    webpage,
)
from benchmarks.measure import commit, report, save
from benchmarks.page import PAGE, replaced
from volspec._gpu.opencl import Compute

# Where VTK draws through GL, the windows that it opens end other contexts: those come last.
MODULES = (
    *(memory, reading, channels, edit, shadows, palette, limits, models, picture, export),
    *(cast, gl_mapper, light, viewer, webpage, session),
)


def keep(table: str) -> None:
    """Put the table into the page, with where and when it was made."""
    where = f"{Compute.open().info.name}, {datetime.now(UTC).date().isoformat()}, {commit()}"
    content = f"\n```text\n{where}\n{table}\n```\n"
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(text, "figures", content), encoding="utf-8")
    print(f"kept in {PAGE.name}")


def main() -> None:
    """Measure everything; the table comes last."""
    figures = [figure for module in MODULES for figure in module.figures()]
    save(figures)
    table = report(figures)
    print(table)
    if "--keep" in sys.argv[1:]:
        keep(table)


if __name__ == "__main__":
    main()
