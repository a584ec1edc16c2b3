"""The palette's wizards and files: what they are given, what they leave in the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.viewer.test_palette import SEEN, designed, undressed, wished
from volspec.errors import PaletteError
from volspec.palette import load_palette, save_palette
from volspec.spectra import reflectance
from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    Region,
    TransferFunction,
    TransferFunction2D,
)
from volspec.viewer.model import palette_files, palette_wizards
from volspec.viewer.model.history import Difference
from volspec.viewer.model.palette_table import column_names, palette_of, table_of
from volspec.viewer.model.palette_targets import LIGHT, REFLECTANCE, PaletteState, Pick
from volspec.viewer.model.state import ViewState


@pytest.fixture(scope="module")
def hidden(state: ViewState) -> ViewState:
    pick = Pick(place=("gold", "A"))
    asked = replace(state, interface=replace(state.interface, pick=pick))
    return palette_wizards.with_wizard_result(asked, palette_wizards.run_wizard(asked, "hide"))


def test_a_wizard_hides_a_material_and_leaves_its_wishes_in_the_table(hidden: ViewState) -> None:
    table = table_of(hidden)
    cell = table.cells["gold", "A"]
    assert cell.kind == "same" and cell.error is not None and cell.error < SEEN
    assert hidden.palette.targets.open == {(REFLECTANCE, "gold")} and not hidden.palette.is_pending
    # What else was asked for can be asked for again, from here.
    again = wished(hidden, 4, "#c0a060")
    assert again.palette.is_pending and palette_of(again).cells["gold", "A"].kind == "same"


def test_a_wizard_s_light_is_a_row_that_shines(state: ViewState) -> None:
    pick = Pick(place=("gold", "A"), like="D65")
    asked = replace(state, interface=replace(state.interface, pick=pick))
    made = palette_wizards.with_wizard_result(asked, palette_wizards.run_wizard(asked, "hide"))
    assert column_names(made.lights)[-1] == "new 1" and made.lights[-1].weight == 1.0
    assert (LIGHT, "new 1") in made.palette.targets.open
    assert (
        Difference.between(undressed(state), replace(made, palette=PaletteState())).stage
        == "relight"
    )


def test_any_kind_of_transfer_function_is_a_scene_to_wizards(state: ViewState) -> None:
    metals, basis = state.transfer.materials, state.transfer.basis
    region = Region((0.3, 0.6), (0.0, 1.0), 0.5, "gold")
    for transfer in (
        state.transfer,
        TransferFunction2D([region], metals, basis),
        LabelFunction({1: (0.5, "gold"), 2: (0.2, {"copper": 0.5})}, metals, basis),
        Isosurfaces([(0.3, 0.5, "copper"), (0.6, 1.0, "gold")], metals, basis),
    ):
        scene = palette_wizards.scene_of(replace(state, transfer=transfer))
        assert list(scene.materials) == ["copper", "gold"]
        assert type(scene.transfer) is type(transfer)
        assert [each.name for each in scene.lights] == list(column_names(state.lights))
        assert scene.relight.viewing == state.relight.viewing


def test_filters_keep_their_basis_and_no_wizard_touches_them(state: ViewState) -> None:
    assert isinstance(state.transfer, TransferFunction)
    glass = replace(state.transfer, filters={"gold": reflectance("gold")})
    asked = wished(replace(state, transfer=glass), 5)
    assert asked.transfer is glass and asked.palette.is_pending
    assert Difference.between(asked, designed(asked)).stage == "cast"
    with pytest.raises(PaletteError, match="filter"):
        palette_wizards.run_wizard(asked, "hide")


def test_a_wizard_that_refuses_says_why(state: ViewState) -> None:
    pick = Pick(place=("gold", "A"), distance=99.0)
    asked = replace(state, interface=replace(state.interface, pick=pick))
    with pytest.raises(PaletteError, match="comes no further than"):
        palette_wizards.run_wizard(asked, "reveal")


def test_a_palette_is_written_and_loaded_as_it_was(hidden: ViewState, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    save_palette(palette_of(hidden), file)
    again = palette_files.with_palette(hidden, load_palette(file))
    assert not again.palette.is_pending
    assert again.palette.targets.cells == hidden.palette.targets.cells
    assert again.palette.targets.open == hidden.palette.targets.open
    # Six decimals are written.
    for name, spectrum in hidden.transfer.materials.items():
        np.testing.assert_allclose(
            again.transfer.materials[name].values, spectrum.values, atol=1e-6
        )
