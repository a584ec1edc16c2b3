"""What do channels cost? Sixteen against three, the engine's transfer function in two bases."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from benchmarks.cast import SIZE, STOPPED
from benchmarks.measure import Figure, compare
from benchmarks.volumes import bench_scene
from volspec.basis import SpectralBasis
from volspec.pipeline import Raycaster, raycast
from volspec.spectra import light_set, reflectance_set

MANY, FEW = 16, 3
ASKED = 1.15


def figures() -> Iterator[Figure]:
    """The ratio of times, flat and shaded."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)
    lights, reflectances = light_set("smooth"), reflectance_set("training")
    # Principal components: the time of a cast does not depend on how a basis was fitted.
    many, few = (
        replace(
            scene.transfer,
            basis=SpectralBasis.fit(lights, reflectances, size=size, method="pca"),
        )
        for size in (MANY, FEW)
    )
    for kind, spec in STOPPED.items():
        row = compare(
            f"channels/engine/{kind}",
            f"{FEW}-channels",
            caster.device,
            lambda spec=spec: raycast(scene.volume, many, scene.camera, SIZE, spec, caster=caster),
            lambda spec=spec: raycast(scene.volume, few, scene.camera, SIZE, spec, caster=caster),
        )
        yield Figure(f"{row.name}: 16/3", 1 / row.ratio, ASKED, at_most=True, row=row)
