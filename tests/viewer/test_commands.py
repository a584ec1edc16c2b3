"""The command palette, the cheat sheet and the menus, without a window."""

from __future__ import annotations

from dataclasses import replace

from volspec.appearance.presets import PRESETS
from volspec.appearance.spec import MODELS
from volspec.viewer.model.commands import BY_KEY, COMMANDS, MENUS, key_text_of
from volspec.viewer.model.edit import after
from volspec.viewer.model.light_rows import effective_weights
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import commands, menus
from volspec.viewer.work.session_store import RecentFile

RECENT = (RecentFile("/data/head.nrrd", True), RecentFile("/data/gone.nrrd", False))


def titles(state: ViewState, search: str) -> list[str]:
    return [row.text for row in commands.commands_of(state, RECENT, search)]


def test_the_palette_lists_every_action_light_model_display_and_file(state: ViewState) -> None:
    rows = commands.commands_of(state, RECENT)
    names = {row.text for row in rows}
    for action in COMMANDS:
        title = f"{action.menu or 'Step'}: {action.title.removesuffix(' …')}"
        assert title in names or action.name == "commands"
    for row in state.lights:
        assert any(name.startswith(f"Light: {row.name} alone") for name in names)
    assert {f"Model: {name}" for name in MODELS} <= names
    assert {f"Display: {name}" for name in PRESETS} <= names
    assert [row.ask for row in rows if row.group == "Open"] == ["open /data/head.nrrd"]
    # Each does something, and rows with a key show it.
    assert all((row.change is None) != (row.ask == "") for row in rows)
    shots = [row for row in rows if row.ask == "screenshot"]
    assert [row.key for row in shots] == ["S"]


def test_a_search_finds_words_before_letters(state: ViewState) -> None:
    assert titles(state, "")[0] == "File: Open"
    assert titles(state, "hp1")[0].endswith("HP1")
    assert titles(state, "fl2 alone") == ["Light: FL2 alone"]
    assert titles(state, "FL2")[0] == "Light: FL2 alone"
    labelled = replace(state, lights=(replace(state.lights[1], label="tungsten lamp"),))
    assert titles(labelled, "tung")[0] == "Light: A alone, tungsten lamp"
    assert titles(state, "undo")[0] == "Edit: Undo"
    assert titles(state, "exp py")[0] == "File: Export as Python"
    assert "File: Export as scene" in titles(state, "xptsc")
    assert titles(state, "zzzz") == []


def test_rows_do_what_they_say(state: ViewState) -> None:
    def done(search: str) -> ViewState:
        row = commands.commands_of(state, (), search)[0]
        assert row.change is not None
        return after(row.change, state).state

    assert effective_weights(done("light FL2 alone").lights) == (0.0, 0.0, 1.0, 0.0)
    assert done("model CAM16").relight.viewing.model == "CAM16"
    assert done("add light HP1").lights[-1].name == "HP1"
    assert done("window dark").interface.dark != state.interface.dark
    dark = next(name for name, preset in PRESETS.items() if preset.surround == "dark")
    marked = replace(state.relight.viewing.display, mark=True)
    seen = replace(state.relight, viewing=replace(state.relight.viewing, display=marked))
    row = commands.commands_of(state, (), f"display {dark}")[0]
    display = after(row.change, replace(state, relight=seen)).state.relight.viewing.display
    assert display.surround == "dark" and display.mark


def test_settings_are_reached_by_name(state: ViewState) -> None:
    def row(text: str) -> commands.Entry:
        return commands.commands_of(state, (), text)[0]

    closed = replace(state, interface=replace(state.interface, panels=frozenset()))
    for name in ("Illuminance", "Exposure", "Background", "Room", "Adaptation"):
        setting = row(f"setting {name}")
        assert setting.item == name and setting.change is not None
        assert "Viewing" in after(setting.change, closed).state.interface.panels
    dim, reduce = row("surround dim").change, row("gamut reduce").change
    assert dim is not None and reduce is not None
    assert after(dim, state).state.relight.viewing.surround == "dim"
    assert after(reduce, state).state.relight.viewing.display.gamut == "reduce"


def test_lights_that_find_no_room_change_nothing(state: ViewState) -> None:
    full = replace(state, lights=state.lights * 30)
    row = commands.commands_of(state, (), "add light HP1")[0]
    assert after(row.change, full).state is full


def test_keys_are_used_once_and_all_menus_are_known() -> None:
    used = [key for action in COMMANDS for key in action.keys if key]
    assert len(used) == len(set(used)) == len(BY_KEY)
    # Those of no menu are steps, which only keys make.
    assert {action.menu for action in COMMANDS} <= {*MENUS, ""}
    assert key_text_of("f1") == "F1" and key_text_of("ctrl+p") == "Ctrl+P"


def test_the_sheet_shows_every_key_in_columns_of_even_height() -> None:
    listed = {what for _, rows in menus.SHEET for _, what in rows}
    for action in COMMANDS:
        # Steps by arrows and the recall of states stand there as a line each.
        if action.menu and not action.name.startswith("recall-"):
            assert not any(action.keys) or action.title.removesuffix(" …") in listed
    for count in (1, 2, 3, 9):
        columns = menus.columns(menus.SHEET, count)
        assert len(columns) <= count
        assert [part for column in columns for part in column] == list(menus.SHEET)
    tall = [sum(len(rows) + 2 for _, rows in column) for column in menus.columns(menus.SHEET, 2)]
    # Parts are not divided, so that one may stand over.
    assert max(tall) - min(tall) <= max(len(rows) + 2 for _, rows in menus.SHEET)
