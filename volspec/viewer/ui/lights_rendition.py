"""Colour rendition of the chosen light or the mix: the colour vector graphic and its numbers."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from imgui_bundle import imgui

from volspec.appearance.comparison import FARTHEST, HUE_BINS, Rendition, hue_colours
from volspec.viewer.model.rendition import Figures, chosen_lights
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.light_look import as_colour
from volspec.viewer.ui.widgets import as_one_line, pack_colour, wrap_text

# Radius of the graphic's reference circle and inner edge of its ring of hues, of the outer edge.
_CIRCLE, _RING = 0.64, 0.93
# Least width of the numbers; with less next to the graphic, they are below it.
_NUMBERS = 140.0
_SEGMENTS = 64
_TIP = (
    "R_a, R_9: colour rendering, CIE 13.3\n"
    "R_f, R_g: fidelity and gamut, CIE 224 and ANSI/IES TM-30-18\n"
    "SSI: spectral similarity to the light named, SMPTE ST 2122\n"
    "lm/W: efficacy of the radiation from 380 to 780 nm\n\n"
    "Circle: colours under the Planck radiator or daylight of the same temperature;\n"
    "line: under this light. Inwards is duller, outwards more vivid, along a change of hue"
)
_METAMER_TIP = (
    "The scene’s materials that match in daylight and differ most in this light.\n"
    "Special metamerism indices of CIE 15: change in illuminant, and in observer;\n"
    "CIEDE2000, of which 1 is just visible"
)


def draw(state: ViewState, ui: UiContext, height: float) -> None:
    """Draw the tab within a height."""
    panel = ui.lights
    width, gap = imgui.get_content_region_avail().x, imgui.get_style().item_spacing.x
    beside = width - height - gap > ui.px(_NUMBERS)
    side = height if beside else min(width, max(0.5 * height, height - ui.px(230)))
    figures = _figures(state, ui)
    rendition = None if figures is None else figures.light.rendition
    if rendition is not None:
        x, y = imgui.get_cursor_screen_pos()
        imgui.dummy((side, side))
        ui.note("rendition")
        _draw_vectors(ui, rendition, (x + side / 2, y + side / 2), side / 2)
        tip(_TIP)
        if beside:
            imgui.same_line()
    imgui.begin_group()
    imgui.push_style_var(imgui.StyleVar_.item_spacing, (gap, ui.px(1)))
    for name, of_mix in (("Light", False), ("Mix", True)):
        if imgui.radio_button(name, panel.of_mix == of_mix):
            panel.of_mix = of_mix
        ui.note(f"rendition of {name}")
        imgui.same_line()
    imgui.new_line()
    _draw_numbers(state, ui, figures)
    imgui.pop_style_var()
    imgui.end_group()
    for line in [] if figures is None else metamer_lines(figures):
        wrap_text(line, imgui.Col_.text_disabled)
        tip(_METAMER_TIP)


def _figures(state: ViewState, ui: UiContext) -> Figures | None:
    """Return the last figures, which may be of the lights as they were a moment ago."""
    done = ui.results.rendition
    requested = chosen_lights(state, ui.lights.of_mix)
    if done is None or requested is None or done[0].of_mix != requested.of_mix:
        return None
    return done[1]


def _draw_numbers(state: ViewState, ui: UiContext, figures: Figures | None) -> None:
    if figures is None:
        dark = chosen_lights(state, ui.lights.of_mix) is None
        waiting = ui.results.rendition is None or ui.results.rendition[1] is not None
        words = "No light is on" if dark else "…" if waiting else "Too few bands to measure"
        imgui.text_disabled(words)
        return
    for line in number_lines(figures):
        imgui.text(line)
    near = figures.light.temperature
    if near is None:
        wrap_text("Too far from white for rendition", imgui.Col_.text_disabled)
    elif abs(near.Duv) > FARTHEST:
        wrap_text("Duv is beyond CIE 13.3’s ±0.0054", imgui.Col_.text_disabled)


def number_lines(figures: Figures) -> list[str]:
    """Return the figures as lines of the panel."""
    lines, measured = [], figures.light
    near, rendition = measured.temperature, measured.rendition
    if rendition is not None:
        lines += [
            f"R_f {rendition.R_f:.0f}   R_g {rendition.R_g:.0f}",
            f"R_a {rendition.R_a:.0f}   R_9 {rendition.R[8]:.0f}",
        ]
    if measured.similarity is not None:
        lines.append(f"SSI {measured.similarity:.0f}, {measured.reference}")
    if near is not None:
        lines.append(f"{near.kelvin:.0f} K, Duv {round(near.Duv, 4) + 0.0:+.4f}")
    return [*lines, f"{measured.lm_per_W:.0f} lm/W"]


def metamer_lines(figures: Figures) -> list[str]:
    """Return lines on two materials that are alike in daylight; none if no two are."""
    if figures.pair is None or figures.metamerism is None:
        return []
    of = figures.metamerism
    other_observers = ", ".join(f"{observer}° {d:.1f}" for observer, d in of.observers.items())
    return [
        f"{' and '.join(as_one_line(name) for name in figures.pair)}: ΔE {of.delta_E:.1f} in D65",
        f"ΔE {of.illuminant:.1f} in this light",
        f"To others in D65: {other_observers}",
    ]


def _draw_vectors(
    ui: UiContext, rendition: Rendition, middle: tuple[float, float], radius: float
) -> None:
    """Draw the graphic around a point: hues as a ring, the reference as a circle."""
    paint, (x, y) = imgui.get_window_draw_list(), middle
    ring, colours = _ring()
    for i, colour in enumerate(ring):
        (ax, ay), (bx, by) = (_direction(i + step, _SEGMENTS) for step in (0, 1.05))
        inner, outer = radius * _RING, radius
        paint.add_quad_filled(
            (x + inner * ax, y - inner * ay),
            (x + outer * ax, y - outer * ay),
            (x + outer * bx, y - outer * by),
            (x + inner * bx, y - inner * by),
            colour,
        )
    text, faint = (imgui.get_color_u32(c) for c in (imgui.Col_.text, imgui.Col_.text_disabled))
    for number in range(HUE_BINS):
        dx, dy = _direction(number, HUE_BINS)
        edge = (x + radius * _RING * dx, y - radius * _RING * dy)
        paint.add_line(middle, edge, imgui.get_color_u32(imgui.Col_.text, 0.12), 1.0)
    scale = radius * _CIRCLE
    paint.add_circle(middle, scale, faint, 0, ui.px(1.5))
    starts, ends = (
        [(x + scale * a, y - scale * b) for a, b in points.tolist()]
        for points in rendition.vectors()
    )
    for i, (start, end) in enumerate(zip(starts, ends, strict=True)):
        paint.add_line(start, end, colours[i], ui.px(2))
        paint.add_line(end, ends[(i + 1) % HUE_BINS], text, ui.px(1.5))


def _direction(step: float, steps: int) -> tuple[float, float]:
    angle = 2.0 * math.pi * step / steps
    return math.cos(angle), math.sin(angle)


@lru_cache(maxsize=1)
def _ring() -> tuple[list[int], list[int]]:
    """Return packed colours of the ring's segments and of the hue bins."""
    packed: list[list[int]] = []
    for count, chroma in ((_SEGMENTS, 40.0), (HUE_BINS, 50.0)):
        hues = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + np.pi / count
        packed.append([pack_colour(as_colour(codes)) for codes in hue_colours(hues, chroma)])
    return packed[0], packed[1]
