"""The window itself, under Xvfb, used with a mouse and keys."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robot import Robot, along

pytestmark = pytest.mark.usefixtures("screen")


def test_a_session_casts_for_views_only_and_refines_when_it_rests(tmp_path: Path) -> None:
    from PIL import Image

    with Robot(tmp_path, ["--screenshot", "160x120"], (900, 600)) as robot:
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
        assert "nosuch.nrrd: no such file" in error["message"]
        screen = tmp_path / "screen.png"
        robot.grab(screen)
        assert np.asarray(Image.open(screen))[:, :500].std() > 5
        assert robot.viewer.poll() is None


def test_without_a_display_one_line_says_what_to_do(tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-c", "from volspec.cli import main; main()", "view"],
        env=environment | {"PYTHONPATH": str(Path(__file__).resolve().parents[2])},
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "volspec render" in done.stderr


def test_a_missing_file_is_refused_before_anything_is_shown(tmp_path: Path) -> None:
    with Robot(tmp_path, ["nosuch.toml"], (320, 240)) as robot:
        assert robot.viewer.wait(30) == 1
        assert robot.viewer.stderr is not None
        assert "nosuch.toml: no such file" in robot.viewer.stderr.read()


def test_the_least_volume_on_a_dense_screen_in_a_window_of_next_to_nothing(
    tmp_path: Path,
) -> None:
    np.save(tmp_path / "least.npy", np.arange(8, dtype=np.uint8).reshape(2, 2, 2))
    with Robot(tmp_path, ["least.npy"], (1200, 800), dpi=192) as robot:
        robot.whole()
        # 21 at 96 dpi: type of 15 and what stands around it.
        assert robot.area("weight 1")[3] == pytest.approx(42, abs=3)
        window = robot.find()
        for size in ((1, 1), (40, 30), (1100, 700)):
            before = robot.now()
            robot.do("windowsize", window, *size)
            time.sleep(0.4)
        robot.whole(before)
        assert not [row for row in robot.rows() if row["event"] == "gl-error"]
        assert robot.viewer.poll() is None


def test_opengl_is_not_asked_after_every_call_whether_it_went_well() -> None:
    """PyOpenGL asks unless it is switched off before its first import."""
    for module in ("app", "ui.window", "work.pictures"):
        code = (
            f"import volspec.viewer.{module}, sys, OpenGL._configflags as flags; "
            "sys.exit(flags.ERROR_CHECKING)"
        )
        assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_picture_that_is_being_saved_is_given_up_when_the_window_closes(tmp_path: Path) -> None:
    """Its thread is in native code; with an interpreter gone it ended the process by SIGABRT."""
    np.save(tmp_path / "v.npy", np.random.default_rng(1).random((24, 24, 24), np.float32))
    with Robot(tmp_path, (str(tmp_path / "v.npy"),), (1000, 700)) as robot:
        robot.whole()
        robot.rest()
        robot.key("s")
        robot.key("ctrl+q")
        assert robot.viewer.wait(60) == 0
        assert robot.viewer.stderr is not None
        said = robot.viewer.stderr.read()
    assert "the picture was given up" in said or list(tmp_path.rglob("*.png"))
