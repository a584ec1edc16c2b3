"""The palette's table without a window: cells, targets, materials of values, wizards, files."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.errors import raises
from tests.support.viewer import (
    KINDS,
    VISIBLE,
    curve_of,
    of_kind,
    run_command,
    with_designed,
    with_target,
)
from tests.viewer._edits import MODULES, drawn
from tests.viewer._states import relit, seen, under
from volspec.basis import MaterialBasis
from volspec.errors import PaletteError
from volspec.palette import Apart, Cell, Palette, PaletteSpectrum, load_palette, save_palette
from volspec.pipeline import raycast
from volspec.raycast import Ambient, LightGroup
from volspec.relight import LightRig, relight
from volspec.spectra import light, reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model import camera, palette_edits, palette_results
from volspec.viewer.model.edit import after, with_interface
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import MAX_ROWS, LightRow
from volspec.viewer.model.materials import with_reflectances
from volspec.viewer.model.palette_table import (
    colour_table,
    column_names,
    material_ranges,
    palette_from_state,
    with_material_range,
)
from volspec.viewer.model.palette_targets import LIGHT, REFLECTANCE, STAY, PaletteState, Pick
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.palette_cells import contrast, importance, levels


def undressed(state: ViewState) -> ViewState:
    """The state with its materials as channels, and no targets."""
    return replace(with_target(state, 0), palette=PaletteState())


def test_cells_stand_row_by_row_and_are_found_again(state):
    table = colour_table(state)
    assert table.rows == ("copper", "gold") and table.columns[:2] == ("D65", "A")
    assert table.place(5) == ("gold", "A") and table.index(("gold", "A")) == 5
    assert table.place(8) is None and table.place(-1) is None
    twice = column_names((*state.lights, state.lights[0]))
    assert len(set(twice)) == len(twice) == 5 and twice[-1].startswith("D65")


def assert_pixel_is_cell(shown: ViewState, rig: LightRig, column: str) -> None:
    """An opaque, flatly lit material fills a pixel with its cell's colour, to 8 bits."""
    volume, basis = shown.document.volume, shown.transfer.basis
    one = replace(shown.document.transfer, points=[(0.0, 1.0, "gold")], basis=basis)
    image = raycast(volume, one, shown.view.camera(volume), (8, 8), shown.shading)
    code = relight(image, rig, shown.relight.viewing, backend="numpy")[4, 4]
    cell = colour_table(shown).cells["gold", column]
    np.testing.assert_allclose(code / 255.0, np.clip(cell.obtained, 0, 1), atol=1.01 / 255.0)


@pytest.mark.not_quick
def test_the_table_shows_what_the_picture_shows(state):
    shown = undressed(state)
    flat = replace(shown.shading, ambient=1.0, diffuse=0.0, specular=0.0)
    assert_pixel_is_cell(replace(shown, shading=flat), LightRig((light("A"),)), "A")


@pytest.mark.slow
def test_a_column_of_two_groups_shows_what_is_out_of_every_shadow(state):
    """Pixel lit by sky and room with 0.3 and 0.7."""
    groups = (LightGroup("sky", Ambient(0.3)), LightGroup("room", Ambient(0.7)))
    rig = LightRig((light("A"), light("daylight:7500")), groups=("room", "sky"))
    row = LightRow("evening", "", rig, texts=("A", None))
    shown = undressed(state)
    shading = replace(shown.shading, groups=groups, ambient=1.0)
    shown = replace(shown, lights=(*shown.lights, row), shading=shading)
    assert_pixel_is_cell(shown, rig, "evening")


def test_other_spectra_relight_and_everything_else_of_a_transfer_casts(state):
    shown = undressed(state)
    curve = shown.transfer

    def stage(transfer: TransferFunction) -> str | None:
        return Difference.between(shown, replace(shown, transfer=transfer)).stage

    silver = {"gold": reflectance("silver")}
    repainted = with_reflectances(curve, silver)
    assert repainted.materials["gold"] is silver["gold"]
    assert stage(repainted) == "relight"
    assert stage(with_material_range(repainted, 0.3, 0.4, "gold")) == "cast"
    assert stage(replace(repainted, reference_step_mm=0.7)) == "cast"
    assert stage(replace(curve, basis=state.transfer.basis)) == "cast"
    # In a fitted basis reflectances are baked into the cast.
    fitted = with_reflectances(state.transfer, silver)
    assert Difference.between(state, replace(state, transfer=fitted)).stage == "cast"


@pytest.mark.not_quick
def test_repainted_coefficients_are_those_of_a_new_cast(state):
    shown, volume = undressed(state), state.document.volume
    other = with_reflectances(shown.transfer, {"gold": reflectance("silver")})
    before, after = (
        raycast(volume, transfer, shown.view.camera(volume), (24, 18))
        for transfer in (shown.transfer, other)
    )
    lit = under(state, 1)
    new = relit(after, lit)
    np.testing.assert_array_equal(relit(replace(before, basis=other.basis), lit), new)
    assert np.abs(new - relit(before, lit)).max() > 5


def test_a_wish_opens_its_material_and_asks_the_other_colours_to_stay(state):
    targets = with_target(state, 5).palette.targets
    assert targets.free == {(REFLECTANCE, "gold")}
    assert targets.cells["gold", "A"].weight == 1.0
    others = [cell for at, cell in targets.cells.items() if at != ("gold", "A")]
    assert len(others) == 3 and all(cell.weight == STAY for cell in others)
    # One more in the same row opens nothing else.
    assert with_target(with_target(state, 5), 6).palette.targets.free == targets.free
    # The first casts once, all that follows relights.
    first = with_target(state, 5)
    assert isinstance(first.transfer.basis, MaterialBasis)
    assert Difference.between(state, first).stage == "cast"
    assert Difference.between(first, with_designed(first)).stage == "relight"
    assert Difference.between(first, with_target(first, 5, "#102030")).stage == "relight"


def test_kinds_of_wishes_keep_their_weight_and_their_partner(state):
    asked = palette_edits.set_target_weight(with_target(state, 5), 5, 3.0)

    def kind(name: str, other: int = -1) -> Cell | None:
        new = palette_edits.set_target_kind(asked, 5, name, other)
        return new.palette.targets.cells.get(("gold", "A"))

    free = kind("free")
    assert free.group and free == Cell("free", group=free.group, weight=3.0)
    assert kind("black") == Cell("black", weight=3.0)
    assert kind("same") == Cell("same", other=("copper", "A"), weight=3.0)
    assert kind("distinct", 0) == Cell("distinct", other=("copper", "D65"), weight=3.0, distance=20)
    assert kind("") is None
    must = palette_edits.set_target_weight(asked, 5, None)
    assert math.isinf(must.palette.targets.cells["gold", "A"].weight)


def test_a_constant_material_is_wanted_of_one_colour(state):
    steady = palette_edits.toggle_constant(state, 1)
    targets = steady.palette.targets
    assert targets.constant == {"gold"} and {at[1] for at in targets.cells} == {"D65"}
    assert [r.name for r in palette_from_state(steady).reflectances if r.constant] == ["gold"]


def test_undo_takes_a_wish_and_its_spectra_back_together(state):
    history = History(state).then(with_target(state, 5), 1)
    history = history.then(with_target(history.present, 5, "#123456"), 1)
    history = history.amend(with_designed(history.present))
    assert len(history.past) == 1 and len(history.step(state).past) == 2
    back = history.undo()
    assert back.present.transfer is state.transfer and back.present.palette == state.palette
    assert back.redo().present.transfer is history.present.transfer


def test_materials_of_values_are_cut_out_of_the_curve(state):
    curve = state.transfer
    made = with_material_range(curve, 0.3, 0.4, "gold")
    before, after = (
        [(r.low, r.high, r.material) for r in material_ranges(each)] for each in (curve, made)
    )
    assert before == [(0.2, 0.5, "copper"), (last := (0.9, 0.9, "gold"))]
    assert after == [(0.2, 0.3, "copper"), (0.3, 0.4, "gold"), (0.4, 0.5, "copper"), last]
    at = np.linspace(0.2, 0.9, 71)
    old, new = (
        np.interp(at, [p[0] for p in each.points], [p[1] for p in each.points])
        for each in (curve, made)
    )
    np.testing.assert_allclose(old, new, atol=1e-12)
    assert with_material_range(made, 0.3, 0.4, "gold").points == made.points
    assert with_material_range(curve, 0.4, 0.3, "gold") is curve
    assert with_material_range(curve, 0.3, 0.4, "tin") is curve


def test_a_hunt_s_eye_is_no_end_of_the_table(state):
    """Models without an inverse in closed form cannot be designed with."""
    table = colour_table(seen(state, model="Hunt", adapting="given"))
    assert "Hunt" in table.complaint and not table.cells


def test_marks_are_read_on_any_colour():
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
_COMMANDS = ("palette-light", "palette-restart", "palette-forget", "palette-own")


@pytest.mark.not_quick
@settings(max_examples=12, suppress_health_check=list(HealthCheck))
@given(edits=st.lists(drawn(_KEYS, *_EDITED), min_size=60, max_size=60), every=st.integers(0, 3))
def test_edits_make_a_palette_or_fail(state, edits, every):
    for number, edit in enumerate(edits):
        state = after(edit, state).state
        if number % 20 == every:
            state = run_command(state, _COMMANDS[every]).state
    assert colour_table(state).columns == column_names(state.lights)
    try:
        palette = palette_from_state(state)
    except PaletteError as error:
        assert str(error)
    else:
        assert palette.names[1] == column_names(state.lights)


@pytest.fixture(scope="module")
def hidden(state: ViewState) -> ViewState:
    asked = with_pick(state)
    return palette_results.with_wizard_result(asked, palette_results.run_wizard(asked, "hide"))


def test_a_wizard_hides_a_material_and_leaves_its_wishes_in_the_table(hidden):
    cell = colour_table(hidden).cells["gold", "A"]
    assert cell.kind == "same" and cell.error < VISIBLE
    assert hidden.palette.targets.free == {(REFLECTANCE, "gold")} and not hidden.palette.is_pending
    # What else was asked for can be asked for again, from here.
    again = with_target(hidden, 4, "#c0a060")
    assert again.palette.is_pending and palette_from_state(again).cells["gold", "A"].kind == "same"


@pytest.mark.not_quick
def test_a_wizard_s_light_is_a_row_that_shines(state):
    asked = with_pick(state, like="D65")
    made = palette_results.with_wizard_result(asked, palette_results.run_wizard(asked, "hide"))
    assert column_names(made.lights)[-1] == "new 1" and made.lights[-1].weight == 1.0
    assert (LIGHT, "new 1") in made.palette.targets.free
    plain = replace(made, palette=PaletteState())
    assert Difference.between(undressed(state), plain).stage == "relight"


def test_filters_keep_their_basis(state):
    glass = with_filter(state)
    asked = with_target(glass, 5)
    assert asked.transfer is glass.transfer and asked.palette.is_pending
    assert Difference.between(asked, with_designed(asked)).stage == "cast"


def with_pick(state: ViewState, **fields: Any) -> ViewState:
    return with_interface(state, pick=Pick(place=("gold", "A"), **fields))


def with_filter(state: ViewState) -> ViewState:
    return replace(state, transfer=replace(curve_of(state), filters={"gold": reflectance("gold")}))


def palette_of_many_lights() -> Palette:
    """Return a palette with more lights than there is room for."""
    path = Path(__file__).resolve().parents[2] / "data" / "palettes" / "figure-2.toml"
    many = (PaletteSpectrum(f"lamp {n}", light("A")) for n in range(MAX_ROWS))
    return replace(palette := load_palette(path), lights=(*palette.lights, *many))


_RUN = palette_results.run_wizard


@pytest.mark.not_quick
@pytest.mark.parametrize(
    ("code", "call"),
    [
        ("unsupported", lambda s: _RUN(with_filter(with_pick(s)), "hide")),
        ("impossible", lambda s: _RUN(with_pick(s, distance=99.0), "reveal")),
        ("size", lambda s: palette_results.with_palette(s, palette_of_many_lights())),
    ],
)
def test_what_a_palette_cannot_is_refused(state, code, call):
    with raises(PaletteError, code):
        call(state)


def test_a_palette_is_written_and_loaded_as_it_was(hidden, tmp_path):
    file = tmp_path / "mine.toml"
    save_palette(palette_from_state(hidden), file)
    again = palette_results.with_palette(hidden, load_palette(file))
    assert not again.palette.is_pending
    assert again.palette.targets.cells == hidden.palette.targets.cells
    assert again.palette.targets.free == hidden.palette.targets.free
    for name, spectrum in hidden.transfer.materials.items():  # six decimals are written
        values = again.transfer.materials[name].values
        np.testing.assert_allclose(values, spectrum.values, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS)
def test_any_kind_of_transfer_function_is_a_scene_to_wizards(state, kind):
    state = of_kind(state, kind)
    scene = palette_results.wizard_scene(state)
    assert list(scene.materials) == ["copper", "gold"]
    assert type(scene.transfer) is type(state.transfer)
    assert [each.name for each in scene.lights] == list(column_names(state.lights))
    assert scene.relight.viewing == state.relight.viewing


def test_materials_to_be_told_apart_are_kept_in_palette_files(state, tmp_path):
    row = Apart(light=("D65", "A"), deficiency=("none", "deutan"), distance=30.0)
    begun = with_target(seen(state, deficiency="deutan", severity=0.5), 0)
    begun = replace(begun, palette=PaletteState(replace(begun.palette.targets, apart=(row,))))
    save_palette(palette_from_state(begun), tmp_path / "palette.toml")
    palette = load_palette(tmp_path / "palette.toml")
    own = replace(row, reflectance=("copper", "gold"))
    assert palette.apart == (own,) and palette.viewing.deficiency == "none"
    loaded = palette_results.with_palette(state, palette)
    assert loaded.palette.targets.apart == (own,)
    assert loaded.relight.viewing.deficiency == state.relight.viewing.deficiency
    kept = palette_results.with_palette(begun, palette).relight.viewing
    assert (kept.deficiency, kept.severity) == ("deutan", 0.5)
    (pair,) = colour_table(loaded).apart
    assert pair.reflectances == ("copper", "gold") and pair.lights == ("D65", "A")
    renamed = loaded.palette.targets.with_light_renamed("A", "lamp")
    assert renamed.apart == (replace(own, light=("D65", "lamp")),)
    # Lights that have been removed are left out, and a row without any.
    assert colour_table(replace(loaded, lights=loaded.lights[:1])).apart[0].lights == ("D65",)
    assert colour_table(replace(loaded, lights=loaded.lights[2:])).apart == ()
