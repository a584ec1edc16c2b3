"""Cuts, fog, a lens, a small turn and two eyes in the page, against the desktop's pictures."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.page.test_access import PHONE, breaches
from tests.page.test_opacity import NEAR, file, page, scene, shared, unpacked
from tests.support.browser import mean_difference
from tests.support.fixtures import slow
from tests.support.raycasts import leaned
from volspec._gpu.sources import asset
from volspec.camera import Camera
from volspec.export.page import PageView, scene_views
from volspec.image import CoefficientImage, DepthEffects
from volspec.mesh.caster import MeshCaster
from volspec.mesh.shapes import shape_mesh
from volspec.pipeline import raycast
from volspec.relight import relight
from volspec.relight.look import Look
from volspec.relight.stereo import Stereo
from volspec.scene import Scene

__all__ = ["file", "page", "scene", "shared"]
SCENE = asset("data/scenes/engine-layers.toml")
SIZE = 160, 120
# Views of layers, against casts and against views that are splatted as other points.
TURNED, SPLATTED, LENS = 1.7, 0.6, 0.6
MIXED = {"block": 0.2, "inserts": 0.8}


@pytest.fixture(scope="module")
def image(scene: Scene) -> CoefficientImage:
    return scene.render(size=SIZE)


def frame(image: CoefficientImage, scene: Scene, lamp: int = 0) -> NDArray[np.uint8]:
    return np.asarray(relight(image, scene.lights[lamp].rig, scene.relight), np.uint8)


@pytest.mark.parametrize(
    ("words", "scales", "effects"),
    [
        slow({"a.near": "520"}, {}, DepthEffects(near_mm=520)),
        slow({"a.far": "520"}, {}, DepthEffects(far_mm=520)),
        (
            {"a.near": "480", "a.far": "600", "a.fog": "900", "a.opacity": "0.3,2"},
            {"block": 0.3, "inserts": 2.0},
            DepthEffects(near_mm=480, far_mm=600, fog_mm=900),
        ),
    ],
    ids=["near", "far", "all"],
)
def test_cuts_and_fog_are_the_desktop_s(page, scene, image, words, scales, effects):
    assert image.opacity_layers is not None
    begins = replace(effects, fog_from_mm=image.opacity_layers.range_mm[0])
    page.show(**words)
    wanted = frame(image.recompose(scales, begins), scene)
    assert mean_difference(wanted, frame(image, scene)) > 2 * NEAR
    # A cut opens what is steep: codes of a slab's ends are seen there.
    assert mean_difference(page.picture(), wanted) <= 2 * NEAR
    assert page.complaints == []


@pytest.mark.slow
@pytest.mark.parametrize(("across", "down"), [slow(4.0, 0.0), (-3.0, 2.5)])
def test_a_small_turn_is_near_a_cast(page, scene, image, across, down):
    assert image.camera is not None
    given = scene.volume(), scene.transfer, leaned(image.camera, across, down), SIZE
    cast = frame(raycast(*given, scene.raycast), scene)
    page.show(turn=f"{across},{down}")
    got = page.picture()
    assert mean_difference(got, cast) <= TURNED
    assert mean_difference(frame(image, scene), cast) > 2 * mean_difference(got, cast)
    # Also of other opacities.
    page.show(turn=f"{across},{down}", **{"a.opacity": "0,1"})
    without = raycast(*given, replace(scene.raycast, opacities={"block": 0.0}))
    assert mean_difference(page.picture(), frame(without, scene)) <= TURNED
    page.show()
    assert mean_difference(page.picture(), frame(image, scene)) <= NEAR


@pytest.mark.slow
def test_meshes_stay_and_are_cut_and_turned_where_they_are(scene, written):
    """A ball of two materials among the inserts, on a floor that reaches far."""
    pytest.importorskip("embreex")
    ball = shape_mesh("sphere", 60.0, "block").placed((150.0, 140.0, 50.0))
    shares = {name: np.full(len(ball.points_mm), part) for name, part in MIXED.items()}
    floor = shape_mesh("plane", 4000.0, "inserts").placed((133.0, 137.0, 115.0))
    caster = MeshCaster([replace(ball, material=shares), floor], scene.materials, scene.basis)
    volume = scene.volume()
    own = scene.camera(volume)

    def cast(camera: Camera = own, **changes: Any) -> CoefficientImage:
        spec = replace(scene.raycast, **changes)
        return raycast(volume, scene.transfer, camera, SIZE, spec, behind=[caster])

    image = cast()
    layers = image.opacity_layers
    assert layers is not None and layers.solid and layers.range_mm[1] > 800
    page = unpacked(written([PageView(image)], scene.lights, scene.relight))
    page.show(**{"a.opacity": "0,1"})
    new = frame(cast(layers=0, opacities={"block": 0.0}), scene)
    assert mean_difference(page.picture(), new) <= 2 * NEAR
    hidden = {"block": 0.0, "inserts": 0.0}
    ball_mm = np.nanmin(image.recompose(hidden).depth_mm)
    for near in (round(ball_mm - 4), round(ball_mm + 4)):
        page.show(**{"a.opacity": "0,0", "a.near": near})
        wanted = frame(image.recompose(hidden, DepthEffects(near_mm=near)), scene)
        assert mean_difference(page.picture(), wanted) <= 2 * NEAR  # a code of much floor
    page.show(turn="4,0", **{"a.opacity": "0,0"})
    turned = cast(leaned(own, 4.0, 0.0), layers=0, opacities=hidden)
    assert mean_difference(page.picture(), frame(turned, scene)) <= TURNED
    assert page.complaints == []


@pytest.mark.slow
def test_an_anaglyph_and_a_pair_are_of_the_desktop_s_eyes(page, scene, image):
    effects = DepthEffects(near_mm=480)
    look = Look(opacities={"block": 0.5}, depth=effects, stereo=Stereo("anaglyph"))
    eyes = [frame(eye, scene) for eye in look.views(image)]
    words = {"a.opacity": "0.5,1", "a.near": "480"}
    page.show(stereo="anaglyph", **words)
    wanted = Stereo("anaglyph").combine(*eyes)
    assert mean_difference(page.picture(), wanted) <= SPLATTED
    assert mean_difference(page.picture(), Stereo("anaglyph").combine(*eyes[::-1])) > SPLATTED
    page.show(stereo="pair", **words)
    got, (width, height) = page.picture(), (side // 2 for side in SIZE)
    top = height // 2
    assert not got[:top].any() and not got[top + height :].any()
    for eye, left in zip(eyes, (0, width), strict=True):
        part = got[top : top + height, left : left + width]
        assert mean_difference(part, eye[::2, ::2]) <= SPLATTED
    assert page.complaints == []


RESTS = "document.getElementById('picture').getAttribute('aria-busy') === 'false'"


@pytest.mark.slow
@pytest.mark.parametrize(("focus", "aperture"), [(470, None), slow(620, 60)])
def test_a_lens_is_refined_to_the_desktop_s(page, scene, image, focus, aperture):
    words = {"a.focus": str(focus)} | ({"a.aperture": str(aperture)} if aperture else {})
    effects = DepthEffects(focus_mm=focus, aperture_mm=aperture)
    lit = image.recompose({}, effects)
    wanted = frame(lit, scene)
    page.show(**words)
    page.until(RESTS)
    got = page.picture()
    assert mean_difference(got, wanted) <= LENS
    assert mean_difference(frame(image, scene), wanted) > 1.5 * mean_difference(got, wanted)
    assert page.output("focus") == f"{focus} mm"
    # Lights change what is there; a lens that is taken off leaves no trace.
    page.show(**words, **{"a.weights": "0,1,0,0,0"})
    assert mean_difference(page.picture(), frame(lit, scene, 1)) <= LENS
    page.page.locator("#lens").uncheck()
    page.show()
    assert mean_difference(page.picture(), frame(image, scene)) <= NEAR
    assert page.complaints == []


@pytest.mark.slow
def test_a_lens_is_switched_on_in_the_middle(page, image):
    assert image.opacity_layers is not None
    assert page.page.locator("#focus").is_disabled()
    page.page.locator("#lens").check()
    page.settle()
    assert page.value("focus") == pytest.approx(sum(image.opacity_layers.range_mm) / 2, rel=0.01)
    assert page.output("aperture") == "f/20"
    page.press("#aperture", "End")
    assert page.output("aperture") == "f/4.0"
    page.until("location.hash.includes('a.aperture=')")
    page.click("#depth-reset")
    assert not page.page.locator("#lens").is_checked()


@pytest.mark.slow
def test_a_lens_that_is_taken_off_half_way_is_waited_for_no_more(page):
    """Also that of a side that is no longer shown, which saving a picture would wait for."""
    page.page.evaluate("location.hash = 'compare=1&b.focus=600'")
    page.settle()
    page.show(**{"a.focus": "500"})
    page.until("document.getElementById('label-a').textContent.includes('focus 500 mm')")
    page.until(RESTS)
    assert page.picture().std() > 10
    page.show(**{"a.focus": "500", "stereo": "anaglyph"})
    assert page.page.locator("#focus").is_disabled() and page.page.locator("#lens").is_disabled()
    # The cuts do not cross.
    page.show(**{"a.far": "500"})
    page.press("#near", "End")
    assert 480 < page.value("near") < 500


@pytest.mark.slow
def test_a_drag_and_keys_turn_and_reset_turns_back(page, image):
    before = page.picture()
    page.drag(0.1 * page.page.locator("#port").bounding_box()["width"], 0)
    page.settle()
    assert page.value("turn-across") == pytest.approx(3, abs=0.1)
    assert mean_difference(page.picture(), before) > 0.5
    page.press("#port", "Shift+PageDown")
    assert page.value("turn-down") == -1
    page.page.locator("#turn-across").dblclick()
    page.settle()
    assert page.value("turn-across") == 0
    page.click("#depth-reset")
    np.testing.assert_array_equal(page.picture(), before)


def test_sliders_of_cuts_and_fog_say_what_they_cut(page, image):
    assert image.opacity_layers is not None
    least, most = image.opacity_layers.range_mm
    for name, key, mm in (("near", "End", most), ("far", "Home", least)):
        page.press(f"#{name}", key)
        row = page.page.locator(f".row:has(#{name}) output")
        number, unit = row.text_content().split()
        assert unit == "mm" and abs(float(number) - mm) < 1.0  # in whole steps of the slider
        page.press(f"#{name}", "Delete")
        assert row.text_content() == "off"
    page.page.locator("#fog").press("ArrowRight")
    page.until("location.hash.includes('a.fog=')")
    for rubbish in ("-5", "x", "0"):
        page.show(**{"a.fog": rubbish, "a.far": rubbish, "turn": f"{rubbish},99"})
        assert page.output("fog") == "off"
        assert page.value("turn-across") == 0


@pytest.mark.slow
def test_a_scene_s_depth_opens_the_page(written, scene, image):
    effects = DepthEffects(near_mm=500, fog_mm=2000, fog_white=0.3, focus_mm=520)
    page = written([PageView(image, depth=effects)], scene.lights, scene.relight)
    page.until(RESTS)
    assert mean_difference(page.picture(), frame(image.recompose({}, effects), scene)) <= LENS
    own = Scene(replace(scene.file, depth=effects), SCENE)
    assert [view.depth for view in scene_views(own, size=(32, 24))] == [effects]


@pytest.mark.slow
def test_a_picture_that_does_not_know_its_camera_is_not_turned(written, scene, image):
    view, words = PageView(replace(image, camera=None)), "#turn=3,0&stereo=anaglyph&a.near=520"
    page = unpacked(written([view], scene.lights, scene.relight, words=words))
    assert not page.page.locator("#turn-rows").is_visible()
    assert page.page.locator("#near").is_visible()
    wanted = frame(image.recompose({}, DepthEffects(near_mm=520)), scene)
    assert mean_difference(page.picture(), wanted) <= 2 * NEAR


@pytest.mark.slow
def test_axe_finds_nothing_wrong_with_depth_and_opacity(page):
    page.show(stereo="pair", **{"a.fog": "300", "a.opacity": "0,2"})
    # What is scrolled has colours that axe does not find.
    page.page.evaluate("document.querySelector('.panel').scrollTo(0, 0)")
    for width, height in (PHONE, (1280, 1500)):
        page.page.set_viewport_size({"width": width, "height": height})
        page.settle()
        assert page.page.evaluate("document.documentElement.scrollWidth") <= width
    assert breaches(page.page) == []
