"""Displays in scene files and in PNG files."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from volspec import Display
from volspec.appearance.presets import PRESETS, preset
from volspec.appearance.spaces import SPACES
from volspec.errors import SceneError
from volspec.export.frames import read_frame_text, write_frame
from volspec.export.png import icc_profile
from volspec.settings import plain, read_table


def read(**keys: object) -> Display:
    return read_table(Display, keys, SceneError)


def test_an_empty_table_is_the_default_display() -> None:
    assert read() == Display() == preset("sRGB").display()


def test_a_table_changes_what_it_names_of_its_preset() -> None:
    display = read(preset="cinema", space="DCI-P3", gamut="reduce", Y_b=10.0)
    assert display == Display(0.2 * 48.0, 10.0, "dark", "DCI-P3", "reduce", False, 48.0)


@pytest.mark.parametrize("name", PRESETS)
def test_displays_are_written_by_preset_or_by_numbers(name: str) -> None:
    display = replace(PRESETS[name].display("Display P3", "reduce"), mark=True)
    assert plain(display).get("preset", "sRGB") == name
    assert read(**plain(display)) == display
    odd = replace(display, L_A=None, white_cd_m2=123.0, Y_b=17.0)
    own = replace(odd, space=replace(SPACES["Display P3"], name="mine"))
    for each in (odd, own):
        assert read(**plain(each)) == each


def test_a_white_without_L_A_lights_the_eye_by_itself() -> None:
    assert pytest.approx(30.0) == read(white_cd_m2=300.0, Y_b=10.0).conditions.L_A
    assert read(white_cd_m2=300.0, L_A=4.0).conditions.L_A == 4.0


@pytest.mark.parametrize("name", SPACES)
def test_a_png_says_whose_codes_it_holds(name: str, tmp_path: Path) -> None:
    from PIL import Image

    path = tmp_path / "frame.png"
    frame = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    write_frame(path, frame, {"light": "A"}, name)
    written = path.read_bytes()
    assert (b"sRGB" in written) == (name == "sRGB")
    with Image.open(path) as image:
        profile = image.info.get("icc_profile")
        assert np.array_equal(np.asarray(image), frame)
    assert profile == (None if name == "sRGB" else icc_profile(SPACES[name]))
    assert read_frame_text(path)["light"] == "A"


@pytest.mark.parametrize("name", SPACES)
def test_colour_management_reads_the_profile_as_the_space(name: str) -> None:
    """Little CMS from one profile to another against our matrices and curves."""
    from PIL import Image, ImageCms

    space = SPACES[name]
    codes = np.random.default_rng(3).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    source = ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(space)))
    assert ImageCms.getProfileDescription(source).strip() == name
    target = SPACES["Rec. 2020"] if name != "Rec. 2020" else SPACES["Display P3"]
    other = ImageCms.ImageCmsProfile(io.BytesIO(icc_profile(target)))
    move = ImageCms.buildTransform(
        source, other, "RGB", "RGB", ImageCms.Intent.RELATIVE_COLORIMETRIC
    )
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
