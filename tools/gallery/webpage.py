"""Make the pictures of docs/page.md and layers.md: ``python -m tools.gallery.webpage [NAME …]``.

scenes -> pages -> [webpage] -> docs/images/page-engine.jpg, page-frog.jpg, page-foot.jpg, …

Each page is opened in Chromium at a phone's width and shown under three of its lights, the foot in
three opacities, and in fog, through a lens, and for two eyes (page-foot-depth.jpg). The frog's
labels come with pyvista, the foot is looked for in $VOLSPEC_DATA.
"""

from __future__ import annotations

import io
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from tests.support.browser import chromium
from tools.gallery.studio import READERS, ROOT
from volspec.export.page import PageSpec, PageView, write_page
from volspec.scene import Scene

FOLDER = ROOT / "docs" / "images"
SHOWN = {
    "engine": ("D65", "A", "HP1"),
    "frog": ("noon", "evening", "street"),
    "foot": ("daylight", "daylight", "tungsten"),
}
# Sliders of opacity under each of the lights, by row and slider.
OPACITIES = {"foot": ({}, {1: -2.3}, {1: -4.0, 2: -2.0})}
# Then, with the first material faded: sliders of what depends on depth, by fractions of their
# range.
DEPTHS: dict[str, tuple[dict[str, float | str], ...]] = {
    "foot": (
        {"fog": 0.05, "turn-across": 0.8},
        {"focus": 0.3, "aperture": 0.75},
        {"stereo": "anaglyph"},
    )
}
FADED = -2.3
_PHONE = {"width": 460, "height": 740}
_GAP, _PAPER, _BYTES = 24, (255, 255, 255), 250_000


def main() -> None:
    """Make the named strips, or all."""
    names = sys.argv[1:] or list(SHOWN)
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        for name in names:
            lights = SHOWN[name]
            path = Path(folder) / f"{name}.html"
            scene = write(name, path)
            numbers = [[light.name for light in scene.lights].index(light) for light in lights]
            shots = screens(browser, path, numbers, OPACITIES.get(name, ()))
            size = save(strip(shots), FOLDER / f"page-{name}.jpg")
            print(f"page-{name}.jpg: {size / 1000:.0f} kB", flush=True)
            if name in DEPTHS:
                shots = depths(browser, path, DEPTHS[name])
                save(strip(shots), FOLDER / f"page-{name}-depth.jpg")


def write(name: str, path: Path) -> Scene:
    """Write a scene's page, as `volspec page` does, from a volume wherever it is."""
    scene = Scene.load(ROOT / "data" / "scenes" / f"{name}.toml")
    image = scene.render(READERS[name]())
    title = PageSpec(scene.file.title)
    write_page(path, [PageView(image)], scene.lights, scene.relight, title)
    return scene


@contextmanager
def opened(browser: Any, path: Path) -> Iterator[Any]:
    """Open a page on a phone in the dark scheme."""
    context = browser.new_context(viewport=_PHONE, device_scale_factor=2, color_scheme="dark")
    page = context.new_page()
    page.goto(path.as_uri())
    page.wait_for_selector("html.ready", state="attached")
    yield page
    context.close()


def shot(page: Any, top: str) -> Image.Image:
    """Return a screenshot at rest, with the panel scrolled to a part of it; empty for its top."""
    page.evaluate("document.activeElement.blur(); window.scrollTo(0, 0)")
    if top:
        page.evaluate("(id) => document.getElementById(id).scrollIntoView()", top)
    page.mouse.move(0, 0)
    page.wait_for_timeout(1000)
    page.wait_for_selector("#picture[aria-busy=false]", timeout=120_000)
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def screens(
    browser: Any, path: Path, lights: list[int], opacities: Sequence[dict[int, float]] = ()
) -> list[Image.Image]:
    """Return screenshots of the page under each of the lights, chosen by touch.

    ``opacities`` are sliders' octaves by row, set under each of the lights.
    """
    shots = []
    with opened(browser, path) as page:
        if opacities:
            page.wait_for_selector("#opacity-list input:enabled")
        for i, light in enumerate(lights):
            page.click(f"#light-list li:nth-child({light + 1}) .light-name")
            for row, octave in opacities[i].items() if opacities else ():
                page.fill(f"#opacity-list li:nth-child({row}) input", str(max(octave, -3.05)))
            shots.append(shot(page, "opacity" if opacities else ""))
    return shots


def depths(browser: Any, path: Path, states: Sequence[dict[str, float | str]]) -> list[Image.Image]:
    """Return screenshots of the page with its panel of depth in each of some states."""
    shots = []
    with opened(browser, path) as page:
        page.wait_for_selector("#opacity-list input:enabled")
        page.fill("#opacity-list li:nth-child(1) input", str(FADED))
        for state in states:
            page.evaluate("document.getElementById('depth-reset').click()")
            page.wait_for_timeout(200)
            page.set_checked("#lens", "focus" in state)
            for name, value in state.items():
                if isinstance(value, str):
                    page.select_option(f"#{name}", value)
                    continue
                low, high = (float(page.get_attribute(f"#{name}", end)) for end in ("min", "max"))
                page.fill(f"#{name}", str(low + value * (high - low)))
            shots.append(shot(page, "depth"))
    return shots


def strip(shots: list[Image.Image]) -> Image.Image:
    """Pictures side by side."""
    width, height = shots[0].size
    whole = Image.new("RGB", (len(shots) * (width + _GAP) - _GAP, height), _PAPER)
    for i, shot in enumerate(shots):
        whole.paste(shot, (i * (width + _GAP), 0))
    return whole


def save(picture: Image.Image, path: Path) -> int:
    """Save a JPEG, as good as its size permits; return its bytes."""
    for quality in range(92, 40, -4):
        memory = io.BytesIO()
        picture.save(memory, "JPEG", quality=quality, optimize=True)
        if memory.tell() <= _BYTES:
            break
    path.write_bytes(memory.getvalue())
    return memory.tell()


if __name__ == "__main__":
    main()
