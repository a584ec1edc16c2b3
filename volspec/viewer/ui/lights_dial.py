"""The light dial, and the names around it: whole if there is room, else cut."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from imgui_bundle import imgui

from volspec.viewer.model import lights
from volspec.viewer.model.light_mixes import dial_place, rim_places
from volspec.viewer.model.light_rows import effective_weights
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.light_look import raw_colour
from volspec.viewer.ui.widgets import ACCENT, as_one_line, pack_colour, shorten, text_width, tip

Box = tuple[float, float, float, float]
Measure = Callable[[str], float]
# Names nearer to the upright than this stand above or below the rim, and have its whole width.
_UPRIGHT = 0.2
# From so far out names stand beside the rim: a longer one would reach over its light's dot.
_BESIDE = 0.7
# Of the greatest radius: what names that are long may leave.
_LEAST_LETTERS = 0.6
_RADII = 8


@dataclass(frozen=True, slots=True)
class Letters:
    """How large words are.

    Parameters
    ----------
    height : float
        Of a line.
    width : callable
        Of a text in one line.
    """

    height: float
    width: Measure


@dataclass(frozen=True, slots=True)
class Ring:
    """Where the dial is.

    Parameters
    ----------
    within : (x, y, width, height)
        What names may not leave.
    middle : (x, y)
    radius : float
    out : float
        From the rim to the names.
    """

    within: Box
    middle: tuple[float, float]
    radius: float
    out: float


@dataclass(frozen=True, slots=True)
class Label:
    """A name that would stand at the rim.

    Parameters
    ----------
    index : int
        Of the light.
    box : (x, y, width, height)
    rank : float
        Those of lower rank come first.
    lines : tuple of str
    """

    index: int
    box: Box
    rank: float
    lines: tuple[str, ...] = ()


def ring_for(
    names: Sequence[str], within: Box, radii: tuple[float, float], out: float, measure: Measure
) -> Ring:
    """The dial in an area: smaller, and off its middle, as far as its names ask for that.

    Parameters
    ----------
    names : sequence of str
        Of the lights, in their order.
    within : (x, y, width, height)
    radii : (least, most)
    out : float
        From the rim to the names.
    measure : callable
        How wide a text is.
    """
    x, y, width, height = within
    least, most = radii[0], max(radii)
    least = min(max(least, _LEAST_LETTERS * most), most)
    steps = [most + (least - most) * i / _RADII for i in range(_RADII + 1)]
    reaches = [extents(names, radius + out, measure) for radius in steps]
    found = next((i for i, ends in enumerate(reaches) if sum(ends) <= width), _RADII)
    left, right = reaches[found]
    first, last = left - width / 2, width / 2 - right
    # What is missing is missing at both sides.
    shift = min(max(0.0, first), last) if first <= last else (first + last) / 2
    return Ring(within, (x + width / 2 + shift, y + height / 2), steps[found], out)


def extents(names: Sequence[str], reach: float, measure: Measure) -> tuple[float, float]:
    """How far to the left and to the right of the middle names go that are whole.

    Parameters
    ----------
    names : sequence of str
    reach : float
        From the middle to the names.
    measure : callable
    """
    left = right = reach
    for (cx, _), name in zip(rim_places(len(names)), names, strict=True):
        if abs(cx) < _UPRIGHT:
            continue
        wide = max(map(measure, in_two(name, measure)))
        left = max(left, _before(cx) * wide - cx * reach)
        right = max(right, (1 - _before(cx)) * wide + cx * reach)
    return left, right


def in_two(name: str, measure: Measure) -> tuple[str, ...]:
    """A name in the two lines that are least wide; in one where it has no gap.

    >>> in_two("HP1 high-pressure sodium", len), in_two("tungsten", len)
    (('HP1 high-', 'pressure sodium'), ('tungsten',))
    """
    name = as_one_line(name)
    ends = [i + 1 for i, letter in enumerate(name[:-1]) if letter in " -"]
    ways = [(name[:end].rstrip(), name[end:].lstrip()) for end in ends]
    return min(ways, key=lambda lines: max(map(measure, lines)), default=(name,))


def labels_of(
    names: Sequence[str], ranks: Sequence[float], ring: Ring, letters: Letters
) -> list[Label]:
    """As many names as there is room for; whole where that takes no other's place.

    Parameters
    ----------
    names : sequence of str
    ranks : sequence of float
        Those of lower rank come first.
    ring : Ring
    letters : Letters
    """
    disc = ring.radius * 1.2
    centre = ring.middle[0] - disc / 2, ring.middle[1] - disc / 2, disc, disc
    places = rim_places(len(names))
    lines = [
        (shorten(name, _room(place, ring), letters.width),)
        for name, place in zip(names, places, strict=True)
    ]
    cut = [
        Label(i, _box(lines[i], places[i], ring, letters), rank, lines[i])
        for i, rank in enumerate(ranks)
    ]
    kept = non_overlapping(cut, ring.within, (centre,))
    for at, label in enumerate(kept):
        i = label.index
        if label.lines == (as_one_line(names[i]),):
            continue
        two = in_two(names[i], letters.width)
        boxes = [_box(two, places[i], ring, letters, share) for share in (1.0, 0.0)]
        whole = [replace(label, box=box, lines=two) for box in boxes]
        others = [centre, *(other.box for other in kept if other is not label)]
        kept[at] = next(iter(non_overlapping(whole, ring.within, others)), label)
    return kept


def non_overlapping(labels: Sequence[Label], within: Box, taken: Sequence[Box] = ()) -> list[Label]:
    """Those names that overlap no other and stand inside; by rank, the first in the way stays."""
    kept: list[Label] = []
    boxes = list(taken)
    for label in sorted(labels, key=lambda each: each.rank):
        if _inside(label.box, within) and not any(_overlap(label.box, box) for box in boxes):
            kept.append(label)
            boxes.append(label.box)
    return kept


def label_at(labels: Sequence[Label], x: float, y: float) -> int:
    """The light whose name is at a place; -1 where none is."""
    point = x, y, 0.0, 0.0
    return next((label.index for label in labels if _overlap(point, label.box)), -1)


def line_starts(label: Label, place: tuple[float, float], measure: Measure) -> list[float]:
    """Where each line begins: those at the left of the dial end at its side."""
    x, _, width, _ = label.box
    return [x + _before(place[0]) * (width - measure(text)) for text in label.lines]


def _before(cx: float) -> float:
    """Which share of a name stands at the left of its place: none at the right of the dial."""
    return 0.5 - 0.5 * min(max(cx / _BESIDE, -1.0), 1.0)


def _room(place: tuple[float, float], ring: Ring) -> float:
    """How wide a name can be in one line."""
    (x, _, width, _), (cx, _) = ring.within, place
    if abs(cx) < _UPRIGHT:
        return width
    at, before = ring.middle[0] + cx * (ring.radius + ring.out), _before(cx)
    left = (at - x) / before if before > 0 else width
    right = (x + width - at) / (1 - before) if before < 1 else width
    return min(left, right)


def _box(
    lines: tuple[str, ...],
    place: tuple[float, float],
    ring: Ring,
    letters: Letters,
    away: float = 1.0,
) -> Box:
    """Of lines at their place; above and below the rim moved to stay within.

    Those of the upper half stand above their place as far as ``away`` says, those of the lower
    half below it; at 0 they stand at its height.
    """
    (cx, cy), (x, _, width, _) = place, ring.within
    wide, tall = max(map(letters.width, lines)), letters.height * len(lines)
    reach = ring.radius + ring.out
    left = ring.middle[0] + cx * reach - _before(cx) * wide
    top = ring.middle[1] + cy * reach - tall * (0.5 - 0.5 * away * cy)
    if abs(cx) < _UPRIGHT:
        left = min(max(left, x), x + width - wide)
    return left, top, wide, tall


def _inside(box: Box, within: Box) -> bool:
    (x, y, width, height), (left, top, wide, tall) = box, within
    return x >= left and y >= top and x + width <= left + wide and y + height <= top + tall


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


# Room for names: above and below, and at the sides; beyond a dot, and between two of them.
_ABOVE, _ASIDE, _OUT, _GAP = 27.0, 60.0, 3.0, 4.0
# The least radius.
_LEAST_RADIUS = 24.0
_DOT, _SMALL_DOT, _MANY = 7.0, 4.0, 16


def draw(state: ViewState, ui: UiContext, width: float, height: float) -> ViewState:
    """Draw it; a drag blends."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button("dial", (width, height))
    ui.note("dial")
    ring = _ring(state, ui, (x, y, width, height))
    middle, radius = ring.middle, ring.radius
    new, hovered = state, -1
    mouse = imgui.get_mouse_pos()
    place = (mouse.x - middle[0]) / radius, (mouse.y - middle[1]) / radius
    if imgui.is_item_active() and len(state.lights) > 1:
        new = lights.blend(state, *place)
    elif imgui.is_item_hovered():
        hovered = light_at(len(state.lights), *place, reach=ui.px(14) / radius)
        if hovered < 0:
            hovered = label_at(_placed(state, ui, ring, -1), mouse.x, mouse.y)
        if hovered >= 0:
            row = state.lights[hovered]
            imgui.set_tooltip("\n".join(dict.fromkeys(map(as_one_line, (row.name, row.label)))))
        else:
            tip("Drag to blend the lights; the middle is all of them alike")
    _rim(new, ui, middle, radius, hovered)
    _names(new, ui, _placed(new, ui, ring, hovered), hovered)
    return new


def light_at(count: int, x: float, y: float, reach: float) -> int:
    """The light at a place of the dial; -1 where none is within reach."""
    away = [math.hypot(px - x, py - y) for px, py in rim_places(count)]
    closest = min(range(count), key=lambda i: away[i])
    return closest if away[closest] <= reach else -1


def _dot(state: ViewState, ui: UiContext) -> float:
    return ui.px(_DOT if len(state.lights) <= _MANY else _SMALL_DOT)


def _rim(
    state: ViewState, ui: UiContext, middle: tuple[float, float], radius: float, hovered: int
) -> None:
    draw_list = imgui.get_window_draw_list()
    line = imgui.get_color_u32(imgui.Col_.button_active)
    text = imgui.get_color_u32(imgui.Col_.text)
    rim = rim_places(len(state.lights))
    at = [(middle[0] + px * radius, middle[1] + py * radius) for px, py in rim]
    draw_list.add_circle_filled(middle, radius, imgui.get_color_u32(imgui.Col_.frame_bg), 64)
    if 2 < len(at) <= _MANY:
        ends: list[Any] = [imgui.ImVec2(*place) for place in at]
        draw_list.add_polyline(ends, line, ui.px(1), imgui.ImDrawFlags_.closed)
    weights = effective_weights(state.lights)
    px, py = dial_place(weights)
    marker = middle[0] + px * radius, middle[1] + py * radius
    accent = ACCENT[state.interface.dark]
    # Many rays would fill the disc.
    strength = 0.6 * min(1.0, _MANY / 2 / max(sum(weight > 0 for weight in weights), 1))
    for place, weight in zip(at, weights, strict=True):
        if weight > 0:
            draw_list.add_line(marker, place, pack_colour(accent, strength), ui.px(1 + 2 * weight))
    dot = _dot(state, ui)
    for i, (row, place) in enumerate(zip(state.lights, at, strict=True)):
        draw_list.add_circle_filled(place, dot, pack_colour(raw_colour(row.rig)))
        ring = text if i in (hovered, state.interface.light) else line
        draw_list.add_circle(place, dot, ring, 0, ui.px(1.5 if ring == text else 1))
    draw_list.add_circle_filled(marker, ui.px(5), text)
    draw_list.add_circle(marker, ui.px(5), imgui.get_color_u32(imgui.Col_.window_bg), 0, 1.5)


def _ring(state: ViewState, ui: UiContext, within: Box) -> Ring:
    _, _, width, height = within
    radii = ui.px(_LEAST_RADIUS), min(height / 2 - ui.px(_ABOVE), width / 2 - ui.px(_ASIDE))
    return ring_for(_names_to_fit(state), within, radii, _out(state, ui), _width(ui))


def width_for(state: ViewState, ui: UiContext, height: float) -> float:
    """How wide it would be with all names whole."""
    radius = max(height / 2 - ui.px(_ABOVE), ui.px(_LEAST_RADIUS))
    return sum(extents(_names_to_fit(state), radius + _out(state, ui), _width(ui)))


def _names_to_fit(state: ViewState) -> list[str]:
    """Names that the dial makes room for: none of many, of which few are written."""
    return [row.name for row in state.lights] if len(state.lights) <= _MANY else []


def _out(state: ViewState, ui: UiContext) -> float:
    return _dot(state, ui) + ui.px(_OUT)


def _width(ui: UiContext) -> Measure:
    """How wide a name is with the gap beside it."""
    return lambda text: text_width(text) + ui.px(_GAP)


def _placed(state: ViewState, ui: UiContext, ring: Ring, hovered: int) -> list[Label]:
    """As many names as there is room for: what is under the mouse, is chosen, shines first."""
    weights, chosen = effective_weights(state.lights), state.interface.light
    ranks = [
        i - 1e3 * weight - 1e3 * (i == chosen) - 1e4 * (i == hovered)
        for i, weight in enumerate(weights)
    ]
    letters = Letters(imgui.get_text_line_height(), _width(ui))
    return labels_of([row.name for row in state.lights], ranks, ring, letters)


def _names(state: ViewState, ui: UiContext, labels: list[Label], hovered: int) -> None:
    weights, places = effective_weights(state.lights), rim_places(len(state.lights))
    draw_list, half = imgui.get_window_draw_list(), ui.px(_GAP) / 2
    dim, text = (imgui.get_color_u32(c) for c in (imgui.Col_.text_disabled, imgui.Col_.text))
    for label in labels:
        colour = text if weights[label.index] > 0 or label.index == hovered else dim
        y, step = label.box[1], label.box[3] / len(label.lines)
        starts = line_starts(label, places[label.index], _width(ui))
        for i, (x, line) in enumerate(zip(starts, label.lines, strict=True)):
            draw_list.add_text((x + half, y + i * step), colour, line)
