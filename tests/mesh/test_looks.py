"""Looks of meshes: textures, colours made spectral, translucency, mirrors, gratings."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
import pyvista
from PIL import Image

import volspec as vs
from tests.mesh.test_mesh import ABOVE, BASIS, LIT, SIZE, WHITE
from tests.support.errors import raises
from tests.support.fixtures import slow_each
from tests.support.gltf import write_glb
from volspec.errors import InputError, VolspecWarning
from volspec.mesh import texture
from volspec.mesh.paint import texel_channels
from volspec.scene.tables.specs import MeshSpec
from volspec.spectra import XYZ_from_spectra, white_XYZ
from volspec.spectra.construct.colours import XYZ_from_sRGB

MATERIALS = {**WHITE, "black": vs.reflectance("grey:0")}
SUN = replace(LIT, groups=LIT.groups[:1], ambient=0.0)
CODES = np.random.default_rng(5).integers(0, 256, (64, 64, 3), np.uint8)


def cast(*meshes: vs.Mesh, camera: vs.Camera = ABOVE, spec: Any = SUN) -> vs.CoefficientImage:
    return vs.cast_meshes(meshes, MATERIALS, BASIS, camera, SIZE, spec)


def channels(name: str) -> np.ndarray:
    return BASIS.channels_for_materials({name: MATERIALS[name]})[0]


def plane(material: str | vs.Texture = "white", size: float = 64.0, z: float = 0.0) -> vs.Mesh:
    return vs.shape_mesh("plane", size, material).placed((0.0, 0.0, z))


def test_numbers_of_materials_are_seen_where_they_are_in_the_picture():
    """The upper left quarter is red: rows run down, texture coordinates up."""
    numbers = np.zeros((2, 2), int)
    numbers[0, 0] = 1
    image = cast(plane(vs.Texture(np.kron(numbers, np.ones((8, 8), int)), ("white", "red"))))
    assert image.coefficients[16, 16] == pytest.approx(channels("red"), abs=2e-3)
    for corner in ((16, 48), (48, 16), (48, 48)):
        assert image.coefficients[corner] == pytest.approx(channels("white"), abs=2e-3)


def test_shares_are_mixtures_and_numbers_far_away_their_mean():
    shares = np.array([[[3.0, 1.0]]])
    mixed = 0.75 * channels("red") + 0.25 * channels("white")
    near = cast(plane(vs.Texture(shares, ("red", "white"))))
    assert near.coefficients[20, 40] == pytest.approx(mixed, abs=2e-3)
    board = np.indices((256, 256)).sum(axis=0) % 2
    far = cast(plane(vs.Texture(board, ("red", "white"))))
    mean = 0.5 * channels("red") + 0.5 * channels("white")
    assert np.abs(far.coefficients - mean).max() < 5e-3


@pytest.mark.slow
def test_the_device_interpolates_colours_as_numpy():
    lattice = texture.channel_lattice(BASIS, "twin")
    codes = CODES.reshape(-1, 3).astype(np.uint16) * np.uint16(257)
    ours = texture.interpolate_on_device(lattice, codes)
    assert ours.shape == (4096, 7)
    # Half-float's last bit.
    assert ours == pytest.approx(texture.interpolate(lattice, codes), abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("codes", [CODES, CODES.astype(np.uint16) * 257, CODES / 255.0])
def test_colours_made_spectral_are_themselves_under_d65(codes):
    day = vs.light("D65")
    white = white_XYZ(day)
    wanted = XYZ_from_sRGB(CODES / 255.0, white)
    seen = BASIS.xyz(cast(plane(vs.Texture(codes))).coefficients.astype(np.float64), day)
    x, y = white[:2] / white.sum()
    lab = [colour.XYZ_to_Lab(each / 100.0, (x, y)) for each in (wanted, seen)]
    assert colour.delta_E(*lab, method="CIE 2000").mean() <= 0.3


def colour_quad(suffix: str, folder: Path) -> tuple[Path, np.ndarray]:
    """Write a square with a colour at each corner; return the file and the 8-bit codes (4, 3)."""
    codes = np.array([[200, 40, 30], [30, 180, 60], [60, 70, 210], [240, 230, 220]], np.uint8)
    square = pyvista.PolyData(plane().points_mm, [4, 0, 1, 2, 3])
    square.point_data["RGB"] = codes
    path = folder / f"square{suffix}"
    square.save(path, **({"texture": "RGB"} if suffix == ".ply" else {}))
    return path, codes


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".ply", *slow_each(".vtp", ".vtk")])
def test_colours_at_points_are_those_of_a_texture(tmp_path, suffix):
    path, codes = colour_quad(suffix, tmp_path)
    mesh = vs.Mesh.load(path, own_colours=True)
    assert (mesh.material[:, :3] // 257 == codes).all()
    coefficients = cast(mesh).coefficients
    corners = coefficients[[-1, -1, 0, 0], [0, -1, -1, 0]]
    for corner, code in zip(corners, codes, strict=True):
        flat = cast(plane(vs.Texture(np.tile(code, (1, 1, 1)))))
        assert corner == pytest.approx(flat.coefficients[9, 9], abs=0.02)
    middle = coefficients[31:33, 31:33].mean(axis=(0, 1))
    # On the diagonal along which the square is divided.
    means = corners[::2].mean(axis=0), corners[1::2].mean(axis=0)
    assert min(np.abs(middle - mean).max() for mean in means) < 0.02
    assert vs.Mesh.load(path).material == "white"


@pytest.mark.slow
def test_colours_of_triangles_are_sharp_and_follow_those_without_an_area():
    points, codes = plane().points_mm, np.array([[255, 0, 0], [9, 9, 9], [0, 0, 255]], np.uint8)
    with pytest.warns(vs.VolspecWarning, match="no area"):
        mesh = vs.Mesh(points, [[0, 1, 2], [0, 1, 1], [0, 2, 3]], codes)
    assert (mesh.material == codes[[0, 2]].astype(np.uint16) * 257).all()
    image = cast(mesh)
    for at, code in (((50, 40), codes[0]), ((10, 20), codes[2])):
        flat = cast(plane(vs.Texture(np.tile(code, (1, 1, 1)))))
        assert image.coefficients[at] == pytest.approx(flat.coefficients[9, 9], abs=1e-3)


def test_colours_in_gltf_are_linear_light(tmp_path):
    write_glb(tmp_path / "tile.glb", 8.0, (1.0, 0.2140, 0.0))
    codes = vs.Mesh.load(tmp_path / "tile.glb", own_colours=True).material
    assert codes / 65535.0 == pytest.approx(np.array([[1.0, 0.5, 0.0]] * 4), abs=1e-3)


@pytest.mark.slow
def test_meshes_without_colours_keep_their_material(tmp_path):
    pyvista.Cone().save(tmp_path / "cone.ply")
    assert vs.Mesh.load(tmp_path / "cone.ply", "red", own_colours=True).material == "red"
    with pytest.warns(VolspecWarning, match="cone.ply: has no colours, and is shown as copper"):
        scene = vs.Scene.from_mesh(tmp_path / "cone.ply", lights=["D65"])
    assert not scene.file.mesh[0].own_colours and scene.file.mesh[0].material == "copper"


@pytest.mark.slow
def test_a_mesh_alone_is_opened_in_its_own_colours(tmp_path):
    path, codes = colour_quad(".ply", tmp_path)
    scene = vs.Scene.from_mesh(path, lights=["D65"])
    again = vs.Scene.load(scene.save(tmp_path / "square.toml"))
    assert again.file.mesh[0].own_colours
    assert again.surfaces()[0].material.shape == (len(codes), 3)
    ours, same = (each.render(size=(32, 32)).coefficients for each in (scene, again))
    assert np.array_equal(ours, same)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*basis")
def test_a_mesh_s_colours_are_in_its_scene_s_basis(tmp_path):
    """A basis for copper alone would be off by 12 under the scene's own lamps."""
    path, codes = colour_quad(".ply", tmp_path)
    scene = vs.Scene.from_mesh(path)
    found = texture.channel_lattice(scene.basis, "colours")
    channels = texture.interpolate(found, codes.astype(np.uint16) * np.uint16(257))
    truth = texture.reflectance_lattice(scene.basis.grid)
    bands = texture.interpolate(truth, codes.astype(np.uint16) * np.uint16(257))
    for each in scene.lights:
        (lamp,) = each.rig.lights
        white = white_XYZ(lamp)
        x, y = white[:2] / white.sum()
        e = scene.basis.xyz(channels.astype(np.float64), lamp)
        true = XYZ_from_spectra(lamp, bands.astype(np.float64))
        lab = [colour.XYZ_to_Lab(xyz / 100.0, (x, y)) for xyz in (e, true)]
        assert colour.delta_E(*lab, method="CIE 2000").max() < 2.5, each.name


def test_alpha_of_colours_is_left_out_with_a_warning():
    codes = np.array([[9, 8, 7, 255], [9, 8, 7, 100]], np.uint8)
    with pytest.warns(VolspecWarning, match="alpha of its colours"):
        mesh = vs.Mesh(plane().points_mm, plane().triangles, codes)
    assert mesh.material.shape == (2, 3)


def saved(pixels: np.ndarray, path: Path) -> Path:
    Image.fromarray(pixels).save(path)
    return path


def with_alpha(folder: Path, alpha: int) -> Path:
    return saved(np.dstack([CODES, np.full((64, 64, 1), alpha, np.uint8)]), folder / "alpha.png")


def test_textures_are_read_with_16_bits_and_without_alpha(tmp_path):
    deep = np.uint16([[0, 30000], [40001, 65535]])
    assert (vs.Texture.load(saved(deep, tmp_path / "deep.png")).texels[..., 1] == deep).all()
    assert (vs.Texture.load(with_alpha(tmp_path, 255)).texels // 257 == CODES).all()


def test_translucent_meshes_are_composited_and_let_part_of_the_light_pass():
    sheet = replace(plane("red", z=10.0), opacity=0.4)
    image = cast(sheet, plane("white"))
    wanted = 0.4 * channels("red") + 0.6 * 0.6 * channels("white")
    assert image.coefficients[32, 32] == pytest.approx(wanted, abs=2e-3)
    assert image.alpha == pytest.approx(1.0) and cast(sheet).alpha == pytest.approx(0.4)


def test_a_translucent_mesh_just_behind_an_opaque_one_is_hidden():
    front = cast(plane("white"))
    behind = cast(plane("white"), replace(plane("red", z=-1.0), opacity=0.5))
    assert np.array_equal(behind.coefficients, front.coefficients)


@pytest.mark.slow
def test_a_texture_is_converted_once_for_a_basis(monkeypatch):
    """A viewer paints the meshes for every cast."""
    caster = vs.MeshCaster([plane(vs.Texture(CODES)), plane("red")], MATERIALS, BASIS)
    bases = []
    monkeypatch.setattr(
        "volspec.mesh.paint.texel_channels",
        lambda texture, *given: bases.append(1) or texel_channels(texture, *given),
    )
    other = {**MATERIALS, "red": vs.reflectance("ColorChecker/blue")}
    assert caster.painted(other, BASIS).alone(ABOVE, SIZE, SUN).alpha.all() and not bases
    caster.painted(other, vs.SpectralBasis.bands())
    assert bases == [1]


@pytest.mark.slow
def test_a_faint_sheet_in_a_volume_changes_nothing_and_a_dense_one_hides_half():
    """Spans of rays add up to the whole cast; behind an opaque sheet nothing is seen."""
    volume = vs.phantom.ball(48)
    points = [(0.3, 0.0, "white"), (0.5, 0.02, "white")]
    transfer = vs.TransferFunction(points=points, materials=MATERIALS, basis=BASIS)
    middle = volume.corners_mm.mean(axis=0)
    # Few nodes: light is followed to each through the voxels.
    camera, spec = vs.Camera.orbit(volume), replace(SUN, light_cells=12)
    whole = vs.raycast(volume, transfer, camera, (40, 40), spec)
    sheet = plane("black", 400.0).placed(middle)

    def with_sheet(opacity: float) -> vs.CoefficientImage:
        meshes = vs.MeshCaster([replace(sheet, opacity=opacity)], MATERIALS, transfer.basis)
        return vs.raycast(volume, transfer, camera, (40, 40), spec, behind=(meshes,))

    assert np.abs(with_sheet(0.001).coefficients - whole.coefficients).max() < 4e-3
    half, opaque = with_sheet(0.5), with_sheet(1.0)
    nearly = with_sheet(0.999)
    assert np.abs(nearly.coefficients - opaque.coefficients).max() < 8e-3
    assert nearly.alpha.max() <= 1.0 + 1e-6
    between = half.coefficients - 0.5 * (opaque.coefficients + whole.coefficients)
    assert np.abs(between).max() < 0.15  # but for the shadow's square


def test_a_mirror_shows_translucent_meshes_before_opaque_ones():
    """An opacity of next to 1 is seen as 1; half of it, with what is behind it."""
    mirror = replace(plane("black", 64.0), mirror=1.0)
    camera = vs.Camera((0.0, -150.0, 150.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), height_mm=50.0)
    wall = vs.shape_mesh("plane", 500.0, "white").placed((0, 120, 0), (90, 0, 0))
    sheet = vs.shape_mesh("plane", 500.0, "red").placed((0, 80, 0), (90, 0, 0))
    spec = vs.RaycastSpec(groups=(vs.LightGroup("all", (vs.Ambient(),)),))

    def middle(*meshes: vs.Mesh) -> np.ndarray:
        image = cast(mirror, *meshes, camera=camera, spec=spec)
        return image.coefficients[32, 32].astype(np.float64)

    red, white = middle(sheet), middle(wall)
    assert middle(replace(sheet, opacity=0.999), wall) == pytest.approx(red, abs=2e-3)
    mixed = middle(replace(sheet, opacity=0.5), wall)
    assert mixed == pytest.approx(0.5 * red + 0.5 * white, abs=2e-3)


def test_a_mirror_shows_the_mesh_above_it_upside_down():
    red = vs.shape_mesh("sphere", 20.0, "red").placed((0.0, 0.0, 16.0))
    floor = replace(plane("black", 200.0), mirror=0.5)
    image = cast(red, floor, camera=vs.Camera((0.0, -200.0, 60.0), (0.0, 0.0, 8.0), height_mm=64.0))
    # Below the ball's own picture, half as bright at most.
    column = image.coefficients[:, 32, -1]
    lower = column[column.argmax() + 20 :]
    assert 0.05 * column.max() < lower.max() <= 0.51 * column.max()


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("tilt", [0.0, 20.0, 35.0])
def test_stripes_are_where_the_grating_equation_has_them(tilt, order):
    """d (sin θi + sin θo) = m λ on a plane under a sun, seen in perspective, to a pixel."""
    spacing_um, nm = 2.5, 550.0
    lines = vs.Grating(
        spacing_um=spacing_um, across=(1.0, 0.0, 0.0), orders=order, spread_deg=0.2, part=1.0
    )
    mesh = replace(plane("black", 2000.0), grating=lines)
    sun = vs.Directional((np.sin(np.radians(tilt)), 0.0, np.cos(np.radians(tilt))))
    spec = replace(SUN, groups=(vs.LightGroup("sun", (sun,)),))
    camera = vs.Camera((0.0, 0.0, 200.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), fov_deg=70.0)
    bands = vs.SpectralBasis.bands()
    width = 401
    image = vs.cast_meshes([mesh], MATERIALS, bands, camera, (width, 101), spec)
    band = int(np.abs(bands.grid.wavelengths_nm - nm).argmin())
    row = image.coefficients[50, :, band].astype(float)
    # Direction cosines of the stripes; orders of either sign.
    pixel_mm = 2.0 * 200.0 * np.tan(np.radians(35.0)) / 101.0
    found = 0
    for sign in (-1, 1):
        sine = sign * order * nm / (1e3 * spacing_um) - np.sin(np.radians(tilt))
        if abs(sine) >= 1.0:
            continue
        # The eye is above the middle: its direction from x is -x / length.
        x = -200.0 * sine / np.sqrt(1.0 - sine**2)
        at = 200.0 + x / pixel_mm
        if not 8 < at < width - 8:
            continue
        near = np.arange(int(at) - 7, int(at) + 9)
        assert row[near].max() > 0.5
        centre = (near * row[near]).sum() / row[near].sum()
        assert centre == pytest.approx(at, abs=1.0)
        found += 1
    assert found


def test_a_grating_sends_on_no_more_light_than_arrives():
    """The integral over the hemisphere of f cos θ is the part that is diffracted."""
    lines = vs.Grating(spacing_um=5.0, across=(1.0, 0.0, 0.0), orders=2, spread_deg=3.0, part=0.8)
    side = np.linspace(-1.0, 1.0, 401)
    s, t = (each.ravel() for each in np.meshgrid(side, side))
    inside = s * s + t * t < 1.0
    s, t = s[inside], t[inside]
    out = np.stack([s, t, np.sqrt(1.0 - s * s - t * t)], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (len(out), 1))
    rows, found = lines.reflectance(BASIS.grid, np.zeros_like(out), normals, out + normals)
    total = found.sum(axis=0) / np.pi * (side[1] - side[0]) ** 2
    assert len(rows) > 100
    assert total == pytest.approx(0.8, rel=1e-2)


def test_a_new_light_recolours_stripes_without_a_cast():
    lines = vs.Grating(spacing_um=1.6, spread_deg=2.0)
    disc = replace(vs.shape_mesh("disc", 60.0, "white"), grating=lines)
    sun = vs.LightGroup("sun", (vs.Directional((0.5, 0.2, 0.84)),))
    image = cast(disc, spec=replace(SUN, groups=(sun,)))
    day, night = (vs.relight(image, vs.light(name)) for name in ("D65", "HP1"))
    assert image.coefficients.max() > 1.5 * channels("white").max()
    assert np.abs(np.int64(day) - np.int64(night)).max() > 40


@pytest.mark.slow
def test_a_triad_has_an_axis_of_each_colour():
    camera = vs.Camera((120.0, 120.0, 120.0), (0.0, 0.0, 0.0), height_mm=64.0)
    head = replace(SUN, groups=(vs.LightGroup("head", (vs.Headlight(),)),))
    image = vs.cast_meshes([vs.shape_mesh("triad", 30.0)], {}, BASIS, camera, SIZE, head)
    seen = np.float64(vs.relight(image, vs.light("D65")))
    for channel, (y, x) in enumerate([(40, 18), (40, 45), (14, 32)]):
        patch = seen[y - 4 : y + 5, x - 4 : x + 5].reshape(-1, 3)
        others = np.delete(patch, channel, axis=1).max(axis=1)
        assert (patch[:, channel] > 1.3 * others + 20.0).any()


def test_a_mesh_out_of_view_is_warned_of_and_one_need_not_be_a_manifold():
    with pytest.warns(VolspecWarning, match="outside the view"):
        cast(plane(), plane(z=0.0).placed((900.0, 0.0, 0.0)))
    points = [[0, 0, 0], [0, 0, 9], [9, 0, 0], [0, 9, 0], [-9, 0, 0]]
    fans = vs.Mesh(points, [[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert cast(fans, camera=vs.Camera((50, 60, 50), (0, 0, 0))).alpha.any()


def coloured(colours: np.ndarray) -> vs.Mesh:
    return vs.Mesh(plane().points_mm, [[0, 1, 2], [0, 2, 3]], colours)


def of_materials(mesh: vs.Mesh) -> vs.CoefficientImage:
    return vs.cast_meshes([mesh], MATERIALS, vs.MaterialBasis(MATERIALS), ABOVE, SIZE, SUN)


def of_two_sizes(folder: Path) -> vs.Texture:
    a, b = (saved(CODES[:n, :, 0], folder / f"{n}.png") for n in (64, 9))
    return vs.Texture.load_shares({"red": a, "white": b})


def no_picture(folder: Path) -> Path:
    (folder / "d.png").write_bytes(b"no picture")
    return folder / "d.png"


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (lambda _: coloured(np.zeros((3, 3), np.uint8)), "shape"),
        (lambda _: coloured(np.zeros((4, 2), np.uint8)), "shape"),
        (lambda _: coloured(np.zeros(4, np.uint8)), "shape"),
        (lambda _: coloured(np.full((4, 3), 255.0)), "range"),
        (lambda _: of_materials(coloured(np.zeros((4, 3), np.uint8))), "conflict"),
        (lambda _: of_materials(plane(vs.Texture(CODES))), "conflict"),
        (lambda _: MeshSpec(file="a.ply", texture="a.png", own_colours=True), "conflict"),
        (lambda _: vs.Texture([[0, 2]], ("red", "white")), "range"),
        (lambda _: vs.Texture(np.zeros((2, 2, 2)), ("red", "white")), "range"),
        (lambda _: vs.Texture(np.full((2, 2, 3), 255.0)), "range"),
        # No coordinates.
        (lambda _: vs.Mesh(np.eye(3), [[0, 1, 2]], vs.Texture([[0]], ("red",))), "missing"),
        (of_two_sizes, "shape"),
        (lambda to: vs.Texture.load(saved(CODES, to / "c.png"), ("red",)), "shape"),
        (lambda folder: vs.Texture.load(with_alpha(folder, 100)), "unsupported"),
        (lambda folder: vs.Texture.load(no_picture(folder)), "damaged"),
        (lambda _: vs.Grating(spacing_um=0.0), None),
        (lambda _: vs.Grating(spacing_um=0.19), "range"),  # finer than light
        (lambda _: vs.Grating(spacing_um=1.6, cross_um=0.1), "range"),
        (lambda _: replace(plane(), opacity=0.0), "range"),
        (lambda _: vs.shape_mesh("plain"), "unknown"),  # a wrong name
    ],
)
def test_bad_colours_textures_and_looks_are_refused(tmp_path, make, code):
    with raises(InputError, code):
        make(tmp_path)
