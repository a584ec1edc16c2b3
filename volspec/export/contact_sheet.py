"""Contact sheets: frames in a grid, under captions or the spectra of their lights.

frames -> [contact_sheet] -> a picture
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volspec._text import fit_text, printable
from volspec.appearance.display import spectrum_colours
from volspec.errors import ShapeError
from volspec.spectra import Spectrum

if TYPE_CHECKING:
    from PIL import Image, ImageDraw

# Background, names, and notes of every sheet.
_PAPER, _INK, _FAINT = (24, 24, 26), (236, 236, 236), (150, 150, 154)
_MARGIN = 36
_PLOT = 84
# The most letters of a text, and the least width of a column's label in pixels.
_LETTERS, _MIN_LABEL = 240, 40
_PLOTTED_NM = (400.0, 700.0)
# Greatest height of a picture in tile widths; taller pictures become narrower.
_TALLEST = 3
_OVERSAMPLING = 3  # spectra are drawn larger and scaled down, for smooth edges


@dataclass(frozen=True, slots=True, eq=False)
class SheetColumn:
    """A light and its frames, one per row of the sheet.

    Parameters
    ----------
    name, label : str
        Name, printed large, and label, printed small.
    light : Spectrum
    frames : sequence of (H, W, 3) uint8
        Frames of equal size.
    """

    name: str
    label: str
    light: Spectrum
    frames: Sequence[NDArray[np.uint8]]


class SheetTile(NamedTuple):
    """A frame with its caption."""

    name: str
    note: str
    """A few words under the name."""
    frame: NDArray[np.uint8]
    """(H, W, 3)."""


@dataclass(frozen=True, slots=True)
class _Grid:
    """Layout of a sheet: tiles in rows under a title, each below a caption.

    `head` is the free height above the first row.
    """

    tile: int
    picture: tuple[int, int]
    gap: int
    row_gap: int
    caption: int
    top: int
    head: int = 0

    def place(self, column: int, row: int) -> tuple[int, int]:
        """Return the corner of a tile's caption; the picture is below the caption."""
        row_height = self.caption + self.picture[1] + self.row_gap
        return _MARGIN + column * (self.tile + self.gap), self.top + self.head + row * row_height

    def blank(self, columns: int, rows: int) -> Image.Image:
        from PIL import Image

        right, bottom = self.place(columns, rows)
        size = right - self.gap + _MARGIN, bottom - self.row_gap + _MARGIN
        return Image.new("RGB", size, _PAPER)

    def paste(self, sheet: Image.Image, frame: NDArray[np.uint8], column: int, row: int) -> None:
        from PIL import Image

        x, y = self.place(column, row)
        picture = Image.fromarray(frame).resize(self.picture, Image.Resampling.LANCZOS)
        sheet.paste(picture, (x, y + self.caption))


def contact_sheet(
    title: str, rows: Sequence[str], columns: Sequence[SheetColumn], tile: int = 400
) -> NDArray[np.uint8]:
    """Lay out the frames of several lights, each in a column under the light's spectrum.

    Parameters
    ----------
    title : str
    rows : sequence of str
        Captions of the rows.
    columns : sequence of SheetColumn
        Columns with one frame per row, else `ShapeError`.
    tile : int
        Width of a frame on the sheet in pixels; very tall frames are narrower.

    Returns
    -------
    (H, W, 3) uint8
    """
    for column in columns:
        if len(column.frames) != len(rows):
            raise ShapeError(
                f"{column.name} has {len(column.frames)} frames for {len(rows)} rows",
                "give one per row",
                field="contact_sheet.columns",
            )
    height, width = columns[0].frames[0].shape[:2]
    grid = _Grid(tile, fitted_size((width, height), tile), 12, 0, 44, _MARGIN + 48, _PLOT + 66)
    sheet = grid.blank(len(columns), len(rows))
    _write(sheet, (_MARGIN, _MARGIN - 6), title, _INK, 28, sheet.width - 2 * _MARGIN)
    for j, row in enumerate(rows):
        _write(sheet, (_MARGIN, grid.place(0, j)[1] + 14), row, _INK, 15, tile)
    for i, column in enumerate(columns):
        x, y = grid.place(i, 0)[0], grid.top
        sheet.paste(spectrum_plot(column.light, tile, _PLOT), (x, y))
        taken = 12 + _write(sheet, (x, y + _PLOT + 8), column.name, _INK, 22, tile)
        if tile - taken > _MIN_LABEL:
            place = round(x + taken), y + _PLOT + 15
            _write(sheet, place, column.label, _FAINT, 15, tile - taken)
        for j, frame in enumerate(column.frames):
            grid.paste(sheet, frame, i, j)
    return np.asarray(sheet)


def comparison_sheet(
    title: str, tiles: Sequence[SheetTile], columns: int = 5, tile: int = 320
) -> NDArray[np.uint8]:
    """Lay out captioned frames of equal size in rows of tiles: (H, W, 3) uint8."""
    height, width = tiles[0].frame.shape[:2]
    grid = _Grid(tile, fitted_size((width, height), tile), 14, 14, 62, _MARGIN + 46)
    columns = min(columns, len(tiles))
    sheet = grid.blank(columns, -(-len(tiles) // columns))
    _write(sheet, (_MARGIN, _MARGIN - 8), title, _INK, 26, sheet.width - 2 * _MARGIN)
    for i, entry in enumerate(tiles):
        row, column = divmod(i, columns)
        x, y = grid.place(column, row)
        _write(sheet, (x, y + 6), entry.name, _INK, 20, tile)
        _write(sheet, (x, y + 35), entry.note, _FAINT, 14, tile)
        grid.paste(sheet, entry.frame, column, row)
    return np.asarray(sheet)


def _write(
    sheet: Image.Image,
    place: tuple[int, int],
    text: str,
    ink: tuple[int, int, int],
    size: int,
    width: float,
) -> float:
    """Write a line of text, cut to a width; return its own."""
    from PIL import ImageDraw

    line = fit_text(printable(text, _LETTERS), size, width)
    line.draw(ImageDraw.Draw(sheet), *place, ink)
    return line.width


def fitted_size(size: tuple[int, int], tile: int) -> tuple[int, int]:
    """Return the size of a picture on a sheet: a tile wide, and at most three tiles high.

    >>> fitted_size((800, 600), 400), fitted_size((1, 4000), 400), fitted_size((4000, 1), 400)
    ((400, 300), (1, 1200), (400, 1))
    """
    width, height = size
    scale = min(tile / width, _TALLEST * tile / height)
    return max(1, round(scale * width)), max(1, round(scale * height))


def spectrum_plot(light: Spectrum, width: int, height: int) -> Image.Image:
    """Plot a light's spectrum, filled with the colours of its wavelengths, with the peak on top."""
    from PIL import Image, ImageDraw

    values = light.values / max(light.values.max(), 1e-12)
    size = (width * _OVERSAMPLING, height * _OVERSAMPLING)
    nm = np.linspace(*_PLOTTED_NM, size[0])
    level = np.interp(nm, light.wavelengths_nm, values, left=0, right=0)
    colour = spectrum_colours(nm)
    rows = np.arange(size[1], 0, -1)[:, None] / size[1]
    filled = np.where((rows <= level[None, :])[..., None], colour[None], np.array(_PAPER) / 255)
    picture = Image.fromarray((filled * 255).round().astype(np.uint8))
    curve = [(x, (1 - y) * (size[1] - 1)) for x, y in enumerate(level)]
    draw: ImageDraw.ImageDraw = ImageDraw.Draw(picture)
    draw.line(curve, _INK, _OVERSAMPLING * 2, joint="curve")
    draw.line([(0, size[1] - 1), (size[0], size[1] - 1)], _FAINT, _OVERSAMPLING)
    return picture.resize((width, height), Image.Resampling.LANCZOS)
