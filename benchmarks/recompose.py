"""Time a change of opacities next to a change of light: ``python -m benchmarks.recompose``.

A picture of 512² with 8 layers of three materials, the foot, on the OpenGL device. Frames stay on
the device, as in a window; each is waited for. Light frames of the same picture without layers are
the peer: layers must not make them slower.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np

from benchmarks.measure import Figure, in_turn, report
from benchmarks.scenes import stored
from volspec._gpu.sources import asset
from volspec.relight import LightRig, Relighter
from volspec.relight.look import Look
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
        first, runs = next(iter(scene.materials)), count()

        def relit(relighter: Relighter) -> None:
            relighter.frame(rigs[next(runs) % 2])

        def faded() -> None:
            scale = 0.3 + 0.02 * (next(runs) % RUNS)
            layered.frame(rigs[0], Look(opacities={first: scale}))

        faded()
        opacity = in_turn(faded, lambda: relit(layered), runs=RUNS).wall
        lights = in_turn(lambda: relit(layered), lambda: relit(peer), runs=RUNS).wall
    changed, relight = (float(ms) for ms in np.median(opacity, axis=0))
    ratio = float(np.median(lights[:, 0] / lights[:, 1]))
    yield Figure("recompose/opacity changed, 512²", changed - relight, 16.0, True, "ms")
    yield Figure("recompose/light changed, 512²", relight, unit="ms")
    yield Figure("recompose/light frame by one without layers", ratio, 1.1, True, "x")


if __name__ == "__main__":
    print(report(list(figures())))
