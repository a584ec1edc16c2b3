"""Contact sheets: one column a light, its spectrum above, one row a way of seeing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.wavelengths import spectrum_colours
from volspec.errors import ShapeError
from volspec.spectra import Spectrum

if TYPE_CHECKING:
    from PIL import Image, ImageDraw

# Of every sheet: the ground, names, and notes.
PAPER, INK, FAINT = (24, 24, 26), (236, 236, 236), (150, 150, 154)
_GAP, _MARGIN, _PLOT, _CAPTION = 12, 36, 84, 44
_PLOTTED_NM = (400.0, 700.0)
# Tiles that a picture is high at most: taller ones are narrower.
_TALLEST = 3
_OVERSAMPLING = 3  # lines of the spectra are drawn larger and scaled down: smooth edges


@dataclass(frozen=True, slots=True, eq=False)
class SheetColumn:
    """A light and its frames, one a row of the sheet.

    Parameters
    ----------
    name, label : str
        Printed large and small.
    light : Spectrum
    frames : sequence of (H, W, 3) uint8
        All of one size.
    """

    name: str
    label: str
    light: Spectrum
    frames: Sequence[NDArray[np.uint8]]


def contact_sheet(
    title: str, rows: Sequence[str], columns: Sequence[SheetColumn], tile: int = 400
) -> NDArray[np.uint8]:
    """Lay out the frames of several lights.

    Parameters
    ----------
    title : str
    rows : sequence of str
        What the frames of each row show.
    columns : sequence of SheetColumn
        Each with one frame a row.
    tile : int
        Width of a frame on the sheet, pixels; of a very tall one that of its room.

    Returns
    -------
    (H, W, 3) uint8

    Raises
    ------
    ShapeError
        If a column has another number of frames than there are rows.
    """
    from PIL import Image, ImageDraw, ImageFont

    for column in columns:
        if len(column.frames) != len(rows):
            raise ShapeError(
                f"contact sheet: {column.name} has {len(column.frames)} frames for {len(rows)} rows"
            )
    height, width = columns[0].frames[0].shape[:2]
    wide, tall = fitted((width, height), tile)
    title_font, name_font, small_font = (ImageFont.load_default(size) for size in (30, 24, 17))
    top = _MARGIN + 48
    head = _PLOT + 66
    row_height = _CAPTION + tall
    sheet = Image.new(
        "RGB",
        (
            2 * _MARGIN + len(columns) * tile + (len(columns) - 1) * _GAP,
            top + head + len(rows) * row_height + _MARGIN,
        ),
        PAPER,
    )
    draw = ImageDraw.Draw(sheet)
    draw.text((_MARGIN, _MARGIN - 6), title, INK, title_font)
    for j, row in enumerate(rows):
        draw.text((_MARGIN, top + head + j * row_height + 14), row, INK, small_font)
    for i, column in enumerate(columns):
        x = _MARGIN + i * (tile + _GAP)
        sheet.paste(spectrum_plot(column.light, tile, _PLOT), (x, top))
        draw.text((x, top + _PLOT + 8), column.name, INK, name_font)
        name_width = draw.textlength(column.name, name_font)
        draw.text((x + name_width + 12, top + _PLOT + 14), column.label, FAINT, small_font)
        for j, frame in enumerate(column.frames):
            picture = Image.fromarray(frame).resize((wide, tall), Image.Resampling.LANCZOS)
            sheet.paste(picture, (x, top + head + j * row_height + _CAPTION))
    return np.asarray(sheet)


def fitted(size: tuple[int, int], tile: int) -> tuple[int, int]:
    """Width and height of a picture on a sheet: a tile wide, but only so many tiles high.

    >>> fitted((800, 600), 400), fitted((1, 4000), 400), fitted((4000, 1), 400)
    ((400, 300), (1, 1200), (400, 1))
    """
    width, height = size
    scale = min(tile / width, _TALLEST * tile / height)
    return max(1, round(scale * width)), max(1, round(scale * height))


def spectrum_plot(light: Spectrum, width: int, height: int) -> Image.Image:
    """A light's spectrum, filled with the colours of its wavelengths, highest band full height."""
    from PIL import Image, ImageDraw

    values = light.values / max(light.values.max(), 1e-12)
    size = (width * _OVERSAMPLING, height * _OVERSAMPLING)
    at = np.linspace(*_PLOTTED_NM, size[0])
    level = np.interp(at, light.wavelengths_nm, values, left=0, right=0)
    colour = spectrum_colours(at)
    rows = np.arange(size[1], 0, -1)[:, None] / size[1]
    filled = np.where((rows <= level[None, :])[..., None], colour[None], np.array(PAPER) / 255)
    picture = Image.fromarray((filled * 255).round().astype(np.uint8))
    curve = [(x, (1 - y) * (size[1] - 1)) for x, y in enumerate(level)]
    draw: ImageDraw.ImageDraw = ImageDraw.Draw(picture)
    draw.line(curve, INK, _OVERSAMPLING * 2, joint="curve")
    draw.line([(0, size[1] - 1), (size[0], size[1] - 1)], FAINT, _OVERSAMPLING)
    return picture.resize((width, height), Image.Resampling.LANCZOS)
