"""How far off a basis is, light by light.

[errors] -> figure
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from volspec.basis.figure.style import FAINT, HAIR, INK, plain, spread, write
from volspec.basis.report.errors import WAYS, own_way
from volspec.basis.report.pairs import RGB_PRODUCT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from volspec.basis.report.table import ErrorTable

# Okabe and Ito's blue, vermilion and green: told apart by the colour-blind.
_BLUE, _VERMILION, _GREEN = "#0072b2", "#d55e00", "#009e73"
_FLOORS = (1e-4, 1e-2)
_MOST_NAMED = 9
NOTHING = 1e-6
"""A CIEDE2000 that is rounding."""
_STYLES: dict[str, dict[str, Any]] = {
    RGB_PRODUCT: {"marker": "^", "markersize": 3.4, "color": _VERMILION, "zorder": 3,
                  "markeredgewidth": 0},
    "exact": {"marker": "o", "markersize": 3.6, "color": _GREEN, "zorder": 4,
              "markerfacecolor": "none", "markeredgewidth": 0.9},
    "linear-model": {"marker": "o", "markersize": 3.6, "color": _GREEN, "zorder": 4,
                     "markerfacecolor": "none", "markeredgewidth": 0.9},
    "componentwise": {"marker": "o", "markersize": 3.2, "color": _BLUE, "zorder": 5,
                      "markeredgewidth": 0},
}  # fmt: skip


def draw_errors(axes: Axes, errors: ErrorTable) -> None:
    """Every light's mean error, sorted within its class; a hair rises to its largest."""
    ways = (RGB_PRODUCT, matrix_way(errors), "componentwise")
    means = {
        name: {way: report.pairs.delta_e[way].mean(axis=1) for way in ways}
        for name, report in errors.classes.items()
    }
    every = np.concatenate([m for ways in means.values() for m in ways.values()])
    visible = every[every > _FLOORS[0]]
    lowest = float(visible.min()) if visible.size else 1.0
    floor = float(np.clip(10.0 ** np.floor(np.log10(lowest)), *_FLOORS))
    way_made_for = own_way(errors.method)
    own_max = {n: r.pairs.delta_e[way_made_for].max(axis=1) for n, r in errors.classes.items()}
    top = max(float(every.max()), *(float(tips.max()) for tips in own_max.values()), 3.0)
    axes.set(xlim=(0, 1), yscale="log", ylim=(floor / 1.5, 2.2 * top))
    plain(axes)
    below = "≤ " if every.min() < floor else ""
    axes.yaxis.set_major_formatter(lambda v, _: f"{below if v < 1.01 * floor else ''}{v:g}")
    axes.minorticks_off()
    axes.grid(axis="y", color=HAIR, linewidth=0.6)
    axes.axhline(1.0, color=FAINT, linewidth=0.8, zorder=1.5)
    axes.set_xticks([])
    axes.set_ylabel("mean ΔE00, hairs to the largest", fontsize=8, color=FAINT, labelpad=1)
    wanted = np.sqrt([len(r.pairs.lights) + 3.0 for r in errors.classes.values()])
    ends = np.concatenate([[0.0], np.cumsum(wanted) / wanted.sum()])
    above = axes.get_xaxis_transform()
    named: list[tuple[float, str]] = []
    own = min(len(errors.classes["scene"].pairs.lights), 5) if "scene" in means else 0
    share = max((_MOST_NAMED - own) // max(len(means) - bool(own), 1), 1)
    for (name, report), left, right in zip(errors.classes.items(), ends, ends[1:], strict=False):
        order = np.argsort(own_max[name], kind="stable")
        x = left + (right - left) * (np.arange(len(order)) + 1.0) / (len(order) + 1.0)
        if left:
            axes.axvline(left, color=HAIR, linewidth=0.8)
        for way in ways:
            y = np.maximum(means[name][way][order], floor)
            if way == way_made_for:
                tips, ink = np.maximum(own_max[name][order], floor), _STYLES[way]["color"]
                axes.vlines(x, y, tips, color=ink, linewidth=0.7, alpha=0.55, zorder=2)
            axes.plot(x, y, linestyle="none", **_STYLES[way])
        middle = (left + right) / 2
        write(axes, middle, 1.015, f"{name} ({len(order)})", transform=above, ha="center",
                  va="bottom", fontsize=7.5, color=FAINT)  # fmt: skip
        last = own if name == "scene" else share if own_max[name].max() > NOTHING else 0
        named += [(x[i], report.pairs.lights[order[i]]) for i in range(len(x))[len(x) - last :]]
    _name_lights(axes, named)
    _draw_legend(axes, ways)


def matrix_way(errors: ErrorTable) -> str:
    """Which picture by matrix stands beside the one by components."""
    return "linear-model" if own_way(errors.method) == "linear-model" else "exact"


def _name_lights(axes: Axes, named: list[tuple[float, str]]) -> None:
    """Slanted names under the axis, with hairs up to the lights they belong to."""
    at = np.array([x for x, _ in named])
    places = spread(at, 0.062, 0.03, 0.99)
    below = axes.get_xaxis_transform()
    for x, place, (_, name) in zip(at, places, named, strict=True):
        axes.plot([x, x, place], [0, -0.012, -0.05], transform=below, color=FAINT, linewidth=0.5,
                  clip_on=False, zorder=1)  # fmt: skip
        short = name if len(name) <= 18 else name[:17].rstrip(" (") + "…"
        write(axes, place + 0.008, -0.06, short, transform=below, rotation=32, ha="right",
              va="top", rotation_mode="anchor", fontsize=6.8, color=INK)  # fmt: skip


def _draw_legend(axes: Axes, ways: Sequence[str]) -> None:
    handles = [axes.plot([], [], linestyle="none", label=WAYS[w], **_STYLES[w])[0] for w in ways]
    axes.legend(handles=handles, loc="center left", bbox_to_anchor=(-0.02, 1.105), ncols=3,
                frameon=False, fontsize=8, labelcolor=INK, handletextpad=0.1, columnspacing=1.2,
                borderaxespad=0, borderpad=0)  # fmt: skip
