"""Layers of a cast, shown without another: opacities, cuts, fog, a focus, both eyes."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.patience import wait_until
from tests.support.viewer import opened, take_until
from tests.support.window import small_engine
from tests.viewer._states import casts_of, frame_of, job_of, relit, seen
from volspec.basis import MaterialBasis
from volspec.image import CoefficientImage, DepthEffects
from volspec.pipeline import Raycaster
from volspec.raycast.progressive import WHOLE, Pass
from volspec.relight.stereo import Stereo, StereoViews
from volspec.scene.tables.specs import MeshSpec
from volspec.viewer.model import camera, depth, opacities, quality
from volspec.viewer.model.edit import after, with_interface
from volspec.viewer.model.history import Difference, History, without_cast
from volspec.viewer.model.quality import cast_spec, opacity_scales
from volspec.viewer.model.scene_file import export_scene, left_out
from volspec.viewer.model.state import ViewState
from volspec.viewer.work import idle_views
from volspec.viewer.work.cast_job import CastDone
from volspec.viewer.work.casts import CastScheduler
from volspec.viewer.work.documents import open_document
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.screen import Meter, Screen

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


def casts(state: ViewState, *passes: Pass, **more: Any) -> list[CastDone]:
    return casts_of(job_of(state, SIZE, *passes, **more))


@pytest.fixture(scope="module")
def layered(ball: ViewState) -> CastDone:
    return casts(ball, LAYERED)[0]


def test_scales_are_clamped_kept_by_name_and_reset(ball):
    assert opacity_scales(ball) == {}
    faded = opacities.set_opacity(ball, "copper", 0.25)
    assert opacity_scales(faded) == {"copper": 0.25}
    thick = opacities.set_opacity(faded, "copper", 99.0)
    assert opacity_scales(thick) == {"copper": opacities.MAX_SCALE}
    assert opacities.set_opacity(faded, "silk", 0.5) is faded
    assert opacities.set_opacity(faded, "copper", 0.25) is faded
    hidden = opacities.toggle(faded, "copper")
    assert opacity_scales(hidden) == {"copper": 0.0}
    assert opacity_scales(opacities.toggle(hidden, "copper")) == {}
    alone = opacities.show_only(faded, "grey")
    assert opacity_scales(alone) == dict.fromkeys({*opacities.names(ball)} - {"grey"}, 0.0)
    assert opacity_scales(opacities.show_only(alone, "grey")) == {}
    assert opacities.reset(hidden).shading == ball.shading


def test_the_first_scale_makes_materials_the_channels(state):
    assert not isinstance(state.transfer.basis, MaterialBasis)
    faded = opacities.set_opacity(state, "copper", 0.5)
    assert isinstance(faded.transfer.basis, MaterialBasis) and not quality.can_layer(state)
    assert quality.can_layer(faded)
    assert not quality.can_layer(replace(faded, shading=replace(faded.shading, mode="maximum")))


@pytest.mark.slow  # tests of meshes cast their layers, too
def test_meshes_are_the_last_layer_and_do_not_fade(ball):
    pytest.importorskip("embreex")
    names = opacities.names(ball)
    mesh = MeshSpec(shape="sphere", size_mm=3.0, material=names[0])
    state = replace(ball, meshes=(mesh,))
    assert quality.can_layer(state) and opacities.is_in_volume(state, names[0])
    assert not quality.can_layer(replace(state, meshes=(replace(mesh, opacity=0.5),)))
    assert quality.can_layer(replace(state, meshes=(replace(mesh, opacity=0.5, shown=False),)))
    only = replace(mesh, material="silk")
    assert not opacities.is_in_volume(replace(ball, meshes=(only,)), "silk")
    (done,) = casts(state, LAYERED, meshes=state.meshes)
    assert done.image.opacity_layers.solid and done.opacity.solid, done.error


def test_a_scale_costs_no_cast_and_has_a_step_of_undo(ball):
    faded = opacities.set_opacity(ball, "grey", 0.5)
    assert_recomposes(ball, faded, "opacity")
    assert Difference.between(ball, camera.orbit(faded, 0.1, 0.0)).stage == "cast"
    assert History(ball).then(faded, 1).undo().present.shading == ball.shading


def test_a_saved_scene_has_them(ball, tmp_path):
    export_scene(opacities.set_opacity(ball, "grey", 0.3), tmp_path / "faded.toml")
    assert open_document(str(tmp_path / "faded.toml")).shading.opacities == {"grey": 0.3}


def test_other_materials_do_not_leave_scales_behind(ball):
    given = replace(ball.shading, opacities={"grey": 0.5, "gone": 0.1})
    assert cast_spec(replace(ball, shading=given)).opacities == {"grey": 0.5}


def test_layers_are_cast_of_the_curve_s_own_opacities(ball):
    plain, layered = casts(opacities.set_opacity(ball, "grey", 0.0), WHOLE, LAYERED)
    assert plain.image.opacity_layers is None and plain.opacity is None
    own = casts(ball, WHOLE)[0].image
    np.testing.assert_allclose(layered.image.coefficients, own.coefficients, atol=1e-6)


def rest(scheduler: CastScheduler) -> list[CastDone]:
    """Return what is cast until no thread is at work."""
    taken = take_until(scheduler.take, lambda _: not scheduler.working)
    assert all(done.error == "" for done in taken)
    return [done for done in taken if done.image is not None]


def test_layers_follow_when_nothing_moves_and_once(ball):
    scheduler = CastScheduler(lambda: None)

    def layers_after(now: float, held: bool = False) -> list[CastDone]:
        rest(scheduler)
        scheduler.tick(now, held)
        return [done for done in rest(scheduler) if done.cast_pass.layers]

    scheduler.change(ball, 0.0, held=False)
    assert layers_after(9.0) == []  # nobody wants them
    scheduler.layers_wanted = True
    assert layers_after(9.0, held=True) == []
    (done,) = layers_after(9.0)
    assert scheduler.is_newest(done)
    scheduler.follow(opacities.set_opacity(ball, "grey", 0.5))
    assert layers_after(9.0) == []
    scheduler.change(camera.orbit(ball, 0.1, 0.0), 9.0, held=False)
    rest(scheduler)
    assert not scheduler.is_newest(done)
    assert len(layers_after(19.0)) == 1
    scheduler.close()


def test_a_turned_view_is_first_shown_by_the_layers(ball):
    faded = opacities.set_opacity(ball, "grey", 0.4)
    scheduler = CastScheduler(lambda: None)
    scheduler.change(faded, 0.0, held=False)
    scheduler.layers_wanted = True
    rest(scheduler)
    scheduler.tick(9.0, held=False)
    assert [done.cast_pass.layers for done in rest(scheduler)] == [8]
    near = camera.orbit(faded, 0.02, 0.0)
    scheduler.change(near, 10.0, held=True, turned=True)
    (shown,) = rest(scheduler)
    assert shown.cast_pass == Pass(1, "none") and shown.image.camera == shown.job.camera
    (exact,) = casts(near, WHOLE)
    assert np.abs(shown.image.coefficients - exact.image.coefficients).mean() < 0.01
    scheduler.tick(11.0, held=True)  # it rests
    assert WHOLE in [done.cast_pass for done in rest(scheduler)]
    scheduler.change(camera.orbit(faded, 0.5, 0.0), 12.0, held=True, turned=True)
    assert "none" not in [done.cast_pass.steps for done in rest(scheduler)]
    # Anything else but the view ends it.
    scheduler.change(opacities.reset(near), 13.0, held=False)
    scheduler.change(near, 14.0, held=False, turned=True)
    assert "none" not in [done.cast_pass.steps for done in rest(scheduler)]
    scheduler.close()


def test_near_is_an_angle_and_a_distance(ball, layered):
    nearby, own = layered.nearby, layered.job.camera
    assert nearby.shows(own)
    towards = np.subtract(own.position_mm, own.target_mm)
    for ratio, near in ((1.2, True), (1.5, False), (0.6, False)):
        place = tuple((np.asarray(own.target_mm) + ratio * towards).tolist())
        assert nearby.shows(replace(own, position_mm=place)) == near
    assert not nearby.shows(replace(own, fov_deg=own.fov_deg + 1))


@pytest.fixture
def screen(context: Any) -> Iterator[Screen]:
    shown = Screen(context, lambda: None, Meter(Trace()), Notice())
    yield shown
    shown.close()


def drawn(screen: Screen, state: ViewState, held: bool = False) -> NDArray[np.int_]:
    screen.mark_stale()
    while screen.relight(state, held):
        pass
    with screen.pictures._context:
        return screen.pictures.pixels().astype(int)


def rested(screen: Screen, state: ViewState) -> NDArray[np.int_]:
    """Return the picture once what takes longer than a frame has been made."""
    drawn(screen, state)
    screen.tick(state, 0.0, held=False)
    wait_until(lambda: screen.idle.take() and screen.pictures.idle)
    return drawn(screen, state)


def assert_codes(one: NDArray[np.int_], other: NDArray[np.int_], most: int = 1) -> None:
    assert np.abs(one - other).max() <= most


def recomposed(image: CoefficientImage, state: ViewState) -> NDArray[np.int_]:
    """Return the picture of an image's layers with a state's opacities, cuts, fog and focus."""
    return relit(image.recompose(opacity_scales(state), state.depth), state)


def assert_recomposes(before: ViewState, new: ViewState, name: str) -> None:
    """A change costs no cast, and is a step of undo."""
    change = Difference.between(before, new)
    assert (change.stage, change.name, change.undoable) == ("recompose", name, True)


def test_a_picture_with_layers_shows_opacities_at_once(screen, ball):
    plain, layered = casts(ball, WHOLE, LAYERED)
    screen.take(plain, ball)
    assert not screen.idle.recomposes(ball)
    before = drawn(screen, ball)
    screen.take(layered, ball)
    assert screen.idle.recomposes(ball) and layered.image is not None
    np.testing.assert_array_equal(drawn(screen, ball), before)
    for scale in (0.2, 2.0, 0.0, 1.0):
        faded = opacities.set_opacity(ball, "grey", scale)
        assert_codes(drawn(screen, faded), recomposed(layered.image, faded))
        assert np.array_equal(drawn(screen, faded), before) == (scale == 1)
    # Fewer pixels while a slow picture is dragged, then all of them.
    faded = opacities.set_opacity(ball, "grey", 0.4)
    screen._meter.bands = 2
    assert drawn(screen, faded, held=True).shape == (SIZE[1] // 2, SIZE[0] // 2, 3)
    assert_codes(drawn(screen, faded), recomposed(layered.image, faded))
    screen.await_cast()
    assert not screen.idle.recomposes(faded)


def test_a_cast_stays_until_its_opacities_change(screen, ball):
    faded = opacities.set_opacity(ball, "grey", 0.3)
    plain, layered = casts(faded, WHOLE, LAYERED)
    screen.take(plain, faded)
    exact = drawn(screen, faded)
    screen.take(layered, faded)
    assert screen.idle.loading  # a step at each tick
    np.testing.assert_array_equal(drawn(screen, faded), exact)
    steps = 0
    while screen.idle.loading:
        screen.tick(faded, 0.0, held=True)
        steps += 1
    assert steps > 3 and screen.idle.recomposes(faded)
    np.testing.assert_array_equal(drawn(screen, faded), exact)
    more = opacities.set_opacity(ball, "grey", 0.2)
    assert_codes(drawn(screen, more), recomposed(layered.image, more))
    # A late cast of another view has no say.
    late = CastDone(layered.job, LAYERED, 0.0, layered.image, opacity=layered.opacity)
    screen.await_cast()
    screen.take(late, more, newest=False)
    assert not screen.idle.recomposes(more)


def test_values_under_the_mouse_are_those_of_the_recomposed_picture(screen, ball, layered):
    screen.take(layered, ball)
    faded = opacities.set_opacity(ball, "grey", 0.05)
    drawn(screen, faded)
    screen.probe(faded, (0.5, 0.5), held=False)
    assert screen.under_mouse is None  # until it is recomposed
    screen.tick(faded, 0.0, held=True)
    assert not screen.busy
    screen.tick(faded, 0.0, held=False)
    assert screen.busy
    wait_until(screen.idle.take)
    drawn(screen, faded)
    with screen.pictures._context:  # a window's stays current
        screen.probe(faded, (0.5, 0.5), held=False)
    shown = np.array(dict(screen.under_mouse.rows)["RGB"].split(), int)
    assert screen.under_mouse.rows[0] == ("Picture", "estimated from layers")
    assert_codes(shown, recomposed(layered.image, faded)[SIZE[1] // 2, SIZE[0] // 2])
    assert screen.image.opacity_layers is None


def test_opacities_that_layers_show_wrongly_are_cast(screen, ball, monkeypatch, layered):
    scheduler = CastScheduler(lambda: None)
    scheduler.change(ball, 0.0, held=False)
    screen.take(layered, ball)
    faded = opacities.set_opacity(ball, "grey", 0.05)
    take_until(scheduler.take, lambda _: not scheduler.busy)
    for visible, off in ((1e6, False), (0.0, True)):
        monkeypatch.setattr(idle_views, "VISIBLE", visible)
        faded = opacities.set_opacity(faded, "copper", 0.5 if off else 0.6)
        drawn(screen, faded)
        screen.tick(faded, 0.0, held=False)
        wait_until(screen.idle.take)
        assert (screen.idle.wants_cast(), screen.idle.wants_cast()) == (off, False)
    scheduler.cast_opacities(faded)
    (done,) = take_until(scheduler.take, lambda _: not scheduler.busy)
    scheduler.close()
    assert done.job.shading.opacities == opacity_scales(faded)
    screen.take(done, faded, scheduler.is_newest(done))
    assert done.image.opacity_layers is None and screen.idle.recomposes(faded)
    assert_codes(drawn(screen, faded), relit(done.image, faded))
    # The next change is recomposed again.
    more = opacities.set_opacity(faded, "copper", 0.4)
    assert_codes(drawn(screen, more), recomposed(layered.image, more))


def test_cuts_and_fog_are_recomposed_and_saved(screen, ball, tmp_path, layered):
    """You should see half a ball in fog."""
    screen.take(layered, ball)
    least, most = depth.limits_mm(ball)
    middle = 0.5 * (least + most)
    foggy = depth.set_fog(depth.set_cut(ball, middle, most), 2.0)
    fog_mm = (most - least) / 2
    assert foggy.depth == DepthEffects(near_mm=middle, fog_mm=fog_mm, fog_from_mm=least)
    assert_recomposes(ball, foggy, "depth")
    for state in (foggy, depth.set_cut(foggy, least, middle), depth.reset(foggy)):
        assert state.depth == depth.shown_depth(state)
        assert_codes(drawn(screen, state), recomposed(layered.image, state), most=2)
    export_scene(foggy, tmp_path / "foggy.toml")
    again = open_document(str(tmp_path / "foggy.toml"))
    assert again.shading.layers == 8
    assert again.file.depth.near_mm == pytest.approx(middle)
    assert np.abs(frame_of(foggy) - drawn(screen, foggy)).mean() < 2


def test_a_focus_is_shown_once_nothing_moves(screen, ball, tmp_path, layered):
    """You should see a ball that is sharp in front."""
    screen.take(layered, ball)
    image = layered.image
    least, most = depth.limits_mm(ball)
    focused = depth.set_focus(ball, least)
    assert depth.aperture_mm(focused) == least / 20
    focused = depth.set_aperture(focused, least)
    assert focused.depth == DepthEffects(focus_mm=least, aperture_mm=least / 4)
    assert_recomposes(ball, focused, "depth")
    plain = drawn(screen, ball)
    assert np.array_equal(drawn(screen, focused), plain)
    screen.tick(focused, 0.0, held=True)
    assert not screen.idle._worker.busy
    shown = rested(screen, focused)
    assert_codes(shown, recomposed(image, focused), most=2)
    assert np.abs(shown - plain).max() > 5
    # Lights change at once, and what is read is what is shown.
    other = replace(focused, lights=focused.lights[::-1])
    assert_codes(drawn(screen, other), recomposed(image, other), most=2)
    screen.probe(other, (0.5, 0.5), held=False)
    assert screen.under_mouse is not None
    faded = depth.set_cut(opacities.set_opacity(focused, "grey", 0.3), least, (least + most) / 2)
    assert_codes(rested(screen, faded), recomposed(image, faded), most=2)
    assert np.array_equal(drawn(screen, ball), plain)
    assert depth.set_focus(focused, None).depth == DepthEffects()
    export_scene(focused, tmp_path / "focused.toml")
    assert open_document(str(tmp_path / "focused.toml")).file.depth.focus_mm == pytest.approx(least)
    parallel = replace(ball, view=replace(ball.view, orthographic=True))
    assert depth.can_focus(ball) and not depth.can_focus(parallel)


def test_cuts_at_the_ends_are_none(ball):
    least, most = depth.limits_mm(ball)
    cut = depth.set_cut(ball, least + 1, most - 1)
    assert cut.depth.near_mm == least + 1 and cut.depth.far_mm == most - 1
    assert depth.set_cut(cut, least - 9, most + 9).depth == DepthEffects()
    crossed = depth.set_cut(ball, most + 5, least - 5).depth
    assert crossed.far_mm is None or crossed.near_mm < crossed.far_mm
    assert depth.set_fog(depth.set_fog(ball, 1.0), 0.0).depth == DepthEffects()
    focused = replace(ball, depth=DepthEffects(focus_mm=least))
    assert not depth.shown_depth(focused).changes and depth.can_be_set(focused)


def test_a_cast_image_with_layers_is_faded_and_saved(ball, tmp_path, layered):
    layered.image.save(tmp_path / "ball.exr")
    state = ViewState.first(open_document(str(tmp_path / "ball.exr")), (300, 300))
    assert quality.can_layer(state)
    scheduler = CastScheduler(lambda: None)
    scheduler.change(state, 0.0, held=False)
    (done,) = take_until(scheduler.take, lambda _: not scheduler.busy)
    scheduler.close()
    assert scheduler.is_newest(done) and done.opacity is not None
    faded = opacities.set_opacity(state, "grey", 0.1)
    assert without_cast(state, faded).state is faded
    turned = without_cast(state, camera.orbit(faded, 0.2, 0.0)).state
    assert turned.shading.opacities == {"grey": 0.1} and turned.view == state.view
    assert_codes(frame_of(faded), recomposed(state.document.image, faded))


def in_stereo(state: ViewState, layout: str) -> ViewState:
    return after(lambda given: depth.set_stereo(given, layout), state).state


def both_eyes(
    image: CoefficientImage, state: ViewState, size: tuple[int, int] = SIZE
) -> NDArray[np.int_]:
    stereo = Stereo(state.interface.stereo)
    found = replace(depth.shown_look(state), stereo=stereo).views(image)
    assert found[0].size == SIZE
    if size != SIZE:
        found = StereoViews(image).views(stereo, opacity_scales(state), None, size)
    eyes = (relit(eye, state).astype(np.uint8) for eye in found)
    return stereo.combine(*eyes, state.relight.viewing.display.colours).astype(int)


def test_the_window_shows_both_eyes_with_lights_opacities_and_fog(screen, ball, layered):
    image = layered.image
    screen.take(layered, ball)
    plain = drawn(screen, ball)
    state = in_stereo(ball, "anaglyph")
    assert np.array_equal(drawn(screen, state), plain)  # until they are there
    both = rested(screen, state)
    assert_codes(both, both_eyes(image, state), most=2)
    assert np.abs(both - plain).max() > 5
    assert_codes(both, frame_of(state), most=2)
    other = replace(state, lights=state.lights[::-1])
    assert_codes(drawn(screen, other), both_eyes(image, other), most=2)
    faded = depth.set_fog(opacities.set_opacity(state, "grey", 0.3), 1.0)
    assert_codes(rested(screen, faded), both_eyes(image, faded), most=2)
    assert (np.abs(drawn(screen, faded) - frame_of(faded)) > 3).mean() < 0.02
    assert not screen.side_by_side
    # Other opacities are shown at once, in one picture until the mouse is released.
    more = opacities.set_opacity(ball, "grey", 0.2)
    assert np.array_equal(drawn(screen, in_stereo(more, "anaglyph"), True), drawn(screen, more))
    screen.tick(in_stereo(more, "anaglyph"), 0.0, held=True)
    assert not screen.idle._worker.busy
    rested(screen, state)
    screen.probe(state, (0.5, 0.5), held=False)
    assert screen.under_mouse is None
    assert np.array_equal(drawn(screen, ball), plain)


def test_pictures_next_to_each_other_fit_the_window(screen, ball, layered):
    screen.take(layered, ball)
    state = in_stereo(ball, "side-by-side")
    both = rested(screen, state)
    saved, shown = frame_of(state), (SIZE[1] // 2, SIZE[0], 3)
    assert both.shape == saved.shape == shown and screen.side_by_side
    assert np.abs(both - saved).mean() < 2
    assert_codes(both, both_eyes(layered.image, state, (SIZE[0] // 2, SIZE[1] // 2)))
    painted = screen.painted_picture((10, 20, 4 * SIZE[0], 4 * SIZE[1]), state)
    assert painted.to == (10, 20 + SIZE[1], 10 + 4 * SIZE[0], 20 + 3 * SIZE[1])
    assert screen.point_mm((0.5, 0.5)) is None
    # A new cast shows its own picture first.
    screen.await_cast()
    assert drawn(screen, state).shape[:2] == SIZE[::-1] and not screen.side_by_side


def test_stereo_is_switched(state):
    on = in_stereo(state, "anaglyph")
    assert quality.can_layer(on) and depth.shown_stereo(on) == "anaglyph"
    assert left_out(on) == "stereo" and not left_out(state)
    assert in_stereo(on, "side-by-side").interface.stereo == "side-by-side"
    assert in_stereo(on, "anaglyph").interface.stereo == ""
    assert depth.shown_stereo(with_interface(on, error_map=True)) == ""


def test_images_of_other_spaces_are_mixed_as_by_the_library(screen, ball, layered):
    screen.take(layered, ball)
    display = replace(ball.relight.viewing.display, space="Display P3")
    state = in_stereo(seen(ball, display=display), "half-colour")
    assert_codes(rested(screen, state), both_eyes(layered.image, state), most=2)


@pytest.mark.slow
def test_a_slider_is_cast_when_it_is_released(window, tmp_path):
    window.open(small_engine(tmp_path))
    window.front("opacity")
    window.click("opacity eye block")  # the first makes the materials channels
    before = window.rest()
    window.steps([window.at("opacity block", share) for share in (0.1, 0.3, 0.6)], "relight")
    (cast,) = window.since(before, "cast", "error")
    assert cast["event"] == "cast" and cast["t"] > window.since(before, "release")[-1]["t"]
