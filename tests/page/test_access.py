"""A page for everybody: axe-core's rules, and what it cannot see: focus, order, names, room."""

import io
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from tests.page.conftest import Open, Opened, new_page, open_file
from tests.support.fixtures import slow, slow_each
from tests.support.images import image, named_lights
from volspec.appearance.display.spaces import SPACES
from volspec.basis import SpectralBasis
from volspec.export.page import PageSpec, PageView, write_page
from volspec.export.value_bars import ValueBar
from volspec.spectra import reflectance

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22a", "wcag22aa", "best-practice"]
# Every control shown and able: two sides, a pixel, own values, errors.
ALL_ON = {"compare": 1, "probe": "9,9", "errors": 1, "a.L_A": 20, "a.D": 0.4}
WIDE, PHONE = (1280, 1440), (360, 740)
DARK_OR_FORCED = slow_each("dark", "light forced", "dark forced")
MEDIA = pytest.mark.parametrize("media", ["light", *DARK_OR_FORCED])
# Words whose ground is the picture, or a drawing: `_CONTRASTS` reads them.
ON_PICTURE = ".label, #probe dt, #probe dd, #dial text"
CONTROLS = "button, input, select, textarea, [tabindex]"


@pytest.fixture(scope="module")
def balls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of a ball that nobody cast, from 36 sides, under three lights."""
    basis, (y, x) = SpectralBasis.load("general-5"), np.mgrid[-1:1:18j, -1.4:1.4:24j]
    alpha = (np.hypot(x, y) < 0.9).astype(np.float32)
    ball = image(alpha[..., None] * basis.analyse(reflectance("copper")), basis, alpha)
    lights = [
        replace(each, label=f"lamp {each.name}") for each in named_lights(["D65", "A", "FL2"])
    ]
    bars = [ValueBar("Ball · mV", -1.5, 9e4, np.ones((64, 5)))]
    path = tmp_path_factory.mktemp("access") / "balls.html"
    views = [PageView(ball, 10.0 * i, values=bars) for i in range(36)]
    write_page(path, views, lights, spec=PageSpec("Ball", "Copper from all sides"))
    return path


@pytest.fixture(scope="module")
def one_page(browser: Any, balls: Path) -> Iterator[Opened]:
    made = open_file(new_page(browser), balls)
    yield made
    made.page.context.close()


@pytest.fixture
def ball(one_page: Opened) -> Iterator[Open]:
    """The page in a state, at a size, under a browser's preferences."""

    def put(size: tuple[int, int] = WIDE, media: str = "", **words: object) -> Opened:
        one_page.page.set_viewport_size({"width": size[0], "height": size[1]})
        scheme = "light" if "light" in media else "dark"
        forced = "active" if "forced" in media else "none"
        # Colours halfway from one scheme to the other have no contrast.
        one_page.page.emulate_media(
            color_scheme=scheme, forced_colors=forced, reduced_motion="reduce"
        )
        one_page.show(**words)
        return one_page

    yield put
    one_page.page.evaluate("document.getElementById('share-dialog').close()")
    one_page.page.evaluate("document.activeElement.blur()")


def breaches(page: Any) -> list[str]:
    """Violations by axe-core, and what it leaves undecided and no test here decides."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    rules = {"runOnly": {"type": "tag", "values": RULES}}
    found = axe.run(page, options=rules).response
    assert len(found["passes"]) > 15
    ours = "([where, words]) => document.querySelector(where).matches(words)"
    undecided = [
        (rule, node)
        for rule in found["incomplete"]
        for node in rule["nodes"]
        if rule["id"] != "color-contrast"
        or not page.evaluate(ours, [node["target"][0], ON_PICTURE])
    ]
    wrong = [(rule, node) for rule in found["violations"] for node in rule["nodes"]]
    return [f"{rule['id']}: {node['target']}" for rule, node in wrong + undecided]


@pytest.mark.parametrize(
    ("size", "media", "words"),
    [
        slow(WIDE, "light", {"a.weights": "0,0,0"}),
        slow(WIDE, "dark", ALL_ON),
        (PHONE, "light", ALL_ON),
        slow(PHONE, "dark", {"view": 7}),
        slow(WIDE, "dark forced", ALL_ON),
        slow(WIDE, "light forced", {"a.weights": "0,0,0", "a.discount": 1}),
    ],
)
def test_axe_finds_nothing_wrong(ball, size, media, words):
    assert breaches(ball(size, media, **words).page) == []


@pytest.mark.parametrize("size", [slow(WIDE), PHONE])
def test_axe_finds_nothing_wrong_with_sharing(ball, size):
    page = ball(size).page
    page.click("#share")
    assert breaches(page) == []
    page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement.id") == "share", "focus comes back"


@pytest.mark.slow
def test_axe_finds_nothing_wrong_with_the_still_picture(opened, balls):
    page = opened(balls, before="delete window.DecompressionStream;", ready="still").page
    assert breaches(page) == []
    assert controls(page) == [] and ("image", "Ball") in exposed(page)


@MEDIA
def test_words_on_the_picture_can_be_read_on_any_picture(ball, media):
    """Contrast that axe leaves undecided: 4.5 : 1 over black and over white."""
    ratios = ball(WIDE, media, **ALL_ON).page.evaluate(_CONTRASTS, ON_PICTURE)
    assert len(ratios) > 10
    assert [pair for pair in ratios if pair[1] < 4.5] == []


# Of each text on the picture or the dial: its first letters, and its least contrast.
_CONTRASTS = """(words) => {
    const numbers = (words) => (words.match(/[\\d.]+/g) ?? [0, 0, 0, 0]).map(Number);
    const luminance = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
        .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
        .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
    const over = (element, ground) => {
        if (element.id === 'port' || element === document.documentElement) return ground;
        const below = over(element.parentElement, ground);
        const [r, g, b, a = 1] = numbers(getComputedStyle(element).backgroundColor);
        return [r, g, b].map((v, i) => a * v + (1 - a) * below[i]);
    };
    const least = (element) => Math.min(...[0, 255].map((grey) => {
        const style = getComputedStyle(element);
        const ink = luminance(numbers(element.closest('svg') ? style.fill : style.color));
        const paper = luminance(over(element, [grey, grey, grey]));
        return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
    }));
    return [...document.querySelectorAll(words)]
        .filter((element) => element.getClientRects().length)
        .map((element) => [element.textContent.slice(0, 12), least(element)]);
}"""


def test_every_control_has_a_name_of_its_own(ball):
    page = ball(WIDE, **ALL_ON).page
    names = controls(page)
    assert len(names) > 30 and all(names) and len(set(names)) == len(names)
    assert "Illuminance" in names, "a slider's value is no part of its name"
    assert any(name.startswith("\u2068Ball\u2069 under") for name in names)
    page.click("#share")
    shared = controls(page)
    assert len(shared) == len(set(shared)) == 6 and all(shared)
    ids = page.evaluate("[...document.querySelectorAll('[id]')].map((e) => e.id)")
    assert len(ids) == len(set(ids))


_ROLES = ("application", "button", "checkbox", "combobox", "radio", "slider", "textbox")


def exposed(page: Any) -> list[tuple[str, str]]:
    """(role, name) pairs of Chromium's accessibility tree."""
    tree = page.context.new_cdp_session(page).send("Accessibility.getFullAXTree")
    nodes = [node for node in tree["nodes"] if not node["ignored"]]
    return [(node["role"]["value"], node.get("name", {}).get("value", "")) for node in nodes]


def controls(page: Any) -> list[str]:
    """Names of the controls in that tree."""
    return [name for role, name in exposed(page) if role in _ROLES]


def test_tab_reaches_every_control_in_reading_order_and_ends(ball):
    page = ball(WIDE, **ALL_ON).page
    wanted = page.evaluate(_TABBABLE, CONTROLS)
    page.click("h1")
    stops = []
    for _ in wanted:
        page.keyboard.press("Tab")
        stops.append(page.evaluate(_STOP))
    assert [stop and stop["what"] for stop in stops] == wanted
    page.keyboard.press("Tab")
    after = page.evaluate(_STOP)
    assert after is None or after["what"] == wanted[0], "out again"
    for one, other in pairwise(stops):
        below, to_the_right = other["y"] >= one["y"], other["x"] >= one["x"] + one["width"]
        assert below or to_the_right, f"{one['what']} before {other['what']}"


_WHAT = """(e) => e.id || e.getAttribute('aria-label') || e.dataset.look || e.textContent"""
_TABBABLE = f"""(controls) => [...document.querySelectorAll(controls)]
    .filter((e) => e.getClientRects().length && !e.disabled)
    .filter((e) => e.type !== 'radio' || e.checked).map({_WHAT})"""
_STOP = f"""() => {{
    const e = document.activeElement;
    if (!e || e === document.body) return null;
    const {{ x, y, width, height }} = e.getBoundingClientRect();
    const top = document.elementFromPoint(x + width / 2, y + height / 2);
    return {{ x, y, width, height, what: ({_WHAT})(e), seen: e.contains(top) }};
}}"""


@pytest.mark.slow
@MEDIA
def test_every_control_shows_that_it_has_the_focus(ball, media):
    """Focus by WCAG 2.2, 2.4.13: as many pixels as an outline of two change by 3 : 1 or more."""
    page = ball(WIDE, media, **ALL_ON).page
    boxes, bare = page.evaluate(_BOXES, CONTROLS), luminance(page.screenshot())
    session = page.context.new_cdp_session(page)
    session.send("DOM.enable")
    session.send("CSS.enable")
    root = session.send("DOM.getDocument")["root"]["nodeId"]
    found = session.send("DOM.querySelectorAll", {"nodeId": root, "selector": CONTROLS})
    for node in found["nodeIds"]:
        # Every control at once looks as where Tab has reached it, until the session ends.
        looks = {"nodeId": node, "forcedPseudoClasses": ["focus", "focus-visible"]}
        session.send("CSS.forcePseudoState", looks)
    ringed = luminance(page.screenshot())
    session.detach()
    changed = np.maximum(bare, ringed) + 0.05 >= 3 * (np.minimum(bare, ringed) + 0.05)
    faint = []
    for what, x, y, width, height in boxes:
        # Its ring is at most four pixels away.
        left, top = max(int(x) - 4, 0), max(int(y) - 4, 0)
        found = changed[top : int(y + height) + 5, left : int(x + width) + 5].sum()
        # Corners are round, and a ring may lie over its neighbour's line.
        if found < 0.8 * 2 * 2 * (width + height):
            faint.append((what, int(found), width, height))
    assert len(boxes) > 30 and faint == []


_BOXES = f"""(controls) => [...document.querySelectorAll(controls)]
    .filter((e) => e.getClientRects().length && !e.disabled).map((e) => {{
        const {{ x, y, width, height }} = e.getBoundingClientRect();
        return [({_WHAT})(e), x, y, width, height];
    }})"""


def luminance(png: bytes) -> NDArray[np.float64]:
    """(H, W) of a window's picture; white 1."""
    codes = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")) / 255.0
    return SPACES["sRGB"].decode(codes) @ SPACES["sRGB"].XYZ_from_RGB[1]


@pytest.mark.slow
def test_what_is_tabbed_to_is_not_behind_the_picture(ball):
    page = ball(PHONE, **ALL_ON).page
    for key in ("Tab", "Shift+Tab"):
        stops = []
        for _ in range(40):
            page.keyboard.press(key)
            stops.append(page.evaluate(_STOP))
            assert stops[-1] is None or stops[-1]["seen"], f"{stops[-1]} by {key}"
        assert sum(stop is not None for stop in stops) > 30


@pytest.mark.parametrize("size", [WIDE, PHONE])
def test_targets_are_as_large_as_a_finger_asks(ball, size):
    assert ball(size, **ALL_ON).page.evaluate(_SMALL, CONTROLS) == []


# A label is a part of its control's target.
_SMALL = f"""(controls) => [...document.querySelectorAll(controls)]
    .filter((e) => e.getClientRects().length).flatMap((e) => {{
        const boxes = [e, ...(e.labels ?? [])].map((part) => part.getBoundingClientRect());
        const [wide, tall] = ['width', 'height'].map((k) => Math.max(...boxes.map((b) => b[k])));
        return wide < 24 || tall < 24 ? [[({_WHAT})(e), wide, tall]] : [];
    }})"""


@pytest.mark.parametrize("size", [(640, 400), (360, 740), (320, 256)])
def test_nothing_is_beside_the_window(ball, size):
    """1280 pixels at 200 %, a phone, and 1280 at 400 %."""
    page = ball(size, **ALL_ON).page
    wide = """() => [...document.querySelectorAll('body *')]
        .filter((e) => !e.closest('#port') && !e.closest('.unseen') && e.getClientRects().length)
        .filter((e) => e.getBoundingClientRect().right > innerWidth + 0.5)
        .map((e) => e.outerHTML.slice(0, 80))"""
    assert page.evaluate(wide) == []
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    # A slider is there to be moved: by a finger, over some way.
    least = """Math.min(...[...document.querySelectorAll('[type=range]')]
        .filter((e) => e.offsetParent).map((e) => e.clientWidth))"""
    assert page.evaluate(least) >= 60


def test_nothing_moves_for_who_asks_for_stillness(ball):
    page = ball(WIDE).page
    moving = """() => [...document.querySelectorAll('*')].filter((e) => {
        const { transitionDuration, animationName } = getComputedStyle(e);
        return !/^(0s(, )?)+$/.test(transitionDuration) || animationName !== 'none';
    }).length"""
    page.emulate_media(reduced_motion="no-preference")
    assert page.evaluate(moving) > 0
    page.emulate_media(reduced_motion="reduce")
    assert page.evaluate(moving) == 0


@pytest.mark.slow
def test_the_keyboard_zooms_at_the_probe_and_pans_after_it(ball):
    opened = ball(WIDE, probe="2,2")
    page = opened.page
    page.focus("#port")
    inside = """() => {
        const port = document.getElementById('port').getBoundingClientRect();
        const cross = document.getElementById('cross').getBoundingClientRect();
        return cross.left >= port.left && cross.right <= port.right
            && cross.top >= port.top && cross.bottom <= port.bottom;
    }"""
    for key in (*["+"] * 12, *["Shift+ArrowRight"] * 2, *["Shift+ArrowDown"] * 2):
        page.keyboard.press(key)
        opened.settle()
        assert page.evaluate(inside), key
    page.focus("#zoom-fit")
    page.keyboard.press("Enter")
    opened.settle()
    assert page.evaluate("document.activeElement.id") == "zoom-fit", "it keeps the focus"
    assert page.get_attribute("#zoom-fit", "aria-disabled") == "true"
