"""Marks in saved pictures: scale bar, orientation, title, light, materials, annotations.

    camera, size, names -> [annotate] -> patches -> pixels of any depth, a strip at a time

Sizes follow the picture's, so that marks are legible in any. Colours are display codes.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from volspec._text import TextLine, fit_text, printable
from volspec.camera import (
    Camera,
    Projection,
    cube_faces,
    cube_label,
    is_patient,
    length_mm,
    scale_text,
)
from volspec.errors import VolspecWarning, quote
from volspec.export.value_bars import ValueBar
from volspec.scene.tables import Annotation, Mark, PlacedAnnotation, place_annotation
from volspec.volume import Volume

if TYPE_CHECKING:
    from PIL import Image

Codes = TypeVar("Codes", bound=NDArray[Any])
# Sizes are given for this height of a picture, and grow with it down to the least factor.
_HEIGHT, _MIN_SCALE = 720, 0.6
_MARGIN, _TEXT, _TITLE, _OUTLINE = 20.0, 20, 28, 1.6
# The bar: length, as a fraction of the width and at most, thickness, and height of its ends.
_BAR, _MAX_BAR, _THICK, _END = 0.25, 180.0, 3.0, 12.0
# The cube's half edge, the distance of its centre from the sides, and supersampling of its edges.
_HALF, _CORNER, _FINE = 26.0, 62.0, 4
# The grey of a face: a constant, and a factor for its cosine to the eye; below it, no letters.
_SHADE, _ASKEW = (0.30, 0.34), 0.3
_SWATCH, _ROW = 18.0, 28.0
# Of annotations: radius of dots, half width of lines, room before a caption, and how far right of
# its point and above it a label is.
_DOT, _LINE, _ROOM, _LEADER = 4.0, 1.1, 6.0, 28.0
_WHITE, _BLACK = (255, 255, 255, 255), (0, 0, 0, 255)
_MAX_LETTERS = 100  # of an annotation 80, and its number


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Part of a picture to paint over."""

    x: int
    y: int
    colours: NDArray[np.float32]  # (h, w, 3) display codes 0 to 1, premultiplied
    alpha: NDArray[np.float32]  # (h, w)


@dataclass(frozen=True, slots=True, eq=False)
class MarkedPicture:
    """Contents of a picture's marks."""

    size: tuple[int, int]  # width and height
    camera: Camera
    volume: Volume
    title: str = ""
    light: str = ""
    materials: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)  # codes 0 to 1
    patient: bool | None = None  # name directions by the patient's body; None: the volume decides
    annotations: Sequence[Annotation] = ()
    values: Sequence[ValueBar] = ()


def picture_marks(marks: Sequence[Mark], picture: MarkedPicture) -> list[Patch]:
    """Return the patches of a picture: its annotations, and marks of ``[export] annotate``."""
    warn_of_cut(picture.annotations, picture.camera, picture.size)
    paint = _Painter(picture)
    patches = [
        patch for annotation in picture.annotations for patch in paint.annotation(annotation)
    ]
    top = paint.margin
    taken = 2 * (_CORNER * paint.unit if "orientation" in marks else paint.margin)
    room = picture.size[0] - taken
    if "title" in marks and picture.title:
        patches.append(paint.text(picture.title, paint.margin, top, _TITLE, room))
        top += 1.3 * _TITLE * paint.unit
    if "light" in marks and picture.light:
        patches.append(paint.text(picture.light, paint.margin, top, _TEXT, room))
        top += 1.3 * _TEXT * paint.unit
    if "orientation" in marks:
        patches.append(paint.cube())
    if "scale" in marks:
        patches += paint.scale_bar()
    if "materials" in marks:
        patches += paint.legend(top)
    if "values" in marks:
        patches += paint.value_bars()
    return patches


def paint(pixels: Codes, patches: Sequence[Patch], top: int = 0) -> Codes:
    """Return rows of a picture, from row ``top``, with patches over them.

    Pixels are (H, W, 3 or 4) codes of any integer type; the fourth channel is straight alpha.
    """
    if not patches:
        return pixels
    maximum = float(np.iinfo(pixels.dtype).max)
    painted = pixels.copy()
    height, width, channels = pixels.shape
    for patch in patches:
        h, w = patch.alpha.shape
        first, last = max(patch.y - top, 0), min(patch.y - top + h, height)
        left, right = max(patch.x, 0), min(patch.x + w, width)
        if first >= last or left >= right:
            continue
        inside = np.s_[
            first + top - patch.y : last + top - patch.y, left - patch.x : right - patch.x
        ]
        over, alpha = patch.colours[inside], patch.alpha[inside][..., None]
        below = painted[first:last, left:right].astype(np.float32) / maximum
        opacity = below[..., 3:] if channels == 4 else 1.0
        mixed = over + opacity * below[..., :3] * (1.0 - alpha)
        if channels == 4:
            cover = alpha + opacity * (1.0 - alpha)
            mixed = np.concatenate([mixed / np.maximum(cover, 1e-6), cover], axis=-1)
        painted[first:last, left:right] = np.rint(np.clip(mixed, 0.0, 1.0) * maximum)
    return painted


def _with_leader(
    annotation: Annotation, projection: Projection, unit: float
) -> PlacedAnnotation | None:
    """Place an annotation in a picture whose sizes grow by ``unit``; None if it is behind."""
    return place_annotation(annotation.points_mm, projection, (_LEADER * unit, -_LEADER * unit))


def annotation_svg(annotations: Sequence[Annotation], camera: Camera, size: tuple[int, int]) -> str:
    """Return annotations as elements of an SVG whose units are a picture's pixels."""
    unit, projection = _unit(size), Projection(camera, (0, 0, *size))
    nodes = []
    for annotation in annotations:
        placed = _with_leader(annotation, projection, unit)
        if placed is None:
            continue
        for name, wider in (("under", _OUTLINE * unit), ("over", 0.0)):
            stroke, radius = 2 * (_LINE * unit + wider), _DOT * unit + wider
            shapes = [
                f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}"/>'
                for (x0, y0), (x1, y1) in placed.lines
            ]
            shapes += [
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}"/>' for x, y in placed.dots
            ]
            nodes.append(f'<g class="{name}" stroke-width="{stroke:.1f}">{"".join(shapes)}</g>')
        x, y = placed.caption + (_ROOM * unit, 0.0)
        caption = escape(printable(annotation.caption, _MAX_LETTERS))
        nodes.append(
            f'<text x="{x:.1f}" y="{y - 0.3 * _TEXT * unit:.1f}" font-size="{_TEXT * unit:.1f}" '
            f'stroke-width="{2 * _OUTLINE * unit:.1f}">{caption}</text>'
        )
    return "".join(nodes)


def warn_of_cut(annotations: Sequence[Annotation], camera: Camera, size: tuple[int, int]) -> None:
    """Warn of annotations that begin within a picture and end beyond its right edge."""
    unit, projection = _unit(size), Projection(camera, (0, 0, *size))
    for annotation in annotations:
        if (placed := _with_leader(annotation, projection, unit)) is None:
            continue
        start = float(placed.caption[0]) + _ROOM * unit
        width = TextLine.of(printable(annotation.caption, _MAX_LETTERS), round(_TEXT * unit)).width
        if 0 <= start < size[0] < start + width:
            warnings.warn(
                f"[[annotation]] {quote(annotation.caption)}: is cut at the edge of a picture of "
                f"{size[0]} x {size[1]}; shorten its text, move its points, or make it wider",
                VolspecWarning,
                stacklevel=2,
            )


def _unit(size: tuple[int, int]) -> float:
    """Return the factor of all sizes in a picture."""
    return max(min(size) / _HEIGHT, _MIN_SCALE)


class _Painter:
    """Draws the marks of one picture."""

    def __init__(self, picture: MarkedPicture) -> None:
        self._picture = picture
        width, height = picture.size
        self.unit = _unit(picture.size)
        self.margin = _MARGIN * self.unit
        self._projection = Projection(picture.camera, (0, 0, width, height))

    def text(self, text: str, x: float, y: float, size: float, room: float = math.inf) -> Patch:
        """Return an outlined line of text, from its upper left; shortened to fit into a width."""
        from PIL import Image, ImageDraw

        line = fit_text(printable(text, _MAX_LETTERS), round(size * self.unit), room)
        outline = max(round(_OUTLINE * self.unit), 1)
        left, top, end, bottom = line.box(outline)
        canvas = Image.new("RGBA", (end - left, bottom - top))
        drawn = ImageDraw.Draw(canvas)
        line.draw(drawn, -left, -top, _BLACK, outline)
        line.draw(drawn, -left, -top, _WHITE)
        return _patch(canvas, x, y + top)

    def scale_bar(self) -> list[Patch]:
        """Return the bar in the lower right corner, and its length above it."""
        width, height = self._picture.size
        mm_per_px = self._projection.mm_per_px
        mm = length_mm(mm_per_px, max(min(_BAR * width, _MAX_BAR * self.unit), 1.0))
        long, thick = max(round(mm / mm_per_px), 1), max(round(_THICK * self.unit), 1)
        end, edge = round(_END * self.unit), max(round(_OUTLINE * self.unit / 2), 1)
        right, bottom = round(width - self.margin), round(height - self.margin)
        white = np.zeros((end, long), bool)
        white[:, :thick] = white[:, -thick:] = True
        middle = (end - thick) // 2
        white[middle : middle + thick] = True
        # The dark outline makes the bar legible on any picture.
        padded = np.pad(white, edge)
        dark = np.zeros_like(padded)
        for dy in range(-edge, edge + 1):
            for dx in range(-edge, edge + 1):
                dark |= np.roll(padded, (dy, dx), (0, 1))
        colours = np.repeat(padded[..., None], 3, axis=2).astype(np.float32)
        bar = Patch(right - long - edge, bottom - end - edge, colours, dark.astype(np.float32))
        text = scale_text(mm, self._picture.volume)
        label = self.text(text, 0.0, 0.0, _TEXT)
        h, w = label.alpha.shape
        x = min(right - (long + w) / 2, width - w - 1)
        return [bar, replace(label, x=round(x), y=round(bottom - end - edge - h))]

    def cube(self) -> Patch:
        """Return the orientation cube in the upper right corner."""
        from PIL import Image, ImageDraw

        picture, half = self._picture, _HALF * self.unit
        side = 2 * round(2 * half)
        fine = _FINE * half
        middle = _FINE * side / 2
        canvas = Image.new("RGBA", (_FINE * side, _FINE * side))
        draw = ImageDraw.Draw(canvas)
        patient = is_patient(picture.volume, picture.patient)
        for face, corners, towards in cube_faces(picture.camera):
            grey = round(255 * (_SHADE[0] + _SHADE[1] * towards))
            ring = [(middle + fine * x, middle + fine * y) for x, y in corners.tolist()]
            draw.polygon(ring, (grey, grey, grey, 255), (20, 20, 20, 255), round(fine * 0.04))
            if towards >= _ASKEW:
                (ax, ay), (cx, cy) = ring[0], ring[2]
                label = TextLine.of(cube_label(face, patient), round(0.52 * fine))
                x, y = (ax + cx - label.width) / 2, (ay + cy - label.height) / 2
                label.draw(draw, x, y, (5, 5, 5, 255))
        small = canvas.resize((side, side), Image.Resampling.BOX)
        x = picture.size[0] - _CORNER * self.unit - side / 2
        return _patch(small, x, _CORNER * self.unit - side / 2)

    def annotation(self, annotation: Annotation) -> list[Patch]:
        """Return an annotation's lines and its caption; nothing if it is behind the camera."""
        placed = _with_leader(annotation, self._projection, self.unit)
        if placed is None:
            return []
        x, y = placed.caption + (_ROOM * self.unit, 0.0)
        text = self.text(annotation.caption, x, y - 1.3 * _TEXT * self.unit, _TEXT)
        return [self._strokes(placed.lines, placed.dots), text]

    def _strokes(
        self, lines: Sequence[tuple[NDArray[np.float64], ...]], dots: NDArray[np.float64]
    ) -> Patch:
        """Return white lines and dots with a dark outline; coverage is by distance."""
        outline = _OUTLINE * self.unit
        margin = _DOT * self.unit + outline + 1.0
        points = np.concatenate([*(np.stack(line) for line in lines), dots])
        size = np.array(self._picture.size)
        low = np.clip(np.floor(points.min(axis=0) - margin), 0, size - 1).astype(int)
        high = np.clip(np.ceil(points.max(axis=0) + margin), low + 1, size).astype(int)
        x, y = np.meshgrid(*(np.arange(a, b) + 0.5 for a, b in zip(low, high, strict=True)))
        # Distance to the nearest edge: below 0 inside.
        edge = np.full(x.shape, np.inf, np.float32)
        for (x0, y0), (x1, y1) in lines:
            dx, dy = x1 - x0, y1 - y0
            t = ((x - x0) * dx + (y - y0) * dy) / max(dx * dx + dy * dy, 1e-9)
            t = np.clip(t, 0.0, 1.0)
            far = np.hypot(x - x0 - t * dx, y - y0 - t * dy)
            edge = np.minimum(edge, far - _LINE * self.unit)
        for x0, y0 in dots:
            edge = np.minimum(edge, np.hypot(x - x0, y - y0) - _DOT * self.unit)
        white = np.clip(0.5 - edge, 0.0, 1.0).astype(np.float32)
        dark = np.clip(0.5 + outline - edge, 0.0, 1.0).astype(np.float32)
        return Patch(int(low[0]), int(low[1]), np.repeat(white[..., None], 3, axis=2), dark)

    def legend(self, top: float) -> list[Patch]:
        """Return a row for each material in the lower left corner; those without room are counted.

        ``top`` is the end of the texts above.
        """
        row, swatch = _ROW * self.unit, round(_SWATCH * self.unit)
        bottom = self._picture.size[1] - self.margin
        max_rows = max(int((bottom - top) / row), 1)
        names = list(self._picture.materials)
        if len(names) > max_rows:
            names = names[: max(max_rows - 1, 1)]
        lines = [*names, f"and {len(self._picture.materials) - len(names)} more"]
        lines = lines[: len(names) + (len(names) < len(self._picture.materials))]
        patches = []
        for i, name in enumerate(lines):
            y = bottom - (len(lines) - i) * row
            x = self.margin
            if i < len(names):
                patches.append(self._swatch(name, x, y + (row - swatch) / 2, swatch))
                x += 1.5 * swatch
            patches.append(self.text(name, x, y, _TEXT))
        return patches

    def value_bars(self) -> list[Patch]:
        """Return a bar for each field above the middle of the lower edge, with its numbers."""
        width, height = self._picture.size
        thick, edge = round(_SWATCH * self.unit), max(round(_OUTLINE * self.unit / 2), 1)
        patches, bottom = [], height - self.margin
        for bar in reversed(self._picture.values):
            labels = [(v, self.text(bar.number(v), 0.0, 0.0, _TEXT)) for v in bar.ticks()]
            long = max(round(_BAR * width), 2)
            left, top = round((width - long) / 2), round(bottom - thick - _ROW * self.unit)
            colours = bar.colours[np.arange(long) * len(bar.colours) // long]
            visible = np.isfinite(colours).all(axis=1)
            framed = np.zeros((thick + 2 * edge, long + 2 * edge, 4), np.float32)
            framed[..., 3] = 1.0
            inner = framed[edge:-edge, edge:-edge]
            inner[..., :3], inner[..., 3] = np.nan_to_num(colours), visible
            patches.append(Patch(left - edge, top - edge, framed[..., :3], framed[..., 3]))
            free = -np.inf
            for value, label in labels:
                x = left + long * (value - bar.low) / (bar.high - bar.low)
                start = x - label.alpha.shape[1] / 2
                if start > free:  # numbers that would touch are left out
                    patches.append(replace(label, x=round(start), y=round(top + thick)))
                    free = start + label.alpha.shape[1]
            bottom = top - 0.5 * _ROW * self.unit
            if bar.title:
                title = self.text(bar.title, left, top - _ROW * self.unit, _TEXT, long)
                patches.append(title)
                bottom -= _ROW * self.unit
        return patches

    def _swatch(self, name: str, x: float, y: float, side: int) -> Patch:
        colours = np.zeros((side + 2, side + 2, 3), np.float32)
        colours[1:-1, 1:-1] = self._picture.materials[name]
        return Patch(round(x) - 1, round(y) - 1, colours, np.ones(colours.shape[:2], np.float32))


def _patch(canvas: Image.Image, x: float, y: float) -> Patch:
    """Return a drawn canvas as a patch; Pillow's antialiasing premultiplies over an empty one."""
    drawn = np.asarray(canvas, np.float32) / 255.0
    return Patch(round(x), round(y), drawn[..., :3], drawn[..., 3])
