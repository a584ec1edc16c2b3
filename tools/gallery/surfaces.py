"""Make docs/gallery/surfaces.md and its pictures: ``python -m tools.gallery.surfaces``.

Figure 5 of reference [1], flames that appear under sodium light, and figure 4 of reference [2], an
RGB texture, a compact disc and its mirror image, and a ball with them; and an implant in a CT.

    python -m tools.gallery.surfaces implant       one row alone

References
----------
[1] Bergner, Drew & Möller (2009), ACM Transactions on Graphics 28(1), article 5.
[2] Wang, Xu & Sun (2004), "Practical Construction of Reflectances for Spectral Rendering".
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pyvista
from numpy.typing import NDArray
from PIL import Image

import volspec as vs
from benchmarks.scenes import chest
from benchmarks.surfaces import flame_paints, paint_difference
from tools.gallery.studio import ROOT, Picture

FOLDER = ROOT / "docs" / "gallery"
SIZE = (1280, 800)
LAMPS = {"daylight": "D65", "tungsten": "A", "sodium street lamp": "HP1"}
TWO_LAMPS = ("daylight", "sodium street lamp")
KEY = vs.LightGroup("key", (vs.Directional((0.5, -0.7, 0.9), shadows=True),))
SKY = vs.LightGroup("sky", (vs.Ambient(occlusion=True),))
STUDIO = vs.RaycastSpec(
    groups=(KEY, SKY), ambient=0.45, diffuse=0.75, specular=0.25, shininess=80, half=True
)


def main(*only: str) -> None:
    """Write the pictures, or those of the rows that are named, and with all of them the page."""
    for name, make in ROWS.items():
        if only and name not in only:
            continue
        for lamp, codes in make().items():
            file = FOLDER / f"{name}-{lamp.split()[0]}.jpg"
            half = (codes.shape[1] // 2, codes.shape[0] // 2)
            Image.fromarray(codes).resize(half, Image.Resampling.LANCZOS).save(file, quality=90)
            print(file)
    (FOLDER / "surfaces.md").write_text(PAGE.format(table=flame_table(), **CELLS), encoding="utf-8")


def relit(image: vs.CoefficientImage, lamps: dict[str, str]) -> dict[str, Picture]:
    """Return the picture under each lamp, for an eye that has adapted to it."""
    adapted = vs.RelightSpec(viewing=vs.Viewing("CIECAM02"))
    lights = {label: vs.light(lamp) for label, lamp in lamps.items()}
    return {label: np.asarray(vs.relight(image, light, adapted)) for label, light in lights.items()}


def flame_table() -> str:
    """Return a table of the difference between figure 5's two paints [1]."""
    paints = flame_paints()
    rows = (f"| {label} | {paint_difference(paints, LAMPS[label]):.2f} |" for label in TWO_LAMPS)
    return "\n".join(["| | CIEDE2000 between flame and body |", "|---|---|", *rows])


def flames_on_a_car() -> dict[str, Picture]:
    """Return figure 5 of [1]."""
    paints = flame_paints()
    materials = {
        **paints,
        "tyre": vs.reflectance("grey:0.03"),
        "floor": vs.reflectance("grey:0.35"),
    }
    rows = np.linspace(0.0, 1.0, 1024)[:, None]
    columns = np.linspace(0.0, 1.0, 2048)[None, :]
    # Tongues from the nose, which bend as they get thin.
    bent = rows + 0.02 * np.sin(14.0 * columns)
    thin = np.abs(np.cos(8.0 * np.pi * bent)) ** 1.4 * (0.6 + 0.4 * np.cos(31.0 * bent))
    reach = 0.10 + 0.55 * thin
    numbers = np.where(columns < reach, 0, 1)
    body = car_body(vs.Texture(numbers, ("flame", "paint"), "flames"))
    wheels = [
        vs.Mesh.of(wheel(x, y), "tyre", "wheel") for x in (-1.35, 1.25) for y in (-0.72, 0.72)
    ]
    floor = vs.shape_mesh("plane", 40.0, "floor")
    bands = vs.SpectralBasis.bands()
    camera = vs.Camera((-5.2, -7.4, 2.9), (-0.1, 0.0, 0.55), fov_deg=19)
    bright = replace(STUDIO, ambient=0.9, diffuse=1.6)
    image = vs.cast_meshes([body, *wheels, floor], materials, bands, camera, SIZE, bright)
    return relit(image, {key: LAMPS[key] for key in TWO_LAMPS})


def car_body(texture: vs.Texture) -> vs.Mesh:
    """Return a streamlined body, 4.4 m long, with texture coordinates along and around it."""
    along, around = np.linspace(0.0, 1.0, 200), np.linspace(0.0, 2.0 * np.pi, 161)
    u, turn = np.meshgrid(along, around, indexing="ij")
    taper = np.clip(np.sin(np.pi * u**0.75), 0.0, None) ** 0.42
    cabin = 0.42 * np.exp(-(((u - 0.56) / 0.17) ** 2))
    cosine, sine = np.cos(turn), np.sin(turn)
    # Superellipses; the upper half rises to the cabin.
    y = 0.82 * taper * np.sign(cosine) * np.abs(cosine) ** 0.7
    z = 0.36 * taper * np.sign(sine) * np.abs(sine) ** 0.7
    z = 0.55 + np.where(sine > 0.0, z + cabin * np.abs(sine) ** 2.2, z)
    x = 4.4 * (u - 0.5)
    # Alike on both sides: from the sill to the roof.
    v = 0.5 + sine / 2.0
    points = np.stack([x, y, z], axis=2).reshape(-1, 3)
    first = (np.arange(199)[:, None] * 161 + np.arange(160)).reshape(-1, 1)
    triangles = np.concatenate([first + [0, 161, 1], first + [1, 161, 162]])
    du, dv = np.gradient(np.stack([x, y, z], axis=2), axis=(0, 1))
    normals = np.cross(dv, du).reshape(-1, 3)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    a, b, c = points[triangles].transpose(1, 0, 2)
    whole = np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-6
    uv = np.stack([u, v], axis=2).reshape(-1, 2)
    return vs.Mesh(points, triangles[whole], texture, normals, "body", uv, mirror=0.04)


def wheel(x: float, y: float) -> object:
    """Return a wheel as pyvista data."""
    import pyvista

    tyre = pyvista.ParametricTorus(ringradius=0.24, crosssectionradius=0.11)
    tyre = tyre.rotate_x(90).translate((x, y, 0.35))
    return tyre.compute_normals(split_vertices=True, feature_angle=40)


def painted_globe() -> dict[str, Picture]:
    """Return figure 4a of [2]: RGB textures made spectral, under three lamps."""
    photo = vs.Texture.load(ROOT / "docs" / "images" / "rooms.jpg")
    rows, columns = np.mgrid[0:512, 0:1024]
    hue = columns / 1024.0
    ramp = np.stack([0.5 + 0.45 * np.cos(2.0 * np.pi * (hue - k / 3.0)) for k in range(3)], axis=2)
    board = (rows // 64 + columns // 64) % 2
    globe = np.where(board[..., None] == 0, ramp, 0.85)
    height, width = photo.texels.shape[:2]
    ball = vs.shape_mesh("sphere", 2.0, vs.Texture(globe)).placed((1.3, 0.2, 1.0), (0.0, 0.0, 30.0))
    wall = vs.shape_mesh("plane", 3.2, photo)
    stretched = wall.points_mm * (width / height / 1.25, 1.0, 1.0)
    wall = replace(wall, points_mm=stretched).placed((-1.0, 1.6, 1.62), (90.0, 0.0, 0.0))
    floor = vs.shape_mesh("plane", 30.0, "floor")
    materials = {"floor": vs.reflectance("grey:0.4")}
    basis = vs.SpectralBasis.load("general-7")
    camera = vs.Camera((0.6, -9.0, 2.6), (0.0, 0.0, 1.1), fov_deg=28)
    return relit(vs.cast_meshes([ball, wall, floor], materials, basis, camera, SIZE, STUDIO), LAMPS)


def disc() -> dict[str, Picture]:
    """Return figure 4b of [2]: a compact disc and its mirror image."""
    return relit(_disc_image(()), LAMPS)


def disc_with_ball() -> dict[str, Picture]:
    """Return figure 4c of [2]: the disc, a ball, and their mirror images."""
    ball = replace(vs.shape_mesh("sphere", 46.0, "orange"), mirror=0.12)
    return relit(_disc_image((ball.placed((64.0, -46.0, 23.0)),)), LAMPS)


def _disc_image(more: tuple[vs.Mesh, ...]) -> vs.CoefficientImage:
    materials = {
        "aluminium": vs.reflectance("grey:0.35"),
        "table": vs.reflectance("grey:0.04"),
        "orange": vs.reflectance_from_colour("#d9641e"),
    }
    lines = vs.Grating(spacing_um=1.6, spread_deg=2.2, part=0.35, orders=3)
    plate = replace(vs.shape_mesh("disc", 120.0, "aluminium"), grating=lines, mirror=0.12)
    plate = plate.placed((0.0, 0.0, 57.0), (68.0, 0.0, 0.0))
    table = replace(vs.shape_mesh("plane", 900.0, "table"), mirror=0.45)
    spec = replace(
        STUDIO,
        groups=(
            vs.LightGroup("key", (vs.Directional((0.25, -0.75, 0.85), shadows=True),)),
            vs.LightGroup("side", (vs.Point((-260.0, -240.0, 160.0), intensity=0.8),)),
            vs.LightGroup("sky", (vs.Ambient(occlusion=True, intensity=0.8),)),
        ),
        diffuse=0.5,
    )
    basis = vs.SpectralBasis.bands()
    camera = vs.Camera((30.0, -400.0, 150.0), (14.0, 0.0, 42.0), fov_deg=28)
    return vs.cast_meshes([plate, table, *more], materials, basis, camera, SIZE, spec)


def implant() -> dict[str, Picture]:
    """Return pedicle screws and rods of titanium in the spine of a chest CT."""
    ct = chest()
    # Where the spinal canal is in slices 21, 31, 41 and 51, in voxels.
    levels = np.array([(266, 325, 21), (259, 341, 31), (255, 356, 41), (248, 366, 51)])
    canal = levels * np.array(ct.spacing_mm)
    parts: list[Any] = []
    for side in (-1.0, 1.0):
        heads, tips = canal + (side * 18.0, 21.0, 0.0), canal + (side * 7.0, -27.0, 2.0)
        for head, tip in zip(heads, tips, strict=True):
            parts.extend(screw(head, tip))
        axes = tips - heads
        held = heads - 9.0 * axes / np.linalg.norm(axes, axis=1, keepdims=True)
        ends = 1.5 * held[[0, -1]] - 0.5 * held[[1, -2]]
        rod = pyvista.Spline(np.vstack([ends[0], held, ends[1]]), 200)
        parts.append(rod.tube(radius=2.75, n_sides=48, capping=True))
    metal = pyvista.merge([part.triangulate().compute_normals(feature_angle=40) for part in parts])
    metal = metal.extract_surface(algorithm=None)
    metal.cell_data.clear()
    looks = {
        "titanium": vs.reflectance("titanium"),
        "bone": vs.reflectance("Vrhel/158 fabric white"),
    }
    basis = vs.SpectralBasis.load("general-7")
    mesh = vs.MeshCaster([vs.Mesh.of(metal, "titanium", "implant")], looks, basis)
    bone = vs.Isosurfaces([(290, 0.95, {"bone": 0.8})], looks, basis)
    pose = {"azimuth_deg": 206, "elevation_deg": 24}
    camera = vs.Camera.orbit(
        ct, **pose, zoom=3.7, target_mm=tuple(canal.mean(axis=0) + (0.0, 0.0, 6.0))
    )
    lamp = vs.LightGroup("key", (vs.Directional((-0.9, 0.8, 0.7), shadows=True),))
    spine = ((170, 350), (318, 425), (12, 71))
    spec = replace(STUDIO, groups=(lamp, SKY), crop_voxels=spine)
    return relit(vs.raycast(ct, bone, camera, SIZE, spec, behind=(mesh,)), LAMPS)


def screw(head_mm: NDArray[Any], tip_mm: NDArray[Any]) -> Iterator[Any]:
    """Yield the thread and the slotted head of a screw, as pyvista data."""
    length = np.linalg.norm(tip_mm - head_mm)
    axis = (tip_mm - head_mm) / length
    across = np.cross(axis, (0.0, 0.0, 1.0))
    across /= np.linalg.norm(across)
    s, turn = np.meshgrid(
        np.linspace(0.0, length, 500), np.linspace(0.0, 2.0 * np.pi, 49), indexing="ij"
    )
    ridge = np.abs((s / 2.6 - turn / (2.0 * np.pi)) % 1.0 * 2.0 - 1.0)
    radius = (2.1 + 0.9 * ridge) * np.clip((length - s) / 5.0, 0.0, 1.0) ** 0.6
    around = np.stack([np.cos(turn), np.sin(turn)], axis=2) @ (across, np.cross(axis, across))
    points = head_mm + s[..., None] * axis + radius[..., None] * around
    grid = pyvista.StructuredGrid(*np.moveaxis(points, 2, 0)[..., None])
    yield grid.extract_surface(algorithm=None)
    # Two cheeks, between which the rod lies.
    for side in (-1.0, 1.0):
        cheek = pyvista.Cylinder(
            center=head_mm - 6.0 * axis, direction=axis, radius=6.4, height=15.0, resolution=96
        )
        cut = head_mm + side * 2.9 * across
        yield cheek.triangulate().clean().clip_closed_surface(side * across, origin=cut)


ROWS = {
    "flames": flames_on_a_car,
    "globe": painted_globe,
    "disc": disc,
    "ball": disc_with_ball,
    "implant": implant,
}
NAMES = {
    "globe": "A photograph and a chequered globe",
    "disc": "A compact disc and its mirror image",
    "ball": "The disc with a ball",
    "implant": "Screws and rods of titanium in a spine",
}
CELLS = {
    name: f"| {' | '.join(f'![{alt}]({name}-{lamp.split()[0]}.jpg)' for lamp in LAMPS)} |"
    for name, alt in NAMES.items()
}
PAGE = """# Surfaces

Meshes and volumes share the light: each lamp's part of the picture is stored in coefficients, and
every picture of a row below is the same cast under another lamp, as an eye sees it that has adapted
to the lamp. All of it is made by one command, `python -m tools.gallery.surfaces`.
Mitsuba 3 sees the same colours in a scene of meshes: [figures](../benchmarks.md#mitsuba).

## Flames that appear under a street lamp

| daylight | sodium street lamp |
| --- | --- |
| ![One blue](flames-daylight.jpg) | ![Flames](flames-sodium.jpg) |

The two paints of `data/palettes/figure-1.toml`, designed to be one colour in daylight and two under
a high-pressure sodium lamp; a texture of their numbers is on the body (figure 5 of Bergner, Drew &
Möller 2009).

{table}

## Pictures made spectral

| daylight | tungsten | sodium street lamp |
| --- | --- | --- |
{globe}

Each sRGB colour of the photograph and of the ball became a plausible reflectance that has that
colour under D65 (figure 4a of Wang, Xu & Sun 2004).

## A compact disc

| daylight | tungsten | sodium street lamp |
| --- | --- | --- |
{disc}
{ball}

Tracks 1.6 µm apart send each wavelength in directions of its own. The stripes of the disc and of
its mirror image differ, as they depend on the direction of view; each lamp's spectrum recolours
them without a new cast (figures 4b and 4c of Wang, Xu & Sun 2004).

## An implant in a CT

| daylight | tungsten | sodium street lamp |
| --- | --- | --- |
{implant}

Pedicle screws and rods with the measured reflectance of titanium, in the spine of a chest CT whose
bone is an isosurface of 290 HU: volume and mesh hide and shade each other.
"""

if __name__ == "__main__":
    main(*sys.argv[1:])
