"""The light dial, and the names around it, which are cut if there is no room."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from imgui_bundle import imgui

from volspec.viewer.model import lights
from volspec.viewer.model.light_rows import effective_weights
from volspec.viewer.model.lights import dial_place, rim_places
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import Rect, raw_colour
from volspec.viewer.ui.widgets import ACCENT, as_one_line, pack_colour, shorten, text_width

Point = tuple[float, float]
# Function that returns the width of a text in one line.
Measure = Callable[[str], float]
# Names closer to the vertical than this are above or below the rim, and may use the full width.
_UPRIGHT = 0.2
# From here outwards, names are fully outside the rim: long ones would cover their light's dot.
_ASIDE_FROM = 0.7
# The least radius, as a fraction of the greatest, to which long names may shrink the dial.
_MIN_FRACTION = 0.6
_RADII = 8


@dataclass(frozen=True, slots=True)
class Ring:
    """The dial's place in an area that names may not leave, and the size of its letters."""

    within: Rect
    middle: Point
    radius: float
    reach: float  # from the middle to the names
    line_height: float
    measure: Measure


@dataclass(frozen=True, slots=True)
class DialLabel:
    """A light's name at the rim; labels of lower rank are placed first."""

    index: int
    box: Rect
    rank: float
    lines: tuple[str, ...] = ()


def ring_for(
    names: Sequence[str],
    within: Rect,
    radii: tuple[float, float],
    out: float,
    line_height: float,
    measure: Measure,
) -> Ring:
    """Fit the dial into an area, shrunk and moved off the middle as far as the names need.

    ``radii`` are the least and the greatest; ``out`` is the distance from the rim to the names.
    """
    x, y, width, height = within
    min_radius, max_radius = radii[0], max(radii)
    min_radius = min(max(min_radius, _MIN_FRACTION * max_radius), max_radius)
    steps = [max_radius + (min_radius - max_radius) * i / _RADII for i in range(_RADII + 1)]
    reaches = [extents(names, radius + out, measure) for radius in steps]
    step = next((i for i, ends in enumerate(reaches) if sum(ends) <= width), _RADII)
    left, right = reaches[step]
    first, last = left - width / 2, width / 2 - right
    # Names that are too wide are cut equally on both sides.
    shift = min(max(0.0, first), last) if first <= last else (first + last) / 2
    middle = x + width / 2 + shift, y + height / 2
    return Ring(within, middle, steps[step], steps[step] + out, line_height, measure)


def extents(names: Sequence[str], reach: float, measure: Measure) -> tuple[float, float]:
    """Return how far uncut names extend to the left and right of the middle, ``reach`` from it."""
    left = right = reach
    for (cx, _), name in zip(rim_places(len(names)), names, strict=True):
        if abs(cx) < _UPRIGHT:
            continue
        width = max(map(measure, in_two(name, measure)))
        left = max(left, _left_fraction(cx) * width - cx * reach)
        right = max(right, (1 - _left_fraction(cx)) * width + cx * reach)
    return left, right


def in_two(name: str, measure: Measure) -> tuple[str, ...]:
    """Break a name into the two narrowest lines; into one if it has no gap.

    >>> in_two("HP1 high-pressure sodium", len), in_two("tungsten", len)
    (('HP1 high-', 'pressure sodium'), ('tungsten',))
    """
    name = as_one_line(name)
    ends = [i + 1 for i, letter in enumerate(name[:-1]) if letter in " -"]
    ways = [(name[:end].rstrip(), name[end:].lstrip()) for end in ends]
    return min(ways, key=lambda lines: max(map(measure, lines)), default=(name,))


def place_labels(names: Sequence[str], ranks: Sequence[float], ring: Ring) -> list[DialLabel]:
    """Place as many names as there is room for; uncut if that hides no other name."""
    x, y = ring.middle
    side = ring.radius * 1.2
    disc = x - side / 2, y - side / 2, side, side
    places = rim_places(len(names))
    cut = []
    for i, place in enumerate(places):
        lines = (shorten(names[i], _room(place[0], ring), ring.measure),)
        cut.append(DialLabel(i, _box(lines, place, ring), ranks[i], lines))
    labels = non_overlapping(cut, ring.within, (disc,))
    for number, label in enumerate(labels):
        name = names[label.index]
        if label.lines == (as_one_line(name),):
            continue
        two = in_two(name, ring.measure)
        taken = [disc, *(other.box for other in labels if other is not label)]
        boxes = (_box(two, places[label.index], ring, outward) for outward in (1.0, 0.0))
        box = next((box for box in boxes if _is_free(box, ring.within, taken)), None)
        if box is not None:
            labels[number] = replace(label, box=box, lines=two)
    return labels


def non_overlapping(
    labels: Sequence[DialLabel], within: Rect, taken: Sequence[Rect] = ()
) -> list[DialLabel]:
    """Return the labels that are inside and overlap none of lower rank, sorted by rank."""
    placed: list[DialLabel] = []
    boxes = list(taken)
    for label in sorted(labels, key=lambda entry: entry.rank):
        if _is_free(label.box, within, boxes):
            placed.append(label)
            boxes.append(label.box)
    return placed


def label_at(labels: Sequence[DialLabel], x: float, y: float) -> int:
    """Return the light whose name is at a place; -1 if there is none."""
    point = x, y, 0.0, 0.0
    return next((label.index for label in labels if _overlap(point, label.box)), -1)


def line_starts(label: DialLabel, cx: float, measure: Measure) -> list[float]:
    """Return each line's left end; ``cx`` is the light's place on the rim, -1 to 1."""
    x, _, width, _ = label.box
    return [x + _left_fraction(cx) * (width - measure(text)) for text in label.lines]


def _left_fraction(cx: float) -> float:
    """Return the fraction of a name that is to the left of its place: 0 right of the dial."""
    return 0.5 - 0.5 * min(max(cx / _ASIDE_FROM, -1.0), 1.0)


def _room(cx: float, ring: Ring) -> float:
    """Return how wide a name can be in one line."""
    x, _, width, _ = ring.within
    if abs(cx) < _UPRIGHT:
        return width
    centre, before = ring.middle[0] + cx * ring.reach, _left_fraction(cx)
    left = (centre - x) / before if before > 0 else width
    right = (x + width - centre) / (1 - before) if before < 1 else width
    return min(left, right)


def _box(lines: tuple[str, ...], place: Point, ring: Ring, outward: float = 1.0) -> Rect:
    """Return the box of lines at their place; above and below the rim it is moved into the area.

    At ``outward`` 1, lines in the upper half are above their place and lines in the lower half
    below; at 0, all are level with it.
    """
    (cx, cy), (x, _, width, _) = place, ring.within
    box_width, box_height = max(map(ring.measure, lines)), ring.line_height * len(lines)
    left = ring.middle[0] + cx * ring.reach - _left_fraction(cx) * box_width
    top = ring.middle[1] + cy * ring.reach - box_height * (0.5 - 0.5 * outward * cy)
    if abs(cx) < _UPRIGHT:
        left = min(max(left, x), x + width - box_width)
    return left, top, box_width, box_height


def _is_free(box: Rect, within: Rect, taken: Sequence[Rect]) -> bool:
    (x, y, width, height), (left, top, w, h) = box, within
    inside = x >= left and y >= top and x + width <= left + w and y + height <= top + h
    return inside and not any(_overlap(box, other) for other in taken)


def _overlap(a: Rect, b: Rect) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]


# Room for names: above and below, at the sides, beyond a dot, between two names.
_ABOVE, _ASIDE, _OUT, _GAP = 27.0, 60.0, 3.0, 4.0
_MIN_RADIUS = 24.0
_DOT, _SMALL_DOT, _MANY = 7.0, 4.0, 16


def draw(state: ViewState, ui: UiContext, width: float, height: float) -> ViewState:
    """Draw the dial; a drag blends the lights."""
    x, y = imgui.get_cursor_screen_pos()
    imgui.invisible_button("dial", (width, height))
    ui.note("dial")
    radii = ui.px(_MIN_RADIUS), min(height / 2 - ui.px(_ABOVE), width / 2 - ui.px(_ASIDE))
    out, line = _dot(state, ui) + ui.px(_OUT), imgui.get_text_line_height()
    area = x, y, width, height
    ring = ring_for(_names_to_fit(state), area, radii, out, line, _measure(ui))
    new, hovered = state, -1
    mouse, radius = imgui.get_mouse_pos(), ring.radius
    place = (mouse.x - ring.middle[0]) / radius, (mouse.y - ring.middle[1]) / radius
    if imgui.is_item_active() and len(state.lights) > 1:
        new = lights.blend(state, *place)
    elif imgui.is_item_hovered():
        hovered = light_at(len(state.lights), *place, reach=ui.px(14) / radius)
        if hovered < 0:
            hovered = label_at(_labels(state, ring, -1), mouse.x, mouse.y)
        if hovered >= 0:
            row = state.lights[hovered]
            imgui.set_tooltip("\n".join(dict.fromkeys(map(as_one_line, (row.name, row.label)))))
        else:
            tip("Drag to blend the lights; the middle weights all equally")
    _draw_rim(new, ui, ring, hovered)
    _draw_names(new, ui, ring, hovered)
    return new


def width_for(state: ViewState, ui: UiContext, height: float) -> float:
    """Return the width of a dial with all names uncut."""
    reach = max(height / 2 - ui.px(_ABOVE), ui.px(_MIN_RADIUS)) + _dot(state, ui) + ui.px(_OUT)
    return sum(extents(_names_to_fit(state), reach, _measure(ui)))


def light_at(count: int, x: float, y: float, reach: float) -> int:
    """Return the light at a place of the dial; -1 if there is none within reach."""
    distances = [math.hypot(px - x, py - y) for px, py in rim_places(count)]
    closest = min(range(count), key=lambda i: distances[i])
    return closest if distances[closest] <= reach else -1


def _dot(state: ViewState, ui: UiContext) -> float:
    return ui.px(_DOT if len(state.lights) <= _MANY else _SMALL_DOT)


def _names_to_fit(state: ViewState) -> list[str]:
    """Return the names that the dial makes room for; none if there are too many."""
    return [row.name for row in state.lights] if len(state.lights) <= _MANY else []


def _measure(ui: UiContext) -> Measure:
    """Return the function that measures a name with its gap."""
    return lambda text: text_width(text) + ui.px(_GAP)


def _draw_rim(state: ViewState, ui: UiContext, ring: Ring, hovered: int) -> None:
    draw_list = imgui.get_window_draw_list()
    line = imgui.get_color_u32(imgui.Col_.button_active)
    text = imgui.get_color_u32(imgui.Col_.text)
    (x, y), radius = ring.middle, ring.radius
    centres = [(x + px * radius, y + py * radius) for px, py in rim_places(len(state.lights))]
    draw_list.add_circle_filled((x, y), radius, imgui.get_color_u32(imgui.Col_.frame_bg), 64)
    if 2 < len(centres) <= _MANY:
        ends: list[Any] = [imgui.ImVec2(*place) for place in centres]
        draw_list.add_polyline(ends, line, ui.px(1), imgui.ImDrawFlags_.closed)
    weights = effective_weights(state.lights)
    px, py = dial_place(weights)
    marker = x + px * radius, y + py * radius
    # Many rays would fill the disc.
    strength = 0.6 * min(1.0, _MANY / 2 / max(sum(weight > 0 for weight in weights), 1))
    accent = pack_colour(ACCENT[state.interface.dark], strength)
    for place, weight in zip(centres, weights, strict=True):
        if weight > 0:
            draw_list.add_line(marker, place, accent, ui.px(1 + 2 * weight))
    dot = _dot(state, ui)
    for i, (row, place) in enumerate(zip(state.lights, centres, strict=True)):
        draw_list.add_circle_filled(place, dot, pack_colour(raw_colour(row.rig)))
        marked = i in (hovered, state.interface.light)
        draw_list.add_circle(place, dot, text if marked else line, 0, ui.px(1.5 if marked else 1))
    draw_list.add_circle_filled(marker, ui.px(5), text)
    draw_list.add_circle(marker, ui.px(5), imgui.get_color_u32(imgui.Col_.window_bg), 0, 1.5)


def _labels(state: ViewState, ring: Ring, hovered: int) -> list[DialLabel]:
    """Place the names, first those under the mouse, chosen or lit."""
    weights, chosen_light = effective_weights(state.lights), state.interface.light
    ranks = [
        i - 1e3 * weight - 1e3 * (i == chosen_light) - 1e4 * (i == hovered)
        for i, weight in enumerate(weights)
    ]
    return place_labels([row.name for row in state.lights], ranks, ring)


def _draw_names(state: ViewState, ui: UiContext, ring: Ring, hovered: int) -> None:
    weights, places = effective_weights(state.lights), rim_places(len(state.lights))
    draw_list, half = imgui.get_window_draw_list(), ui.px(_GAP) / 2
    text = imgui.get_color_u32(imgui.Col_.text)
    dim = imgui.get_color_u32(imgui.Col_.text_disabled)
    for label in _labels(state, ring, hovered):
        colour = text if weights[label.index] > 0 or label.index == hovered else dim
        starts = line_starts(label, places[label.index][0], ring.measure)
        for i, (x, line) in enumerate(zip(starts, label.lines, strict=True)):
            draw_list.add_text((x + half, label.box[1] + i * ring.line_height), colour, line)
