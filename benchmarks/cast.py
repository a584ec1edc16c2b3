"""Times of casts and of light changes, with the peer's data, camera, points and step.

Against VTK's fixed-point mapper and its GPU mapper; sixteen channels against three; a cast after
an edit of the transfer function; shadows; a change of the light.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from itertools import count, cycle
from statistics import geometric_mean

import numpy as np

from benchmarks.measure import Comparison, Figure, commit, compare, in_turn
from benchmarks.scenes import SPECS, BenchScene, bench_scene, bench_scenes
from benchmarks.vtk_peer import ALPHA_STOP, Points, VtkPeer, fixed_point, gpu_mapper
from volspec._checks import Vector
from volspec._gpu.sources import asset
from volspec.basis import SpectralBasis
from volspec.image import CoefficientImage
from volspec.pipeline import Raycaster, Relighter, raycast
from volspec.raycast import Ambient, Directional, LightGroup, RaycastSpec
from volspec.raycast.launch.bricks import BRICK, brick_codes, brick_ranges
from volspec.scene import Scene
from volspec.spectra import Spectrum, light_set, reflectance_set
from volspec.transfer import TransferFunction

SIZE = (512, 512)
# Of all cores' time: the geometric mean of five volumes, and the least.
ASKED_MEAN = {"flat": 4.5, "shaded": 4.2}
ASKED = 3.5
# Against VTK's GPU mapper on llvmpipe; on a GPU the comparison differs.
ASKED_VTK_GPU = {"flat": 6, "shaded": 10}
MANY_CHANNELS, FEW_CHANNELS, ASKED_CHANNELS = 16, 3, 1.15
ASKED_EDIT_MS = 10
ASKED_CODES_MS = 100
ASKED_SHADOWS = 2
ASKED_LIGHT = 40
TOWARDS = ((1.0, 1.0, 1.0), (1.0, 1.1, 1.0), (1.1, 1.0, 1.0))
# End rays at the same transmittance as the fixed-point mapper.
STOPPED = {name: replace(spec, alpha_stop=ALPHA_STOP) for name, spec in SPECS.items()}


def grey_points(scene: BenchScene) -> Points:
    """Return the scene's opacities for VTK, in one colour, as only the time matters."""
    return [(value, opacity, (0.7, 0.7, 0.75)) for value, opacity, _ in scene.transfer.points]


def peer_of(
    scene: BenchScene, spec: RaycastSpec, mapper: Callable[..., VtkPeer] = fixed_point
) -> VtkPeer:
    """Return a VTK mapper for the scene."""
    reference_mm = scene.transfer.reference_step_mm or min(scene.volume.spacing_mm)
    return mapper(scene.volume, grey_points(scene), reference_mm, scene.camera, SIZE, spec)


def recoloured(transfer: TransferFunction) -> TransferFunction:
    """Return the function with the same opacities in darker materials."""
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
    """Time a cast against a VTK mapper that redraws with other colours.

    Both sides receive other colours and return a picture.
    """
    spec = replace(STOPPED[kind], step_mm=0.5 * min(scene.volume.spacing_mm))
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
    """Compare with VTK's fixed-point mapper: seven channels, five volumes, flat and shaded."""
    ratios: dict[str, list[float]] = {kind: [] for kind in STOPPED}
    for scene in bench_scenes():
        if not isinstance(scene, BenchScene):
            name, why = scene
            yield Figure(f"cast/{name}", None, ASKED, note=why)
            continue
        caster = Raycaster(scene.volume)
        for kind, those in ratios.items():
            row = against(scene, kind, caster)
            those.append(row.cpu_ratio)
            yield Figure(row.name, row.cpu_ratio, ASKED, row=row)
    for kind, those in ratios.items():
        yield Figure(f"cast/geometric mean/{kind}", geometric_mean(those), ASKED_MEAN[kind])


def vtk_gpu_figures() -> Iterator[Figure]:
    """Compare with VTK's GPU mapper on the GL of this machine: the engine, flat and shaded."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)
    for kind, asked in ASKED_VTK_GPU.items():
        row = against(scene, kind, caster, gpu_mapper, "vtk-gpu", runs=3)
        yield Figure(f"{row.name}/vtk-gpu", row.ratio, asked, row=row)


def channel_figures() -> Iterator[Figure]:
    """Compare sixteen channels with three: the engine in two bases, flat and shaded."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)
    lights, reflectances = light_set("smooth"), reflectance_set("training")
    # Principal components: the time of a cast does not depend on the fitting method.
    many, few = (
        replace(
            scene.transfer,
            basis=SpectralBasis.fit(lights, reflectances, size=size, method="pca"),
        )
        for size in (MANY_CHANNELS, FEW_CHANNELS)
    )
    for kind, spec in STOPPED.items():
        row = compare(
            f"channels/engine/{kind}",
            f"{FEW_CHANNELS}-channels",
            caster.device,
            lambda spec=spec: raycast(scene.volume, many, scene.camera, SIZE, spec, caster=caster),
            lambda spec=spec: raycast(scene.volume, few, scene.camera, SIZE, spec, caster=caster),
        )
        yield Figure(f"{row.name}: 16/3", 1 / row.ratio, ASKED_CHANNELS, at_most=True, row=row)


def edit_figures() -> Iterator[Figure]:
    """Compare the first picture after an edit with a cast whose table is ready."""
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)
    table = scene.transfer.bake(min(scene.volume.spacing_mm))
    edits = count()

    def edited() -> TransferFunction:
        # Opaque enough to cost the same, but different each time.
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
        ).wall
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
        yield Figure(row.name, more_ms, ASKED_EDIT_MS, at_most=True, unit="ms", row=row)
    # The engine's bricks as those of 1024³ voxels.
    ranges = brick_ranges(scene.volume.values)
    places = [np.arange(1024 // BRICK) * n // (1024 // BRICK) for n in ranges[0].shape]
    low, high = (np.ascontiguousarray(each[np.ix_(*places)]) for each in ranges)
    alone = in_turn(lambda: brick_codes(low, high, [table], RaycastSpec(), 1.0), lambda: None)
    codes_ms = float(np.median(alone.wall[:, 0]))
    yield Figure("edit/codes of 1024³ voxels", codes_ms, ASKED_CODES_MS, at_most=True, unit="ms")


def shadow_specs(
    towards: Iterable[Vector], shadows: bool, physical: bool = False
) -> list[RaycastSpec]:
    """Return specs of one light from over the camera's shoulder, one for each direction."""
    keys = (Directional(each, frame="camera", shadows=shadows) for each in towards)
    return [
        replace(
            STOPPED["shaded"],
            groups=(LightGroup("key", (Ambient(), key)),),
            physical_light=physical,
        )
        for key in keys
    ]


def shadow_figures() -> Iterator[Figure]:
    """Compare one light on the engine with and without shadows, and physical ones with these.

    A light that moves for every picture needs a new light volume each time.
    """
    scene = bench_scene("engine")
    caster = Raycaster(scene.volume)

    def cast(spec: RaycastSpec) -> CoefficientImage:
        return raycast(scene.volume, scene.transfer, scene.camera, SIZE, spec, caster=caster)

    def figure(
        name: str,
        peer: str,
        ours: list[RaycastSpec],
        theirs: list[RaycastSpec],
        asked: float | None = None,
    ) -> Figure:
        our, their = cycle(ours), cycle(theirs)
        row = compare(
            f"shadows/{name}",
            peer,
            caster.device,
            lambda: cast(next(our)),
            lambda: cast(next(their)),
        )
        return Figure(row.name, 1 / row.ratio, asked, at_most=True, row=row)

    moving, still = TOWARDS, TOWARDS[:1]
    shadows = shadow_specs(moving, True)
    yield figure("engine", "no-shadows", shadows, shadow_specs(moving, False), ASKED_SHADOWS)
    yield figure("physical, light moves", "default", shadow_specs(moving, True, True), shadows)
    yield figure("physical, light stays", "default", shadow_specs(still, True, True), shadows[:1])


def light_figures(steps: dict[str, float]) -> Iterator[Figure]:
    """Swap the light on the demo's engine: new light in, finished 8-bit frame out.

    VTK redraws with a step, in smallest spacings, for each kind. Ours is the time per change in a
    drag of eight; a single change takes a third longer, since the other side has just emptied the
    caches.
    """
    scene = Scene.load(asset("data/scenes/engine.toml"))
    lights = cycle([light.rig for light in scene.lights])
    bench = bench_scene("engine")
    with Relighter(scene.render(bench.volume)) as relighter:
        for kind, spec in SPECS.items():
            step_mm = steps[kind] * min(bench.volume.spacing_mm)
            peer = peer_of(bench, replace(spec, step_mm=step_mm))
            row = compare(
                f"light/engine/{kind}",
                "vtk-fixed-point",
                relighter.backend,
                lambda: relighter.frame(next(lights), scene.relight.viewing),
                peer.redraw,
                our_calls=8,
            )
            yield Figure(row.name, row.ratio, ASKED_LIGHT, row=row)
