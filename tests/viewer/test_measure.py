"""Distances, angles and labels: picked in the picture, listed, undone, saved and drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.viewer import read_scene
from tests.support.window import Robot
from volspec.raycast.projection import Projection
from volspec.scene import Scene
from volspec.viewer.model import measure
from volspec.viewer.model.state import ViewState

POINTS = ((0.0, 0.0, 0.0), (3.0, 4.0, 0.0), (3.0, 8.0, 0.0))


def picked(state: ViewState, tool: str) -> ViewState:
    """The state after a tool has picked all of its points."""
    state = measure.start(measure.stop(state), tool)
    for point in POINTS[: measure.TOOLS[tool]]:
        state = measure.pick(state, point).state
    return state


@pytest.mark.parametrize(
    ("tool", "caption"), [("distance", "5 mm"), ("angle", "143.1°"), ("label", "label")]
)
def test_a_tool_annotates_and_stays_in_use(state: ViewState, tool: str, caption: str) -> None:
    new = picked(state, tool)
    assert [each.caption for each in new.annotations] == [caption]
    assert new.interface.tool == tool and new.interface.tool_points == ()
    assert measure.hint(measure.stop(new)) == ""
    assert len(picked(new, tool).annotations) == 2


def test_points_without_a_tool_are_ignored(state: ViewState) -> None:
    assert measure.pick(state, POINTS[0]).state is state
    assert measure.pick(measure.start(state, "ruler"), POINTS[0]).state.annotations == ()


def test_texts_and_rows_are_edited(state: ViewState) -> None:
    new = picked(picked(state, "label"), "distance")
    new = measure.rename(measure.rename(new, 0, "  aortic\nvalve "), 1, "width")
    assert [each.caption for each in new.annotations] == ["aortic valve", "width 5 mm"]
    assert measure.rename(new, 0, " ") is new  # a label has a text
    assert measure.remove(new, 0).annotations == new.annotations[1:]
    assert measure.remove(new, 5) is new
    assert measure.remove_all(new).annotations == ()


@pytest.mark.slow
def test_points_of_the_picture_are_points_of_the_volume(window: Robot, tmp_path: Path) -> None:
    values = np.zeros((40, 40, 40), np.float32)
    values[8:32, 8:32, 8:32] = 1.0
    np.save(tmp_path / "box.npy", values)
    window.open(tmp_path / "box.npy")
    window.command("preset surface")
    window.command("measure a distance")
    x, y, width, height = window.area("picture")
    places = [window.at("picture", 0.35, 0.45), window.at("picture", 0.65, 0.5)]
    window.click(*places)
    # A new label is typed at once; its letters are no commands.
    window.command("add a label")
    window.click(places[0])
    window.enter("a crust")
    window.keys("Escape")
    # The palette takes keys at once, before it is drawn: S saves no picture.
    window.do("key", "--delay", "0", "ctrl+p", "s")
    window.keys("Escape")
    # A double click on its caption in the picture edits the text.
    window.double_click("annotation 1", lambda: True)
    window.enter("the crust")
    before = window.keys("ctrl+s")
    window.key("Return")
    saved = window.event("export-scene", before)
    window.keys("ctrl+z")
    scene = Scene.load(saved["path"])
    found, label = scene.file.annotation
    assert label.text == "the crust"
    assert [path.suffix for path in tmp_path.iterdir()].count(".png") == 0
    assert 5 < (found.value or 0.0) < 24
    # The first hits lie on the box's surface, and appear where they were clicked.
    for point in found.points_mm:
        assert np.abs(np.abs(np.subtract(point, 19.5)).max() - 12.0) < 0.8
    projection = Projection(scene.camera(scene.volume()), (x, y, width, height))
    assert np.abs(projection.to_window(np.array(found.points_mm))[:, :2] - places).max() < 2.0
    assert read_scene(Path(saved["path"])).annotations == (found, label)
