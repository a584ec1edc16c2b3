"""How fast is a light change? Against VTK's fixed-point mapper redrawing with other colours."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle

from benchmarks.cast import SIZE, SPECS, grey_points
from benchmarks.measure import Comparison, compare
from benchmarks.vtk_peer import FixedPointPeer
from volspec._gpu.sources import asset
from volspec.pipeline import Relighter
from volspec.scene import Scene


def rows() -> Iterator[Comparison]:
    """Swap the light on the demo's engine: new light in, finished 8-bit frame out.

    Ours is a drag of eight changes, per change; one alone takes a third longer, since the other
    side has just emptied the caches.
    """
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume = scene.volume()
    camera = scene.camera(volume)
    points = grey_points(scene)
    lights = cycle([light.rig for light in scene.lights])
    with Relighter(scene.render(volume)) as relighter:
        for name, spec in SPECS.items():
            peer = FixedPointPeer(volume, points, camera, SIZE, spec)
            yield compare(
                f"light/engine/{name}",
                "vtk-fixed-point",
                relighter.backend,
                lambda: relighter.frame(next(lights), scene.relight.viewing),
                peer.redraw,
                our_calls=8,
            )
