"""How fast is a cast? Against VTK's fixed-point mapper, same data, camera and step."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.measure import Comparison, compare
from benchmarks.vtk_peer import FixedPointPeer, Points
from volspec._gpu.sources import asset
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera, RaycastSpec
from volspec.scene import Scene

SIZE = (512, 512)
SPECS = {
    "flat": RaycastSpec(ambient=1, diffuse=0),
    "shaded": RaycastSpec(ambient=0.3, diffuse=0.7, specular=0.2, shininess=24),
}


def grey_points(scene: Scene) -> Points:
    """The scene's opacities for VTK, in one colour: what it casts, not how it looks, is timed."""
    return [(p.value, p.opacity, (0.7, 0.7, 0.75)) for p in scene.file.transfer.points]


def rows() -> Iterator[Comparison]:
    """Cast the demo's engine, seven channels, flat and shaded."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume = scene.volume()
    camera: Camera = scene.camera(volume)
    caster = Raycaster(volume)
    points = grey_points(scene)
    for name, spec in SPECS.items():
        peer = FixedPointPeer(volume, points, camera, SIZE, spec)
        yield compare(
            f"cast/engine/{name}",
            "vtk-fixed-point",
            caster.device,
            lambda spec=spec: raycast(volume, scene.transfer, camera, SIZE, spec, caster=caster),
            peer.redraw,
        )
