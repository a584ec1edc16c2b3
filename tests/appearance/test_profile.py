"""Displays in scene files, ICC profiles and PNG files."""

import io
import json
import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from tests.support.errors import raises, refuses
from volspec import Display
from volspec.appearance.display.monitors import PRESETS, preset
from volspec.appearance.display.profile import read_profile
from volspec.appearance.display.spaces import SPACES, ColourSpace, Transfer
from volspec.errors import SceneError, ViewingError
from volspec.export.frames import read_frame_text, write_frame
from volspec.export.png import icc_profile
from volspec.relight import RelightSpec
from volspec.scene import Scene
from volspec.scene.model import cast_notes
from volspec.settings import plain, read_table


@pytest.mark.parametrize("space", SPACES.values(), ids=lambda s: s.name)
def test_what_is_written_is_read(space, tmp_path):
    path = tmp_path / "monitor.icc"
    path.write_bytes(icc_profile(space))
    read = read_profile(path)
    assert np.abs(read.XYZ_from_RGB - space.XYZ_from_RGB).max() < 0.02
    codes = np.linspace(0.0, 1.0, 101)
    assert np.abs(read.encode(space.decode(codes)) - codes).max() < 1e-3


def test_a_profile_of_another_maker_with_a_sampled_curve_is_read(tmp_path):
    path = tmp_path / "little.icm"
    path.write_bytes(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    read = read_profile(path)
    assert np.abs(read.XYZ_from_RGB - SPACES["sRGB"].XYZ_from_RGB).max() < 0.1
    assert Display(space=str(path)).colours == read
    assert Display(space=path) == Display(space=str(path))


def table(values: np.ndarray) -> bytes:
    words = np.rint(values * 65535).astype(">u2")
    return b"curv" + struct.pack(">II", 0, len(words)) + words.tobytes()


def with_curves(curve: bytes) -> bytes:
    """sRGB's profile with other curves behind it."""
    data = bytearray(icc_profile(SPACES["sRGB"]))
    start = len(data)
    (count,) = struct.unpack_from(">I", data, 128)
    for i in range(count):
        at = 132 + 12 * i
        if data[at : at + 4] in (b"rTRC", b"gTRC", b"bTRC"):
            struct.pack_into(">II", data, at + 4, start, len(curve))
    return bytes(data) + curve


@pytest.mark.parametrize("name", ["sRGB", "Adobe RGB (1998)", "DCI-P3"])
def test_sampled_curves_become_the_power_that_they_are(name, tmp_path):
    path = tmp_path / "sampled.icc"
    codes = np.linspace(0.0, 1.0, 1024)
    path.write_bytes(with_curves(table(SPACES[name].decode(codes))))
    assert np.abs(read_profile(path).encode(SPACES[name].decode(codes)) - codes).max() < 0.003


@pytest.mark.parametrize(
    ("exponent", "size"), [(1.0, 2), (1.0, 3), (1.0, 4096), (2.2, 16), (2.2, 256)]
)
def test_tables_of_few_numbers_are_read(exponent, size, tmp_path):
    path = tmp_path / "few.icc"
    path.write_bytes(with_curves(table(np.linspace(0.0, 1.0, size) ** exponent)))
    assert 1.0 / read_profile(path).transfer.power == pytest.approx(exponent, rel=0.01)


def of_class(data: bytes, start: int, what: bytes) -> bytes:
    """A profile whose header says something else."""
    return data[:start] + what + data[start + 4 :]


SRGB = icc_profile(SPACES["sRGB"])
ZEROS = np.zeros(256)
# The error's code, and the file.
BAD = {
    "folder": ("not-found", None),
    "no profile": ("damaged", b"no profile"),
    "cut": ("damaged", SRGB[:300]),
    "S curve": ("unsupported", with_curves(table((1 - np.cos(np.linspace(0, np.pi, 256))) / 2))),
    "lifted": ("unsupported", with_curves(b"para" + struct.pack(">IHH", 0, 1, 0) + bytes(12))),
    "no rXYZ": ("damaged", SRGB.replace(b"rXYZ", b"xXYZ")),
    "zeros": ("unsupported", with_curves(table(ZEROS))),
    "only white": ("unsupported", with_curves(table(np.r_[ZEROS, 1.0]))),
    "short table": ("damaged", with_curves(b"curv" + struct.pack(">II", 0, 9) + bytes(8))),
    "table of 2^32": ("damaged", with_curves(b"curv" + struct.pack(">II", 0, 2**32 - 1))),
    "gamma 0": ("range", with_curves(b"curv" + struct.pack(">IIH", 0, 1, 0))),
    "g 0": ("range", with_curves(b"para" + struct.pack(">IHHi", 0, 0, 0, 0))),
    "type 9": ("damaged", with_curves(b"para" + struct.pack(">IHHi", 0, 9, 0, 0))),
    "printer": ("unsupported", of_class(SRGB, 12, b"prtr")),
    "grey": ("unsupported", of_class(SRGB, 16, b"GRAY")),
    "LUT": ("unsupported", of_class(SRGB, 20, b"Lab ")),
    "no light": ("range", re.sub(rb"(?s)XYZ \0{4}.{12}", b"XYZ " + bytes(16), SRGB)),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("code", "data"), BAD.values(), ids=BAD)
def test_bad_profiles_are_refused_by_name(code, data, tmp_path):
    path = tmp_path / "bad.icc"
    path.mkdir() if data is None else path.write_bytes(data)
    with raises(ViewingError, code, "Display.space") as caught:
        Display(space=str(path))
    assert "bad.icc" in str(caught.value)


def scene_for(folder: Path, display: str) -> Scene:
    """The engine under a display that its scene describes."""
    shipped = Path(__file__).parents[2] / "data"
    text = (shipped / "scenes" / "engine.toml").read_text(encoding="utf-8")
    text = text.replace('"../', f'"{shipped.as_posix()}/')
    scene = folder / "scene.toml"
    scene.write_text(f"{text}\n[viewing.display]\n{display}\n", encoding="utf-8")
    return Scene.load(scene)


def test_a_scene_finds_its_profile_and_the_note_in_its_image_needs_none(tmp_path):
    (tmp_path / "mine.icc").write_bytes(icc_profile(SPACES["Display P3"]))
    scene = scene_for(tmp_path, 'space = "mine.icc"')
    note = cast_notes(scene.file, scene.relight)["viewing"]
    assert str(tmp_path) not in note and ".icc" not in note
    (tmp_path / "mine.icc").unlink()
    again = read_table(RelightSpec, json.loads(note), SceneError).viewing
    assert again == scene.relight.viewing
    assert again.display.colours.name == "mine"
    assert again.display.colours.primaries_xy[0] == pytest.approx((0.68, 0.32), abs=1e-3)


def test_a_scene_may_give_a_measured_display_in_numbers(tmp_path):
    xy = "primaries_xy = [[0.68, 0.32], [0.265, 0.69], [0.15, 0.06]], white_xy = [0.3127, 0.329]"
    measured = scene_for(tmp_path, f"space = {{ {xy}, transfer = 2.2 }}")
    assert measured.relight.viewing.display.colours == ColourSpace(
        "display", SPACES["Display P3"].primaries_xy, (0.3127, 0.329), Transfer.gamma(2.2)
    )
    refuses(lambda: scene_for(tmp_path, "space = 5"), "type viewing.display.space")


def read(**keys: object) -> Display:
    return read_table(Display, keys, SceneError)


def test_a_table_changes_what_it_names_of_its_preset():
    assert read() == Display() == preset("sRGB").display()
    display = read(preset="cinema", space="DCI-P3", gamut="reduce", Y_b=10.0)
    assert display == Display(0.2 * 48.0, 10.0, "dark", "DCI-P3", "reduce", False, 48.0)


@pytest.mark.parametrize("name", PRESETS)
def test_displays_are_written_by_preset_or_by_numbers(name):
    display = replace(PRESETS[name].display("Display P3", "reduce"), mark=True)
    assert plain(display).get("preset", "sRGB") == name
    assert read(**plain(display)) == display
    odd = replace(display, L_A=None, white_cd_m2=123.0, Y_b=17.0)
    for each in (odd, replace(odd, space=replace(SPACES["Display P3"], name="mine"))):
        assert read(**plain(each)) == each


def test_a_white_without_L_A_lights_the_eye_by_itself():
    assert pytest.approx(30.0) == read(white_cd_m2=300.0, Y_b=10.0).conditions.L_A
    assert read(white_cd_m2=300.0, L_A=4.0).conditions.L_A == 4.0


@pytest.mark.parametrize("name", SPACES)
def test_a_png_says_whose_codes_it_holds(name, tmp_path):
    path = tmp_path / "frame.png"
    frame = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    write_frame(path, frame, {"light": "A"}, name)
    assert (b"sRGB" in path.read_bytes()) == (name == "sRGB")
    with Image.open(path) as image:
        profile = image.info.get("icc_profile")
        assert np.array_equal(np.asarray(image), frame)
    assert profile == (None if name == "sRGB" else icc_profile(SPACES[name]))
    assert read_frame_text(path)["light"] == "A"


@pytest.mark.parametrize("name", SPACES)
def test_colour_management_reads_the_profile_as_the_space(name):
    """Little CMS from one profile to another against our matrices and curves."""
    space = SPACES[name]
    codes = np.random.default_rng(3).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    source = ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(space)))
    assert ImageCms.getProfileDescription(source).strip() == name
    target = SPACES["Rec. 2020"] if name != "Rec. 2020" else SPACES["Display P3"]
    other = ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(target)))
    relative = ImageCms.Intent.RELATIVE_COLORIMETRIC
    move = ImageCms.buildTransform(source, other, "RGB", "RGB", relative)
    shown = np.asarray(ImageCms.applyTransform(Image.fromarray(codes), move)).astype(float)
    linear = space.decode(codes / 255.0)
    if space.white_xy == target.white_xy:
        linear = linear @ (target.RGB_from_XYZ @ space.XYZ_from_RGB).T
        ours = 255.0 * target.encode(np.clip(linear, 0.0, 1.0))
        dark = (ours < 16.0).any(axis=-1)  # eight bits of a pure power are coarse there
        assert np.abs(shown - ours)[~dark].max() < 1.5
    else:
        white = Image.fromarray(np.full((1, 1, 3), 255, np.uint8))
        assert np.asarray(ImageCms.applyTransform(white, move)).min() == 255
