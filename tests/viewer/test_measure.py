"""Distances, angles and labels: picked in the picture, listed, undone, saved and drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.viewer import read_scene
from tests.support.window import Robot
from volspec.raycast.projection import Projection
from volspec.scene import Scene
from volspec.scene.annotation import Annotation
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
def test_a_tool_adds_its_annotation_and_stays_in_use(
    state: ViewState, tool: str, caption: str
) -> None:
    new = picked(state, tool)
    assert [each.caption for each in new.annotations] == [caption]
    assert new.interface.tool == tool and new.interface.tool_points == ()
    assert measure.hint(measure.stop(new)) == ""
    assert len(picked(new, tool).annotations) == 2


def test_points_without_a_tool_are_ignored(state: ViewState) -> None:
    assert measure.pick(state, POINTS[0]).state is state
    assert measure.pick(measure.start(state, "ruler"), POINTS[0]).state.annotations == ()


def test_there_is_a_limit(state: ViewState) -> None:
    many = picked(state, "label")
    for _ in range(measure.MOST - 1):
        many = measure.pick(many, POINTS[0]).state
    assert len(many.annotations) == measure.MOST
    refused = measure.pick(many, POINTS[0])
    assert refused.message and refused.state is many


def test_texts_and_rows_are_edited(state: ViewState) -> None:
    new = picked(picked(state, "label"), "distance")
    new = measure.rename(measure.rename(new, 0, "  aortic\nvalve "), 1, "width")
    assert [each.caption for each in new.annotations] == ["aortic valve", "width 5 mm"]
    assert measure.rename(new, 0, " ") is new  # a label has a text
    assert measure.remove(new, 0).annotations == new.annotations[1:]
    assert measure.remove(new, 5) is new
    assert measure.remove_all(new).annotations == ()


@pytest.mark.slow
@pytest.mark.usefixtures("screen")
def test_points_of_the_picture_are_points_of_the_volume(tmp_path: Path) -> None:
    values = np.zeros((40, 40, 40), np.float32)
    values[8:32, 8:32, 8:32] = 1.0
    np.save(tmp_path / "box.npy", values)
    with Robot(tmp_path, ["box.npy"], (800, 520)) as robot:
        robot.whole()
        robot.rest()

        def command(words: str) -> None:
            robot.key("ctrl+p")
            robot.rest()
            robot.type(words)
            robot.rest()
            robot.key("Return")
            robot.rest()

        command("preset surface")
        command("measure a distance")
        x, y, width, height = robot.area("picture")
        places = [(x + width * 0.4, y + height * 0.45), (x + width * 0.6, y + height * 0.5)]
        for place in places:
            robot.click(place)
            robot.rest()
        # A new label is typed at once; its letters are no commands.
        command("add a label")
        robot.click(places[0])
        robot.rest()
        robot.type("a crust")
        robot.rest()
        robot.key("Return")
        robot.rest()
        robot.key("Escape")
        robot.rest()
        # The palette takes keys at once, before it is drawn: S saves no picture.
        robot.do("key", "--delay", "0", "ctrl+p", "s")
        robot.rest()
        robot.key("Escape")
        robot.rest()
        # A double click on its caption in the picture edits the text.
        robot.do("mousemove", *robot.middle("annotation 1"), "sleep", "0.1")
        robot.do("click", "--repeat", "2", "--delay", "60", "1")
        robot.rest()
        robot.type("the crust")
        robot.rest()
        robot.key("Return")
        robot.rest()
        robot.key("ctrl+s")
        robot.rest()
        before = robot.now()
        robot.key("Return")
        saved = robot.wait_for(lambda row: row["event"] == "export-scene", before)
        robot.key("ctrl+z")
        robot.rest()
        assert robot.viewer.poll() is None
    scene = Scene.load(saved["path"])
    found, label = scene.file.annotation
    assert label.text == "the crust"
    assert [path.suffix for path in tmp_path.iterdir()].count(".png") == 0
    assert 5 < (found.value or 0.0) < 24
    # The first hits lie on the box's surface, and appear where they were clicked.
    for point in found.points_mm:
        assert np.abs(np.abs(np.subtract(point, 19.5)).max() - 12.0) < 0.8
    projection = Projection(scene.camera(scene.volume()), (x, y, width, height))
    drawn = projection.to_window(np.array(found.points_mm))[:, :2]
    assert np.abs(drawn - places).max() < 2.0
    assert read_scene(Path(saved["path"])).annotations == (found, label)
    assert isinstance(found, Annotation)
