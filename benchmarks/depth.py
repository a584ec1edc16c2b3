"""Errors of focus, fog, cuts and meshes in layers, against casts: ``python -m benchmarks.depth``.

The volumes, materials and lights of `benchmarks.layer_cases`, with all opacities as cast and with
the first material's at a quarter. Cuts and fog are compared with the float64 march of the
reference, of which samples are left out beyond a cut, and each sample is seen through its fog; on
covered pixels of 96² rays. Focus is compared with the mean of casts from points all over a lens,
each shifted so that the plane in focus stays; under ambient light, as a headlight would move.

Distances are those below which parts of the opacity are: a cut at 30 and 60 %, fog that begins at
the first and leaves 5 % after one and three times the distance from 5 to 95 %, focus at 10 and 90 %
with a circle of confusion of 16 pixels at the other end, of 320². A mesh is a ball of a sixth of
the volume, at the median depth in the middle of the picture, under a shadowing lamp too: all
combinations of the scales 0, 1/4, 1 and 4 are compared with casts of 192² pixels. Errors are the
RMS of sRGB codes, 1 for white, and CIEDE2000 of the frame under D65 in front of black: mean, 99 %.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

from benchmarks.layer_cases import (
    CASES,
    LAYERS_PAGE,
    RIGS,
    SPEC,
    Errors,
    display,
    transfer_of,
)
from benchmarks.measure import replaced
from benchmarks.scenes import Points
from volspec._gpu.sources import asset
from volspec.basis import MaterialBasis
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.image.depth import DepthEffects, axis_cosine
from volspec.image.layers import OpacityLayers, sample_tau
from volspec.mesh.caster import MeshCaster
from volspec.mesh.shapes import shape_mesh
from volspec.pipeline import Raycaster, raycast, relight
from volspec.raycast import RaycastSpec, reference
from volspec.raycast.launch.layer_stream import LayerStream, Samples, empty_rows
from volspec.scene import Scene
from volspec.spectra import light
from volspec.transfer import TransferFunction, TransferTable
from volspec.volume import Volume

Array = NDArray[np.float64]
SIDE = 96
FOCUSED = 320, 320
BLUR_PX = 16
COUNTS = 8, 16
QUARTER = 0.25
KINDS = "near", "far", "fog", "focus", "mesh"
WITH_MESH = 192, 192


@dataclass(frozen=True, slots=True)
class _Case:
    """Settings whose picture is compared, and the scales of the materials."""

    kind: str
    effects: DepthEffects
    scales: tuple[float, float, float]


class Truth:
    """The picture of a table's materials under effects, sample by sample: a `SampleStream`."""

    def __init__(self, case: _Case, scales: Array, cosine: Array) -> None:
        self.effects, self.scales, self.cosine = case.effects, scales, cosine
        rays = len(cosine)
        self.through, self.lit, self.white = np.ones(rays), np.ones(rays), np.zeros(rays)
        self.channels = np.zeros((rays, 4))

    def add(self, rays: NDArray[np.int64], samples: Samples) -> None:
        """Composite a sample of each of some rays."""
        effects, along = self.effects, samples.distance
        far = math.inf if effects.far_mm is None else effects.far_mm
        deep = along * self.cosine[rays]
        inside = (deep >= effects.near_mm) & (deep < far)
        tau = (sample_tau(samples.alpha) * inside)[:, None] * samples.weights * self.scales
        total = tau.sum(axis=1)
        seen = self.through[rays] * -np.expm1(-total)
        lit = np.exp(-effects.fog_per_mm * np.maximum(along - effects.fog_from_mm, 0))
        self.white[rays] += self.through[rays] * (self.lit[rays] - lit)
        self.lit[rays] = lit
        part = lit * seen / np.maximum(total, 1e-300)
        self.channels[rays, :3] += (part * samples.factor[:, 0])[:, None] * tau
        self.channels[rays, 3] += lit * seen * samples.highlight[:, 0]
        self.through[rays] -= seen

    def picture(self, columns: list[int]) -> tuple[Array, Array]:
        """Return the channels and what is left of light from behind."""
        effects = self.effects
        end = 1.0 if effects.fog_mm is None else 0.0
        channels = self.channels[:, [*np.argsort(columns), 3]]
        white = self.white + self.through * (self.lit - end)
        channels[:, 3] += effects.fog_white * white
        return channels, self.through * end


def subject(
    volume: Volume, points: Points, orbit: dict[str, Any]
) -> tuple[TransferFunction, MaterialBasis, Camera]:
    """Return a case's function, its basis and its camera."""
    transfer = transfer_of(points)
    assert isinstance(transfer, TransferFunction)
    assert isinstance(transfer.basis, MaterialBasis)
    return transfer, transfer.basis, Camera.orbit(volume, **orbit)


def marched(
    volume: Volume, points: Points, orbit: dict[str, Any]
) -> dict[tuple[int, str], list[Errors]]:
    """Return the errors of cuts and fog, by layers and kind: as cast, and a material at 1/4."""
    transfer, basis, camera = subject(volume, points, orbit)
    spec = replace(SPEC, step_mm=0.5 * volume.finest_mm, layers=COUNTS[0])
    caster = Raycaster(volume)
    table = caster.bake(transfer)
    assert isinstance(table, TransferTable)
    columns = table.channels.argmax(axis=1).tolist()
    image = cast_layers(caster, table, camera, (SIDE, SIDE), spec, basis)
    covered = np.flatnonzero(image.alpha.ravel() > 0.01)
    cosine = axis_cosine((SIDE, SIDE), camera.fov_deg).ravel().astype(np.float64)
    cases = list(cut_and_fogged(image))
    truths = [Truth(case, np.array(case.scales)[columns], cosine) for case in cases]
    streams = [LayerStream(SIDE * SIDE, count, 1, 3) for count in COUNTS]
    reference.cast_layers(*(volume, table, camera, (SIDE, SIDE), spec), streams=(*truths, *streams))
    codes = display(basis)
    found: dict[tuple[int, str], list[Errors]] = {}
    for stream, (case, truth) in itertools.product(streams, zip(cases, truths, strict=True)):
        rows = stream.rows().reshape(SIDE, SIDE, stream.layers, -1).astype(np.float16)
        layers = OpacityLayers.of_rows(rows, columns, 3, 1)
        image = replace(image, opacity_layers=layers)
        made = image.recompose(dict(zip(basis.materials, case.scales, strict=True)), case.effects)
        shown = made.coefficients.reshape(-1, 4), 1 - made.alpha.ravel()
        both = [
            codes(*(np.asarray(each[covered], np.float64) for each in side))[None]
            for side in (shown, truth.picture(columns))
        ]
        found.setdefault((stream.layers, case.kind), []).append(Errors.of(*both))
    return found


def cast_layers(
    caster: Raycaster,
    table: TransferTable,
    camera: Camera,
    size: tuple[int, int],
    spec: RaycastSpec,
    basis: MaterialBasis,
) -> CoefficientImage:
    """Return a picture with layers, which are of half precision as a file's are."""
    rows = empty_rows(table, size, spec)
    cast = caster.cast(table, camera, size, spec, layers=rows)
    columns = table.channels.argmax(axis=1).tolist()
    layers = OpacityLayers.of_rows(rows.astype(np.float16), columns, 3, 1)
    return CoefficientImage(
        *(cast.coefficients, cast.alpha, cast.depth_mm, basis),
        fov_deg=camera.fov_deg,
        opacity_layers=layers,
    )


def opacity_quantiles(image: CoefficientImage, parts: list[float]) -> list[float]:
    """Return the distances along the axis before which parts of the seen opacity are."""
    layers = image.opacity_layers
    assert layers is not None
    tau = layers.tau.astype(np.float64).sum(axis=3)
    through = np.exp(-np.cumsum(tau, axis=2) + tau)
    seen = (through * -np.expm1(-tau)).ravel()
    cosine = axis_cosine(image.size, image.fov_deg)[..., None]
    deep = np.where(tau > 0, layers.depth_mm, 0).astype(np.float64) * cosine
    order = np.argsort(deep.ravel())
    share = np.cumsum(seen[order]) / seen.sum()
    return np.interp(parts, share, deep.ravel()[order]).tolist()


def cut_and_fogged(image: CoefficientImage) -> Iterator[_Case]:
    """Yield cuts and fogs."""
    first, near, far, last = opacity_quantiles(image, [0.05, 0.3, 0.6, 0.95])
    for scales in ((1.0, 1.0, 1.0), (QUARTER, 1.0, 1.0)):
        for at in (near, far):
            yield _Case("near", DepthEffects(near_mm=at), scales)
            yield _Case("far", DepthEffects(far_mm=at), scales)
        for times in (1, 3):
            fog = DepthEffects(fog_mm=times * (last - first), fog_from_mm=0.95 * first)
            yield _Case("fog", fog, scales)


def focused(
    volume: Volume, points: Points, orbit: dict[str, Any]
) -> dict[tuple[int, str], list[Errors]]:
    """Return the errors of focus, by layers."""
    transfer, basis, camera = subject(volume, points, orbit)
    spec = replace(SPEC, ambient=1.0, diffuse=0.0, specular=0.0, step_mm=0.5 * volume.finest_mm)
    caster = Raycaster(volume)
    table = caster.bake(transfer)
    assert isinstance(table, TransferTable)
    images = [
        cast_layers(caster, table, camera, FOCUSED, replace(spec, layers=count), basis)
        for count in COUNTS
    ]
    codes = display(basis)
    found: dict[tuple[int, str], list[Errors]] = {(n, "focus"): [] for n in COUNTS}
    first, last = opacity_quantiles(images[0], [0.1, 0.9])
    for focus, other in ((first, last), (last, first)):
        per_aperture = DepthEffects(focus_mm=focus, aperture_mm=1.0).blur_px(
            FOCUSED[1], camera.fov_deg
        )
        aperture = BLUR_PX / (per_aperture * abs(1 - focus / other))
        effects = DepthEffects(focus_mm=focus, aperture_mm=aperture)
        true = by_lens(caster, table, camera, spec, effects)
        covered = true[1] > 0.01
        for count, image in zip(COUNTS, images, strict=True):
            made = image.recompose({}, effects)
            shown = made.coefficients.astype(np.float64), made.alpha.astype(np.float64)
            both = [
                codes(channels[covered].astype(np.float64), 1 - alpha[covered])[None]
                for channels, alpha in (shown, true)
            ]
            found[count, "focus"].append(Errors.of(*both))
    return found


def with_mesh(
    volume: Volume, points: Points, orbit: dict[str, Any]
) -> dict[tuple[int, str], list[Errors]]:
    """Return the errors of opacities around and within a mesh, by layers."""
    transfer, basis, camera = subject(volume, points, orbit)
    caster = Raycaster(volume)
    spec = replace(SPEC, step_mm=0.5 * volume.finest_mm, groups=RIGS["one group"])
    middle = np.array(camera.target_mm)
    depth_mm = raycast(volume, transfer, camera, WITH_MESH, spec, caster=caster).depth_mm
    towards = np.array(camera.position_mm) - middle
    away = np.linalg.norm(towards)
    middle += towards / away * (away - float(np.median(depth_mm[np.isfinite(depth_mm)])))
    side = float(np.ptp(volume.corners_mm, axis=0).min()) / 6
    ball = shape_mesh("sphere", side, next(iter(basis.materials))).placed(tuple(middle))
    behind = (MeshCaster([ball], transfer.materials, basis),)

    def cast(layers: int, opacities: dict[str, float]) -> CoefficientImage:
        own = replace(spec, layers=layers, opacities=opacities)
        return raycast(volume, transfer, camera, WITH_MESH, own, caster=caster, behind=behind)

    images = [cast(count, {}) for count in COUNTS]
    codes = display(basis)
    states = [
        dict(zip(basis.materials, scales, strict=True))
        for scales in itertools.product((0.0, QUARTER, 1.0, 4.0), repeat=3)
    ]
    covered = images[0].alpha > 0.01

    def shown(made: CoefficientImage) -> Array:
        own = made.coefficients[covered], 1 - made.alpha[covered]
        return codes(*(each.astype(np.float64) for each in own))

    true = np.stack([shown(cast(0, state)) for state in states])
    return {
        (count, "mesh"): [Errors.of(np.stack([shown(image.recompose(s)) for s in states]), true)]
        for count, image in zip(COUNTS, images, strict=True)
    }


def by_lens(
    caster: Raycaster,
    table: TransferTable,
    camera: Camera,
    spec: RaycastSpec,
    effects: DepthEffects,
) -> tuple[Array, Array]:
    """Return the mean of casts from a lens: channels and alpha.

    A cast from u on the lens is shifted by u f / z₀ pixels, whole ones, as points are a grid.
    """
    focus, size = effects.focus_mm, FOCUSED
    assert focus is not None and effects.aperture_mm is not None
    pixel_mm = focus * 2 * math.tan(math.radians(camera.fov_deg) / 2) / size[1]
    radius = 0.5 * effects.aperture_mm / pixel_mm
    step = max(1, round(radius / 4))
    most = int(radius // step)
    offsets = [step * k for k in range(-most, most + 1)]
    right, up, _ = camera.frame()
    sums, count = np.zeros((size[1], size[0], 5)), 0
    for x, y in itertools.product(offsets, offsets):
        if math.hypot(x, y) > radius:
            continue
        move = pixel_mm * (x * right - y * up)
        moved = replace(
            camera,
            position_mm=tuple(np.add(camera.position_mm, move)),
            target_mm=tuple(np.add(camera.target_mm, move)),
        )
        cast = caster.cast(table, moved, size, spec)
        both = np.concatenate([cast.coefficients, cast.alpha[..., None]], axis=2)
        sums += np.roll(both, (y, x), axis=(0, 1))
        count += 1
    return sums[..., :4] / count, sums[..., 4] / count


def table_of(name: str, count: int, found: dict[tuple[int, str], list[Errors]]) -> str:
    """Return a line: RMS, mean and 99 % of CIEDE2000 by kind, means of the cases."""
    cells = []
    for kind in KINDS:
        each = found[count, kind]
        rms, mean, most = (
            float(np.mean([getattr(e, key) for e in each])) for key in ("rms", "mean", "most_of")
        )
        cells.append(f"{rms:.4f} {mean:.2f} {most:.1f}")
    return f"{name:9s}{count:3d}" + "".join(f"{cell:>20s}" for cell in cells)


STATES = (
    DepthEffects(),
    DepthEffects(focus_mm=470, aperture_mm=40),
    DepthEffects(focus_mm=620, aperture_mm=40),
    DepthEffects(fog_mm=330, fog_from_mm=440, fog_white=0.35),
    DepthEffects(near_mm=520),
)


def six_states() -> NDArray[np.uint8]:
    """Return frames of one cast of the shipped engine: in depth, and with a ball inside."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume, transfer, size = scene.volume(), scene.transfer, (360, 360)
    assert isinstance(transfer, TransferFunction)
    basis = MaterialBasis(transfer.materials)
    camera, spec = scene.camera(volume), replace(scene.raycast, layers=COUNTS[0])
    image = raycast(volume, replace(transfer, basis=basis), camera, size, spec)
    ball = shape_mesh("sphere", 70.0, "inserts").placed((180.0, 130.0, 60.0))
    alone = MeshCaster([ball], transfer.materials, basis).alone(camera, size, spec)
    frames = [image.recompose({}, each) for each in STATES]
    frames.append(image.recompose({"inserts": 0}, surface=alone))
    shown = [relight(each, light("A"), scene.relight) for each in frames]
    return np.vstack([np.hstack(shown[:3]), np.hstack(shown[3:])]).astype(np.uint8)


def main() -> None:
    """Print the table; with ``--keep``, write it to docs/layers.md, and its picture."""
    lines = ["layers".rjust(12) + "".join(f"{kind:>20s}" for kind in KINDS)]
    print(lines[0])
    for name, (read, points, orbit) in CASES.items():
        try:
            volume = read()
        except FileNotFoundError as error:
            lines.append(f"{name:12s}left out: {error}")
        else:
            given = volume, points, orbit
            found = marched(*given) | focused(*given) | with_mesh(*given)
            lines += [table_of(name, count, found) for count in COUNTS]
        print("\n".join(lines[-len(COUNTS) :]), flush=True)
    if "--keep" in sys.argv[1:]:
        text = "\n```text\n" + "\n".join(lines) + "\n```\n"
        page = LAYERS_PAGE.read_text(encoding="utf-8")
        LAYERS_PAGE.write_text(replaced(page, "depth", text), encoding="utf-8")
        iio.imwrite(LAYERS_PAGE.parent / "images" / "depth.jpg", six_states(), quality=92)


if __name__ == "__main__":
    main()
