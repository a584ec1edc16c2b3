"""Figure of what a room does to paints: their colours in an atlas, and as they are seen there.

    surfaces or ranked paints, by lamp -> [figure] -> PNG, PDF, SVG

Left, x and y; right, a_C = C cos h and b_C = C sin h to the adapted eye. Lines lead from the colour
in the atlas to that under each lamp, as figures 6 and 8 of Neumann et al. (2004).
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from volspec._figures import FAINT, INK, inch_axes, new_figure, style_axes, write, write_figure
from volspec.appearance.models import opponents
from volspec.room.eye import SurfaceAppearance
from volspec.room.paint_ranking import RankedPaint

# Okabe and Ito's colours, which colour-blind people can distinguish.
_COLOURS = "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"


def save_room_figure(
    looks: Mapping[str, Sequence[SurfaceAppearance | RankedPaint]], path: str | os.PathLike[str]
) -> None:
    """Write the figure of colours by lamp, in the format of the file's suffix."""
    figure = new_figure(10.0, 5.4)
    for number, (left, across, up) in enumerate(((0.6, "x", "y"), (5.5, "a_C", "b_C"))):
        axes = inch_axes(figure, left, 0.6, 4.2, 4.2)
        style_axes(axes)
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.15)
        axes.set_xlabel(across, fontsize=8, color=FAINT)
        axes.set_ylabel(up, fontsize=8, color=FAINT)
        for k, (lamp, paints) in enumerate(looks.items()):
            style: dict[str, Any] = {
                "color": _COLOURS[k % len(_COLOURS)],
                "label": lamp or "its own light",
            }
            for paint in paints:
                ends = [paint.chosen_xy, paint.seen_xy]
                if number:
                    colours = paint.chosen, paint.seen
                    ends = [tuple(opponents("figure", c.J, c.C, c.h)[1:]) for c in colours]
                axes.plot(*zip(*ends, strict=True), "o-", markevery=[1], markersize=3, **style)
                style.pop("label", None)
                if not k:
                    write(axes, *ends[0], f"{paint.name} ", fontsize=7, color=INK, ha="right")
        if not number:
            axes.legend(frameon=False, fontsize=8, loc=(-0.02, 1.02), ncols=6)
    write_figure(figure, path)
