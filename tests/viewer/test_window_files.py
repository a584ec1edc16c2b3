"""The window under Xvfb: messages, menus, dialogs, panels, a volume larger than memory."""

import json
import math
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.pyramids import stored
from tests.support.viewer import opened
from tests.support.window import Robot, Row, small_engine
from tests.viewer._states import casts_of, job_of, save_ball
from volspec.raycast.progressive import WHOLE
from volspec.volume import Volume, phantom

pytestmark = [pytest.mark.usefixtures("screen"), pytest.mark.not_quick]


def red(picture: NDArray[np.int16]) -> int:
    """Return the number of pixels as red as errors are, where messages are shown."""
    r, g, b = np.moveaxis(picture[:90], -1, 0)
    return int(((r > 150) & (r > 1.7 * g) & (r > 1.7 * b)).sum())


@pytest.fixture
def ball(window: Robot, tmp_path: Path) -> Robot:
    """The window with a volume alone."""
    window.open(save_ball(tmp_path))
    return window


@pytest.mark.slow
def test_warnings_and_errors_stay_readable(ball, tmp_path):
    values = phantom.ball(16).values.copy()
    values[3, 4, 5] = np.nan
    np.save(tmp_path / "nan.npy", values)
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    # A file's warning comes each time that it is opened.
    for _ in range(2):
        before = ball.rest()
        ball.open(tmp_path / "nan.npy")
        assert "NaN" in ball.event("warning", before)["message"]
    before = ball.rest()
    ball.drop((tmp_path / "bad.npy").as_uri())
    ball.event("error", before)
    for theme in ("dark", "light"):
        assert red(ball.pixels()) > 150, theme
        ball.keys("t")
    # The count of errors opens the list; the cross dismisses the message.
    ball.click("errors")
    ball.rest()
    assert {f"message {number}" for number in range(5)} <= ball.areas().keys()
    ball.click("close message")
    assert red(ball.pixels()) < 20
    ball.click("clear messages")
    ball.rest()


@pytest.mark.slow
def test_arrows_lead_from_menu_to_menu(ball):
    def pressed(*names: str) -> list[str]:
        """Return what the keys have cast and opened."""
        before = ball.rest()
        ball.keys(*names)
        return [row["event"] for row in ball.since(before, "cast", "open")]

    # From File to View, around the end to Window, and into a submenu and back.
    assert pressed("F10", "Right", "Right") == [] and "action view-front" in ball.areas()
    assert pressed("Left", "Left", "Left") == [] and "action panel-cuts" in ball.areas()
    assert pressed("Right", "Down", "Right") == [] and "recent 0" in ball.areas()
    assert pressed("Left", "Escape", "Escape") == []
    assert "cast" in pressed("Right")  # the picture's again
    # Enter runs a command; a menu that the mouse has opened is left alike.
    assert "cast" in pressed("F10", "Right", "Right", "Down", "Return")
    ball.click("menu Edit")
    assert pressed("Right", "Right") == [] and "action crop" in ball.areas()
    assert pressed("Escape", "Escape") == []
    assert "cast" in pressed("Left")


@pytest.mark.slow
def test_files_are_found_by_mouse_arrows_and_tab(ball, tmp_path):
    data = tmp_path / "data"
    (data / "inner" / "more").mkdir(parents=True)
    for name in ("one.npy", "two.npy", "inner/three.npy"):
        save_ball(data, name=name)
    (data / "notes.txt").touch()

    def titles(after: float) -> list[str]:
        ball.rest()
        return [row["title"] for row in ball.since(after, "open")]

    @contextmanager
    def dialog(title: str = "") -> Iterator[None]:
        """Open the dialog, and assert what is opened by it."""
        before = ball.rest()
        ball.keys("ctrl+o")
        yield
        assert titles(before) == [title] * bool(title)

    # It starts next to the open file; a double click goes into a folder, and opens a file.
    with dialog("two.npy"):
        ball.double_click("file data/", lambda: "file inner/" in ball.areas())
        assert "file notes.txt" not in ball.areas()
        ball.double_click("file inner/", lambda: "file three.npy" in ball.areas())
        ball.click("path up")
        before = ball.rest()
        ball.double_click("file two.npy", lambda: titles(before))
    # Arrows choose a row, and a chord selects the text.
    with dialog("three.npy"):
        ball.keys("Down", "Down", "ctrl+a")
        ball.enter("inn", "Tab", "Down", "Down", "Return")
    # A name to be saved under is completed as well, by the folders next to the open file.
    before = ball.keys("ctrl+s")
    ball.enter("mo", "Tab")
    ball.enter("mine")
    assert Path(ball.event("export-scene", before)["path"]) == data / "inner" / "more" / "mine.toml"
    # All files; the place of the open file, and Escape.
    with dialog():
        ball.click("place Home", "place Folder of the open file", "path filter")
        ball.keys("Escape", "Escape")
    before = ball.rest()
    ball.key("Left")
    assert ball.event("cast", before)


@pytest.mark.slow
def test_steps_play_and_raw_layouts_are_chosen_from_lists(tmp_path):
    tifffile = pytest.importorskip("tifffile", reason="tifffile is not installed")
    values = (phantom.ball(16).values * 1000).astype(np.uint16)
    stack = np.stack([np.stack([values, values[::-1]])] * 3)
    names = {"Name": ["DAPI", "GFP"]}
    tifffile.imwrite(tmp_path / "c.ome.tif", stack, metadata={"axes": "TCZYX", "Channel": names})
    values.tofile(tmp_path / "ball.raw")
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    with Robot(tmp_path, ["bad.npy"], (1000, 700)) as robot:
        # Nothing can be opened: the window says why, and offers another file.
        robot.wait_for(lambda row: "open another" in row.get("areas", {}))
        # imgui measures a new window for a frame before it draws it.
        robot.until(lambda: red(robot.look()[300:]) > 100)
        robot.key("ctrl+o")
        robot.wait_for(lambda row: "file c.ome.tif" in row.get("areas", {}))
        robot.click("file c.ome.tif")
        robot.key("Return")
        robot.whole(robot.event("open")["t"])
        # Steps are chosen by key, by the slider and while they play.
        before = robot.rest()
        robot.key("comma")
        assert robot.event("step", before)["step"] == 2
        before = robot.rest()
        robot.steps([robot.at("time step", 0.95), robot.at("time step")], "step")
        assert robot.event("step", before)["step"] == 1
        before = robot.rest()
        robot.click("time play")
        robot.until(lambda: {row["step"] for row in robot.since(before, "step")} == {0, 1, 2})
        robot.key("j")
        before = robot.rest()
        robot.drop((tmp_path / "ball.raw").as_uri())
        robot.wait_for(lambda row: "guess 0" in row.get("areas", {}), before)
        robot.key("Return")
        assert robot.event("open", before)["title"] == "ball.raw"
        robot.rest()
        robot.key("ctrl+q")
        assert robot.ends() == 0


@pytest.mark.slow
def test_files_dropped_together_are_what_is_answered(ball, tmp_path):
    small = save_ball(tmp_path, 8, "small.npy").as_uri()
    one, two = (save_ball(tmp_path, name=name).as_uri() for name in ("a.npy", "b.npy"))

    def dropped(*uris: str, use: str = "", keys: str = "") -> float:
        """Drop files, answer the question by mouse or by keys; return the time before."""
        before = ball.rest()
        ball.drop(*uris)
        ball.rest()
        if use:
            ball.click(f"use {use}", "use ok")
        else:
            ball.keys(*keys.split())
        return before

    before = dropped(one, two, keys="Down Escape")
    ball.rest()
    assert ball.since(before, "open", "error", "cast") == []
    assert ball.event("open", dropped(one, two, keys="Return"))["title"] == "a.npy + b.npy"
    before = ball.rest()
    ball.keys("ctrl+s", "Return")
    saved = Path(ball.event("export-scene", before)["path"])
    scene = tomllib.loads(saved.read_text(encoding="utf-8"))
    assert (scene["volume"]["file"], scene["field"][0]["file"]) == ("a.npy", "b.npy")
    # Of other shapes: refused, and nothing changes.
    message = ball.event("error", before := dropped(one, small, use="steps"))["message"]
    assert "small.npy: has another lattice" in message and not ball.since(before, "open")
    assert ball.event("open", dropped(one, two, keys="Down Return"))["title"] == "a.npy|b.npy"
    # One that cannot be opened does not keep the next one.
    (tmp_path / "bad.npy").write_text("no numbers", encoding="utf-8")
    before = dropped(one, (tmp_path / "bad.npy").as_uri(), small, use="each")
    ball.wait_for(lambda row: row.get("title") == "small.npy", before)
    events = [row.get("title", "bad") for row in ball.since(before, "open", "error")]
    assert events == ["a.npy", "bad", "small.npy"]


@pytest.mark.slow
def test_a_cast_image_is_relit_and_says_what_it_cannot(window, tmp_path):
    (done,) = casts_of(job_of(opened(tmp_path), (64, 32), WHOLE))
    done.image.save(tmp_path / "it.exr")
    window.resize((1000, 700))
    before = window.open(tmp_path / "it.exr")
    # The picture keeps the image's shape; another light is a relight.
    x, y, width, height = window.area("picture")
    assert width / height == pytest.approx(2.0, abs=0.02)
    window.keys("space")
    assert window.since(before, "relight") and not window.since(before, "cast")
    # It cannot be turned, and is saved at its own size.
    shown = window.pixels()
    before = window.rest()
    window.drag([(x + width / 4, y + height - 9), (x + width / 4 + 60, y + height - 30)])
    window.rest()
    assert not window.since(before, "cast")
    below = slice(height // 2, None), slice(width // 2, None)  # the message
    np.testing.assert_array_equal(window.pixels()[below], shown[below])
    window.key("s")
    assert window.saved("screenshot", before).shape == (32, 64, 3)


@pytest.mark.slow
def test_a_picture_dialog_stays_until_its_folder_can_be_made(ball, tmp_path):
    def save_to(folder: str) -> None:
        ball.click("file folder")
        ball.keys("ctrl+a")
        ball.type(folder)
        ball.rest()
        ball.click("picture ok")
        ball.rest()

    before = ball.keys("ctrl+i")
    save_to("/proc/none")
    assert "file problem" in ball.areas()
    save_to(f"{tmp_path}/new/deeper")
    assert ball.event("screenshot", before)["path"] == str(tmp_path / "new" / "deeper" / "ball.png")


@pytest.mark.slow
def test_a_click_on_a_swatch_picks_a_colour_for_its_material(tmp_path):
    save_ball(tmp_path)
    with Robot(tmp_path, ["ball.npy"], (1000, 800), ahead=False) as robot:
        robot.whole()
        robot.front("transfer")
        robot.click(next(name for name in robot.areas() if name.startswith("swatch ")))
        before = robot.rest()
        robot.click(robot.at("picker", 0.3, 0.3))
        assert robot.event("design", before)


def is_fine(row: Row) -> bool:
    """Return True for a cast of the level asked for, False for one of the level in memory."""
    return row["event"] == "cast" and (row["divisor"], row["steps"]) == (1, "own")


@pytest.mark.slow
def test_coarse_at_once_and_finer_when_it_rests(window, tmp_path):
    z, y, x = np.mgrid[-1:1:160j, -1:1:150j, -1:1:170j]
    values = np.clip(1 - np.sqrt(x**2 + y**2 + z**2), 0, 1)
    values[::4] *= 0.5  # slats, of which the coarse level shows none
    stored(Volume((255 * values).astype(np.uint8)), tmp_path)
    before = window.keys("ctrl+o", "ctrl+a")
    window.enter(f"{tmp_path}/v.zarr?memory=3MB")
    assert not is_fine(window.event("cast", window.event("open", before)["t"]))
    left, right = window.at("picture", 1 / 3), window.at("picture")
    window.do("mousemove", *left)  # the probe shows the same place before and after
    fine = window.pixels()
    assert [is_fine(row) for row in window.since(before, "cast")][-1]
    # There and back, each time until the finer level is cast: the same view.
    window.do("mousedown", "1")
    for place in (right, left):
        before = window.now()
        window.do("mousemove", *place)
        window.wait_for(is_fine, before)
        assert not is_fine(window.event("cast", before))
    window.do("mouseup", "1")
    assert np.abs(fine - window.pixels()).mean() < 0.5
    assert fine.std() > 5
    assert window.since(-1.0, "warning", "error") == []


@pytest.fixture
def engine(window: Robot, tmp_path: Path) -> Robot:
    """The window with a smaller engine; the trace begins when it is shown."""
    window.resize((1000, 700))
    window.open(small_engine(tmp_path))
    window.begin()
    return window


@pytest.mark.slow
def test_lights_are_drawn_given_lux_saved_and_faded_without_a_cast(engine):
    # The first state, as the scene has it.
    engine.click("tab States", "save state")
    plain = engine.picture()

    # The figures of a light, and of the mix, which a thread computes.
    engine.click("tab Rendition", "rendition of Mix")
    engine.until(lambda: "rendition" in engine.areas())

    # A spectrum, drawn in one stroke.
    engine.click("tab Spectrum")
    engine.rest()
    heights = ((i / 30, 0.5 + 0.4 * math.cos(i / 3)) for i in range(2, 29))
    engine.drag([engine.at("spectrum", *place) for place in heights])
    drawn = engine.picture()
    # How much depends on how many of the stroke's places a slow window sees; 1 is rounding.
    assert np.abs(drawn - plain).max() > 1

    # Lux: an eye adapted to little light sees the picture otherwise.
    engine.click("tab Light", "lux given")
    engine.rest()
    engine.steps([engine.at("lux", share) for share in (0.5, 0.3, 0.05)], "relight")
    dim = engine.picture()
    assert np.abs(dim - drawn).max() > 5

    # The second state, and back to the first in a fade of 1.5 s; a cut would be there at once.
    engine.key("alt+s")
    before = engine.rest()
    engine.keys("alt+1")
    last = engine.since(before, "relight")[-1]
    assert last["whole"] and last["t"] > before + 1.4
    assert np.abs(engine.picture() - plain).max() <= 1
    # Undo is one step, and has the lights that were before the fade.
    engine.key("ctrl+z")
    assert np.abs(engine.picture() - dim).max() <= 1
    assert engine.since(-1.0, "cast") == []


@pytest.mark.slow
def test_a_colour_is_dragged_and_a_material_hidden_with_one_cast(engine):
    engine.front("palette")
    engine.click("cell 6")  # the inserts under A
    before = engine.rest()
    x, y, _, _ = engine.area("picker")
    cast = engine.steps([(x + 60, y + 60), (x + 120, y + 90)], "design")
    assert any(row["whole"] for row in engine.since(before, "design"))
    # The materials become channels: the one cast.
    assert any(row["divisor"] == 1 for row in engine.since(before, "cast"))

    # From now on the picture only relights.
    places = [(x + 120, y + 90), (x + 100, y + 80), (x + 70, y + 70), (x + 40, y + 60)]
    dragged = engine.steps(places, "relight")
    last = engine.since(cast, "design")[-1]
    # A muted pink by lamp light can be had: seen side by side it is the one wanted.
    assert last["whole"] and last["worst"] < 1.0

    # A wizard hides them again.
    engine.click("picture", "menu Palette", "action hide")
    engine.rest()
    (hidden,) = engine.since(dragged, "wizard")
    found = re.search(r"^A: inserts – block ΔE ([\d.]+)", hidden["reached"][0])
    assert found and float(found[1]) < 1.0
    assert engine.since(hidden["t"], "relight")

    # One step back are the colours from before.
    before = engine.rest()
    engine.keys("ctrl+z")
    assert any(row["whole"] for row in engine.since(before, "relight"))
    assert engine.since(before, "design") == engine.since(cast, "cast") == []


@pytest.mark.slow
def test_a_preset_is_edited_as_regions_and_windowed_in_the_picture(engine):
    engine.front("transfer")
    engine.click("presets", "preset glass")
    curve = engine.picture()

    # Glass leaves out flat parts; where gradient 0 counts as well, they are seen.
    x, y = engine.middle("gradient 0")
    engine.steps([(x, y), (x, y - 12), (x, y - 24)], "cast")
    assert np.abs(engine.picture() - curve).mean() > 1
    engine.key("ctrl+z")
    assert np.abs(engine.picture() - curve).mean() < 0.1

    engine.click("kind", "kind regions")
    regions = engine.picture()
    assert np.abs(curve - regions).mean() < 10

    # The first region's middle, dragged down: flat parts, which glass leaves out, are seen.
    x, y = engine.middle("region 0")
    engine.steps([(x, y), (x, y + 30), (x, y + 60)], "cast")
    dragged = engine.picture()
    assert np.abs(dragged - regions).mean() > 1

    # The library's gold, by the first letters of its name: redder than glass.
    engine.click("material")
    engine.enter("gol")
    golden = engine.picture()
    assert (golden - dragged)[..., 0].mean() > 2 + (golden - dragged)[..., 2].mean()
    engine.keys("Escape")

    # Ctrl and a drag in the picture: another window, undone as one step.
    x, y = engine.middle("picture")
    engine.do("keydown", "ctrl")
    engine.drag([(x, y), (x + 10, y), (x + 40, y - 20), (x + 60, y - 30)])
    engine.do("keyup", "ctrl")
    assert np.abs(engine.picture() - golden).mean() > 1
    engine.key("ctrl+z")
    assert np.abs(engine.picture() - golden).mean() < 0.1
    assert engine.since(-1.0, "error") == []


def slices(robot: Robot) -> list[NDArray[np.int16]]:
    """Pictures of the two slices that a click into the third moves."""
    return [robot.pixels(f"slice {plane}") for plane in ("Coronal", "Sagittal")]


@pytest.mark.slow
def test_handles_cube_and_slices_take_the_mouse(engine):
    # A face of the crop's box: cast coarsely while it is dragged, whole when it is let go.
    start = engine.rest()
    before = engine.keys("c")
    assert engine.since(start, "cast") == []
    (x, y), far = engine.middle("crop 4"), engine.middle("crop 5")
    there = x + 0.4 * (far[0] - x), y + 0.4 * (far[1] - y)
    engine.steps([(x, y), there], "cast")
    casts = [row["divisor"] for row in engine.since(before, "cast")]
    assert casts[0] > 1 and casts[-1] == 1
    # A handle stays where it was released, to a pixel or two.
    np.testing.assert_allclose(engine.middle("crop 4"), there, atol=2.0)
    assert engine.middle("crop 5") == far
    before = engine.keys("ctrl+z")
    assert engine.middle("crop 4") == (x, y)

    # The cube: a click on its front face looks straight at it, and there is one face.
    engine.click("cube 3")
    engine.rest()
    assert engine.since(before, "cast")[-1]["divisor"] == 1

    # Slices: a click moves the other two, and a light relights them; nothing is cast.
    before = engine.keys("o")
    first = slices(engine)
    engine.click(engine.at("slice Axial", 0.4, 0.62))
    assert min(np.abs(a - b).mean() for a, b in zip(first, slices(engine), strict=True)) > 2
    engine.keys("space")
    assert engine.since(before, "relight") and not engine.since(before, "cast")


@pytest.mark.slow
def test_lights_are_renamed_and_chosen(engine, tmp_path):
    def state(name: str) -> dict[str, Any]:
        """Content of a session that is saved now."""
        engine.keys("ctrl+shift+s")
        engine.enter(name)
        saved = json.loads((tmp_path / f"{name}.volspec.json").read_text(encoding="utf-8"))
        return dict(saved["state"])

    # A name of one's own, for the light that Space has chosen.
    engine.keys("space", "F2")
    engine.enter(name := "my lamp")
    first = state("first")
    assert first["lights"][1]["name"] == name and first["interface"]["light"] == 1
    # A notch of the wheel is one step, and the mix before it another.
    engine.keys("k")
    engine.do("mousemove", *engine.middle("picture"), "click", "4")
    second = state("second")
    assert second["interface"]["light"] == len(second["lights"]) - 1 == len(first["lights"])
    engine.keys("ctrl+z", "ctrl+z")
    third = state("third")
    assert third["view"] == first["view"] != second["view"]
    assert third["lights"] == first["lights"] and third["interface"]["light"] == 1
