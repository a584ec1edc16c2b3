"""The palette's logic without a window: wishes, what they cost, designs, wizards, files."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from volspec.basis import MaterialBasis
from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, design, load_palette
from volspec.pipeline import raycast
from volspec.relight import LightRig, relight
from volspec.spectra import light, reflectance
from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    Region,
    TransferFunction,
    TransferFunction2D,
)
from volspec.viewer.actions import BY_NAME
from volspec.viewer.document import Document
from volspec.viewer.events import EVENTS, Event, reduced
from volspec.viewer.history import History
from volspec.viewer.palette import files, wizards
from volspec.viewer.palette.ranges import assigned, ranges
from volspec.viewer.palette.service import advice_of
from volspec.viewer.palette.spectra import columns, with_reflectances
from volspec.viewer.palette.table import answered, palette_of, table_of
from volspec.viewer.palette.wishes import LIGHT, REFLECTANCE, STAY, Board, Pick, Wishes
from volspec.viewer.palette.worker import DesignDone, DesignJob, DesignWorker
from volspec.viewer.panels.palette.cells import contrast, explained, importance, levels
from volspec.viewer.panels.palette.panel import summary
from volspec.viewer.stale import stale_stage
from volspec.viewer.state import ViewState

PALETTES = Path(__file__).resolve().parents[2] / "data" / "palettes"
# ΔE00 that side by side is just seen: what a reached wish stays below.
SEEN = 1.0


def wished(state: ViewState, place: int, colour: str = "#8c5a3c") -> ViewState:
    return reduced(state, Event("wish", index=place, key=colour))


def designed(state: ViewState) -> ViewState:
    return answered(state, design(palette_of(state)), state.board.wishes)


def undressed(state: ViewState) -> ViewState:
    """With its materials as channels, and no wishes."""
    exact = wished(state, 0)
    return replace(exact, board=Board())


def answers(*asked: ViewState) -> list[DesignDone]:
    """What comes of wishes that follow each other at once, up to the last one's design."""
    worker = DesignWorker(lambda: None)
    for each in asked:
        worker.request(DesignJob(palette_of(each), each.board.wishes))
    done: list[DesignDone] = []
    end = time.time() + 20
    while time.time() < end and not any(
        each.whole and each.job.wishes is asked[-1].board.wishes for each in done
    ):
        done += worker.take()
        time.sleep(0.005)
    worker.close()
    return done


def test_cells_stand_row_by_row_and_are_found_again(state: ViewState) -> None:
    table = table_of(state)
    assert table.rows == ("copper", "gold") and table.columns[:2] == ("D65", "A")
    assert table.place(5) == ("gold", "A") and table.index(("gold", "A")) == 5
    assert table.place(8) is None and table.place(-1) is None


def test_lights_of_one_name_are_columns_of_their_own(state: ViewState) -> None:
    twice = (*state.lights, state.lights[0])
    assert columns(twice)[-1] == "D65 (2)" and len(set(columns(twice))) == len(twice)


def test_the_table_shows_what_the_picture_shows(state: ViewState, document: Document) -> None:
    """An opaque, flatly lit material fills a pixel with its cell's colour, to 8 bits."""
    shown = undressed(state)
    one = replace(document.transfer, points=[(0.0, 1.0, "gold")], basis=shown.transfer.basis)
    camera = shown.view.camera(document.volume)
    flat = replace(shown.shading, ambient=1.0, diffuse=0.0, specular=0.0)
    image = raycast(document.volume, one, camera, (8, 8), flat)
    rig = LightRig((light("A"),))
    viewing = shown.seen.viewing
    code = relight(image, rig, viewing, backend="numpy")[4, 4]
    cell = table_of(shown).cells["gold", "A"]
    np.testing.assert_allclose(code / 255.0, np.clip(cell.obtained, 0, 1), atol=1.01 / 255.0)


def test_a_first_wish_casts_once_and_all_that_follows_relights(state: ViewState) -> None:
    first = wished(state, 5)
    assert isinstance(first.transfer.basis, MaterialBasis)
    assert stale_stage(state, first) == "cast"
    assert stale_stage(first, designed(first)) == "relight"
    assert stale_stage(first, wished(first, 5, "#102030")) == "relight"


def test_other_spectra_relight_and_everything_else_of_a_transfer_casts(state: ViewState) -> None:
    shown = undressed(state)
    curve = shown.transfer
    assert isinstance(curve, TransferFunction)

    def stage(transfer: TransferFunction) -> str | None:
        return stale_stage(shown, replace(shown, transfer=transfer))

    silver = {"gold": reflectance("silver")}
    repainted = with_reflectances(curve, silver)
    assert isinstance(repainted, TransferFunction)
    assert repainted.materials["gold"] is silver["gold"]
    assert stage(repainted) == "relight"
    assert stage(assigned(repainted, 0.3, 0.4, "gold")) == "cast"
    assert stage(replace(repainted, reference_step_mm=0.7)) == "cast"
    assert stage(replace(curve, basis=state.transfer.basis)) == "cast"
    # In a fitted basis reflectances are baked into the cast.
    fitted = with_reflectances(state.transfer, silver)
    assert stale_stage(state, replace(state, transfer=fitted)) == "cast"


def test_repainted_coefficients_are_those_of_a_new_cast(
    state: ViewState, document: Document
) -> None:
    shown = undressed(state)
    other = with_reflectances(shown.transfer, {"gold": reflectance("silver")})
    camera = shown.view.camera(document.volume)
    before = raycast(document.volume, shown.transfer, camera, (24, 18))
    after = raycast(document.volume, other, camera, (24, 18))
    kept = replace(before, basis=other.basis)
    rig = LightRig((light("A"),))
    old, new = (relight(image, rig, backend="numpy") for image in (kept, after))
    np.testing.assert_array_equal(old, new)
    assert np.abs(new.astype(int) - relight(before, rig, backend="numpy")).max() > 5


def test_a_wish_opens_its_material_and_asks_the_other_colours_to_stay(state: ViewState) -> None:
    wishes = wished(state, 5).board.wishes
    assert wishes.open == {(REFLECTANCE, "gold")}
    assert wishes.cells["gold", "A"].weight == 1.0
    others = [cell for at, cell in wishes.cells.items() if at != ("gold", "A")]
    assert len(others) == 3 and all(cell.weight == STAY for cell in others)
    # One more in the same row opens nothing else.
    assert wished(wished(state, 5), 6).board.wishes.open == wishes.open


def test_a_wish_that_can_be_met_is_met(state: ViewState) -> None:
    made = designed(wished(state, 5))
    table = table_of(made)
    assert max(table.errors) < SEEN
    assert "All met" in summary(table)
    values = made.transfer.materials["gold"].values
    assert values.min() >= 0.0 and values.max() <= 1.0
    assert made.transfer.materials["copper"] is state.transfer.materials["copper"]


def test_a_wish_that_cannot_be_met_is_flagged(state: ViewState) -> None:
    """No reflectance is saturated blue under tungsten light and saturated red under daylight."""
    asked = wished(wished(state, 5, "#0000ff"), 4, "#ff0000")
    table = table_of(designed(asked))
    assert max(table.errors) > 5 and "2 of 2 missed" in summary(table)
    cell, wish = table.cells["gold", "A"], asked.board.wishes.cells["gold", "A"]
    assert "cannot be told apart" in explained(cell, wish)


def test_five_colours_that_merge_to_three_and_one_are_designed(state: ViewState) -> None:
    """Figure 2's wishes, of a scene with as many materials and no such lights."""
    names = ("a", "b", "c", "d", "e")
    grey = {name: reflectance("ColorChecker/neutral 5 (.70 D)") for name in names}
    transfer = TransferFunction([(0.2, 0.0, "a"), (0.5, 0.2, "b")], grey, MaterialBasis(grey))
    empty = replace(state, transfer=transfer, lights=state.lights[:1])
    palette = load_palette(PALETTES / "figure-2.toml")
    begun = files.with_palette(empty, palette)
    assert columns(begun.lights) == ("D65", "split 1", "split 2")
    assert begun.board.waits and begun.board.anew
    found = answers(begun)[-1].made
    assert found is not None
    made = answered(begun, found, begun.board.wishes)
    table = table_of(made)
    assert not made.board.waits
    assert len(table.errors) == 15 and max(table.errors) < SEEN
    assert len({summary(table), summary(table_of(begun))}) == 2
    assert all(row.rig.lights[0].values.min() >= 0 for row in made.lights)
    assert stale_stage(begun, made) == "relight"


def test_kinds_of_wishes_keep_their_weight_and_their_partner(state: ViewState) -> None:
    asked = reduced(wished(state, 5), Event("wish-weight", 3.0, index=5))

    def kind(name: str, other: float = -1.0) -> Cell | None:
        event = Event("wish-kind", other, index=5, key=name)
        return reduced(asked, event).board.wishes.cells.get(("gold", "A"))

    assert kind("free") == Cell("free", group="one colour", weight=3.0)
    assert kind("black") == Cell("black", weight=3.0)
    assert kind("same") == Cell("same", other=("copper", "A"), weight=3.0)
    assert kind("distinct", 0.0) == Cell(
        "distinct", other=("copper", "D65"), weight=3.0, distance=20
    )
    assert kind("") is None
    must = reduced(asked, Event("wish-weight", 1.0, index=5, key="must"))
    assert math.isinf(must.board.wishes.cells["gold", "A"].weight)


def test_a_constant_material_is_wanted_of_one_colour(state: ViewState) -> None:
    steady = reduced(state, Event("constant", index=1))
    wishes = steady.board.wishes
    assert wishes.constant == {"gold"} and {at[1] for at in wishes.cells} == {"D65"}
    assert next(row for row in palette_of(steady).reflectances if row.name == "gold").constant


def test_a_light_of_real_lamps_is_a_sum_of_them(state: ViewState) -> None:
    asked = reduced(wished(state, 6), Event("lamp", index=2, key="A"))
    asked = reduced(asked, Event("lamp", index=2, key="D65"))
    assert asked.board.wishes.lamps == {"FL2": ("A", "D65")}
    made = designed(asked)
    values = made.lights[2].rig.lights[0].values
    lamps = np.stack([light(name).values for name in ("A", "D65")], axis=1)
    shares, *_ = np.linalg.lstsq(lamps, values, rcond=None)
    # What the solver leaves beside the two lamps is rounding.
    np.testing.assert_allclose(lamps @ shares, values, atol=1e-6 * values.max())
    assert shares.min() > -1e-6


def test_undo_takes_a_wish_and_its_spectra_back_together(state: ViewState) -> None:
    history = History(state).then(wished(state, 5), 1)
    history = history.then(wished(history.present, 5, "#123456"), 1)
    history = history.amended(designed(history.present))
    assert len(history.past) == 1
    back = history.undone().present
    assert back.transfer is state.transfer and back.board == state.board
    assert history.undone().redone().present.transfer is history.present.transfer
    assert len(history.step(state).past) == 2


def test_materials_of_values_are_cut_out_of_the_curve(state: ViewState) -> None:
    curve = state.transfer
    assert isinstance(curve, TransferFunction)
    assert [(r.low, r.high, r.material) for r in ranges(curve)] == [
        (0.2, 0.5, "copper"),
        (0.9, 0.9, "gold"),
    ]
    made = assigned(curve, 0.3, 0.4, "gold")
    found = [(r.low, r.high, r.material) for r in ranges(made)]
    assert found == [
        *((0.2, 0.3, "copper"), (0.3, 0.4, "gold"), (0.4, 0.5, "copper"), (0.9, 0.9, "gold"))
    ]
    at = np.linspace(0.2, 0.9, 71)
    old, new = (
        np.interp(at, [p[0] for p in each.points], [p[1] for p in each.points])
        for each in (curve, made)
    )
    np.testing.assert_allclose(old, new, atol=1e-12)
    assert assigned(made, 0.3, 0.4, "gold").points == made.points
    assert assigned(curve, 0.4, 0.3, "gold") is curve
    assert assigned(curve, 0.3, 0.4, "tin") is curve


@pytest.fixture(scope="module")
def hidden(state: ViewState) -> ViewState:
    pick = Pick(place=("gold", "A"))
    asked = replace(state, interface=replace(state.interface, pick=pick))
    return wizards.applied(asked, wizards.asked(asked, "hide"))


def test_a_wizard_hides_a_material_and_leaves_its_wishes_in_the_table(hidden: ViewState) -> None:
    table = table_of(hidden)
    cell = table.cells["gold", "A"]
    assert cell.kind == "same" and cell.error is not None and cell.error < SEEN
    assert hidden.board.wishes.open == {(REFLECTANCE, "gold")} and not hidden.board.waits
    # What else was asked for can be asked for again, from here.
    again = wished(hidden, 4, "#c0a060")
    assert again.board.waits and palette_of(again).cells["gold", "A"].kind == "same"


def test_a_wizard_s_light_is_a_row_that_shines(state: ViewState) -> None:
    pick = Pick(place=("gold", "A"), like="D65")
    asked = replace(state, interface=replace(state.interface, pick=pick))
    made = wizards.applied(asked, wizards.asked(asked, "hide"))
    assert columns(made.lights)[-1] == "new 1" and made.lights[-1].weight == 1.0
    assert (LIGHT, "new 1") in made.board.wishes.open
    assert stale_stage(undressed(state), replace(made, board=Board())) == "relight"


def test_any_kind_of_transfer_function_is_a_scene_to_wizards(state: ViewState) -> None:
    metals, basis = state.transfer.materials, state.transfer.basis
    region = Region((0.3, 0.6), (0.0, 1.0), 0.5, "gold")
    for transfer in (
        state.transfer,
        TransferFunction2D([region], metals, basis),
        LabelFunction({1: (0.5, "gold"), 2: (0.2, {"copper": 0.5})}, metals, basis),
        Isosurfaces([(0.3, 0.5, "copper"), (0.6, 1.0, "gold")], metals, basis),
    ):
        scene = wizards.scene_of(replace(state, transfer=transfer))
        assert list(scene.materials) == ["copper", "gold"]
        assert type(scene.transfer) is type(transfer)
        assert [each.name for each in scene.lights] == list(columns(state.lights))
        assert scene.relight.viewing == state.seen.viewing


def test_filters_keep_their_basis_and_no_wizard_touches_them(state: ViewState) -> None:
    assert isinstance(state.transfer, TransferFunction)
    glass = replace(state.transfer, filters={"gold": reflectance("gold")})
    asked = wished(replace(state, transfer=glass), 5)
    assert asked.transfer is glass and asked.board.waits
    assert stale_stage(asked, designed(asked)) == "cast"
    with pytest.raises(PaletteError, match="filter"):
        wizards.asked(asked, "hide")


def test_a_wizard_that_refuses_says_why(state: ViewState) -> None:
    pick = Pick(place=("gold", "A"), distance=99.0)
    asked = replace(state, interface=replace(state.interface, pick=pick))
    with pytest.raises(PaletteError, match="comes no further than"):
        wizards.asked(asked, "reveal")


def test_a_palette_is_written_and_loaded_as_it_was(hidden: ViewState, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    files.saved(hidden, str(file))
    again = files.with_palette(hidden, load_palette(file))
    assert not again.board.waits
    assert again.board.wishes.cells == hidden.board.wishes.cells
    assert again.board.wishes.open == hidden.board.wishes.open
    # Six decimals are written.
    for name, spectrum in hidden.transfer.materials.items():
        np.testing.assert_allclose(
            again.transfer.materials[name].values, spectrum.values, atol=1e-6
        )


def test_the_latest_wish_wins_and_is_answered_quickly_then_well(state: ViewState) -> None:
    first, last = wished(state, 5), wished(state, 5, "#906050")
    done = answers(first, last)
    assert [each.whole for each in done if each.job.wishes is last.board.wishes] == [False, True]
    assert not any(each.whole for each in done if each.job.wishes is first.board.wishes)
    made = done[-1].made
    assert made is not None
    assert max(table_of(answered(last, made, last.board.wishes)).errors) < SEEN


def test_what_contradicts_itself_is_refused_in_words(state: ViewState) -> None:
    asked = state
    for index, colour in ((4, "#ff0000"), (5, "#0000ff")):
        asked = wished(asked, index, colour)
        asked = reduced(asked, Event("wish-weight", 1.0, index=index, key="must"))
    done = answers(asked)
    assert done[0].made is None and done[0].whole and "gold" in done[0].error


def test_advice_is_about_wishes_alone() -> None:
    wishes = Wishes({("a", "D65"): Cell(colour=(0, 0, 0), weight=STAY)})
    advice = ("(a, D65): weight 1 …", "(a, A): weight 4 …", "rounds 12 …")
    assert advice_of(advice, wishes) == advice[1:]


def test_a_hunt_s_eye_is_no_end_of_the_table(state: ViewState) -> None:
    """Models without an inverse in closed form cannot be designed with; the table says so."""
    viewing = replace(state.seen.viewing, model="Hunt", adapting="given")
    table = table_of(replace(state, seen=replace(state.seen, viewing=viewing)))
    assert "no inverse in closed form" in table.complaint and not table.cells


def test_marks_are_read_on_any_colour() -> None:
    assert contrast((1.0, 1.0, 0.9)) == (0.0, 0.0, 0.0)
    assert contrast((0.1, 0.1, 0.4)) == (1.0, 1.0, 1.0)
    sizes = [importance(Cell("black", weight=w)) for w in (STAY, 1.0, 4.0, math.inf)]
    assert sizes == sorted(sizes) and sizes[-1] < 0.7
    assert max(levels(light("A"), True)) == 1.0


_NAMES = sorted(name for name in EVENTS if name not in ("orbit", "pan", "zoom", "wheel"))
_KEYS = (
    *("", "colour", "free", "black", "same", "distinct", "must", "light", "reflectance"),
    *("#804020", "0.1 0.9 2.0", "0.2 0.3 0.4", "nan nan nan", "A", "nosuch", "gold", "RGB"),
)
_EVENTS = st.builds(
    Event,
    st.sampled_from(_NAMES),
    st.floats(-2, 30) | st.floats(-1e6, 1e6),
    st.floats(-2, 2),
    st.integers(-2, 9),
    st.sampled_from(_KEYS),
)
_CHANGES = [BY_NAME[n] for n in ("palette-light", "palette-anew", "palette-forget", "palette-own")]


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(events=st.lists(_EVENTS, min_size=60, max_size=60), every=st.integers(0, 3))
def test_any_wishes_make_a_palette_or_say_why_not(
    state: ViewState, events: list[Event], every: int
) -> None:
    for number, event in enumerate(events):
        state = reduced(state, event)
        if number % 20 == every:
            change = _CHANGES[every].change
            assert change is not None
            state = change(state)
    assert isinstance(state.board.wishes.criteria, Criteria)
    assert table_of(state).columns == columns(state.lights)
    try:
        palette = palette_of(state)
    except PaletteError as error:
        assert str(error)
    else:
        assert palette.names[1] == columns(state.lights)
