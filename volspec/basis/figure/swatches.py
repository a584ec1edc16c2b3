"""The worst colours of a basis side by side with the true ones.

[swatches] -> figure
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from volspec.basis.figure.style import shortened, write
from volspec.basis.report.errors import WAYS, BasisReport, WorstPair, own_way
from volspec.basis.report.text import heading_of, number

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from volspec.basis.report.table import ErrorTable

# L* = 50: colours are judged on a neutral grey.
_GREY, _ON_GREY, _QUIET = "#777777", "white", "#e4e4e4"
_MOST = 9
_GAP = 0.14
STRIP_IN = 1.92
"""Height of the strip."""


def draw_swatches(axes: Axes, errors: ErrorTable) -> None:
    """The worst reflectance under each of the worst lights, class by class, on neutral grey.

    The upper left half is the colour of the full spectra, the lower right half the channels'.
    Axes are in inches.
    """
    figure = axes.get_figure()
    assert figure is not None
    box = axes.get_window_extent()
    wide, tall = box.width / figure.dpi, box.height / figure.dpi
    axes.set(xlim=(0, wide), ylim=(0, tall))
    axes.set_axis_off()
    axes.fill((0, 0, wide, wide), (0, tall, tall, 0), color=_GREY, linewidth=0)
    way = own_way(errors.method)
    shares = shared_out(_MOST, [len(r.pairs.lights) for r in errors.classes.values()])
    groups = {
        name: worst_pairs(report, share, way)
        for (name, report), share in zip(errors.classes.items(), shares, strict=True)
    }
    count = sum(map(len, groups.values()))
    between = 0.16 * (len(groups) - 1)
    width = (wide - 0.3 - between - _GAP * (count - 1)) / count
    size = min(width, 0.86)
    pitch = min(width + _GAP, 1.4)
    x = 0.15
    top = tall - 0.56
    by = "" if way == "componentwise" else f", {WAYS[way]}"
    key = f"worst colours: upper left, the full spectra; lower right, {errors.size} channels{by}"
    write(axes, 0.15, tall - 0.18, key, fontsize=8.5, color=_ON_GREY, va="center")
    for name, pairs in groups.items():
        heading = heading_of(name, len(errors.classes[name].pairs.lights)).removeprefix("the ")
        write(axes, x, tall - 0.42, heading, fontsize=7.5, color=_QUIET, va="center")
        for pair in pairs:
            left, low = x, top - size
            across, along = (left, left, left + size, left + size), (low, top, top, low)
            axes.fill(across, along, color=pair.sRGB_shown, linewidth=0)
            axes.fill(across[:3], along[:3], color=pair.sRGB, linewidth=0)
            lines = (pair.reflectance, f"under {pair.light}", f"ΔE00 {number(pair.delta_e)}")
            for row, line in enumerate(lines):
                weight = "bold" if row == 2 else "normal"
                text = write(axes, left, low - 0.1 - 0.128 * row, line, fontsize=6.4, va="center",
                             color=_ON_GREY if row != 1 else _QUIET, weight=weight)  # fmt: skip
                shortened(text, pitch - 0.06)
            x += pitch
        x += 0.16


def shared_out(places: int, wanted: list[int]) -> list[int]:
    """As many places for each as it wants, no one more than one ahead of who still wants."""
    given = [0] * len(wanted)
    while sum(given) < places and given != wanted:
        least = min(g for g, w in zip(given, wanted, strict=True) if g < w)
        hungry = [i for i, w in enumerate(wanted) if given[i] == least < w]
        if len(hungry) > places - sum(given):
            break
        for i in hungry:
            given[i] += 1
    return given


def worst_pairs(report: BasisReport, count: int, way: str = "componentwise") -> list[WorstPair]:
    """The worst pairs, each of another light, and of another reflectance while there are some."""
    delta_e = report.pairs.delta_e[way]
    found: list[tuple[int, int]] = []
    for once in (True, False):
        for flat in np.argsort(-delta_e, axis=None, kind="stable"):
            j, i = divmod(int(flat), delta_e.shape[1])
            if len(found) == count:
                break
            if all(j != light and not (once and i == sample) for light, sample in found):
                found.append((j, i))
    found.sort(key=lambda pair: -delta_e[pair])
    return [WorstPair.at(report.pairs, j, i, way) for j, i in found]
