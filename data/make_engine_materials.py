"""Make the two reflectances of the engine scene again: a metameric pair.

    python data/make_engine_materials.py

The block is a plain grey with a touch of blue. The inserts match it exactly under D65 and differ as
far as a smooth reflectance can under tungsten (light A), towards red: a linear program in the
81 bands, with X Y Z under D65 equal, 0.03 ≤ r ≤ 0.95 and bounded second differences. So the
inserts are hidden by daylight and revealed by a lamp.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import linprog

from volspec.spectra import DEFAULT_GRID, colour_matching_functions, light

FOLDER = Path(__file__).parent / "spectra"
MAX_SECOND_DIFFERENCE = 0.02


def main() -> None:
    """Write ``data/spectra/engine-block.csv`` and ``engine-inserts.csv``."""
    wavelengths = DEFAULT_GRID.wavelengths_nm
    block = 0.45 - 0.06 * (wavelengths - 550) / 150
    matching = colour_matching_functions(DEFAULT_GRID)
    seen = {}
    for name in ("D65", "A"):
        weighted = matching * light(name).values
        seen[name] = weighted / weighted.sum(axis=1, keepdims=True)
    bend = np.diff(np.eye(len(wavelengths)), 2, axis=0)
    solution = linprog(
        -(seen["A"][0] - seen["A"][1]),
        A_ub=np.vstack([bend, -bend]),
        b_ub=np.full(2 * len(bend), MAX_SECOND_DIFFERENCE),
        A_eq=seen["D65"],
        b_eq=seen["D65"] @ block,
        bounds=[(0.03, 0.95)] * len(wavelengths),
    )
    for name, values in (("block", block), ("inserts", solution.x)):
        rows = "\n".join(
            f"{nm:g},{value:.6f}" for nm, value in zip(wavelengths, values, strict=True)
        )
        text = (
            f"# Engine {name}, BSD-3-Clause\n"
            "# designed: by data/make_engine_materials.py\nnm,value\n"
        )
        (FOLDER / f"engine-{name}.csv").write_text(text + rows + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
