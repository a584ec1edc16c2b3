"""The error map over the picture, with its scale and figures."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from imgui_bundle import imgui

from volspec.relight.error_map import ErrorMap
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import BLACK, WHITE, over_picture, packed, text_width

_STEPS = 48
# CIEDE2000 of colours that an eye can just tell apart.
_TOLD_APART = 1.0


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it."""
    heat = ui.results.heat
    if heat is None or not state.interface.error_map:
        return None
    if heat.texture and heat.image is ui.results.image:
        left, top, right, bottom = ui.results.shown_at
        with over_picture(ui) as draw_list:
            draw_list.add_image(imgui.ImTextureRef(heat.texture), (left, top), (right, bottom))
    x, y, _, _ = ui.areas["picture"]
    _legend(ui, (x + ui.px(14), y + ui.px(14)))
    return None


def _legend(ui: UiContext, corner: tuple[float, float]) -> None:
    heat = ui.results.heat
    assert heat is not None
    found = heat.map
    lines = told(found, heat.problem)
    draw_list = imgui.get_background_draw_list()
    x, y = corner
    wide = max(text_width(line) for line in lines)
    tall = imgui.get_text_line_height_with_spacing()
    bar = ui.px(10) if found is not None else 0.0
    rows = len(lines) + int(found is not None)
    pad = ui.px(8)
    white = packed(WHITE)
    end = x + wide + 2 * pad, y + rows * tall + bar + 2 * pad
    draw_list.add_rect_filled((x, y), end, packed(BLACK, 0.55), ui.px(5))
    for i, line in enumerate(lines):
        draw_list.add_text((x + pad, y + pad + i * tall), white, line)
    if found is None:
        return
    top = y + pad + len(lines) * tall
    step = wide / _STEPS
    for i, colour in enumerate(_scale()):
        left = x + pad + i * step
        draw_list.add_rect_filled((left, top), (left + step + 1, top + bar), colour)
    for share in (0.0, 0.5, 1.0):
        text = f"{share * found.top:.3g}"
        at = x + pad + share * (wide - text_width(text))
        draw_list.add_text((at, top + bar + ui.px(1)), white, text)


def told(found: ErrorMap | None, problem: str) -> list[str]:
    """The figures of a map; where there is none, why."""
    if found is None:
        return [problem or "Error map: working …"]
    figures = f"mean {found.mean:.2g}   95 % {found.p95:.2g}   max {found.max:.2g}"
    lines = [f"ΔE00, {found.compared}", figures]
    if found.max < _TOLD_APART:
        lines.append("An eye tells 1 apart: nothing here is seen")
    return lines


@lru_cache(maxsize=1)
def _scale() -> tuple[int, ...]:
    """The map's colours from 0 to its top, as `ErrorMap.heat` has them."""
    ramp = np.linspace(0, 1, _STEPS, dtype=np.float32)[None]
    colours = ErrorMap(ramp, np.ones_like(ramp)).heat(1.0)[0] / 255.0
    return tuple(packed(colour) for colour in colours.tolist())
