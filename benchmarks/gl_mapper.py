"""How fast is a cast against VTK's GPU mapper, drawn by what GL this machine has?"""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.cast import against
from benchmarks.measure import Figure
from benchmarks.volumes import bench_scene
from benchmarks.vtk_peer import gpu_mapper
from volspec.pipeline import Raycaster

# On llvmpipe; a GPU's own mapper is another race.
ASKED = {"flat": 6, "shaded": 10}


def figures() -> Iterator[Figure]:
    """The engine, flat and shaded."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)
    for kind, asked in ASKED.items():
        row = against(scene, kind, caster, gpu_mapper, "vtk-gpu", runs=3)
        yield Figure(f"{row.name}/vtk-gpu", row.ratio, asked, row=row)
