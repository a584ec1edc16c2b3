"""Films: the frames' colours, tagged for players; whole or not at all."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.export.conftest import SCENE, ffmpeg
from tests.export.test_files_whole import left_by_a_kill
from tests.support.errors import raises
from tests.support.fixtures import slow
from volspec.appearance.spaces import SPACES
from volspec.errors import DeviceError, InputError, VolspecWarning
from volspec.export import film
from volspec.export.film import write_film


def probe(path: Path) -> str:
    """Report of ffmpeg on a film."""
    return ffmpeg("-hide_banner", "-i", path, check=False).stderr.decode()


def first_frame(path: Path, size: tuple[int, int]) -> np.ndarray:
    words = ["-i", path, "-frames:v", 1, "-f", "rawvideo", "-pix_fmt", "rgb24"]
    if path.suffix != ".gif":
        words += ["-vf", "scale=in_color_matrix=bt709:in_range=tv:out_range=pc"]
    raw = ffmpeg("-loglevel", "error", *words, "-").stdout
    return np.frombuffer(raw, np.uint8).reshape(size[1], size[0], 3)


@pytest.mark.parametrize("suffix", [".mp4", slow(".webm"), ".gif"])
def test_a_film_has_the_frames_colours_and_says_what_they_are(scene, tmp_path, suffix):
    pytest.importorskip("imageio_ffmpeg")
    made, film = scene(), tmp_path / f"ball{suffix}"
    settings = {"size": (64, 48), "lights": ["lamp"], "turntable": {"frames": 3}}
    left_by_a_kill(film)
    done = made.export(film, **settings)
    assert (done.frames, done.files) == (3, (film.name,))
    assert list(tmp_path.iterdir()) == [film], "the frames of a film are gone with it"
    made.export(tmp_path / "frames", **settings)
    expected = np.asarray(Image.open(tmp_path / "frames" / "lamp" / "0000.png")).astype(int)
    shown = first_frame(film, (64, 48)).astype(int)
    # Chroma is shared by four pixels; the mean reveals a wrong matrix, range or curve.
    off = (shown - expected).mean(axis=(0, 1))
    assert np.abs(off).max() < 3, off
    said = probe(film)
    assert "25 fps" in said
    if suffix != ".gif":
        assert "bt709/bt709/iec61966-2-1" in said and "tv," in said and "yuv420p" in said
    first = film.read_bytes()
    made.export(film, **settings)
    assert film.read_bytes() == first


def test_odd_sides_get_an_edge_more_and_a_note(scene, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    with pytest.warns(VolspecWarning):
        scene().export(tmp_path / "b.mp4", size=(63, 47), sweep={"frames": 2})
    assert "64x48" in probe(tmp_path / "b.mp4")


def test_a_scene_s_odd_size_is_made_even(scene, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    made = scene(text=SCENE.replace("width = 32", "width = 33"))
    made.export(tmp_path / "b.mp4", sweep={"frames": 2})
    assert "32x24" in probe(tmp_path / "b.mp4")


def test_wide_primaries_are_told(scene, tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    made = scene('[viewing.display]\nspace = "Display P3"\n')
    made.export(tmp_path / "b.mp4", sweep={"frames": 2})
    assert "bt709/smpte432/iec61966-2-1" in probe(tmp_path / "b.mp4")


def test_a_film_that_fails_is_not_there_and_what_was_stays(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg")
    Image.new("RGB", (8, 8)).save(tmp_path / "f.png")
    (tmp_path / "b.mp4").write_bytes(b"before")
    monkeypatch.setattr(film, "_CODECS", {".mp4": "-c:v no-such-codec"})
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
        ("b.mp4", {"format": "exr", "spectral": True}),
        ("b.mp4", {"format": "coefficients"}),
        ("b.gif", {"sweep": {"frames": 2}}),
    ],
)
def test_what_no_film_can_hold_is_refused_first(scene, tmp_path, name, settings):
    pytest.importorskip("imageio_ffmpeg")
    made = scene('[viewing.display]\nspace = "Display P3"\n' if name == "b.gif" else "")
    with raises(InputError, "unsupported" if name == "b.gif" else "conflict"):
        made.export(tmp_path / name, **settings)


@pytest.mark.parametrize("program", ["", "/no/such/program", sys.executable])
def test_an_ffmpeg_that_there_is_not_is_told_before_the_frames_are_made(
    program, scene, tmp_path, monkeypatch
):
    """The extra is not installed, or a variable names no ffmpeg."""
    if program:
        pytest.importorskip("imageio_ffmpeg")
        monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    else:
        monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with raises(DeviceError, "unsupported"):
        scene().export(tmp_path / "ball.mp4")
    assert list(tmp_path.iterdir()) == []
