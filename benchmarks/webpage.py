"""Is the web page small, accurate and quick? ``python -m benchmarks.webpage``.

The bundled engine, 512², 7 channels, in Chromium with its software GPU, from a file on disk.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.measure import Figure, report
from tests.support.browser import chromium, mean_difference, missing, saved_picture
from volspec._gpu.sources import asset
from volspec.export.page import PageSpec, PageView, scene_views, write_page
from volspec.relight import Relighter
from volspec.scene import Scene

# Views of the full turn, and the number of them to cast for an estimate of its size.
TURN, CAST = 36, 6
# Drag a slider for some seconds, with one change per frame, like a user.
_DRAG = """async (seconds) => {
    const slider = document.querySelector('#light-list input'), start = performance.now();
    let frames = 0;
    for (; performance.now() - start < 1000 * seconds; frames++) {
        slider.value = 0.2 + 0.8 * Math.abs(Math.sin(frames / 9));
        slider.dispatchEvent(new Event('input'));
        await new Promise(requestAnimationFrame);
    }
    return 1000 * frames / (performance.now() - start);
}"""


def figures() -> Iterator[Figure]:
    """Yield sizes, colour differences from the desktop under five lights, and frames per second."""
    if why := missing():
        yield Figure("page", None, note=why)
        return
    scene = Scene.load(asset("data/scenes/engine.toml"))
    views = list(scene_views(scene, CAST))
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        path = Path(folder)
        one = _written(path / "8.html", scene, views[:1], 8)
        many = _written(path / "turn.html", scene, views, 8)
        turn = one + (many - one) / (CAST - 1) * (TURN - 1)
        yield Figure("page/engine, 1 view", one / 1e6, 1.5, at_most=True, unit="MB")
        yield Figure(f"page/engine, {TURN} views", turn / 1e6, 25.0, at_most=True, unit="MB")
        _written(path / "12.html", scene, views[:1], 12)
        for bits, asked in ((8, 0.8), (12, 0.3)):
            page = browser.new_page()
            worst = _worst(page, path / f"{bits}.html", scene, views[0])
            yield Figure(f"page/{bits} bits, worst light", worst, asked, at_most=True, unit="ΔE")
            if bits == 8:
                rate = page.evaluate(_DRAG, 4.0)
                yield Figure("page/light dragged, frames a second", rate, 20.0, unit="/s")
            page.close()


def _written(path: Path, scene: Scene, views: list[PageView], bits: int) -> int:
    return write_page(path, views, scene.lights, scene.relight, PageSpec("Engine", bits=bits))


def _worst(page: Any, path: Path, scene: Scene, view: PageView) -> float:
    """Return the greatest mean CIEDE2000 between page and desktop over the scene's lights."""
    page.goto(path.as_uri())
    page.wait_for_selector("html.ready", state="attached")
    seen, found = scene.relight, []
    with Relighter(view.image) as relighter:
        for i, light in enumerate(scene.lights):
            page.click(f"#light-list li:nth-child({i + 1}) .light-name")
            page.wait_for_timeout(200)
            frame = relighter.frame(light.rig, seen)
            found.append(mean_difference(saved_picture(page), frame))
    return max(found)


if __name__ == "__main__":
    print(report(list(figures())))
