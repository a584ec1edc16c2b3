"""How long after an edit of the transfer function is its first picture there?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import count

import numpy as np

from benchmarks.cast import SIZE, STOPPED
from benchmarks.measure import Comparison, Figure, commit, in_turn
from benchmarks.volumes import bench_scene
from volspec.pipeline import Raycaster, raycast
from volspec.transfer import TransferFunction

ASKED_MS = 10


def figures() -> Iterator[Figure]:
    """An edited engine, against a cast with the table ready: the difference."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)
    table = scene.transfer.bake(min(scene.volume.spacing_mm))
    edits = count()

    def edited() -> TransferFunction:
        # Opaque enough to cost the same, never the same twice.
        (value, opacity, mix), *rest = reversed(scene.transfer.points)
        last = (value, opacity - 1e-4 * (next(edits) % 100 + 1), mix)
        return replace(scene.transfer, points=[*reversed(rest), last])

    for kind, spec in STOPPED.items():
        pairs = in_turn(
            lambda spec=spec: raycast(
                scene.volume, edited(), scene.camera, SIZE, spec, caster=caster
            ),
            lambda spec=spec: caster.cast(table, scene.camera, SIZE, spec),
            runs=11,
        )
        ours_ms, cast_ms = (float(n) for n in np.median(pairs, axis=0))
        more_ms = float(np.median(pairs[:, 0] - pairs[:, 1]))
        row = Comparison(
            f"edit/engine/{kind}",
            "cast-alone",
            ours_ms,
            cast_ms,
            float(np.median(pairs[:, 1] / pairs[:, 0])),
            caster.device,
            commit(),
        )
        print(f"{row.name:28s} {ours_ms:.1f} ms, the cast alone {cast_ms:.1f} ms", flush=True)
        yield Figure(row.name, more_ms, ASKED_MS, at_most=True, unit="ms", row=row)
