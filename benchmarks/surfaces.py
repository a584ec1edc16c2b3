"""Surfaces: casts of meshes alone and in a volume, colours made spectral, figure 5's two paints.

    python -m benchmarks.surfaces       these figures alone

References
----------
[1] Bergner, Drew & Möller (2009), ACM Transactions on Graphics 28(1), article 5.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Mapping
from statistics import median
from typing import Any

import colour
import numpy as np
import pyvista
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

import volspec as vs
from benchmarks.measure import Figure, in_turn, report
from benchmarks.scenes import ROOT
from volspec.mesh.paint import texel_channels
from volspec.spectra import XYZ_from_spectra, white_XYZ
from volspec.spectra.construct.colours import XYZ_from_sRGB

BASIS = vs.SpectralBasis.load("general-7")
LIT = vs.RaycastSpec(
    groups=(vs.LightGroup("key", (vs.Directional((0.4, -0.6, 0.8), shadows=True),)),)
)


def figures() -> Iterator[Figure]:
    """Yield all figures of surfaces."""
    codes = np.random.default_rng(1).integers(0, 256, (2048, 2048, 3), np.uint8)
    texture = vs.Texture(codes)
    texel_channels(texture, {}, BASIS)  # builds the lattice and the kernel
    took = _seconds(lambda: texel_channels(texture, {}, BASIS))
    yield Figure("surfaces/RGB texture of 2048²", took, 0.5, at_most=True, unit="s")
    found = texel_channels(texture, {}, BASIS)[:256, :256].astype(np.float64)
    day = vs.light("D65")
    wanted = XYZ_from_sRGB(codes[:256, :256] / 255.0, white_XYZ(day))
    error = difference(day, wanted, BASIS.xyz(found, day)).mean()
    yield Figure(
        "surfaces/RGB texture, back under D65, CIEDE2000", error, 0.3, at_most=True, unit=""
    )
    paints = flame_paints()
    for name, limit, at_most in (("D65", 1.0, True), ("HP1", 15.0, False)):
        off = float(paint_difference(paints, name))
        yield Figure(
            f"surfaces/flame and body under {name}, CIEDE2000", off, limit, at_most, unit=""
        )
    yield from _depth()
    yield from _casts()


def flame_paints() -> dict[str, vs.Spectrum]:
    """Return the paints of figure 5 [1], as the palette of figure 1 designs them."""
    made = vs.design(vs.load_palette(ROOT / "data" / "palettes" / "figure-1.toml"))
    return {name: made.reflectance(name) for name in ("flame", "paint")}


def paint_difference(paints: Mapping[str, vs.Spectrum], lamp: str) -> float:
    """Return CIEDE2000 between two paints under a lamp."""
    light = vs.light(lamp)
    one, other = XYZ_from_spectra(light, [*paints.values()])
    return float(difference(light, one, other))


def difference(light: vs.Spectrum, one: NDArray[Any], other: NDArray[Any]) -> NDArray[Any]:
    """Return CIEDE2000 between XYZ (..., 3) under a light."""
    white = white_XYZ(light)
    lab = (colour.XYZ_to_Lab(each / 100.0, white[:2] / white.sum()) for each in (one, other))
    return np.asarray(colour.delta_E(*lab, method="CIE 2000"))


def _casts() -> Iterator[Figure]:
    grey = {"grey": vs.reflectance("grey:0.6")}
    million = pyvista.Sphere(radius=40.0, theta_resolution=1000, phi_resolution=501)
    mesh = vs.Mesh.of(million.compute_normals(), "grey")
    caster = vs.MeshCaster([mesh], grey, BASIS)
    turns = iter(range(100))

    def turned() -> object:
        camera = vs.Camera((3.0 * next(turns), -160.0, 60.0), (0.0, 0.0, 0.0))
        return caster.alone(camera, (1024, 1024), LIT)

    name = f"surfaces/{len(mesh.triangles) / 1e6:.1f} M triangles, 1024²"
    yield Figure(name, _seconds(turned), 1.5, at_most=True, unit="s")
    volume = vs.load_volume(ROOT / "data" / "engine.nrrd")
    transfer = vs.TransferFunction([(90, 0.0, "grey"), (180, 0.3, "grey")], grey, BASIS)
    ball = pyvista.Sphere(radius=30.0, theta_resolution=320, phi_resolution=160)
    inside = vs.Mesh.of(ball.compute_normals(), "grey").placed(volume.corners_mm.mean(axis=0))
    within = vs.MeshCaster([inside], grey, BASIS)

    def engine(*behind: vs.MeshCaster) -> Callable[[], object]:
        # One each, as a mesh's shadows are kept with the volume's light.
        device = vs.Raycaster(volume)
        azimuths = itertools.count(0, 7)

        def cast() -> object:
            camera = vs.Camera.orbit(volume, azimuth_deg=float(next(azimuths)))
            size = 1024, 1024
            return vs.raycast(volume, transfer, camera, size, LIT, caster=device, behind=behind)

        return cast

    wall = in_turn(engine(within), engine(), runs=15).wall
    count = len(inside.triangles) / 1000
    name = f"surfaces/engine with {count:.0f},000 triangles, by the cast without"
    yield Figure(name, float(np.median(wall[:, 0] / wall[:, 1])), 1.3, at_most=True)


def _depth() -> Iterator[Figure]:
    """Yield how a sphere in the engine differs from its isosurface on the engine's voxels."""
    volume = vs.load_volume(ROOT / "data" / "engine.nrrd")
    camera, size = vs.Camera.orbit(volume, azimuth_deg=30, elevation_deg=20), (512, 512)
    grey, radius = {"grey": vs.reflectance("grey:0.6")}, 30.0
    middle = volume.corners_mm.mean(axis=0)
    ball = pyvista.Sphere(radius=radius, theta_resolution=320, phi_resolution=160)
    mesh = vs.Mesh.of(ball.compute_normals(), "grey").placed(middle)
    # Next to nothing of the engine is in front.
    clear = vs.TransferFunction([(254, 0.0, "grey"), (255, 1e-6, "grey")], grey, BASIS)
    within = vs.MeshCaster([mesh], grey, BASIS)
    found = vs.raycast(volume, clear, camera, size, behind=(within,))
    steps = zip(volume.values.shape, volume.spacing_mm[::-1], strict=True)
    z, y, x = (np.arange(n) * mm for n, mm in steps)
    away = np.sqrt(
        (z[:, None, None] - middle[2]) ** 2 + (y[:, None] - middle[1]) ** 2 + (x - middle[0]) ** 2
    )
    field = vs.Volume((radius - away).astype(np.float32), spacing_mm=volume.spacing_mm)
    surface = vs.Isosurfaces([(0.0, 1.0, "grey")], grey, BASIS)
    wanted = vs.raycast(field, surface, camera, size, vs.RaycastSpec(step_mm=0.25))
    here, there = found.alpha > 0.5, wanted.alpha > 0.5
    # From each pixel of one silhouette, the pixels to the other.
    apart = max(
        (distance_transform_edt(~one) * other).max()
        for one, other in ((here, there), (there, here))
    )
    name = "surfaces/sphere in the engine and its isosurface, silhouettes"
    yield Figure(name, float(apart), 1.0, at_most=True, unit="px")
    both = here & there
    off = np.abs(found.depth_mm[both] - wanted.depth_mm[both]).max() / min(volume.spacing_mm)
    name = "surfaces/sphere in the engine and its isosurface, depth"
    yield Figure(name, float(off), 0.5, at_most=True, unit="voxels")


def _seconds(action: Callable[[], object]) -> float:
    """Return the median of 5 runs, after one."""
    times = []
    for _ in range(6):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return median(times[1:])


if __name__ == "__main__":
    print(report(list(figures())))
