"""Does halving the step at least halve the error? ``python -m benchmarks.convergence``.

RMS and maximum error of the channels against a very fine step, without jitter or early ray
termination; the order is log2 of the error ratio when the step is halved. The table goes into
``docs/benchmarks.md``.

``python -m benchmarks.convergence --quality`` prints, for 43 scenes with thin walls, small things,
details, flat bodies along an axis and isosurfaces, the error of each quality by what it promises,
and the step in voxels; and how many are above 1.2 without a warning. Words after it choose scenes
by their names.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.measure import PAGE, replaced
from benchmarks.scenes import bench_scene
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Ambient, Directional, LightGroup, RaycastSpec
from volspec.raycast.step_search import TARGETS
from volspec.spectra import reflectance
from volspec.transfer import Isosurfaces, LabelFunction, TransferFunction, TransferTable
from volspec.volume import Volume, phantom

SIZE = (256, 256)
STEPS = (2.0, 1.0, 0.5, 0.25, 0.125)
FINEST = 1 / 64
SPECS = {
    "flat": RaycastSpec(ambient=1, diffuse=0, alpha_stop=1),
    "shaded": RaycastSpec(ambient=0.3, diffuse=0.7, alpha_stop=1),
}


@dataclass(frozen=True, slots=True)
class Error:
    """Error of one step size, in voxels, against the finest."""

    step: float
    rms: float
    most: float


def ball() -> tuple[Volume, TransferTable, Camera]:
    """Return a smooth phantom: opacity and grey are linear in a value that is a cone in space."""
    volume = phantom.ball(64)
    rise = np.linspace(0, 1, 1024)
    return volume, TransferTable((0, 1), 0.1 * rise, rise[:, None], 1.0), Camera.orbit(volume)


def engine() -> tuple[Volume, TransferTable, Camera]:
    """Return the demo: metal edges, a transfer function with corners."""
    scene = bench_scene("engine")
    return scene.volume, scene.transfer.bake(min(scene.volume.spacing_mm)), scene.camera


def errors(
    volume: Volume, table: TransferTable, camera: Camera, spec: RaycastSpec
) -> Iterator[Error]:
    """Halve the step."""
    caster, unit = Raycaster(volume), min(volume.spacing_mm)

    def channels(step: float) -> np.ndarray:
        stepped = replace(spec, step_mm=step * unit)
        return caster.cast(table, camera, SIZE, stepped)[0].astype(np.float64)

    truth = channels(FINEST)
    for step in STEPS:
        off = np.abs(channels(step) - truth)
        yield Error(step, float(np.sqrt(np.mean(off**2))), float(off.max()))


def table() -> str:
    """Return the table for the page."""
    lines = [
        "| volume | shading | step, voxels | RMS | greatest | order |",
        "|---|---|---|---|---|---|",
    ]
    for make in (ball, engine):
        for kind, spec in SPECS.items():
            last = None
            for error in errors(*make(), spec):
                order = f"{math.log2(last.rms / error.rms):.2f}" if last else ""
                lines.append(
                    f"| {make.__name__} | {kind} | {error.step:g} | {error.rms:.1e} | "
                    f"{error.most:.1e} | {order} |"
                )
                last = error
    return "\n".join(lines)


SIDE = 64
Z, Y, X = np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2
Array = NDArray[np.floating]
MATERIALS = {
    **{name: reflectance(name) for name in ("copper", "gold")},
    **{n: reflectance(f"grey:{v}") for n, v in (("black", 0.05), ("grey", 0.5), ("white", 0.9))},
}
BASIS = SpectralBasis.load("general-7")


def away(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """Return the voxels' distances from a place."""
    return np.sqrt((X - x) ** 2 + (Y - y) ** 2 + (Z - z) ** 2)


def sheet(thick: float, tilt: float = 0.0) -> Array:
    """Return a plane."""
    return np.clip(thick - np.abs(X * np.cos(tilt) + Y * np.sin(tilt)), 0, 1) * 255


def beads() -> Array:
    """Return 60 balls, three voxels across."""
    places = np.random.default_rng(3).uniform(-26, 26, (60, 3))
    return np.max([(1.6 - away(*place)) * 120 + 128 for place in places], axis=0)


def gyroid() -> Array:
    """Return a curved surface that fills the volume."""
    x, y, z = (axis * np.pi / 8 for axis in (X, Y, Z))
    waves = np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)
    return 128 + 80 * waves


def noise(smooth: float = 2.0) -> Array:
    """Return smooth noise."""
    values = gaussian_filter(np.random.default_rng(1).normal(size=(SIDE,) * 3), smooth)
    return 128 + 45 * values / values.std()


def shells() -> Array:
    """Return nested shells, 1.6 voxels thick."""
    return np.where(np.abs(away() % 8 - 4) < 0.8, 200.0, 0.0)


def detail() -> Array:
    """Return a soft slab, and a small hard shell in front of it."""
    slab = np.clip(60 - np.abs(X + 16) * 3, 0, 60)
    return np.maximum(slab, np.where((away(12) > 6) & (away(12) < 7.2), 200, 0))


def tubes() -> Array:
    """Return six wound tubes."""
    found = np.zeros((SIDE,) * 3)
    for s in range(6):
        x, y = 12 * np.sin(s) + 6 * np.sin(Z / 9 + s), 12 * np.cos(2 * s) + 6 * np.cos(Z / 7 + s)
        found = np.maximum(found, (1.7 - np.hypot(X - x, Y - y)) * 100 + 128)
    return found


def cells() -> Array:
    """Return labels 1 to 6 of touching cells."""
    places = np.random.default_rng(2).uniform(-32, 32, (40, 3))
    apart = np.stack([away(*place) for place in places])
    return np.where(apart.min(axis=0) < 12, apart.argmin(axis=0) % 6 + 1, 0)


def surfaces(*points: Any) -> Isosurfaces:
    """Return isosurfaces."""
    return Isosurfaces(points, MATERIALS, BASIS)


def curve(*points: Any) -> TransferFunction:
    """Return a transfer function."""
    return TransferFunction(points, MATERIALS, BASIS)


def ramp(low: float, high: float) -> TransferFunction:
    """Return a curve from black to white."""
    return curve((low, 0, "black"), (high, 1, "white"))


Case = tuple[Callable[[], Volume | Array], Any, dict[str, Any], RaycastSpec]
SOFT = curve((90, 0, "grey"), (150, 0.3, "copper"), (255, 0.6, "white"))
HARD = curve((127, 0, "grey"), (128, 0.95, "grey"), (180, 0.95, "copper"), (181, 0.95, "white"))
THIN = curve(
    *((20, 0, "grey"), (60, 0.05, "grey"), (100, 0.05, "grey"), (130, 0, "copper")),
    *((131, 0.9, "copper"), (255, 0.9, "copper")),
)
PEAK = curve((120, 0, "grey"), (128, 0.8, "white"), (136, 0, "black"))
TWO_TONE = curve((100, 0, "black"), (110, 0.9, "black"), (150, 0.9, "black"), (151, 0.9, "white"))
FAINT = curve((50, 0, "grey"), (199, 0.04, "white"), (200, 0.04, "copper"))
FOG = curve((0, 0.3, "white"), (255, 0.3, "white"))
LABELS = LabelFunction(
    {n: (0.9, (*MATERIALS, "grey")[n - 1]) for n in range(1, 7)}, MATERIALS, BASIS
)
WALL = surfaces((230, 1.0, "grey"))
ONE = surfaces((128, 1.0, "grey"))
TWO = surfaces((100, 0.4, "grey"), (180, 0.6, "copper"))
PLAIN = RaycastSpec()
ASIDE = RaycastSpec(groups=(LightGroup("side", (Ambient(), Directional((1, 0.2, 0.3)))),))
LIT = RaycastSpec(
    groups=(LightGroup("sun", (Ambient(occlusion=True), Directional((1, 0.5, 1), shadows=True))),)
)
GLOSSY = RaycastSpec(specular=0.4, shininess=60)
CROP = RaycastSpec(crop_voxels=((20, 150), (30, 200), (20, 90)))
FLAT, LONG = RaycastSpec(ambient=1, diffuse=0), RaycastSpec(preintegrated=True)
MAX, MEAN = RaycastSpec(mode="maximum"), RaycastSpec(mode="average")
ALONG = {"azimuth_deg": 70, "elevation_deg": 10, "orthographic": True}
FACING = {"azimuth_deg": 90, "elevation_deg": 0, "orthographic": True}
NEAR = {"azimuth_deg": 80, "zoom": 8, "target_mm": (43.5, 31.5, 31.5)}
ENGINE = {"azimuth_deg": 148, "elevation_deg": 32, "up": (0, 0, -1)}


def edge() -> Array:
    """Return a ball."""
    return (22 - away()) * 40 + 128


def whole_engine() -> Volume:
    """Return the demo's volume."""
    return bench_scene("engine").volume


CASES: dict[str, Case] = {
    "iso: sheet": (lambda: sheet(1.5), WALL, {}, PLAIN),
    "iso: sheet, detail": (lambda: sheet(1.5), WALL, {**ALONG, "zoom": 4}, PLAIN),
    "iso: tilted thin sheet": (lambda: sheet(1.0, 0.5), surfaces((99, 1, "grey")), ALONG, PLAIN),
    "iso: ball": (edge, ONE, {}, PLAIN),
    "iso: ball, light aside": (edge, surfaces((128, 1, "white")), {}, ASIDE),
    "iso: beads": (beads, ONE, {}, PLAIN),
    "iso: beads, detail": (beads, ONE, {"zoom": 5}, PLAIN),
    "iso: gyroid": (gyroid, ONE, {}, PLAIN),
    "iso: gyroid, two translucent": (gyroid, TWO, {}, PLAIN),
    "iso: noise": (noise, ONE, {}, PLAIN),
    "iso: rough noise, detail": (lambda: noise(0.8), ONE, {"zoom": 6}, PLAIN),
    "iso: tubes": (tubes, surfaces((128, 0.8, "copper")), {}, PLAIN),
    "iso: shells, translucent": (shells, surfaces((100, 0.3, "white")), {}, PLAIN),
    "iso: engine": (whole_engine, TWO, ENGINE, PLAIN),
    "iso: engine, detail": (whole_engine, TWO, {**ENGINE, "zoom": 8}, PLAIN),
    "iso: engine, cut": (whole_engine, TWO, {}, CROP),
    "slab and shell, detail": (detail, THIN, NEAR, PLAIN),
    "slab and shell": (detail, THIN, {}, PLAIN),
    "sheet": (lambda: sheet(1.5), HARD, ALONG, PLAIN),
    "tilted thin sheet": (lambda: sheet(1.0, 0.4), HARD, ALONG, PLAIN),
    "flat, along an axis": (lambda: sheet(3.6), SOFT, FACING, PLAIN),
    "flat, hard edge, along an axis": (lambda: sheet(5.4), HARD, FACING, PLAIN),
    "flat, black to white, along it": (lambda: sheet(5.4), TWO_TONE, FACING, PLAIN),
    "beads": (beads, HARD, {}, PLAIN),
    "beads, far away": (beads, SOFT, {"zoom": 0.3}, PLAIN),
    "ball, hard edge": (edge, HARD, {}, PLAIN),
    "shells, faint": (shells, FAINT, {}, PLAIN),
    "gyroid": (gyroid, SOFT, {}, PLAIN),
    "gyroid, narrow peak": (gyroid, PEAK, {}, PLAIN),
    "noise": (noise, SOFT, {}, PLAIN),
    "noise, black to white": (noise, TWO_TONE, {}, PLAIN),
    "rough noise, detail, highlights": (lambda: noise(0.8), HARD, {"zoom": 5}, GLOSSY),
    "tubes, light aside": (tubes, HARD, {}, ASIDE),
    "tubes, shadows": (tubes, SOFT, {}, LIT),
    "cells, labels": (cells, LABELS, {}, PLAIN),
    "fog": (lambda: np.full((SIDE,) * 3, 128), FOG, {}, FLAT),
    "noise, preintegrated": (noise, HARD, {}, LONG),
    "noise, maximum": (noise, ramp(128, 255), {}, MAX),
    "beads, average": (beads, ramp(0, 20), {}, MEAN),
    "beads, maximum, detail": (beads, ramp(0, 255), {"zoom": 4}, MAX),
    "flat voxels": (
        lambda: Volume(noise()[::4].astype(np.uint8), spacing_mm=(1, 1, 4)),
        *(SOFT, {}, PLAIN),
    ),
    "engine": (whole_engine, bench_scene("engine").transfer, ENGINE, PLAIN),
    "engine, detail": (
        *(whole_engine, bench_scene("engine").transfer),
        *({**ENGINE, "zoom": 6}, PLAIN),
    ),
}


def by_promise(
    case: Case, size: tuple[int, int] = (160, 120)
) -> Iterator[tuple[float, float, bool]]:
    """Yield each quality's error by what it promises, its step in voxels, and if it warned."""
    make, transfer, view, spec = case
    values = make()
    if not isinstance(values, Volume):
        values = Volume(np.clip(values, 0, 255).astype(np.uint8))
    volume, unit, view = values, min(values.spacing_mm), {"azimuth_deg": 33, **view}
    caster, camera = Raycaster(volume), Camera.orbit(volume, **view)

    def cast(**change: Any) -> Any:
        return raycast(volume, transfer, camera, size, replace(spec, **change), caster=caster)

    true = cast(step_mm=unit / 32, alpha_stop=1.0)
    for name, target in TARGETS.items():
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            image = cast(quality=name)
        apart = (image.coefficients - true.coefficients)[true.alpha > 0.01]
        error = float(np.sqrt(np.mean(apart**2))) / target.error
        step_mm = float(image.notes["raycast"].partition("step_mm=")[2].partition(",")[0])
        yield error, step_mm / unit, any("quality" in str(each.message) for each in said)


def print_promises(words: list[str]) -> None:
    """Print the errors of `CASES` by what qualities promise; ``!`` is a warning."""
    broken = count = 0
    for name, case in CASES.items():
        if words and not any(word in name for word in words):
            continue
        found = list(by_promise(case))
        broken += sum(error > 1.2 and not warned for error, _, warned in found)
        count += len(found)
        columns = [f"{e:6.2f}{'!' if warned else ' '} at {s:<7.3g}" for e, s, warned in found]
        print(f"{name:32}", *columns, flush=True)
    print(f"above 1.2 without a warning: {broken} of {count}")


if __name__ == "__main__":
    if "--quality" in sys.argv[1:]:
        print_promises(sys.argv[2:])
        sys.exit()
    found = table()
    print(found)
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(text, "convergence", f"\n{found}\n"), encoding="utf-8")
