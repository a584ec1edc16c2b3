"""The command line: exit codes, one line on stderr, files whole or not at all."""

import io
import json
import os
import re
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from importlib import import_module
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from tests.support.commands import call, figures, refusal, write_files
from tests.support.errors import raises
from tests.support.scenes import BALL, DAY, write_scene_text
from volspec import doctor
from volspec._gpu import device_list as devices
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source, asset
from volspec.cli import main
from volspec.errors import DeviceError, InputError, OpenCLError, OpenGLError
from volspec.relight import gpu as gl_engine
from volspec.scene import Scene

ROOT = Path(__file__).resolve().parents[2]


def run(*words: str, program: str = "", **settings: object) -> subprocess.CompletedProcess[str]:
    """The installed command in a process of its own, as a user calls it, after a program."""
    command = [sys.executable, "-c", f"{program}\nfrom volspec.cli import main; main()", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, **settings)


@pytest.mark.slow
def test_without_a_writable_home_commands_work_with_one_warning(tmp_path):
    """Neither PoCL's, pyopencl's and Matplotlib's caches nor our own stop a cast."""
    own = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "POCL_CACHE_DIR", "MPLCONFIGDIR")
    blocked = tmp_path / "file"
    blocked.touch()
    env = {k: v for k, v in os.environ.items() if k not in own} | {"HOME": f"{blocked}/home"}
    # One channel, as a kernel without a cache is compiled for each.
    scene = write_scene_text(tmp_path, BALL + DAY + '[basis]\nmethod = "materials"\n')
    words = ("render", str(scene), "-o", "i.exr", "--size", "8x6")
    done = run(*words, cwd=tmp_path, env=env)
    lines = [line for line in done.stderr.splitlines() if "%" not in line]
    assert len(lines) == 1 and "XDG_CACHE_HOME" in lines[0], done.stderr
    assert done.returncode == 0 and (tmp_path / "i.exr").is_file()


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory, needs_opencl: None) -> Path:
    folder = tmp_path_factory.mktemp("demo") / "out"
    with redirect_stdout(io.StringIO()) as printed:
        assert call("demo", "--out", folder, "--json") == 0
    assert json.loads(printed.getvalue())["channels"] == 7
    return folder


def test_demo_writes_everything_it_promises(demo):
    frames = {path.name: iio.imread(path) for path in (demo / "frames").iterdir()}
    assert set(frames) == {"D65.png", "A.png", "FL2.png", "HP1.png", "D65+A.png"}
    for name, frame in frames.items():
        assert frame.shape == (512, 512, 3)
        assert 20 < frame.mean() < 200 and frame.std() > 15, f"{name} is dark, bright or empty"
    assert iio.imread(demo / "sheet.png").shape[1] > 2000
    report = json.loads((demo / "report.json").read_text())
    assert len(report["lights"]) == 5 and report["cast_ms"] and report["lights"][0]["relight_ms"]
    assert max(light["delta_e_max"] for light in report["lights"]) < 0.1
    assert sorted(path.name for path in demo.iterdir()) == [
        *("engine-block.csv", "engine-inserts.csv", "engine.exr", "engine.html", "engine.nrrd"),
        *("engine.toml", "errors.png", "frames", "report.json", "sheet.png"),
    ]


def test_a_demo_that_fails_leaves_no_empty_folder(tmp_path, monkeypatch):
    def full(_: object, out: Path, *__: object, **___: object) -> None:
        out.mkdir()
        raise InputError("no space left; free some", code="unwritable")

    monkeypatch.setattr(import_module("volspec.export"), "run_demo", full)
    assert call("demo", "--out", tmp_path / "out") == 1
    assert not list(tmp_path.iterdir())


def test_the_demo_s_scene_can_be_moved(demo, tmp_path):
    moved = shutil.copytree(demo, tmp_path / "elsewhere")
    there, here = Scene.load(moved / "engine.toml"), Scene.load(asset("data/scenes/engine.toml"))
    assert there.path.parent == moved
    assert not any(".." in row.reflectance for row in there.file.material)
    assert np.array_equal(there.volume().values, here.volume().values)
    for name, spectrum in here.materials.items():
        assert np.array_equal(there.materials[name].values, spectrum.values)


def test_the_demo_names_commands_that_parse():
    from volspec.cli.render import NEXT
    from volspec.cli.shell import app

    for words, _ in NEXT:
        app.parse_args(words.format(out="volspec-demo"), exit_on_error=False, print_error=False)


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("has_gl", [True, False])
def test_relight_of_a_stored_image_gives_the_demo_s_frame(
    has_gl, demo, tmp_path, monkeypatch, capsys
):
    """The scene's viewing and backdrop travel in the file; without GL there is one warning."""

    def lacking() -> None:
        raise OpenGLError("OpenGL: no headless context (test)")

    if not has_gl:
        monkeypatch.setattr(gl_engine, "lend_context", lacking)
    words = ("relight", demo / "engine.exr", "--light", "A", "-o", tmp_path / "a.png")
    assert call(*words) == 0
    assert capsys.readouterr().err.count("warning") == (not has_gl)
    stored, fresh = iio.imread(tmp_path / "a.png"), iio.imread(demo / "frames" / "A.png")
    assert np.abs(stored.astype(int) - fresh).max() <= 1


def test_doctor_lists_devices(capsys):
    report = figures(capsys, "doctor")
    assert report["healthy"] and report["opencl"][0]["name"]


@pytest.mark.slow
def test_doctor_names_what_brings_films_and_notebooks(monkeypatch, capsys):
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr(doctor, "version", lambda name: missing(name) if "any" in name else "1.2")
    found = doctor.examine()
    assert found.healthy and found.problems == ()
    extras = found.extras
    assert "volspec[video]" in extras["films"] and "volspec[notebook]" in extras["notebooks"]
    wanted = {"OME-Zarr": 2, "HDF5": 1, "microscopes": 4, "pages from a server": 1, "the window": 5}
    assert {name: extras[name].count(" 1.2") for name in wanted} == wanted
    monkeypatch.undo()
    pytest.importorskip("imageio_ffmpeg")
    assert call("doctor") == 0
    # The binary's own version, from running it.
    assert re.search(r"films +│ ffmpeg \S*\d", capsys.readouterr().out)


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "utf-8"])
@pytest.mark.parametrize(
    ("words", "exotic"),
    [
        (("info", str(ROOT / "data" / "engine.nrrd")), "█"),
        (("reflectance", "#b05020"), "Δ"),
        (("relight", "--help"), "─"),
    ],
)
def test_what_an_encoding_lacks_is_a_question_mark(words, exotic, encoding, monkeypatch):
    printed = io.BytesIO()
    with io.TextIOWrapper(printed, encoding, "strict") as stdout:
        monkeypatch.setattr(sys, "stdout", stdout)
        assert call(*words) == 0
        stdout.flush()
        said = printed.getvalue().decode(encoding)
        monkeypatch.undo()
    assert (exotic in said) == (encoding == "utf-8")


def test_bad_input_shows_a_traceback_if_asked():
    """Transcripts show the one line without it."""
    done = run("info", "none.nrrd", "--debug")
    assert done.returncode == 1 and "Traceback" in done.stderr


def test_without_opencl_the_remedy_is_named(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(devices, "all_devices", list)
    error = refusal("demo", "--out", tmp_path / "out")
    assert isinstance(error, DeviceError) and error.code == "missing"
    assert "volspec[intel]" in error.remedy
    assert not (tmp_path / "out").exists()
    assert call("doctor") == 1
    assert "volspec[intel]" in capsys.readouterr().out


def test_a_kernel_that_does_not_build_names_device_options_and_line():
    text = '#line 7 "kernels/broken.cl"\n__kernel void f(__global int *x) { x[0] = y; }\n'
    with raises(OpenCLError) as caught:
        Compute.open().kernel(Source(text, ("<prelude>", "kernels/broken.cl")), "f", ["-w"])
    for named in (Compute.open().info.name, "-w", "broken.cl:7"):
        assert named in str(caught.value)


THREAD_AT_THE_END = """
import atexit, sys, threading, time
threading.Thread(target=time.sleep, args=(60,), daemon=True).start()
atexit.register(print, "handlers")
class Late:
    def __del__(self): print("finalized")
late = Late()
"""


def test_the_exit_code_stays_with_a_thread_in_an_extension():
    """Python's own end would stop it there, and abort when the extension is in C++."""
    done = run("light", "--list", "D65", program=THREAD_AT_THE_END)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-1] == "handlers" and "finalized" not in done.stdout


@pytest.mark.parametrize("words", ["light --list", "light --help", "light D65", "light D65 --json"])
def test_a_pipe_that_nobody_reads_ends_the_command_quietly(words, monkeypatch, capsys):
    ours, theirs = os.pipe()
    os.close(ours)
    with io.TextIOWrapper(os.fdopen(theirs, "wb")) as stdout:
        monkeypatch.setattr("sys.stdout", stdout)
        assert call(*words.split()) == 141
        monkeypatch.undo()
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "words",
    [
        ("light", "x" * 100_000),
        ("reflectance", "9" * 5000),
        ("info", "(" * 3000),
        ("compositing", "\0", "-o", "x.nk"),
        ("render", "\udcff.toml", "-o", "x.exr"),
        ("+" * 5000,),
    ],
    ids=lambda words: words[0][:12],
)
def test_a_value_of_any_length_is_refused_in_one_short_line(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(list(words))
    [line] = capsys.readouterr().err.splitlines()
    assert ended.value.code in (1, 2) and len(line) < 1100 and line.startswith("volspec: ")


def test_a_room_s_json_has_the_eye_s_conditions(tmp_path, monkeypatch, capsys):
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    rows = figures(capsys, "room", "room.toml", "--patches", "12")
    for row in rows:
        assert row["C"] == pytest.approx(np.hypot(row["a_C"], row["b_C"]))
        assert row["L_Aw"] == pytest.approx(row["L_A"] / row["surround"]) or row["surround"] == 1
        assert row["Y_b"] > 0 and row["white_XYZ"][1] == pytest.approx(100) and 0 <= row["H"] < 400


def test_a_ranking_prints_figures_and_paints_the_picture(tmp_path, monkeypatch, capsys):
    write_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    words = ["--paint-set", "sRGB/blue*0.9", "--paint-set", "grey:0.6", "--mix", "0.5"]
    words += ["--patches", "12", "--top", "2", "--size", "16x12", "--wanted"]
    blue, grey = (
        figures(capsys, "room", "room.toml", *words, colour, "--picture", f"{name}.png")
        for name, colour in (("blue", "blue"), ("grey", "grey:0.6"))
    )
    assert blue["candidates"] == 3 and blue["solved"] in (2, 3)
    assert blue["surfaces"] == ["left", "right", "front", "back"]
    mix = "50 % sRGB/blue*0.9 + 50 % grey:0.6"
    assert {row["paint"] for row in blue["paints"]} == {"sRGB/blue*0.9", mix}
    assert blue["paints"][0]["distance"] < blue["paints"][1]["distance"]
    assert grey["paints"][0]["paint"] == "grey:0.6"
    lamps = ["--lamp", "D65", "--lamp", "A", "--white", "ceiling", "--figure", "f.png"]
    over = figures(capsys, "room", "room.toml", *words, "blue", *lamps)
    assert list(over["lamps"]) == ["D65", "A"] and over["lamps"]["A"]["candidates"] == 3
    for row in over["worst"]:
        assert row["worst"] == max(row["D65"], row["A"])
        assert row["mean"] == pytest.approx((row["D65"] + row["A"]) / 2)
    assert iio.imread("f.png").shape == (864, 1600, 4)
    surplus = [
        np.subtract(frame[..., 2], frame[..., 0], dtype=float).mean()
        for frame in (iio.imread(f"{name}.png") for name in ("blue", "grey"))
    ]
    assert surplus[0] > surplus[1] + 20
