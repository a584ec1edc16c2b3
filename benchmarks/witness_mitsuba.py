"""Mitsuba 3 as a witness: a scene of meshes that volspec writes for it, and a room.

    python -m benchmarks.witness_mitsuba       these figures alone; also writes them to the page

A textured sphere and a plane, lit by a directional and a point light, are cast by volspec, and
rendered by Mitsuba's variant ``scalar_spectral`` from the files of `save_mitsuba`: the same
linear XYZ is wanted, at the same scale. Without Mitsuba (``pip install mitsuba``) the rows say so.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

import volspec as vs
from benchmarks.measure import PAGE, Figure, replaced, report
from benchmarks.mitsuba_scene import save_mitsuba
from volspec.relight.illumination import Illumination
from volspec.room import Room, irradiance_from_lux, solve_room
from volspec.room.mesh import box, panel
from volspec.spectra import colour_matching_functions, light, reflectance

Array = NDArray[np.float64]
LIGHTS = ("D65", "A", "HP1")
SIZE = (128, 128)
SAMPLES = 256
# Mitsuba's XYZ are sums over nm, divided by this: the Y of a flat spectrum is 1 (its spectrum.h).
_Y_OF_FLAT = 106.7502593994140625
# Pixels of the margin around edges of meshes, shadows and texels.
_MARGIN = 2
_HIGHER_DEG = 2.0

MATERIALS = {
    "orange": vs.reflectance("ColorChecker/orange"),
    "blue": vs.reflectance("ColorChecker/blue sky"),
    "floor": vs.reflectance("ColorChecker/moderate red"),
}
CAMERA = vs.Camera((0.0, -150.0, 90.0), (0.0, 0.0, 8.0), fov_deg=32.0)


def figures() -> Iterator[Figure]:
    """Yield all figures of the witness."""
    try:
        import mitsuba as mi  # type: ignore[import-not-found]  # not installed by default
    except ImportError:
        note = "no mitsuba: pip install mitsuba"
        yield Figure("mitsuba/meshes", None, 1, at_most=True, note=note)
        yield Figure("mitsuba/room", None, 3, at_most=True, note=note)
        return
    for lamp in LIGHTS:
        peer = rendered(mi, vs.light(lamp), lit())
        for basis in (vs.MaterialBasis(MATERIALS), vs.SpectralBasis.load("general-7")):
            off = 100.0 * differences(peer, lamp, basis)
            print(f"{lamp}, {basis.name}: {len(off)} pixels, {describe(off)}", flush=True)
            exact = isinstance(basis, vs.MaterialBasis)
            name = f"mitsuba/{lamp}, {'exact' if exact else basis.name}, mean XYZ"
            yield Figure(name, float(off.mean()), 1 if exact else None, at_most=True, unit="%")
    higher = rendered(mi, vs.light("D65"), lit(_HIGHER_DEG))
    off = 100.0 * differences(higher, "D65", vs.MaterialBasis(MATERIALS))
    # If this one did not differ, the others would prove nothing.
    yield Figure(f"mitsuba/D65, sun {_HIGHER_DEG:g}° off", float(off.mean()), 1, unit="%")
    off = 100.0 * room_compared(mi)
    print(f"room: {describe(off)}", flush=True)
    yield Figure("mitsuba/room, worst irradiance", float(off.max()), 3, at_most=True, unit="%")


def describe(off: Array) -> str:
    """Return mean and worst of percentages."""
    return f"mean {off.mean():.2g} %, worst {off.max():.2g} %"


# Meshes.


def meshes() -> list[vs.Mesh]:
    """Return a sphere of two materials in squares, above a plane."""
    squares = np.indices((4, 8)).sum(axis=0) % 2
    texture = vs.Texture(np.kron(squares, np.ones((16, 16), int)), ("orange", "blue"))
    ball = vs.shape_mesh("sphere", 50.0, texture).placed((0.0, 0.0, 30.0))
    return [ball, vs.shape_mesh("plane", 200.0, "floor")]


def lit(higher_deg: float = 0.0) -> vs.RaycastSpec:
    """Return a sun and a lamp near the sphere, each in a group of its own."""
    up = np.radians(42.0 + higher_deg)
    towards = (0.57 * float(np.cos(up)), -0.82 * float(np.cos(up)), float(np.sin(up)))
    lamp = vs.Point((-60.0, -50.0, 60.0), intensity=0.6, falloff_mm=70.0, shadows=True)
    groups = (
        vs.LightGroup("sun", (vs.Directional(towards, shadows=True),)),
        vs.LightGroup("lamp", (lamp,)),
    )
    return vs.RaycastSpec(groups=groups)


def differences(peer: Array, lamp: str, basis: vs.SpectralBasis | vs.MaterialBasis) -> Array:
    """Return relative differences of XYZ (K,) in K pixels that are not near an edge."""
    spectrum = vs.light(lamp)
    image = vs.cast_meshes(meshes(), MATERIALS, basis, CAMERA, SIZE, lit())
    rig = vs.LightRig.of(spectrum)
    illumination = Illumination.of(basis, rig, vs.RelightSpec(), image.groups)
    # From Y = 100 of a white that faces the light to Mitsuba's scale.
    step = spectrum.grid.step_nm
    white = colour_matching_functions(spectrum.grid)[1] @ spectrum.values * step / _Y_OF_FLAT
    ours = illumination.scene_XYZ(image.coefficients, image.alpha) * (white / 100.0)
    inside = interior()
    away = np.linalg.norm(ours[inside] - peer[inside], axis=1)
    return np.asarray(away / np.linalg.norm(ours[inside], axis=1))


def rendered(mi: Any, spectrum: vs.Spectrum, spec: vs.RaycastSpec) -> Array:
    """Return Mitsuba's XYZ (H, W, 3) of the exported scene.

    Each group has a scene: of several lights Mitsuba takes one at random for each sample, and that
    noise would be most of the difference.
    """
    mi.set_variant("scalar_spectral")
    found = np.zeros((*SIZE[::-1], 3))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.xml"
        for group in spec.groups:
            rig = vs.LightRig((spectrum,), groups=(group.name,))
            save_mitsuba(path, meshes(), MATERIALS, CAMERA, rig, SIZE, spec)
            scene = mi.load_file(str(path), samples=str(SAMPLES), pixel_format="xyz")
            found += np.array(mi.render(scene, seed=1))
    return found


def interior() -> NDArray[np.bool_]:
    """Return where pixels (H, W) and their neighbours see one material, lit by the same lights."""
    basis = vs.MaterialBasis(MATERIALS)
    image = vs.cast_meshes(meshes(), MATERIALS, basis, CAMERA, SIZE, lit())
    layers = np.stack([np.asarray(image.layer(group), np.float64) for group in image.groups])
    shares = layers.sum(axis=0)
    total, kind = shares.sum(axis=2), shares.argmax(axis=2)
    pure = (shares.max(axis=2) > 0.999 * total) & (total > 0.0) & (image.alpha == 1.0)
    for layer in layers:
        kind = 2 * kind + (layer.sum(axis=2) > 0.0)
    side = 2 * _MARGIN + 1
    same = maximum_filter(kind, side) == minimum_filter(kind, side)
    return np.asarray(same & minimum_filter(pure, side))


# A room.

_NM = (450.0, 500.0, 550.0, 600.0, 650.0)
_ROOM_SAMPLES = 1 << 16


def cornell() -> Room:
    """Return a room like Cornell's: a lamp in the ceiling, a red and a green wall, a box."""
    size = 2.0
    mesh = panel(
        (0, 0, size), (0, size, 0), (size, 0, 0), "ceiling", [("lamp", (0.7, 0.7, 0.6, 0.6))]
    )
    walls = box(
        (0, 0, 0), (size,) * 3, ("red", "green", "front", "back", "floor", "-"), inside=True
    )
    mesh = mesh + walls.part(walls.surface != walls.names.index("-"))
    mesh = mesh + box((0.5, 0.6, 0.01), (1.1, 1.2, 0.9), "block")
    paints = {
        "red": "ColorChecker/red",
        "green": "ColorChecker/green",
        "lamp": "black",
        "-": "black",
    }
    rho = [reflectance(paints.get(name, "grey:0.7")).values for name in mesh.names]
    return Room(mesh, np.array(rho), {"lamp": irradiance_from_lux(light("A"), 5000.0)})


def places() -> tuple[Array, Array]:
    """Return 20 points of the room's surfaces, slightly in front, and their normals."""
    rng = np.random.default_rng(7)
    points, normals = [], []
    for axis, end in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0)):
        for _ in range(4):
            point = rng.uniform(0.2, 1.8, 3)
            point[axis] = 2.0 * end + (1 - 2 * end) * 1e-3
            if axis == 2 and 0.45 < point[0] < 1.15 and 0.55 < point[1] < 1.25:
                point[0] += 0.75  # not below the block
            points.append(point)
            normals.append(np.eye(3)[axis] * (1 - 2 * end))
    return np.array(points), np.array(normals)


def room_compared(mi: Any) -> Array:
    """Return relative differences of irradiances at 20 points and 5 wavelengths."""
    room = cornell()
    solved = solve_room(room, 5000)
    points, normals = places()
    ours = solved.irradiance_at(points, normals)
    # Three bands at a time: a picture's channels do not mix.
    mi.set_variant("scalar_rgb")
    bands = [int(np.flatnonzero(room.grid.wavelengths_nm == nm)[0]) for nm in _NM]
    parts = [
        _irradiance(mi, room, chosen, points, normals)
        for chosen in (bands[:3], [*bands[3:], bands[-1]])
    ]
    peer = np.concatenate(parts, axis=1)[:, : len(bands)]
    return np.abs(ours[:, bands] / peer - 1.0)


def _irradiance(
    mi: Any,
    room: Room,
    bands: Sequence[int],
    points: Array,
    normals: Array,
) -> Array:
    """Return the irradiance (P, 3) in three bands, as the channels of one picture."""
    with tempfile.TemporaryDirectory() as folder:
        scene = _room_scene(room, bands, Path(folder))
        film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}}
        film |= {"pixel_format": "rgb", "component_format": "float32"}
        integrator = mi.load_dict({"type": "path", "max_depth": 200, "rr_depth": 50})
        found = []
        for number, (point, normal) in enumerate(zip(points, normals, strict=True)):
            place = mi.ScalarTransform4f().look_at(
                list(point), list(point + normal), [0.3, 0.5, 0.8]
            ) @ mi.ScalarTransform4f().scale(1e-3)
            meter = {
                "type": "rectangle",
                "to_world": place,
                "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}},
                "sensor": {
                    "type": "irradiancemeter",
                    "film": film,
                    "sampler": {"type": "multijitter", "sample_count": _ROOM_SAMPLES},
                },
            }
            loaded = mi.load_dict({**scene, "meter": meter})
            picture = mi.render(loaded, integrator=integrator, seed=number)
            found.append(np.asarray(picture).ravel()[:3])
    return np.array(found)


def _room_scene(room: Room, bands: Sequence[int], folder: Path) -> dict[str, Any]:
    """Return a room as Mitsuba's shapes."""
    scene: dict[str, Any] = {"type": "scene"}
    for number, name in enumerate(room.mesh.names):
        corners = room.mesh.corners_m[room.mesh.surface == number]
        if not len(corners):
            continue
        path = folder / f"{number}.obj"
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in corners.reshape(-1, 3).tolist()]
        lines += [f"f {n + 1} {n + 2} {n + 3}" for n in range(0, 3 * len(corners), 3)]
        path.write_text("\n".join(lines), encoding="utf-8")
        shade = {"type": "rgb", "value": room.reflectances[number, bands].tolist()}
        shape: dict[str, Any] = {
            "type": "obj",
            "filename": str(path),
            "face_normals": True,
            "bsdf": {"type": "diffuse", "reflectance": shade},
        }
        if name in room.exitances:
            radiance = (room.exitances[name][bands] / np.pi).tolist()
            shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": radiance}}
        scene[f"shape{number}"] = shape
    return scene


if __name__ == "__main__":
    found = list(figures())
    print(report(found))
    if all(figure.reached is not None for figure in found):
        content = f"\n```text\n{report(found)}\n```\n"
        page = replaced(PAGE.read_text(encoding="utf-8"), "mitsuba", content)
        PAGE.write_text(page, encoding="utf-8")
