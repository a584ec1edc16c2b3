"""How fast is a light change? Against VTK's fixed-point mapper redrawing with other colours."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import cycle

from benchmarks.cast import SPECS, peer_of
from benchmarks.measure import Figure, compare
from benchmarks.volumes import bench_scene
from volspec._gpu.sources import asset
from volspec.pipeline import Relighter
from volspec.scene import Scene


def figures() -> Iterator[Figure]:
    """Swap the light on the demo's engine: new light in, finished 8-bit frame out.

    Ours is a drag of eight changes, per change; one alone takes a third longer, since the other
    side has just emptied the caches.
    """
    scene = Scene.load(asset("data/scenes/engine.toml"))
    lights = cycle([light.rig for light in scene.lights])
    bench = bench_scene("engine")
    with Relighter(scene.render(bench.volume)) as relighter:
        for kind, spec in SPECS.items():
            peer = peer_of(bench, spec)
            row = compare(
                f"light/engine/{kind}",
                "vtk-fixed-point",
                relighter.backend,
                lambda: relighter.frame(next(lights), scene.relight.viewing),
                peer.redraw,
                our_calls=8,
            )
            yield Figure(row.name, row.ratio, row=row)
