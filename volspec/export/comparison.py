"""Frames side by side, each under its name: one light, every way of seeing it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec.export.sheet import FAINT, INK, PAPER, fitted

_GAP, _MARGIN, _CAPTION = 14, 36, 62


class Seen(NamedTuple):
    """A frame and what it shows."""

    name: str
    note: str
    """A few words under the name."""
    frame: NDArray[np.uint8]
    """(H, W, 3)."""


def comparison_sheet(
    title: str, seen: Sequence[Seen], columns: int = 5, tile: int = 320
) -> NDArray[np.uint8]:
    """Lay frames out in rows.

    Parameters
    ----------
    title : str
    seen : sequence of Seen
        Frames of one size.
    columns : int
    tile : int
        Width of a frame on the sheet, pixels; of a very tall one that of its room.

    Returns
    -------
    (H, W, 3) uint8
    """
    from PIL import Image, ImageDraw, ImageFont

    height, width = seen[0].frame.shape[:2]
    wide, tall = fitted((width, height), tile)
    columns = min(columns, len(seen))
    rows = -(-len(seen) // columns)
    title_font, name_font, small_font = (ImageFont.load_default(size) for size in (28, 22, 15))
    top = _MARGIN + 46
    size = (
        2 * _MARGIN + columns * tile + (columns - 1) * _GAP,
        top + rows * (_CAPTION + tall + _GAP) + _MARGIN - _GAP,
    )
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((_MARGIN, _MARGIN - 8), title, INK, title_font)
    for i, each in enumerate(seen):
        x = _MARGIN + i % columns * (tile + _GAP)
        y = top + i // columns * (_CAPTION + tall + _GAP)
        draw.text((x, y + 6), each.name, INK, name_font)
        draw.text((x, y + 34), each.note, FAINT, small_font)
        picture = Image.fromarray(each.frame).resize((wide, tall), Image.Resampling.LANCZOS)
        sheet.paste(picture, (x, y + _CAPTION))
    return np.asarray(sheet)
