"""Materials of a transfer function: adding, removing and saving them."""

from dataclasses import replace

import numpy as np
import pytest

from tests.support.errors import refuses
from tests.support.viewer import (
    KINDS,
    assert_same_picture,
    curve_of,
    of_kind,
    opened,
    picture,
    wait_until,
)
from tests.viewer._states import restored
from volspec.basis import MaterialBasis
from volspec.errors import TransferError
from volspec.spectra import Spectrum, light, reflectance, reflectance_from_colour, reflectance_names
from volspec.spectra.construct.colours import sRGB_from_word
from volspec.viewer.model import materials, transfer_edits
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import list_parts
from volspec.viewer.ui import transfer_detail, transfer_plot
from volspec.viewer.work.css_colours import Colours

BANANA = "PMC/Banana"


def given(state: ViewState, name: str, index: int = 0) -> ViewState:
    return materials.add_material(state, index, name).state


def test_a_material_of_the_library_is_exact_under_any_light(state):
    """A basis that was trained on others need not hold it: materials become the channels."""
    new = given(state, BANANA.lower(), 1)
    assert list_parts(new.transfer)[1].mix == {BANANA: 1.0}
    assert list(new.transfer.materials) == ["copper", "gold", BANANA]
    basis = new.transfer.basis
    lamp, banana = light("HP1"), reflectance(BANANA)
    channels = basis.channels_for_materials({BANANA: banana})[0]
    wanted = MaterialBasis({"one": banana}, grid=basis.grid).xyz([1.0, 0.0], lamp)
    np.testing.assert_allclose(basis.xyz(channels, lamp), wanted, rtol=1e-12)
    assert isinstance(given(new, "white").transfer.basis, MaterialBasis)


def test_what_is_there_is_given_and_another_of_its_name_is_numbered(state):
    gold = given(state, "gold")
    assert list_parts(gold.transfer)[0].mix == {"gold": 1.0}
    assert gold.transfer.basis.fingerprint == state.transfer.basis.fingerprint
    assert materials.material_message(state.transfer, gold.transfer) == ""
    paint = {**state.transfer.materials, "gold": reflectance(BANANA)}
    painted = replace(state, transfer=replace(curve_of(state), materials=paint))
    new = given(given(painted, "gold"), "gold", 1)
    assert [list(part.mix) for part in list_parts(new.transfer)][:2] == [["gold (2)"]] * 2
    assert list(new.transfer.materials) == ["copper", "gold", "gold (2)"]


def test_a_basis_that_filters_need_stays(state):
    glass = {"copper": Spectrum([390, 710], [0.2, 0.9])}
    new = given(replace(state, transfer=replace(curve_of(state), filters=glass)), "silver")
    assert new.transfer.basis.fingerprint == state.transfer.basis.fingerprint
    assert curve_of(new).filters == glass


def test_materials_that_nothing_is_made_of_make_room_for_more(state):
    for i in range(materials.MAX_MATERIALS - 2):
        state = given(state, f"CES/{i + 1}")
    assert len(state.transfer.materials) == materials.MAX_MATERIALS
    new = given(state, "silver")
    # Points 2 and 3 are of copper and gold, the first was of the last that was tried.
    last = f"CES/{materials.MAX_MATERIALS - 2}"
    assert set(new.transfer.materials) == {"copper", "gold", last, "silver"}
    message = materials.material_message(state.transfer, new.transfer)
    gone = set(state.transfer.materials) - {*new.transfer.materials}
    assert [name for name in gone if name not in message] == []
    points = [(float(i), 0.1, f"CES/{i + 1}") for i in range(materials.MAX_MATERIALS - 2)]
    curve = replace(curve_of(state), points=[*points, (98, 0.1, "gold"), (99, 0.1, "copper")])
    full = replace(state, transfer=curve)
    assert given(full, "silver") is full
    assert str(materials.MAX_MATERIALS) in materials.add_material(full, 0, "silver").message


def test_a_material_without_a_part_is_taken_out_in_one_step_of_undo(state):
    tried = given(given(state, "silver"), "copper")
    history = History(tried).then(materials.remove_material(tried, "silver"), 1)
    new = history.present
    assert list(new.transfer.materials) == ["copper", "gold"]
    assert list(new.transfer.basis.materials) == ["copper", "gold"]
    assert list_parts(new.transfer) == list_parts(tried.transfer)
    assert history.undo().present.transfer is tried.transfer
    # A fitted basis is no list of materials: it stays.
    fitted = replace(curve_of(state), materials=tried.transfer.materials)
    without = materials.without_material(fitted, "silver")
    assert without.basis.fingerprint == fitted.basis.fingerprint
    assert materials.remove_material(state, "nosuch") is state


@pytest.mark.parametrize("kind", KINDS)
def test_a_material_that_parts_are_made_of_stays(state, kind):
    state = of_kind(state, kind)
    assert materials.remove_material(state, "gold") is state
    refuses(lambda: materials.without_material(state.transfer, "gold"), "conflict", TransferError)
    free = transfer_edits.set_material(state, len(list_parts(state.transfer)) - 1, "copper")
    assert list(materials.remove_material(free, "gold").transfer.materials) == ["copper"]


def test_shares_of_nothing_and_a_filter_go_with_their_material(state):
    mixed = [(0.0, 0.1, {"copper": 1.0, "gold": 0.0}), (1.0, 0.2, "copper")]
    glass = {name: Spectrum([390, 710], [0.2, 0.9]) for name in ("copper", "gold")}
    new = materials.without_material(replace(curve_of(state), points=mixed, filters=glass), "gold")
    assert [dict(part.mix) for part in list_parts(new)] == [{"copper": 1.0}] * 2
    assert list(new.filters) == list(new.materials) == ["copper"]


def test_a_colour_is_a_material_and_a_metal_comes_before_it(state):
    new = given(state, " #c08040 ", 2)
    assert new.transfer.materials["#c08040"].notes["constructed"] == "delaunay"
    assert list_parts(new.transfer)[2].mix == {"#c08040": 1.0}
    assert given(state, "silver", 9) is state
    metal = given(new, "silver").transfer.materials["silver"]
    np.testing.assert_array_equal(metal.values, reflectance("silver").values)


def test_colours_of_the_web_are_made_in_the_background(state):
    made = Colours(state.transfer.basis.grid, 2)
    wait_until(lambda: made.spectra is not None)
    assert set(made.spectra) == set(materials.colour_names())
    tomato = reflectance_from_colour("tomato")
    np.testing.assert_allclose(made.spectra["tomato"].values, tomato.values, atol=1e-12)


def test_every_name_of_the_list_is_a_reflectance_or_a_colour():
    names = transfer_detail.library_names()
    assert len(set(names)) == len(names)
    measured = set(reflectance_names())
    css = transfer_detail.material_class("steelblue")
    assert {name for name in names if transfer_detail.material_class(name) != css} == measured
    assert "sample" not in {transfer_detail.material_class(name) for name in names}
    for name in set(names) - measured:
        assert sRGB_from_word(name).shape == (3,)
    found = {search: transfer_detail.matching_entries(search) for search in ("banana", "blue css")}
    assert found["banana"][0] == BANANA and "steelblue" in found["blue css"]


@pytest.mark.not_quick
@pytest.mark.slow
@pytest.mark.parametrize("basis", ['name = "general-5"', 'method = "materials"'])
def test_all_files_keep_such_a_material(tmp_path, basis):
    state = replace(given(opened(tmp_path, basis=basis), BANANA, 1), size=(24, 18))
    again = assert_same_picture(state, tmp_path)
    assert list(again.transfer.materials) == ["copper", "grey", BANANA]
    assert again.transfer.basis.fingerprint == state.transfer.basis.fingerprint

    kept, banana = restored(state, tmp_path, cast=False), state.transfer.materials[BANANA].values
    np.testing.assert_array_equal(kept.transfer.materials[BANANA].values, banana)
    np.testing.assert_array_equal(picture(kept), picture(state))


def test_materials_are_shown_as_an_adapted_eye_sees_them(state):
    under_daylight = transfer_plot.material_colours(state)
    assert set(under_daylight) == {"copper", "gold"}
    r, g, b = under_daylight["gold"]
    assert r > g > b
    # Tungsten makes everything orange, an adapted eye takes most of that back.
    lamp = replace(state, lights=(replace(state.lights[1], weight=1.0),))
    assert np.abs(np.subtract(transfer_plot.material_colours(lamp)["gold"], (r, g, b))).max() < 0.1
    dark = replace(state, lights=(replace(state.lights[0], weight=0.0),))
    assert max(transfer_plot.part_colours(dark)[0]) == 0.0
