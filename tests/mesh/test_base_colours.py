"""Colours of meshes' own materials: OBJ with MTL, glTF; they come back under D65."""

import struct
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import colour
import numpy as np
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

import volspec as vs
from tests.mesh.test_mesh import BASIS, LIT, WHITE
from tests.support.errors import raises
from tests.support.gltf import write_squares
from volspec.appearance.display import SPACES
from volspec.errors import MeshError, VolspecWarning
from volspec.export.png import icc_profile
from volspec.spectra import white_XYZ

QUARTERS = np.uint8([[[200, 40, 30], [30, 180, 60]], [[60, 70, 210], [240, 230, 220]]])
SIDE = 64
# Four unit squares side by side along x, seen upright and lit from the eye.
EYE = vs.Camera((2.0, 0.5, 10.0), (2.0, 0.5, 0.0), (0.0, 1.0, 0.0), height_mm=1.0)
SUN = replace(LIT, groups=LIT.groups[:1], ambient=0.0)


def picture(codes: np.ndarray = QUARTERS, **settings: Any) -> bytes:
    """Return a PNG of 64 x 64 texels, in blocks of colours."""
    file, times = BytesIO(), SIDE // len(codes)
    Image.fromarray(np.kron(codes, np.ones((times, times, 1), np.uint8))).save(
        file, "PNG", **settings
    )
    return file.getvalue()


def lab(XYZ: np.ndarray) -> np.ndarray:
    """Return CIELAB of XYZ under D65, Y = 100 for white."""
    white = white_XYZ(vs.light("D65"))
    return colour.XYZ_to_Lab(XYZ / 100.0, white[:2] / white.sum())


def seen(mesh: vs.Mesh) -> np.ndarray:
    """Return CIELAB (4, 2, 2, 3) under D65 in the squares, at the middles of their quarters."""
    image = vs.cast_meshes([mesh], WHITE, BASIS, EYE, (256, 64), SUN)
    XYZ = BASIS.xyz(image.coefficients.astype(np.float64), vs.light("D65"))
    middles = XYZ[16::32, 16::32].reshape(2, 4, 2, 3)
    return lab(middles.swapaxes(0, 1))


def wanted(*linear: np.ndarray) -> np.ndarray:
    """Return CIELAB (4, 2, 2, 3) of linear sRGB in each square, by colour-science."""
    white = white_XYZ(vs.light("D65"))
    rows = np.array([np.broadcast_to(each, (2, 2, 3)) for each in linear], float)
    XYZ = colour.RGB_to_XYZ(rows, "sRGB", white[:2] / white.sum(), "Bradford")
    return lab(100.0 * XYZ)


def error(found: np.ndarray, true: np.ndarray) -> float:
    return colour.delta_E(found, true, method="CIE 2000").max()


def squares_obj(folder: Path, mtl: str, names: tuple[str | None, ...]) -> Path:
    """Write unit squares side by side along x as OBJ, of materials by name."""
    lines = ["mtllib looks.mtl", "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    for place, name in enumerate(names):
        corners = ((place, 0), (place + 1, 0), (place + 1, 1), (place, 1))
        lines += [f"v {x} {y} 0" for x, y in corners]
        lines += [f"usemtl {name}"] * (name is not None)
        lines += ["f " + " ".join(f"{4 * place + k}/{k}" for k in (1, 2, 3, 4))]
    (folder / "looks.mtl").write_text(mtl)
    (folder / "squares.obj").write_text("\n".join(lines))
    return folder / "squares.obj"


LINEAR = colour.cctf_decoding(QUARTERS / 255.0, "sRGB")
MTL = """newmtl red
Kd 0.8 0.2 0.1
newmtl wood
  map_Kd -blendu on -mm 0 1 maps\\my wood.png
newmtl dim
Kd 0.5 0.5 0.5
map_Kd maps/my wood.png
"""


def test_obj_has_the_colours_of_its_mtl_under_d65(tmp_path):
    """Kd are sRGB codes; a picture is multiplied by them in linear light."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "my wood.png").write_bytes(picture())
    path = squares_obj(tmp_path, MTL, ("red", "wood", "dim", "red"))
    red = colour.cctf_decoding(np.array([0.8, 0.2, 0.1]), "sRGB")
    half = colour.cctf_decoding(0.5, "sRGB")
    true = wanted(red, LINEAR, half * LINEAR, red)
    assert error(seen(vs.Mesh.load(path, own_colours=True)), true) <= 0.3
    assert vs.Mesh.load(path).material == "white"


def test_gltf_has_the_colours_of_its_materials_under_d65(tmp_path):
    """Factors and COLOR_0 are linear light; a primitive without a material is white."""
    textured = {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.5, 0.8, 1.0, 1.0]}
    materials = [{"baseColorFactor": [0.6, 0.3, 0.02, 1.0]}, textured]
    write_squares(
        tmp_path / "a.glb", materials, (1, 0, None, 1), [picture()], linear=(0.5, 1.0, 0.25)
    )
    true = wanted(
        LINEAR * (0.25, 0.8, 0.25), (0.6, 0.3, 0.02), (1.0, 1.0, 1.0), LINEAR * (0.5, 0.8, 1.0)
    )
    assert error(seen(vs.Mesh.load(tmp_path / "a.glb", own_colours=True)), true) <= 0.3


def test_meshes_of_several_materials_are_cut_with_their_colours(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "my wood.png").write_bytes(picture())
    mesh = vs.Mesh.load(squares_obj(tmp_path, MTL, ("red", "wood")), own_colours=True)
    part = mesh.within(np.array([[1.0, 0.0, 0.0, 0.5]]))
    assert part is not None and error(seen(part)[1], wanted(LINEAR)[0]) <= 0.3
    assert part.digest() != mesh.digest() != vs.Mesh.load(tmp_path / "squares.obj").digest()


@pytest.mark.parametrize(
    ("mtl", "names", "message"),
    [
        ("newmtl red\nmap_Kd gone.png", ("red",), "the picture of 'red', .*gone.png, is mi"),
        ("newmtl red", ("red", "blue"), "material 'blue' is not in its MTL; it is white"),
        ("newmtl red\nmap_Kd -s 2 2 1 w.png", ("red",), "scales of 'red'"),
    ],
)
def test_what_a_material_lacks_is_one_line_and_white(tmp_path, mtl, names, message):
    (tmp_path / "w.png").write_bytes(picture(np.full((1, 1, 3), 255, np.uint8)))
    with pytest.warns(VolspecWarning, match=message):
        mesh = vs.Mesh.load(squares_obj(tmp_path, mtl, names), own_colours=True)
    assert error(seen(mesh)[0], wanted(np.ones(3))[0]) <= 0.3


def test_without_an_mtl_a_mesh_keeps_its_material(tmp_path):
    path = squares_obj(tmp_path, "", ("red",))
    (tmp_path / "looks.mtl").unlink()
    with pytest.warns(VolspecWarning, match="squares.obj: its file of materials, looks.mtl, is mi"):
        assert vs.Mesh.load(path, "red", own_colours=True).material == "red"


def test_gltf_without_materials_is_white(tmp_path):
    """The default of glTF, as of a material without a colour."""
    write_squares(tmp_path / "a.glb", [], (None,))
    write_squares(tmp_path / "b.glb", [{}], (0,))
    for name in ("a.glb", "b.glb"):
        assert (vs.Mesh.load(tmp_path / name, own_colours=True).material == 65535).all()
    assert vs.Mesh.load(tmp_path / "a.glb", "red").material == "red"


def test_a_picture_that_gltf_names_is_missing_in_one_line(tmp_path):
    write_squares(tmp_path / "a.glb", [{"baseColorTexture": {"index": 0}}], (0,), ["gone%20.png"])
    with raises(MeshError, "not-found") as caught:
        vs.Mesh.load(tmp_path / "a.glb")
    assert "names gone .png, which is missing" in str(caught.value)


P3 = np.uint8([[[230, 60, 40], [40, 220, 70]], [[60, 70, 210], [240, 230, 220]]])


def wide_lab(codes: np.ndarray, space: str, gamma: float | None = None) -> np.ndarray:
    """Return CIELAB of codes of one of colour-science's spaces."""
    white = white_XYZ(vs.light("D65"))
    linear = codes / 255.0
    linear = colour.cctf_decoding(linear, "sRGB") if gamma is None else linear**gamma
    XYZ = colour.RGB_to_XYZ(linear, space, white[:2] / white.sum(), "Bradford")
    return lab(100.0 * XYZ)


def chunk(kind: bytes, numbers: list[float]) -> tuple[bytes, bytes]:
    return kind, struct.pack(f">{len(numbers)}I", *(round(1e5 * n) for n in numbers))


def with_chunks(*chunks: tuple[bytes, bytes]) -> PngInfo:
    info = PngInfo()
    for kind, data in chunks:
        info.add(kind, data)
    return info


P3_XY = [0.3127, 0.3290, 0.680, 0.320, 0.265, 0.690, 0.150, 0.060]
# A grey profile of gamma 1.8: header, then its white and curve.
GREY_HEAD = struct.pack(
    ">I4sI4s4s4s12x4s4x24xIIII44x",
    *(192, b"none", 0x02400000, b"mntr", b"GRAY", b"XYZ ", b"acsp"),
    *(0, 0xF6D6, 0x10000, 0xD32D),
)
GREY_TAGS = struct.pack(
    ">I4sII4sII4s4xIII4s4xIH2x",
    *(2, b"wtpt", 156, 20, b"kTRC", 176, 14, b"XYZ ", 0xF6D6, 0x10000, 0xD32D),
    *(b"curv", 1, round(1.8 * 256)),
)
ADOBE = replace(SPACES["Adobe RGB (1998)"], name="Adobe")


def on_square(material: vs.Texture) -> vs.Mesh:
    return vs.shape_mesh("plane", 1.0, material).placed((0.5, 0.5, 0.0))


@pytest.mark.parametrize(
    ("settings", "space", "gamma"),
    [
        ({"icc_profile": icc_profile(SPACES["Display P3"])}, "Display P3", None),
        ({"pnginfo": with_chunks(chunk(b"cHRM", P3_XY))}, "Display P3", None),
        ({"pnginfo": with_chunks(chunk(b"gAMA", [1 / 1.8]))}, "sRGB", 1.8),
        ({"icc_profile": icc_profile(ADOBE)}, "Adobe RGB (1998)", 563 / 256),
        ({"icc_profile": icc_profile(SPACES["sRGB"])}, "sRGB", None),
    ],
)
def test_pictures_have_the_colours_of_their_profile(tmp_path, settings, space, gamma):
    # All of Display P3; its lattice is coarser than sRGB's.
    codes, path = P3 if gamma is None else P3 // 2 + 100, tmp_path / "p.png"
    path.write_bytes(picture(codes, **settings))
    found = seen(on_square(vs.Texture.load(path)))[0]
    true, as_sRGB = wide_lab(codes, space, gamma), wide_lab(codes, "sRGB")
    assert error(found, true) <= (0.3 if space == "sRGB" and gamma is None else 0.5)
    assert (space, gamma) == ("sRGB", None) or error(found, as_sRGB) > 2.0


def test_pictures_of_materials_have_the_colours_of_their_profile(tmp_path):
    """Also next to one of sRGB."""
    (tmp_path / "p3.png").write_bytes(picture(P3, icc_profile=icc_profile(SPACES["Display P3"])))
    (tmp_path / "s.png").write_bytes(picture())
    mtl = "newmtl a\nmap_Kd p3.png\nnewmtl b\nmap_Kd s.png\nnewmtl c\nKd 0.8 0.2 0.1"
    mesh = vs.Mesh.load(squares_obj(tmp_path, mtl, ("a", "b", "c")), own_colours=True)
    found, red = seen(mesh), colour.cctf_decoding(np.array([0.8, 0.2, 0.1]), "sRGB")
    true = [wide_lab(P3, "Display P3"), *wanted(LINEAR, red)]
    assert error(found[:3], np.array(true)) <= 0.5


def test_profiles_of_other_kinds_are_converted_and_damaged_ones_refused(tmp_path):
    """A grey picture's gamma, by Little CMS in steps of 8 bits; CIELAB of a grey is its L*."""
    grey = np.kron(np.uint8([[60, 120], [180, 240]]), np.ones((32, 32), np.uint8))
    profile = bytearray(icc_profile(SPACES["Display P3"]))
    (tmp_path / "bad.png").write_bytes(picture(P3, icc_profile=bytes(profile[:200])))
    with raises(MeshError, "damaged") as caught:
        vs.Texture.load(tmp_path / "bad.png")
    assert "bad.png" in str(caught.value) and "sRGB" in caught.value.remedy
    gamma = GREY_HEAD + GREY_TAGS
    Image.fromarray(grey).save(tmp_path / "g.png", icc_profile=gamma)
    found = seen(on_square(vs.Texture.load(tmp_path / "g.png")))[0]
    linear = (np.array([[60, 120], [180, 240]]) / 255.0) ** 1.8
    true = np.where(linear > 0.008856, 116.0 * np.cbrt(linear) - 16.0, 903.3 * linear)
    assert np.abs(found[..., 0] - true).max() < 0.3 and np.abs(found[..., 1:]).max() < 0.7
