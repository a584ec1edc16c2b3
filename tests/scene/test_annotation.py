"""Annotations: their numbers, what is refused, and their way through a scene's file."""

from dataclasses import replace

import pytest

from tests.support.errors import raises
from volspec._gpu.sources import asset
from volspec.errors import SceneError
from volspec.scene import Scene, write_scene
from volspec.scene.tables.annotation import Annotation


@pytest.mark.parametrize(
    ("points", "value", "caption"),
    [
        (((0, 0, 0), (30, 40, 0)), 50.0, "50 mm"),
        (((0, 0, 0), (0, 0, 0.0123456)), 0.0123456, "12.35 µm"),
        (((1, 0, 0), (0, 0, 0), (0, 5, 0)), 90.0, "90°"),
        (((1, 0, 0), (0, 0, 0), (1, 1, 0)), 45.0, "45°"),
        (((1, 0, 0), (0, 0, 0), (2, 0, 0)), 0.0, "0°"),
    ],
)
def test_distances_and_angles(points, value, caption):
    found = Annotation(points_mm=points)
    assert found.value == pytest.approx(value, abs=1e-9) and found.caption == caption


def test_a_label_needs_a_text_and_no_number():
    assert Annotation(points_mm=((1, 2, 3),), text="valve").value is None
    with raises(SceneError, "missing", "Annotation.text"):
        Annotation(points_mm=((1, 2, 3),))
    for count in (0, 4):
        with pytest.raises(SceneError):
            Annotation(points_mm=((0.0, 0.0, 0.0),) * count, text="x")


def test_a_scene_keeps_its_annotations(tmp_path):
    scene = Scene.load(asset("data/scenes/engine.toml"))
    label = Annotation(points_mm=((1.0, 2.0, 3.0),), text="valve")
    rows = label, Annotation(points_mm=((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    saved = write_scene(replace(scene.file, annotation=rows), tmp_path / "a.toml", scene)
    assert Scene.load(saved).file.annotation == rows
