"""How fast is a cast? Against VTK's fixed-point mapper, same data, camera, points and step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import cycle

from benchmarks.measure import Comparison, Figure, compare
from benchmarks.volumes import BenchScene, bench_scenes
from benchmarks.vtk_peer import ALPHA_STOP, Points, VtkPeer, fixed_point
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.spectra import Spectrum
from volspec.transfer import TransferFunction

SIZE = (512, 512)
SPECS = {
    "flat": RaycastSpec(ambient=1, diffuse=0),
    "shaded": RaycastSpec(ambient=0.3, diffuse=0.7, specular=0.2, shininess=24),
}
ASKED = 3
# Ours ends a ray where the fixed-point mapper does.
STOPPED = {name: replace(spec, alpha_stop=ALPHA_STOP) for name, spec in SPECS.items()}


def grey_points(scene: BenchScene) -> Points:
    """The scene's opacities for VTK, in one colour: what it casts, not how it looks, is timed."""
    return [(value, opacity, (0.7, 0.7, 0.75)) for value, opacity, _ in scene.transfer.points]


def peer_of(
    scene: BenchScene, spec: RaycastSpec, mapper: Callable[..., VtkPeer] = fixed_point
) -> VtkPeer:
    """A mapper of VTK's on the scene."""
    reference_mm = scene.transfer.reference_step_mm or min(scene.volume.spacing_mm)
    return mapper(scene.volume, grey_points(scene), reference_mm, scene.camera, SIZE, spec)


def recoloured(transfer: TransferFunction) -> TransferFunction:
    """The same opacities in darker materials."""
    darker = {
        name: Spectrum(each.wavelengths_nm, 0.9 * each.values, each.name)
        for name, each in transfer.materials.items()
    }
    return replace(transfer, materials=darker)


def against(
    scene: BenchScene,
    kind: str,
    caster: Raycaster,
    mapper: Callable[..., VtkPeer] = fixed_point,
    peer_name: str = "vtk-fixed-point",
    runs: int = 7,
) -> Comparison:
    """Time a cast beside a mapper of VTK's that redraws with other colours.

    Both sides take in other colours and deliver a picture.
    """
    spec = STOPPED[kind]
    peer = peer_of(scene, spec, mapper)
    colours = cycle([scene.transfer, recoloured(scene.transfer)])
    return compare(
        f"cast/{scene.name}/{kind}",
        peer_name,
        caster.device,
        lambda: raycast(scene.volume, next(colours), scene.camera, SIZE, spec, caster=caster),
        peer.redraw,
        runs=runs,
    )


def figures() -> Iterator[Figure]:
    """Seven channels, five volumes, flat and shaded."""
    for scene in bench_scenes():
        if not isinstance(scene, BenchScene):
            name, why = scene
            yield Figure(f"cast/{name}", None, ASKED, note=why)
            continue
        caster = Raycaster(scene.volume)
        for kind in STOPPED:
            row = against(scene, kind, caster)
            yield Figure(row.name, row.ratio, ASKED, row=row)
