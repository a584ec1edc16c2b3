"""The window under Xvfb: casts, faults, dropped files, sessions, commands."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.support.images import read_codes
from tests.support.window import Robot, small_engine
from tests.viewer._states import save_ball
from volspec._gpu.device_list import POCL, devices
from volspec.export.exporter import export
from volspec.scene import Scene
from volspec.volume import phantom

pytestmark = [pytest.mark.usefixtures("screen"), pytest.mark.not_quick]


def test_a_session_casts_for_views_only_and_refines_at_rest(window, tmp_path):
    first = window.open(small_engine(tmp_path))

    # A light, and the dial: relit at every step, nothing is cast.
    places = [window.at("weight 1", share) for share in (0.05, 0.4, 0.7, 0.95)]
    moved = window.steps(places, "relight")
    x, y = window.middle("dial")
    before = window.steps([(x, y), (x + 9, y + 9)], "relight")
    assert window.since(first, "cast") == []
    assert all(window.since(t, "relight")[-1]["whole"] for t in (first, moved))

    # An orbit: a coarse picture at once, the whole one when it rests.
    x, y = window.middle("picture")
    window.steps([(x - 80, y), (x + 80, y + 30)], "cast")
    casts = [row["divisor"] for row in window.since(before, "cast")]
    assert casts[0] > 1 and casts[-1] == 1

    # Keys: a view, undo, and a picture of the size that was asked for.
    for key in ("9", "ctrl+z"):
        before = window.rest()
        window.keys(key)
        assert any(row["whole"] for row in window.since(before, "relight"))
    window.key("s")
    picture = window.saved("screenshot", before)
    assert picture.shape == (120, 160, 3)
    assert picture.max() > 100 and picture.std() > 5

    # A file that is not there is said, and what was open stays.
    before = window.keys("ctrl+o")
    window.enter("nosuch.nrrd")
    assert "nosuch" in window.event("error", before)["message"]
    assert window.pixels().std() > 5


@pytest.mark.slow
def test_the_least_volume_on_a_dense_screen_in_a_window_of_next_to_nothing(tmp_path):
    least = tmp_path / "least.npy"
    np.save(least, np.arange(8, dtype=np.uint8).reshape(2, 2, 2))
    with Robot(tmp_path, ["least.npy"], (1200, 800), dpi=192, ahead=False) as robot:
        robot.whole()
        # 21 at 96 dpi: type of 15 and its padding.
        assert robot.area("weight 1")[3] == pytest.approx(42, abs=3)
        for size in ((1, 1), (40, 30), (1100, 700)):
            before = robot.now()
            robot.resize(size)
            robot.drop(least.as_uri())  # answered, so that the window has seen its size
        robot.whole(before)
        assert robot.since(-1.0, "gl-error") == [] and robot.viewer.poll() is None


@pytest.mark.slow
def test_without_a_device_the_remedy_is_shown(tmp_path, monkeypatch):
    if not all(device.platform == POCL for device in devices()):
        pytest.skip("a device here is none of PoCL, and would work")
    # PoCL rejects this flag as it does a CPU that it does not know: when it builds.
    monkeypatch.setenv("POCL_EXTRA_BUILD_FLAGS", "-no-such-flag")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    monkeypatch.delenv("VOLSPEC_DEVICE", raising=False)
    save_ball(tmp_path)
    with Robot(tmp_path, ["ball.npy"], (900, 600)) as robot:
        robot.wait_for(lambda row: row["event"] == "error" and row.get("stage") == "cast")
        whole = robot.pixels()
        text = whole[:, : 2 * whole.shape[1] // 3].mean(axis=2) > 90  # left of cube and scale
        above, middle, below = (part.sum() for part in np.array_split(text, 3))
        assert 300 < middle < 0.1 * text.size
        assert above == below == 0  # where a notice would say the same
        robot.keys("h")  # the window goes on
        assert robot.viewer.poll() is None


SCENE = """
title = "%s"
version = 2
volume.file = "ball.npy"
basis.method = "materials"
material = [{ name = "grey", reflectance = "grey:0.5" }]
light = [{ name = "day", spectrum = "D65" }, { name = "sodium", spectrum = "HP1" }]
transfer.points = [
    { value = 0.2, opacity = 0.0, material = "grey" },
    { value = 0.9, opacity = 0.4, material = "grey" },
]
"""


def titles(robot: Robot, after: float = -1.0) -> list[str]:
    """Titles of what has been opened."""
    return [row["title"] for row in robot.since(after, "open")]


def fed(pipe: Path, text: str) -> bool:
    """Return True if a text was passed to the reader of a named pipe."""
    try:
        end = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
    except OSError:
        return False
    with open(end, "w", encoding="utf-8") as file:
        return bool(file.write(text))


def complaint(robot: Robot, *uris: str) -> str:
    """Message of a drop that changes nothing."""
    before = robot.now()
    robot.drop(*uris)
    robot.rest()
    assert robot.since(before, "open", "cast") == []
    (row,) = robot.since(before, "error")
    return str(row["message"])


@pytest.mark.slow
def test_what_is_dropped_is_opened_or_not_and_what_was_open_stays(tmp_path):
    # On Linux a name may be bytes that are no text.
    plain, odd, _ = (
        save_ball(tmp_path, name=name)
        for name in ("ball.npy", "Kugel é 骨 100%.npy", os.fsdecode(b"caf\xe9.npy"))
    )
    notes, scene, first = (tmp_path / name for name in ("notes.txt", "scene.toml", "first.toml"))
    notes.write_text("no volume", encoding="utf-8")
    scene.write_text(SCENE % "Dropped", encoding="utf-8")
    # Reading it takes until it is fed below.
    os.mkfifo(first)
    holed = np.random.default_rng(1).random((24, 24, 24), np.float32)
    holed[3, 4, 5] = np.nan
    np.save(tmp_path / "holed.npy", holed)

    options = first.name, "--screenshot", "2000x1500"
    with Robot(tmp_path, options, (480, 360), ahead=False) as robot:
        # What is dropped before anything is open comes after what was asked for first.
        robot.event("layout")
        robot.drop(plain.as_uri())
        robot.until(lambda: fed(first, SCENE % "First"))
        robot.wait_for(lambda row: row.get("title") == plain.name)
        robot.rest()
        assert titles(robot) == ["First", plain.name]

        # Of two drops in a row the last is open in the end; percent-encoded names are read.
        for uris, title in (([odd.as_uri()], odd.name), ([], "Dropped")):
            before = robot.now()
            for uri in (f"file://localhost{scene}", *uris):
                robot.drop(uri)
            robot.rest()
            assert titles(robot, before)[-1] == title

        # Of several the use is asked for; nothing changes without an answer.
        before = robot.now()
        robot.drop(plain.as_uri(), odd.as_uri())
        robot.rest()
        robot.keys("Escape")
        robot.rest()
        assert titles(robot, before) == []
        assert str(notes) in complaint(robot, notes.as_uri())
        plain.unlink()
        assert str(plain) in complaint(robot, plain.as_uri())
        for ending in (".npy", ".volspec.json"):
            assert "UTF-8" in complaint(robot, f"{tmp_path.as_uri()}/caf%E9{ending}")
        # A key that comes with such a name is not lost.
        before = robot.now()
        robot.drop(f"{tmp_path.as_uri()}/caf%E9.npy", key="F12")
        robot.wait_for(lambda row: row.get("key") == "f12", before)
        # A folder with such a name is listed without it.
        robot.keys("ctrl+o", "Escape")

        # A picture that is being saved is given up when the window closes: with an interpreter
        # gone, its thread, which is in native code, ended the process by SIGABRT.
        robot.open(tmp_path / "holed.npy")
        robot.keys()
        robot.key("s")
        robot.key("ctrl+q")
        assert robot.ends() == 0
        said = robot.viewer.stderr.read()
    assert "NaN" in said and ("cancelled" in said or list(tmp_path.rglob("*.png")))


_PASTE = """
import copykitten, sys
data, width, height = copykitten.paste_image()
sys.stdout.write(f"{width} {height} {min(data[3::4])} {max(data[0::4])}")
"""


@pytest.mark.slow
def test_work_is_exported_found_by_name_kept_and_restored(tmp_path):
    save_ball(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE % "Work", encoding="utf-8")

    def started(what: str) -> Robot:
        return Robot(tmp_path, [what, "--screenshot", "160x120"], (640, 480), ahead=False)

    with started("scene.toml") as robot:
        robot.whole()
        # A command by a few letters, and a light in the list by name.
        for words in ("sod alo", "view right"):
            robot.command(words)

        # As a scene, by a path that Tab completes.
        (tmp_path / "folder").mkdir()
        robot.keys("ctrl+s")
        robot.enter("fol", "Tab")
        robot.enter("mine")
        scene = Scene.load(tmp_path / robot.event("export-scene")["path"])
        assert scene.path.parent.name == "folder" and scene.path.stem == "mine"
        assert scene.lights[0].name == "sodium" and scene.file.camera.azimuth_deg == 90.0

        # A picture, also for other programs.
        robot.key("s")
        first = robot.saved("screenshot", -1.0)
        robot.key("ctrl+c")
        robot.event("copied")
        pasted = subprocess.check_output(
            [sys.executable, "-c", _PASTE], env=robot.environment, text=True
        )
        width, height, opaque, brightest = map(int, pasted.split())
        assert (width, height) == robot.area("picture")[2:]
        assert opaque == 255 and brightest > 50

        # Plain keys belong to a panel while the keyboard is in it: Space does not change lights.
        before = robot.keys("F6")
        robot.keys("space")
        assert robot.since(before, "relight") == []
        robot.key("Escape")
        for key in ("space", "ctrl+z"):
            before = robot.rest()
            robot.keys(key)
            assert robot.since(before, "relight")
        robot.key("ctrl+q")
        assert robot.ends() == 0

    with started("--restore") as robot:
        robot.whole()
        robot.rest()
        robot.key("s")
        np.testing.assert_array_equal(robot.saved("screenshot", -1.0), first)
        assert len(list(tmp_path.glob("*.png"))) == 2
        # Read again, the scene is as its file has it, seen from where one was; what was restored
        # is not lost by that.
        for key in ("F5", "ctrl+shift+r"):
            before = robot.rest()
            robot.key(key)
            robot.event("open", before)
        assert robot.viewer.poll() is None


@pytest.mark.slow
def test_a_volume_s_saved_scene_exports_the_picture_shown(window, tmp_path):
    import SimpleITK as sitk

    values = (200 * phantom.ball(32).values).astype(np.uint8)
    sitk.WriteImage(sitk.GetImageFromArray(values), str(tmp_path / "ball.nii.gz"))
    window.open(tmp_path / "ball.nii.gz")
    window.command("preset skin")
    before = window.rest()
    window.steps([window.middle("picture"), (200, 180)], "cast")
    # The name and the folder that are offered.
    window.keys("ctrl+s", "Return")
    saved = Path(window.event("export-scene", before)["path"])
    assert saved == tmp_path / "ball.toml"
    window.key("s")
    seen = window.saved("screenshot", before)
    text = saved.read_text(encoding="utf-8")
    assert 'file = "ball.nii.gz"' in text and 'reflectance = "Vrhel/' in text
    assert max(map(len, re.findall(r"[\d.]+", text))) <= 9
    scene = Scene.load(saved)
    assert (scene.file.output.width, scene.file.output.height) == window.area("picture")[2:]
    made = export(
        scene.exporting(annotate=["scale"]),  # as a picture has what the screen shows
        tmp_path / "frames",
        lights=[scene.lights[0].name],
        sheet=False,
        size=(160, 120),
    )
    frame = read_codes(made.output / made.files[0]).astype(int)
    assert seen.std() > 5 and np.abs(frame - seen).max() <= 1


@pytest.mark.slow
def test_a_first_start_offers_demonstrations_and_a_crash_is_told_of(tmp_path):
    own = save_ball(tmp_path)
    with Robot(tmp_path, [], (720, 520), ahead=False) as robot:
        robot.whole()
        # At once, before the scene behind it is read.
        first = robot.wait_for(lambda row: "open your own" in row.get("areas", ()))
        assert first["t"] < robot.event("open")["t"]
        robot.rest()
        names = {f"demonstration {name}" for name in ("head", "engine", "frog")}
        assert names <= robot.areas().keys()
        before = robot.rest()
        robot.click("demonstration head")
        robot.event("open", before)
        before = robot.rest()
        assert "demonstration frog" not in robot.areas()
        # Again from the command list; Esc leaves the scene as it is.
        robot.command("demonstrations")
        assert "demonstration frog" in robot.areas()
        robot.keys("Escape")
        assert "demonstration frog" not in robot.areas() and titles(robot, before) == []
        # One's own file, without a way back through the screen.
        robot.command("demonstrations")
        before = robot.rest()
        robot.click("open your own")
        robot.keys("ctrl+a")
        robot.enter(str(own))
        robot.event("open", before)
        # The session that is saved by itself, which a crash leaves.
        robot.keys("space")
        kept = tmp_path / "state" / "sessions"
        robot.until(lambda: any(kept.glob("[!.]*.json")))
        robot.viewer.kill()
        robot.viewer.wait()
    # Now there is something of one's own; demonstrations are none of the recent files.
    with Robot(tmp_path, [], (720, 520), ahead=False) as robot:
        robot.event("ended-early")
        robot.whole()
        robot.rest()
        assert "open your own" not in robot.areas()
