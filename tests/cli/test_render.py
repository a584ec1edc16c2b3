"""``volspec render``: sizes, halves, interruptions; ``volspec info`` of labels."""

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.export.test_export_depth import DEEP
from tests.support.commands import call, figures
from tests.support.images import read_codes
from tests.support.patience import PATIENCE_S
from tests.support.scenes import BALL, DAY, SMALL, write_scene_text
from volspec.errors import OpenCLError
from volspec.export.frames import read_frame_text
from volspec.image import CoefficientImage
from volspec.large import Raycaster

MATERIAL_BASIS = '[basis]\nmethod = "materials"\n'
GROUPS = """[[group]]
name = "key"
sources = [{ kind = "directional", towards = [0, -1, 1], shadows = true }]
[[group]]
name = "sky"
sources = [{ kind = "ambient" }]
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A ball in one channel: a kernel of few is soon built."""
    return write_scene_text(tmp_path, BALL + MATERIAL_BASIS + GROUPS + DAY + SMALL, 16)


def test_render_says_what_it_wrote(scene, capsys):
    out = scene.with_name("i.exr")
    assert call("render", scene, "-o", out) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{out}: 24×16") and "100%" in printed.err
    image = CoefficientImage.load(out)
    assert image.coefficients.dtype == np.float32 and list(image.groups) == ["key", "sky"]


def test_a_picture_is_the_first_frame_of_an_export(scene):
    assert call("render", scene, "-o", scene.with_name("p.png")) == 0
    assert call("export", scene, "-o", scene.with_name("frames"), "--light", "day") == 0
    frame = scene.with_name("frames") / "day.png"
    assert (read_codes(scene.with_name("p.png")) == read_codes(frame)).all()


def test_size_and_half_are_taken_in_place_of_the_scene_s(scene):
    out = scene.with_name("i.exr")
    assert call("render", scene, "-o", out, "--size", "40x30", "--half") == 0
    image = CoefficientImage.load(out)
    assert image.size == (40, 30) and image.coefficients.dtype == np.float16


def test_a_device_that_fails_is_told_in_one_line(scene, monkeypatch, capsys):
    def fail(*_: object, **__: object) -> None:
        raise OpenCLError("pocl: out of\nmemory; cast it smaller")

    monkeypatch.setattr(Raycaster, "cast", fail)
    assert call("render", scene, "-o", scene.with_name("i.exr")) == 1
    assert capsys.readouterr().err.count("volspec: pocl: ") == 1


# The command, interrupted once a band of its picture is there: it says so on stdout, and waits.
# A suite that a shell runs in the background ignores the interrupt, and so would its children.
INTERRUPTED = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    "from volspec.raycast.launch.row_batches import RowBatches; fetch = RowBatches._fetch\n"
    "def fetch_and_wait(*a): fetch(*a); print('band', flush=True); signal.pause()\n"
    "RowBatches._fetch = fetch_and_wait; from volspec.cli import main; main()"
)


def interrupted(folder: Path, *words: str) -> tuple[int, str]:
    """Interrupt a command amid its cast; return its exit code and what it said on stderr."""
    command, pipe = [sys.executable, "-c", INTERRUPTED, *words], subprocess.PIPE
    with subprocess.Popen(command, cwd=folder, text=True, stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "band\n", process.stderr.read()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=PATIENCE_S)
    return process.returncode, err


def test_an_interrupted_cast_leaves_the_image_that_was_there(scene):
    out = scene.with_name("i.exr")
    out.write_bytes(b"mine")
    before = sorted(scene.parent.iterdir())
    code, err = interrupted(scene.parent, "render", scene.name, "-o", out.name, "--half")
    assert code == 130
    assert err.splitlines()[-1].startswith("volspec: interrupted; ")
    assert "Traceback" not in err
    assert out.read_bytes() == b"mine" and sorted(scene.parent.iterdir()) == before


def test_info_lists_labels_with_their_names(tmp_path, capsys):
    np.save(tmp_path / "v.npy", np.kron([[[0, 0], [1, 2]]] * 2, np.ones((4, 4, 4), np.uint8)))
    assert figures(capsys, "info", tmp_path / "v.npy")["labels"] == {"1": "", "2": ""}
    (tmp_path / "v.txt").write_text("1 liver\n2 spleen\n")
    assert figures(capsys, "info", tmp_path / "v.npy")["labels"] == {"1": "liver", "2": "spleen"}
    assert call("info", tmp_path / "v.npy") == 0
    assert "2: 1 liver, 2 spleen" in capsys.readouterr().out
    np.save(tmp_path / "v.npy", np.arange(27, dtype=np.float32).reshape(3, 3, 3))
    assert figures(capsys, "info", tmp_path / "v.npy")["labels"] == {}


def faded(scale: float) -> tuple[str, ...]:
    """Options by which both materials fade."""
    return "--opacity", f"gold={scale}", "--opacity", f"grey={scale}"


def test_layers_are_cast_and_fade_when_relit(tmp_path, capsys):
    """You should see the ball, then a thinner one, then nothing of it."""
    scene, out = write_scene_text(tmp_path, DEEP, 16), tmp_path / "i.exr"
    assert call("render", scene, "-o", out, "--layers", "4") == 0
    assert "4 layers of opacity" in capsys.readouterr().out
    layers = CoefficientImage.load(out).opacity_layers
    assert layers is not None and layers.count == 4
    frame = tmp_path / "f.png"

    def relit(*options: object) -> np.ndarray:
        assert call("relight", out, "--light", "D65", "-o", frame, *options) == 0
        return read_codes(frame).astype(int)

    plain, thin, none = relit(), relit(*faded(0.3)), relit(*faded(0))
    assert (relit("--opacity", "gold=1") == plain).all()
    assert np.ptp(none, axis=(0, 1)).max() == 0
    shown = [np.abs(each - none[0, 0]).sum() for each in (thin, plain)]
    assert 2 < shown[0] < shown[1]
    options = ("--focus", 40, "--aperture", 8, "--fog", 90, "--near", 1, "--far", 90)
    assert (relit(*options, "--opacity", "gold=0.9") != plain).any()
    capsys.readouterr()
    relit("--near", "999")
    assert "{:.4g} to {:.4g} mm".format(*layers.range_mm) in capsys.readouterr().err
    for layout, width in (("side-by-side", 2), ("anaglyph", 1)):
        stereo = ("--stereo", layout, "--eyes-deg", "4")
        eyes = np.hsplit(relit(*stereo), width)
        assert read_frame_text(frame)["stereo"] == layout
        assert all(each.shape == plain.shape for each in eyes)
        if layout == "side-by-side":
            assert 0 < np.abs(eyes[0] - eyes[1]).mean() < 20
    assert np.ptp(relit(*faded(0), *stereo), axis=(0, 1)).max() == 0
