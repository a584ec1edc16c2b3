"""docs/scenes.md and the scenes that ship: every key with its default, every example a scene."""

import re
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.fixtures import slow_each

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs" / "scenes.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the examples: next to data/, with the segmentation that the text makes."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "data").symlink_to(ROOT / "data")
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(code, {})
    return folder


@pytest.mark.not_quick
# Each feature is cast by tests of its own, too.
@pytest.mark.parametrize("number", [0, *slow_each(*range(1, len(EXAMPLES)))])
def test_every_example_casts_into_a_picture(folder, number):
    path = folder / "example.toml"
    path.write_text(EXAMPLES[number], encoding="utf-8")
    scene = vs.Scene.load(path)
    image = scene.render(size=(48, 48))
    assert image.alpha.max() > 0.5
    with vs.Relighter(image) as relighter:
        frame = relighter.frame(scene.lights[0].rig, scene.relight.viewing)
    assert frame.std() > 5


@pytest.mark.not_quick
def test_every_example_is_a_scene_and_each_kind_of_transfer_function_has_one(folder):
    kinds = set()
    for text in EXAMPLES:
        (folder / "kind.toml").write_text(text, encoding="utf-8")
        kinds.add(type(vs.Scene.load(folder / "kind.toml").transfer))
    own = {vs.TransferFunction, vs.TransferFunction2D, vs.LabelFunction, vs.Isosurfaces}
    assert kinds == own | {vs.FieldFunctions}


ENGINE, *SCENES = sorted((ROOT / "data" / "scenes").glob("engine*.toml"), key=lambda p: p.stem)


@pytest.mark.not_quick
# Not the figure-… scenes, where some lights hide what is there.
@pytest.mark.parametrize("path", [ENGINE, *slow_each(*SCENES)], ids=lambda path: path.stem)
def test_scenes_that_ship_are_neither_dark_nor_washed_out(path):
    scene = vs.Scene.load(path)
    image = scene.render(size=(128, 128))
    viewing, relit = scene.relight.viewing, scene.relight
    with vs.Relighter(image) as relighter:
        for light in scene.lights:
            frame = relighter.frame(light.rig, vs.RelightSpec(viewing, relit.mode, relit.backdrop))
            shown = frame[image.alpha > 0.5]
            assert 60 < shown.mean() < 190, light.name
            assert np.mean(shown == 255) < 0.02, light.name
            assert shown.std() > 12, light.name
