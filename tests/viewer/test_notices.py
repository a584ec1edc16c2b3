"""What panels tell the user: why something is not done, what was done beside it, how it stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.viewer.test_transfer import of_kind
from volspec.palette import Cell, CellReport
from volspec.relight.error_map import ErrorMap
from volspec.viewer.model import lights
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.light_rows import MOST_ROWS, LightState
from volspec.viewer.model.light_states import MOST_STATES
from volspec.viewer.model.palette_table import Table, table_of
from volspec.viewer.model.palette_targets import STAY
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.compare import error_map_lines
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.palette_cells import cell_lines
from volspec.viewer.ui.transfer_library import add_material_of
from volspec.viewer.ui.viewing import white_text


def said(state: ViewState, name: str) -> str:
    """What an action says that leaves the state as it is."""
    here = UiContext()
    assert here.run(state, BY_NAME[name]) is state
    assert len(here.requests) == 1
    return str(here.requests[0]).removeprefix("say ")


def full_of_lights(state: ViewState) -> ViewState:
    return replace(state, lights=state.lights[:1] * MOST_ROWS)


def test_actions_that_leave_all_as_it_is_say_why(state: ViewState) -> None:
    full = full_of_lights(state)
    assert said(full, "keep-mix") == said(full, "palette-light")
    assert said(full, "keep-mix") == "99 lights are the most; remove one first"
    dark = replace(state, lights=(replace(state.lights[0], weight=0.0),))
    assert said(dark, "keep-mix") == "No light is on: there is no mix to keep"
    assert said(dark, "remove-light").startswith("The last light stays")
    assert said(state, "palette-anew").startswith("Nothing may change yet")
    kept = tuple(LightState(str(i), state.lights, state.relight) for i in range(MOST_STATES))
    assert said(replace(state, saved_lights=kept), "save-state").startswith(
        "99 saved states are the most"
    )


@pytest.mark.parametrize("name", ["preset-bone", "transfer-regions"])
def test_labels_say_that_no_preset_and_no_other_kind_fits_them(state: ViewState, name: str) -> None:
    assert said(of_kind(state, "labels"), name).startswith("Labels are names, no values")


def test_actions_that_do_something_or_have_nothing_to_do_say_nothing(state: ViewState) -> None:
    here = UiContext()
    for name in ("keep-mix", "save-state", "palette-light", "remove-light", "preset-bone"):
        assert here.run(state, BY_NAME[name]) is not state, name
    # It is a curve already.
    assert here.run(state, BY_NAME["transfer-points"]) is state
    assert here.requests == []


def test_the_command_palette_says_why_a_light_is_not_added(state: ViewState) -> None:
    from volspec.viewer.ui.commands import commands_of

    command = next(c for c in commands_of(state, (), "add light hp1") if c.title == "HP1")
    assert command.change is not None
    here, full = UiContext(), full_of_lights(state)
    assert here.edited(full, command.change) is full
    assert here.requests == ["say 99 lights are the most; remove one first"]
    assert here.edited(state, command.change) is not state
    assert len(here.requests) == 1


def test_the_library_says_what_adding_a_material_did_or_why_it_did_not(state: ViewState) -> None:
    here = UiContext()
    here.library.search = "silver"
    new = add_material_of(state, here, 0, "silver")
    assert "silver" in new.transfer.materials and here.library.search == ""
    assert here.requests[0].startswith("say Added silver: materials are the channels now")
    here.library.search = "gould"
    assert add_material_of(state, here, 0, "gould") is state
    # What was typed stays, to be mended.
    assert "gold" in here.library.complaint and here.library.search == "gould"
    assert len(here.requests) == 1


def test_a_colour_that_is_not_made_yet_is_waited_for(
    state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:

    class Unmade:
        spectra = None

    def unmade(*_: object) -> Unmade:
        return Unmade()

    from volspec.viewer.ui import transfer_library as library

    monkeypatch.setattr(library.css_colours, "colours", unmade)
    here = UiContext()
    assert library.add_material_of(state, here, 0, "tomato") is state
    assert here.library.search == "tomato"
    assert here.library.complaint == "Colours are being made ready …"
    assert here.requests == ["say Colours are being made ready …"]


def report(
    wanted: Cell | None = None, error: float | None = None, inside: bool = True
) -> CellReport:
    colour, XYZ = (0.5, 0.4, 0.3), (20.0, 18.0, 10.0)
    kind = wanted.kind if wanted else "colour"
    weight = wanted.weight if wanted else 1.0
    return CellReport("gold", "A", kind, weight, colour, colour, XYZ, error, error, inside)


def test_a_cell_says_what_is_wanted_and_how_far_it_is() -> None:
    assert "Nothing is wanted here" in cell_lines(report(), None)
    for cell, words in (
        (Cell(colour=(1, 0, 0)), "a colour is wanted"),
        (Cell(colour=(1, 0, 0), weight=STAY), "is to stay, as far as it can"),
        (Cell("free", group="metals"), "one colour with all of “metals”"),
        (Cell("black"), "is to reflect nothing"),
        (Cell("same", other=("tin", "D65")), "the colour of tin under D65"),
        (Cell("distinct", other=("tin", "D65"), distance=20), "ΔE 20 or more from tin under D65"),
    ):
        assert cell_lines(report(cell, 0.2), cell).splitlines()[1] == words
    target = Cell(colour=(1, 0, 0))
    assert cell_lines(report(target, 0.4), target).endswith("ΔE 0.4, reached")
    assert "ΔE 7.0: cannot be told apart below 1" in cell_lines(report(target, 7.0), target)
    assert cell_lines(report(target, 0.4, inside=False), target).endswith(
        "! is outside the display"
    )


def test_the_palette_sums_up_what_is_missed_and_what_drifts(state: ViewState) -> None:
    from volspec.viewer.ui.palette_panel import summary

    def of(*errors: tuple[float, float]) -> Table:
        cells = {
            (f"{i}", "A"): report(Cell(colour=(1, 0, 0), weight=weight), error)
            for i, (weight, error) in enumerate(errors)
        }
        return Table((), ("A",), {}, cells)

    assert summary(table_of(state)) == "Click a cell to wish for a colour"
    assert summary(of((1.0, 0.3), (STAY, 0.2))) == "All met, ΔE ≤ 0.3"
    assert summary(of((1.0, 0.3), (STAY, 6.0))) == "All met, ΔE ≤ 0.3, others drift by 6"
    assert summary(of((1.0, 0.3), (4.0, 6.0))) == "1 of 2 missed: ΔE up to 6.0"


def test_the_error_map_says_whether_an_eye_would_see_it() -> None:
    whole = np.ones((2, 2), np.float32)
    assert error_map_lines(None, "") == ["Error map: working …"]
    assert error_map_lines(None, "no memory") == ["no memory"]
    assert error_map_lines(ErrorMap(0.5 * whole, whole), "")[-1].endswith("nothing here is seen")
    far = error_map_lines(ErrorMap(3 * whole, whole), "")
    assert far == ["ΔE00, componentwise against the exact light matrix", far[1]]
    assert far[1].startswith("mean 3")


def test_the_adopted_white_is_told_of_what_shines_alone(state: ViewState) -> None:
    muted = lights.toggle_mute(state, 0)
    assert white_text(muted.lights) == white_text(())
    both = lights.set_weight(state, 1, 1.0)
    assert white_text(both.lights) != white_text(state.lights)
