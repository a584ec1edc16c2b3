"""A page's words, from any author: names around the dial, titles, marks that turn directions."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pytest

from tests.page.conftest import Open, Opened
from tests.support.fixtures import slow
from tests.support.images import image, named_lights
from volspec.basis import SpectralBasis
from volspec.export.page import PageSpec, PageView

FIVE = (
    *("D65", "Operating theatre LED", "Ward fluorescent", "Daylight, north window"),
    "Sodium street lamp",
)
TWELVE = (*FIVE, "LED-B3", "planck:3200", "A", "Xenon\nheadlight", "FL11", "W" * 300, "lamp:candle")
DESKTOP, PHONE = (1280, 900), (320, 640)


@pytest.fixture
def page_of(written: Open) -> Open:
    """A grey picture under lights of given names, at a window's size."""

    def made(
        names: Sequence[str],
        window: tuple[int, int] = DESKTOP,
        picture: tuple[int, int] = (4, 3),
        title: str = "Grey",
        caption: str = "",
    ) -> Opened:
        grey = image(np.full((*picture[::-1], 5), 0.5), SpectralBasis.load("general-5"))
        spec = PageSpec(title, caption)
        shown = written([PageView(grey)], named_lights(names, "D65"), spec=spec)
        shown.page.set_viewport_size({"width": window[0], "height": window[1]})
        shown.settle()
        return shown

    return made


# Of each name at the dial: its lines' words, and its box less what letters leave free.
_NAMES = """() => {
    const dial = document.getElementById('dial').getBoundingClientRect();
    return [...document.querySelectorAll('#dial g:has(> text)')].map((name) => {
        const { left, right, top, bottom } = name.getBoundingClientRect();
        const words = [...name.querySelectorAll('text')].map((line) => line.textContent);
        return { words, box: [left, top + 1, right, bottom - 1],
            inside: left >= dial.left && right <= dial.right
                && top >= dial.top && bottom <= dial.bottom };
    });
}"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("window", "names", "caption"),
    [
        slow(DESKTOP, TWELVE, "Cast once. " * 450),
        slow(PHONE, FIVE, "Cast once. " * 450),
        (PHONE, TWELVE, "W" * 300),
    ],
)
def test_long_words_leave_room_and_can_be_read(page_of, names, window, caption):
    """Names around the dial, whole and apart; two lines of a title, and three of a caption."""
    title = "Engine " * 700
    shown = page_of(names, window, title=title, caption=caption)
    seen, page = shown.page.evaluate(_NAMES), shown.page
    assert len(seen) == len(names)
    assert [one["words"] for one in seen if not one["inside"]] == []
    for one, other in combinations(seen, 2):
        (left, top, right, bottom), (x0, y0, x1, y1) = one["box"], other["box"]
        assert right <= x0 or x1 <= left or bottom <= y0 or y1 <= top, (one, other)
    tall = page.evaluate("document.querySelector('h1').clientHeight")
    assert 16 < tall <= 2 * 1.4 * 16 + 1, "two lines of 16 pixels, each 1.4 high"
    assert page.get_attribute("h1", "title") == title
    tall = "document.getElementById('caption').clientHeight"
    assert page.evaluate(tall) <= 3 * 1.4 * 13 + 1, "lines of 13 pixels, each 1.4 high"
    more = page.locator("#more")
    shown.click("#more")
    assert (more.inner_text(), more.get_attribute("aria-expanded")) == ("Less", "true")
    cut = "document.getElementById('caption').scrollHeight > 60"
    assert page.evaluate(cut) and page.locator("#port").bounding_box()["height"] > 200
    shown.click("#more")
    assert more.is_visible() and page.evaluate(tall) <= 56
    assert page.evaluate("document.documentElement.scrollWidth") <= window[0]


def test_five_ordinary_names_are_written_out(page_of):
    page = page_of(FIVE, caption="A few words").page
    assert not page.locator("#more").is_visible(), "all of the caption is shown"
    seen = page.evaluate(_NAMES)
    words = [" ".join(word.strip("\u2068\u2069") for word in one["words"]) for one in seen]
    assert words == list(FIVE)


@pytest.mark.slow
def test_of_forty_lights_the_dial_names_the_strongest_or_the_one_under_the_mouse(page_of):
    shown = page_of([f"lamp {i}" for i in range(40)])
    assert [one["words"] for one in shown.page.evaluate(_NAMES)] == [["\u2068lamp 0\u2069"]]
    shown.page.locator("#dial circle").nth(10).hover()
    shown.settle()
    assert [one["words"] for one in shown.page.evaluate(_NAMES)] == [["\u2068lamp 10\u2069"]]


def test_a_name_that_turns_the_direction_turns_no_word_of_the_page(page_of):
    """Letters after it are in order: each right of the previous one."""
    lefts = page_of(["A\u2069\u202eB"]).page.evaluate("""() => {
        const node = document.getElementById('label-a').firstChild;
        const start = node.data.indexOf('CIECAM02');
        return [...'CIECAM02'].map((_, i) => {
            const letter = document.createRange();
            letter.setStart(node, start + i);
            letter.setEnd(node, start + i + 1);
            return letter.getBoundingClientRect().left;
        });
    }""")
    assert lefts == sorted(lefts)


@pytest.mark.slow
def test_a_long_name_leaves_the_picture_free(page_of):
    label = page_of(["W" * 300], PHONE).page.locator("#label-a").bounding_box()
    assert label["height"] <= 3 * 1.4 * 12 + 7, "three lines of 12 pixels, and room around them"


@pytest.mark.parametrize("picture", [slow((1, 2000)), slow((2000, 1))])
def test_a_thin_picture_is_seen_and_its_pixels_are_found(page_of, picture):
    shown = page_of(["D65"], picture=picture)
    page = shown.page
    box, port = page.locator("#picture").bounding_box(), page.locator("#port").bounding_box()
    assert min(box["width"], box["height"]) >= 5.9
    for side in ("width", "height"):
        assert box[side] <= port[side] + 0.1
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    middle = ",".join(str(side // 2) for side in picture)
    shown.until(f"location.hash.includes('probe={middle}')")
