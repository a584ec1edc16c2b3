"""Opacities in the page: sliders against new frames of the desktop, keys, sharing, notebooks."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.page.conftest import VIEWPORT, Opened, new_page, open_file
from tests.support.browser import mean_difference
from tests.support.commands import call
from tests.support.errors import raises, warns
from tests.support.fixtures import slow
from tests.twins.test_recompose import layered, rig
from volspec._gpu.sources import asset
from volspec.errors import ImageError
from volspec.export.page import PageView, build, page_html, scene_views, write_page
from volspec.export.page.packing import pack_layers
from volspec.image import CoefficientImage
from volspec.image.layers import residual_share
from volspec.relight import relight
from volspec.scene import Scene
from volspec.scene.tables.lights import NamedLight
from volspec.spectra import light

# Measured at 0.08 to 0.13 with its channels of 8 bits, as are pages without layers.
NEAR = 0.25
SIZE = 128, 96


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene.load(asset("data/scenes/engine-layers.toml"))


@pytest.fixture(scope="module")
def image(scene: Scene) -> CoefficientImage:
    return scene.render(size=SIZE)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, scene: Scene, image: CoefficientImage) -> Path:
    path = tmp_path_factory.mktemp("opacity") / "engine.html"
    write_page(path, [PageView(image)], scene.lights, scene.relight)
    return path


@pytest.fixture(scope="module")
def shared(browser: Any, file: Path) -> Iterator[Opened]:
    made = unpacked(open_file(new_page(browser), file))
    yield made
    made.page.context.close()


@pytest.fixture
def page(shared: Opened) -> Opened:
    """The page as it is opened, its layers unpacked."""
    shared.page.set_viewport_size(VIEWPORT)
    shared.show()
    return shared


def unpacked(page: Opened) -> Opened:
    page.until("!document.querySelector('#opacity-list input').disabled")
    return page


def slider(number: int) -> str:
    return f"#opacity-list li:nth-child({number + 1}) input"


def shown_scale(page: Opened, number: int) -> float:
    return float(page.page.get_attribute(slider(number), "data-scale"))


def drag(page: Opened, number: int, to: float) -> float:
    """Drag a slider to a fraction of its length with the mouse; return its scale."""
    track = page.page.locator(slider(number))
    track.scroll_into_view_if_needed()
    box, octave = track.bounding_box(), float(track.input_value())
    mouse, y = page.page.mouse, box["y"] + box["height"] / 2
    mouse.move(box["x"] + 8 + (box["width"] - 16) * (octave + 3.05) / 5.05, y)
    mouse.down()
    mouse.move(box["x"] + 8 + (box["width"] - 16) * to, y, steps=4)
    mouse.up()
    page.settle()
    return shown_scale(page, number)


def frame(
    image: CoefficientImage, scene: Scene, scales: dict[str, float], lamp: int = 0
) -> NDArray[np.uint8]:
    made = image.recompose(scales)
    return np.asarray(relight(made, scene.lights[lamp].rig, scene.relight), np.uint8)


@pytest.mark.slow
def test_scales_of_1_draw_the_page_of_today(opened, page, tmp_path, scene, image):
    path = tmp_path / "plain.html"
    plain = replace(image, opacity_layers=None)
    write_page(path, [PageView(plain)], scene.lights, scene.relight)
    today = opened(path)
    assert not today.page.locator("#opacity").is_visible()
    for weights in ("1,0,0,0,0", "0,0,0.5,1,0"):
        for each in (page, today):
            each.show(**{"a.weights": weights})
        np.testing.assert_array_equal(page.picture(), today.picture())
    # Also after another scale.
    drag(page, 0, 0.2)
    page.page.keyboard.press("Delete")
    page.settle()
    assert shown_scale(page, 0) == 1
    np.testing.assert_array_equal(page.picture(), today.picture())


@pytest.mark.parametrize("to", [slow((0.0, 0.6)), (0.35, 1.0), slow((0.7, 0.0))])
def test_a_slider_that_is_dragged_fades_as_a_new_frame_of_the_desktop(page, scene, image, to):
    scales = {name: drag(page, i, to[i]) for i, name in enumerate(("block", "inserts"))}
    assert len(set(scales.values())) == 2
    for lamp in (0, 3):
        page.click(f"#light-list li:nth-child({lamp + 1}) .light-name")
        wanted = frame(image, scene, scales, lamp)
        assert mean_difference(page.picture(), wanted) <= NEAR, (scales, lamp)
    assert page.complaints == []


@pytest.mark.slow
@pytest.mark.parametrize(("materials", "groups"), [slow(1, 1), slow(4, 1), slow(3, 2), (4, 8)])
def test_any_number_of_materials_and_groups_is_drawn(opened, tmp_path, materials, groups):
    """One texel a layer to eleven, and one pass of a slice to three of four."""
    image = layered(materials, groups)
    scales = dict(zip(image.basis.materials, (0.5, 1.0, 0.0, 2.0), strict=False))
    lights = [NamedLight("mixed", "", light("A"), rig(image))]
    path = tmp_path / "random.html"
    write_page(path, [PageView(image, opacities=scales)], lights)
    page = opened(path)
    wanted = np.asarray(relight(image.recompose(scales), rig(image)), np.uint8)
    assert mean_difference(page.picture(), wanted) <= 2 * NEAR, "noise, dark in many pixels"
    assert page.complaints == []


@pytest.mark.slow
def test_a_light_that_changes_recomposes_nothing(opened, file):
    count = """
        window.passes = 0;
        const attach = WebGL2RenderingContext.prototype.drawBuffers;
        WebGL2RenderingContext.prototype.drawBuffers = function (...what) {
            window.passes += 1;
            attach.apply(this, what);
        };"""
    page = unpacked(opened(file, before=count))
    page.press(slider(0), "ArrowLeft")
    # The difference at scale 1, once; then the slider's.
    assert page.page.evaluate("window.passes") == 2
    page.page.fill("#light-list li:nth-child(2) input", "0.5")
    page.page.fill("#exposure", "1")
    page.settle()
    assert page.page.evaluate("window.passes") == 2
    page.press(slider(0), "ArrowLeft")
    assert page.page.evaluate("window.passes") == 3


@pytest.mark.slow
def test_keys_names_and_double_clicks_set_opacities(page):
    name = page.page.locator("#opacity-list li:nth-child(1) .material")
    drag(page, 0, 0.3)
    scale = shown_scale(page, 0)
    assert 0.2 < scale < 0.5
    name.click()
    page.settle()
    assert shown_scale(page, 0) == 0 and name.get_attribute("aria-pressed") == "false"
    assert page.page.get_attribute(slider(0), "aria-valuetext") == "hidden"
    name.click()
    page.settle()
    assert shown_scale(page, 0) == scale
    page.page.dblclick(slider(0))
    page.settle()
    assert shown_scale(page, 0) == 1
    page.press(slider(1), "End")
    assert shown_scale(page, 1) == 4
    page.press(slider(1), "Home")
    assert shown_scale(page, 1) == 0
    assert "inserts\u2069 hidden" in page.page.text_content("#label-a")
    page.click("#opacity-reset")
    assert [shown_scale(page, i) for i in (0, 1)] == [1, 1]


def test_swatches_are_the_materials_under_the_light(page):
    """The engine's materials are alike under daylight, and apart under sodium."""
    page.show(**{"a.weights": "0,0,0,1,0"})
    style = "getComputedStyle(document.querySelectorAll('.swatch')[{}]).backgroundColor"
    page.until(f"{style.format(0)} !== {style.format(1)}")
    page.show()
    numbers = "{}.match(/\\d+/g).map(Number)"
    apart = (
        f"Math.max(...{numbers.format(style.format(0))}.map((v, i) => "
        f"Math.abs(v - {numbers.format(style.format(1))}[i])))"
    )
    page.until(f"{apart} <= 3")


def test_sides_have_opacities_of_their_own_and_the_probe_reads_them(page, scene, image):
    page.show(**{"compare": 1, "divide": 0.5, "a.opacity": "0,1", "b.opacity": "1,0.25"})
    got, middle = page.picture(), SIZE[0] // 2
    for part, scales in (
        (slice(0, middle), {"block": 0}),
        (slice(middle, None), {"inserts": 0.25}),
    ):
        wanted = frame(image, scene, scales)
        assert mean_difference(got[:, part], wanted[:, part]) <= NEAR
    made = image.recompose({"block": 0})
    y, x = np.unravel_index(np.argmax(made.alpha[:, :middle]), (SIZE[1], middle))
    page.show(**{"compare": 1, "a.opacity": "0,1", "probe": f"{x},{y}"})
    opacity = float(page.page.locator("#probe-rows dd").nth(1).text_content())
    assert opacity == pytest.approx(float(made.alpha[y, x]), abs=0.02)
    page.show(**{"a.opacity": "0,0", "probe": f"{x},{y}"})
    assert float(page.page.locator("#probe-rows dd").nth(1).text_content()) == 0


@pytest.mark.slow
def test_an_address_brings_opacities_back_and_rubbish_none(opened, file, page):
    scale = drag(page, 0, 0.25)
    page.until("location.hash.includes('a.opacity=')")
    again = unpacked(opened(file, page.page.evaluate("location.hash")))
    assert shown_scale(again, 0) == pytest.approx(scale, rel=1e-5)
    # An address has six digits of a scale.
    np.testing.assert_allclose(again.picture(), page.picture().astype(float), atol=1)
    for rubbish in ("-1,1", "1", "1,NaN", "1e9,1"):
        again.show(**{"a.opacity": rubbish})
        assert [shown_scale(again, i) for i in (0, 1)] == [1, 1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "reason"),
    [
        ("WebGL2RenderingContext.prototype.getExtension = () => null;", "cannot draw to half"),
        slow(
            "const had = WebGL2RenderingContext.prototype.getParameter;"
            "WebGL2RenderingContext.prototype.getParameter = function (what) {"
            "  return what === this.MAX_ARRAY_TEXTURE_LAYERS ? 4 : had.call(this, what); };",
            "no textures of 24 slices",
        ),
    ],
)
def test_a_browser_that_cannot_recompose_keeps_the_lights(opened, file, before, reason):
    page = opened(file, "#a.opacity=0,1", before=before)
    page.until("document.getElementById('opacity-status').textContent.includes('cannot be')")
    assert reason in page.page.text_content("#opacity-status")
    assert page.page.is_disabled(slider(0))
    before_light = page.picture()
    page.page.click("#light-list li:nth-child(2) .light-name")
    assert mean_difference(page.picture(), before_light) > 1
    assert page.complaints == []


@pytest.mark.slow
def test_layers_that_are_cut_off_leave_the_picture(opened, file, tmp_path):
    head, _, rest = file.read_text(encoding="utf-8").partition('id="layers">')
    path = tmp_path / "cut.html"
    path.write_text(f'{head}id="layers">{rest[:1000]}{rest[rest.index("</") :]}', encoding="utf-8")
    page = opened(path)
    page.until("document.getElementById('opacity-status').textContent.includes('unpacked')")
    assert page.page.is_disabled(slider(0)) and page.picture().std() > 10


def test_a_lost_device_is_filled_again(page):
    page.show(**{"a.opacity": "0.3,1"})
    before = page.picture()
    page.page.evaluate("""() => new Promise((done) => {
        const canvas = document.getElementById('picture');
        const lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context');
        canvas.addEventListener('webglcontextrestored', done);
        canvas.addEventListener('webglcontextlost', () => setTimeout(() => lose.restoreContext()));
        lose.loseContext();
    })""")
    page.eventually(lambda: np.array_equal(page.picture(), before), "the picture is back")


def test_a_notebook_sets_and_hears_opacities(browser, file, tmp_path):
    """The page in a frame, as host.js makes it, and a port in the place of the kernel."""
    outer = new_page(browser)
    outer.goto("about:blank")
    outer.evaluate(
        """(page) => new Promise((done) => {
            const frame = document.createElement('iframe');
            frame.sandbox = 'allow-scripts';
            frame.srcdoc = page;
            frame.style.cssText = 'width: 900px; height: 900px';
            frame.onload = () => {
                const { port1, port2 } = new MessageChannel();
                window.heard = {};
                port1.onmessage = ({ data }) => Object.assign(window.heard, data);
                frame.contentWindow.postMessage('volspec', '*', [port2]);
                port1.postMessage({ opacities: { block: 0.5, inserts: 1 }, probe: null });
                done();
            };
            document.body.append(frame);
        })""",
        file.read_text(encoding="utf-8"),
    )
    inner = outer.frame_locator("iframe")
    first = inner.locator("#opacity-list li:nth-child(1) input:enabled")
    first.wait_for()
    assert float(first.get_attribute("data-scale")) == 0.5
    inner.locator("#opacity-list li:nth-child(2) input").press("Home")
    Opened(outer).until("'opacities' in window.heard")
    heard = outer.evaluate("window.heard")
    assert heard["opacities"] == {"block": 0.5, "inserts": 0}
    # Only fields of Viewing, for the kernel.
    assert {"model", "lux"} <= {*heard["viewing"]} and not {"near", "focus"} & {*heard["viewing"]}
    outer.context.close()


def test_what_layers_lack_is_added_as_on_the_desktop(browser, web):
    rng = np.random.default_rng(3)
    given = [(2.0 ** rng.uniform(-2.5, 2.5, 3)).tolist() for _ in range(50)]
    given += [[1, 1, 0], [1, 1], [4, 1], [0.3]]
    code = (web / "recompose.js").read_text(encoding="utf-8")
    code += "const fades = (scales, k) => scales.map((_, i) => (i + k) % 3 > 0);"
    page = browser.new_page()
    each = "(scales, k) => residualShare(scales, fades(scales, k))"
    call = f"(given) => {{ class Refused {{}} {code}; return given.map({each}); }}"
    got = page.evaluate(call, given)
    page.close()
    wanted = [
        residual_share(scales, [(i + k) % 3 > 0 for i in range(len(scales))])
        for k, scales in enumerate(given)
    ]
    np.testing.assert_allclose(got, wanted, atol=1e-12)


def test_packed_layers_are_small_and_their_constants_the_shader_s(image):
    assert image.opacity_layers is not None
    packed = pack_layers(image.opacity_layers)
    constants = packed.constants()
    names = "COUNT", "MATERIALS", "GROUPS", "TEXELS", "CODED"
    assert [constants[name] for name in names] == [8, 2, 1, 3, 1]
    assert packed.present == (True, True) and 0 < packed.tau <= 32
    # 56 numbers of a pixel in less than 14 bytes.
    assert len(packed.data) < 14 * SIZE[0] * SIZE[1]


def test_several_views_are_written_without_layers_and_say_what_they_would_take(scene, image):
    views = [PageView(image), PageView(image, 90.0)]
    with warns("2 pictures", "MB"):
        text = page_html(views, scene.lights)
    assert 'id="layers"' not in text and '"opacity":null' in text


@pytest.mark.parametrize(
    ("limit", "least", "field"),
    [
        ("_MAX_LAYER_BYTES", 4 * 24 * SIZE[0] * SIZE[1] - 1, "page.layers"),
        ("_MAX_PAGE_BYTES", 1000, "page"),
    ],
)
def test_pages_too_large_for_browsers_are_refused(
    scene, image, tmp_path, monkeypatch, limit, least, field
):
    monkeypatch.setattr(build, limit, least)
    with raises(ImageError, "size", field):
        write_page(tmp_path / "large.html", [PageView(image)], scene.lights)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_command_s_layers(tmp_path, capsys):
    out, engine = tmp_path / "page.html", asset("data/scenes/engine-layers.toml")
    assert call("page", engine, "-o", out, "--size", "32x24", "--layers", "4") == 0
    assert "4 layers of opacity" in capsys.readouterr().out
    numbers = out.read_text(encoding="utf-8").partition('id="numbers">')[2].partition("</")[0]
    assert json.loads(numbers)["opacity"]["count"] == 4


@pytest.mark.slow
def test_a_scene_s_opacities_are_the_sliders_of_the_page_that_is_opened(
    opened, tmp_path, scene, image
):
    """A material that the scene hides can be shown."""
    hidden = scene.casting(opacities={"block": 0.0})
    views = list(scene_views(hidden, size=SIZE))
    path = tmp_path / "hidden.html"
    write_page(path, views, scene.lights, scene.relight)
    page = opened(path)
    assert [shown_scale(page, i) for i in (0, 1)] == [0, 1]
    assert mean_difference(page.picture(), frame(image, scene, {"block": 0})) <= NEAR
    page.press(slider(0), "Delete")
    assert mean_difference(page.picture(), frame(image, scene, {})) <= NEAR
