"""The scale bar in the picture's corner: exact without perspective, else for the target's depth."""

from __future__ import annotations

import math

from imgui_bundle import imgui

from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.widgets import BLACK, WHITE, over_picture, packed

# Pixels at 96 dpi; a narrower picture has no bar.
_LONGEST, _MARGIN, _TICK, _NARROW = 130.0, 16.0, 4.0, 90.0


def length_mm(mm_per_px: float, longest_px: float) -> float:
    """The greatest of 1, 2, 5, 10, … that is no longer than so many pixels.

    >>> length_mm(0.5, 130), length_mm(0.001, 130)
    (50.0, 0.1)
    """
    most = mm_per_px * longest_px
    decade = math.floor(math.log10(most))
    # Tenths of a power of ten are no exact numbers: whole ones are divided.
    lengths = [
        step * 10.0**power if power >= 0 else step / 10.0**-power
        for power in (decade - 1, decade)
        for step in (1, 2, 5)
    ]
    return max(length for length in lengths if length <= most * (1 + 1e-9))


def length_text(mm: float) -> str:
    """A length with its unit.

    >>> [length_text(mm) for mm in (0.02, 5.0, 50.0, 2000.0, 2e-5)]
    ['20 µm', '5 mm', '5 cm', '2 m', '0.02 µm']
    """
    units = ((1000.0, "m"), (10.0, "cm"), (1.0, "mm"))
    size, unit = next((each for each in units if mm >= each[0]), (1e-3, "µm"))
    return f"{mm / size:.6g} {unit}"


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw it."""
    if not state.interface.aids.scale:
        return None
    x, y, width, height = ui.areas["picture"]
    if width < ui.px(_NARROW):
        return None
    seen = ui.projection(state)
    mm = length_mm(seen.mm_per_px, min(ui.px(_LONGEST), width / 3))
    long = mm / seen.mm_per_px
    right, low = x + width - ui.px(_MARGIN), y + height - ui.px(_MARGIN)
    left, tick = right - long, ui.px(_TICK)
    text = length_text(mm)
    size = imgui.calc_text_size(text)
    line, shade = packed(WHITE, 0.9), packed(BLACK, 0.55)
    strokes = (
        ((left, low), (right, low)),
        ((left, low - tick), (left, low + tick)),
        ((right, low - tick), (right, low + tick)),
    )
    with over_picture(ui) as draw_list:
        # The shade first, so that it is legible on any picture.
        for colour, thick, shift in ((shade, 3.5, 1.0), (line, 1.5, 0.0)):
            for ends in strokes:
                draw_list.add_line(*ends, colour, ui.px(thick))
            place = (left + right - size.x) / 2 + shift, low - size.y - tick + shift
            draw_list.add_text(place, colour, text)
    ui.areas["scale"] = int(left), int(low - tick), int(long), int(2 * tick)
    return None
