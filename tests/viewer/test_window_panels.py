"""Panels in the window under Xvfb: lights, palette, transfer function, slices, steps of undo."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.window import Robot, along, small_engine

pytestmark = pytest.mark.usefixtures("screen")


def last_layout(robot: Robot) -> dict[str, Any]:
    """Return the rectangles of the last frame's items."""
    found: dict[str, Any] = [row["areas"] for row in robot.rows() if row["event"] == "layout"][-1]
    return found


def test_lights_are_drawn_given_lux_saved_and_faded_without_a_cast(tmp_path: Path) -> None:
    with Robot(tmp_path, small_engine(tmp_path), (1000, 640)) as robot:
        first = robot.whole()

        def click(name: str) -> None:
            robot.rest()
            robot.click(name)

        # The first state, as the scene has it.
        click("tab States")
        click("save state")
        plain = picture(robot, tmp_path)

        # A spectrum, drawn in one stroke.
        # The figures of a light, and of the mix, which a thread computes.
        click("tab Rendition")
        click("rendition of Mix")
        assert robot.until(lambda: "rendition" in last_layout(robot))

        click("tab Spectrum")
        robot.rest()
        x, y, width, height = robot.area("spectrum")
        waves = [
            (x + width * i / 30, y + height * (0.5 + 0.4 * math.cos(i / 3))) for i in range(2, 29)
        ]
        robot.drag(waves)
        drawn = picture(robot, tmp_path)
        # How much depends on how many of the stroke's places a slow window sees; 1 is rounding.
        assert np.abs(drawn - plain).max() > 1

        # Lux: an eye adapted to little light sees the picture otherwise.
        click("tab Light")
        click("lux given")
        robot.rest()
        x, y, width, height = robot.area("lux")
        ends = (x + width * 0.5, y + height / 2), (x + width * 0.05, y + height / 2)
        robot.drag(along(*ends, 0.5))
        dim = picture(robot, tmp_path)
        assert np.abs(dim - drawn).max() > 5

        # The second state, and back to the first in a fade.
        robot.key("alt+s")
        before = robot.rest()
        robot.key("alt+1")
        robot.rest()
        fade = [row for row in robot.since(before) if row["stage"] == "relight"]
        # 1.5 s; a slow machine draws few frames of it, one would be a cut.
        assert len(fade) > 1 and fade[-1]["whole"]
        assert np.abs(picture(robot, tmp_path) - plain).max() <= 1
        # Undo is one step, and has the lights that were before the fade.
        robot.key("ctrl+z")
        assert np.abs(picture(robot, tmp_path) - dim).max() <= 1

        assert [row for row in robot.since(first["t"]) if row["stage"] == "cast"] == []
        assert robot.viewer.poll() is None


def picture(robot: Robot, folder: Path) -> NDArray[np.int16]:
    """Unobstructed part of the picture, once it is complete."""
    from PIL import Image

    robot.rest()
    robot.grab(folder / "screen.png")
    x, y, width, height = robot.area("picture")
    screen = np.asarray(Image.open(folder / "screen.png").convert("RGB"), dtype=np.int16)
    # Below the message, above the values under the mouse.
    return screen[y + height // 4 : y + height // 2, x : x + width - 8]


def ask(robot: Robot, menu: str, action: str) -> None:
    for name in (f"menu {menu}", f"action {action}"):
        robot.click(name)
        robot.rest()


def test_a_colour_is_dragged_and_a_material_hidden_with_one_cast(tmp_path: Path) -> None:
    with Robot(tmp_path, small_engine(tmp_path), (1000, 700)) as robot:
        robot.whole()
        for _ in range(2):  # closed and opened, it comes to the front
            ask(robot, "Window", "panel-palette")
        robot.click("cell 6")  # the inserts under A
        before = robot.rest()
        x, y, _, _ = robot.area("picker")
        robot.drag(along((x + 60, y + 60), (x + 120, y + 90), 0.5))
        cast = robot.rest()
        assert any(row["event"] == "design" and row["whole"] for row in robot.since(before))
        # The materials become channels: the one cast.
        assert any(row["event"] == "cast" and row["divisor"] == 1 for row in robot.since(before))

        # From now on the picture only relights.
        robot.drag(along((x + 120, y + 90), (x + 40, y + 60), 1.0))
        dragged = robot.rest()
        designs = [row for row in robot.since(cast) if row["event"] == "design"]
        # A muted pink by lamp light can be had: seen side by side it is the one wanted.
        assert designs[-1]["whole"] and designs[-1]["worst"] < 1.0
        assert len([row for row in robot.since(cast) if row["event"] == "relight"]) > 3

        # A wizard hides them again.
        robot.click("picture")
        robot.rest()
        ask(robot, "Palette", "hide")
        (hidden,) = (row for row in robot.since(dragged) if row["event"] == "wizard")
        found = re.search(r"^A: inserts – block ΔE ([\d.]+)", hidden["reached"][0])
        assert found and float(found[1]) < 1.0
        assert any(row["event"] == "relight" for row in robot.since(hidden["t"]))

        # One step back are the colours from before.
        before = robot.rest()
        robot.key("ctrl+z")
        robot.rest()
        assert any(row["event"] == "relight" and row["whole"] for row in robot.since(before))
        assert [row for row in robot.since(before) if row["event"] == "design"] == []
        assert [row for row in robot.since(cast) if row["stage"] == "cast"] == []
        assert robot.viewer.poll() is None


@pytest.mark.slow
def test_a_preset_is_edited_as_regions_and_windowed_in_the_picture(tmp_path: Path) -> None:
    with Robot(tmp_path, small_engine(tmp_path), (900, 640)) as robot:
        robot.whole()
        robot.rest()

        def clicked(*names: str) -> NDArray[np.int16]:
            for name in names:
                robot.rest()
                robot.click(name)
            return picture(robot, tmp_path)

        # Closed and opened again, the panel is in front of the others.
        clicked(*("menu Window", "action panel-transfer") * 2)
        curve = clicked("presets", "preset glass")

        # Glass leaves out flat parts; where gradient 0 counts as well, they are seen.
        x, y = robot.middle("gradient 0")
        robot.drag(along((x, y), (x, y - 24), 1))
        assert np.abs(picture(robot, tmp_path) - curve).mean() > 1
        robot.key("ctrl+z")
        assert np.abs(picture(robot, tmp_path) - curve).mean() < 0.1

        regions = clicked("kind", "kind regions")
        assert np.abs(curve - regions).mean() < 10

        # The first region's middle, dragged down: flat parts, which glass leaves out, are seen.
        x, y = robot.middle("region 0")
        robot.drag(along((x, y), (x, y + 60), 0.5))
        dragged = picture(robot, tmp_path)
        assert np.abs(dragged - regions).mean() > 1

        # The library's gold, by the first letters of its name: redder than glass.
        clicked("material")
        robot.type("gol")
        robot.rest()
        robot.key("Return")
        golden = picture(robot, tmp_path)
        assert (golden - dragged)[..., 0].mean() > 2 + (golden - dragged)[..., 2].mean()
        robot.key("Escape")
        robot.rest()

        # Ctrl and a drag in the picture: another window, undone as one step.
        x, y = robot.middle("picture")
        robot.do("keydown", "ctrl")
        robot.drag([(x, y), (x + 10, y), (x + 40, y - 20), (x + 60, y - 30)])
        robot.do("keyup", "ctrl")
        assert np.abs(picture(robot, tmp_path) - golden).mean() > 1
        robot.key("ctrl+z")
        assert np.abs(picture(robot, tmp_path) - golden).mean() < 0.1
        assert [row for row in robot.rows() if row["event"] == "error"] == []
        assert robot.viewer.poll() is None


def casts(robot: Robot, after: float) -> list[int]:
    """Casts since then that came to an end, by what their sides are divided by."""
    return [row["divisor"] for row in robot.since(after) if row["event"] == "cast"]


def slices(robot: Robot, folder: Path) -> list[NDArray[np.int64]]:
    """Pictures of the two slices that a click into the third moves."""
    from PIL import Image

    robot.grab(folder / "screen.png")
    screen = np.asarray(Image.open(folder / "screen.png")).astype(int)
    areas = (robot.area(f"slice {plane}") for plane in ("Coronal", "Sagittal"))
    return [screen[y : y + height, x : x + width] for x, y, width, height in areas]


@pytest.mark.slow
def test_handles_cube_and_slices_take_the_mouse(tmp_path: Path) -> None:
    with Robot(tmp_path, small_engine(tmp_path), (1000, 640)) as robot:
        robot.whole()
        before = robot.rest()

        # A face of the crop's box: cast coarsely while it is dragged, whole when it is let go.
        robot.key("c")
        robot.rest()
        assert casts(robot, before) == []
        (x, y), (far_x, far_y) = robot.middle("crop 4"), robot.middle("crop 5")
        shares = np.linspace(0.0, 0.4, 20)
        robot.drag([(x + s * (far_x - x), y + s * (far_y - y)) for s in shares])
        robot.rest()
        # One that comes between may be whole, as a busy machine holds the mouse still.
        first, *_, last = casts(robot, before)
        assert first > 1 and last == 1
        # A handle stays where it was released, to a pixel or two.
        there = x + 0.4 * (far_x - x), y + 0.4 * (far_y - y)
        np.testing.assert_allclose(robot.middle("crop 4"), there, atol=2.0)
        assert robot.middle("crop 5") == (far_x, far_y)
        robot.key("ctrl+z")
        before = robot.rest()
        assert robot.middle("crop 4") == (x, y)

        # The cube: a click on its front face looks straight at it, and there is one face.
        robot.click("cube 3")
        robot.rest()
        assert casts(robot, before)[-1] == 1

        # Slices: a click moves the other two, and nothing is cast.
        robot.key("o")
        before = robot.rest()
        ax, ay, width, height = robot.area("slice Axial")
        place = ax + 0.4 * width, ay + 0.62 * height
        first = slices(robot, tmp_path)
        robot.click(place)
        robot.rest()
        pairs = zip(first, slices(robot, tmp_path), strict=True)
        assert min(np.abs(a - b).mean() for a, b in pairs) > 2
        assert casts(robot, before) == []

        # A light relights them, and still nothing is cast.
        robot.key("space")
        robot.rest()
        assert any(row["event"] == "relight" for row in robot.since(before))
        assert casts(robot, before) == []
        assert robot.viewer.poll() is None


def test_lights_are_renamed_and_chosen_and_a_crash_is_told_of(tmp_path: Path) -> None:
    def state(robot: Robot, name: str) -> dict[str, Any]:
        """Content of a session that is saved now."""
        robot.rest()
        robot.key("ctrl+shift+s")
        robot.rest()
        robot.type(name)
        robot.key("Return")
        robot.rest()
        found = json.loads((tmp_path / f"{name}.volspec.json").read_text(encoding="utf-8"))
        assert isinstance(found["state"], dict)
        return dict(found["state"])

    with Robot(tmp_path, small_engine(tmp_path), (640, 420)) as robot:
        robot.whole()
        robot.rest()
        # A name of one's own, for the light that Space has chosen.
        robot.key("space")
        robot.rest()
        robot.key("F2")
        robot.rest()
        robot.type(name := "my lamp")
        robot.key("Return")
        first = state(robot, "first")
        assert first["lights"][1]["name"] == name and first["interface"]["light"] == 1
        # The wheel's three notches are one step, and the mix before them another.
        robot.key("k")
        robot.rest()
        x, y = robot.middle("picture")
        robot.do("mousemove", x, y, "click", "--repeat", "3", "--delay", "100", "4")
        second = state(robot, "second")
        assert second["interface"]["light"] == len(second["lights"]) - 1 == len(first["lights"])
        robot.key("ctrl+z")
        robot.rest()
        robot.key("ctrl+z")
        third = state(robot, "third")
        assert third["view"] == first["view"] != second["view"]
        assert third["lights"] == first["lights"] and third["interface"]["light"] == 1
        # What is kept by itself, which a crash leaves.
        kept = tmp_path / "state" / "sessions"
        assert robot.until(lambda: any(kept.glob("[!.]*.json")))
        robot.viewer.kill()
        robot.viewer.wait()
    (tmp_path / "trace.jsonl").unlink()

    with Robot(tmp_path, small_engine(tmp_path), (640, 420)) as robot:
        robot.wait_for(lambda row: row["event"] == "ended-early")
