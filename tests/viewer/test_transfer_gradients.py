"""Opacity by gradient, as it is edited; and what another kind of transfer function leaves out."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest

from volspec.spectra import Spectrum
from volspec.transfer import MAX_SURFACES, Region, TransferFunction, TransferFunction2D
from volspec.viewer.model import transfer_edits
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_convert import conversion_losses, convert
from volspec.viewer.model.transfer_parts import MOST_PARTS, Kind, parts_of

_SPAN = (0.0, 1.0)


def curve_of(state: ViewState) -> TransferFunction:
    assert isinstance(state.transfer, TransferFunction)
    return state.transfer


def factors_of(state: ViewState) -> list[tuple[float, float]]:
    return list(curve_of(state).gradient_opacity or ())


def filtered(state: ViewState) -> TransferFunction:
    glass = Spectrum([390, 710], [0.2, 0.9])
    return replace(curve_of(state), filters={"copper": glass})


def test_opacity_by_gradient_hides_what_is_flat_and_is_one_step_of_undo(state: ViewState) -> None:
    on = transfer_edits.toggle_gradient_opacity(state)
    table = curve_of(on).bake(1.0)
    assert table.opacity[0].max() == 0.0 and table.opacity[-1].max() == pytest.approx(0.6)
    assert curve_of(transfer_edits.toggle_gradient_opacity(on)).gradient_opacity is None
    history = History(state).then(on, 1)
    assert history.undone().present.transfer is state.transfer


def test_the_scenes_own_factors_come_back(state: ViewState) -> None:
    own = replace(curve_of(state), gradient_opacity=((0.0, 0.5), (9.0, 1.0)))
    state = replace(state, document=replace(state.document, transfer=own), transfer=own)
    off = transfer_edits.toggle_gradient_opacity(state)
    assert factors_of(off) == []
    assert factors_of(transfer_edits.toggle_gradient_opacity(off)) == [(0.0, 0.5), (9.0, 1.0)]


def test_filters_and_opacity_by_gradient_do_not_go_together(state: ViewState) -> None:
    state = replace(state, transfer=filtered(state))
    assert transfer_edits.toggle_gradient_opacity(state) is state


def test_factors_stay_between_their_neighbours_on_the_axis_and_apart(state: ViewState) -> None:
    on, top = transfer_edits.toggle_gradient_opacity(state), state.document.joint.top
    over = transfer_edits.move_gradient_point(on, 0, 9 * top, 7.0)
    (first, factor), (last, _) = factors_of(over)
    assert factor == 1.0 and first == pytest.approx(last - top / 128)
    end = transfer_edits.move_gradient_point(on, 1, 9 * top, -1.0)
    assert factors_of(end)[1] == (top, 0.0)
    # The last is never at 0, where a table would have no rows.
    low = transfer_edits.move_gradient_point(
        transfer_edits.move_gradient_point(on, 0, -1.0, 0.0), 0, -1.0, 0.0
    )
    assert factors_of(low)[0] == (0.0, 0.0)
    assert factors_of(transfer_edits.move_gradient_point(low, 1, -1.0, 0.0))[1][0] > 0
    assert transfer_edits.move_gradient_point(on, 2, 0.1, 0.1) is on


def test_factors_are_added_where_there_is_room_and_two_stay(state: ViewState) -> None:
    on, top = transfer_edits.toggle_gradient_opacity(state), state.document.joint.top
    more = transfer_edits.add_gradient_point(on, 0.7 * top, 0.3)
    assert factors_of(more)[2] == (0.7 * top, 0.3)
    assert transfer_edits.add_gradient_point(more, 0.7 * top, 0.9) is more
    assert transfer_edits.remove_gradient_point(more, 2).transfer is not more.transfer
    for i in range(2 * transfer_edits.MOST_FACTORS):
        more = transfer_edits.add_gradient_point(more, i / 31 * top, 0.5)
    assert len(factors_of(more)) == transfer_edits.MOST_FACTORS
    # As near as they can be, a table has rows for each of them: baking would warn.
    assert all(b - a >= top / 128 for (a, _), (b, _) in pairwise(factors_of(more)))
    curve_of(more).bake(1.0)
    two = transfer_edits.remove_gradient_point(on, 1)
    assert two is on


@pytest.mark.parametrize("kind", ["regions", "surfaces"])
def test_another_kind_says_that_it_has_no_filters(state: ViewState, kind: Kind) -> None:
    curve = filtered(state)
    said = conversion_losses(curve, kind, _SPAN)
    assert said == "Left out: the filters of copper. Ctrl+Z brings all back"
    assert conversion_losses(state.transfer, kind, _SPAN) == ""
    assert (
        conversion_losses(curve, "points", _SPAN) == conversion_losses(curve, "labels", _SPAN) == ""
    )


def test_surfaces_say_that_they_have_no_opacity_by_gradient(state: ViewState) -> None:
    on = transfer_edits.toggle_gradient_opacity(state)
    assert "opacity by gradient" in conversion_losses(on.transfer, "surfaces", _SPAN)
    # Regions begin where boundaries do.
    assert conversion_losses(on.transfer, "regions", _SPAN) == ""
    # Of which neither a curve nor surfaces keep anything.
    regions = convert(on.transfer, "regions", _SPAN)
    kinds: tuple[Kind, ...] = ("points", "surfaces")
    for kind in kinds:
        assert "the regions' gradients" in conversion_losses(regions, kind, _SPAN)


def test_how_many_find_no_room_is_said(state: ViewState) -> None:
    count = 12
    regions = [Region((i, i + 0.5), (0, math.inf), 0.5, "gold") for i in range(count)]
    many = TransferFunction2D(regions, state.transfer.materials, state.transfer.basis)
    span = (0.0, float(count))
    made = convert(many, "surfaces", span)
    assert len(parts_of(made)) == MAX_SURFACES
    gone = f"{count - MAX_SURFACES} of {count} regions, which show least"
    assert gone in conversion_losses(many, "surfaces", span)
    assert conversion_losses(many, "points", span) == ""
    most = MOST_PARTS[TransferFunction2D]
    peaks = [(float(i), 0.5 * (i % 2), "gold") for i in range(2 * most + 3)]
    curve = replace(curve_of(state), points=peaks)
    assert f"1 of {most + 1} ranges" in conversion_losses(curve, "regions", (0.0, 60.0))
