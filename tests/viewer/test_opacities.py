"""Opacities of materials: edits, their cost, pictures without a cast, the panel in the window."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.patience import wait_until
from tests.support.viewer import opened, take_until
from tests.support.window import Robot, small_engine
from volspec.basis import MaterialBasis
from volspec.pipeline import Raycaster, relight
from volspec.raycast import CoefficientImage, DepthEffects
from volspec.raycast.pace import WHOLE, Pass
from volspec.scene.specs import MeshSpec
from volspec.viewer.model import camera, depth, opacities
from volspec.viewer.model.history import Difference, History, without_cast
from volspec.viewer.model.light_rows import light_rig
from volspec.viewer.model.quality import cast_spec, opacity_scales
from volspec.viewer.model.scene_file import export_scene
from volspec.viewer.model.state import ViewState
from volspec.viewer.work import screen as work_screen
from volspec.viewer.work.casts import CastDone, CastJob, CastScheduler, CastWorker
from volspec.viewer.work.documents import open_document
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.outputs import Progress
from volspec.viewer.work.screen import Meter, Screen
from volspec.viewer.work.screenshot import render_frame

pytestmark = pytest.mark.not_quick

SIZE = 48, 36
LAYERED = Pass(1, layers=8)


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> ViewState:
    """The state of a scene whose materials are its channels."""
    state = opened(tmp_path_factory.mktemp("ball"))
    document = replace(state.document, caster=Raycaster(state.document.volume))
    first = replace(state, document=document, size=SIZE)
    return opacities.set_opacity(opacities.set_opacity(first, "copper", 0.5), "copper", 1.0)


def job(state: ViewState, *passes: Pass) -> CastJob:
    view = state.view.camera(state.document.volume)
    return CastJob(state.document, state.transfer, view, cast_spec(state), SIZE, passes)


def casts(state: ViewState, *passes: Pass) -> list[CastDone]:
    return list(CastWorker(lambda: None)._results(job(state, *passes)))


@pytest.fixture(scope="module")
def layered(ball: ViewState) -> CastDone:
    return casts(ball, LAYERED)[0]


def test_scales_are_clamped_kept_by_name_and_reset(ball: ViewState) -> None:
    assert opacity_scales(ball) == {}
    faded = opacities.set_opacity(ball, "copper", 0.25)
    assert opacity_scales(faded) == {"copper": 0.25}
    assert opacity_scales(opacities.set_opacity(faded, "copper", 99.0)) == {
        "copper": opacities.MOST
    }
    assert opacities.set_opacity(faded, "silk", 0.5) is faded
    assert opacities.set_opacity(faded, "copper", 0.25) is faded
    hidden = opacities.toggle(faded, "copper")
    assert opacity_scales(hidden) == {"copper": 0.0}
    assert opacity_scales(opacities.toggle(hidden, "copper")) == {}
    others = {name: 0.0 for name in opacities.names(ball) if name != "grey"}
    alone = opacities.show_only(faded, "grey")
    assert opacity_scales(alone) == others
    assert opacity_scales(opacities.show_only(alone, "grey")) == {}
    assert opacities.reset(hidden).shading == ball.shading


def test_the_first_scale_makes_materials_the_channels(state: ViewState) -> None:
    assert not isinstance(state.transfer.basis, MaterialBasis)
    faded = opacities.set_opacity(state, "copper", 0.5)
    assert isinstance(faded.transfer.basis, MaterialBasis) and not opacities.can_layer(state)
    assert opacities.can_layer(faded)
    projected = replace(faded, shading=replace(faded.shading, mode="maximum"))
    assert not opacities.can_layer(projected)


@pytest.mark.slow  # tests of meshes cast their layers, too
def test_meshes_are_the_last_layer_and_do_not_fade(ball: ViewState) -> None:
    pytest.importorskip("embreex")
    names = opacities.names(ball)
    mesh = MeshSpec(shape="sphere", size_mm=3.0, material=names[0])
    state = replace(ball, meshes=(mesh,))
    assert opacities.can_layer(state) and opacities.is_in_volume(state, names[0])
    assert not opacities.can_layer(replace(state, meshes=(replace(mesh, opacity=0.5),)))
    assert opacities.can_layer(replace(state, meshes=(replace(mesh, opacity=0.5, shown=False),)))
    only = replace(mesh, material="silk")
    assert not opacities.is_in_volume(replace(ball, meshes=(only,)), "silk")
    view = state.view.camera(state.document.volume)
    own = CastJob(
        *(state.document, state.transfer, view, cast_spec(state), SIZE, (LAYERED,)),
        meshes=state.meshes,
    )
    (done,) = CastWorker(lambda: None)._results(own)
    assert done.opacity is not None, done.error
    layers = done.image.opacity_layers
    assert layers.solid and done.opacity.solid


def test_a_scale_costs_no_cast_and_has_a_step_of_undo(ball: ViewState) -> None:
    faded = opacities.set_opacity(ball, "grey", 0.5)
    change = Difference.between(ball, faded)
    assert (change.stage, change.name, change.undoable) == ("recompose", "opacity", True)
    turned = camera.orbit(faded, 0.1, 0.0)
    assert Difference.between(ball, turned).stage == "cast"
    history = History(ball).then(faded, 1)
    assert history.undo().present.shading == ball.shading


def test_a_saved_scene_has_them(ball: ViewState, tmp_path: Path) -> None:
    export_scene(opacities.set_opacity(ball, "grey", 0.3), tmp_path / "faded.toml")
    again = open_document(str(tmp_path / "faded.toml"))
    assert again.shading.opacities == {"grey": 0.3}


def test_other_materials_do_not_leave_scales_behind(ball: ViewState) -> None:
    faded = opacities.set_opacity(ball, "grey", 0.5)
    given = replace(faded.shading, opacities={"grey": 0.5, "gone": 0.1})
    assert cast_spec(replace(faded, shading=given)).opacities == {"grey": 0.5}


def test_layers_are_cast_of_the_curve_s_own_opacities(ball: ViewState) -> None:
    faded = opacities.set_opacity(ball, "grey", 0.0)
    plain, layered = casts(faded, WHOLE, LAYERED)
    assert plain.image.opacity_layers is None and plain.opacity is None
    own = casts(ball, WHOLE)[0].image
    np.testing.assert_allclose(layered.image.coefficients, own.coefficients, atol=1e-6)


def test_layers_follow_when_nothing_moves_and_once(ball: ViewState) -> None:
    scheduler = CastScheduler(lambda: None)
    taken: list[CastDone] = []

    def rest() -> list[CastDone]:
        taken.clear()
        wait_until(lambda: taken.extend(scheduler.take()) or not scheduler.busy)
        return [done for done in taken if done.image is not None and done.made.layers]

    scheduler.change(ball, 0.0, held=False)
    assert rest() == []
    scheduler.tick(9.0, held=False)
    assert rest() == []  # nobody wants them
    scheduler.layers_wanted = True
    scheduler.tick(9.0, held=True)
    assert rest() == []
    scheduler.tick(9.0, held=False)
    (done,) = rest()
    assert scheduler.is_newest(done)
    scheduler.follow(opacities.set_opacity(ball, "grey", 0.5))
    scheduler.tick(9.0, held=False)
    assert rest() == []
    scheduler.change(camera.orbit(ball, 0.1, 0.0), 9.0, held=False)
    rest()
    assert not scheduler.is_newest(done)
    scheduler.tick(19.0, held=False)
    assert len(rest()) == 1
    scheduler.close()


def test_a_turned_view_is_first_shown_by_the_layers(ball: ViewState) -> None:
    faded = opacities.set_opacity(ball, "grey", 0.4)
    scheduler = CastScheduler(lambda: None)
    taken: list[CastDone] = []

    def rest() -> list[Pass]:
        taken.clear()
        wait_until(lambda: taken.extend(scheduler.take()) or not scheduler.working)
        assert all(done.error == "" for done in taken)
        return [done.made for done in taken if done.image is not None]

    scheduler.change(faded, 0.0, held=False)
    scheduler.layers_wanted = True
    rest()
    scheduler.tick(9.0, held=False)
    assert [made.layers for made in rest()] == [8]
    near = camera.orbit(faded, 0.02, 0.0)
    scheduler.change(near, 10.0, held=True, turned=True)
    assert rest() == [Pass(1, "none")]
    (shown,) = taken
    assert shown.image.camera == shown.job.camera
    (exact,) = casts(near, WHOLE)
    off = np.abs(shown.image.coefficients - exact.image.coefficients)
    assert off.mean() < 0.01
    scheduler.tick(11.0, held=True)  # it rests
    assert WHOLE in rest()
    far = camera.orbit(faded, 0.5, 0.0)
    scheduler.change(far, 12.0, held=True, turned=True)
    assert "none" not in [made.steps for made in rest()]
    # Anything else but the view ends it.
    scheduler.change(opacities.reset(near), 13.0, held=False)
    scheduler.change(near, 14.0, held=False, turned=True)
    assert "none" not in [made.steps for made in rest()]
    scheduler.close()


def test_near_is_an_angle_and_a_distance(ball: ViewState, layered: CastDone) -> None:
    nearby = layered.nearby
    own = layered.job.camera
    assert nearby.shows(own)
    towards = np.subtract(own.position_mm, own.target_mm)
    for ratio, near in ((1.2, True), (1.5, False), (0.6, False)):
        x, y, z = (np.asarray(own.target_mm) + ratio * towards).tolist()
        assert nearby.shows(replace(own, position_mm=(x, y, z))) == near
    assert not nearby.shows(replace(own, fov_deg=own.fov_deg + 1))


@pytest.fixture
def screen(context: Any) -> Iterator[Screen]:
    shown = Screen(context, lambda: None, Meter(Trace()), Notice())
    yield shown
    shown.close()


def drawn(screen: Screen, state: ViewState, held: bool = False) -> NDArray[np.uint8]:
    screen.mark_stale()
    while screen.relight(state, held):
        pass
    with screen.pictures._context:
        return screen.pictures.pixels().copy()


def wanted(image: CoefficientImage, state: ViewState) -> NDArray[Any]:
    rig = light_rig(state.lights)
    shown = image.recompose(opacity_scales(state))
    return relight(shown, rig, state.relight, backend="numpy").astype(int)


def assert_shown(screen: Screen, state: ViewState, image: CoefficientImage) -> None:
    """The screen's picture is that of an image with the state's opacities, to a code."""
    assert np.abs(drawn(screen, state).astype(int) - wanted(image, state)).max() <= 1


def test_a_picture_with_layers_shows_opacities_at_once(screen: Screen, ball: ViewState) -> None:
    plain, layered = casts(ball, WHOLE, LAYERED)
    screen.take(plain, ball)
    assert not screen.recomposes()
    before = drawn(screen, ball)
    screen.take(layered, ball)
    assert screen.recomposes() and layered.image is not None
    np.testing.assert_array_equal(drawn(screen, ball), before)
    for scale in (0.2, 2.0, 0.0, 1.0):
        faded = opacities.set_opacity(ball, "grey", scale)
        assert_shown(screen, faded, layered.image)
        assert np.array_equal(drawn(screen, faded), before) == (scale == 1)
    # Fewer pixels while a slow picture is dragged, then all of them.
    faded = opacities.set_opacity(ball, "grey", 0.4)
    screen._meter.bands = 2
    assert drawn(screen, faded, held=True).shape == (SIZE[1] // 2, SIZE[0] // 2, 3)
    assert_shown(screen, faded, layered.image)
    screen.forget_layers()
    assert not screen.recomposes()


def test_a_cast_with_the_same_opacities_stays_until_they_change(
    screen: Screen, ball: ViewState
) -> None:
    faded = opacities.set_opacity(ball, "grey", 0.3)
    plain, layered = casts(faded, WHOLE, LAYERED)
    screen.take(plain, faded)
    exact = drawn(screen, faded)
    screen.take(layered, faded)
    assert screen.loading  # a step at each tick
    np.testing.assert_array_equal(drawn(screen, faded), exact)
    steps = 0
    while screen.loading:
        screen.tick(faded, 0.0, held=True)
        steps += 1
    assert steps > 3 and screen.recomposes()
    np.testing.assert_array_equal(drawn(screen, faded), exact)
    more = opacities.set_opacity(ball, "grey", 0.2)
    assert_shown(screen, more, layered.image)
    # A late cast of another view has no say.
    late = CastDone(layered.job, LAYERED, 0.0, layered.image, opacity=layered.opacity)
    screen.forget_layers()
    screen.take(late, more, newest=False)
    assert not screen.recomposes()


def test_values_under_the_mouse_are_those_of_the_recomposed_picture(
    screen: Screen, ball: ViewState, layered: CastDone
) -> None:
    screen.take(layered, ball)
    faded = opacities.set_opacity(ball, "grey", 0.05)
    drawn(screen, faded)
    screen.probe(faded, (0.5, 0.5), held=False)
    assert screen.under_mouse is None  # until it is recomposed
    screen.tick(faded, 0.0, held=True)
    assert not screen.busy
    screen.tick(faded, 0.0, held=False)
    assert screen.busy
    wait_until(screen.take_recomposed)
    drawn(screen, faded)
    with screen.pictures._context:  # a window's stays current
        screen.probe(faded, (0.5, 0.5), held=False)
    reading = screen.under_mouse
    shown = np.array(dict(reading.rows)["RGB"].split(), int)
    assert np.abs(shown - wanted(layered.image, faded)[SIZE[1] // 2, SIZE[0] // 2]).max() <= 1
    assert screen.image.opacity_layers is None


def test_opacities_that_layers_show_wrongly_are_cast(
    screen: Screen, ball: ViewState, monkeypatch: pytest.MonkeyPatch, layered: CastDone
) -> None:
    scheduler = CastScheduler(lambda: None)
    scheduler.change(ball, 0.0, held=False)
    screen.take(layered, ball)
    faded = opacities.set_opacity(ball, "grey", 0.05)
    take_until(scheduler.take, lambda _: not scheduler.busy)
    for visible, off in ((1e6, False), (0.0, True)):
        monkeypatch.setattr(work_screen, "VISIBLE", visible)
        faded = opacities.set_opacity(faded, "copper", 0.5 if off else 0.6)
        drawn(screen, faded)
        screen.tick(faded, 0.0, held=False)
        wait_until(screen.take_recomposed)
        assert screen.visibly_off == off
    scheduler.cast_opacities(faded)
    (done,) = take_until(scheduler.take, lambda _: not scheduler.busy)
    scheduler.close()
    assert done.job.shading.opacities == opacity_scales(faded)
    screen.take(done, faded, scheduler.is_newest(done))
    assert done.image.opacity_layers is None and screen.recomposes()
    rig = light_rig(faded.lights)
    shown = relight(done.image, rig, faded.relight, backend="numpy")
    assert np.abs(drawn(screen, faded).astype(int) - shown.astype(int)).max() <= 1
    # The next change is recomposed again.
    assert_shown(screen, opacities.set_opacity(faded, "copper", 0.4), layered.image)


def test_cuts_and_fog_are_recomposed_and_saved(
    screen: Screen, ball: ViewState, tmp_path: Path, layered: CastDone
) -> None:
    """You should see half a ball in fog."""
    screen.take(layered, ball)
    least, most = depth.limits_mm(ball)
    middle = 0.5 * (least + most)
    foggy = depth.set_fog(depth.set_cut(ball, middle, most), 2.0)
    fog_mm = (most - least) / 2
    assert foggy.depth == DepthEffects(near_mm=middle, fog_mm=fog_mm, fog_from_mm=least)
    change = Difference.between(ball, foggy)
    assert (change.stage, change.name, change.undoable) == ("recompose", "depth", True)
    for state in (foggy, depth.set_cut(foggy, least, middle), depth.reset(foggy)):
        rig, image = light_rig(state.lights), layered.image
        shown = image.recompose({}, depth.shown_depth(state))
        codes = relight(shown, rig, state.relight, backend="numpy").astype(int)
        assert np.abs(drawn(screen, state).astype(int) - codes).max() <= 2
    export_scene(foggy, tmp_path / "foggy.toml")
    again = open_document(str(tmp_path / "foggy.toml"))
    assert again.shading.layers == 8
    assert again.file.depth.near_mm == pytest.approx(middle)
    frame = render_frame(foggy, SIZE, Progress("picture"))
    assert np.abs(frame.astype(int) - drawn(screen, foggy).astype(int)).mean() < 2


def test_a_focus_is_shown_once_nothing_moves(
    screen: Screen, ball: ViewState, tmp_path: Path, layered: CastDone
) -> None:
    """You should see a ball that is sharp in front."""
    screen.take(layered, ball)
    image = layered.image
    least, most = depth.limits_mm(ball)
    focused = depth.set_focus(ball, least)
    assert depth.aperture_mm(focused) == least / 20
    focused = depth.set_aperture(focused, least)
    assert focused.depth == DepthEffects(focus_mm=least, aperture_mm=least / 4)
    change = Difference.between(ball, focused)
    assert (change.stage, change.name, change.undoable) == ("recompose", "depth", True)
    plain = drawn(screen, ball)
    assert np.array_equal(drawn(screen, focused), plain)
    screen.tick(focused, 0.0, held=True)
    assert not screen._resting.busy

    def rested(state: ViewState) -> NDArray[np.int_]:
        drawn(screen, state)
        screen.tick(state, 0.0, held=False)
        wait_until(screen.take_rest)
        return drawn(screen, state).astype(int)

    def expected(state: ViewState) -> NDArray[np.int_]:
        shown, rig = image.recompose(opacity_scales(state), state.depth), light_rig(state.lights)
        return relight(shown, rig, state.relight, backend="numpy").astype(int)

    shown = rested(focused)
    assert np.abs(shown - expected(focused)).max() <= 2 and np.abs(shown - plain).max() > 5
    # Lights change at once, and what is read is what is shown.
    other = replace(focused, lights=focused.lights[::-1])
    assert np.abs(drawn(screen, other) - expected(other)).max() <= 2
    screen.probe(other, (0.5, 0.5), held=False)
    assert screen.under_mouse is not None
    faded = depth.set_cut(opacities.set_opacity(focused, "grey", 0.3), least, (least + most) / 2)
    assert np.abs(rested(faded) - expected(faded)).max() <= 2
    assert np.array_equal(drawn(screen, ball), plain)
    assert depth.set_focus(focused, None).depth == DepthEffects()
    export_scene(focused, tmp_path / "focused.toml")
    again = open_document(str(tmp_path / "focused.toml"))
    assert again.file.depth.focus_mm == pytest.approx(least)
    parallel = replace(ball, view=replace(ball.view, orthographic=True))
    assert depth.can_focus(ball) and not depth.can_focus(parallel)


def test_cuts_at_the_ends_are_none(ball: ViewState) -> None:
    least, most = depth.limits_mm(ball)
    cut = depth.set_cut(ball, least + 1, most - 1)
    assert cut.depth.near_mm == least + 1 and cut.depth.far_mm == most - 1
    assert depth.set_cut(cut, least - 9, most + 9).depth == DepthEffects()
    crossed = depth.set_cut(ball, most + 5, least - 5).depth
    assert crossed.far_mm is None or crossed.near_mm < crossed.far_mm
    assert depth.set_fog(depth.set_fog(ball, 1.0), 0.0).depth == DepthEffects()
    focused = replace(ball, depth=DepthEffects(focus_mm=least))
    assert not depth.shown_depth(focused).changes and depth.can_be_set(focused)


def test_a_cast_image_with_layers_is_faded_and_saved(
    ball: ViewState, tmp_path: Path, layered: CastDone
) -> None:
    layered.image.save(tmp_path / "ball.exr")
    state = ViewState.first(open_document(str(tmp_path / "ball.exr")), (300, 300))
    assert opacities.can_layer(state)
    scheduler = CastScheduler(lambda: None)
    scheduler.change(state, 0.0, held=False)
    (done,) = take_until(scheduler.take, lambda _: not scheduler.busy)
    scheduler.close()
    assert scheduler.is_newest(done) and done.opacity is not None
    faded = opacities.set_opacity(state, "grey", 0.1)
    assert without_cast(state, faded) is faded
    turned = without_cast(state, camera.orbit(faded, 0.2, 0.0))
    assert turned.shading.opacities == {"grey": 0.1} and turned.view == state.view
    frame = render_frame(faded, SIZE, Progress(""))
    assert np.abs(frame.astype(int) - wanted(state.document.image, faded)).max() <= 1


@pytest.mark.slow
def test_a_slider_is_dragged_without_a_cast(window: Robot, tmp_path: Path) -> None:
    window.open(small_engine(tmp_path))
    window.front("opacity")
    window.click("opacity eye block")  # the first makes the materials channels
    before = window.rest()
    window.steps([window.at("opacity block", share) for share in (0.1, 0.3, 0.6)], "relight")
    assert window.since(before, "cast", "error") == []
