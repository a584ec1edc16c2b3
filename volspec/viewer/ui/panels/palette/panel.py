"""The palette: materials are rows, lights columns; colours are wanted of their cells and designed.

References
----------
[1] Bergner, Drew & Möller (2009), ACM TOG 28(1) art. 5, section 3 and figure 2: the table.
"""

from __future__ import annotations

from imgui_bundle import imgui

from volspec.palette.advice import VISIBLE
from volspec.viewer.model.actions import BY_NAME
from volspec.viewer.model.palette.spectra import can_be_exact
from volspec.viewer.model.palette.table import Table, table_of
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.panels.palette import cells, editor, tools
from volspec.viewer.ui.panels.widgets import AT_ONCE, WAITING_GREYED, packed, tip, wrapped
from volspec.viewer.ui.window.style import ACCENT

_HELP = (
    "Rows are materials, columns lights. A cell shows the colour that the material has under that "
    "light, and in its middle the colour you want there.\n\n"
    "Click a cell and pick its colour: spectra that are ticked change until the wishes are met. "
    "A frame and a number say where they cannot be: ΔE, how far off, 1 is just seen.\n\n"
    "With the first wish the scene is cast once more, by its materials; from then on the picture "
    "follows without a cast, with exact colours."
)
_FILTERED = "Materials with filters absorb by wavelength: every design casts the scene anew."
_MARKS = (
    "Small ones only stay as they were, as far as they can.\n"
    "~ one colour with others   = as another cell   ≠ apart from another   ! outside the display"
)
_MISSED = "Below 1 nobody sees it. No spectrum that may change shows all that is wanted."
_MOST_SAID = 3
# Actions of the menu, in three parts.
_MENU = (
    *("palette-light", "palette-anew", "", "palette-load", "palette-save", ""),
    *("palette-forget", "palette-own"),
)


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    table = table_of(state)
    new = _head(state, table, ui)
    if table.complaint:
        imgui.text_wrapped(table.complaint)
    else:
        new = cells.draw(new, table, ui)
        new = editor.draw(new, table, ui)
        _legend(state, ui)
    _news(ui)
    new = tools.draw(new, ui)
    return None if new is state else new


def _head(state: ViewState, table: Table, ui: UiContext) -> ViewState:
    """How near the wishes are, and what can be done about all of them."""
    new = state
    imgui.align_text_to_frame_padding()
    busy = ui.results.design.busy
    imgui.text(busy or summary(table))
    right = imgui.get_window_width() - imgui.get_style().window_padding.x
    imgui.same_line(right - ui.px(56))
    if imgui.button("…", (ui.px(26), 0)):
        imgui.open_popup("palette menu")
    ui.note("palette menu")
    imgui.same_line(right - ui.px(26))
    imgui.button("?", (ui.px(26), 0))
    if imgui.is_item_hovered():
        imgui.set_next_window_size((ui.px(320), 0))
        if imgui.begin_tooltip():
            imgui.text_wrapped(_HELP if can_be_exact(state.transfer) else f"{_HELP}\n\n{_FILTERED}")
            imgui.end_tooltip()
    if imgui.begin_popup("palette menu"):
        for name in _MENU:
            if not name:
                imgui.separator()
                continue
            action = BY_NAME[name]
            if imgui.menu_item(action.title, "", False)[0]:
                new = ui.done(new, action)
            ui.note(f"palette {name}")
        imgui.end_popup()
    return new


def summary(table: Table) -> str:
    """How near the wishes are, in a line."""
    errors = table.errors
    if not errors:
        return "Click a cell to wish for a colour"
    worst = max(errors)
    missed = sum(error > VISIBLE for error in errors)
    if missed:
        return f"{missed} of {len(errors)} missed: ΔE up to {worst:.1f}"
    drift = max(table.drifts, default=0.0)
    others = f", others drift by {drift:.0f}" if drift > VISIBLE else ""
    return f"All met, ΔE ≤ {worst:.1f}{others}"


def _legend(state: ViewState, ui: UiContext) -> None:
    """What the marks mean: a cell drawn small, and words."""
    side = imgui.get_text_line_height()
    x, y = imgui.get_cursor_screen_pos()
    draw_list = imgui.get_window_draw_list()
    outer, inner = (
        imgui.get_color_u32(imgui.Col_.button_active),
        imgui.get_color_u32(imgui.Col_.text_disabled),
    )
    draw_list.add_rect_filled((x, y), (x + side, y + side), outer, ui.px(2))
    inset = side * 0.3
    draw_list.add_rect_filled((x + inset, y + inset), (x + side - inset, y + side - inset), inner)
    imgui.dummy((side, side))
    imgui.same_line(0, ui.px(6))
    imgui.text_disabled("reached, around wanted")
    tip("The larger the square, the more the wish counts.\n" + _MARKS, WAITING_GREYED)
    imgui.same_line(0, ui.px(14))
    x, y = imgui.get_cursor_screen_pos()
    accent = packed(ACCENT[state.interface.dark])
    draw_list.add_rect((x, y), (x + side, y + side), accent, ui.px(2), ui.px(2))
    imgui.dummy((side, side))
    imgui.same_line(0, ui.px(6))
    imgui.text_disabled("missed, by ΔE")
    tip(_MISSED, WAITING_GREYED)


def _news(ui: UiContext) -> None:
    """Why something was refused, what would help, what a wizard reached."""
    news = ui.results.design
    if news.complaint:
        wrapped(news.complaint, imgui.Col_.check_mark)
        ui.note("palette complaint")
    for line in (*news.reached, *news.advice)[:_MOST_SAID]:
        imgui.text_wrapped(line)
    rest = (*news.reached, *news.advice)[_MOST_SAID:]
    if rest:
        imgui.text_disabled(f"and {len(rest)} more")
        tip("\n".join(rest), AT_ONCE)
