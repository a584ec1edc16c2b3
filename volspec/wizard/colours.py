"""Colours as wizards need them: what a scene shows, how far cells lie apart, distinct hues.

drawing, Design -> [colours] -> asks
"""

from __future__ import annotations

import math

import numpy as np

from volspec.appearance.models.cielab import delta_E_2000
from volspec.appearance.spaces import space_of
from volspec.palette import Cell, Design, Palette
from volspec.palette.model import Place
from volspec.palette.model import Triple as Colour
from volspec.palette.state import State
from volspec.wizard.drawing import Drawing

# CIELAB of colours that are told apart by their hue: light, and within sRGB all around.
_LIGHTNESS, _CHROMA, _FIRST_DEG = 65.0, 45.0, 30.0


def shown_codes(drawing: Drawing) -> dict[Place, Colour]:
    """What the display shows of every material under every column, clipped to its codes."""
    names = list(drawing.scene.materials)
    rows, columns = drawing.rows(names[:1], before=False), drawing.lights()
    # One open row makes it a palette; its state is what the scene shows now.
    black = {(names[0], columns[0].name): Cell("black")}
    palette = Palette(rows, columns, black, drawing.viewing, drawing.scene.basis.grid)
    state = State.start(palette)
    eyes = state.eyes()
    codes = eyes[0].space.encode(np.clip(state.linear(eyes), 0.0, 1.0))
    return {
        (row.name, column.name): tuple(codes[i, j].tolist())
        for i, row in enumerate(rows)
        for j, column in enumerate(columns)
    }


def apart(made: Design, one: Place, other: Place) -> float:
    """CIEDE2000 between two cells, as the display shows them."""
    eyes = made.state.eyes()
    linear = np.clip(made.state.linear(eyes), 0.0, 1.0)
    Lab = [eyes[j].Lab(linear[i, j]) for i, j in map(made.palette.index, (one, other))]
    return float(delta_E_2000(Lab[0], Lab[1]))


def distinct_colours(count: int) -> tuple[Colour, ...]:
    """Hues as far apart as can be, of one lightness: the display's codes.

    >>> len(set(distinct_colours(5)))
    5
    """
    space = space_of("sRGB")
    hues = math.radians(_FIRST_DEG) + 2.0 * math.pi * np.arange(count) / count
    fy = (_LIGHTNESS + 16.0) / 116.0
    ratios = np.stack(
        [
            fy + _CHROMA * np.cos(hues) / 500.0,
            np.full(count, fy),
            fy - _CHROMA * np.sin(hues) / 200.0,
        ]
    )
    XYZ = space.white_XYZ * (ratios.T**3)
    codes = space.encode(np.clip(XYZ @ space.RGB_from_XYZ.T, 0.0, 1.0))
    return tuple((r, g, b) for r, g, b in codes.tolist())
