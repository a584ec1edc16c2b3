"""Fit the shipped bases again: ``python -m volspec.basis.make [NAME ...]``.

Writes ``data/bases/NAME.json``, all of them or those named, and prints their error tables.
Reproducible: the same versions of NumPy and colour-science give the same numbers to rounding.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from volspec._gpu.sources import asset
from volspec.basis.model import SpectralBasis
from volspec.errors import BasisError, nearest
from volspec.spectra.library import light_set, reflectance_set

SIZES = (5, 7, 9)
# All spiky lights together count this much against the smooth ones: enough to quarter their
# error, little enough that smooth lights stay far below what an eye can tell apart.
SPIKY_SHARE = 0.03
# Sensors held positive have several minima.
_RESTARTS = {"": 0, "-positive": 8}
_REFLECTANCES = "99 CES of CIE 224:2017 and 29 CIE colour rendering samples"

NAMES = tuple(
    [f"{lights}-{m}{sign}" for lights in ("general", "smooth") for m in SIZES for sign in _RESTARTS]
    + [f"exact-{m}" for m in SIZES]
)
"""``general`` and ``exact`` are trained on all lights, ``smooth`` on the smooth ones."""


def fit_shipped(name: str) -> SpectralBasis:
    """Fit a shipped basis on the 128 training reflectances.

    Parameters
    ----------
    name : str
        One of `NAMES`.

    Raises
    ------
    BasisError
        If the name is unknown.
    """
    if name not in NAMES:
        raise BasisError(
            f"basis {name!r} does not ship; {nearest(name, NAMES)}shipped: {', '.join(NAMES)}"
        )
    lights, size = name.removesuffix("-positive").split("-")
    sign = "-positive" if name.endswith("-positive") else ""
    smooth, spiky = light_set("smooth"), light_set("spiky")
    options: dict[str, Any] = {"positive": bool(sign), "restarts": _RESTARTS[sign]}
    if lights == "exact":
        options = {"method": "reduced-rank"}
        said = f"{len(smooth)} smooth and {len(spiky)} spiky lights"
    elif lights == "smooth":
        said = f"{len(smooth)} smooth lights"
    else:
        shares = [1.0 / len(smooth), SPIKY_SHARE / len(spiky)]
        options["light_weights"] = np.repeat(shares, [len(smooth), len(spiky)])
        said = (
            f"{len(smooth)} smooth lights and, weighted {SPIKY_SHARE:g}, {len(spiky)} spiky lights"
        )
    return SpectralBasis.fit(
        smooth if lights == "smooth" else smooth + spiky,
        reflectance_set("training"),
        size=int(size),
        name=name,
        trained_on=f"{said}; {_REFLECTANCES}",
        **options,
    )


def main(names: list[str]) -> int:
    """Fit, save, and print the tables."""
    for name in names or NAMES:
        basis = fit_shipped(name)
        path = asset("data/bases") / f"{name}.json"
        basis.save(path)
        print(f"{path} (fingerprint {basis.fingerprint})")
        for kind in ("smooth", "spiky"):
            print(f"\n{kind} lights, held-out reflectances\n{basis.report(light_set(kind))}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
