"""Meshes: rays, light against analytic answers, depth and shadows with a volume, refusals."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista

import volspec as vs
from tests.support.errors import raises
from tests.support.fixtures import slow, slow_each
from tests.support.scenes import scene_text
from volspec._triangles import TriangleRays, is_mesh_file
from volspec.errors import MeshError, RaycastError, SceneError
from volspec.raycast import reference
from volspec.scene.from_volume import mesh_file

BASIS = vs.SpectralBasis.load("general-7")
WHITE = {"white": vs.reflectance("grey:1"), "red": vs.reflectance("ColorChecker/red")}
SUN = vs.Directional((0.0, 0.0, 1.0), shadows=True)
LIT = vs.RaycastSpec(
    groups=(vs.LightGroup("sun", (SUN,)), vs.LightGroup("sky", (vs.Ambient(occlusion=True),))),
    ambient=1.0,
    diffuse=1.0,
    specular=0.0,
)
# The reference follows light to every node through the voxels, in NumPy.
FEW_NODES = replace(LIT, light_cells=12)
TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
ABOVE = vs.Camera((0.0, 0.0, 200.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), height_mm=64.0)
LOW = vs.Camera((0.0, -200.0, 100.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), height_mm=64.0)
SIZE = (64, 64)


def plane(z: float, half: float = 40.0, name: str = "plane") -> vs.Mesh:
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return vs.Mesh(corners, [[0, 1, 2], [0, 2, 3]], name=name)


@cache
def sphere(radius: float = 20.0) -> vs.Mesh:
    fine = pyvista.Sphere(radius=radius, theta_resolution=180, phi_resolution=90)
    return vs.Mesh.of(fine.compute_normals(), name="sphere")


def cast(*meshes: vs.Mesh, camera: vs.Camera = ABOVE, spec: Any = LIT) -> vs.CoefficientImage:
    return vs.cast_meshes(meshes, WHITE, BASIS, camera, SIZE, spec)


def test_rays_find_triangle_distance_and_shares():
    corners = [[[0, 0, 1], [3, 0, 1], [0, 3, 1]], [[0, 0, 2], [9, 0, 2], [0, 9, 2]]]
    rays = TriangleRays(np.array(corners, float), "tests", "none")
    origins = np.array([[0.3, 0.6, -1.0], [4.0, 4.0, 0.0], [9.0, 9.0, 0.0]])
    hits = rays.hits(origins, np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert hits.triangle.tolist() == [0, 1, -1] and hits.along == pytest.approx([2.0, 2.0, np.inf])
    assert hits.shares[0] == pytest.approx([0.7, 0.1, 0.2])
    assert rays.clear(origins[:1], np.array([[0.3, 0.6, 0.9]])).all()
    assert not rays.clear(origins[:1], np.array([[0.3, 0.6, 1.1]])).any()


def test_a_white_sphere_is_lambert_s():
    """The cosine of the sun's height, at each pixel's normal."""
    image = cast(sphere())
    y, x = (np.mgrid[0:64, 0:64] - 31.5).astype(float)
    inside = x**2 + y**2 < 18.0**2
    true = np.sqrt(20.0**2 - x**2 - y**2, where=inside, out=np.zeros((64, 64))) / 20.0
    found = image.layer("sun").mean(axis=2)
    assert np.abs(found - true)[inside].max() < 0.01
    assert image.depth_mm[inside] == pytest.approx(200.0 - 20.0 * true[inside], abs=0.1)
    assert image.alpha[32, 32] == 1.0 and image.alpha[0, 0] == 0.0
    assert 0.0 < image.alpha[(image.alpha > 0) & (image.alpha < 1)].mean() < 1.0  # edges


def test_a_square_casts_its_shadow_and_takes_the_sky():
    """A square of 20 mm hovers 10 mm above a plane, seen from below its height."""
    image = cast(plane(0.0), plane(10.0, 10.0, "lid"), camera=LOW)
    sun, sky = (image.layer(name).mean(axis=2) for name in ("sun", "sky"))
    # Points of the plane on the line x = 0: rows of the picture, by the cosine of the view.
    free, hidden = (round(31.5 - y / np.sqrt(5.0)) for y in (-25.0, -5.0))
    assert sun[[free, hidden], 32] == pytest.approx([1.0, 0.0], abs=1e-3)
    # Of the sky within 11 mm, a lid at 10 mm hides the middle: 1 - (10 / 11.3)².
    assert sky[free, 32] > 0.97 and sky[hidden, 32] == pytest.approx(0.78, abs=0.03)


def test_a_ball_hides_its_form_factor_of_the_sky():
    """Seen from D away on a plane h below its centre, a ball's form factor is h R² / D³."""
    h, radius = 24.0, 20.0
    sky = vs.LightGroup("sky", (vs.Ambient(occlusion=True, radius_mm=500.0),))
    ball = sphere(radius).placed((0.0, 0.0, h))
    image = cast(plane(0.0, 100.0), ball, camera=LOW, spec=replace(LIT, groups=(sky,)))
    row, column = np.mgrid[34:64, 0:64]  # in front of the ball
    x, y = column - 31.5, (31.5 - row) * np.sqrt(5.0)
    true = 1.0 - h * radius**2 / (x**2 + y**2 + h**2) ** 1.5
    assert image.layer("sky").mean(axis=2)[34:] == pytest.approx(true, abs=0.035)


def test_shares_of_materials_mix():
    """At points linearly, in triangles evenly."""
    at_points = {"white": [1, 1, 0, 0], "red": [0, 0, 2, 2]}
    found = cast(replace(plane(0.0), material=at_points)).layer("sun")
    white, red = (BASIS.channels_for_materials({name: WHITE[name]})[0] for name in WHITE)
    row = 16  # y = 15.5 of -40…40
    share = (15.5 + 40.0) / 80.0
    assert found[row, 32] == pytest.approx((1 - share) * white + share * red, abs=1e-3)
    halves = {"white": [1, 0], "red": [0, 1]}
    found = cast(replace(plane(0.0), material=halves)).layer("sun")
    assert found[50, 60] == pytest.approx(white, abs=1e-6)
    assert found[10, 4] == pytest.approx(red, abs=1e-6)


@cache
def ball() -> tuple[vs.Volume, vs.TransferFunction]:
    volume = vs.phantom.ball(48)
    points = [(0.3, 0.0, "white"), (0.5, 0.02, "white"), (1.0, 0.02, "red")]
    return volume, vs.TransferFunction(points=points, materials=WHITE, basis=BASIS)


def camera_of(volume: vs.Volume) -> vs.Camera:
    return vs.Camera.orbit(volume, azimuth_deg=30, elevation_deg=20)


def inside(volume: vs.Volume, radius: float = 6.0) -> vs.MeshCaster:
    middle = volume.corners_mm.mean(axis=0)
    fine = pyvista.Sphere(radius=radius, center=middle, theta_resolution=90, phi_resolution=45)
    return vs.MeshCaster([vs.Mesh.of(fine.compute_normals(), "red")], WHITE, BASIS)


def test_a_mesh_ends_rays_at_its_depth_and_shades_the_volume_as_the_reference():
    """Twin of the cast with a mesh in the middle: stops, and light that it keeps from voxels."""
    volume, transfer = ball()
    camera, meshes = camera_of(volume), inside(volume)
    size, caster = (20, 20), vs.Raycaster(volume)
    table, stop_mm = caster.bake(transfer), meshes.depths_mm(camera, size)[0]
    assert np.isfinite(stop_mm).any()
    span_mm = np.stack([np.zeros_like(stop_mm), stop_mm], axis=2)
    ours = caster.cast(table, camera, size, FEW_NODES, span_mm=span_mm, clear=meshes.clear)
    given = volume, table, camera, size, FEW_NODES
    true = reference.cast(*given, span_mm, meshes.clear)
    assert np.abs(ours.coefficients - true[0]).max() < 2e-3
    assert np.abs(true[0] - reference.cast(*given, span_mm)[0]).max() > 0.05  # its shadow


@pytest.mark.slow
def test_the_volume_s_light_at_points_is_that_of_its_nodes():
    """Light that arrives at a mesh: in the volume, behind it, and where it passes by."""
    volume, transfer = ball()
    camera, meshes = camera_of(volume), inside(volume)
    caster = vs.Raycaster(volume)
    table = caster.bake(transfer)
    caster.cast(table, camera, (8, 8), FEW_NODES, clear=meshes.clear)
    arrives = caster.transmittances(table, FEW_NODES, camera, meshes.clear)
    low, high = volume.corners_mm.min(axis=0), volume.corners_mm.max(axis=0)
    middle = (low + high) / 2.0
    points = np.array([middle, [*middle[:2], low[2] - 50.0], [*(high[:2] + 9.0), low[2]]])
    true = reference.transmittances(volume, table, FEW_NODES, camera)
    index = points[:1] @ volume.index_from_world[:3, :3].T + volume.index_from_world[:3, 3]
    sun = arrives[0](points)
    assert sun[0] == pytest.approx(float(true[0](index)[0]), abs=2e-3)
    assert sun[1] < sun[0] and sun[2] == 1.0 and arrives[1](points)[2] == 1.0


@pytest.mark.slow
def test_a_mesh_in_a_volume_is_behind_what_is_before_it():
    """A red sphere under a thin shell, through which it is seen, at its own depth."""
    volume, transfer = ball()
    camera, meshes = camera_of(volume), inside(volume)
    image = vs.raycast(volume, transfer, camera, SIZE, FEW_NODES, behind=(meshes,))
    alone = vs.raycast(volume, transfer, camera, SIZE, FEW_NODES)
    assert image.alpha[32, 32] == pytest.approx(1.0)
    assert image.first_mm[32, 32] == pytest.approx(alone.first_mm[32, 32], abs=0.5)
    outside = ~np.isfinite(meshes.depths_mm(camera, SIZE)[0])
    changed = np.abs(image.alpha[outside] - alone.alpha[outside]) > 1e-6
    assert changed.mean() < 0.005  # pixels of its outline


# Of a sheet that leaves a ball of radius 20.
CORNERS = ((-9.0, -7.0, 8.0), (8.0, -6.0, -6.0), (7.0, 8.0, 0.0), (-6.0, 9.0, -8.0))


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), (0.0,), (40.0,)], ids=["alone", "before", "behind"])
@pytest.mark.parametrize("mode", ["composite", *slow_each("maximum")])
def test_edges_of_a_mesh_before_and_in_a_volume_are_those_of_a_finer_picture(mode, more):
    """Mean of 4 x 4 pixels: the volume goes on behind edges, and with a faint sheet elsewhere."""
    volume, thin = ball()
    transfer = replace(thin, points=((0.3, 0.0, "white"), (0.5, 0.9, "white")))
    camera, spec = vs.Camera.orbit(volume, azimuth_deg=30, zoom=2), vs.RaycastSpec(mode=mode)
    right, down, forward = camera.frame()
    near = volume.corners_mm.mean(axis=0) - 17.0 * forward
    corners = [near + a * right + b * down + c * forward for a, b, c in CORNERS]
    sheet = vs.Mesh(corners, [[0, 1, 2], [0, 2, 3]], "red")
    faint = [replace(sheet, opacity=0.5).placed(20.0 * right + at * forward) for at in more]
    meshes = vs.MeshCaster([sheet, *faint], WHITE, BASIS)
    one, fine = (
        vs.raycast(volume, transfer, camera, (n, n), spec, behind=(meshes,)) for n in (48, 192)
    )
    true = fine.alpha.reshape(48, 4, 48, 4).mean(axis=(1, 3))
    seen = true > 0.999
    assert seen.sum() > 400
    assert np.abs(one.alpha - true)[seen].max() < 0.01
    colour = fine.coefficients.reshape(48, 4, 48, 4, -1).mean(axis=(1, 3))
    # A highlight along the sheet's fold is sampled four times in a pixel.
    assert np.sqrt(np.square(one.coefficients - colour)[seen].mean()) < 0.015
    assert np.isfinite(one.depth_mm[one.alpha > 0]).all()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["composite", "maximum", *slow_each("average")])
def test_what_an_edge_covers_in_part_is_a_mixture(mode):
    """Opacity a … + (1 - a) W, with W of the volume alone; also of tips between the points."""
    volume, transfer = ball()
    camera, spec = vs.Camera.orbit(volume, zoom=2), vs.RaycastSpec(mode=mode, alpha_stop=1.0)
    middle = volume.corners_mm.mean(axis=0)
    right, down, _ = camera.frame()
    tips = [middle + x * right + y * down for x, y in ((-9, -9), (-9, -8.9), (9, 7.0))]
    wide = [middle + x * right + y * down for x, y in ((-6, -9), (9, -8), (9, 4))]
    parts = [vs.Mesh(each, [[0, 1, 2]], "red") for each in (tips, wide)]
    meshes = vs.MeshCaster(parts, WHITE, BASIS)
    both = vs.raycast(volume, transfer, camera, SIZE, spec, behind=(meshes,)).alpha
    alone = vs.raycast(volume, transfer, camera, SIZE, spec).alpha
    mesh = meshes.alone(camera, SIZE, spec).alpha
    hits = np.isfinite(meshes.depths_mm(camera, SIZE)[0])
    assert ((mesh > 0) & (mesh < 1)).sum() > 30 and (hits & (mesh == 0)).any()
    edge, free = mesh < 1, (1 - mesh) * alone
    # The opacity before the mesh is unknown: at least 0, at most 1.
    assert (both[edge] >= free[edge] - 1e-5).all()
    assert (both[edge] <= (mesh + free)[edge] + 1e-5).all()


@pytest.mark.slow
def test_a_mesh_is_shaded_only_where_the_volume_lets_it_be_seen():
    """The picture of all of the mesh, but for what the ends of rays leave out."""
    volume, thin = ball()
    camera, meshes = camera_of(volume), inside(volume)
    thick = replace(thin, points=((0.3, 0.0, "white"), (0.5, 0.9, "white")))
    for transfer in (thin, thick):
        image, whole = (
            vs.raycast(volume, transfer, camera, SIZE, spec, behind=(meshes,))
            for spec in (replace(FEW_NODES, alpha_stop=0.999), replace(FEW_NODES, alpha_stop=1.0))
        )
        assert image.coefficients == pytest.approx(whole.coefficients, abs=2e-3)
        assert (image.alpha[32, 32] < 1.0) == (transfer is thick)


@pytest.mark.slow
def test_depth_is_that_of_a_voxelised_surface():
    """A sphere in an empty volume against the isosurface of its distance field: half a voxel."""
    n, radius = 64, 20.0
    z, y, x = np.mgrid[0:n, 0:n, 0:n] - (n - 1) / 2.0
    field = vs.Volume((radius - np.sqrt(x**2 + y**2 + z**2)).astype(np.float32))
    surface = vs.Isosurfaces(((0.0, 1.0, "white"),), WHITE, BASIS)
    camera, size = camera_of(field), (128, 128)
    voxels = vs.raycast(field, surface, camera, size, vs.RaycastSpec(step_mm=0.25))
    depth = inside(field, radius).depths_mm(camera, size)[0]
    seen, true = np.isfinite(depth), voxels.alpha > 0.5
    both = seen & true
    assert np.abs(depth[both] - voxels.first_mm[both]).max() < 0.5
    assert (seen ^ true).sum() < 0.1 * np.sqrt(seen.sum()) * 4  # pixels of the silhouette


@pytest.mark.filterwarnings("ignore:.*(nothing of it is seen|the picture is empty)")
def test_meshes_are_cut_with_the_volume_if_asked():
    """Areas, insides and looks: cut by planes of no field, and by a crop's sides in the volume."""
    volume, transfer = vs.Volume(np.zeros((33, 33, 33), np.uint8), (2, 2, 2)), ball()[1]
    # From z = 32; the middle of the volume.
    camera = replace(ABOVE, position_mm=(32.0, 32.0, 300.0), target_mm=(32.0, 32.0, 32.0))
    half = {"white": [1, 0], "red": [0, 1]}
    whole = replace(plane(32.0, 20.0), material=half).placed((32.0, 32.0, 0.0))
    cut, above = replace(whole, cut=True), vs.ClipPlane((26.5, 0.0, 0.0), (3.0, 0.0, 0.0))

    def seen(*meshes: vs.Mesh, **cuts: Any) -> vs.CoefficientImage:
        casters = [vs.MeshCaster(meshes, WHITE, BASIS)]
        spec = replace(LIT, **cuts)
        return vs.raycast(volume, transfer, camera, SIZE, spec, behind=casters)

    assert seen(cut).alpha.sum() == seen(whole, clip_planes=[above]).alpha.sum() == 1600
    found = seen(cut, clip_planes=[above])
    assert found.alpha.sum() == pytest.approx(40 * 25.5) and found.alpha[32, :26].max() == 0.0
    assert found.coefficients[50, 50] == pytest.approx(seen(whole).coefficients[50, 50], abs=1e-6)
    assert found.coefficients[14, 30] == pytest.approx(seen(whole).coefficients[14, 30], abs=1e-6)
    of_field = replace(above, fields=("",))
    box = (0.0, 20.25), (0.0, 32.0), (0.0, 32.0)  # to x = 40.5
    assert seen(cut, clip_planes=[of_field], crop_voxels=box).alpha.sum() == pytest.approx(
        40 * 28.5
    )
    assert seen(cut, clip_planes=[replace(above, point_mm=(90.0, 0.0, 0.0))]).alpha.max() == 0.0
    # An open ball shows its inside, in its own shadow.
    ball_of = replace(sphere(), cut=True).placed((32.0, 32.0, 32.0))
    low = seen(ball_of, clip_planes=[vs.ClipPlane((0.0, 0.0, 32.0), (0.0, 0.0, -1.0))])
    assert low.depth_mm[32, 32] == pytest.approx(288.0, abs=0.1)
    both = seen(ball_of, plane(20.0).placed((32.0, 32.0, 0.0)), clip_planes=[above])
    assert both.alpha.min() == 1.0 and np.isfinite(both.coefficients).all()


@pytest.mark.parametrize("suffix", ["ply", *slow_each("stl", "obj", "vtp")])
def test_files_are_read_with_smooth_edges(tmp_path, suffix):
    fine, path = pyvista.Sphere(radius=2.0), tmp_path / f"ball.{suffix}"
    if suffix == "obj":
        lines = [f"v {x} {y} {z}" for x, y, z in fine.points]
        faces = fine.faces.reshape(-1, 4)[:, 1:] + 1
        path.write_text("\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces)]))
    else:
        fine.save(path)
    mesh = vs.Mesh.load(path, "red", unit_mm=10.0)
    assert len(mesh.triangles) == fine.n_cells and mesh.normals is not None
    assert np.abs(mesh.points_mm).max() == pytest.approx(20.0, rel=1e-3)
    assert len(vs.Mesh.load(path, smooth_deg=0.0).points_mm) > len(mesh.points_mm)


def test_triangles_without_an_area_are_left_out_with_a_warning():
    with pytest.warns(vs.VolspecWarning, match="1 of its triangles have no area"):
        vs.Mesh(TRIANGLE, [[0, 1, 2], [0, 1, 1]])


GENERAL = '[basis]\nname = "general-7"\n'
MESH = '[[mesh]]\nfile = "core.ply"\nmaterial = "red"\n'
D65 = {"D65": "D65"}
SCENE = scene_text(
    {"white": "grey:1", "red": "ColorChecker/red"},
    [(30, 0, "white"), (50, 0.005, "white")],
    lights=D65,
    more=f"{GENERAL}{MESH}move_mm = [23.5, 23.5, 23.5]\n",
)


def loaded(folder: Path, text: str) -> vs.Scene:
    (folder / "scene.toml").write_text(text)
    return vs.Scene.load(folder / "scene.toml")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.save(tmp_path / "ball.npy", (100 * ball()[0].values).astype(np.uint8))
    pyvista.Sphere(radius=6.0).save(tmp_path / "core.ply")
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path


def test_a_scene_shows_its_meshes(folder):
    texts = SCENE, SCENE.replace("move_mm", "shown = false\nmove_mm")
    shown, hidden = (loaded(folder, text).render(size=SIZE) for text in texts)
    frame, bare = (vs.relight(each, vs.light("D65")).astype(int) for each in (shown, hidden))
    red, green, _ = (frame - bare)[32, 32]
    assert red - green > 30
    assert shown.alpha[32, 32] == pytest.approx(1.0)


def test_other_paint_keeps_what_the_volume_s_light_was_found_for():
    """The light volume's cache goes by this object: a new one would be a new light volume."""
    caster = vs.MeshCaster([plane(0.0)], WHITE, BASIS)
    assert caster.painted(WHITE, BASIS).clear == caster.clear


ALONE = scene_text({"red": "ColorChecker/red"}, file="", lights=D65, more=GENERAL + MESH)


def test_a_scene_of_meshes_alone_is_their_cast(folder):
    """Without [volume] and [transfer]; the camera orbits the box around the meshes."""
    scene = loaded(folder, ALONE)
    volume = scene.volume()
    assert volume.is_empty
    assert volume.corners_mm.max(axis=0) == pytest.approx([6.0] * 3, abs=0.1)
    meshes = [vs.Mesh.load(folder / "core.ply", "red")]
    camera = scene.camera(volume)
    expected = vs.cast_meshes(meshes, scene.materials, BASIS, camera, SIZE, scene.raycast)
    found = scene.render(volume, size=SIZE)
    assert found.coefficients == pytest.approx(expected.coefficients, abs=1e-6)
    assert np.array_equal(found.alpha, expected.alpha)
    again = vs.Scene.load(scene.save(folder / "again.toml"))
    assert "transfer" not in (folder / "again.toml").read_text()
    assert np.array_equal(again.render(size=SIZE).coefficients, found.coefficients)


def test_a_box_keeps_the_camera_when_meshes_are_added(folder):
    box = "volume.box_mm = [[-6, 6], [-6, 6], [-6, 6]]\n"
    more = ALONE.replace("[[light]]", '[[mesh]]\nshape = "triad"\nsize_mm = 50\n[[light]]')
    scenes = [loaded(folder, text) for text in (box + ALONE, box + more, more)]
    cameras = [scene.camera(scene.volume()) for scene in scenes]
    assert cameras[0] == cameras[1] != cameras[2]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*shown as copper")
def test_a_mesh_s_file_becomes_a_scene(folder):
    scene = vs.Scene.from_mesh(folder / "core.ply", lights=["A"])
    assert [light.name for light in scene.lights] == ["A"]
    image = scene.render(size=SIZE)
    assert image.alpha[32, 32] == 1.0 and image.alpha[0, 0] == 0.0
    assert (image.alpha > 0.5).any(axis=0).sum() > 50  # framed


def exported_again(folder: Path) -> None:
    vs.export(loaded(folder, ALONE), folder / "out", size=(16, 16))
    pyvista.Cube().save(folder / "core.ply")
    vs.export(loaded(folder, ALONE), folder / "out", size=(16, 16))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*outside the view")
def test_a_mesh_outside_the_view_changes_nothing_of_a_volume():
    volume, transfer = ball()
    camera = camera_of(volume)
    bare = vs.raycast(volume, transfer, camera, SIZE, FEW_NODES)
    for x, z in ((700.0, 0.0), (0.0, 900.0), (-500.0, 40.0)):
        away = vs.MeshCaster([sphere(5.0).placed((x, 0.0, z))], WHITE, BASIS)
        image = vs.raycast(volume, transfer, camera, SIZE, FEW_NODES, behind=(away,))
        assert np.abs(image.alpha - bare.alpha).max() < 1e-6


@pytest.mark.filterwarnings("ignore:.*shown as copper")
def test_a_vtk_file_is_a_mesh_or_a_volume(tmp_path):
    pyvista.Cone().save(tmp_path / "cone.vtk")
    pyvista.ImageData(dimensions=(4, 4, 4)).save(tmp_path / "box.vtk")
    assert is_mesh_file(tmp_path / "cone.vtk") and not is_mesh_file(tmp_path / "box.vtk")
    assert not is_mesh_file(tmp_path / "missing.vtk")
    assert vs.Scene.from_mesh(tmp_path / "cone.vtk").surfaces()


def test_a_gltf_stands_upright_in_metres(folder):
    (folder / "x.glb").write_bytes(b"")
    row = mesh_file(folder / "x.glb").mesh[0]
    assert (row.unit_mm, row.turn_deg) == (1000.0, (90.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (SCENE.replace("move_mm", "unit_mm = 1000\nmove_mm"), "is unit_mm right"),
        slow(ALONE.replace("[[light]]", "shown = false\n[[light]]"), "no mesh is shown"),
    ],
)
def test_wrong_units_and_hidden_meshes_are_warned_of(folder, text, match):
    with pytest.warns(vs.VolspecWarning, match=match):
        loaded(folder, text).render(size=(8, 8))


def rendered(folder: Path, old: str, new: str) -> object:
    assert old in SCENE
    return loaded(folder, SCENE.replace(old, new)).render(size=(8, 8))


def behind(caster: Any) -> object:
    volume, transfer = ball()
    return vs.raycast(volume, transfer, camera_of(volume), (8, 8), behind=(caster,))


def read(folder: Path, content: str | bytes, name: str = "part.obj") -> vs.Mesh:
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return vs.Mesh.load(folder / name)


def read_part(folder: Path, share: float) -> vs.Mesh:
    """VTK's reader ends the process at some ends of a file."""
    whole = (folder / "core.ply").read_bytes()
    return read(folder, whole[: int(share * len(whole))], "part.ply")


def mesh(material: Any = "red", corners: Any = (0, 1, 2), **look: Any) -> vs.Mesh:
    return vs.Mesh(TRIANGLE, [corners], material, **look)


NINE = vs.MeshCaster([plane(0.0)], WHITE, vs.SpectralBasis.load("general-9"))
POINTS = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("call", "error", "code"),
    [
        (lambda _: vs.Mesh([*TRIANGLE[:2], [0, np.nan, 0]], [[0, 1, 2]]), MeshError, "range"),
        (lambda _: mesh(corners=(0, 1, 3)), MeshError, "range"),
        (lambda _: mesh(corners=(0, 1, 1)), MeshError, "missing"),
        (lambda _: mesh({"red": [1.0, 2.0]}), MeshError, "shape"),
        (lambda _: mesh({"red": [0.0, 0.0, 0.0]}), MeshError, "range"),
        (lambda _: mesh(3), MeshError, "type"),
        (lambda _: cast(mesh("rde")), MeshError, "unknown"),
        (lambda _: vs.MeshCaster(sphere(), WHITE, BASIS), MeshError, "type"),
        (lambda _: behind(NINE), RaycastError, "conflict"),  # another basis than the volume's
        (lambda folder: vs.Mesh.load(folder / "no.ply"), MeshError, "not-found"),
        (lambda folder: read(folder, "ply\n", "bad.plx"), MeshError, "unsupported"),
        (lambda folder: read(folder, "ply\n", "bad.ply"), MeshError, "damaged"),
        (lambda folder: read_part(folder, 0.3), MeshError, "damaged"),
        slow(lambda folder: read_part(folder, 0.9), MeshError, "damaged"),
        (lambda folder: read(folder, ""), MeshError, "damaged"),
        slow(lambda folder: read(folder, "hello\n"), MeshError, "damaged"),
        (lambda folder: read(folder, POINTS), MeshError, "damaged"),
        # VTK would read beyond the points, and end the process.
        (lambda folder: read(folder, f"{POINTS}f 1 2 9\n"), MeshError, "damaged"),
        (lambda folder: vs.Scene.from_mesh(folder / "scene.toml"), SceneError, None),
        (lambda f: rendered(f, '"red"\nmove', '"rde"\nmove'), SceneError, "unknown"),
        (lambda folder: rendered(folder, "core.ply", "cor.ply"), SceneError, "not-found"),
        (lambda folder: rendered(folder, "move_mm", "unit_mm = 0\nmove_mm"), SceneError, "range"),
        (lambda f: rendered(f, '"ball.npy"', '"ball.npy"\nbox_mm = [[0, 1]]'), SceneError, "shape"),
        slow(exported_again, vs.InputError, "conflict"),
    ],
)
def test_what_cannot_be_a_mesh_is_refused(folder, call, error, code):
    with raises(error, code):
        call(folder)


def test_a_spot_lights_the_cone_it_is_aimed_at():
    """On a plane 100 mm below: whole up to tan 10°, dark from tan 15°, a smoothstep between."""
    torch = vs.Spot((20.0, 0.0, 100.0), target_mm=(20.0, 0.0, 0.0), cone_deg=15, edge_deg=5)
    spec = vs.RaycastSpec(diffuse=1.0, specular=0.0, groups=(vs.LightGroup("torch", (torch,)),))
    camera = vs.Camera((0.0, 0.0, 500.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), height_mm=128.0)
    plane = vs.shape_mesh("plane", 400.0, "white")
    image = vs.cast_meshes([plane], WHITE, BASIS, camera, (129, 129), spec)
    x = (np.arange(129) + 0.5) * 128 / 129 - 64 - 20
    rim, whole = np.cos(np.radians([15, 10]))
    cosine = 100 / np.hypot(x, 100)
    t = np.clip((cosine - rim) / (whole - rim), 0, 1)
    expected = cosine * t * t * (3 - 2 * t)
    assert np.abs(image.coefficients[64, :, 0] - expected).max() < 1e-3
    assert np.ptp(expected) > 0.99


def test_a_lamp_with_a_radius_has_the_penumbra_of_its_disc():
    """Behind a straight edge the lit part is that of the disc beyond a chord, to a fiftieth."""
    radius, height, edge_z = 12.0, 200.0, 60.0
    lamp = vs.Point((0.0, 0.0, height), shadows=True, radius_mm=radius)
    shadowed, free = (
        vs.RaycastSpec(diffuse=1.0, specular=0.0, groups=(vs.LightGroup("lamp", (source,)),))
        for source in (lamp, replace(lamp, shadows=False))
    )
    camera = vs.Camera((0.0, 0.0, 50.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0), height_mm=40.0)
    floor = vs.shape_mesh("plane", 400.0, "white")
    # Its edge is at x = 0, above the camera.
    cover = vs.shape_mesh("plane", 400.0, "white").placed((-200.0, 0.0, edge_z))
    pictures = [
        np.float64(
            vs.cast_meshes([floor, cover], WHITE, BASIS, camera, (161, 161), spec).layer("lamp")
        )
        for spec in (shadowed, free)
    ]
    lit = (pictures[0] / pictures[1])[80, :, 0]
    x = (np.arange(161) + 0.5) * 40 / 161 - 20
    # The edge, seen from a point of the floor, at the lamp's height.
    chord = x + (0.0 - x) * height / edge_z
    t = np.clip(-chord / radius, -1, 1)
    expected = 0.5 + (t * np.sqrt(1 - t * t) + np.arcsin(t)) / np.pi
    assert np.abs(lit - expected).max() < 0.02
    assert (lit[0], lit[-1]) == (0.0, 1.0)
