"""Time a change of opacities next to a change of light: ``python -m benchmarks.recompose``.

A picture of 512² with 8 layers of three materials, the foot, on the OpenGL device. Frames stay on
the device, as in a window; each is waited for. Light frames of the same picture without layers are
the peer: layers must not make them slower.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.measure import Figure, report
from benchmarks.scenes import stored
from volspec._gpu.sources import asset
from volspec.relight import LightRig, Relighter
from volspec.scene import Scene
from volspec.spectra import light

SIZE, RUNS = (512, 512), 30
LIGHTS = "D65", "A"


def figures() -> Iterator[Figure]:
    """Yield milliseconds of both changes, and of light frames with layers by those without."""
    try:
        volume = stored("foot")()
    except FileNotFoundError as error:
        yield Figure("recompose/foot", None, note=str(error))
        return
    scene = Scene.load(asset("data/scenes/foot.toml"))
    image = scene.render(volume, size=SIZE)
    assert image.opacity_layers is not None
    rigs = [LightRig.of(light(name)) for name in LIGHTS]
    plain = replace(image, opacity_layers=None)
    with Relighter(image, "gl") as layered, Relighter(plain, "gl") as peer:
        first = next(iter(scene.materials))

        def fade(run: int) -> None:
            layered.set_opacities({first: 0.3 + 0.02 * run})

        def shown(relighter: Relighter, run: int) -> None:
            relighter.frame(rigs[run % 2])

        fade(0)
        shown(layered, 0)
        ms = {
            "opacity": _median(lambda run: (fade(run), shown(layered, 0))),
            "light": _median(lambda run: shown(layered, run)),
            "without": _median(lambda run: shown(peer, run)),
        }
    recomposed = ms["opacity"] - ms["light"]
    yield Figure("recompose/opacity changed, 512²", recomposed, 16.0, at_most=True, unit="ms")
    yield Figure("recompose/light changed, 512²", ms["light"], unit="ms")
    ratio = ms["light"] / ms["without"]
    yield Figure("recompose/light frame by one without layers", ratio, 1.1, at_most=True, unit="x")


def _median(change: Callable[[int], object]) -> float:
    times = []
    for run in range(RUNS):
        started = time.perf_counter()
        change(run)
        times.append(1e3 * (time.perf_counter() - started))
    return float(np.median(times))


if __name__ == "__main__":
    print(report(list(figures())))
