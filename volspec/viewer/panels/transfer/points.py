"""Opacity over value: points of a curve, or surfaces, dragged over the histogram."""

from __future__ import annotations

import numpy as np
from imgui_bundle import imgui, implot

from volspec.transfer import Isosurfaces, TransferFunction
from volspec.viewer.desk import Desk
from volspec.viewer.events import Event, reduced
from volspec.viewer.panels.lights.colours import Colour
from volspec.viewer.panels.transfer import detail
from volspec.viewer.panels.transfer.axes import height_of, opacity_at, opacity_plot, say
from volspec.viewer.panels.transfer.colours import part_colours
from volspec.viewer.panels.widgets import packed
from volspec.viewer.state import ViewState
from volspec.viewer.transfer.parts import Part, parts_of
from volspec.viewer.window.style import ACCENT

_STRIP_PX = 3.0


def draw(state: ViewState, desk: Desk) -> ViewState:
    """Draw the plot, and the chosen point or surface below."""
    new, what = state, "Surface" if isinstance(state.transfer, Isosurfaces) else "Point"
    with opacity_plot(state, desk, detail.height_above(2, desk)) as shown:
        if shown:
            implot.push_plot_clip_rect()
            if isinstance(state.transfer, TransferFunction):
                _fill(state, state.transfer, desk)
                if state.transfer.gradient_opacity:
                    say("× what the gradient lets through", desk)
            else:
                _stems(state, desk)
            implot.pop_plot_clip_rect()
            new = _handles(state, desk)
    new = detail.value_and_opacity(new, desk, what)
    return detail.material(new, desk, detail.chosen(new))


def _fill(state: ViewState, curve: TransferFunction, desk: Desk) -> None:
    """What is below the curve, in the colours of what is seen there; the curve itself."""
    draw_list = implot.get_plot_draw_list()
    left, width = implot.get_plot_pos().x, implot.get_plot_size().x
    places = np.array([implot.plot_to_pixels(value, 0.0).x for value, _, _ in curve.points])
    # Upright stripes: the curve between points is straight in opacity, not on this axis.
    strip = desk.px(_STRIP_PX)
    at = np.concatenate([np.arange(left, left + width + strip, strip), places])
    # At whole pixels, or stripes would blend where they meet.
    at = np.unique(at.clip(left, left + width).round())
    opacity = np.interp(at, places, [opacity for _, opacity, _ in curve.points])
    codes = np.array(part_colours(state))
    mixed = np.stack([np.interp(at, places, column) for column in codes.T], axis=1)
    zero, one = (implot.plot_to_pixels(0.0, height).y for height in (0.0, 1.0))
    tops = zero + (one - zero) * np.sqrt(opacity)
    for i in range(len(at) - 1):
        if max(opacity[i], opacity[i + 1]) <= 0:
            continue
        ends = (at[i], (tops[i] + tops[i + 1]) / 2), (at[i + 1], zero)
        draw_list.add_rect_filled(*ends, packed((mixed[i] + mixed[i + 1]) / 2, 0.7))
    line: list[imgui.ImVec2Like] = [(float(x), float(y)) for x, y in zip(at, tops, strict=True)]
    draw_list.add_polyline(line, _ink(), desk.px(1.4), 0)


def _stems(state: ViewState, desk: Desk) -> None:
    """An upright line for each surface, as high as it is opaque."""
    draw_list = implot.get_plot_draw_list()
    for part, colour in zip(parts_of(state.transfer), part_colours(state), strict=True):
        foot = implot.plot_to_pixels(part.values[0], 0.0)
        head = implot.plot_to_pixels(*_place(part))
        draw_list.add_line(foot, head, _ink(), desk.px(5))
        draw_list.add_line(foot, head, packed(colour), desk.px(3))


def _handles(state: ViewState, desk: Desk) -> ViewState:
    """What is dragged, clicked away, or added where there is none."""
    new, held, chosen = state, False, detail.chosen(state)
    colours = part_colours(state)
    for i, part in enumerate(parts_of(state.transfer)):
        # The last three ask for what it tells of the mouse; `_mark` is what is seen.
        moved, x, y, clicked, hovered, down = implot.drag_point(
            i, *_place(part), (0, 0, 0, 0), desk.px(5), 0, False, False, False
        )
        held = held or bool(down) or bool(hovered)
        if hovered and imgui.is_mouse_clicked(1):
            new = reduced(new, Event("remove-point", index=i))
        elif moved:
            new = reduced(new, Event("point", x, opacity_at(y), index=i))
        if clicked or down:
            new = reduced(new, Event("choose-point", index=i))
        if hovered or down:
            value, mix = part.values[0], detail.in_words(part.mix)
            imgui.set_tooltip(f"value {value:.5g}\nopacity {part.opacity:.3g}\n{mix}")
        _mark(desk, part, colours[i], i == chosen, state.interface.dark)
    if implot.is_plot_hovered() and not held and imgui.is_mouse_double_clicked(0):
        mouse = implot.get_plot_mouse_pos()
        new = reduced(new, Event("add-point", mouse.x, opacity_at(mouse.y)))
    return new


def _mark(desk: Desk, part: Part, colour: Colour, chosen: bool, dark: bool) -> None:
    """A handle in its colour, ringed so that it is seen on any ground."""
    implot.push_plot_clip_rect(desk.px(6))
    draw_list, place = implot.get_plot_draw_list(), implot.plot_to_pixels(*_place(part))
    ring = packed(ACCENT[dark]) if chosen else _ink()
    draw_list.add_circle_filled(place, desk.px(5.5 if chosen else 4.5), ring)
    draw_list.add_circle_filled(place, desk.px(3.5), packed(colour))
    implot.pop_plot_clip_rect()


def _place(part: Part) -> tuple[float, float]:
    return part.values[0], height_of(part.opacity)


def _ink() -> int:
    return int(imgui.get_color_u32(imgui.Col_.text))
