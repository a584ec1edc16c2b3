"""The scenes after figures 2, 6 and 7 of Bergner, Drew & Möller (2009) show what those show."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

import volspec as vs
from tests.support.errors import raises
from volspec.appearance.models.lab import delta_E_2000
from volspec.errors import SceneError
from volspec.palette import load_palette
from volspec.scene.file import scene_data, scene_file
from volspec.wizard.result import displayed_Lab

DATA = Path(__file__).resolve().parents[2] / "data"
SCENES = DATA / "scenes"


def shown(scene: vs.Scene) -> dict[tuple[str, str], np.ndarray]:
    """CIELAB of every material under every light, as the frames show it."""
    return {
        (name, light.name): Lab
        for light in scene.lights
        for name, Lab in zip(scene.materials, displayed_Lab(scene, light), strict=True)
    }


def apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(delta_E_2000(one, other))


def test_figure_6_hides_the_inserts_and_the_smoke_and_keeps_the_block():
    seen = shown(vs.Scene.load(SCENES / "figure-6.toml"))
    assert apart(seen["inserts", "a"], seen["block", "a"]) < 1.0
    assert seen["smoke", "a"][0] < 1.0  # L*
    for light in ("b", "c"):
        assert apart(seen["block", light], seen["block", "a"]) < 1.0
        assert apart(seen["inserts", light], seen["block", light]) > 30.0
    assert apart(seen["inserts", "b"], seen["inserts", "c"]) < 1.0
    white, red = seen["smoke", "b"], seen["smoke", "c"]
    assert white[0] > 90.0 and np.hypot(*white[1:]) < 3.0 and red[1] > 50.0 and red[2] > 30.0


def test_figure_7_is_of_one_colour_and_then_without_a_body():
    scene = vs.Scene.load(SCENES / "figure-7.toml")
    seen = shown(scene)
    first = [seen[name, "1:0"] for name in scene.materials]
    assert max(apart(first[0], other) for other in first[1:]) < 1.0
    assert seen["body", "0:1"][0] < 1.0
    inside = [seen[name, "0:1"] for name in ("skin", "organs", "eyes")]
    assert min(apart(*pair) for pair in combinations(inside, 2)) > 25.0
    lightness = [seen["body", light.name][0] for light in scene.lights]
    assert lightness == sorted(lightness, reverse=True) and len(scene.lights) == 5


@pytest.mark.slow
def test_figure_7_casts_the_frog(volumes):
    if not (volumes / "frog.nrrd").exists():
        pytest.skip("frog.nrrd is not in the folder of the larger volumes")
    scene = vs.Scene.load(SCENES / "figure-7.toml")
    image = scene.render(vs.load_volume(volumes / "frog.nrrd"), size=(64, 64))
    whole, inside = (
        vs.relight(image, light.rig, vs.RelightSpec(scene.relight.viewing, backdrop=0.0)).mean()
        for light in (scene.lights[0], scene.lights[-1])
    )
    assert 0 < inside < 0.8 * whole


def test_figure_2_parts_one_colour_into_three_and_five():
    scene = vs.Scene.load(SCENES / "figure-2.toml")
    seen = shown(scene)
    for light, groups in (("D65", 1), ("split 1", 3), ("split 2", 5)):
        kinds: list[np.ndarray] = []
        for name in scene.materials:
            if all(apart(seen[name, light], kind) > 1.0 for kind in kinds):
                kinds.append(seen[name, light])
        assert len(kinds) == groups, light
        assert all(apart(*pair) > 10.0 for pair in combinations(kinds, 2))


def test_a_volume_that_does_not_ship_is_missed_in_one_line():
    scene = vs.Scene.load(SCENES / "figure-7.toml", {"method": "materials"})
    if (scene.folder / scene.file.volume.file).exists():
        pytest.skip("the volume has been put there")
    with raises(SceneError, "not-found", "volume"):
        scene.volume()


@pytest.mark.parametrize("name", ["figure-2-volume", "figure-6", "figure-7", "colour-vision"])
def test_a_scene_is_exposed_as_its_palette(name):
    palette = load_palette(DATA / "palettes" / f"{name}.toml")
    path = SCENES / f"{name.removesuffix('-volume')}.toml"
    assert palette.viewing == scene_file(scene_data(path), path).viewing.viewing
