"""Transfer functions: edits of every kind, conversions, opacity by gradient, presets."""

import gc
import math
import weakref
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.viewer import KINDS, curve_of, of_kind, run_command
from tests.viewer._edits import drawn
from volspec.pipeline import raycast
from volspec.spectra import Spectrum, reflectance
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
from volspec.viewer.model.document import field_data
from volspec.viewer.model.edit import after
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_convert import convert, transfer_kind
from volspec.viewer.model.transfer_parts import MAX_PARTS, list_parts
from volspec.viewer.ui import transfer_editors
from volspec.volume import Volume, phantom

_EDITS = drawn(("copper", "gold", "soft", "no such"), transfer_edits, materials)
_SPAN = (0.0, 1.0)
_COMMANDS = st.sampled_from([each.change for each in COMMANDS if each.menu == "Transfer"])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=20, suppress_health_check=list(HealthCheck))
@given(edits=st.lists(_EDITS | _EDITS | _EDITS | _COMMANDS, min_size=25, max_size=40))
def test_random_edits_keep_parts_in_order(state, kind, edits):
    state = of_kind(state, kind)
    for edit in edits:
        state = after(edit, state).state
        if isinstance(state.transfer, LabelFunction):  # of numbers, not values
            continue
        parts = list_parts(state.transfer)
        assert all(0 <= part.opacity <= 1 for part in parts)
        values = [value for part in parts for value in part.values]
        # A range beyond either end, and where a region reaches beyond that.
        assert min(values) >= -1.3 and max(values) <= 2.3
        if not isinstance(state.transfer, TransferFunction2D):
            assert all(a <= b for a, b in pairwise(values))


def values_of(state: ViewState) -> list[float]:
    return [value for part in list_parts(state.transfer) for value in part.values]


def opacities_of(state: ViewState) -> list[float]:
    return [part.opacity for part in list_parts(state.transfer)]


@pytest.mark.parametrize("kind", ["points", "regions", "surfaces"])
def test_a_drag_across_shifts_and_one_upwards_spreads(state, kind):
    state = of_kind(state, kind)
    old = np.array(values_of(state))
    # A quarter of the picture's height is a quarter of the volume's range.
    across = transfer_edits.window(state, 0.25, 0.0)
    by = 0.25 * np.ptp(state.document.volume.range)
    np.testing.assert_allclose(values_of(across), old + by, atol=1e-12)
    assert across.shift == pytest.approx(by)
    up = transfer_edits.window(state, 0.0, -0.1)
    middle = (old.min() + old.max()) / 2
    np.testing.assert_allclose(values_of(up), middle + math.exp(0.2) * (old - middle), atol=1e-12)
    back = transfer_edits.shift(transfer_edits.window(up, 0.0, 0.1), 0.0)
    np.testing.assert_allclose(values_of(back), old, atol=1e-12)


def test_contrast_limits_move_the_ends_and_what_is_between(state):
    old = np.array(values_of(state))
    ends = np.interp([0.1, 0.6], [0, 1], state.document.volume.range).tolist()
    new = np.array(values_of(transfer_edits.set_limits(state, *ends)))
    assert [new.min(), new.max()] == pytest.approx(ends)
    np.testing.assert_allclose(
        (old - old.min()) / np.ptp(old), (new - new.min()) / np.ptp(new), atol=1e-12
    )
    assert transfer_edits.set_limits(state, ends[1], ends[0]) is state


@pytest.mark.parametrize("kind", KINDS)
def test_thickening_is_as_of_denser_matter_and_undone(state, kind):
    """Exactly: opacities that were rounded to 1 and such as were 1 come back too."""
    state = of_kind(state, kind)
    thin = transfer_edits.thicken(state, 0.1)
    # What is wholly opaque lets something through.
    left = 1 - np.array(opacities_of(state)).clip(0, 0.999)
    np.testing.assert_allclose(opacities_of(thin), 1 - left**0.1, atol=1e-12)
    for thickness in (50.0, 0.02, 7.0):
        thin = transfer_edits.thicken(thin, thickness)
    assert transfer_edits.thicken(thin, 1.0).transfer is state.transfer
    dragged = transfer_edits.thicken_by(state, 0.0, -0.1)
    assert dragged.thickness == pytest.approx(math.exp(0.3))
    back = transfer_edits.thicken_by(transfer_edits.thicken_by(dragged, 0.0, 0.4), 0.0, -0.3)
    assert back.transfer is state.transfer


def test_thickening_is_undone_of_shifted_and_edited_values(state):
    thick = transfer_edits.thicken(state, 50.0)
    moved = transfer_edits.window(transfer_edits.shift(thick, 0.1), 0.0, 0.1)
    back = transfer_edits.thicken(moved, 1.0)
    assert opacities_of(back) == opacities_of(state)
    assert values_of(back) == values_of(moved) != values_of(state)
    edited = transfer_edits.set_opacity(thick, 1, 0.3)
    same = transfer_edits.thicken(transfer_edits.thicken(edited, 2.0), 50.0)
    # Through a power and back: float64's last digits.
    np.testing.assert_allclose(opacities_of(same), opacities_of(edited), rtol=1e-12)


def test_menus_tick_the_preset_in_use_until_it_is_changed(state):
    def ticked(state: ViewState) -> list[str]:
        rows = (each for each in COMMANDS if each.name.startswith("preset-"))
        return [each.name for each in rows if each.on is not None and each.on(state)]

    bone = run_command(state, "preset-bone").state
    assert ticked(state) == [] and ticked(bone) == ["preset-bone"]
    assert ticked(transfer_edits.set_opacity(bone, 1, 0.3)) == []


@pytest.mark.parametrize("kind", KINDS)
def test_parts_left_alone_at_fifty_fold_thickness_come_back(state, kind):
    """Opacities that fifty-fold thickness rounds to 1 were all .129 after any edit there."""
    state = of_kind(state, kind)
    edited = transfer_edits.set_opacity(transfer_edits.thicken(state, 50.0), 0, 0.3)
    edited = transfer_edits.set_material(edited, 1, "gold")
    edited = transfer_edits.set_opacity(edited, 0, 0.4)
    back = opacities_of(transfer_edits.thicken(edited, 1.0))
    assert back[1:] == opacities_of(state)[1:]
    assert back[0] == pytest.approx(1 - 0.6 ** (1 / 50))


def test_points_added_and_removed_when_thick_leave_the_others(state):
    old = opacities_of(state)
    thick = transfer_edits.thicken(state, 50.0)
    added = transfer_edits.add_point(thick, 0.7, 0.5)
    assert len(opacities_of(added)) == len(old) + 1
    back = opacities_of(transfer_edits.thicken(added, 1.0))
    assert [opacity for opacity in back if opacity in old] == old
    removed = transfer_edits.remove_point(thick, 1)
    assert opacities_of(transfer_edits.thicken(removed, 1.0)) == [old[0], *old[2:]]


def test_edits_of_points_keep_what_gradients_do_to_opacity(state):
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
        assert state.transfer.gradient_opacity == factors, edit.__name__


def test_a_share_makes_the_others_room_and_their_proportions_come_back(state):
    gold, set_weight = (
        {"gold": 0.5, "copper": 0.3, "steel": 0.2},
        transfer_edits.set_material_weight,
    )
    points = [(0.0, 0.1, gold), (1.0, 0.2, "gold")]
    materials = {name: reflectance(name) for name in gold}
    given = replace(state, transfer=replace(state.transfer, points=points, materials=materials))
    more = list_parts(set_weight(given, 0, "gold", 0.75).transfer)
    assert more[0].mix == pytest.approx({"gold": 0.75, "copper": 0.15, "steel": 0.1})
    back = set_weight(set_weight(given, 0, "gold", 1.0), 0, "gold", 0.5)
    assert list_parts(back.transfer)[0].mix == pytest.approx(gold)
    # What one material alone left would be black.
    assert set_weight(given, 1, "gold", 0.5) is given


def test_a_region_follows_its_sides_and_has_no_end_above_the_axis(state, top):
    state = of_kind(state, "regions")
    moved = transfer_edits.set_region_values(state, 0, 0.6, 0.3)
    moved = transfer_edits.set_region_gradients(moved, 0, 0.1 * top, 0.5 * top)
    region = moved.transfer.regions[0]
    assert region.values == (0.3, 0.6) and region.gradients == (0.1 * top, 0.5 * top)
    open_above = transfer_edits.set_region_gradients(moved, 0, 0.1 * top, top)
    assert open_above.transfer.regions[0].gradients == (0.1 * top, math.inf)
    added = transfer_edits.add_point(state, 0.5, 0.5 * top)
    assert len(list_parts(added.transfer)) == 3 and added.interface.part == 2


def test_labels_are_added_and_removed_by_number(state):
    state = of_kind(state, "labels")
    added = transfer_edits.add_point(state, 3.2, 0.5)
    assert values_of(added) == [1, 7, 3] and added.interface.part == 2
    assert list_parts(added.transfer)[2].mix == {"gold": 1.0}
    assert transfer_edits.add_point(added, 7.0, 0.5) is added
    assert values_of(transfer_edits.remove_point(added, 0)) == [7, 3]
    assert transfer_edits.move_point(added, 0, 0.1, 0.1) is added


@pytest.mark.parametrize("kind", ["points", "surfaces"])
def test_a_point_without_room_takes_only_an_opacity(state, kind):
    rows = [(0.0, 0.1, "copper"), (0.5, 0.1, "copper"), (0.5005, 0.2, "gold"), (0.501, 0.3, "gold")]
    made = TransferFunction if kind == "points" else Isosurfaces
    close = replace(state, transfer=made(rows, state.transfer.materials, state.transfer.basis))
    for x in (0.5005, 0.2, 0.9):
        moved = transfer_edits.move_point(close, 2, x, 0.7)
        assert values_of(moved) == [0.0, 0.5, 0.5005, 0.501]
        assert opacities_of(moved) == [0.1, 0.1, 0.7, 0.3]
    # Nearer than a gap to one neighbour only: it stays where just its opacity is dragged.
    assert values_of(transfer_edits.move_point(close, 3, 0.501, 0.7)) == values_of(close)


def opacities_at(transfer: Transfer, values: np.ndarray) -> np.ndarray:
    """Return a curve's opacities at values, or those of regions where nothing changes."""
    table = transfer.bake(1.0)
    opacities = table.opacity[0] if table.opacity.ndim > 1 else table.opacity
    return np.interp(values, np.linspace(*table.domain, len(opacities)), opacities)


def test_a_curve_becomes_regions_that_look_alike(state):
    """Opacity of regions over all gradients against the curve's, over the volume's values.

    Slopes become soft sides, which rise along another curve: a tenth on average (measured 0.03).
    """
    points = [(0.1, 0, "copper"), (0.2, 0.3, "copper"), (0.5, 0.3, "copper"), (0.6, 0, "copper")]
    points += [(0.7, 0, "gold"), (0.75, 0.8, "gold"), (0.9, 0.8, "gold")]
    function = replace(state.transfer, points=points)
    regions = convert(function, "regions", _SPAN)
    assert [list(part.mix) for part in list_parts(regions)] == [["copper"], ["gold"]]
    at = np.linspace(0, 1, 201)
    here, there = opacities_at(function, at), opacities_at(regions, at)
    assert np.abs(there - here).mean() < 0.1
    # Beyond its last point a curve goes on: the greatest value is no soft side.
    assert there[-1] == pytest.approx(0.8, abs=0.02)
    assert np.abs(opacities_at(convert(regions, "points", _SPAN), at) - here).mean() < 0.1


def test_hard_sides_and_boundaries_stay_in_another_kind(state):
    regions = of_kind(state, "regions").transfer
    hard = replace(regions, regions=[replace(regions.regions[0], softness=0.0)])
    curve = replace(state, transfer=convert(hard, "points", _SPAN))
    # From 0.2 to 0.5; sides as steep as points can be distinguished on the screen.
    np.testing.assert_allclose(values_of(curve), [0.2, 0.2, 0.5, 0.5], atol=1e-3 + 1e-9)
    np.testing.assert_allclose(opacities_of(curve), [0, 0.1, 0.1, 0], atol=1e-12)
    # Boundaries of a curve stay boundaries as regions.
    function = replace(state.transfer, gradient_opacity=((0.0, 0.0), (0.4, 1.0)))
    regions = convert(function, "regions", _SPAN)
    assert {region.gradients for region in regions.regions} == {(0.2, math.inf)}


def test_kinds_change_by_name_as_one_step(state):
    for kind in ("regions", "surfaces", "points"):
        history = History(state).then(run_command(state, f"transfer-{kind}").state, 1)
        assert transfer_kind(history.present.transfer) == kind
        assert history.undo().present.transfer is state.transfer
        state = history.present
    # The ball's values are not whole numbers.
    new, message, _ = run_command(state, "transfer-labels")
    assert new is state and message


def test_a_curve_of_more_bands_than_it_has_points_for_shows_all_of_them(state):
    """Every second corner was left out, and with them whole bands."""
    materials, basis = state.transfer.materials, state.transfer.basis
    regions = [
        Region((low + 0.005, high - 0.005), (0.0, math.inf), 0.1 + 0.03 * i, "gold", 0.3)
        for i, (low, high) in enumerate(pairwise(np.linspace(0.0, 1.0, 25)))
    ]
    curve = convert(TransferFunction2D(regions, materials, basis), "points", _SPAN)
    values, opacities = np.array([point[:2] for point in curve.points]).T
    assert len(values) == MAX_PARTS[TransferFunction]
    for region in regions:
        inside = (values > region.values[0]) & (values < region.values[1])
        assert opacities[inside].max() == pytest.approx(region.opacity)
    # Of more than there is room for, what shows least goes.
    bands = [Region((e, e + 0.01), (0, math.inf), 0.5, "gold") for e in np.linspace(0, 0.9, 40)]
    wide = Region((0.95, 1.0), (0, math.inf), 0.9, "copper")
    surfaces = convert(TransferFunction2D([*bands, wide], materials, basis), "surfaces", _SPAN)
    assert surfaces.surfaces[-1][2] == {"copper": 1.0}


def factors_of(state: ViewState) -> list[tuple[float, float]]:
    return list(curve_of(state).gradient_opacity or ())


@pytest.fixture
def on(state: ViewState) -> ViewState:
    """The state with opacity by gradient."""
    return transfer_edits.toggle_gradient_opacity(state)


@pytest.fixture
def top(state: ViewState) -> float:
    """The greatest gradient of the joint histogram."""
    return state.document.data[""].joint.top


def test_opacity_by_gradient_hides_what_is_flat_and_is_one_step_of_undo(state, on):
    table = curve_of(on).bake(1.0)
    assert table.opacity[0].max() == 0.0 and table.opacity[-1].max() == pytest.approx(0.6)
    assert factors_of(transfer_edits.toggle_gradient_opacity(on)) == []
    assert History(state).then(on, 1).undo().present.transfer is state.transfer
    # It does not go with filters.
    glass = {"copper": Spectrum([390, 710], [0.2, 0.9])}
    filtered = replace(state, transfer=replace(curve_of(state), filters=glass))
    assert transfer_edits.toggle_gradient_opacity(filtered) is filtered


def test_the_scenes_own_factors_come_back(state):
    own = replace(curve_of(state), gradient_opacity=((0.0, 0.5), (9.0, 1.0)))
    state = replace(state, document=replace(state.document, transfer=own), transfer=own)
    off = transfer_edits.toggle_gradient_opacity(state)
    assert factors_of(off) == []
    assert factors_of(transfer_edits.toggle_gradient_opacity(off)) == [*own.gradient_opacity]


def test_factors_stay_between_their_neighbours_on_the_axis_and_apart(on, top):
    move = transfer_edits.move_gradient_point
    (first, factor), (last, _) = factors_of(move(on, 0, 9 * top, 7.0))
    assert factor == 1.0 and first == pytest.approx(last - top / 128)
    assert factors_of(move(on, 1, 9 * top, -1.0))[1] == (top, 0.0)
    # The last is never at 0, where a table would have no rows.
    low = move(on, 0, -1.0, 0.0)
    assert factors_of(low)[0] == (0.0, 0.0)
    assert factors_of(move(low, 1, -1.0, 0.0))[1][0] > 0
    assert move(on, 2, 0.1, 0.1) is on


def test_factors_are_added_where_there_is_room_and_two_stay(on, top):
    more = transfer_edits.add_gradient_point(on, 0.7 * top, 0.3)
    assert factors_of(more)[2] == (0.7 * top, 0.3)
    assert transfer_edits.add_gradient_point(more, 0.7 * top, 0.9) is more
    assert factors_of(transfer_edits.remove_gradient_point(more, 2)) == factors_of(on)
    for i in range(2 * transfer_edits.MAX_FACTORS):
        more = transfer_edits.add_gradient_point(more, i / 31 * top, 0.5)
    assert len(factors_of(more)) == transfer_edits.MAX_FACTORS
    # As near as they can be, a table has rows for each of them: baking would warn.
    assert all(b - a >= top / 128 for (a, _), (b, _) in pairwise(factors_of(more)))
    curve_of(more).bake(1.0)
    assert transfer_edits.remove_gradient_point(on, 1) is on


@pytest.mark.not_quick
def test_a_preset_shows_the_ball_and_replaces_materials_and_basis(document):
    shifted = transfer_edits.shift(ViewState.first(document, (32, 32)), 0.2)
    new = run_command(shifted, "preset-skin").state
    assert list(new.transfer.materials) == ["skin"] and new.shift == 0
    assert new.transfer.basis.method == "materials"
    assert new.transfer.basis.grid == document.grid
    image = raycast(document.volume, new.transfer, new.view.camera(document.volume), (32, 32))
    assert image.alpha.max() > 0.9


def test_the_joint_histogram_knows_a_ramps_gradient():
    """0.25 per voxel of 0.5 mm."""
    ramp = np.broadcast_to(0.25 * np.arange(8, dtype=np.float32), (5, 6, 8))
    joint = field_data((Volume(ramp, spacing_mm=(0.5, 1, 1)),))[""].joint
    assert joint.top == pytest.approx(0.5)
    assert joint.counts[:-1].sum() == 0 and joint.counts[-1].sum() > 0
    assert field_data((Volume(np.zeros((2, 2, 2), np.uint8)),))[""].joint.top == 1.0


def test_the_histogram_on_the_screen_keeps_no_closed_volume(document):
    opened = replace(document, volume=Volume(phantom.ball(8).values))
    closed = weakref.ref(opened.volume.values)
    assert transfer_editors.shades(opened.data[""].joint, True).max() == pytest.approx(1.0)
    del opened
    gc.collect()
    assert closed() is None
