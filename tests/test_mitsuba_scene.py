"""Scenes for Mitsuba 3: the XML, the files that it names, and what Mitsuba reads in them."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista
from PIL import Image

import volspec as vs
from benchmarks.mitsuba_scene import save_mitsuba
from tests.support.errors import raises
from volspec.errors import VolspecWarning

MATERIALS = {
    "white": vs.reflectance("grey:1"),
    "red": vs.reflectance("ColorChecker/red"),
    "a/b: <c>": vs.reflectance("ColorChecker/blue sky"),
}
CAMERA = vs.Camera((0.0, 0.0, 200.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), fov_deg=20.0)
FLAT = vs.Camera((0.0, 0.0, 200.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), height_mm=64.0)
SUN = vs.Directional((0.0, 0.6, 0.8), intensity=0.5, shadows=True)
LAMP = vs.Point((0.0, 30.0, 40.0), falloff_mm=50.0, shadows=True)
SPEC = vs.RaycastSpec(groups=(vs.LightGroup("sun", (SUN,)), vs.LightGroup("lamp", (LAMP,))))
NUMBERS = np.kron([[1, 0], [0, 0]], np.ones((4, 4), int))


def plane(material: str | vs.Texture = "white", z: float = 0.0) -> vs.Mesh:
    return vs.shape_mesh("plane", 64.0, material).placed((0.0, 0.0, z))


def save(path: Path, *meshes: vs.Mesh, **changes: Any) -> ElementTree.Element:
    """Save to a file, and return its root with the folder's name filled in."""
    given = {"camera": CAMERA, "light": vs.light("A"), "size": (64, 48), "spec": SPEC, **changes}
    save_mitsuba(path, meshes, MATERIALS, **given)
    text = path.read_text(encoding="utf-8")
    root = ElementTree.fromstring(text)
    folder = root.find("default[@name='files']").get("value")
    assert re.fullmatch(rf"{path.stem}-[0-9a-f]{{8}}", folder)
    return ElementTree.fromstring(text.replace("$files", str(path.parent / folder)))


def spectrum(element: ElementTree.Element) -> vs.Spectrum:
    return vs.read_spectrum(element.get("filename"))


def test_every_file_that_is_named_is_there_and_no_other(tmp_path):
    texture = vs.Texture(NUMBERS, ("white", "a/b: <c>"))
    root = save(tmp_path / "scene.xml", plane(texture), plane("red", 5.0))
    named = {each.get("filename") for each in root.iter("spectrum")}
    named |= {each.get("value") for each in root.iterfind(".//string[@name='filename']")}
    folder = Path(min(named)).parent
    assert {str(path) for path in folder.iterdir()} == named
    assert sorted(path.name for path in tmp_path.iterdir()) == [folder.name, "scene.xml"]
    assert root.get("version") == "3.0.0"
    ids = {each.get("id") for each in root.findall("bsdf")}
    assert {each.get("id") for each in root.iter("ref")} == ids


def test_spectra_are_the_bands_as_steps(tmp_path):
    root = save(tmp_path / "scene.xml", plane("red"))
    found = spectrum(root.find("bsdf/spectrum"))
    red = MATERIALS["red"]
    assert found.values[::2] == pytest.approx(red.values)
    assert found.values[1::2] == pytest.approx(red.values)
    edges = red.wavelengths_nm + 0.5 * red.grid.step_nm
    assert found.wavelengths_nm[1::2] == pytest.approx(edges, abs=2e-3)
    assert found.on(red.grid).values == pytest.approx(red.values, rel=1e-3)


def test_lights_send_pi_times_what_a_white_reflects(tmp_path):
    """The radiance of a white surface is the light's, times intensity and weight."""
    root = save(tmp_path / "scene.xml", plane())
    power = vs.light("A").values * SPEC.diffuse * np.pi
    sun, lamp = root.findall("emitter")
    assert (sun.get("type"), lamp.get("type")) == ("directional", "point")
    assert spectrum(sun.find("spectrum")).values[::2] == pytest.approx(0.5 * power)
    assert spectrum(lamp.find("spectrum")).values[::2] == pytest.approx(50.0**2 * power)
    way = [float(sun.find("vector").get(key)) for key in "xyz"]
    assert way == pytest.approx([0.0, -0.6, -0.8])
    assert [float(lamp.find("point").get(key)) for key in "xyz"] == [0.0, 30.0, 40.0]


def test_groups_without_light_are_left_out(tmp_path):
    rig = vs.LightRig((vs.light("HP1"),), groups=("lamp",))
    root = save(tmp_path / "scene.xml", plane(), light=rig)
    assert [each.get("type") for each in root.findall("emitter")] == ["point"]


@pytest.mark.parametrize(("camera", "kind"), [(CAMERA, "perspective"), (FLAT, "orthographic")])
def test_camera_and_film(tmp_path, camera, kind):
    root = save(tmp_path / "scene.xml", plane(), camera=camera)
    sensor = root.find("sensor")
    assert sensor.get("type") == kind
    assert sensor.find("transform/lookat").get("origin") == "0, 0, 200"
    film = sensor.find("film")
    sides = [film.find(f"integer[@name='{name}']") for name in ("width", "height")]
    assert [each.get("value") for each in sides] == ["64", "48"]
    if camera is FLAT:
        assert float(sensor.find("transform/scale").get("x")) == pytest.approx(32.0 * 64 / 48)
    else:
        assert float(sensor.find("float[@name='fov']").get("value")) == 20.0


def test_meshes_are_stored_with_normals_and_texture_coordinates(tmp_path):
    mesh = plane(vs.Texture(NUMBERS, ("white", "red")))
    root = save(tmp_path / "scene.xml", mesh)
    file = root.find("shape/string[@name='filename']").get("value")
    head, _, body = Path(file).read_bytes().partition(b"end_header\n")
    assert b"property float nx" in head and b"property float u" in head
    vertices = np.frombuffer(body, "<f4", 4 * 8).reshape(4, 8)
    assert vertices[:, :3] == pytest.approx(mesh.points_mm)
    assert vertices[:, 6:] == pytest.approx(mesh.uv)
    read = pyvista.read(file)
    assert (read.faces.reshape(-1, 4)[:, 1:] == mesh.triangles).all()


def test_shares_of_three_materials_become_weights_of_layers(tmp_path):
    shares = np.array([[[0.5, 0.25, 0.25], [0.0, 0.0, 1.0]]])
    names = ("white", "red", "a/b: <c>")
    root = save(tmp_path / "scene.xml", plane(vs.Texture(shares, names)))
    files = [each.get("value") for each in root.iterfind(".//texture/string[@name='filename']")]
    second, third = (np.asarray(Image.open(file)) / 65535.0 for file in sorted(files))
    assert second == pytest.approx(np.array([[1 / 3, 0.0]]), abs=1e-5)
    assert third == pytest.approx(np.array([[0.25, 1.0]]), abs=1e-5)


def test_looks_become_the_nearest_bsdf(tmp_path):
    clear = vs.Mesh(plane().points_mm, plane().triangles, "red", opacity=0.4, mirror=0.2)
    shiny = vs.RaycastSpec(groups=SPEC.groups, specular=0.3)
    with pytest.warns(VolspecWarning, match="mirrors"):
        root = save(tmp_path / "scene.xml", clear, spec=shiny)
    kinds = [each.get("type") for each in root.find("shape").iter("bsdf")]
    assert kinds == ["mask", "twosided", "blendbsdf", "blendbsdf", "roughconductor", "conductor"]
    assert root.find("integrator").get("type") == "volpath"
    face_normals = root.find("shape/boolean[@name='face_normals']")
    assert face_normals.get("value") == "true"


def test_what_mitsuba_lacks_is_one_line(tmp_path):
    points, triangles = plane().points_mm, plane().triangles
    codes = np.full((2, 2, 3), 90, np.uint8)
    for mesh, said in (
        (
            vs.Mesh(points, triangles, "red", grating=vs.Grating(spacing_um=1.6)),
            "Mitsuba has no gratings",
        ),
        (plane(vs.Texture(codes)), "spectra of its own"),
        (vs.Mesh(points, triangles, codes.reshape(4, 3)), "spectra of its own"),
    ):
        with pytest.warns(VolspecWarning, match=said):
            save(tmp_path / "scene.xml", mesh)
    with pytest.warns(VolspecWarning) as given:
        save(tmp_path / "scene.xml", plane(), spec=vs.RaycastSpec())
    said = [str(each.message).split(":")[0] for each in given]
    assert said == ["headlight light", "ambient light"]


def test_a_new_scene_replaces_the_last_one_and_its_folder(tmp_path):
    for material in ("white", "red", "red"):
        save(tmp_path / "scene.xml", plane(material))
    assert len([*tmp_path.iterdir()]) == 2


@pytest.mark.parametrize(
    ("name", "materials", "code"),
    [
        ("scene.xml", ["copper"], "unknown"),
        ("scene.json", ["white"], "unsupported"),
        ("scene.xml", [], "missing"),
        ("scene.xml", ["red"], "unwritable"),
    ],
)
def test_a_failed_save_leaves_the_last_one(tmp_path, monkeypatch, name, materials, code):
    save(tmp_path / "scene.xml", plane("white"))
    before, write = sorted(tmp_path.rglob("*")), Path.write_bytes

    def full(self: Path, data: bytes) -> int:
        if ".spd" in self.suffix:
            raise OSError(28, "No space left on device", str(self))
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with raises(vs.InputError, code):
        save(tmp_path / name, *map(plane, materials))
    assert sorted(tmp_path.rglob("*")) == before


def both_XYZ(
    path: Path, basis: Any, *meshes: vs.Mesh, light: vs.Spectrum
) -> tuple[np.ndarray, np.ndarray]:
    """The picture under the sun by Mitsuba, and by volspec."""
    mi = pytest.importorskip("mitsuba", reason="Mitsuba 3 is optional: pip install mitsuba")
    mi.set_variant("scalar_spectral")
    spec = vs.RaycastSpec(groups=(vs.LightGroup("sun", (SUN,)),))
    save(path, *meshes, camera=FLAT, spec=spec, size=(16, 16), light=light)
    scene = mi.load_file(str(path), samples="256", pixel_format="xyz")
    image = vs.cast_meshes(meshes, MATERIALS, basis, FLAT, (16, 16), spec)
    ours = basis.xyz(np.asarray(image.coefficients), light)
    return np.array(mi.render(scene, seed=1)), ours


def test_mitsuba_s_picture_is_volspec_s(tmp_path):
    """The red quarter is the upper left one, and both have the same XYZ, within noise."""
    points, triangles = plane().points_mm, plane().triangles
    at_points = {"white": [1.0, 1.0, 0.0, 0.0], "red": [0.0, 0.0, 1.0, 1.0]}
    mixed = vs.Mesh(points * 0.4 + [16.0, -16.0, 1.0], triangles, at_points)
    in_faces = {"white": [1.0, 0.0], "red": [0.0, 1.0]}
    halves = vs.Mesh(points * 0.4 + [-16.0, -16.0, 1.0], triangles, in_faces)
    meshes = plane(vs.Texture(NUMBERS, ("white", "red"))), mixed, halves
    basis = vs.MaterialBasis({name: MATERIALS[name] for name in ("white", "red")})
    peer, ours = both_XYZ(tmp_path / "scene.xml", basis, *meshes, light=vs.light("A"))
    scale = ours[5, 13] / peer[5, 13]
    for row, column in ((2, 2), (2, 13), (13, 13), (10, 10), (10, 7), (10, 3)):
        assert ours[row, column] == pytest.approx(scale * peer[row, column], rel=0.03)


@pytest.mark.parametrize("of", ["points", "triangles"])
def test_mitsuba_s_colours_are_volspec_s(tmp_path, of):
    """Reflectances of a colour differ least under D65; between points Mitsuba mixes otherwise."""
    codes = np.array([[200, 40, 30], [30, 180, 60]], np.uint8)
    corners = plane().points_mm[plane().triangles].reshape(6, 3)
    colours = codes if of == "triangles" else codes.repeat(3, axis=0)
    mesh = vs.Mesh(corners, np.arange(6).reshape(2, 3), colours)
    basis = vs.SpectralBasis.load("general-7")
    with pytest.warns(VolspecWarning, match="spectra of its own"):
        peer, ours = both_XYZ(tmp_path / "scene.xml", basis, mesh, light=vs.light("D65"))
    scale = ours[2, 2].sum() / peer[2, 2].sum()
    for row, column in ((2, 2), (2, 9), (13, 13), (9, 12)):
        most = ours[row, column].max()
        assert ours[row, column] == pytest.approx(scale * peer[row, column], abs=0.05 * most)
