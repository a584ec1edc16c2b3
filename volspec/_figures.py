"""Shared style of matplotlib figures: inks, axes in inches, texts that fit, files.

    [_figures] -> basis.figure, basis.reflectance_figure, palette.figure

matplotlib is imported late and draws on a canvas of its own: no window, no global state.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import write_whole
from volspec._text import text_runs

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text

Array = NDArray[np.float64]

PAPER, INK, FAINT, HAIR = "white", "#1d1d1f", "#6b6b70", "#d5d5d8"
DPI = 160


def new_figure(width_in: float, height_in: float) -> Figure:
    """Return an empty figure on an Agg canvas."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=DPI, facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def write_figure(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure atomically, in the format of the file's suffix."""
    kind = Path(path).suffix.lstrip(".").lower()
    metadata = {"Date": None} if kind == "svg" else {}  # no date, so that output is reproducible
    with write_whole(path) as temporary:
        figure.savefig(temporary, format=kind, dpi=DPI, metadata=metadata)


def inch_axes(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    """Add axes placed in inches from the figure's lower left."""
    w, h = figure.get_size_inches()
    return figure.add_axes((left / w, bottom / h, width / w, height / h))


def write(on: Axes | Figure, x: float, y: float, words: str, **style: Any) -> Text:
    """Add text as one literal line without mathtext; a box for letters that no font has."""
    from matplotlib.font_manager import FontProperties, findfont, get_font

    if not (runs := text_runs(words)):
        return on.text(x, y, "", **style)
    drawn = "".join(run for run, _ in runs)
    families = [_family(font) for font in dict.fromkeys(font for _, font in runs)]
    font_face = get_font(findfont(FontProperties(family=families[0], weight=style.get("weight"))))
    if not all(font_face.get_char_index(ord(c)) for c in drawn):
        style.pop("weight", None)  # in which some letters, and most other fonts, do not exist
    return on.text(x, y, drawn, parse_math=False, family=families, **style)


@cache
def _family(font: Path) -> str:
    """Return the name by which matplotlib finds a font."""
    from matplotlib.font_manager import fontManager, get_font

    fontManager.addfont(font)
    return get_font(font).family_name


def shorten(text: Text, width_in: float) -> None:
    """Shorten a text to a width, with an ellipsis."""
    figure = text.get_figure()
    assert figure is not None
    words = text.get_text()
    while text.get_window_extent().width > width_in * figure.dpi and len(words) > 1:
        words = words[:-1].rstrip(" ,;(")
        text.set_text(words + "…")


def style_axes(axes: Axes) -> None:
    """Style a plot without a frame: a thin line below, small grey numbers."""
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.spines["bottom"].set(color=FAINT, linewidth=0.6)
    axes.tick_params(length=0, labelsize=7.5, labelcolor=FAINT)
    axes.set_axisbelow(True)


def spread_apart(positions: Array, gap: float, low: float, high: float) -> Array:
    """Return positions near the wanted ones, at least ``gap`` apart within ``low``…``high``."""
    order = np.argsort(positions, kind="stable")
    gap = min(gap, (high - low) / max(len(positions) - 1, 1))
    y = np.clip(np.asarray(positions, dtype=np.float64)[order], low, high)
    for _ in range(200):
        for i in range(len(y) - 1):
            lack = gap - (y[i + 1] - y[i])
            if lack > 0:
                y[i] -= lack / 2
                y[i + 1] += lack / 2
        y = np.clip(y, low, high)
    steps = np.arange(len(y)) * gap
    y = np.minimum(np.maximum.accumulate(y - steps) + steps, high - steps[::-1])
    result = np.empty_like(y)
    result[order] = y
    return result
