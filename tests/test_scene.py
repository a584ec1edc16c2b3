"""Scene files: checked when loaded, errors name file, field and value."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from volspec import CoefficientImage, Scene
from volspec.errors import SceneError
from volspec.volume import phantom

GOOD = """
[volume]
file = "ball.npy"
[[material]]
name = "shell"
reflectance = "shell.csv"
[[material]]
name = "core"
reflectance = "copper"
[transfer]
points = [
    { value = 0.1, opacity = 0.0, material = "shell" },
    { value = 0.6, opacity = 0.4, material = { shell = 0.5, core = 0.5 } },
]
[[light]]
name = "day"
spectrum = "D65"
[output]
width = 24
height = 16
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    np.save(tmp_path / "ball.npy", phantom.ball(12).values)
    (tmp_path / "shell.csv").write_text("nm,value\n390,0.2\n710,0.8\n")
    return tmp_path


def load(folder: Path, text: str) -> Scene:
    path = folder / "scene.toml"
    path.write_text(text)
    return Scene.load(path)


def test_a_scene_casts_into_its_picture(folder: Path) -> None:
    image = load(folder, GOOD).render()
    assert isinstance(image, CoefficientImage) and image.size == (24, 16)
    assert image.alpha.max() > 0.5 and image.basis.name == "general-7"


def test_paths_are_relative_to_the_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load(folder, GOOD)
    monkeypatch.chdir("/")
    assert scene.volume().shape_xyz == (12, 12, 12)
    assert scene.materials["shell"].values[0] < 0.3


def test_a_scene_always_loads_into_the_same_picture(folder: Path) -> None:
    train = GOOD + '[basis]\ntrain = "scene"\nsize = 5\n'
    first, second = (load(folder, train).render() for _ in range(2))
    assert first.basis.name != "general-7" and first.basis.size == 5
    assert np.array_equal(first.coefficients, second.coefficients)
    assert first.basis.fingerprint == second.basis.fingerprint


def test_spacing_can_be_given_where_the_file_has_none(folder: Path) -> None:
    text = GOOD.replace('file = "ball.npy"', 'file = "ball.npy"\nspacing_mm = [1, 1, 2.5]')
    assert load(folder, text).volume().spacing_mm == (1, 1, 2.5)


def test_an_explicit_camera_is_taken(folder: Path) -> None:
    text = GOOD + "[camera]\nposition_mm = [5, -40, 5]\ntarget_mm = [5, 5, 5]\nfov_deg = 20\n"
    scene = load(folder, text)
    camera = scene.camera(scene.volume())
    assert camera.position_mm == (5, -40, 5) and camera.fov_deg == 20


CHANGES = {
    "unknown key": ("width = 24", "widht = 24", r"output\.widht: .*not permitted"),
    "unknown table": ("[output]", "[otuput]", "otuput"),
    "missing table": ("[transfer]", "[[x]]", "transfer"),
    "wrong type": ("width = 24", 'width = "wide"', r"output\.width: .*'wide'"),
    "picture of no pixels": ("width = 24", "width = 0", r"output\.width: .*it is 0"),
    "picture too large": ("width = 24", "width = 1000000000", r"output\.width"),
    "unknown light": ('"D65"', '"D56"', r"\[\[light\]\] .*D56.*D65"),
    "unknown reflectance": ('"copper"', '"cooper"', r"\[\[material\]\] .*cooper.*copper"),
    "unknown material": (
        'material = "shell"',
        'material = "shel"',
        r"\[transfer\] .*'shel'.*shell",
    ),
    "opacity": ("opacity = 0.4", "opacity = 1.4", r"\[transfer\] .*opacity 1.4"),
    "no points": ("points = [", "points = []\nx = [", "transfer"),
    "same name twice": ('name = "core"', 'name = "shell"', "two .*material.* named 'shell'"),
    "not TOML": ("[volume]", "[volume", "not valid TOML"),
    "missing volume": ("ball.npy", "bell.npy", "bell.npy: no such file"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_mistakes_are_named_in_one_line(folder: Path, change: str) -> None:
    old, new, message = CHANGES[change]
    assert old in GOOD
    with pytest.raises(Exception, match=message) as caught:
        load(folder, GOOD.replace(old, new)).render()
    assert isinstance(caught.value, ValueError) and "\n" not in str(caught.value)
    if change != "missing volume":
        assert isinstance(caught.value, SceneError) and "scene.toml" in str(caught.value)


def test_a_missing_scene_is_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"none\.toml: No such file"):
        Scene.load(tmp_path / "none.toml")


def test_basis_is_either_named_or_trained(folder: Path) -> None:
    with pytest.raises(SceneError, match="not both"):
        load(folder, GOOD + '[basis]\nname = "general-7"\ntrain = "scene"\n')
