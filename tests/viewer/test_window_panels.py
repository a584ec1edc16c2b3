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

from tests.support.window import Robot, small_engine

pytestmark = pytest.mark.not_quick


@pytest.fixture
def engine(window: Robot, tmp_path: Path) -> Robot:
    """The window with a smaller engine; the trace begins when it is shown."""
    window.resize((1000, 700))
    window.open(small_engine(tmp_path))
    window.begin()
    return window


@pytest.mark.slow
def test_lights_are_drawn_given_lux_saved_and_faded_without_a_cast(engine: Robot) -> None:
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
def test_a_colour_is_dragged_and_a_material_hidden_with_one_cast(engine: Robot) -> None:
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
def test_a_preset_is_edited_as_regions_and_windowed_in_the_picture(engine: Robot) -> None:
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
def test_handles_cube_and_slices_take_the_mouse(engine: Robot) -> None:
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
def test_lights_are_renamed_and_chosen(engine: Robot, tmp_path: Path) -> None:
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
