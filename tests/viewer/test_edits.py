"""Random edits never raise; edits of views, lights and curves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.support.viewer import run_command
from tests.viewer._edits import MODULES, drawn
from volspec.raycast import Ambient, Camera, Headlight, LightGroup
from volspec.relight import LightRig
from volspec.spectra import DEFAULT_GRID, light
from volspec.viewer.model import camera, light_rows, lights
from volspec.viewer.model.commands import COMMANDS
from volspec.viewer.model.document import Document
from volspec.viewer.model.edit import Change, after
from volspec.viewer.model.light_rows import LightRow
from volspec.viewer.model.state import ViewState
from volspec.viewer.model.view import View
from volspec.viewer.work.casts import DIVISORS, Pace

WORDS = ("", "no such", "gold", "A", "#804020", "CAM16", "dim", "free", "light")
_COMMANDS = st.sampled_from([each.change for each in COMMANDS if each.change is not None])


@settings(max_examples=60, suppress_health_check=list(HealthCheck))
@given(
    edits=st.lists(drawn(WORDS, *MODULES) | _COMMANDS, min_size=50, max_size=60),
    grouped=st.booleans(),
)
def test_random_edits_never_raise(state: ViewState, edits: list[Change], grouped: bool) -> None:
    if grouped:  # a light of two groups, over a cast with both
        groups = LightGroup("gold", (Headlight(),)), LightGroup("A", (Ambient(),))
        rig = LightRig((light("A"), light("D65")), (1.0, 0.5), None, ("gold", "A"))
        rows = (*state.lights, LightRow("evening", "", rig, texts=("A", "D65")))
        state = replace(state, lights=rows, shading=replace(state.shading, groups=groups))
    for edit in edits:
        state = after(edit, state).state
    state.view.camera(state.document.volume)
    rig_now = light_rows.light_rig(state.lights)
    assert rig_now is None or any(rig_now.weights)
    for row in state.lights:
        assert np.isfinite(row.rig.mixed(DEFAULT_GRID).values).all()
        assert len(row.texts) == len(row.rig.lights)
    assert state.lights and state.transfer.bake(1.0).opacity.max() <= 1
    assert 0 <= state.interface.light < light_rows.MOST_ROWS


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_camera_becomes_the_orbit_there(document: Document, orthographic: bool) -> None:
    volume = document.volume
    for up in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)):
        given = View(40.0, 25.0, 1.7, 24.0, orthographic, up, (3.0, 4.0, 2.0)).camera(volume)
        again = View.of(given, volume).camera(volume)
        np.testing.assert_allclose(again.position_mm, given.position_mm, atol=1e-9)
        np.testing.assert_allclose(again.frame()[1], given.frame()[1], atol=1e-9)
        if orthographic:
            assert again.height_mm == pytest.approx(given.height_mm)


def test_a_point_follows_the_mouse_when_it_is_panned(state: ViewState) -> None:
    """The target moves by as much of the picture's height as the mouse, the other way."""
    start = replace(state, view=View(zoom=1.3))

    def height_of(camera: Camera) -> float:
        return 2 * camera.distance_mm * math.tan(math.radians(camera.fov_deg) / 2)

    before, panned = (
        each.view.camera(state.document.volume) for each in (start, camera.pan(start, 0.1, 0.2))
    )
    right, up, _ = before.frame()
    step = np.subtract(panned.target_mm, before.target_mm) / height_of(before)
    np.testing.assert_allclose([step @ right, step @ up], [-0.1, 0.2], atol=1e-9)


def test_front_right_and_top_look_along_the_axes(state: ViewState) -> None:
    for side, towards in (("front", (0, 1, 0)), ("right", (-1, 0, 0)), ("top", (0, 0, -1))):
        view = run_command(state, f"view-{side}").state.view
        forward = view.camera(state.document.volume).frame()[2]
        np.testing.assert_allclose(forward, towards, atol=1e-9)


@given(
    count=st.integers(1, 12),
    x=st.floats(-2, 2, allow_subnormal=False),
    y=st.floats(-2, 2, allow_subnormal=False),
)
def test_dial_weights_sum_to_one_and_come_back_to_their_place(
    count: int, x: float, y: float
) -> None:
    weights = lights.dial_weights(count, x, y)
    assert min(weights) >= 0 and sum(weights) == pytest.approx(1.0)
    # Weights on the dial are those of its place, which is where they are drawn.
    again = lights.dial_weights(count, *lights.dial_place(weights))
    np.testing.assert_allclose(again, weights, atol=1e-9)


def test_solo_and_mute_decide_who_shines(state: ViewState) -> None:
    lit = state
    for i in range(3):
        lit = lights.set_weight(lit, i, 0.5)
    assert light_rows.effective_weights(lit.lights) == (0.5, 0.5, 0.5, 0.0)
    solo = lights.toggle_solo(lit, 1)
    assert light_rows.effective_weights(solo.lights) == (0.0, 0.5, 0.0, 0.0)
    assert light_rows.effective_weights(lights.toggle_mute(solo, 1).lights) == (0.0,) * 4
    assert light_rows.light_rig(lights.toggle_mute(solo, 1).lights) is None


def test_a_light_is_added_alone_and_heated(state: ViewState) -> None:
    added = lights.add(state, "planck:2700").state
    assert light_rows.effective_weights(added.lights) == (0.0, 0.0, 0.0, 0.0, 1.0)
    assert added.lights[-1].kelvin == 2700
    hotter = lights.set_kelvin(added, 4, 5000.4).lights
    assert hotter[4].name == "5000 K" and hotter[4].rig is not added.lights[4].rig


def test_lights_kept_beside_stay_while_others_change(state: ViewState) -> None:
    kept = run_command(state, "b").state
    changed = run_command(kept, "space").state
    assert changed.other == state.lights != changed.lights
    assert lights.set_divide(changed, 7.0).divide == 0.98
    assert run_command(changed, "b").state.other is None


def test_space_goes_round_all_lights(state: ViewState) -> None:
    seen = []
    for _ in state.lights:
        seen.append(light_rows.brightest_row(state.lights))
        state = run_command(state, "space").state
    assert seen == [0, 1, 2, 3] and light_rows.brightest_row(state.lights) == 0


def test_a_moving_picture_gets_coarser_until_it_keeps_up() -> None:
    pace = Pace()
    for _ in range(9):
        pace = pace.after(pace.divisor, 500.0)
    assert pace.divisor == DIVISORS[-1]
    for _ in range(9):
        pace = pace.after(pace.divisor, 0.5)
    assert pace.divisor == 1 and pace.after(1, 300.0).divisor == 2
    assert replace(pace, divisor=4, whole_ms=5000.0).to_whole == (2, 1)
