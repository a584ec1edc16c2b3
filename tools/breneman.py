"""Breneman's corresponding chromaticities: error of each adaptation against observers' matches.

    python -m tools.breneman

prints the table of docs/adaptation.md. Observers saw one picture with each eye, under two lights,
and matched 12 surfaces. Inputs, per experiment of colour-science's copy of the data:

- direction: from the test light (A, projector, D55) to the match light (D65, D55, green);
- whites: u'v' of the two "Illuminant" rows, Y = 100;
- colours: u'v' of the test rows with Y = 27 or 9, alternating as colour-science has it;
- luminance of the white, the same in both eyes: the table of primaries, 75 to 11 100 cd/m²;
- background Y_b = 30, hence L_A = 0.3 Y_n; surround average.

Linear transforms with a given D use only the chromaticities and the whites; Fairchild's and
CAT02's own D also use the luminances; Nayatani's and Guth's use everything. Experiments 5, 7 and 10
did not test a change of light; colour-science cannot read 9 (IndexError).

References
----------
[1] Breneman (1987), "Corresponding chromaticities for different states of adaptation to complex
    visual fields", JOSA A 4(6), 1115-1129. doi:10.1364/JOSAA.4.001115
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.adaptation import adapt
from volspec.appearance.adaptation.linear import Array
from volspec.appearance.spec import Triple, ViewingConditions
from volspec.spectra.datasets import colour_science

EXPERIMENTS = (1, 2, 3, 4, 6, 8, 11, 12)
# Luminance factors of Breneman's twelve surfaces, grey to purple.
Y_OF_SURFACES = (27, 9, 27, 27, 9, 27, 9, 9, 27, 9, 27, 9)
Y_B = 30.0
ROWS: tuple[tuple[str, str, float | None, bool], ...] = (
    # label, method, D, discount
    ("none", "none", None, False),
    ("von Kries", "von Kries", None, False),
    ("Bradford", "Bradford", None, False),
    ("Sharp", "Sharp", None, False),
    ("CAT02, D = 1", "CAT02", 1.0, False),
    ("CAT02", "CAT02", None, False),
    ("CAT16, D = 1", "CAT16", 1.0, False),
    ("CAT16", "CAT16", None, False),
    ("Nayatani", "Nayatani", None, False),
    ("CIE 1994", "CIE 1994", None, False),
    ("Guth", "Guth", None, False),
    ("Fairchild 1990", "Fairchild 1990", None, False),
    ("Fairchild 1990, discounting", "Fairchild 1990", None, True),
)


class Experiment(NamedTuple):
    """One of Breneman's experiments."""

    number: int
    lights: str
    Y_n: float
    """Luminance of both whites, cd/m²."""
    source: ViewingConditions
    target: ViewingConditions
    XYZ: Array
    """(12, 3) under the source."""
    matched: Array
    """(12, 2) u'v' under the target."""


def XYZ_from_uv(uv: ArrayLike, Y: ArrayLike) -> Array:
    """Convert (..., 2) u'v' of CIE 1976 and (...) Y to (..., 3) XYZ."""
    u, v = np.moveaxis(np.asarray(uv, dtype=np.float64), -1, 0)
    XYZ = np.stack([9.0 * u, 4.0 * v, 12.0 - 3.0 * u - 20.0 * v], axis=-1)
    return np.asarray(XYZ * (np.asarray(Y, dtype=np.float64) / (4.0 * v))[..., None])


def uv_from_XYZ(XYZ: ArrayLike) -> Array:
    """Convert (..., 3) XYZ to (..., 2) u'v' of CIE 1976."""
    X, Y, Z = np.moveaxis(np.asarray(XYZ, dtype=np.float64), -1, 0)
    return np.stack([4.0 * X, 9.0 * Y], axis=-1) / (X + 15.0 * Y + 3.0 * Z)[..., None]


@cache
def experiments() -> tuple[Experiment, ...]:
    """Return the eight usable experiments."""
    data = colour_science().corresponding
    found = []
    for number in EXPERIMENTS:
        light, *surfaces = data.BRENEMAN_EXPERIMENTS[number]
        about = data.BRENEMAN_EXPERIMENT_PRIMARIES_CHROMATICITIES[number]
        Y_n = float(about.Y)
        ends: list[ViewingConditions] = []
        for uv in (light.uv_t, light.uv_m):
            white: Triple = tuple(XYZ_from_uv(uv, 100.0).tolist())
            ends.append(ViewingConditions(white, L_A=Y_n * Y_B / 100.0, Y_b=Y_B))
        XYZ = XYZ_from_uv([each.uv_t for each in surfaces], np.array(Y_OF_SURFACES))
        matched = np.array([each.uv_m for each in surfaces])
        lights = " to ".join(about.illuminants)
        found.append(Experiment(number, lights, Y_n, ends[0], ends[1], XYZ, matched))
    return tuple(found)


def errors(method: str, D: float | None = None, discount: bool = False) -> Array:
    """Return Δu'v' between a transform's predictions and the matches.

    Parameters
    ----------
    method : str
        One of `volspec.appearance.adaptation.ADAPTATIONS`.
    D, discount
        For both sides, as in `ViewingConditions`.

    Returns
    -------
    (8, 12) float64
        A row per experiment.
    """
    rows = []
    for each in experiments():
        source = replace(each.source, D=D, discount=discount)
        target = replace(each.target, D=D, discount=discount)
        foretold = uv_from_XYZ(adapt(each.XYZ, source, target, method))
        rows.append(np.linalg.norm(foretold - each.matched, axis=-1))
    return np.array(rows)


def table() -> str:
    """Return the means of `errors` as Markdown, in thousandths."""
    heads = [f"{e.number}: {e.lights}, {e.Y_n:g}" for e in experiments()]
    lines = ["| 1000 Δu'v' | mean | worst | " + " | ".join(heads) + " |"]
    lines.append("|" + "---|" * (len(heads) + 3))
    for label, method, D, discount in ROWS:
        miss = 1000.0 * errors(method, D, discount)
        cells = [f"**{miss.mean():.1f}**", f"{miss.max():.0f}"]
        cells += [f"{each:.1f}" for each in miss.mean(axis=1)]
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
