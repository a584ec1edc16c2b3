"""A transfer function of one kind made of another: curves, regions and surfaces that look alike."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.viewer.test_transfer import of_kind
from volspec.transfer import Isosurfaces, Region, TransferFunction, TransferFunction2D
from volspec.viewer.model.commands import BY_NAME, COMMANDS
from volspec.viewer.model.edit import after
from volspec.viewer.model.history import History
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.transfer_convert import convert, kind_of
from volspec.viewer.model.transfer_parts import MOST_PARTS, parts_of

_SPAN = (0.0, 1.0)


def test_a_curve_becomes_regions_that_look_alike(state: ViewState) -> None:
    """Opacity of regions over all gradients against the curve's, over the volume's values.

    Slopes become soft sides, which rise along another curve: a tenth on average (measured 0.03).
    """
    basis, materials = state.transfer.basis, state.transfer.materials
    function = TransferFunction(
        [(0.1, 0, "copper"), (0.2, 0.3, "copper"), (0.5, 0.3, "copper"), (0.6, 0, "copper")]
        + [(0.7, 0, "gold"), (0.75, 0.8, "gold"), (0.9, 0.8, "gold")],
        materials,
        basis,
    )
    regions = convert(function, "regions", _SPAN)
    assert isinstance(regions, TransferFunction2D) and len(regions.regions) == 2
    assert [list(part.mix) for part in parts_of(regions)] == [["copper"], ["gold"]]
    table, wanted = regions.bake(1.0), function.bake(1.0)
    at = np.linspace(0, 1, 201)
    domain = np.linspace(*table.domain, table.opacity.shape[1])
    there = np.interp(at, domain, table.opacity[0])
    here = np.interp(at, np.linspace(*wanted.domain, len(wanted.opacity)), wanted.opacity)
    assert np.abs(there - here).mean() < 0.1
    # Beyond its last point a curve goes on: the greatest value is no soft side.
    assert there[-1] == pytest.approx(0.8, abs=0.02)
    again = convert(regions, "points", _SPAN)
    table = again.bake(1.0)
    back = np.interp(at, np.linspace(*table.domain, len(table.opacity)), table.opacity)
    assert np.abs(back - here).mean() < 0.1


def test_a_hard_region_becomes_a_curve_with_steep_sides(state: ViewState) -> None:
    regions = of_kind(state, "regions").transfer
    assert isinstance(regions, TransferFunction2D)
    hard = replace(regions, regions=[replace(regions.regions[0], softness=0.0)])
    points = parts_of(convert(hard, "points", _SPAN))
    # From 0.2 to 0.5; sides as steep as points can be told apart on the screen.
    np.testing.assert_allclose(
        [p.values[0] for p in points], [0.2, 0.2, 0.5, 0.5], atol=1e-3 + 1e-9
    )
    np.testing.assert_allclose([p.opacity for p in points], [0, 0.1, 0.1, 0], atol=1e-12)


def test_boundaries_of_a_curve_stay_boundaries_as_regions(state: ViewState) -> None:
    function = replace(state.transfer, gradient_opacity=((0.0, 0.0), (0.4, 1.0)))
    regions = convert(function, "regions", _SPAN)
    assert isinstance(regions, TransferFunction2D)
    assert {region.gradients for region in regions.regions} == {(0.2, math.inf)}


def test_kinds_change_by_name_as_one_step(state: ViewState) -> None:
    for kind in ("regions", "surfaces", "points"):
        change = BY_NAME[f"transfer-{kind}"].change
        assert change is not None
        history = History(state).then(after(change, state).state, 1)
        assert kind_of(history.present.transfer) == kind
        assert history.undone().present.transfer is state.transfer
        state = history.present
    labels = of_kind(state, "labels")
    for action in COMMANDS:
        if action.menu == "Transfer" and action.name != "reset-transfer":
            assert action.change is not None and after(action.change, labels).state is labels, (
                action.name
            )


def test_a_curve_of_more_bands_than_it_has_points_for_shows_all_of_them(state: ViewState) -> None:
    """Every second corner was left out, and with them whole bands."""
    count = 24
    edges = np.linspace(0.0, 1.0, count + 1)
    regions = [
        Region((low + 0.005, high - 0.005), (0.0, math.inf), 0.1 + 0.03 * i, "gold", 0.3)
        for i, (low, high) in enumerate(itertools.pairwise(edges))
    ]
    many = TransferFunction2D(regions, state.transfer.materials, state.transfer.basis)
    curve_ = convert(many, "points", _SPAN)
    assert isinstance(curve_, TransferFunction)
    values, opacities = np.array([point[:2] for point in curve_.points]).T
    assert len(values) == MOST_PARTS[TransferFunction]
    for region in regions:
        inside = (values > region.values[0]) & (values < region.values[1])
        assert opacities[inside].max() == pytest.approx(region.opacity)
    # Of more than there is room for, what shows least goes.
    bands = [Region((e, e + 0.01), (0, math.inf), 0.5, "gold") for e in np.linspace(0, 0.9, 40)]
    wide = Region((0.95, 1.0), (0, math.inf), 0.9, "copper")
    whole = TransferFunction2D([*bands, wide], state.transfer.materials, state.transfer.basis)
    surfaces = convert(whole, "surfaces", _SPAN)
    assert isinstance(surfaces, Isosurfaces) and surfaces.surfaces[-1][2] == {"copper": 1.0}
