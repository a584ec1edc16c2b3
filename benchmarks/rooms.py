"""Rooms: time and memory of the radiosity, the brick against triangles, section 5.

    python -m benchmarks.rooms          also prints the table of section 5 [1]

References
----------
[1] Neumann, Castro, Neumann & Sbert (2004), "Color Appearance in Multispectral Radiosity".
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.measure import Figure
from volspec.relight.illumination import Illumination
from volspec.room import (
    Room,
    cube_radiosity,
    irradiance_from_lux,
    load_room,
    lux_from_irradiance,
    solve_room,
    surface_appearance,
)
from volspec.room.brick import PATCHES, Brick
from volspec.room.mesh import RoomMesh, box, panel, rectangle
from volspec.scene import Scene
from volspec.spectra import (
    DEFAULT_GRID,
    SpectralGrid,
    light,
    reflectance_from_colour,
)
from volspec.volume import Volume

ROOMS = Path(__file__).resolve().parent.parent / "data" / "rooms"
# Width, depth, height, window, furnished fraction of the height.
BRICKS = (
    Brick(4.0, 5.0, 2.7, (1.0, 0.9, 2.0, 1.4), 0.3),
    Brick(3.0, 3.0, 3.0, (0.5, 0.5, 2.0, 2.0), 0.5),
    Brick(8.0, 6.0, 3.2, (1.0, 0.8, 6.0, 2.0), 0.25),
    Brick(2.5, 7.0, 2.4, (0.7, 1.0, 1.0, 1.2), 0.4),
    Brick(5.0, 2.0, 2.6, (0.2, 0.2, 4.6, 2.2), 0.1),
)
# Reflectances of floor, ceiling, window wall, upper and lower walls.
GREYS = (0.3, 0.85, 0.7, *(0.75,) * 3, *(0.4,) * 3)


def figures() -> Iterator[Figure]:
    """Yield all figures of rooms."""
    yield from _speed()
    wide = SpectralGrid(360.0, 830.0, 1.0)
    paint = np.full((6, wide.size), 0.7)
    emission = np.full((6, wide.size), 1.0)
    took = min(_seconds(lambda: cube_radiosity(paint, emission, wide)) for _ in range(20))
    yield Figure("room/cube, 471 bands, another paint", 1e3 * took, 2, at_most=True, unit="ms")
    off = [brick_against_triangles(each) for each in BRICKS]
    factors, means = (100.0 * max(each[i] for each in off) for i in range(2))
    yield Figure("room/brick, form factors by rays", factors, 1, at_most=True, unit="%")
    yield Figure("room/brick, against 4000 triangles", means, at_most=True, unit="%")
    yield from scenes()


def _seconds(call: Any) -> float:
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


def _speed() -> Iterator[Figure]:
    """Yield time and memory of 5000 patches in a process of its own, and the ratio of 10,000."""
    found = {}
    for patches in (5000, 10000):
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.rooms", str(patches)],
            capture_output=True,
            text=True,
            check=True,
        )
        found[patches] = json.loads(done.stdout.splitlines()[-1])
    once, twice = found[5000], found[10000]
    yield Figure("room/5000 patches, 31 bands", once["s"], 60, at_most=True, unit="s")
    yield Figure("room/5000 patches, memory", once["GiB"], 4, at_most=True, unit="GiB")
    ratio = twice["s"] / once["s"] / (twice["patches"] / once["patches"] / 2.0)
    yield Figure("room/twice the patches", ratio, 2.6, at_most=True)


def measured(patches: int) -> dict[str, float]:
    """Return seconds and GiB of the study's solution, without imports."""
    import resource

    room = load_room(ROOMS / "study.toml")
    started = time.perf_counter()
    solved = solve_room(room, patches)
    took = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    return {"s": took, "GiB": peak, "patches": len(solved.mesh.surface)}


def scenes() -> Iterator[Figure]:
    """Yield figures of a volume in a room."""
    with tempfile.TemporaryDirectory() as folder:
        path = _ball_in_room(Path(folder))
        scene = Scene.load(path)
        room, volume = scene.room, scene.volume()
        assert room is not None
        off = [_light_on_ball(scene, volume, azimuth) for azimuth in (0.0, 120.0, 240.0)]
        rendered, true = np.concatenate(off, axis=1)
        error = 100.0 * float(np.sqrt(np.mean((rendered - true) ** 2)) / true.mean())
        yield Figure("room/light on an opaque ball, rms", error, 10, at_most=True, unit="%")
        paint = {"walls": "#4060c0"}
        took = min(_seconds(lambda: room.with_paint(paint, estimate=True)) for _ in range(5))
        yield Figure("room/another paint, closed form", 1e3 * took, 33, at_most=True, unit="ms")
        fast, exact = room.with_paint(paint, estimate=True), room.with_paint(paint)
        light, other = (
            lux_from_irradiance(each.response.solved.irradiance) for each in (fast, exact)
        )
        areas = exact.response.solved.mesh.areas_m2
        error = 100.0 * float(np.sqrt(areas @ (light / other - 1.0) ** 2 / areas.sum()))
        yield Figure("room/closed form, lux of patches, rms", error, at_most=True, unit="%")


_BALL = """
version = 2
[volume]
file = "ball.npy"
[[material]]
name = "white"
reflectance = "grey:1"
[transfer]
points = [
    { value = 0.45, opacity = 0, material = "white" },
    { value = 0.55, opacity = 1, material = "white" },
]
[basis]
name = "general-7"
[raycast]
step_mm = 0.25
[camera]
elevation_deg = 20
[room]
file = "room.toml"
position_m = [2, 2.5, 1.2]
[[light]]
name = "own"
spectrum = "room"
"""
# Voxels of the ball's volume and of its radius.
_SIDE, _RADIUS = 96, 40.0


def _ball_in_room(folder: Path) -> Path:
    """Write a white ball of 8 cm in a study, and return its scene's file."""
    offset = np.indices((_SIDE,) * 3) - (_SIDE - 1) / 2
    away = np.linalg.norm(offset, axis=0)
    np.save(folder / "ball.npy", np.clip(_RADIUS + 0.5 - away, 0, 1).astype(np.float32))
    (folder / "room.toml").write_bytes((ROOMS / "study.toml").read_bytes())
    path = folder / "scene.toml"
    path.write_text(_BALL, encoding="utf-8")
    return path


def _light_on_ball(scene: Scene, volume: Volume, azimuth_deg: float) -> NDArray[np.float64]:
    """Return the lux (2, K) on points of the ball: as rendered, and gathered by rays."""
    seen = scene.with_camera(replace(scene.file.camera, azimuth_deg=azimuth_deg))
    image, camera = seen.render(volume, size=(64, 64)), seen.camera(volume)
    lit = Illumination.of(image.basis, scene.lights[0].rig, scene.relight, image.groups)
    Y = lit.scene_XYZ(image.coefficients, image.alpha)[..., 1]
    right, up, forward = camera.frame()
    x, y = np.meshgrid(*(np.arange(64) - 31.5,) * 2)
    slope = math.tan(math.radians(camera.fov_deg / 2.0)) / 32.0
    ways = forward + slope * (x[..., None] * right - y[..., None] * up)
    ways /= np.linalg.norm(ways, axis=-1, keepdims=True)
    assert image.first_mm is not None
    reach = np.where(np.isfinite(image.first_mm), image.first_mm, 0.0)
    normals = camera.position_mm + reach[..., None] * ways - volume.corners_mm.mean(axis=0)
    length = np.linalg.norm(normals, axis=-1)
    normals /= np.maximum(length, 1e-9)[..., None]
    # Facing the camera, so that a pixel sees a single place.
    on = (np.abs(length - _RADIUS) < 1.0) & (np.einsum("yxc,yxc->yx", normals, -ways) > 0.4)
    chosen = np.random.default_rng(0).choice(np.flatnonzero(on), 60, replace=False)
    room = scene.room
    assert room is not None
    facing = normals.reshape(-1, 3)[chosen] @ room.placement.axes.T
    place = np.broadcast_to(room.placement.position_m, facing.shape)
    true = lux_from_irradiance(room.response.solved.irradiance_at(place, facing))
    return np.stack([Y.ravel()[chosen] / 100.0 * room.specimen.brightest_lux, true])


def brick_mesh(brick: Brick) -> RoomMesh:
    """Return a brick's patches as triangles, fronts inside, in the order of `PATCHES`."""
    w, d, h = brick.width_m, brick.depth_m, brick.height_m
    low = brick.furnished * h
    assert brick.window_m is not None
    parts = [
        rectangle((0, 0, 0), (w, 0, 0), (0, d, 0), "floor"),
        rectangle((0, 0, h), (0, d, 0), (w, 0, 0), "ceiling"),
        _flipped(
            panel((0, 0, 0), (w, 0, 0), (0, 0, h), "window wall", [("window", brick.window_m)])
        ),
    ]
    for part, z0, z1 in (("upper", low, h), ("lower", 0.0, low)):
        up = (0, 0, z1 - z0)
        parts += [
            rectangle((0, 0, z0), (0, d, 0), up, f"left {part}"),
            rectangle((w, 0, z0), up, (0, d, 0), f"right {part}"),
            rectangle((0, d, z0), (w, 0, 0), up, f"back {part}"),
        ]
    mesh = parts[0]
    for each in parts[1:]:
        mesh = mesh + each
    return mesh


def _flipped(mesh: RoomMesh) -> RoomMesh:
    return RoomMesh(mesh.corners_m[:, ::-1], mesh.surface, mesh.names)


def brick_against_triangles(brick: Brick) -> tuple[float, float]:
    """Return the largest relative difference of irradiances: of patches, and of their means.

    The first is between patches of the brick, with its own form factors and with those that rays
    find between triangles, summed; the second is against the solution with 4000 triangles, whose
    radiosity varies over a patch.
    """
    mesh = brick_mesh(brick)
    rho = np.repeat(np.array(GREYS)[:, None], DEFAULT_GRID.size, axis=1)
    emission = brick.window_emission(light("D65"), 1000.0)
    closed = brick.irradiance(brick.radiosity(rho, emission))
    by_name = {**dict(zip(PATCHES, rho, strict=False)), "window": 0.0 * rho[0]}
    order = [mesh.names.index(name) for name in PATCHES]
    room = Room(mesh, np.array([by_name[name] for name in mesh.names]), {"window": emission[-1]})
    fine = solve_room(room, 4000)
    means = np.array([fine.mean_irradiance(name) for name in PATCHES])
    # Sums of the triangles' exchange areas.
    flow = fine.factors.factors.multiply(fine.mesh.areas_m2[:, None]).tocoo()
    i, j = fine.mesh.surface[flow.coords[0]], fine.mesh.surface[flow.coords[1]]
    sums = np.zeros((len(order), len(order)))
    np.add.at(sums, (i, j), flow.data)
    sums = sums[np.ix_(order, order)] / brick.areas_m2[:, None]
    count = len(order) - 1
    system = np.eye(count) - np.array(GREYS)[:, None] * sums[:count, :count]
    reflected = np.linalg.solve(system, rho * np.outer(sums[:count, count], emission[-1]))
    coarse = sums[:, :count] @ reflected + np.outer(sums[:, count], emission[-1])
    band = DEFAULT_GRID.size // 2
    return (
        float(np.abs(coarse[:, band] / closed[:, band] - 1.0).max()),
        float(np.abs(means[:, band] / closed[:, band] - 1.0).max()),
    )


# Section 5.

PAINTS = {"salmon": "#f4b8a0", "beige": "#f0d9b5", "yellowish green": "#dfe3a8"}
# Lumens per m² of a lamp of 1 m².
LIGHTS = {"daylight": ("D65", 40000.0), "tungsten": ("lamp:tungsten-2850", 40000.0)}


def section_5() -> Iterator[str]:
    """Yield a row for each paint and light: xy and J C h as chosen, and in the room."""
    yield f"{'paint':16} {'light':9} {'x':>6} {'y':>6} {'J':>6} {'C':>6} {'h':>6} {'H':>6}"
    for paint, code in PAINTS.items():
        rho = reflectance_from_colour(code).values
        for number, (name, (spectrum, lux)) in enumerate(LIGHTS.items()):
            mesh = panel(
                (0, 0, 2.7), (0, 5, 0), (4, 0, 0), "ceiling", [("lamp", (2.0, 1.5, 1.0, 1.0))]
            )
            sides = ("wall", "wall", "wall", "wall", "floor", "-")
            rest = box((0, 0, 0), (4, 5, 2.7), sides, inside=True)
            mesh = mesh + rest.part(rest.surface != rest.names.index("-"))
            paints = {"floor": 0.4 * np.ones_like(rho), "lamp": 0.0 * rho, "-": 0.0 * rho}
            room = Room(
                mesh,
                np.array([paints.get(each, rho) for each in mesh.names]),
                {"lamp": irradiance_from_lux(light(spectrum), lux)},
            )
            seen = surface_appearance(solve_room(room, 1500), "wall")
            if not number:
                yield _row(paint, "chosen", seen.chosen_xy, seen.chosen)
            yield _row("", name, seen.seen_xy, seen.seen)


def _row(paint: str, name: str, xy: tuple[float, float], look: Any) -> str:
    J, C, h, H = (float(each) for each in (look.J, look.C, look.h, look.H))
    return f"{paint:16} {name:9} {xy[0]:6.4f} {xy[1]:6.4f} {J:6.1f} {C:6.1f} {h:6.1f} {H:6.1f}"


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(measured(int(sys.argv[1]))))
    else:
        for figure in figures():
            print(figure)
        print("\n".join(section_5()))
