"""The version of a scene's file."""

import pytest

from tests.support.errors import raises
from tests.support.scenes import BALL, DAY, write_scene_text
from volspec.errors import SceneError
from volspec.scene import Scene
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID

TEXT = f"# A ball.{BALL}# By day.\n{DAY}"


def test_a_file_may_leave_its_version_out(tmp_path):
    text = TEXT.replace("version = 2\n", "")
    scene = Scene.load(write_scene_text(tmp_path, text))
    assert (scene.basis.name, scene.basis.grid) == ("general-7", DEFAULT_GRID)
    assert (scene.file.version, scene.relight.mode) == (2, "fitted")
    assert scene.save().read_text(encoding="utf-8") == text


def test_bands_of_a_palette_are_those_of_its_values(tmp_path):
    """Designs without ``grid_nm`` are of the papers' bands if they have 31 values."""
    for bands, grid in ((31, PAPERS_GRID), (81, DEFAULT_GRID)):
        palette = tmp_path / "design.toml"
        palette.write_text(f'[[light]]\nname = "lamp"\nvalues = {[1.0] * bands}\n')
        path = write_scene_text(tmp_path, TEXT.replace('"D65"', '"design.toml#lamp"'))
        assert Scene.load(path).basis.grid == grid


@pytest.mark.parametrize(
    ("version", "code"),
    [("3", "unsupported"), ("1", "range"), ("0", "range"), ('"1"', "range"), ("true", "range")],
)
def test_another_version_is_refused_in_one_line(tmp_path, version, code):
    path = write_scene_text(
        tmp_path, TEXT.replace("version = 2", f"version = {version}\nlater = 1")
    )
    with raises(SceneError, code, "version") as caught:
        Scene.load(path)
    assert str(path) in str(caught.value)
