"""Make the reflectances of sRGB's primaries and their sums again, which colour labels.

    python data/make_primaries.py

Red, green and blue of display codes 0 and 1, and cyan, magenta and yellow, as plausible
reflectances that have these colours under D65. A mix of the six and white with weights by Smits
(1999) has any sRGB colour under D65.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from volspec.spectra import SpectralGrid, reflectance_from_colour

NAMES = ("red", "green", "blue", "cyan", "magenta", "yellow")
CODES = ("#ff0000", "#00ff00", "#0000ff", "#00ffff", "#ff00ff", "#ffff00")
GRID = SpectralGrid(380, 730, 10)


def main() -> None:
    """Write ``data/spectra/srgb.csv``."""
    made = [reflectance_from_colour(code, grid=GRID).values.clip(0, 1) for code in CODES]
    rows = [
        ",".join([f"{nm:g}", *(f"{value:.5f}" for value in values)])
        for nm, values in zip(GRID.wavelengths_nm, np.array(made).T, strict=True)
    ]
    text = (
        "# sRGB's primaries and their sums as reflectances, BSD-3-Clause\n"
        "# made by data/make_primaries.py\n"
        f"nm,{','.join(NAMES)}\n"
    )
    path = Path(__file__).parent / "spectra" / "srgb.csv"
    path.write_text(text + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
