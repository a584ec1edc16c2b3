"""Fit the shipped basis again: ``python -m volspec.basis.make [FILE]``.

Writes ``data/bases/general-7.json`` (or FILE) and prints its error tables. Reproducible: the
same versions of NumPy and colour-science give the same numbers to rounding.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from volspec._gpu.sources import asset
from volspec.basis.model import SpectralBasis
from volspec.spectra.library import light_set, reflectance_set

SIZE = 7
# All spiky lights together count this much against the smooth ones: enough to quarter their
# error, little enough that smooth lights stay far below what an eye can tell apart.
SPIKY_SHARE = 0.03


def fit_general(size: int = SIZE) -> SpectralBasis:
    """The general basis: 26 smooth and 89 spiky lights x 128 reflectances."""
    smooth, spiky = light_set("smooth"), light_set("spiky")
    weights = np.concatenate(
        [
            np.full(len(smooth), 1.0 / len(smooth)),
            np.full(len(spiky), SPIKY_SHARE / len(spiky)),
        ]
    )
    return SpectralBasis.fit(
        smooth + spiky,
        reflectance_set("training"),
        size=size,
        name=f"general-{size}",
        trained_on=(
            f"26 smooth lights and, weighted {SPIKY_SHARE:g}, 89 spiky lights; "
            "99 CES of CIE 224:2017 and 29 CIE colour rendering samples"
        ),
        light_weights=weights,
    )


def main(arguments: list[str]) -> int:
    """Fit, save, and print the tables."""
    path = Path(arguments[0]) if arguments else asset(f"data/bases/general-{SIZE}.json")
    basis = fit_general()
    basis.save(path)
    print(f"{path} (fingerprint {basis.fingerprint})")
    for name in ("smooth", "spiky"):
        print(f"\n{name} lights, held-out reflectances\n{basis.report(light_set(name))}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
