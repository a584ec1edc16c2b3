"""The window under Xvfb: casts, faults, dropped files, sessions, commands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.support.window import ENGINE, Robot, Row, along, small_engine
from volspec._gpu.devices import POCL, devices
from volspec.scene import Scene
from volspec.volume import phantom

pytestmark = pytest.mark.usefixtures("screen")


def test_a_session_casts_for_views_only_and_refines_when_it_rests(tmp_path: Path) -> None:
    from PIL import Image

    scene = small_engine(tmp_path)
    with Robot(tmp_path, [*scene, "--screenshot", "160x120"], (900, 600)) as robot:
        robot.whole()
        first = robot.rest()

        # A light: relit at every step, nothing is cast.
        x, y, width, height = robot.area("weight 1")
        start, end = (x + 4, y + height / 2), (x + width - 4, y + height / 2)
        robot.drag(along(start, end, 1.0))
        moved = robot.rest()
        light = robot.since(first)
        assert [row for row in light if row["stage"] == "cast"] == []
        relit = [row for row in light if row["stage"] == "relight"]
        assert len(relit) > 5 and relit[-1]["whole"]

        # The dial: as well.
        x, y = robot.middle("dial")
        robot.drag([(x, y), (x + 5, y + 5), (x + 9, y + 9)])
        before = robot.rest()
        dial = robot.since(moved)
        assert [row for row in dial if row["stage"] == "cast"] == []
        assert any(row["stage"] == "relight" for row in dial)

        # An orbit: coarse pictures while it lasts, the whole one after.
        x, y = robot.middle("picture")
        robot.drag(along((x - 80, y), (x + 80, y + 30), 1.0))
        released = robot.wait_for(lambda row: row["event"] == "release", before)
        whole = robot.whole(released["t"])
        robot.rest()
        casts = [row for row in robot.since(before) if row["event"] == "cast"]
        during = [row for row in casts if row["t"] < released["t"]]
        assert during and all(row["divisor"] > 1 for row in during)
        assert casts[-1]["divisor"] == 1 and whole["t"] > released["t"]

        # Keys: a view, undo, and a picture of the size that was asked for.
        for key in ("9", "ctrl+z"):
            before = robot.rest()
            robot.key(key)
            robot.rest()
            assert any(row["event"] == "relight" and row["whole"] for row in robot.since(before))
        robot.key("s")
        saved = robot.wait_for(lambda row: row["event"] == "screenshot")
        picture = np.asarray(Image.open(tmp_path / saved["path"]))
        assert picture.shape == (120, 160, 3)
        assert picture.max() > 100 and picture.std() > 5

        # A file that is not there is said, and what was open stays.
        robot.key("ctrl+o")
        robot.rest()
        robot.type("nosuch.nrrd")
        robot.key("Return")
        error = robot.wait_for(lambda row: row["event"] == "error")
        assert "nosuch" in error["message"]
        screen = tmp_path / "screen.png"
        robot.grab(screen)
        assert np.asarray(Image.open(screen))[:, :500].std() > 5
        assert robot.viewer.poll() is None


def test_the_least_volume_on_a_dense_screen_in_a_window_of_next_to_nothing(tmp_path: Path) -> None:
    np.save(tmp_path / "least.npy", np.arange(8, dtype=np.uint8).reshape(2, 2, 2))
    with Robot(tmp_path, ["least.npy"], (1200, 800), dpi=192) as robot:
        robot.whole()
        # 21 at 96 dpi: type of 15 and its padding.
        assert robot.area("weight 1")[3] == pytest.approx(42, abs=3)
        window = robot.find()
        for size in ((1, 1), (40, 30), (1100, 700)):
            before = robot.now()
            robot.do("windowsize", window, *size)
            time.sleep(0.4)
        robot.whole(before)
        assert "gl-error" not in {row["event"] for row in robot.rows()}
        assert robot.viewer.poll() is None


def test_opengl_is_not_asked_after_every_call_whether_it_went_well() -> None:
    """PyOpenGL asks unless it is switched off before its first import."""
    code = (
        "import volspec.viewer.work.pictures, sys, OpenGL._configflags as flags; "
        "sys.exit(flags.ERROR_CHECKING)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_picture_that_is_being_saved_is_given_up_when_the_window_closes(tmp_path: Path) -> None:
    """Its thread is in native code; with an interpreter gone it ended the process by SIGABRT."""
    values = np.random.default_rng(1).random((24, 24, 24), np.float32)
    values[3, 4, 5] = np.nan
    np.save(tmp_path / "v.npy", values)
    with Robot(tmp_path, (str(tmp_path / "v.npy"),), (1000, 700)) as robot:
        assert "NaN" in event(robot, "warning")["message"]
        robot.whole()
        robot.rest()
        robot.key("s")
        robot.key("ctrl+q")
        assert robot.viewer.wait(60) == 0
        assert robot.viewer.stderr is not None
        said = robot.viewer.stderr.read()
    assert "cancelled" in said or list(tmp_path.rglob("*.png"))


def test_without_a_device_the_remedy_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not all(device.platform == POCL for device in devices()):
        pytest.skip("a device here is none of PoCL, and would work")
    # PoCL refuses this flag as it refuses a CPU that it does not know: when it builds.
    monkeypatch.setenv("POCL_EXTRA_BUILD_FLAGS", "-no-such-flag")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path))
    monkeypatch.delenv("VOLSPEC_DEVICE", raising=False)
    with Robot(tmp_path, [ENGINE], (900, 600)) as robot:
        robot.wait_for(lambda row: row["event"] == "error" and row.get("stage") == "cast")
        robot.rest()
        x, y, width, height = robot.area("picture")
        robot.grab(tmp_path / "window.png")
        with Image.open(tmp_path / "window.png") as window:
            left = window.crop((x, y, x + 2 * width // 3, y + height))  # of cube and scale
            picture = np.asarray(left.convert("L")) > 90
        above, middle, below = (part.sum() for part in np.array_split(picture, 3))
        assert 300 < middle < 0.1 * picture.size
        assert above == below == 0  # where a notice would say the same
        robot.key("h")  # the window goes on
        robot.rest()
        assert robot.viewer.poll() is None


SCENE = """
title = "%s"
version = 2
[volume]
file = "plain.npy"
[[material]]
name = "grey"
reflectance = "grey:0.5"
[transfer]
points = [
    { value = 0.2, opacity = 0.0, material = "grey" },
    { value = 0.9, opacity = 0.4, material = "grey" },
]
[[light]]
name = "day"
spectrum = "D65"
"""


def opened(robot: Robot, after: float = -1.0) -> list[str]:
    """Titles of what has been opened."""
    return [row["title"] for row in robot.since(after) if row["event"] == "open"]


def fed(pipe: Path, text: str) -> bool:
    """Return True if a text was passed to the reader of a named pipe."""
    try:
        end = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
    except OSError:
        return False
    with open(end, "w", encoding="utf-8") as file:
        file.write(text)
    return True


def refusal(robot: Robot, *uris: str) -> str:
    """Message of a refused drop, which changes nothing."""
    before = robot.now()
    robot.drop(*uris)
    robot.rest()
    assert not {"open", "cast"} & {row["event"] for row in robot.since(before)}
    (said,) = [row["message"] for row in robot.since(before) if row["event"] == "error"]
    return str(said)


def test_what_is_dropped_is_opened_or_refused_and_what_was_open_stays(tmp_path: Path) -> None:
    plain, odd = tmp_path / "plain.npy", tmp_path / "Kugel é 骨 100%.npy"
    for path in (plain, odd):
        np.save(path, phantom.ball(16).values)
    notes, scene, first = (tmp_path / name for name in ("notes.txt", "scene.toml", "first.toml"))
    notes.write_text("no volume", encoding="utf-8")
    scene.write_text(SCENE % "Dropped", encoding="utf-8")
    # Reading it takes until it is fed below.
    os.mkfifo(first)
    # On Linux a name may be bytes that are no text.
    np.save(tmp_path / os.fsdecode(b"caf\xe9.npy"), phantom.ball(16).values)

    with Robot(tmp_path, [first.name], (480, 360)) as robot:
        # What is dropped before anything is open comes after what was asked for first.
        robot.wait_for(lambda row: row["event"] == "layout")
        robot.drop(plain.as_uri())
        assert robot.until(lambda: fed(first, SCENE % "First"))
        robot.wait_for(lambda row: row.get("title") == plain.name)
        robot.rest()
        assert opened(robot) == ["First", plain.name]

        # Of two drops in a row the last is open in the end; percent-encoded names are read.
        before = robot.now()
        robot.drop(f"file://localhost{scene}")
        robot.drop(odd.as_uri())
        robot.rest()
        assert opened(robot, before)[-1] == odd.name
        before = robot.now()
        robot.drop(f"file://localhost{scene}")
        robot.rest()
        assert opened(robot, before) == ["Dropped"]

        assert refusal(robot, plain.as_uri(), odd.as_uri())
        assert str(notes) in refusal(robot, notes.as_uri())
        plain.unlink()
        assert str(plain) in refusal(robot, plain.as_uri())
        for ending in (".npy", ".volspec.json"):
            assert "UTF-8" in refusal(robot, f"{tmp_path.as_uri()}/caf%E9{ending}")
        # A key that comes with such a name is not lost.
        before = robot.now()
        robot.drop(f"{tmp_path.as_uri()}/caf%E9.npy", key="F12")
        robot.wait_for(lambda row: row.get("key") == "f12", before)
        robot.rest()
        # A folder with such a name is listed without it.
        robot.key("ctrl+o")
        robot.rest()
        robot.key("Escape")
        robot.rest()
        robot.key("ctrl+q")
        assert robot.viewer.wait(20) == 0


_PASTE = """
import copykitten, sys
data, width, height = copykitten.paste_image()
sys.stdout.write(f"{width}x{height} {min(data[3::4])} {max(data[0::4])}")
"""


def event(robot: Robot, name: str, after: float = -1.0) -> Row:
    return robot.wait_for(lambda row: row["event"] == name, after)


def typed(robot: Robot, text: str) -> None:
    """Into what a key has opened."""
    robot.rest()
    robot.type(text)
    robot.key("Return")
    robot.rest()


def test_work_is_exported_found_by_name_kept_and_restored(tmp_path: Path) -> None:
    from PIL import Image

    with Robot(tmp_path, [ENGINE, "--screenshot", "160x120"], (900, 600)) as robot:
        robot.whole()
        robot.rest()
        # A command by a few letters, and a light in the list by name.
        for words in ("hp1 alo", "view right"):
            robot.key("ctrl+p")
            typed(robot, words)

        # As a scene, by a path that Tab completes.
        (tmp_path / "folder").mkdir()
        robot.key("ctrl+s")
        robot.rest()
        robot.type("fol")
        robot.rest()
        robot.key("Tab")
        typed(robot, "mine")
        saved = event(robot, "export-scene")
        scene = Scene.load(tmp_path / saved["path"])
        assert scene.path.parent.name == "folder" and scene.path.stem == "mine"
        assert scene.lights[0].name == "HP1" and scene.file.camera.azimuth_deg == 90.0

        # A picture, also for other programs.
        robot.key("s")
        first = tmp_path / event(robot, "screenshot")["path"]
        robot.key("ctrl+c")
        event(robot, "copied")
        pasted = subprocess.run(
            [sys.executable, "-c", _PASTE],
            env=robot.environment,
            capture_output=True,
            text=True,
            check=True,
        )
        width, height = (int(side) for side in pasted.stdout.split()[0].split("x"))
        assert (width, height) == robot.area("picture")[2:]
        assert pasted.stdout.split()[1] == "255" and int(pasted.stdout.split()[2]) > 50

        # Plain keys belong to a panel while the keyboard is in it: Space does not change lights.
        robot.key("F6")
        before = robot.rest()
        robot.key("space")
        robot.rest()
        assert [row for row in robot.since(before) if row["event"] == "relight"] == []
        robot.key("Escape")
        for key in ("space", "ctrl+z"):
            before = robot.rest()
            robot.key(key)
            robot.rest()
            assert any(row["event"] == "relight" for row in robot.since(before))
        robot.key("ctrl+q")
        assert robot.viewer.wait(20) == 0
    (tmp_path / "trace.jsonl").unlink()

    with Robot(tmp_path, ["--restore", "--screenshot", "160x120"], (900, 600)) as robot:
        robot.whole()
        robot.rest()
        robot.key("s")
        second = tmp_path / event(robot, "screenshot")["path"]
        assert second != first
        np.testing.assert_array_equal(np.asarray(Image.open(first)), np.asarray(Image.open(second)))
        for picture in (first, second):
            picture.unlink()  # next to the shipped scene
        # Read again, the scene is as its file has it, seen from where one was.
        before = robot.rest()
        robot.key("F5")
        event(robot, "open", before)
        # What was restored is not lost by that.
        before = robot.rest()
        robot.key("ctrl+shift+r")
        event(robot, "open", before)
        assert robot.viewer.poll() is None


def test_a_volume_s_saved_scene_exports_the_picture_on_the_screen(tmp_path: Path) -> None:
    import SimpleITK as sitk
    from PIL import Image

    values = (200 * phantom.ball(32).values).astype(np.uint8)
    sitk.WriteImage(sitk.GetImageFromArray(values), str(tmp_path / "ball.nii.gz"))
    with Robot(tmp_path, ["ball.nii.gz"], (640, 420)) as robot:
        robot.whole()
        robot.rest()
        robot.key("ctrl+p")
        typed(robot, "preset skin")
        robot.rest()
        robot.drag(along(robot.middle("picture"), (200, 180), 0.1))
        robot.rest()
        # The name and the folder that are offered.
        robot.key("ctrl+s")
        robot.rest()
        robot.key("Return")
        saved = Path(event(robot, "export-scene")["path"])
        assert saved == tmp_path / "ball.toml"
        robot.key("s")
        shot = tmp_path / event(robot, "screenshot")["path"]
    text = saved.read_text(encoding="utf-8")
    assert 'file = "ball.nii.gz"' in text and 'reflectance = "Vrhel/' in text
    assert max(len(number) for number in re.findall(r"[\d.]+", text)) <= 9
    seen = np.asarray(Image.open(shot).convert("RGB"), np.int16)
    scene = Scene.load(saved)
    assert (scene.file.output.height, scene.file.output.width) == seen.shape[:2]
    scene = scene.exporting(annotate=["scale"])  # as a picture has what the screen shows
    made = scene.export(tmp_path / "frames", lights=[scene.lights[0].name], sheet=False)
    frame = np.asarray(Image.open(made.output / made.files[0]).convert("RGB"), np.int16)
    assert seen.std() > 5 and np.abs(frame - seen).max() <= 1


def test_a_first_start_offers_demonstrations(tmp_path: Path) -> None:
    with Robot(tmp_path, [], (1000, 640)) as robot:
        robot.whole()
        # At once, before the scene behind it is read.
        rows = robot.rows()
        first = next(row for row in rows if "open your own" in row.get("areas", ()))
        assert first["t"] < next(row["t"] for row in rows if row["event"] == "open")
        robot.rest()
        assert {f"demonstration {name}" for name in ("head", "engine", "frog")} <= areas(robot)
        before = robot.rest()
        robot.click("demonstration head")
        event(robot, "open", before)
        robot.rest()
        assert "demonstration frog" not in areas(robot)
        # Again from the command list; Esc leaves the scene as it is.
        before = robot.rest()
        robot.key("ctrl+p")
        typed(robot, "demonstrations")
        assert "demonstration frog" in areas(robot)
        robot.key("Escape")
        robot.rest()
        assert "demonstration frog" not in areas(robot) and opened(robot, before) == []
        # One's own file, without a way back through the screen.
        robot.key("ctrl+p")
        typed(robot, "demonstrations")
        np.save(tmp_path / "own.npy", phantom.ball(16).values)
        robot.click("open your own")
        robot.rest()
        robot.key("ctrl+a")
        before = robot.now()
        robot.type(str(tmp_path / "own.npy"))
        robot.key("Return")
        event(robot, "open", before)
        robot.rest()
    (tmp_path / "trace.jsonl").unlink()
    # Now there is something of one's own; demonstrations are none of the recent files.
    with Robot(tmp_path, [], (1000, 640)) as robot:
        robot.whole()
        robot.rest()
        assert "open your own" not in areas(robot)


def areas(robot: Robot) -> set[str]:
    """Names of the items of the last layout."""
    return set([row["areas"] for row in robot.rows() if row["event"] == "layout"][-1])
