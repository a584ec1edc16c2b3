"""A display's profile is the space that it was written from."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import ImageCms

from volspec import Display
from volspec.appearance.profile import read_profile
from volspec.appearance.spaces import SPACES, ColourSpace
from volspec.errors import ViewingError
from volspec.export.icc import icc_profile
from volspec.scene import Scene


@pytest.mark.parametrize("space", SPACES.values(), ids=lambda s: s.name)
def test_what_is_written_is_read(space: ColourSpace, tmp_path: Path) -> None:
    path = tmp_path / "monitor.icc"
    path.write_bytes(icc_profile(space))
    read = read_profile(path)
    assert np.abs(read.XYZ_from_RGB - space.XYZ_from_RGB).max() < 0.02
    codes = np.linspace(0.0, 1.0, 101)
    assert np.abs(read.encode(space.decode(codes)) - codes).max() < 1e-3


def test_a_profile_of_another_maker_with_a_sampled_curve_is_read(tmp_path: Path) -> None:
    path = tmp_path / "little.icm"
    path.write_bytes(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    read = read_profile(path)
    assert np.abs(read.XYZ_from_RGB - SPACES["sRGB"].XYZ_from_RGB).max() < 0.1
    assert Display(space=str(path)).colours == read


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
def test_sampled_curves_become_the_power_that_they_are(name: str, tmp_path: Path) -> None:
    path = tmp_path / "sampled.icc"
    codes = np.linspace(0.0, 1.0, 1024)
    path.write_bytes(with_curves(table(SPACES[name].decode(codes))))
    assert np.abs(read_profile(path).encode(SPACES[name].decode(codes)) - codes).max() < 0.003


def test_what_cannot_be_used_is_said_in_one_line(tmp_path: Path) -> None:
    profile = icc_profile(SPACES["sRGB"])
    s_curve = (1 - np.cos(np.pi * np.linspace(0, 1, 256))) / 2
    for data, what in (
        (b"no profile", "no ICC profile"),
        (profile[:300], "damaged|has no"),
        (with_curves(table(s_curve)), "neither sRGB's nor a power"),
        (with_curves(b"para" + struct.pack(">IHH", 0, 1, 0) + bytes(12)), "lift black"),
        (profile.replace(b"rXYZ", b"xXYZ"), "has no rXYZ"),
    ):
        path = tmp_path / "bad.icc"
        path.write_bytes(data)
        with pytest.raises(ViewingError, match=what) as caught:
            Display(space=str(path))
        assert "\n" not in str(caught.value)
    with pytest.raises(ViewingError, match=r"missing\.icc.*No such file"):
        Display(space=str(tmp_path / "missing.icc"))


def test_a_scene_finds_the_profile_beside_it(tmp_path: Path) -> None:
    shipped = Path(__file__).parents[2] / "data"
    text = (shipped / "scenes" / "engine.toml").read_text(encoding="utf-8")
    text = text.replace('"../', f'"{shipped.as_posix()}/')
    (tmp_path / "p3.icc").write_bytes(icc_profile(SPACES["Display P3"]))
    scene = tmp_path / "scene.toml"
    scene.write_text(text + '\n[viewing.display]\nspace = "p3.icc"\n', encoding="utf-8")
    colours = Scene.load(scene).relight.viewing.display.colours
    assert colours.primaries_xy[0] == pytest.approx((0.68, 0.32), abs=1e-3)
