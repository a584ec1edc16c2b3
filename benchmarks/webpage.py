"""Is the web page small, accurate and quick? ``python -m benchmarks.webpage``.

The bundled engine, 512², 7 channels, in Chromium with its software GPU, from a file on disk. Then
pages with 8 layers of opacity, of the engine in two materials and a foot in three: CIEDE2000 of
covered pixels from the desktop's recomposed frame, in several opacities under every light, with
cuts, fog and a lens, and turned by 5° from a cast there; and the times of changed opacities and
turns next to a light's.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import Figure, report
from benchmarks.scenes import stored
from tests.support.browser import (
    chromium,
    differences,
    mean_difference,
    missing,
    saved_picture,
)
from tests.support.raycasts import leaned
from volspec._gpu.sources import asset
from volspec.export.page import PageSpec, PageView, scene_views, write_page
from volspec.image import CoefficientImage, DepthEffects
from volspec.pipeline import raycast
from volspec.relight import Relighter, relight
from volspec.scene import Scene
from volspec.volume import Volume

# Views of the full turn, and the number of them to cast for an estimate of its size.
TURN, CAST = 36, 6
TURN_DEG = 5
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


# Scales of the first and second material; others stay.
OPACITIES = ((0.0, 1.0), (0.3, 1.0), (0.5, 2.0), (4.0, 0.0), (1.0, 0.25), (1.0, 1.0))
# Change one slider a frame, and wait until it is drawn.
_CHANGES = """async ([where, count]) => {
    const slider = document.querySelector(where), { min, max } = slider, times = [];
    const gl = document.getElementById('picture').getContext('webgl2');
    for (let i = 0; i < count; i++) {
        slider.value = Number(min) + (max - min) * (0.2 + 0.6 * Math.abs(Math.sin(i)));
        const start = performance.now();
        slider.dispatchEvent(new Event('input'));
        await new Promise(requestAnimationFrame);
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
        times.push(performance.now() - start);
    }
    return times.sort((a, b) => a - b)[count >> 1];
}"""


def layered_figures() -> Iterator[Figure]:
    """Yield sizes, errors and times of pages with layers of opacity."""
    if why := missing():
        yield Figure("page/layers", None, note=why)
        return
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        for name, stored_volume in (("engine-layers", None), ("foot", stored("foot"))):
            scene = Scene.load(asset(f"data/scenes/{name}.toml"))
            try:
                volume = stored_volume() if stored_volume else scene.volume()
            except FileNotFoundError as error:
                yield Figure(f"page/{name}", None, note=str(error))
                continue
            (view,) = scene_views(scene, volume=volume)
            path = Path(folder) / f"{name}.html"
            size = _written(path, scene, [view], 8)
            asked = 5.0 if name == "engine-layers" else None
            yield Figure(f"page/{name}", size / 1e6, asked, at_most=True, unit="MB")
            page = browser.new_page()
            mean, worst, most_of, unscaled = _opacity_errors(page, path, scene, view)
            yield Figure(f"page/{name}, mean", mean, 0.25, at_most=True, unit="ΔE")
            yield Figure(f"page/{name}, mean as cast", unscaled, unit="ΔE")
            yield Figure(f"page/{name}, worst combination", worst, unit="ΔE")
            yield Figure(f"page/{name}, 99 %", most_of, unit="ΔE")
            for title, error in _depth_errors(page, scene, view.image):
                yield Figure(f"page/{name}, {title}", error, unit="ΔE")
            turned = _turned_error(page, scene, view.image, volume)
            yield Figure(f"page/{name}, turned by {TURN_DEG}°", turned, 1.7, True, "ΔE")
            if name == "engine-layers":
                yield from _times(page)
            page.close()


def _opacity_errors(
    page: Any, path: Path, scene: Scene, view: PageView
) -> tuple[float, float, float, float]:
    """Return mean, mean of the worst combination, 99 %, and mean of the last opacities, as cast."""
    page.goto(path.as_uri())
    page.wait_for_selector("#opacity-list input:enabled")
    names, found = list(scene.materials), []
    covered = np.asarray(view.image.alpha) > 0.01
    for scales in OPACITIES:
        given = dict(zip(names, scales, strict=False))
        row = ",".join(str(given.get(name, 1.0)) for name in names)
        image = view.image.recompose(given)
        with Relighter(image) as relighter:
            for i, light in enumerate(scene.lights):
                weights = ",".join(str(int(j == i)) for j in range(len(scene.lights)))
                words = f"a.weights={weights}&a.opacity={row}"
                page.evaluate("(words) => { location.hash = words; }", words)
                page.wait_for_timeout(100)
                frame = relighter.frame(light.rig, scene.relight)
                found.append(differences(saved_picture(page)[covered], frame[covered]))
    means = [each.mean() for each in found]
    most_of = np.percentile(np.concatenate(found), 99)
    as_cast = np.mean(means[-len(scene.lights) :])
    return float(np.mean(means)), float(max(means)), float(most_of), float(as_cast)


def _depth_errors(page: Any, scene: Scene, image: CoefficientImage) -> Iterator[tuple[str, float]]:
    """Yield mean differences of cuts in the middle, fog and a lens from the desktop's."""
    assert image.opacity_layers is not None
    near, far = image.opacity_layers.range_mm
    middle = (near + far) / 2
    covered = np.asarray(image.alpha) > 0.01
    for title, words, effects in (
        ("near cut", f"a.near={middle:.6g}", DepthEffects(near_mm=middle)),
        ("far cut", f"a.far={middle:.6g}", DepthEffects(far_mm=middle)),
        ("fog", f"a.fog={far - near:.6g}", DepthEffects(fog_mm=far - near, fog_from_mm=near)),
        ("lens", f"a.focus={middle:.6g}", DepthEffects(focus_mm=middle)),
    ):
        wanted = relight(image.recompose({}, effects), scene.lights[0].rig, scene.relight)
        page.evaluate("(words) => { location.hash = words; }", words)
        page.wait_for_timeout(200)
        page.wait_for_selector("#picture[aria-busy=false]", timeout=120_000)
        yield title, float(differences(saved_picture(page)[covered], wanted[covered]).mean())


def _turned_error(page: Any, scene: Scene, image: CoefficientImage, volume: Volume) -> float:
    """Return the mean difference of both turns across from casts of these views."""
    assert image.camera is not None
    found = []
    for angle in (-TURN_DEG, TURN_DEG):
        camera = leaned(image.camera, angle, 0)
        cast = raycast(volume, scene.transfer, camera, image.size, scene.raycast)
        wanted = relight(cast, scene.lights[0].rig, scene.relight)
        page.evaluate("(words) => { location.hash = words; }", f"turn={angle},0")
        page.wait_for_timeout(1000)
        covered = np.asarray(cast.alpha) > 0.01
        found.append(differences(saved_picture(page)[covered], wanted[covered]).mean())
    return float(np.mean(found))


def _times(page: Any) -> Iterator[Figure]:
    """Yield the times of a change of light, of an opacity, and of a turn, in turn."""
    page.evaluate("location.hash = 'a.opacity=0.5,1'")
    sliders = "#light-list input", "#opacity-list input", "#turn-across"
    times: list[list[float]] = []
    for _ in range(5):
        times.append([])
        for where in sliders:
            times[-1].append(page.evaluate(_CHANGES, [where, 15]))
            page.evaluate("document.getElementById('depth-reset').click()")
    light, *others = np.median(times, axis=0)
    yield Figure("page/light changed", float(light), unit="ms")
    for name, each in zip(("opacity", "turn"), others, strict=True):
        yield Figure(f"page/{name} changed", float(each), unit="ms")
        yield Figure(f"page/{name} by light", float(each / light), unit="x")


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
    print(report([*figures(), *layered_figures()]))
