"""Transfer functions as they are edited: every kind, window and level, thickness, mixes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.viewer._edits import drawn
from volspec.spectra import reflectance
from volspec.transfer import (
    Isosurfaces,
    LabelFunction,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.viewer.model import materials, transfer_edits
from volspec.viewer.model.commands import COMMANDS
from volspec.viewer.model.edit import Change, after
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_parts import parts_of

KINDS = ("points", "regions", "surfaces", "labels")


def of_kind(state: ViewState, kind: str) -> ViewState:
    """The state of a scene with a transfer function of a kind."""
    materials, basis = state.transfer.materials, state.transfer.basis
    made: dict[str, Callable[[], Transfer]] = {
        "points": lambda: state.transfer,
        "regions": lambda: TransferFunction2D(
            [
                Region((0.2, 0.5), (0.0, math.inf), 0.1, "copper"),
                Region((0.5, 1.0), (0.02, 0.1), 0.5, "gold"),
            ],
            materials,
            basis,
        ),
        "surfaces": lambda: Isosurfaces(
            [(0.3, 0.2, "copper"), (0.8, 1.0, "gold")], materials, basis
        ),
        "labels": lambda: LabelFunction({1: (0.2, "copper"), 7: (1.0, "gold")}, materials, basis),
    }
    document = replace(state.document, transfer=made[kind]())
    return replace(state, document=document, transfer=document.transfer)


_EDITS = drawn(("copper", "gold", "soft", "no such"), transfer_edits, materials)
_COMMANDS = st.sampled_from([each.change for each in COMMANDS if each.menu == "Transfer"])


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(edits=st.lists(_EDITS | _EDITS | _EDITS | _COMMANDS, min_size=40, max_size=40))
def test_random_edits_keep_parts_in_order_and_near_the_volume(
    state: ViewState, kind: str, edits: list[Change]
) -> None:
    state = of_kind(state, kind)
    for edit in edits:
        state = after(edit, state).state
        if kind == "labels":
            assert isinstance(state.transfer, LabelFunction)
            continue
        parts = parts_of(state.transfer)
        assert all(0 <= part.opacity <= 1 for part in parts)
        values = [value for part in parts for value in part.values]
        # A range beyond either end, and where a region reaches beyond that.
        assert min(values) >= -1.3 and max(values) <= 2.3
        if not isinstance(state.transfer, TransferFunction2D):
            assert all(a <= b for a, b in itertools.pairwise(values))


def values_of(state: ViewState) -> list[float]:
    return [value for part in parts_of(state.transfer) for value in part.values]


@pytest.mark.parametrize("kind", ["points", "regions", "surfaces"])
def test_a_drag_across_shifts_and_one_upwards_spreads_about_the_middle(
    state: ViewState, kind: str
) -> None:
    state = of_kind(state, kind)
    old = np.array(values_of(state))
    # A quarter of the picture's height is a quarter of the volume's range.
    across = transfer_edits.window(state, 0.25, 0.0)
    low, high = state.document.volume.range
    np.testing.assert_allclose(values_of(across), old + 0.25 * (high - low), atol=1e-12)
    assert across.shift == pytest.approx(0.25 * (high - low))
    up = transfer_edits.window(state, 0.0, -0.1)
    middle = (old.min() + old.max()) / 2
    np.testing.assert_allclose(values_of(up), middle + math.exp(0.2) * (old - middle), atol=1e-12)
    back = transfer_edits.shift(transfer_edits.window(up, 0.0, 0.1), 0.0)
    np.testing.assert_allclose(values_of(back), old, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_thickening_is_as_of_denser_matter_and_undone_by_its_slider(
    state: ViewState, kind: str
) -> None:
    """Exactly: opacities that were rounded to 1 and such as were 1 come back too."""
    state = of_kind(state, kind)
    old = np.array([part.opacity for part in parts_of(state.transfer)])
    thin = transfer_edits.thicken(state, 0.1)
    opacities = [part.opacity for part in parts_of(thin.transfer)]
    # What is wholly opaque lets something through.
    np.testing.assert_allclose(opacities, 1 - (1 - old.clip(0, 0.999)) ** 0.1, atol=1e-12)
    for thickness in (50.0, 0.02, 7.0):
        thin = transfer_edits.thicken(thin, thickness)
    assert transfer_edits.thicken(thin, 1.0).transfer is state.transfer
    dragged = transfer_edits.thicken_by(state, 0.0, -0.1)
    assert dragged.thickness == pytest.approx(math.exp(0.3))
    back = transfer_edits.thicken_by(transfer_edits.thicken_by(dragged, 0.0, 0.4), 0.0, -0.3)
    assert back.transfer is state.transfer


def test_thickening_is_undone_of_what_was_shifted_and_goes_on_from_what_was_edited(
    state: ViewState,
) -> None:
    old = [part.opacity for part in parts_of(state.transfer)]
    thick = transfer_edits.thicken(state, 50.0)
    moved = transfer_edits.window(transfer_edits.shift(thick, 0.1), 0.0, 0.1)
    back = transfer_edits.thicken(moved, 1.0)
    assert [part.opacity for part in parts_of(back.transfer)] == old
    assert values_of(back) == values_of(moved) != values_of(state)
    edited = transfer_edits.set_opacity(thick, 1, 0.3)
    same = transfer_edits.thicken(transfer_edits.thicken(edited, 2.0), 50.0)
    # Through a power and back: float64's last digits.
    np.testing.assert_allclose(opacities_of(same), opacities_of(edited), rtol=1e-12)


def opacities_of(state: ViewState) -> list[float]:
    return [part.opacity for part in parts_of(state.transfer)]


@pytest.mark.parametrize("kind", KINDS)
def test_what_was_left_alone_at_fifty_fold_thickness_is_what_it_was_at_one(
    state: ViewState, kind: str
) -> None:
    """Opacities that fifty-fold thickness rounds to 1 were all .129 after any edit there."""
    state = of_kind(state, kind)
    thick = transfer_edits.thicken(state, 50.0)
    edited = transfer_edits.set_opacity(thick, 0, 0.3)
    edited = transfer_edits.set_material(edited, 1, "gold")
    edited = transfer_edits.set_opacity(edited, 0, 0.4)
    back = opacities_of(transfer_edits.thicken(edited, 1.0))
    assert back[1:] == opacities_of(state)[1:]
    assert back[0] == pytest.approx(1 - 0.6 ** (1 / 50))


def test_points_added_and_removed_at_fifty_fold_thickness_leave_the_others(
    state: ViewState,
) -> None:
    old = opacities_of(state)
    thick = transfer_edits.thicken(state, 50.0)
    added = transfer_edits.add_point(thick, 0.7, 0.5)
    assert len(opacities_of(added)) == len(old) + 1
    back = opacities_of(transfer_edits.thicken(added, 1.0))
    assert [opacity for opacity in back if opacity in old] == old
    removed = transfer_edits.remove_point(thick, 1)
    assert opacities_of(transfer_edits.thicken(removed, 1.0)) == [old[0], *old[2:]]


def test_a_drag_in_the_picture_is_one_step_of_undo(state: ViewState) -> None:
    history = History(state)
    for _ in range(5):
        history = history.then(transfer_edits.window(history.present, 0.01, 0.01), 7)
    assert len(history.past) == 1
    assert history.undone().present.transfer is state.transfer


def test_edits_of_points_keep_what_gradients_do_to_opacity(state: ViewState) -> None:
    assert isinstance(state.transfer, TransferFunction)
    factors = ((0.0, 0.0), (0.3, 1.0))
    state = replace(state, transfer=replace(state.transfer, gradient_opacity=factors))
    for edit, *arguments in (
        (transfer_edits.move_point, 1, 0.4, 0.4),
        (transfer_edits.add_point, 0.7, 0.1),
        (transfer_edits.window, 0.1, 0.1),
        (transfer_edits.thicken, 2.0),
        (transfer_edits.set_material, 0, "gold"),
        (transfer_edits.set_material_weight, 1, "gold", 0.4),
        (transfer_edits.remove_point, 1),
    ):
        state = edit(state, *arguments)
        assert isinstance(state.transfer, TransferFunction)
        assert state.transfer.gradient_opacity == factors, edit.__name__


def test_a_share_makes_the_others_room_and_their_proportions_come_back(state: ViewState) -> None:
    gold = {"gold": 0.5, "copper": 0.3, "steel": 0.2}
    materials = {name: reflectance(name) for name in gold}
    function = replace(
        state.transfer, points=[(0.0, 0.1, gold), (1.0, 0.2, "gold")], materials=materials
    )
    given, set_weight = replace(state, transfer=function), transfer_edits.set_material_weight
    more = parts_of(set_weight(given, 0, "gold", 0.75).transfer)
    assert more[0].mix == pytest.approx({"gold": 0.75, "copper": 0.15, "steel": 0.1})
    all_gold = set_weight(given, 0, "gold", 1.0)
    back = set_weight(all_gold, 0, "gold", 0.5)
    assert parts_of(back.transfer)[0].mix == pytest.approx(gold)
    # What one material alone left would be black.
    assert set_weight(given, 1, "gold", 0.5) is given


def test_a_region_follows_its_sides_and_has_no_end_above_the_axis(state: ViewState) -> None:
    state, top = of_kind(state, "regions"), state.document.joint.top
    moved = transfer_edits.set_region_values(state, 0, 0.6, 0.3)
    moved = transfer_edits.set_region_gradients(moved, 0, 0.1 * top, 0.5 * top)
    assert isinstance(moved.transfer, TransferFunction2D)
    region = moved.transfer.regions[0]
    assert region.values == (0.3, 0.6) and region.gradients == (0.1 * top, 0.5 * top)
    open_above = transfer_edits.set_region_gradients(moved, 0, 0.1 * top, top)
    assert isinstance(open_above.transfer, TransferFunction2D)
    assert open_above.transfer.regions[0].gradients == (0.1 * top, math.inf)
    added = transfer_edits.add_point(state, 0.5, 0.5 * top)
    assert len(parts_of(added.transfer)) == 3 and added.interface.part == 2


@pytest.mark.parametrize("kind", ["points", "surfaces"])
def test_a_point_without_room_keeps_its_value_and_takes_an_opacity(
    state: ViewState, kind: str
) -> None:
    rows = [(0.0, 0.1, "copper"), (0.5, 0.1, "copper"), (0.5005, 0.2, "gold"), (0.501, 0.3, "gold")]
    materials, basis = state.transfer.materials, state.transfer.basis
    transfer: Transfer = Isosurfaces(rows, materials, basis)
    if kind == "points":
        transfer = TransferFunction(rows, materials, basis)
    close = replace(state, transfer=transfer)
    for x in (0.5005, 0.2, 0.9):
        moved = transfer_edits.move_point(close, 2, x, 0.7)
        assert values_of(moved) == [0.0, 0.5, 0.5005, 0.501]
        assert [p.opacity for p in parts_of(moved.transfer)] == [0.1, 0.1, 0.7, 0.3]
    # Nearer than a gap to one neighbour only: it stays where just its opacity is dragged.
    lifted = transfer_edits.move_point(close, 3, 0.501, 0.7)
    assert values_of(lifted) == values_of(close)
