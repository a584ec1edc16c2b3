"""The page in a browser, from its file on disk: colours, network, words, state, access."""

import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.page.conftest import Frame, Opened, new_page, open_file
from tests.support.browser import mean_difference
from tests.support.fixtures import slow, slow_each
from tests.support.images import image, named_lights
from volspec.appearance.adaptation import ADAPTATIONS
from volspec.appearance.models import ciecam02
from volspec.appearance.scene_to_display import CLOSED
from volspec.basis import SpectralBasis
from volspec.export.page import PageSpec, PageView, scene_bars, write_page
from volspec.export.value_bars import value_bars
from volspec.image import CoefficientImage
from volspec.relight import Illumination, Relighter
from volspec.relight.difference_maps import error_map
from volspec.scene import Scene
from volspec.spectra import light, reflectance

BAD_TITLE = "</script><b id=hurt>\"'&amp; \u202egnisrever"


@pytest.fixture(scope="module")
def files(
    tmp_path_factory: pytest.TempPathFactory, engine_scene: Scene, engine_image: CoefficientImage
) -> Path:
    """Pages of the engine: ``8.html``, ``12.html``, ``turn.html`` and ``beat.html``."""
    folder = tmp_path_factory.mktemp("pages")
    lights, seen = engine_scene.lights, engine_scene.relight
    views = [PageView(engine_image)]
    for bits in (8, 12):
        spec = PageSpec(BAD_TITLE, "A caption", bits)
        write_page(folder / f"{bits}.html", views, lights, seen, spec)
    turned = {
        name: np.ascontiguousarray(getattr(engine_image, name)[:, ::-1])
        for name in ("coefficients", "alpha")
    }
    views += [PageView(replace(engine_image, **turned), 180.0), PageView(engine_image, 270.0)]
    write_page(folder / "turn.html", views, lights, seen)
    steps = [replace(view, step=step) for step in (0, 1) for view in views[step : step + 2]]
    write_page(folder / "beat.html", steps, lights, seen, PageSpec(fps=4))
    return folder


@pytest.fixture(scope="module")
def engine_page(browser: Any, files: Path) -> Iterator[Opened]:
    made = open_file(new_page(browser), files / "8.html")
    yield made
    made.page.context.close()


@pytest.fixture(scope="module")
def desktop(engine_scene: Scene, engine_image: CoefficientImage) -> Frame:
    """The desktop's frame under a light of the scene; with another look, and other viewing."""

    def frame(lamp: int = 0, look: dict[str, Any] | None = None, **viewing: Any) -> Any:
        seen = replace(engine_scene.relight.viewing, **viewing)
        seen = replace(engine_scene.relight, viewing=seen, **look or {})
        with Relighter(engine_image) as relighter:
            return relighter.frame(engine_scene.lights[lamp].rig, seen)

    return frame


def only(lamp: int) -> str:
    """Weights of a light of the engine's five alone."""
    return ",".join("1" if i == lamp else "0" for i in range(5))


# Eight bits were measured at 0.11 to 0.16 on the engine at 512², twelve at 0.01, each with the
# display's own rounding.
EIGHT, TWELVE = 0.4, 0.05


@pytest.mark.slow
def test_twelve_bits_give_the_desktops_frames_under_five_lights(opened, files, desktop):
    page = opened(files / "12.html")
    for lamp in range(5):
        page.show(**{"a.weights": only(lamp)})
        assert mean_difference(page.picture(), desktop(lamp)) <= TWELVE, lamp
    assert page.complaints == []


def test_the_screen_shows_the_desktops_frames_under_three_lights(engine_page, desktop):
    """A browser that is slow shows every second row and column first."""
    page = engine_page.page
    engine_page.show()
    for lamp in (1, 3, 0):
        page.click(f"#light-list li:nth-child({lamp + 1}) .light-name")
        page.mouse.move(0, 0)
        wanted = desktop(lamp)
        # Above and below are captions and buttons.
        rows = slice(len(wanted) // 5, -len(wanted) // 5)

        def is_shown(wanted: NDArray[np.uint8] = wanted, rows: slice = rows) -> bool:
            box, sides = page.locator("#frame").bounding_box(), ("height", "width")
            y, x = (
                (box[start] + (np.arange(count) + 0.5) * box[side] / count).astype(int)
                for start, side, count in zip("yx", sides, wanted.shape, strict=False)
            )
            window = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
            return mean_difference(window[np.ix_(y, x)][rows], wanted[rows]) <= EIGHT

        engine_page.eventually(is_shown, f"the frame of light {lamp}")


@pytest.mark.parametrize(
    "model", [*CLOSED, *list(ADAPTATIONS)[:1], *slow_each(*list(ADAPTATIONS)[1:])]
)
def test_every_model_gives_the_desktops_frame(engine_page, desktop, model):
    words = {"a.model": model, "a.L_A": 20, "a.Y_b": 35, "a.surround": 0.1, "a.mode": "exact"}
    engine_page.show(**words, **{"a.weights": only(1), "a.backdrop": 0.3})
    viewing = {"model": model, "L_A": 20.0, "Y_b": 35.0, "surround": "dim"}
    wanted = desktop(1, {"mode": "exact", "backdrop": 0.3}, **viewing)
    assert mean_difference(engine_page.picture(), wanted) <= EIGHT


def test_colour_vision_is_simulated_as_on_the_desktop(engine_page, desktop):
    row = engine_page.page.locator("#severity-row")
    engine_page.show()
    assert not row.is_visible()
    for deficiency, severity in (("protan", 1.0), ("deutan", 0.35), ("tritan", 0.8)):
        engine_page.show(**{"a.deficiency": deficiency, "a.severity": severity})
        assert row.is_visible() and engine_page.page.input_value("#deficiency") == deficiency
        wanted = desktop(deficiency=deficiency, severity=severity)
        assert mean_difference(engine_page.picture(), wanted) <= EIGHT, deficiency
        assert deficiency in engine_page.page.text_content("#label-a")


def test_two_settings_stand_on_the_sides_of_the_divide(engine_page, desktop):
    words = {"compare": 1, "divide": 0.25, "b.model": "none", "b.weights": only(3)}
    engine_page.show(**words)
    got, left, right = engine_page.picture(), desktop(), desktop(3, model="none")
    quarter = got.shape[1] // 4
    assert mean_difference(got[:, :quarter], left[:, :quarter]) <= EIGHT
    assert mean_difference(got[:, quarter:], right[:, quarter:]) <= EIGHT


def test_bars_of_values_have_the_exports_colours_and_numbers(written, engine_scene, engine_image):
    scene, volume = engine_scene.exporting(annotate=["values"]), engine_scene.volume()
    (bar,), how = scene_bars(scene, volume), (scene.relight, scene.raycast.shares())
    assert scene_bars(engine_scene, volume) == ()
    gap = np.where(np.arange(64)[:, None] == 9, np.nan, bar.colours)
    views = [PageView(engine_image, values=[bar, replace(bar, title="I · V", colours=gap)])]
    page = written(views, scene.lights, scene.relight)
    codes = """[...document.querySelectorAll('#values canvas')].map((each) => (
        [...each.getContext('2d').getImageData(0, 0, 64, each.height).data]))"""

    def are_shown(*lamps: int) -> bool:
        shown = np.array(page.page.evaluate(codes)).reshape(2, -1, 64, 4)
        rows = (
            value_bars(scene.transfer, volume, scene.basis, scene.lights[lamp].rig, *how)[0].colours
            for lamp in lamps
        )
        wanted = 255 * np.stack([*rows])
        opaque = shown[..., 3] == 255
        if len(shown[0]) != len(wanted) or np.any(opaque[:, :, 9] != [[True], [False]]):
            return False
        return bool(np.abs(shown[..., :3] - wanted)[opaque].max() <= 2)

    words = " ".join(page.page.locator("#values").inner_text().split())
    assert words == "100 150 200 250 I · V 100 150 200 250"
    for lamp in (1, 3):
        page.show(**{"a.weights": only(lamp)})
        page.eventually(lambda lamp=lamp: are_shown(lamp), f"the bars under light {lamp}")
    page.show(compare=1, **{"a.weights": only(1), "b.weights": only(3)})
    page.eventually(lambda: are_shown(1, 3), "both sides' bars")
    assert page.complaints == []


def test_the_error_map_has_the_desktops_figures(written):
    basis = SpectralBasis.load("general-5")
    samples = basis.analyse([reflectance(f"CES/{number}") for number in range(1, 82)])
    chart = image(samples.reshape(9, 9, 5), basis)
    spec = PageSpec(bits=12)
    page = written([PageView(chart)], named_lights(["FL2"]), spec=spec, words="#errors=1")
    page.until("document.getElementById('heat-figures').textContent !== ''")
    said = page.page.text_content("#heat-figures")
    mean, most = (float(word) for word in re.findall(r"(?:mean|max) ([\d.]+)", said))
    wanted = error_map(chart, light("FL2"))
    # Twelve bits move a colour by 0.015.
    assert wanted.mean > 0.3
    assert abs(mean - wanted.mean) < 0.02 and abs(most - wanted.max) < 0.05


@pytest.mark.slow
def test_the_picture_fills_a_phone_held_sideways_and_its_backdrop_goes_on_around_it(opened, files):
    page = opened(files / "8.html")
    page.page.set_viewport_size({"width": 844, "height": 390})
    page.settle()
    stage, panel = (page.page.locator(name).bounding_box() for name in (".stage", ".panel"))
    assert stage["width"] > 844 / 2 and panel["x"] >= stage["x"] + stage["width"] - 1
    assert stage["height"] > 0.8 * 390
    around = "getComputedStyle(document.getElementById('port')).backgroundColor"
    page.until(f"{around} !== 'rgba(0, 0, 0, 0)'")
    before = page.page.evaluate(around)
    assert before == f"rgb({', '.join(map(str, page.picture()[0, 0]))})"
    page.show(**{"a.backdrop": 0.9})
    page.until(f"{around} !== '{before}'")
    page.show(compare=1)
    page.until(f"{around} === 'rgba(0, 0, 0, 0)'")


def test_other_views_are_turned_to(opened, files, desktop):
    page, wanted = opened(files / "turn.html"), desktop()
    assert mean_difference(page.picture(), wanted) <= EIGHT
    page.press("#port", "PageDown")
    page.until("document.getElementById('view-read').textContent === '180\u00b0'")
    # It is drawn once it is unpacked, which nothing on the page shows.
    page.eventually(
        lambda: mean_difference(page.picture(), wanted[:, ::-1]) <= EIGHT, "the other side"
    )


def test_time_steps_are_shown_and_played(opened, files):
    page = opened(files / "beat.html")
    shown = "document.getElementById('step-read').textContent"
    turned = "document.getElementById('view-read').textContent"
    page.press("#port", "PageDown")
    page.until(f"{turned} === '180°' && {shown} === '1 / 2'")
    page.page.keyboard.press(".")
    page.until(f"{turned} === '270°' && {shown} === '2 / 2'")
    page.page.keyboard.press("PageDown")
    page.until(f"{turned} === '180°' && {shown} === '2 / 2'")
    page.page.click("#play")
    page.until(f"{shown} === '1 / 2'")
    page.until(f"{shown} === '2 / 2'")
    assert page.page.text_content("#play") == "Pause"
    page.page.fill("#step", "0")  # which stops it
    page.until(f"{shown} === '1 / 2' && document.getElementById('play').textContent === 'Play'")
    assert page.complaints == []


@pytest.mark.slow
def test_a_view_that_cannot_be_unpacked_leaves_the_one_before(opened, files, tmp_path):
    text = (files / "turn.html").read_text(encoding="utf-8")
    cut, count = re.subn(r'(id="view-1"[^>]*>[^<]{1000})[^<]*', r"\1", text)
    assert count == 1
    (tmp_path / "cut.html").write_text(cut, encoding="utf-8")
    page = opened(tmp_path / "cut.html")
    before = page.picture()
    page.press("#port", "PageDown")
    page.until("!document.getElementById('notice').hidden")
    assert page.page.text_content("#notice").startswith("This view cannot be unpacked: ")
    page.until("document.getElementById('view-read').textContent === '0\u00b0'")
    assert mean_difference(page.picture(), before) == 0
    # And it can still be relit.
    page.page.click("#light-list li:nth-child(2) .light-name")
    assert mean_difference(page.picture(), before) > 1
    # Another that can be unpacked is turned to, and what was said is gone.
    page.press("#port", "PageUp")
    page.until("document.getElementById('view-read').textContent === '270\u00b0'")
    page.until("document.getElementById('notice').hidden")


def test_a_page_asks_the_network_for_nothing(engine_page):
    local = ("file:", "data:", "blob:")
    assert [url for url in engine_page.requests if not url.startswith(local)] == []
    policy = engine_page.page.get_attribute("meta[http-equiv]", "content")
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy and "http" not in policy
    # The policy is at work: what it forbids fails.
    blocked = "fetch('https://example.org/').then(() => 'through', () => 'blocked')"
    assert engine_page.page.evaluate(blocked) == "blocked"


def test_words_of_users_stay_words(engine_page, files):
    page = engine_page.page
    assert page.title() == BAD_TITLE
    assert page.text_content("h1") == BAD_TITLE
    assert page.query_selector("#hurt") is None
    page.click("#share")
    snippet = page.input_value("#share-snippet")
    page.keyboard.press("Escape")
    parsed = "new DOMParser().parseFromString(text, 'text/html')"
    title = f"(text) => {parsed}.querySelector('iframe').title"
    # Parsed outside the reach of the page's policy.
    assert page.context.new_page().evaluate(title, snippet) == BAD_TITLE
    assert b"\xe2\x80\xae" not in (files / "8.html").read_bytes()


def test_an_address_brings_a_picture_back(opened, files, engine_page):
    engine_page.show(**{"a.weights": "0.5,1,0,0,0.25", "a.model": "CAM16", "a.exposure": 0.7})
    engine_page.page.fill("#light-list li:nth-child(1) input", "0.8")
    engine_page.until("location.hash.includes('0.8,1,0,0,0.25')")
    words = engine_page.page.evaluate("location.hash")
    again = opened(files / "8.html", words)
    assert again.page.input_value("#model") == "CAM16"
    assert mean_difference(again.picture(), engine_page.picture()) == 0.0


def test_an_address_holds_although_an_edit_before_writes_over_it(engine_page):
    words = "location.hash = 'a.exposure=0.5'; history.replaceState(null, '', '#a.exposure=0.25')"
    engine_page.page.evaluate(f"() => {{ {words}; }}")
    engine_page.settle()
    assert engine_page.output("exposure") == "−1.00 EV"
    engine_page.until("location.hash === '#a.exposure=0.5'")


def test_rubbish_in_an_address_is_left_aside(opened, files, desktop):
    words = "#a.weights=1,NaN&a.model=constructor&a.exposure=1e99&view=7&probe=-1,x&a.solo=1e3&%%%"
    page = opened(files / "8.html", words)
    assert mean_difference(page.picture(), desktop()) <= EIGHT
    assert page.complaints == []


def test_the_keyboard_reads_pixels_aloud(engine_page, engine_scene, engine_image):
    engine_page.show()
    page = engine_page.page
    page.focus("#port")
    for key in ("ArrowLeft", "Shift+ArrowLeft", "ArrowUp"):
        page.keyboard.press(key)
    engine_page.settle()
    # What is said comes after a pause, and is then of the pixel that is shown.
    engine_page.until(
        "document.getElementById('probe-status').textContent"
        ".includes(document.querySelector('#probe-rows dd')?.textContent ?? '?')"
    )
    said = dict(part.split(" ", 1) for part in page.text_content("#probe-status").split("; "))
    x, y = (int(word) for word in said["Pixel"].split(", "))
    seen = engine_scene.relight
    lit = Illumination.of(engine_image.basis, engine_scene.lights[0].rig, seen)
    XYZ = lit.scene_XYZ(engine_image.coefficients[y, x], engine_image.alpha[y, x])
    look = ciecam02.forward(XYZ, seen.viewing.conditions(lit.white_XYZ))
    rows = (page.locator(f"#probe-rows {part}").all_text_contents() for part in ("dt", "dd"))
    shown = dict(zip(*rows, strict=True))
    J, C, _ = shown["J C h"].split()
    # Half a step of eight bits moves J by a few tenths.
    assert abs(float(J) - float(look.J)) < 0.5 and abs(float(C) - float(look.C)) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "reason"),
    [
        ("HTMLCanvasElement.prototype.getContext = () => null;", "no WebGL 2"),
        slow(
            "WebGL2RenderingContext.prototype.getParameter = () => 64;",
            "128 pixels long; this browser draws up to 64",
        ),
        slow("delete window.DecompressionStream;", "too old"),
    ],
)
def test_a_browser_that_cannot_shows_the_still_picture(opened, files, before, reason):
    page = opened(files / "8.html", before=before, ready="still").page
    assert reason in page.text_content("#notice")
    assert page.is_visible("#still") and not page.is_visible("#picture")
    assert page.is_disabled("#model")
