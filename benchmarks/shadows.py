"""What do shadows cost? One light with them against the same without, the engine.

Every picture has its light elsewhere, so that the light volume is made anew for each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle

import numpy as np

from benchmarks.cast import SIZE, STOPPED
from benchmarks.measure import Figure, compare
from benchmarks.volumes import bench_scene
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Ambient, CoefficientImage, Directional, LightGroup, RaycastSpec

ASKED = 2
TOWARDS = ((1.0, 1.0, 1.0), (1.0, 1.1, 1.0), (1.1, 1.0, 1.0))


def lit(towards: tuple[float, float, float], shadows: bool) -> RaycastSpec:
    """The bench's shading under one light from over the camera's shoulder."""
    key = Directional(towards, frame="camera", shadows=shadows)
    return replace(STOPPED["shaded"], groups=(LightGroup("key", (Ambient(), key)),))


def figures() -> Iterator[Figure]:
    """The ratio of times."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)

    def cast(spec: RaycastSpec) -> CoefficientImage:
        return raycast(scene.volume, scene.transfer, scene.camera, SIZE, spec, caster=caster)

    with_and_without = (cast(lit(TOWARDS[0], shadows)).coefficients for shadows in (True, False))
    if np.array_equal(*with_and_without):
        yield Figure("shadows/engine", None, ASKED, at_most=True, note="the caster casts none yet")
        return
    lights = {shadows: cycle([lit(t, shadows) for t in TOWARDS]) for shadows in (True, False)}
    row = compare(
        "shadows/engine",
        "no-shadows",
        caster.device,
        lambda: cast(next(lights[True])),
        lambda: cast(next(lights[False])),
    )
    yield Figure(row.name, 1 / row.ratio, ASKED, at_most=True, row=row)
