"""The panel of the palette: table, wizards, materials of values, criteria."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from imgui_bundle import imgui

from volspec.palette import VISIBLE, apart_text
from volspec.transfer import TransferFunction
from volspec.viewer.model import palette_edits, palette_table
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.materials import can_be_exact
from volspec.viewer.model.palette_table import PaletteTable
from volspec.viewer.model.palette_targets import CRITERIA, DISTANCES, MIN_SMOOTHNESS
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_convert import transfer_kind
from volspec.viewer.ui import palette_cells, palette_editor
from volspec.viewer.ui.context import UiContext, tip
from volspec.viewer.ui.form import Form, FormField, draw_fields
from volspec.viewer.ui.widgets import ACCENT, as_one_line, pack_colour, pick, wrap_text

_BUTTON, _LABEL, _UNDER = 66.0, 72.0, 54.0
_SURROUNDINGS, _BLACK = "its surroundings", "black"
_NO_LIGHT = "none: the light stays as it is"
_FORM = Form(lambda state: state.palette.targets.criteria, palette_edits.set_criterion)
_METRICS = {"Lab": "perceptual (CIELAB)", "RGB": "display codes (RGB)"}
_CRITERIA = (
    FormField(
        *("smoothness", "Smooth", (MIN_SMOOTHNESS, CRITERIA["smoothness"][1]), "%.4f"),
        is_logarithmic=True,
        tip="Weight of smoothness; a high weight misses target colours",
    ),
    FormField("rounds", "Iterations", CRITERIA["rounds"]),
    FormField("metric", "Compare", titles=_METRICS, key="pick Compare"),
)


def _wizards(state: ViewState, ui: UiContext) -> ViewState:
    material, light = palette_table.wizard_place(state)
    rows, lights = tuple(state.transfer.materials), palette_table.column_names(state.lights)
    inputs, new = state.interface.pick, state
    half = (imgui.get_content_region_avail().x - ui.px(_UNDER)) / 2
    picked = _combo("##material", material, rows, ui, half)
    new = _apply_pick(new, palette_edits.pick_material, picked)
    imgui.same_line(0, ui.px(7))
    imgui.text_disabled("under")
    imgui.same_line(0, ui.px(7))
    new = _apply_pick(new, palette_edits.pick_light, _combo("##light", light, lights, ui))
    model = inputs.like if inputs.like in lights else ""
    picked = _combo("New light", f"like {model}" if model else _NO_LIGHT, (_NO_LIGHT, *lights), ui)
    tip("Also designs a light under which the other materials look as they do under this one")
    if picked is not None:
        new = palette_edits.with_pick(new, like="" if picked == _NO_LIGHT else picked)
    imgui.spacing()
    _wizard_button("hide", "Make it look like its surroundings under this light", ui)
    other_rows = tuple(name for name in rows if name != material)
    # The picked material may have been removed since.
    within = _BLACK if inputs.black else inputs.within if inputs.within in rows else _SURROUNDINGS
    picked = _combo("##within", within, (_SURROUNDINGS, *other_rows, _BLACK), ui)
    if picked is not None:
        within = "" if picked in (_SURROUNDINGS, _BLACK) else picked
        new = palette_edits.with_pick(new, within=within, black=picked == _BLACK)
    _wizard_button(
        "reveal",
        "Make it differ from all others under this light; if a colour-vision deficiency is\n"
        "simulated, to viewers with it as well",
        ui,
    )
    imgui.set_next_item_width(-1)
    changed, distance = imgui.slider_float("##far", inputs.distance, *DISTANCES, "by ΔE %.0f")
    if changed:
        new = palette_edits.pick_distance(new, distance)
    _wizard_button("keep", "Give it one colour under all lights", ui)
    imgui.align_text_to_frame_padding()
    imgui.text_disabled("its colour, under all lights")
    _wizard_button("merge", "Give materials one colour under this light", ui)
    return _merge_list(new, rows)


def _apply_pick(
    state: ViewState, change: Callable[[ViewState, str], ViewState], name: str | None
) -> ViewState:
    """Return the state after an edit with the name that was picked, if any."""
    return state if name is None else change(state, name)


def _merge_list(state: ViewState, rows: Sequence[str]) -> ViewState:
    """Draw a list of materials to tick."""
    ticked, new = state.interface.pick.materials, state
    several = [name for name in rows if name in ticked]
    words = ", ".join(several) if len(several) > 1 else "all materials"
    imgui.set_next_item_width(-1)
    if imgui.begin_combo("##several", as_one_line(words), imgui.ComboFlags_.height_large):
        for number, name in enumerate(rows):
            if imgui.checkbox(f"{as_one_line(name)}###{number}", name in ticked)[0]:
                new = palette_edits.toggle_merged(new, name)
        imgui.end_combo()
    return new


def _wizard_button(name: str, text: str, ui: UiContext) -> None:
    """Draw a wizard's button; its settings follow in the line."""
    if imgui.button(name.capitalize(), (ui.px(_BUTTON), 0)):
        ui.request(name)
    ui.note(f"wizard {name}", text)
    imgui.same_line()


def _values(state: ViewState, ui: UiContext) -> ViewState:
    """Draw the ranges of the transfer function, and a tool that adds one."""
    curve, new = state.transfer, state
    if not isinstance(curve, TransferFunction):
        has = f"This transfer function has {transfer_kind(curve)}, not the ranges of a curve."
        imgui.text_wrapped(f"{has} Edit it in the Transfer panel")
        return state
    names = tuple(curve.materials)
    for number, span in enumerate(palette_table.material_ranges(curve)):
        imgui.push_id(number)
        imgui.align_text_to_frame_padding()
        imgui.text(f"{span.low:.4g} – {span.high:.4g}")
        imgui.same_line(ui.px(100))
        choice = _combo("##of", span.material, names, ui)
        if choice not in (None, span.material):
            new = palette_edits.recast_range(new, number, choice)
        imgui.pop_id()
    imgui.separator()
    picked, (low, high) = state.interface.pick, state.document.volume.range
    first, last = picked.values or (low, high)
    use = picked.use if picked.use in names else names[0]
    imgui.set_next_item_width(ui.px(118))
    changed, first, last = imgui.drag_float_range2(
        "##range", first, last, (high - low) / 300, low, high, "%.4g", "%.4g"
    )
    ui.note("range")
    if changed:
        new = palette_edits.with_pick(new, values=(first, last))
    imgui.same_line()
    choice = _combo("##use", use, names, ui, -ui.px(52))
    if choice is not None:
        new = palette_edits.with_pick(new, use=choice)
    imgui.same_line()
    if imgui.button("Use", (-1, 0)):
        new = palette_edits.assign(new, first, last, use)
    ui.note("use", "Assign the material to this range; opacities stay")
    return new


def _criteria(state: ViewState, ui: UiContext) -> ViewState:
    imgui.push_item_width(-ui.px(_LABEL))
    new = draw_fields(state, ui, _FORM, *_CRITERIA)
    imgui.pop_item_width()
    wrap_text("Spectra stay above 0, reflectances below 1.", imgui.Col_.text_disabled)
    return new


def _combo(
    label: str, now: str, names: Iterable[str], ui: UiContext, width: float | None = None
) -> str | None:
    """Draw a list to pick from, as wide as the panel allows."""
    imgui.set_next_item_width(width or (-1 if label.startswith("##") else -ui.px(_LABEL)))
    picked = pick(label, now, names)
    ui.note(f"pick {label.strip('#')}")
    return picked


_HELP = (
    "Rows are materials, columns are lights. A cell shows the colour of the material under the "
    "light, and in its middle the target colour.\n\n"
    "Click a cell and pick a target colour: ticked spectra change until the targets are met. "
    "A frame and a number mark missed targets: the ΔE, where 1 is just visible.\n\n"
    "The first target casts the scene once more, with materials as channels; after that, the "
    "picture follows without a cast, and its colours are exact."
)
_FILTERED = "Materials with filters absorb by wavelength: every design casts the scene again."
_MARKS = (
    "Small ones: keep the colour if possible.\n"
    "~ one colour with others   = as another cell   ≠ different from another   ! out of gamut"
)
_MISSED = (
    "The number is the ΔE; below 1 is not visible.\n"
    "No choice of the ticked spectra meets all targets."
)
_MAX_LINES = 3
_APART = (
    "CIEDE2000 between two materials to be distinguished, as viewers with normal vision and with a "
    "lacking cone see them: the least under these lights"
)
# Commands of the menu, in three parts.
_MENU = (
    ("palette-light", "palette-restart"),
    ("palette-load", "palette-save"),
    ("palette-forget", "palette-own"),
)
# Title, name that is noted, and contents of a section.
_SECTIONS = (
    ("Hide, reveal, keep, merge", "wizards", _wizards),
    ("Materials of values", "values", _values),
    ("Criteria", "criteria", _criteria),
)


def draw(state: ViewState, ui: UiContext) -> ViewState | None:
    """Draw the panel."""
    table = palette_table.colour_table(state)
    new = _head(state, table, ui)
    if table.complaint:
        imgui.text_wrapped(table.complaint)
    else:
        new = palette_cells.draw(new, table, ui)
        new = palette_editor.draw(new, table, ui)
        _legend(state, ui)
        _distances(table)
    _status(ui)
    for title, name, section in _SECTIONS:
        opened = imgui.collapsing_header(title)
        ui.note(name)
        if opened:
            new = section(new, ui)
    return None if new is state else new


def _head(state: ViewState, table: PaletteTable, ui: UiContext) -> ViewState:
    """Draw the summary of the targets, and the menu of commands for all of them."""
    new = state
    imgui.align_text_to_frame_padding()
    imgui.text(ui.results.design.busy or summary(table))
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
        for i, names in enumerate(_MENU):
            if i:
                imgui.separator()
            for name in names:
                if imgui.menu_item(BY_NAME[name].title, "", False)[0]:
                    new = ui.run(new, name)
                ui.note(f"palette {name}")
        imgui.end_popup()
    return new


def summary(table: PaletteTable) -> str:
    """Return the errors of all targets in a line."""
    errors = table.errors
    if not errors:
        return "Click a cell to set a target colour"
    worst = max(errors)
    if missed := sum(error > VISIBLE for error in errors):
        return f"{missed} of {len(errors)} missed: ΔE up to {worst:.1f}"
    drift = max(table.drifts, default=0.0)
    if drift > VISIBLE:
        return f"Targets met; others changed by ΔE {drift:.0f}"
    return f"Targets met (ΔE {worst:.1f} or less)"


def _legend(state: ViewState, ui: UiContext) -> None:
    """Draw the legend of the marks."""
    side = imgui.get_text_line_height()
    x, y = imgui.get_cursor_screen_pos()
    draw_list = imgui.get_window_draw_list()
    outer = imgui.get_color_u32(imgui.Col_.button_active)
    draw_list.add_rect_filled((x, y), (x + side, y + side), outer, ui.px(2))
    inner, inset = imgui.get_color_u32(imgui.Col_.text_disabled), side * 0.3
    draw_list.add_rect_filled((x + inset, y + inset), (x + side - inset, y + side - inset), inner)
    imgui.dummy((side, side))
    imgui.same_line(0, ui.px(6))
    imgui.text_disabled("reached, around the target")
    tip("The larger the square, the higher the target's weight.\n" + _MARKS, greyed=True)
    imgui.same_line(0, ui.px(14))
    x, y = imgui.get_cursor_screen_pos()
    accent = pack_colour(ACCENT[state.interface.dark])
    draw_list.add_rect((x, y), (x + side, y + side), accent, ui.px(2), ui.px(2))
    imgui.dummy((side, side))
    imgui.same_line(0, ui.px(6))
    imgui.text_disabled("missed, and how far")
    tip(_MISSED, greyed=True)


def _distances(table: PaletteTable) -> None:
    """Draw how far materials to be distinguished are, by colour vision."""
    for pair in table.apart[:_MAX_LINES]:
        imgui.text_wrapped(apart_text(pair))
        tip(_APART)
    if more := table.apart[_MAX_LINES:]:
        imgui.text_disabled(f"and {len(more)} more pairs")
        tip("\n".join(map(apart_text, more)), at_once=True)


def _status(ui: UiContext) -> None:
    """Draw the last error, advice, and the result of a wizard."""
    news = ui.results.design
    if news.complaint:
        wrap_text(news.complaint, imgui.Col_.check_mark)
        ui.note("palette complaint")
    lines = (*news.reached, *news.advice)
    for line in lines[:_MAX_LINES]:
        imgui.text_wrapped(line)
    if more := lines[_MAX_LINES:]:
        imgui.text_disabled(f"and {len(more)} more")
        tip("\n".join(more), at_once=True)
