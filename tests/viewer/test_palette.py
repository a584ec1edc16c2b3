"""The palette's table without a window: cells, targets and what they cost, materials of values."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.viewer._edits import MODULES, drawn
from volspec.basis import MaterialBasis
from volspec.errors import PaletteError
from volspec.palette import Cell, Criteria, design
from volspec.pipeline import raycast
from volspec.raycast import Ambient, LightGroup
from volspec.relight import LightRig, relight
from volspec.spectra import light, reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model import camera, palette_edits
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.document import Document
from volspec.viewer.model.edit import Change, after
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import LightRow
from volspec.viewer.model.materials import with_reflectances
from volspec.viewer.model.palette_table import (
    column_names,
    material_ranges,
    palette_of,
    table_of,
    with_design,
    with_material_range,
)
from volspec.viewer.model.palette_targets import REFLECTANCE, STAY, PaletteState
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.palette_cells import column_note, contrast, importance, levels

# ΔE00 that side by side is just seen: what a reached target stays below.
SEEN = 1.0


def wished(state: ViewState, place: int, colour: str = "#8c5a3c") -> ViewState:
    return palette_edits.set_target(state, place, colour)


def designed(state: ViewState) -> ViewState:
    return with_design(state, design(palette_of(state)), state.palette.targets)


def undressed(state: ViewState) -> ViewState:
    """With its materials as channels, and no targets."""
    exact = wished(state, 0)
    return replace(exact, palette=PaletteState())


def test_cells_stand_row_by_row_and_are_found_again(state: ViewState) -> None:
    table = table_of(state)
    assert table.rows == ("copper", "gold") and table.columns[:2] == ("D65", "A")
    assert table.place(5) == ("gold", "A") and table.index(("gold", "A")) == 5
    assert table.place(8) is None and table.place(-1) is None


def test_lights_of_one_name_are_columns_of_their_own(state: ViewState) -> None:
    twice = (*state.lights, state.lights[0])
    assert column_names(twice)[-1] == "D65 (2)" and len(set(column_names(twice))) == len(twice)


def test_the_table_shows_what_the_picture_shows(state: ViewState, document: Document) -> None:
    """An opaque, flatly lit material fills a pixel with its cell's colour, to 8 bits."""
    shown = undressed(state)
    one = replace(document.transfer, points=[(0.0, 1.0, "gold")], basis=shown.transfer.basis)
    camera = shown.view.camera(document.volume)
    flat = replace(shown.shading, ambient=1.0, diffuse=0.0, specular=0.0)
    image = raycast(document.volume, one, camera, (8, 8), flat)
    rig = LightRig((light("A"),))
    viewing = shown.relight.viewing
    code = relight(image, rig, viewing, backend="numpy")[4, 4]
    cell = table_of(shown).cells["gold", "A"]
    np.testing.assert_allclose(code / 255.0, np.clip(cell.obtained, 0, 1), atol=1.01 / 255.0)


def test_a_column_of_two_groups_shows_what_is_out_of_every_shadow(
    state: ViewState, document: Document
) -> None:
    """As a pixel that sky and room light by 0.3 and 0.7, to 8 bits."""
    groups = (LightGroup("sky", Ambient(0.3)), LightGroup("room", Ambient(0.7)))
    shown = undressed(state)
    rig = LightRig((light("A"), light("daylight:7500")), groups=("room", "sky"))
    row = LightRow("evening", "", rig, texts=("A", None))
    shading = replace(shown.shading, groups=groups, ambient=1.0)
    shown = replace(shown, lights=(*shown.lights, row), shading=shading)
    one = replace(document.transfer, points=[(0.0, 1.0, "gold")], basis=shown.transfer.basis)
    image = raycast(document.volume, one, shown.view.camera(document.volume), (8, 8), shading)
    code = relight(image, rig, shown.relight.viewing, backend="numpy")[4, 4]
    cell = table_of(shown).cells["gold", "evening"]
    np.testing.assert_allclose(code / 255.0, np.clip(cell.obtained, 0, 1), atol=1.01 / 255.0)


def test_a_column_says_which_groups_its_light_is_from(state: ViewState) -> None:
    pair, groups = (light("A"), light("D65")), ("room", "sky")
    both = column_note(LightRow("x", "", LightRig(pair, groups=groups), texts=("A", None)))
    assert both.startswith("A from room + drawn by hand from sky\n") and "together" in both
    mix = column_note(LightRow("x", "", LightRig(pair, (1.0, 0.0)), texts=("A", "D65")))
    assert mix.startswith("A\n")
    assert column_note(LightRow("x", "", LightRig(pair[:1], groups=("sky",)))) == "From sky alone"
    assert column_note(state.lights[0]) == ""


def test_a_first_wish_casts_once_and_all_that_follows_relights(state: ViewState) -> None:
    first = wished(state, 5)
    assert isinstance(first.transfer.basis, MaterialBasis)
    assert Difference.between(state, first).stage == "cast"
    assert Difference.between(first, designed(first)).stage == "relight"
    assert Difference.between(first, wished(first, 5, "#102030")).stage == "relight"


def test_other_spectra_relight_and_everything_else_of_a_transfer_casts(state: ViewState) -> None:
    shown = undressed(state)
    curve = shown.transfer
    assert isinstance(curve, TransferFunction)

    def stage(transfer: TransferFunction) -> str | None:
        return Difference.between(shown, replace(shown, transfer=transfer)).stage

    silver = {"gold": reflectance("silver")}
    repainted = with_reflectances(curve, silver)
    assert isinstance(repainted, TransferFunction)
    assert repainted.materials["gold"] is silver["gold"]
    assert stage(repainted) == "relight"
    assert stage(with_material_range(repainted, 0.3, 0.4, "gold")) == "cast"
    assert stage(replace(repainted, reference_step_mm=0.7)) == "cast"
    assert stage(replace(curve, basis=state.transfer.basis)) == "cast"
    # In a fitted basis reflectances are baked into the cast.
    fitted = with_reflectances(state.transfer, silver)
    assert Difference.between(state, replace(state, transfer=fitted)).stage == "cast"


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
    targets = wished(state, 5).palette.targets
    assert targets.open == {(REFLECTANCE, "gold")}
    assert targets.cells["gold", "A"].weight == 1.0
    others = [cell for at, cell in targets.cells.items() if at != ("gold", "A")]
    assert len(others) == 3 and all(cell.weight == STAY for cell in others)
    # One more in the same row opens nothing else.
    assert wished(wished(state, 5), 6).palette.targets.open == targets.open


def test_kinds_of_wishes_keep_their_weight_and_their_partner(state: ViewState) -> None:
    asked = palette_edits.set_target_weight(wished(state, 5), 5, 3.0)

    def kind(name: str, other: int = -1) -> Cell | None:
        new = palette_edits.set_target_kind(asked, 5, name, other)
        return new.palette.targets.cells.get(("gold", "A"))

    assert kind("free") == Cell("free", group="one colour", weight=3.0)
    assert kind("black") == Cell("black", weight=3.0)
    assert kind("same") == Cell("same", other=("copper", "A"), weight=3.0)
    assert kind("distinct", 0) == Cell("distinct", other=("copper", "D65"), weight=3.0, distance=20)
    assert kind("") is None
    must = palette_edits.set_target_weight(asked, 5, None)
    assert math.isinf(must.palette.targets.cells["gold", "A"].weight)


def test_a_constant_material_is_wanted_of_one_colour(state: ViewState) -> None:
    steady = palette_edits.toggle_constant(state, 1)
    targets = steady.palette.targets
    assert targets.constant == {"gold"} and {at[1] for at in targets.cells} == {"D65"}
    assert next(row for row in palette_of(steady).reflectances if row.name == "gold").constant


def test_undo_takes_a_wish_and_its_spectra_back_together(state: ViewState) -> None:
    history = History(state).then(wished(state, 5), 1)
    history = history.then(wished(history.present, 5, "#123456"), 1)
    history = history.amended(designed(history.present))
    assert len(history.past) == 1
    back = history.undone().present
    assert back.transfer is state.transfer and back.palette == state.palette
    assert history.undone().redone().present.transfer is history.present.transfer
    assert len(history.step(state).past) == 2


def test_materials_of_values_are_cut_out_of_the_curve(state: ViewState) -> None:
    curve = state.transfer
    assert isinstance(curve, TransferFunction)
    assert [(r.low, r.high, r.material) for r in material_ranges(curve)] == [
        (0.2, 0.5, "copper"),
        (0.9, 0.9, "gold"),
    ]
    made = with_material_range(curve, 0.3, 0.4, "gold")
    found = [(r.low, r.high, r.material) for r in material_ranges(made)]
    assert found == [
        *((0.2, 0.3, "copper"), (0.3, 0.4, "gold"), (0.4, 0.5, "copper"), (0.9, 0.9, "gold"))
    ]
    at = np.linspace(0.2, 0.9, 71)
    old, new = (
        np.interp(at, [p[0] for p in each.points], [p[1] for p in each.points])
        for each in (curve, made)
    )
    np.testing.assert_allclose(old, new, atol=1e-12)
    assert with_material_range(made, 0.3, 0.4, "gold").points == made.points
    assert with_material_range(curve, 0.4, 0.3, "gold") is curve
    assert with_material_range(curve, 0.3, 0.4, "tin") is curve


def test_a_hunt_s_eye_is_no_end_of_the_table(state: ViewState) -> None:
    """Models without an inverse in closed form cannot be designed with; the table says so."""
    viewing = replace(state.relight.viewing, model="Hunt", adapting="given")
    table = table_of(replace(state, relight=replace(state.relight, viewing=viewing)))
    assert "no inverse in closed form" in table.complaint and not table.cells


def test_marks_are_read_on_any_colour() -> None:
    assert contrast((1.0, 1.0, 0.9)) == (0.0, 0.0, 0.0)
    assert contrast((0.1, 0.1, 0.4)) == (1.0, 1.0, 1.0)
    sizes = [importance(Cell("black", weight=w)) for w in (STAY, 1.0, 4.0, math.inf)]
    assert sizes == sorted(sizes) and sizes[-1] < 0.7
    assert max(levels(light("A"), True)) == 1.0


_KEYS = (
    *("", "colour", "free", "black", "same", "distinct", "must", "light", "reflectance"),
    *("#804020", "0.1 0.9 2.0", "0.2 0.3 0.4", "nan nan nan", "A", "nosuch", "gold", "RGB"),
)
_EDITED = [module for module in MODULES if module is not camera]
_CHANGES = [BY_NAME[n] for n in ("palette-light", "palette-anew", "palette-forget", "palette-own")]


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(edits=st.lists(drawn(_KEYS, *_EDITED), min_size=60, max_size=60), every=st.integers(0, 3))
def test_any_wishes_make_a_palette_or_say_why_not(
    state: ViewState, edits: list[Change], every: int
) -> None:
    for number, edit in enumerate(edits):
        state = after(edit, state).state
        if number % 20 == every:
            change = _CHANGES[every].change
            assert change is not None
            state = after(change, state).state
    assert isinstance(state.palette.targets.criteria, Criteria)
    assert table_of(state).columns == column_names(state.lights)
    try:
        palette = palette_of(state)
    except PaletteError as error:
        assert str(error)
    else:
        assert palette.names[1] == column_names(state.lights)
