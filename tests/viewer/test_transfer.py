"""Transfer functions as they are edited: every kind, presets, conversions, window and level."""

from __future__ import annotations

import gc
import itertools
import math
import weakref
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from volspec.pipeline import raycast
from volspec.spectra import reflectance
from volspec.transfer import (
    MAX_LABEL,
    Isosurfaces,
    LabelFunction,
    Region,
    Transfer,
    TransferFunction,
    TransferFunction2D,
)
from volspec.viewer.actions import ACTIONS, BY_NAME
from volspec.viewer.document import Document, histogram
from volspec.viewer.events import Event, curve, reduced
from volspec.viewer.history import History
from volspec.viewer.state import ViewState
from volspec.viewer.transfer import preset_table, presets
from volspec.viewer.transfer.converting import converted, kind_of
from volspec.viewer.transfer.joint import joint_histogram
from volspec.viewer.transfer.parts import MOST_PARTS, parts_of, with_share
from volspec.viewer.view import slice_table
from volspec.volume import Volume, phantom

KINDS = ("points", "regions", "surfaces", "labels")
_SPAN = (0.0, 1.0)


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


_NUMBERS = st.floats(-3, 3) | st.floats(-1e9, 1e9) | st.sampled_from([0.0, math.nan, math.inf])
_EDITS = st.builds(
    Event,
    st.sampled_from(sorted(curve.EVENTS)),
    _NUMBERS,
    _NUMBERS,
    st.integers(-2, 12),
    st.sampled_from(["copper", "gold", "soft", "no such"]),
)
_ACTIONS = st.sampled_from([action for action in ACTIONS if action.menu == "Transfer"])


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(edits=st.lists(_EDITS | _EDITS | _EDITS | _ACTIONS, min_size=40, max_size=40))
def test_random_edits_keep_parts_in_order_and_near_the_volume(
    state: ViewState, kind: str, edits: list[Event]
) -> None:
    state = of_kind(state, kind)
    for edit in edits:
        if isinstance(edit, Event):
            state = reduced(state, edit)
        elif edit.change is not None:
            state = edit.change(state)
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
    across = reduced(state, Event("window", 0.25, 0.0))
    low, high = state.document.volume.range
    np.testing.assert_allclose(values_of(across), old + 0.25 * (high - low), atol=1e-12)
    assert across.shift == pytest.approx(0.25 * (high - low))
    up = reduced(state, Event("window", 0.0, -0.1))
    middle = (old.min() + old.max()) / 2
    np.testing.assert_allclose(values_of(up), middle + math.exp(0.2) * (old - middle), atol=1e-12)
    back = reduced(reduced(up, Event("window", 0.0, 0.1)), Event("shift", 0.0))
    np.testing.assert_allclose(values_of(back), old, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_thickening_is_as_of_denser_matter_and_undone_by_its_slider(
    state: ViewState, kind: str
) -> None:
    """Exactly: opacities that were rounded to 1 and such as were 1 come back too."""
    state = of_kind(state, kind)
    old = np.array([part.opacity for part in parts_of(state.transfer)])
    thin = reduced(state, Event("thicken", 0.1))
    opacities = [part.opacity for part in parts_of(thin.transfer)]
    # What is wholly opaque lets something through.
    np.testing.assert_allclose(opacities, 1 - (1 - old.clip(0, 0.999)) ** 0.1, atol=1e-12)
    for thickness in (50.0, 0.02, 7.0):
        thin = reduced(thin, Event("thicken", thickness))
    assert reduced(thin, Event("thicken", 1.0)).transfer is state.transfer
    dragged = reduced(state, Event("thicken-by", 0.0, -0.1))
    assert dragged.thickness == pytest.approx(math.exp(0.3))
    back = reduced(reduced(dragged, Event("thicken-by", 0.0, 0.4)), Event("thicken-by", 0.0, -0.3))
    assert back.transfer is state.transfer


def test_thickening_is_undone_of_what_was_shifted_and_goes_on_from_what_was_edited(
    state: ViewState,
) -> None:
    old = [part.opacity for part in parts_of(state.transfer)]
    thick = reduced(state, Event("thicken", 50.0))
    moved = reduced(reduced(thick, Event("shift", 0.1)), Event("window", 0.0, 0.1))
    back = reduced(moved, Event("thicken", 1.0))
    assert [part.opacity for part in parts_of(back.transfer)] == old
    assert values_of(back) == values_of(moved) != values_of(state)
    edited = reduced(thick, Event("opacity", 0.3, index=1))
    same = reduced(reduced(edited, Event("thicken", 2.0)), Event("thicken", 50.0))
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
    thick = reduced(state, Event("thicken", 50.0))
    edited = reduced(thick, Event("opacity", 0.3, index=0))
    for event in (Event("material", index=1, key="gold"), Event("opacity", 0.4, index=0)):
        edited = reduced(edited, event)
    back = opacities_of(reduced(edited, Event("thicken", 1.0)))
    assert back[1:] == opacities_of(state)[1:]
    assert back[0] == pytest.approx(1 - 0.6 ** (1 / 50))


def test_points_added_and_removed_at_fifty_fold_thickness_leave_the_others(
    state: ViewState,
) -> None:
    old = opacities_of(state)
    thick = reduced(state, Event("thicken", 50.0))
    added = reduced(thick, Event("add-point", 0.7, 0.5))
    assert len(opacities_of(added)) == len(old) + 1
    back = opacities_of(reduced(added, Event("thicken", 1.0)))
    assert [opacity for opacity in back if opacity in old] == old
    removed = reduced(thick, Event("remove-point", index=1))
    assert opacities_of(reduced(removed, Event("thicken", 1.0))) == [old[0], *old[2:]]


def test_a_drag_in_the_picture_is_one_step_of_undo(state: ViewState) -> None:
    history = History(state)
    for _ in range(5):
        history = history.then(reduced(history.present, Event("window", 0.01, 0.01)), 7)
    assert len(history.past) == 1
    assert history.undone().present.transfer is state.transfer


def test_edits_of_points_keep_what_gradients_do_to_opacity(state: ViewState) -> None:
    assert isinstance(state.transfer, TransferFunction)
    factors = ((0.0, 0.0), (0.3, 1.0))
    state = replace(state, transfer=replace(state.transfer, gradient_opacity=factors))
    for event in (
        Event("point", 0.4, 0.4, 1),
        Event("add-point", 0.7, 0.1),
        Event("window", 0.1, 0.1),
        Event("thicken", 2.0),
        Event("material", index=0, key="gold"),
        Event("share", 0.4, index=1, key="gold"),
        Event("remove-point", index=1),
    ):
        state = reduced(state, event)
        assert isinstance(state.transfer, TransferFunction)
        assert state.transfer.gradient_opacity == factors, event.name


def test_a_share_makes_the_others_room_and_their_proportions_come_back(state: ViewState) -> None:
    gold = {"gold": 0.5, "copper": 0.3, "steel": 0.2}
    materials = {name: reflectance(name) for name in gold}
    function = replace(
        state.transfer, points=[(0.0, 0.1, gold), (1.0, 0.2, "gold")], materials=materials
    )
    more = with_share(function, 0, "gold", 0.75)
    assert parts_of(more)[0].mix == pytest.approx({"gold": 0.75, "copper": 0.15, "steel": 0.1})
    all_gold = with_share(function, 0, "gold", 1.0)
    back = with_share(all_gold, 0, "gold", 0.5)
    assert parts_of(back)[0].mix == pytest.approx(gold)
    # What one material alone left would be black.
    assert with_share(function, 1, "gold", 0.5) is function


def test_a_region_follows_its_sides_and_has_no_end_above_the_axis(state: ViewState) -> None:
    state, top = of_kind(state, "regions"), state.document.joint.top
    moved = reduced(state, Event("region-values", 0.6, 0.3, 0))
    moved = reduced(moved, Event("region-gradients", 0.1 * top, 0.5 * top, 0))
    assert isinstance(moved.transfer, TransferFunction2D)
    region = moved.transfer.regions[0]
    assert region.values == (0.3, 0.6) and region.gradients == (0.1 * top, 0.5 * top)
    open_above = reduced(moved, Event("region-gradients", 0.1 * top, top, 0))
    assert isinstance(open_above.transfer, TransferFunction2D)
    assert open_above.transfer.regions[0].gradients == (0.1 * top, math.inf)
    added = reduced(state, Event("add-point", 0.5, 0.5 * top))
    assert len(parts_of(added.transfer)) == 3 and added.interface.part == 2


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
    regions = converted(function, "regions", _SPAN)
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
    again = converted(regions, "points", _SPAN)
    table = again.bake(1.0)
    back = np.interp(at, np.linspace(*table.domain, len(table.opacity)), table.opacity)
    assert np.abs(back - here).mean() < 0.1


def test_a_hard_region_becomes_a_curve_with_steep_sides(state: ViewState) -> None:
    regions = of_kind(state, "regions").transfer
    assert isinstance(regions, TransferFunction2D)
    hard = replace(regions, regions=[replace(regions.regions[0], softness=0.0)])
    points = parts_of(converted(hard, "points", _SPAN))
    # From 0.2 to 0.5; sides as steep as points can be told apart on the screen.
    np.testing.assert_allclose(
        [p.values[0] for p in points], [0.2, 0.2, 0.5, 0.5], atol=1e-3 + 1e-9
    )
    np.testing.assert_allclose([p.opacity for p in points], [0, 0.1, 0.1, 0], atol=1e-12)


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
        moved = reduced(close, Event("point", x, 0.7, index=2))
        assert values_of(moved) == [0.0, 0.5, 0.5005, 0.501]
        assert [p.opacity for p in parts_of(moved.transfer)] == [0.1, 0.1, 0.7, 0.3]
    # Nearer than a gap to one neighbour only: it stays where just its opacity is dragged.
    lifted = reduced(close, Event("point", 0.501, 0.7, index=3))
    assert values_of(lifted) == values_of(close)


def test_boundaries_of_a_curve_stay_boundaries_as_regions(state: ViewState) -> None:
    function = replace(state.transfer, gradient_opacity=((0.0, 0.0), (0.4, 1.0)))
    regions = converted(function, "regions", _SPAN)
    assert isinstance(regions, TransferFunction2D)
    assert {region.gradients for region in regions.regions} == {(0.2, math.inf)}


def test_kinds_change_by_name_as_one_step(state: ViewState) -> None:
    for kind in ("regions", "surfaces", "points"):
        change = BY_NAME[f"transfer-{kind}"].change
        assert change is not None
        history = History(state).then(change(state), 1)
        assert kind_of(history.present.transfer) == kind
        assert history.undone().present.transfer is state.transfer
        state = history.present
    labels = of_kind(state, "labels")
    for action in ACTIONS:
        if action.menu == "Transfer" and action.name != "reset-transfer":
            assert action.change is not None and action.change(labels) is labels, action.name


def _volumes() -> dict[str, Volume]:
    rng = np.random.default_rng(5)
    body = np.where(phantom.ball(16).values > 0.5, 60.0, -1000.0)
    body[7:9, 7:9, 7:9] = 1400.0
    return {
        "floats": phantom.ball(12),
        "bytes": Volume(rng.integers(0, 256, (8, 9, 10), dtype=np.uint8)),
        "hounsfield": Volume((body + rng.normal(0, 10, body.shape)).astype(np.int16)),
        "two labels": Volume((body > 0).astype(np.uint8)),
        "constant": Volume(np.full((4, 4, 4), 7, np.uint8)),
        "tiny": Volume(np.array([0.0, 1e-6] * 4, np.float32).reshape(2, 2, 2)),
        "far": Volume(1e4 + phantom.ball(8).values.astype(np.float32)),
    }


@pytest.mark.parametrize("name", _volumes())
def test_every_preset_fits_every_volume(state: ViewState, name: str) -> None:
    volume = _volumes()[name]
    low, high = presets.span(volume)
    for preset in preset_table.PRESETS:
        made = presets.transfer_of(preset, volume, histogram(volume), state.transfer.basis)
        assert made.bake(1.0).opacity.max() > 0
        values = [value for part in parts_of(made) for value in part.values]
        assert low <= values[0] and values[-1] <= high and values == sorted(values)
        assert presets.picked(made) == preset.title


def test_presets_take_hounsfield_units_as_they_are() -> None:
    volume = _volumes()["hounsfield"]
    assert presets.in_hounsfield(volume)
    bone = presets.fitted(preset_table.BY_NAME["bone"], volume, histogram(volume))
    assert [value for value, _, _ in bone] == [200, 380, 650, 1200]
    names = [preset.name for preset in presets.offered(volume)]
    assert names.index("bone") < names.index("metal")
    assert not presets.in_hounsfield(phantom.ball(8))


def test_a_preset_shows_the_ball_and_replaces_materials_and_basis(document: Document) -> None:
    state = ViewState.first(document, (32, 32))
    shifted = reduced(state, Event("shift", 0.2))
    change = BY_NAME["preset-skin"].change
    assert change is not None
    new = change(shifted)
    assert list(new.transfer.materials) == ["skin"] and new.shift == 0
    assert new.transfer.basis.method == "materials"
    assert new.transfer.basis.grid == document.grid
    image = raycast(document.volume, new.transfer, new.view.camera(document.volume), (32, 32))
    assert image.alpha.max() > 0.9


def test_the_joint_histogram_knows_a_ramps_gradient() -> None:
    """0.25 per voxel of 0.5 mm."""
    ramp = np.broadcast_to(0.25 * np.arange(8, dtype=np.float32), (5, 6, 8))
    joint = joint_histogram(Volume(ramp, spacing_mm=(0.5, 1, 1)))
    assert joint.top == pytest.approx(0.5)
    assert joint.counts[:-1].sum() == 0 and joint.counts[-1].sum() > 0
    assert joint_histogram(Volume(np.zeros((2, 2, 2), np.uint8))).top == 1.0


def test_materials_are_shown_as_an_adapted_eye_sees_them(state: ViewState) -> None:
    colours = pytest.importorskip("volspec.viewer.panels.transfer.colours")
    under_daylight = colours.material_colours(state)
    assert set(under_daylight) == {"copper", "gold"}
    r, g, b = under_daylight["gold"]
    assert r > g > b
    # Tungsten makes everything orange, an adapted eye takes most of that back.
    lamp = replace(state, lights=(replace(state.lights[1], weight=1.0),))
    assert np.abs(np.subtract(colours.material_colours(lamp)["gold"], (r, g, b))).max() < 0.1
    dark = replace(state, lights=(replace(state.lights[0], weight=0.0),))
    assert max(colours.part_colours(dark)[0]) == 0.0


def test_the_histogram_on_the_screen_keeps_no_closed_volume(document: Document) -> None:
    regions = pytest.importorskip("volspec.viewer.panels.transfer.regions")
    opened = replace(document, volume=Volume(phantom.ball(8).values))
    closed = weakref.ref(opened.volume.values)
    assert regions.shades(opened.joint, True).max() == pytest.approx(1.0)
    del opened
    gc.collect()
    assert closed() is None


def test_a_curve_of_more_bands_than_it_has_points_for_shows_all_of_them(state: ViewState) -> None:
    """Every second corner was left out, and with them whole bands."""
    count = 24
    edges = np.linspace(0.0, 1.0, count + 1)
    regions = [
        Region((low + 0.005, high - 0.005), (0.0, math.inf), 0.1 + 0.03 * i, "gold", 0.3)
        for i, (low, high) in enumerate(itertools.pairwise(edges))
    ]
    many = TransferFunction2D(regions, state.transfer.materials, state.transfer.basis)
    curve_ = converted(many, "points", _SPAN)
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
    surfaces = converted(whole, "surfaces", _SPAN)
    assert isinstance(surfaces, Isosurfaces) and surfaces.surfaces[-1][2] == {"copper": 1.0}


@pytest.mark.parametrize(
    ("dtype", "top"),
    [(np.uint16, 300), (np.uint16, 65535), *((np.float32, top) for top in (300, 65535, 2**31))],
)
def test_a_table_of_labels_is_bounded_and_tells_those_apart_that_can_be_named(
    dtype: type, top: int
) -> None:
    """Volumes of 32-bit integers are kept as floats: they had 4096 entries, evenly."""
    volume = Volume(np.array([0, 1, 2, top // 2, top - 1, top, 7, 8], dtype).reshape(2, 2, 2))
    entries = slice_table.entries_of(volume, labels=True)
    assert entries.count <= MAX_LABEL + 1 + slice_table.ENTRIES
    named = volume.values[volume.values <= MAX_LABEL]
    np.testing.assert_array_equal(entries.values[entries.codes(named)], named)
    # The others are grey by what they are.
    shades = slice_table.greys(entries, volume.range, (0.0, 1.0))
    np.testing.assert_allclose(
        shades[entries.codes(volume.values)], volume.values / top, atol=1 / slice_table.ENTRIES
    )


def test_slices_tell_labels_above_65535_apart() -> None:
    """70000 was 4464."""
    labels = np.array([[0, 4464, 65535, 70000]], np.int32)
    codes = slice_table.Entries(0.0, 65536, 70000.0, slice_table.ENTRIES).codes(labels)
    np.testing.assert_array_equal(codes, [[0, 4464, 65535, 65535 + slice_table.ENTRIES]])
