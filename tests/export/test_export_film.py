"""Films: the frames' colours, tagged for players; whole or not at all."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from tests.export.conftest import SCENE, ffmpeg
from tests.export.test_files_whole import left_by_a_kill
from tests.support.errors import raises
from tests.support.fixtures import slow
from volspec.appearance.display.spaces import SPACES
from volspec.errors import DeviceError, InputError, VolspecWarning
from volspec.export import film
from volspec.export.exporter import export
from volspec.export.film import write_film

pytest.importorskip("imageio_ffmpeg")


def probe(path: Path) -> str:
    """Report of ffmpeg on a film."""
    return ffmpeg("-hide_banner", "-i", path, check=False).stderr.decode()


def codes_of(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Frames of a film with their opacity: (F, H, W, 4)."""
    if path.suffix == ".webp":  # ffmpeg reads no films of it
        with Image.open(path) as film:
            frames = [np.asarray(each.convert("RGBA")) for each in ImageSequence.Iterator(film)]
        return np.stack(frames).astype(int)
    words = ["-f", "rawvideo", "-pix_fmt", "rgba"]
    if path.suffix in (".mp4", ".webm", ".mov"):
        words += ["-vf", "scale=in_color_matrix=bt709:in_range=tv:out_range=pc"]
    reader = ["-c:v", "libvpx-vp9"] if path.suffix == ".webm" else []  # others drop the opacity
    raw = ffmpeg("-loglevel", "error", *reader, "-i", path, *words, "-").stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 4).astype(int)


@pytest.mark.parametrize("suffix", [".mp4", slow(".webm"), slow(".mov"), ".gif"])
def test_a_film_has_the_frames_colours_and_says_what_they_are(scene, tmp_path, suffix):
    made, film = scene(), tmp_path / f"ball{suffix}"
    settings = {"size": (64, 48), "lights": ["lamp"], "turntable": {"frames": 3}}
    left_by_a_kill(film)
    done = export(made, film, **settings)
    assert (done.frames, done.files) == (3, (film.name,))
    assert list(tmp_path.iterdir()) == [film], "the frames of a film are gone with it"
    export(made, tmp_path / "frames", **settings)
    expected = np.asarray(Image.open(tmp_path / "frames" / "lamp" / "0000.png")).astype(int)
    shown = codes_of(film, (64, 48))[0, ..., :3]
    # Chroma is shared by four pixels; the mean reveals a wrong matrix, range or curve.
    off = (shown - expected).mean(axis=(0, 1))
    assert np.abs(off).max() < 3, off
    said = probe(film)
    assert "25 fps" in said
    if suffix != ".gif":
        assert "bt709/bt709/iec61966-2-1" in said and "tv," in said
        assert ("yuv444p12" if suffix == ".mov" else "yuv420p") in said
    first = film.read_bytes()
    export(made, film, **settings)
    assert film.read_bytes() == first


@pytest.mark.parametrize(
    ("suffix", "shade", "opacity"),
    [(".webm", 8, 6), (".mov", 3, 1), (".webp", 0, 0), (".apng", 0, 0)],
)
def test_transparent_frames_become_a_transparent_film(suffix, shade, opacity, scene, tmp_path):
    """Also of odd sides, but of WebM; shades are compared over grey, in its worst pixel."""
    made, film = scene(), tmp_path / f"ball{suffix}"
    size = (64, 48) if suffix == ".webm" else (63, 47)
    settings = {"size": size, "lights": ["day"], "transparent": True, "turntable": {"frames": 3}}
    export(made, film, **settings)
    export(made, tmp_path / "frames", **settings)
    paths = sorted((tmp_path / "frames").rglob("0*.png"))
    expected, shown = np.stack([np.asarray(Image.open(p)) for p in paths]), codes_of(film, size)
    assert 0 < (expected[..., 3] == 0).mean() < 1 and shown.shape == expected.shape
    assert np.abs(shown[..., 3] - expected[..., 3].astype(int)).max() <= opacity
    over = [(rows[..., :3] - 128.0) * rows[..., 3:] / 255 for rows in (expected, shown)]
    assert np.abs(over[0] - over[1]).max() <= shade


def test_odd_sides_get_an_edge_more_and_a_note(scene, tmp_path):
    with pytest.warns(VolspecWarning):
        export(scene(), tmp_path / "b.mp4", size=(63, 47), sweep={"frames": 2})
    assert "64x48" in probe(tmp_path / "b.mp4")


@pytest.mark.parametrize(("suffix", "size"), [(".mp4", "32x24"), (".gif", "33x24")])
def test_a_scene_s_odd_size_is_made_even_where_pixels_share_chroma(suffix, size, scene, tmp_path):
    made = scene(text=SCENE.replace("width = 32", "width = 33"))
    export(made, tmp_path / f"b{suffix}", sweep={"frames": 2})
    assert size in probe(tmp_path / f"b{suffix}")


def test_wide_primaries_are_told(scene, tmp_path):
    made = scene('[viewing.display]\nspace = "Display P3"\n')
    export(made, tmp_path / "b.mp4", sweep={"frames": 2})
    assert "bt709/smpte432/iec61966-2-1" in probe(tmp_path / "b.mp4")


def test_a_film_that_fails_is_not_there_and_what_was_stays(tmp_path, monkeypatch):
    Image.new("RGB", (8, 8)).save(tmp_path / "f.png")
    (tmp_path / "b.mp4").write_bytes(b"before")
    monkeypatch.setattr(film, "_CODECS", {".mp4": ("-c:v no-such-codec",)})
    with raises(InputError, "unwritable"):
        frames = [tmp_path / "f.png"] * 50
        write_film(tmp_path / "b.mp4", frames, 25, SPACES["sRGB"], lambda share: None)
    assert (tmp_path / "b.mp4").read_bytes() == b"before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.mp4", "f.png"]


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("b.mp4", {"bits": 16}),
        ("b.mp4", {"transparent": True}),
        ("c.gif", {"transparent": True}),
        ("b.mp4", {"format": "exr", "spectral": True}),
        ("b.mp4", {"format": "coefficients"}),
        ("b.gif", {"sweep": {"frames": 2}}),
        ("b.webp", {"sweep": {"frames": 2}}),
    ],
)
def test_what_no_film_can_hold_is_refused_first(scene, tmp_path, name, settings):
    wide = "sweep" in settings
    made = scene('[viewing.display]\nspace = "Display P3"\n' if wide else "")
    with raises(InputError, "unsupported" if wide else "conflict"):
        export(made, tmp_path / name, **settings)


@pytest.mark.parametrize("program", ["", "/no/such/program", sys.executable])
def test_an_ffmpeg_that_there_is_not_is_told_before_the_frames_are_made(
    program, scene, tmp_path, monkeypatch
):
    """The extra is not installed, or a variable names no ffmpeg."""
    if program:
        monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    else:
        monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with raises(DeviceError, "unsupported"):
        export(scene(), tmp_path / "ball.mp4")
    assert list(tmp_path.iterdir()) == []
