"""Pairs of random scenes that must give one picture: a twin shares faults, relations do not.

``RELATIONS=0:90 pytest -m slow tests/raycast/test_relations.py`` tries these seeds.
"""

import os
from collections.abc import Callable
from dataclasses import astuple, dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import pyvista
import tomlkit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from tests.support.pyramids import in_parts_of, pyramid_of
from tests.support.raycasts import METAL_BASIS, METALS
from tools.phantom_sheet import WRITERS
from volspec.basis import SpectralBasis
from volspec.camera import Camera
from volspec.export.tiles import WindowCamera
from volspec.mesh.caster import MeshCaster
from volspec.mesh.model import Mesh
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Ambient, ClipPlane, Directional, Headlight, LightGroup, Point
from volspec.raycast import RaycastSpec as Spec
from volspec.raycast.lights import HEADLIT
from volspec.relight import LightRig, RelightSpec
from volspec.relight.illumination import Illumination
from volspec.room.mesh import SIDES
from volspec.scene import Scene as Stored
from volspec.scene.file import scene_file
from volspec.scene.room import SceneRoom
from volspec.scene.tables.lights import LightSpec
from volspec.scene.tables.specs import CameraSpec, RoomSpec
from volspec.scene.tables.transfer import MaskLabelSpec, TransferSpec
from volspec.settings import plain
from volspec.spectra import reflectance
from volspec.transfer import FieldFunctions, Isosurfaces, LabelFunction, Mask, Region
from volspec.transfer import TransferFunction as Curve
from volspec.transfer import TransferFunction2D as Regions
from volspec.volume import Volume

SPECTRAL = SpectralBasis.load("general-5")
KINDS = "curve gradient regions labels surfaces filters preintegrated maximum average fields mask"
LIGHTS = "ambient headlight directional point shadows occlusion physical"
PROJECTIONS, JOINT = ("maximum", "average"), ("fields", "mask")
SIZE, LANES = (40, 32), 4  # these compile in half the time of more
# Of float32; where light is of a light volume, 1 % of the pixels may be off by more than 0.01, and
# next to missing voxels, of which a sample may have 1e-5, by more than the first.
TOLERANCE, LIT, OFF = 2e-4, 0.01, 0.01
Array, Rng, Picture = NDArray[Any], np.random.Generator, list[NDArray[Any]]
Pair = tuple[Any, ...] | None
"""Two scenes, and what then takes each one's arrays to those that are equal."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A picture's parts; ``back_mm`` is how much farther the camera is than its pair's."""

    kind: str
    light: str
    volume: Volume
    transfer: Any
    camera: Camera
    spec: Spec
    meshes: tuple[Mesh, ...] = ()
    size: tuple[int, int] = SIZE
    back_mm: float = 0.0
    device: str | None = None
    behind: tuple[Any, ...] = ()
    rig: LightRig | None = None

    @property
    def lit(self) -> bool:
        return self.kind not in PROJECTIONS and self.light in LIGHTS.split()[4:]

    @property
    def spherical(self) -> bool:  # lit from directions that do not turn with the world
        return self.light in ("occlusion", "physical")

    def spec_of(self, **changes: Any) -> "Scene":
        return replace(self, spec=replace(self.spec, **changes))

    @lru_cache(1)  # noqa: B019 - the first of many pairs
    def cast(self) -> Picture:
        """Return channels, or in a room the logarithm of XYZ, alpha, and its depth in voxels."""
        behind = (MeshCaster(self.meshes, METALS, self.transfer.basis),) if self.meshes else ()
        caster = Raycaster(self.volume, device=self.device, lanes=LANES)
        given = self.volume, self.transfer, self.camera, self.size, self.spec
        image = raycast(*given, behind=behind + self.behind, caster=caster)
        if caster.cluster:
            caster.cluster.close()
        alpha = image.alpha[..., None]
        groups = image.coefficients.reshape(*image.alpha.shape, len(self.spec.groups), -1)
        if self.rig:
            lit = Illumination.of(image.basis, self.rig, RelightSpec(), image.groups)
            groups = np.log1p(lit.scene_XYZ(image.coefficients, image.alpha)[:, :, None] / 100)
        depth = image.depth_mm[..., None]  # infinite where a room alone is seen
        depth = np.where(np.isfinite(depth), depth - self.back_mm, 0.0)
        finest = min(each.smallest_mm for each in self.volume.by_name.values())
        return [groups.sum(axis=2), alpha, alpha * depth / finest]


def vector(array: Array) -> Any:
    return tuple(np.asarray(array, float).tolist())


def smooth(rng: Rng, shape: Any) -> Array:
    values = gaussian_filter(rng.random(shape), rng.uniform(1.2, 2.5))
    return ((values - values.min()) / np.ptp(values)).astype(np.float32)


def curve(rng: Rng, basis: Any = METAL_BASIS, **more: Any) -> Curve:
    """Opacities that begin at 0, and are 0 again in the middle."""
    at = [0.3, 0.42, 0.5, 0.58, 0.8] + rng.uniform(-0.03, 0.03, 5)
    opacity = rng.uniform(0.1, 0.8, 5) * [0, 1, 0, 0, 1]
    points = zip(at.tolist(), opacity.tolist(), rng.choice([*METALS], 5).tolist(), strict=True)
    return Curve([*points], METALS, basis, rng.choice([None, 1.3]), **more)


def seen_by(kind: str, rng: Rng, volume: Volume) -> tuple[Volume, Any]:
    """Return a volume suited to a kind of transfer function, and one."""
    other, made = smooth(rng, volume.values.shape), (METALS, METAL_BASIS)
    if kind == "regions":
        low = float(rng.uniform(0.25, 0.4))
        first = Region((low, low + 0.31), (0.021, 0.32), 0.5, "gold")
        last = Region((low + 0.23, 0.93), (0.052, np.inf), 0.7, "copper")
        return volume, Regions([first, last], *made)
    if kind == "surfaces":
        return volume, Isosurfaces([(0.45, 0.5, "gold"), (0.6, 0.9, "copper")], *made)
    if kind == "labels":
        codes = np.digitize(volume.values, [0.35, 0.5, 0.65]).astype(np.uint8)
        looks = {1: (0.3, "gold"), 2: (0.0, "gold"), 3: (0.6, "copper")}
        return replace(volume, values=codes, missing=None), LabelFunction(looks, *made)
    if kind == "mask":
        codes = np.digitize(other, [0.4, 0.6]).astype(np.uint8)
        masks = {"": Mask("more", {1: curve(rng), 2: None})}
        more = Volume(codes, world_from_index=volume.world_from_index, name="more")
        return volume.with_fields([more]), FieldFunctions({"": curve(rng)}, masks=masks)
    if kind == "fields":
        world = volume.world_from_index @ np.diag([1, rng.choice([1.0, 0.9]), 1, 1])
        more = Volume(other, world_from_index=world, name="more")
        both = FieldFunctions({"": curve(rng), "more": curve(rng)}, {"more": 0.6})
        return volume.with_fields([more]), both
    extra = {
        "gradient": {"gradient_opacity": [(0.02, 0.0), (0.2, 1.0)]},
        "filters": {"basis": SPECTRAL, "filters": {each: reflectance(each) for each in METALS}},
    }
    return volume, curve(rng, **extra.get(kind, {}))


@lru_cache(1)
def scene_of(seed: int) -> Scene:
    """Return the scene of a seed."""
    rng = np.random.default_rng(seed)
    kind, light = (str(rng.choice(each.split())) for each in (KINDS, LIGHTS))
    world = np.diag([*rng.uniform(0.6, 1.8, 3), 1])
    if rng.random() < 0.5:
        world[:3, :3] = Rotation.random(random_state=seed).as_matrix() @ world[:3, :3]
    world[:3, 3] = rng.uniform(-20, 20, 3)
    values = smooth(rng, shape := rng.integers(12, 20, 3))
    if rng.random() < 0.15:
        values[smooth(rng, shape) > 0.75] = np.nan
    volume, transfer = seen_by(kind, rng, Volume(values, None, world, "own"))
    corners, last = volume.corners_mm, np.array(volume.shape_xyz) - 1
    middle, across = corners.mean(axis=0), float(np.ptp(corners, axis=0).max())
    frame, shadows = rng.choice(["world", "camera"]), light in ("shadows", "physical")
    sun = Directional(vector(rng.normal(size=3)), str(frame), shadows=shadows)
    place = vector(middle + across * rng.normal(size=3))
    lamp = Point(place, falloff_mm=across, shadows=shadows)
    sky = Ambient(occlusion=light in ("occlusion", "physical"), radius_mm=across / 4)
    by_kind = {"point": (sky, lamp), "shadows": (sun, lamp), "occlusion": (sky, Headlight())}
    sources = by_kind.get(light, (sky, Headlight() if light == "headlight" else sun))
    spec = Spec(
        step_mm=rng.uniform(0.4, 1) * min(volume.spacing_mm),
        alpha_stop=1.0,  # others end rays a sample earlier or later, by rounding
        flat_gradient=float(rng.choice([0, 0.02])),
        shininess=8,
        light_cells=16,
        **{"diffuse": 0.0, "specular": 0.0} if light == "ambient" else {"specular": 0.2},
        mode=kind if kind in PROJECTIONS else "composite",
        preintegrated=kind == "preintegrated",
        jitter=float(rng.choice([0, 0, 1])),
        groups=(LightGroup("all", sources),),
        physical_light=light == "physical",
    )
    cut = rng.random()
    if cut < 0.25:
        normal = vector(rng.normal(size=3))
        plane = ClipPlane(vector(middle - np.multiply(2, normal)), normal)
        spec = replace(spec, clip_planes=(plane,))
    elif cut < 0.5:
        box = np.stack([rng.uniform(2, 4, 3), last - rng.uniform(2, 4, 3)], axis=1)
        spec = replace(spec, crop_voxels=tuple(map(vector, box)))
    view, up = rng.choice(["perspective", "parallel", "inside"]), vector(rng.normal(size=3))
    angles = {"azimuth_deg": rng.uniform(0, 360), "elevation_deg": rng.uniform(-80, 80)}
    camera = Camera.orbit(volume, **angles, up=up, zoom=1.3, orthographic=view == "parallel")
    if view == "inside":
        camera = Camera(vector(middle + 0.5), camera.position_mm, up, fov_deg=80.0)
    points = rng.uniform(0.1, 0.9, (2, 3, 3)) * last @ volume.world_from_index[:3, :3].T
    points, opacity = points + volume.world_from_index[:3, 3], float(rng.choice([0, 0, 1, 0.4]))
    rows = zip(points if opacity else (), METALS, strict=False)
    meshes = tuple(Mesh(at, [[0, 1, 2]], name, name=name, opacity=opacity) for at, name in rows)
    return Scene(kind, light, volume, transfer, camera, spec, meshes)


def of_functions(transfer: Any, change: Callable[[Any], Any]) -> Any:
    if not isinstance(transfer, FieldFunctions):
        return change(transfer)
    functions = {name: change(each) for name, each in transfer.functions.items()}
    masks = {name: each.changed(change) for name, each in transfer.masks.items()}
    return replace(transfer, functions=functions, masks=masks)


def of_fields(scene: Scene, change: Callable[[Array, Array], tuple[Array, Array]]) -> Scene:
    """Return a scene with other values, NaN where missing, and places of all fields."""

    def relaid(volume: Volume) -> Volume:
        values, world = change(volume.nan_if_missing(volume.values), volume.world_from_index)
        return replace(
            volume, values=np.ascontiguousarray(values, volume.values.dtype), spacing_mm=None,
            world_from_index=world, missing=None, fields=(),
        )  # fmt: skip

    volume = relaid(scene.volume).with_fields(map(relaid, scene.volume.fields))
    return replace(scene, volume=volume)


def with_field(scene: Scene, name: str, volume: Volume, transfer: Any) -> Scene:
    more = replace(volume, fields=(), name=name)
    fields = scene.volume.with_fields([*scene.volume.fields, more])
    return replace(scene, volume=fields, transfer=transfer)


def together(scene: Scene) -> FieldFunctions:
    given = scene.transfer
    return given if isinstance(given, FieldFunctions) else FieldFunctions({"": given})


def moved(scene: Scene, linear: Array, offset: Any = 0.0) -> Scene:
    """Return a scene whose world is turned, mirrored or scaled, and then moved."""
    scale, matrix = abs(np.linalg.det(linear)) ** (1 / 3), np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = linear, offset
    hand = [np.sign(np.linalg.det(linear)), 1, 1]

    def place(point: Any) -> Any:
        return vector(linear @ point + offset)

    def source(given: Any) -> Any:
        if isinstance(given, Directional):
            of_camera = given.frame == "camera"
            way = np.multiply(given.towards, hand) if of_camera else linear @ given.towards
            return replace(given, towards=vector(way))
        if isinstance(given, Point):
            position = place(given.position_mm)
            return replace(given, position_mm=position, falloff_mm=given.falloff_mm * scale)
        if isinstance(given, Ambient):
            return replace(given, radius_mm=given.radius_mm * scale)
        return given

    def function(given: Any) -> Any:
        step, changes = getattr(given, "reference_step_mm", None), {}
        if step is not None:
            changes["reference_step_mm"] = step * scale
        return revalued(given and replace(given, **changes), 1.0, 0.0, 1 / scale)

    camera, (group,) = scene.camera, scene.spec.groups
    planes = (
        ClipPlane(place(each.point_mm), vector(linear @ each.normal))
        for each in scene.spec.clip_planes
    )
    return replace(
        of_fields(scene, lambda values, world: (values, matrix @ world)),
        transfer=of_functions(scene.transfer, function),
        camera=replace(
            camera, position_mm=place(camera.position_mm), target_mm=place(camera.target_mm),
            up=vector(linear @ camera.up), height_mm=camera.height_mm and camera.height_mm * scale,
        ),
        meshes=tuple(replace(m, points_mm=m.points_mm @ linear.T + offset) for m in scene.meshes),
    ).spec_of(
        step_mm=scene.spec.step_mm * scale, clip_planes=tuple(planes),
        groups=(replace(group, sources=tuple(map(source, group.sources))),),
    )  # fmt: skip


def revalued(given: Any, factor: float, more: float, slope: float | None = None) -> Any:
    """Return a transfer function of values that are multiplied and added to."""
    slope = abs(factor) if slope is None else slope

    def to(value: float) -> float:
        return float(value * factor + more)

    if isinstance(given, Isosurfaces):
        return replace(given, surfaces=[(to(v), *rest) for v, *rest in given.surfaces])
    if isinstance(given, Regions):
        values = [vector(sorted(map(to, r.values))) for r in given.regions]
        steep = [vector(np.multiply(slope, r.gradients)) for r in given.regions]
        rows = zip(given.regions, values, steep, strict=True)
        return replace(given, regions=[replace(r, values=v, gradients=g) for r, v, g in rows])
    if isinstance(given, Curve):
        points = sorted([(to(v), *rest) for v, *rest in given.points], key=lambda p: p[0])
        steep = given.gradient_opacity and [(g * slope, f) for g, f in given.gradient_opacity]
        return replace(given, points=points, gradient_opacity=steep)
    return given


def values_times(scene: Scene, factor: float, more: float) -> Scene:
    transfer = of_functions(scene.transfer, lambda given: revalued(given, factor, more))
    made = of_fields(scene, lambda v, w: (v * factor + more if v.dtype.kind == "f" else v, w))
    return replace(made, transfer=transfer)


def padded(scene: Scene, ends: Array, value: float) -> Scene:
    """Return a scene with more voxels, (3, 2) before and after; fewer where negative."""

    def change(values: Array, world: Array) -> tuple[Array, Array]:
        values = np.pad(values, np.maximum(ends, 0)[::-1], constant_values=value)
        sides = zip(ends[::-1], values.shape, strict=True)
        z, y, x = (slice(max(-a, 0), n - max(-b, 0)) for (a, b), n in sides)
        shift = np.eye(4)
        shift[:3, 3] = -ends[:, 0]
        return values[z, y, x], world @ shift

    crop = scene.spec.crop_voxels
    made = of_fields(scene, change)
    box = crop and tuple(map(vector, np.array(crop) + ends[:, :1]))
    return made.spec_of(crop_voxels=box, light_cells=max(made.volume.shape_xyz))


def even(scene: Scene) -> Scene:
    """Return a scene whose light volume has its nodes on voxels, as padded ones have."""
    if not scene.lit:
        return scene
    scale = np.diag([*min(scene.volume.spacing_mm) / np.array(scene.volume.spacing_mm), 1])
    made = of_fields(scene, lambda values, world: (values, world @ scale))
    return made.spec_of(light_cells=max(made.volume.shape_xyz))


def axes(scene: Scene, rng: Rng) -> Pair:
    """Axes of arrays in another order and direction, in the same world."""
    order, flips = rng.permutation(3), rng.random(3) < 0.5
    last = np.array(scene.volume.shape_xyz) - 1

    def change(values: Array, world: Array) -> tuple[Array, Array]:
        matrix = np.eye(4)
        matrix[:3, :3] = np.diag(np.where(flips, -1.0, 1.0))
        matrix[:3, 3] = np.where(flips, np.array(values.shape[::-1]) - 1, 0)
        values = np.flip(values, 2 - np.flatnonzero(flips)).transpose(2 - order[::-1])
        return values, (world @ matrix)[:, [*order, 3]]

    box = scene.spec.crop_voxels
    if box is not None:
        turned = np.where(flips[:, None], last[:, None] - np.array(box)[:, ::-1], box)
        box = tuple(map(vector, turned[order]))
    return scene, of_fields(scene, change).spec_of(crop_voxels=box)


def turned(scene: Scene, rng: Rng) -> Pair:
    if scene.spherical:
        return None
    turn = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    return scene, moved(scene, turn, rng.uniform(-30, 30, 3))


def mirrored(scene: Scene, rng: Rng) -> Pair:
    """Pixels at meshes' edges are means of points without a mirror image."""
    if scene.spherical or scene.meshes:
        return None
    scene, axis = scene.spec_of(jitter=0.0), np.diag(rng.permutation([-1.0, 1.0, 1.0]))
    return scene, moved(scene, axis), lambda a: a[:, ::-1]


def scaled(scene: Scene, rng: Rng) -> Pair:
    return scene, moved(scene, np.eye(3) * 10 ** rng.uniform(-3, 3))


def in_other_values(scene: Scene, rng: Rng) -> Pair:
    return scene, values_times(scene, 10 ** rng.uniform(-3, 3), 0.0)


def with_an_offset(scene: Scene, rng: Rng) -> Pair:
    return scene, values_times(scene, 8.0, rng.uniform(-20, 20))


def turned_over(scene: Scene, rng: Rng) -> Pair:
    return None if scene.kind == "maximum" else (scene, values_times(scene, -1.0, 1.0))


def padded_by_transparent_voxels(scene: Scene, rng: Rng) -> Pair:
    """Means are of longer rays then."""
    if scene.kind in PROJECTIONS:
        return None
    inner = padded(even(scene), np.full((3, 2), 2), 0)
    return inner, padded(inner, rng.integers(0, 5, (3, 2)), 0)


def padded_by_missing_voxels(scene: Scene, rng: Rng) -> Pair:
    """Cropped inside the border, where float32 may have a part of what is missing."""
    if scene.kind in (*JOINT, "labels"):
        return None
    box = tuple((0.0005, n - 1.0005) for n in scene.volume.shape_xyz)
    inner = even(scene).spec_of(crop_voxels=scene.spec.crop_voxels or box)
    return inner, padded(inner, rng.integers(1, 5, (3, 2)), np.nan)


def cropped_by_planes(scene: Scene, rng: Rng) -> Pair:
    if scene.spec.crop_voxels is None:
        return None
    world, inverse, planes = scene.volume.world_from_index, scene.volume.index_from_world, []
    for axis, ends in enumerate(scene.spec.crop_voxels):
        for end, sign in zip(ends, (1, -1), strict=True):
            point = world[:3, :3] @ (end * np.eye(3)[axis]) + world[:3, 3]
            planes.append(ClipPlane(vector(point), vector(sign * inverse[axis, :3])))
    return scene, scene.spec_of(crop_voxels=None, clip_planes=planes)


def cropped_as_an_array(scene: Scene, rng: Rng) -> Pair:
    """Pair with one voxel more around, as slopes are of neighbours; the range scales the floor."""
    if scene.spec.crop_voxels is None or scene.kind in JOINT:
        return None
    whole, box = even(scene).spec_of(flat_gradient=0.0), np.array(scene.spec.crop_voxels)
    low, high = np.floor(box[:, 0]) - 1, np.ceil(box[:, 1]) + 2 - scene.volume.shape_xyz
    return whole, padded(whole, np.stack([-low, high], axis=1).astype(int), 0)


def cut_by_idle_planes(scene: Scene, rng: Rng) -> Pair:
    """One that cuts nothing, and others twice."""
    corners = np.concatenate([each.corners_mm for each in scene.volume.by_name.values()])
    normal = rng.normal(size=3)
    point = corners[np.argmin(corners @ normal)] - 0.1 * normal
    planes = ClipPlane(vector(point), vector(normal)), *scene.spec.clip_planes * 2
    return scene, scene.spec_of(clip_planes=planes)


def in_two_of_less_extinction(scene: Scene, rng: Rng) -> Pair:
    if scene.kind != "curve":
        return None
    both = FieldFunctions({"": scene.transfer, "twin": scene.transfer}, {"": 0.25, "twin": 0.75})
    return scene, with_field(scene, "twin", scene.volume, both)


def in_two_of_other_values(scene: Scene, rng: Rng) -> Pair:
    """A field twice, each with the half of the function in which the other is transparent."""
    if scene.kind not in ("curve", "fields"):
        return None
    given = together(scene)
    own = given.functions[""]
    halves = [[(v, o * (n < 3), m), (v, o * (n >= 3), m)] for n, (v, o, m) in enumerate(own.points)]
    low, high = (replace(own, points=points) for points in zip(*halves, strict=True))
    made = replace(given, functions={**given.functions, "": low, "twin": high})
    return scene, with_field(scene, "twin", scene.volume, made)


def with_a_transparent_field(scene: Scene, rng: Rng) -> Pair:
    if scene.kind not in ("curve", *JOINT):
        return None
    given, clear = together(scene), Curve([(0.0, 0.0, "gold")], METALS, METAL_BASIS)
    made = replace(given, functions={**given.functions, "clear": clear})
    return scene, with_field(scene, "clear", scene.volume, made)


def with_a_mask_of_equal_functions(scene: Scene, rng: Rng) -> Pair:
    if scene.kind not in ("curve", "fields"):
        return None
    codes = np.digitize(smooth(rng, scene.volume.values.shape), [0.4, 0.5, 0.6]).astype(np.uint8)
    field = replace(scene.volume, values=codes, missing=None)
    given = together(scene)
    one, two = (replace(given.functions[""]) for _ in range(2))
    made = replace(given, masks={"": Mask("codes", {1: one, 2: two})})
    return scene, with_field(scene, "codes", field, made)


def with_another_own_field(scene: Scene, rng: Rng) -> Pair:
    """Crop and light volume are along the own field's lattice."""
    if scene.kind != "fields" or scene.spec.crop_voxels or scene.lit:
        return None
    volume, given = scene.volume, scene.transfer
    made = volume.fields[0].with_fields([replace(volume, fields=())])
    functions = {"own": given.functions[""], "": given.functions["more"]}
    return scene, replace(scene, volume=made, transfer=FieldFunctions(functions, {"": 0.6}))


def in_layers(scene: Scene, rng: Rng) -> Pair:
    clear = any(each.opacity < 1 for each in scene.meshes)
    if clear or scene.kind not in ("curve", "labels", "gradient", "regions"):  # refused
        return None
    return scene, scene.spec_of(layers=8, opacities={"gold": 1.0})


def with_groups_of_lights(scene: Scene, rng: Rng) -> Pair:
    (group,) = scene.spec.groups
    groups = [LightGroup(f"of {n}", (each,)) for n, each in enumerate(group.sources)]
    return scene, scene.spec_of(groups=groups[::-1])


def with_half_lights_twice(scene: Scene, rng: Rng) -> Pair:
    (group,) = scene.spec.groups
    half = tuple(replace(each, intensity=each.intensity / 2) for each in group.sources)
    return scene, scene.spec_of(groups=(replace(group, sources=half[::-1] + half),))


def in_another_order(scene: Scene, rng: Rng) -> Pair:
    """Materials, surfaces, regions, fields, meshes and planes."""

    def function(given: Any) -> Any:
        if given is None:
            return None
        parts = {"surfaces", "regions"} & {*dir(given)}
        changes = {name: getattr(given, name)[::-1] for name in parts}
        return replace(given, materials=dict(reversed(given.materials.items())), **changes)

    transfer = of_functions(scene.transfer, function)
    if isinstance(transfer, FieldFunctions):
        transfer = replace(transfer, functions=dict(reversed(transfer.functions.items())))
    normal = vector(rng.normal(size=3))
    point = scene.volume.corners_mm.mean(axis=0) - np.multiply(3, normal)
    scene = scene.spec_of(clip_planes=(ClipPlane(vector(point), normal), *scene.spec.clip_planes))
    other = scene.spec_of(clip_planes=scene.spec.clip_planes[::-1])
    return scene, replace(other, transfer=transfer, meshes=scene.meshes[::-1])


def in_a_window(scene: Scene, rng: Rng) -> Pair:
    """Edges of meshes are known by a pixel's neighbours, so a window's border is left out."""
    (x, y), scene = rng.integers(0, (20, 16)).tolist(), scene.spec_of(jitter=0.0)
    if scene.kind not in (*JOINT, "filters") and rng.random() < 0.5:
        scene = replace(scene, volume=pyramid_of(scene.volume, 8)).spec_of(level=0)
    window = WindowCamera(*astuple(scene.camera), whole=SIZE, corner=(x, y))
    small = replace(scene, camera=window, size=(20, 16))
    return scene, small, lambda a: a[y + 1 : y + 15, x + 1 : x + 19], lambda a: a[1:-1, 1:-1]


def from_along_the_view(scene: Scene, rng: Rng) -> Pair:
    """Another target ahead, up not square to the view, and a parallel camera seven steps back."""
    camera, (_, above, ahead) = scene.camera, scene.camera.frame()
    back = 7 * scene.spec.step_mm if camera.height_mm else 0.0
    position = np.array(camera.position_mm)
    target = position + rng.uniform(0.5, 2) * camera.distance_mm * ahead
    made = replace(
        camera, position_mm=vector(position - back * ahead), target_mm=vector(target),
        up=vector(above + rng.uniform(-1, 1) * ahead),
    )  # fmt: skip
    return scene, replace(scene, camera=made, back_mm=back)


def with_one_mesh_of_both(scene: Scene, rng: Rng) -> Pair:
    if not scene.meshes:
        return None
    same = [replace(each, material="gold") for each in scene.meshes]
    points = np.concatenate([each.points_mm for each in same])
    one = replace(same[0], points_mm=points, triangles=np.arange(6).reshape(2, 3))
    return replace(scene, meshes=tuple(same)), replace(scene, meshes=(one,))


def as_a_mesh(scene: Scene, rng: Rng) -> Pair:
    """A linear field's isosurface is a plane: its middle, as borders of meshes are smooth."""
    if scene.kind != "surfaces" or scene.lit:
        return None
    middle, normal = scene.volume.corners_mm.mean(axis=0), rng.normal(size=3)

    def linear(values: Array, world: Array) -> tuple[Array, Array]:
        xyz = np.moveaxis(np.indices(values.shape)[::-1], 0, -1)
        return (xyz @ world[:3, :3].T + world[:3, 3] - middle) @ normal, world

    side = min(np.multiply(scene.volume.spacing_mm, scene.volume.shape_xyz))
    normal /= np.linalg.norm(normal)
    across = np.linalg.svd(normal[None])[2][1:] * side
    position, height = middle + side * normal + 0.4 * across[0], scene.camera.height_mm and side / 6
    camera = Camera(vector(position), vector(middle), vector(across[1]), 10.0, height)
    spec = replace(scene.spec, flat_gradient=0.0, crop_voxels=None, clip_planes=())
    made = replace(of_fields(scene, linear), camera=camera, spec=spec, meshes=())
    opacity = float(rng.choice([1.0, 0.6]))
    one, none = (replace(scene.transfer, surfaces=[(v, opacity, "gold")]) for v in (0.0, 1e6))
    corners = middle + np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ across
    quad = Mesh(corners, [[0, 1, 2], [0, 2, 3]], "gold", opacity=opacity)
    return replace(made, transfer=one), replace(made, transfer=none, meshes=(quad,))


def part_by_part(scene: Scene, rng: Rng) -> Pair:
    if scene.kind in (*JOINT, "filters"):  # refused
        return None
    big = pyramid_of(scene.volume, int(rng.integers(5, 12)), ranges=bool(rng.random() < 0.5))
    return scene, replace(scene, volume=big).spec_of(level=0)


@lru_cache
def cluster() -> str:
    from distributed import LocalCluster  # in a second

    made = LocalCluster(n_workers=1, processes=False, dashboard_address="127.0.0.1:0")
    return made.scheduler_address


def on_a_cluster(scene: Scene, rng: Rng) -> Pair:
    if scene.kind in PROJECTIONS:  # refused, as meshes are
        return None
    pair = part_by_part(replace(scene, meshes=()), rng)
    return pair and (pair[0], replace(pair[1], device=cluster()))


def in_tables(given: Any, name: str = "") -> dict[str, Any]:
    """Return the table of a transfer function, or of a field's; none if it has none."""
    if not isinstance(given, FieldFunctions):
        return {"transfer": plain(TransferSpec.of(given))}
    if name not in given.functions:
        return {}
    table = plain(TransferSpec.of(given.functions[name])) | {"weight": given.weights.get(name, 1)}
    if mask := given.masks.get(name):
        points = {k: f and TransferSpec.of(f).points for k, f in mask.functions.items()}
        rows = [plain(MaskLabelSpec(k, None, own, own is not None)) for k, own in points.items()]
        table |= {"mask": mask.field, "label": rows}
    return {"transfer": table}


def as_a_file(scene: Scene, rng: Rng) -> Pair:
    """Volume, fields, meshes and settings, written again in another folder and read there."""
    camera, rows, looks, filtered = plain(scene.camera), [], [], scene.kind == "filters"
    if camera.pop("height_mm", None):
        orbit = CameraSpec(*rng.uniform(-80, 80, 2).tolist(), orthographic=True, up=camera["up"])
        scene, camera = replace(scene, camera=orbit.camera(scene.volume)), plain(orbit)
    if scene.kind == "mask":  # whose functions have one step
        to = of_functions(scene.transfer, lambda f: f and replace(f, reference_step_mm=1.3))
        scene = replace(scene, transfer=to)
    keys = ("name", "reflectance", "filter")[: 2 + filtered]
    with TemporaryDirectory() as name:
        first, last = Path(name, "scene.toml"), Path(name, "a", "b", "scene.toml")
        last.parent.mkdir(parents=True)
        for each in scene.volume.by_name.values():
            file = f"{each.name}{rng.choice(['.nrrd', '.mha', '.nii.gz'])}"
            values = each.nan_if_missing(each.values)
            WRITERS["MetaImage"][1](first.with_name(file), values, each.world_from_index)
            table = in_tables(scene.transfer, each.name.removeprefix("own"))
            rows.append({"name": each.name, "file": file} | table)
        for mesh in scene.meshes:
            surface = pyvista.PolyData.from_regular_faces(mesh.points_mm, mesh.triangles)
            surface.save(first.with_name(file := f"{mesh.name}.ply"))
            looks.append({"file": file, "material": mesh.material, "opacity": mesh.opacity})
        tables = {
            "version": 2, "camera": camera, "light": [{"name": "day", "spectrum": "D65"}],
            "volume": {"file": rows[0]["file"]}, "transfer": rows[0]["transfer"],
            "field": rows[1:], "material": [dict.fromkeys(keys, each) for each in METALS],
            "basis": {"name": SPECTRAL.name} if filtered else {"method": "materials"},
            "raycast": plain(replace(scene.spec, groups=HEADLIT)),
            "group": plain(scene.spec.groups), "mesh": looks,
        }  # fmt: skip
        Stored.load(Stored(scene_file(tables, first), first).save()).save(last)
        read = Stored.load(last)
        volume = read.volume()
        made = replace(scene, volume=volume, transfer=read.transfer, spec=read.raycast, meshes=())
        return scene, replace(made, camera=read.camera(volume), behind=read.behind(volume))


def room_of(seed: int, turned: bool = False, factor: float = 1.0, parts: int = 1) -> Any:
    """Return a room's file and a place in it: turned by 90°, larger, or with a lamp in parts."""
    rng, order = np.random.default_rng(seed), [1, 0, 2] if turned else [0, 1, 2]
    sides = ("front", "back", "right", "left", "floor", "ceiling") if turned else SIDES
    size, (azimuth, height, turn) = factor * rng.uniform(2.5, 5, 3), rng.uniform(5, 70, 3).tolist()

    def ends(*points: tuple[float, float, float]) -> Array:  # in fractions of the room
        found = np.array(points) * (1, 1 - 2 * turned, 1) + (0, turned, 0)
        return np.sort(found * size, axis=0)[:, order]

    paints = rng.choice(["grey:0.5", "#f0d9b5", "#4060c0", "grey:0.8", "copper"], 7).tolist()
    rows, side = zip([*sides, "table"], paints, strict=True), int(rng.integers(6))
    low, high = np.delete(ends((0.2, 0.3, 0.25), (0.5, 0.8, 0.6)), order[side // 2], axis=1)
    window = {"on": sides[side], "place_m": vector([*low, *high - low]), "lux": 4000.0}
    bulb = {"position_m": vector(ends((0.2, 0.1, 0.8))[0]), "lumen": 4000 * factor**2 / parts}
    azimuth += (270, 90, 0, 180, 0, 0)[side] + 90 * turned  # through most windows
    turns = {"azimuth_deg": azimuth, "elevation_deg": height}
    lamp = bulb if rng.random() < 0.5 else turns | {"lux": 4000 / parts}
    lights = enumerate([*[lamp | {"spectrum": "A"}] * parts, window | {"spectrum": "D65"}])
    (middle,), (low, high) = ends((0.5, 0.5, 0.6)), ends((0.6, 0.1, 0.0), (0.9, 0.25, 0.3))
    return {
        "size_m": vector(size[order]),
        "surface": [{"name": each, "reflectance": paint} for each, paint in rows],
        "light": [{"name": f"lamp {number}"} | row for number, row in lights],
        "box": [{"name": "table", "low_m": vector(low), "high_m": vector(high)}],
    }, RoomSpec(
        file="room.toml", position_m=vector(middle), scale=5 * factor, directions=1, patches=1000,
        turn_deg=turn + 90 * turned,
    )  # fmt: skip


def in_room(scene: Scene, room: dict[str, Any], place: RoomSpec) -> Scene:
    with TemporaryDirectory() as name:
        Path(name, place.file).write_text(tomlkit.dumps(room))
        made = SceneRoom.of(place, Path(name), SPECTRAL.grid, scene.camera.up)
    transfer = of_functions(scene.transfer, lambda f: f and replace(f, basis=SPECTRAL))
    rig = made.light([LightSpec(name="own", spectrum="room")], {}).rig
    behind = (made.behind(scene.volume, SPECTRAL),)
    return replace(scene, transfer=transfer, spec=made.cast(scene.spec), behind=behind, rig=rig)


def in_a_larger_room_of_more_lamps(scene: Scene, rng: Rng) -> Pair:
    """Larger by a power of 2, as the volume is there, and rows in another order."""
    if scene.kind not in ("curve", "labels", "surfaces"):  # programs for rooms are large
        return None
    seed = int(rng.integers(1 << 30))
    room, place = room_of(seed, False, 2.0 ** rng.integers(-3, 4), 2)
    room |= {key: room[key][::-1] for key in ("surface", "light")}
    return in_room(scene, *room_of(seed)), in_room(scene, room, place)


def in_a_turned_room(scene: Scene, rng: Rng) -> Pair:
    """Form factors are of other rays then, by which light is less than 0.01 off."""
    if scene.kind not in ("curve", "labels", "surfaces"):
        return None
    seed, scene = int(rng.integers(1 << 30)), replace(scene, light="shadows")
    return in_room(scene, *room_of(seed)), in_room(scene, *room_of(seed, True))


RELATIONS: dict[str, Callable[[Scene, Rng], Pair]] = {each.__name__: each for each in (
    axes, turned, mirrored, scaled, in_other_values, with_an_offset, turned_over,
    padded_by_transparent_voxels, padded_by_missing_voxels, cropped_by_planes, cropped_as_an_array,
    cut_by_idle_planes, in_two_of_less_extinction, in_two_of_other_values,
    with_a_transparent_field, with_a_mask_of_equal_functions, with_another_own_field, in_layers,
    with_groups_of_lights, with_half_lights_twice, in_another_order, in_a_window,
    from_along_the_view, with_one_mesh_of_both, as_a_mesh, part_by_part, on_a_cluster, as_a_file,
    in_a_larger_room_of_more_lamps, in_a_turned_room,
)}  # fmt: skip


def fault(name: str, seed: int) -> str | None:
    """Return how a relation's pictures differ: empty if they do not, None if there is no pair."""
    scene = scene_of(seed)
    pair = RELATIONS[name](scene, np.random.default_rng([seed, *name.encode()]))
    if pair is None:
        return None
    one, other, *views = pair
    views += [lambda array: array] * (2 - len(views))
    pairs = zip(map(views[0], one.cast()), map(views[1], other.cast()), strict=True)
    colour, alpha, depth = (np.abs(a - b).max(axis=2) for a, b in pairs)
    off, most = np.maximum(colour, alpha), LIT if one.lit else TOLERANCE
    allowed = OFF if one.lit or other.volume.missing is not None else 0.0
    if (~(off <= most)).mean() <= allowed and (~(depth <= 0.02)).mean() <= allowed:
        return ""
    return f"{name}, seed {seed} ({scene.kind}, {scene.light}): {off.max():.2g}, {depth.max():.2g}"


@pytest.fixture(autouse=True)
def _small_parts(monkeypatch):
    in_parts_of(monkeypatch, 8)


@pytest.mark.filterwarnings("ignore::volspec.errors.VolspecWarning")
@pytest.mark.parametrize("seed", [1, 2, 7])
def test_a_few_pairs_give_one_picture(seed):
    few = ["axes", "scaled", "turned_over", "cut_by_idle_planes", "in_a_window"]
    few += ["as_a_file"] * (seed == 2)  # one without meshes, of which each is read in a second
    assert not [*filter(None, (fault(name, seed) for name in few))]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::volspec.errors.VolspecWarning")
def test_pairs_of_random_scenes_give_one_picture():
    """Some ten of each; all relations of a scene in turn, as they share programs."""
    first, last = map(int, os.environ.get("RELATIONS", "0:12").split(":"))
    faults = [fault(name, seed) for seed in range(first, last) for name in RELATIONS]
    assert not [*filter(None, faults)]
