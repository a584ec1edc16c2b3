"""Errors of nearby views of layers against casts of them: ``python -m benchmarks.views``.

The volumes and materials of `benchmarks.layer_cases`, 512², an ambient light and one from the
camera's place at the cast that is fixed in the world. Cameras are turned by 2, 5 and 10° to either
side, upwards and downwards; errors are means over the four, of pixels that the turned cast covers:
CIEDE2000 of the frames under D65 in front of black, its mean and 99 %, and the part of the pixels
that lack a quarter of opacity, the holes. Times are of all cores.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray

from benchmarks.layer_cases import CASES, LAYERS_PAGE, SPEC, Errors, display, transfer_of
from benchmarks.layers import LAYERS, TIMED
from benchmarks.measure import Figure, in_turn, replaced
from benchmarks.scenes import Points
from volspec._gpu.sources import asset
from volspec.basis import MaterialBasis
from volspec.camera import Camera
from volspec.image import CoefficientImage
from volspec.image.reproject import PARTS, Reprojector, Warp, reproject_reference
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import RaycastSpec
from volspec.raycast.lights import Ambient, Directional, LightGroup
from volspec.relight import relight
from volspec.relight.look import Look
from volspec.relight.stereo import Stereo
from volspec.scene import Scene
from volspec.spectra import light
from volspec.transfer import TransferFunction
from volspec.volume import Volume

Array = NDArray[np.float64]
TURNS = (2, 5, 10)
ASKED_DEG, ASKED = 5, 1.7
# Errors of a turn: CIEDE2000 mean and 99 %, and pixels that lack a quarter of opacity, per cent.
Turned = tuple[float, float, float]


# Reprojectors by their column: layers, points a layer, and whether the light turns with the camera.
COLUMNS = {
    "parts=1": (LAYERS, 1, False),
    "8 layers": (LAYERS, PARTS, False),
    "parts=6": (LAYERS, 6, False),
    "16 layers": (16, PARTS, False),
    "headlight": (LAYERS, PARTS, True),
}
OURS = "8 layers"


@dataclass(frozen=True, slots=True)
class Views:
    """Figures of a volume: errors by column and turn, points and ms by column.

    ``moved`` are mean and 99 % of the cast's picture, moved by half a pixel, against a cast there.
    """

    name: str
    errors: dict[str, dict[int, Turned]]
    points: dict[str, int]
    ms: dict[str, float]
    quicker: float
    apart: float
    moved: tuple[float, float]


def turned_views(name: str, volume: Volume, points: Points, orbit: dict[str, Any]) -> Views:
    """Compare reprojected views, turned to either side and up and down, with casts of them."""
    transfer, caster = transfer_of(points), Raycaster(volume)
    assert isinstance(transfer.basis, MaterialBasis)
    around = {"azimuth_deg": 30, "elevation_deg": 20, **orbit}
    camera = Camera.orbit(volume, **around)
    towards = np.subtract(camera.position_mm, camera.target_mm)
    fixed = replace(SPEC, groups=(LightGroup("light", (Ambient(), Directional(tuple(towards)))),))
    codes_of = display(transfer.basis)

    def cast(
        seen_by: Camera, spec: RaycastSpec, layers: int = 0, size: tuple[int, int] = TIMED
    ) -> CoefficientImage:
        spec = replace(spec, layers=layers)
        return raycast(volume, transfer, seen_by, size, spec, caster=caster)

    def shown(image: CoefficientImage) -> Array:
        flat = image.coefficients.reshape(-1, image.coefficients.shape[2])
        return codes_of(flat.astype(np.float64), 1.0 - image.alpha.ravel().astype(np.float64))

    images = {
        key: cast(camera, SPEC if key[1] else fixed, key[0])
        for key in {(layers, turns) for layers, _, turns in COLUMNS.values()}
    }
    views = {
        column: Reprojector(images[layers, turns], parts=parts)
        for column, (layers, parts, turns) in COLUMNS.items()
    }
    rows: dict[str, dict[int, list[Turned]]] = {each: {} for each in ("left", *COLUMNS)}
    for turn in TURNS:
        for key, by in itertools.product(("azimuth_deg", "elevation_deg"), (-turn, turn)):
            other = Camera.orbit(volume, **{**around, key: around[key] + by})
            true = {turns: cast(other, SPEC if turns else fixed) for turns in (False, True)}
            for column, into in rows.items():
                wanted = true[column in COLUMNS and COLUMNS[column][2]]
                made = images[LAYERS, False] if column == "left" else views[column].view(other)
                seen = wanted.alpha.ravel() > 0.01
                errors = Errors.of(shown(made)[seen][None], shown(wanted)[seen][None])
                holes = ((wanted.alpha - made.alpha) > 0.25).sum() / seen.sum()
                into.setdefault(turn, []).append((errors.mean, errors.most_of, 100 * holes))
    layers = images[LAYERS, False].opacity_layers
    assert layers is not None
    made, warp = views[OURS].view(other), Warp.of(camera, TIMED, other, TIMED)
    twin = reproject_reference(layers, [1.0] * 3, warp)
    apart = float(np.percentile(np.abs(made.coefficients - twin.coefficients).max(axis=2), 99))
    times = {
        column: in_turn(
            partial(views[column].view, other),
            lambda: cast(other, fixed, LAYERS),
            our_calls=5,
            runs=5,
        ).cpu
        for column in list(COLUMNS)[:3]
    }
    pixels = half_a_pixel_apart(cast(camera, fixed, size=(2 * TIMED[0], 2 * TIMED[1])))
    covered = pixels[1].alpha.ravel() > 0.01
    moved = Errors.of(*(shown(each)[covered][None] for each in pixels))
    return Views(
        name,
        {c: {turn: _mean(each) for turn, each in by.items()} for c, by in rows.items()},
        {column: view.points for column, view in views.items()},
        {column: float(each[:, 0].min()) for column, each in times.items()},
        float(np.median(times[OURS][:, 1] / times[OURS][:, 0])),
        apart,
        (moved.mean, moved.most_of),
    )


def half_a_pixel_apart(doubled: CoefficientImage) -> tuple[CoefficientImage, CoefficientImage]:
    """Return every second pixel, moved by half a pixel down and to the right, and cast there."""

    def between(plane: NDArray[Any]) -> NDArray[Any]:
        edge = np.pad(plane[::2, ::2], ((0, 1), (0, 1), *[(0, 0)] * (plane.ndim - 2)), mode="edge")
        return (edge[:-1, :-1] + edge[1:, :-1] + edge[:-1, 1:] + edge[1:, 1:]) / 4

    def picture(change: Callable[[NDArray[Any]], NDArray[Any]]) -> CoefficientImage:
        planes = doubled.coefficients, doubled.alpha, doubled.depth_mm
        return CoefficientImage(*map(change, planes), doubled.basis, groups=doubled.groups)

    return picture(between), picture(lambda plane: plane[1::2, 1::2])


def table(found: list[Views | tuple[str, str]]) -> str:
    """Return mean / 99 % of CIEDE2000 / holes in per cent, turn by turn.

    ``left`` is the picture that is not turned; ``parts`` are points a deep layer; ``headlight`` has
    a light that turns with the camera. Then thousands of points and milliseconds of all cores; a
    view's time by that of a cast with layers; and the kernel against its twin.
    """
    head = "".join(f"{each:>17s}" for each in ("left", *COLUMNS))
    lines = ["turned by".ljust(14) + head]
    for row in found:
        if not isinstance(row, Views):
            lines.append(f"{row[0]:12s}left out: {row[1]}")
            continue
        for turn in TURNS:
            each = (by[turn] for by in row.errors.values())
            cells = "".join(f"{f'{m:.2f} {p:.1f} {h:.2f}':>17s}" for m, p, h in each)
            lines.append(f"{row.name:9s}{turn:>3d}° {cells}")
        sizes = (
            f"{row.points[c] / 1000:.0f} k" + (f", {row.ms[c]:.0f} ms" if c in row.ms else "")
            for c in COLUMNS
        )
        about = f"1/{row.quicker:.0f} of a cast"
        cells = "".join(f"{each:>17s}" for each in (about, *sizes))
        half = "½ px {:.2f} {:.1f}".format(*row.moved)
        lines.append(f"{row.name:14s}{cells}; kernel {row.apart:.0e}; {half}")
    return "\n".join(lines)


def _mean(rows: list[Turned]) -> Turned:
    mean, most_of, holes = np.mean(rows, axis=0).tolist()
    return mean, most_of, holes


def rows() -> Iterator[Views | tuple[str, str]]:
    """Yield the figures of each volume, or its name and the reason if it is missing."""
    for name, (read, points, orbit) in CASES.items():
        try:
            yield turned_views(name, read(), points, orbit)
        except FileNotFoundError as error:
            yield name, str(error)


def figures() -> Iterator[Figure]:
    """Yield the figures that have a target, for `benchmarks.__main__`."""
    for row in rows():
        if isinstance(row, Views):
            mean = row.errors[OURS][ASKED_DEG][0]
            yield Figure(f"{row.name}: view turned by {ASKED_DEG}°", mean, ASKED, True, "ΔE")
        else:
            yield Figure(f"{row[0]}: nearby views", None, note=row[1])


def pictures() -> NDArray[np.uint8]:
    """Return the shipped engine: cast, turned by 10° and cast there, and an anaglyph."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume, transfer = scene.volume(), scene.transfer
    assert isinstance(transfer, TransferFunction)
    materials = replace(transfer, basis=MaterialBasis(transfer.materials))
    camera, size = scene.camera(volume), (360, 360)
    spec = replace(scene.raycast, layers=LAYERS)
    image = raycast(volume, materials, camera, size, spec)
    place, target = np.array(camera.position_mm), np.array(camera.target_mm)
    right, _, _ = camera.frame()
    away = place - target
    angle = np.radians(10.0)
    there = target + np.cos(angle) * away + np.sin(angle) * np.linalg.norm(away) * right
    other = replace(camera, position_mm=tuple(there.tolist()))
    stereo = Stereo("anaglyph")
    each = [
        relight(image, light("A"), scene.relight),
        relight(Reprojector(image).view(other), light("A"), scene.relight),
        relight(raycast(volume, materials, other, size, spec), light("A"), scene.relight),
        relight(image, light("A"), Look(scene.relight, stereo=stereo)),
    ]
    return np.hstack(each).astype(np.uint8)


def main() -> None:
    """Print the table; with ``--keep``, write it to docs/layers.md, and its picture."""
    found = []
    for row in rows():
        found.append(row)
        print(row.name if isinstance(row, Views) else row, flush=True)
    text = table(found)
    print(text)
    if "--keep" in sys.argv[1:]:
        page = Path(LAYERS_PAGE)
        iio.imwrite(page.parent / "images" / "views.jpg", pictures(), quality=92)
        content = f"\n```text\n{text}\n```\n"
        page.write_text(
            replaced(page.read_text(encoding="utf-8"), "views", content), encoding="utf-8"
        )


if __name__ == "__main__":
    main()
