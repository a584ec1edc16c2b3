"""``volspec render``: sizes, halves, interruptions; ``volspec info`` of labels."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from tests.support.commands import call, figures
from tests.support.scenes import BALL, DAY, SMALL, write_scene_text
from volspec.errors import OpenCLError
from volspec.export.frames import read_frame, read_frame_text
from volspec.raycast import CoefficientImage
from volspec.raycast.gpu import Raycaster

ROOT = Path(__file__).resolve().parents[2]
GROUPS = """[[group]]
name = "key"
sources = [{ kind = "directional", towards = [0, -1, 1], shadows = true }]
[[group]]
name = "sky"
sources = [{ kind = "ambient" }]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write_scene_text(tmp_path, BALL + GROUPS + DAY + SMALL, 16)


def test_render_says_what_it_wrote(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = scene.with_name("i.exr")
    assert call("render", scene, "-o", out) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{out}: 24×16") and "100%" in printed.err
    image = CoefficientImage.load(out)
    assert image.coefficients.dtype == np.float32 and list(image.groups) == ["key", "sky"]


def test_a_picture_is_the_first_frame_of_an_export(scene: Path) -> None:
    assert call("render", scene, "-o", scene.with_name("p.png")) == 0
    assert call("export", scene, "-o", scene.with_name("frames"), "--light", "day") == 0
    frame = scene.with_name("frames") / "day.png"
    assert (read_codes(scene.with_name("p.png")) == read_codes(frame)).all()


def read_codes(path: Path) -> np.ndarray:
    """Return a picture's codes."""
    return np.asarray(read_frame(path).convert("RGB"))


def test_size_and_half_are_taken_in_place_of_the_scene_s(scene: Path) -> None:
    out = scene.with_name("i.exr")
    assert call("render", scene, "-o", out, "--size", "40x30", "--half") == 0
    image = CoefficientImage.load(out)
    assert image.size == (40, 30) and image.coefficients.dtype == np.float16


def test_a_device_that_refuses_is_told_in_one_line(
    scene: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OpenCLError("pocl: out of\nmemory; cast it smaller")

    monkeypatch.setattr(Raycaster, "cast", refuse)
    assert call("render", scene, "-o", scene.with_name("i.exr")) == 1
    assert capsys.readouterr().err.count("volspec: pocl: ") == 1


# The command, which says on stdout that a band of the picture is there. A suite that a shell runs
# in the background ignores the interrupt, and so would its children.
TELLING_BANDS = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from volspec.raycast.row_batches import RowBatches; fetch = RowBatches._fetch\n"
    "def fetch_and_print(*a): fetch(*a); sys.stdout.write('band\\n'); sys.stdout.flush()\n"
    "RowBatches._fetch = fetch_and_print; from volspec.cli import main; main()"
)


def test_an_interrupted_cast_leaves_the_image_that_was_there(tmp_path: Path) -> None:
    """A picture of half a minute or so, interrupted once its first band is there."""
    text = (ROOT / "data/scenes/engine-groups.toml").read_text()
    (tmp_path / "s.toml").write_text(text.replace('"../', f'"{ROOT}/data/'))
    out = tmp_path / "i.exr"
    out.write_bytes(b"mine")
    words = ("render", str(tmp_path / "s.toml"), "-o", str(out), "--size", "4096x4096", "--half")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, "-c", TELLING_BANDS, *words], text=True, **pipes)
    watchdog = threading.Timer(120, process.kill)
    watchdog.start()
    assert process.stdout is not None
    assert process.stdout.readline() == "band\n"
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    watchdog.cancel()
    assert process.returncode == 130
    assert err.splitlines()[-1].startswith("volspec: interrupted; ")
    assert "Traceback" not in err
    assert out.read_bytes() == b"mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["i.exr", "s.toml"]


def test_info_lists_labels_with_their_names(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "v.npy", np.kron([[[0, 0], [1, 2]]] * 2, np.ones((4, 4, 4), np.uint8)))
    assert figures(capsys, "info", tmp_path / "v.npy")["labels"] == {"1": "", "2": ""}
    (tmp_path / "v.txt").write_text("1 liver\n2 spleen\n")
    assert figures(capsys, "info", tmp_path / "v.npy")["labels"] == {"1": "liver", "2": "spleen"}
    assert call("info", tmp_path / "v.npy") == 0
    assert "2: 1 liver, 2 spleen" in capsys.readouterr().out
    np.save(tmp_path / "v.npy", np.arange(27, dtype=np.float32).reshape(3, 3, 3))
    assert figures(capsys, "info", tmp_path / "v.npy")["labels"] == {}


MATERIAL_BASIS = '[basis]\nmethod = "materials"\n'


def test_layers_are_cast_and_fade_when_relit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """You should see the ball, then a thinner one, then nothing of it."""
    scene = write_scene_text(tmp_path, BALL + MATERIAL_BASIS + GROUPS + DAY + SMALL, 16)
    out = tmp_path / "i.exr"
    assert call("render", scene, "-o", out, "--layers", "4") == 0
    assert "4 layers of opacity" in capsys.readouterr().out
    image = CoefficientImage.load(out)
    assert image.opacity_layers is not None and image.opacity_layers.count == 4
    words = ("relight", out, "--light", "D65", "-o")
    assert call(*words, tmp_path / "1.png", "--opacity", "ball=1") == 0
    assert call(*words, tmp_path / "plain.png") == 0
    assert call(*words, tmp_path / "thin.png", "--opacity", "ball=0.3") == 0
    assert call(*words, tmp_path / "none.png", "--opacity", "ball=0") == 0
    same, plain, thin, none = (
        read_codes(tmp_path / f"{name}.png").astype(int) for name in ("1", "plain", "thin", "none")
    )
    assert (same == plain).all() and np.ptp(none, axis=(0, 1)).max() == 0
    options = ("--focus", 40, "--aperture", 8, "--fog", 90, "--near", 1, "--far", 90)
    assert call(*words, tmp_path / "deep.png", *map(str, options), "--opacity", "ball=0.9") == 0
    assert (read_codes(tmp_path / "deep.png") != plain).any()
    layers = image.opacity_layers
    capsys.readouterr()
    assert call(*words, tmp_path / "cut.png", "--near", "999") == 0
    assert "{:.4g} to {:.4g} mm".format(*layers.range_mm) in capsys.readouterr().err
    for layout in ("side-by-side", "anaglyph"):
        stereo = ("--stereo", layout, "--eyes-deg", "4")
        assert call(*words, tmp_path / f"{layout}.png", *stereo) == 0
        assert read_frame_text(tmp_path / f"{layout}.png")["stereo"] == layout
    pair = read_codes(tmp_path / "side-by-side.png").astype(int)
    left, right = np.hsplit(pair, 2)
    assert left.shape == plain.shape and 0 < np.abs(left - right).mean() < 20
    anaglyph = read_codes(tmp_path / "anaglyph.png")
    assert anaglyph.shape == plain.shape
    assert call(*words, tmp_path / "gone.png", "--opacity", "ball=0", *stereo) == 0
    assert np.ptp(read_codes(tmp_path / "gone.png"), axis=(0, 1)).max() == 0
    backdrop = none[0, 0]
    assert 2 < np.abs(thin - backdrop).sum() < np.abs(plain - backdrop).sum()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("render", "{scene}", "-o", "{out}", "--layers", "17"), "--layers is 17"),
        (("render", "{scene}", "-o", "{out}", "--layers", "4"), 'method = "materials"'),
        (("render", "{scene}", "-o", "p.png", "--layers", "4"), "name it .exr"),
        (("relight", "{out}", "--light", "A", "-o", "f.png", "--opacity", "ball"), "block=0.3"),
        (("relight", "{out}", "--light", "A", "-o", "f.png", "--opacity", "ball=0"), "layers = 8"),
        (
            ("relight", "{out}", "--light", "A", "-o", "f.png", "--opacity", "ball=0,air=1"),
            "one material each, --opacity ball=0 --opacity air=1",
        ),
        (("relight", "{out}", "--light", "A", "-o", "f.png", "--focus", "0"), "--focus is 0"),
        (("relight", "{out}", "--light", "A", "-o", "f.png", "--near", "1"), "layers = 8"),
        (("relight", "{out}", "--light", "A", "-o", "f.png", "--stereo", "crossed"), "layers = 8"),
        (
            ("relight", "{out}", "--light", "A", "-o", "f.png", "--eyes-mm", "3"),
            "--eyes-mm without --stereo",
        ),
        (
            ("relight", "{out}", "--light", "A", "-o", "f.png", "--stereo", "crossed", "--errors"),
            "--errors with --stereo",
        ),
    ],
)
def test_what_has_no_layers_is_refused_in_one_line(
    scene: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], said: str
) -> None:
    out = scene.with_name("i.exr")
    assert call("render", scene, "-o", out) == 0
    capsys.readouterr()
    assert call(*(word.format(scene=scene, out=out) for word in words)) == 1
    error = capsys.readouterr().err
    assert said in " ".join(error.split())
