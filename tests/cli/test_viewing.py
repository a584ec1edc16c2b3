"""Viewing options of `volspec relight`, which replace the scene's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image

from tests.support.commands import CHART, GENERAL, call
from volspec.appearance import Viewing
from volspec.appearance.presets import preset
from volspec.appearance.spaces import SPACES
from volspec.cli.viewing import PictureOptions
from volspec.errors import SceneError
from volspec.export.png import icc_profile
from volspec.raycast import CoefficientImage
from volspec.relight import RelightSpec, relight
from volspec.settings import read_table
from volspec.spectra import light

SCENE = {
    "model": "CAM16",
    "L_A": 5.0,
    "discount": True,
    "exposure": 0.5,
    "Y_b": 18.0,
    "display": {"preset": "cinema", "space": "DCI-P3", "mark": True, "L_A": 3.0},
}

OWN = read_table(RelightSpec, SCENE, SceneError)


@pytest.fixture
def chart(tmp_path: Path) -> Path:
    """The test reflectances, with the viewing of a scene."""
    chart = (0.8 * GENERAL.analyse(CHART)).astype(np.float32)
    alpha = np.full(chart.shape[:2], 0.9, np.float32)
    notes = {"viewing": json.dumps(SCENE)}
    CoefficientImage(chart, alpha, alpha, GENERAL, notes=notes).save(tmp_path / "chart.exr")
    return tmp_path / "chart.exr"


def onto(**options: object) -> Viewing:
    """The scene's viewing with options in place of what it says."""
    return PictureOptions(**options).onto(OWN).viewing


def test_what_is_left_out_is_as_in_the_scene() -> None:
    own = OWN.viewing
    assert onto() == own
    assert onto(exposure=2.0) == replace(own, exposure=2.0)
    assert onto(surround=0.1, Y_b=20.0, L_A=9.0) == replace(own, surround=0.1, Y_b=20.0, L_A=9.0)
    shown = replace(own.display, space="sRGB", gamut="reduce", mark=False)
    assert onto(space="sRGB", gamut="reduce", mark=False) == replace(own, display=shown)
    assert onto(deficiency="deutan") == replace(own, deficiency="deutan")
    mild = replace(own, deficiency="tritan", severity=0.25)
    assert onto(deficiency="tritan", severity=0.25) == mild


def test_what_says_the_same_in_the_scene_gives_way() -> None:
    own = OWN.viewing
    assert onto(lux=50.0) == replace(own, illuminance_lux=50.0, L_A=None)
    assert onto(D=0.5) == replace(own, D=0.5, discount=False)
    room = replace(preset("dim room").display("DCI-P3"), mark=True)
    assert onto(preset="dim room") == replace(own, display=room)
    half = RelightSpec(Viewing(D=0.5))
    assert PictureOptions(discount=True).onto(half).viewing == Viewing(discount=True)


def test_lux_and_L_A_go_together_where_lights_are_held_against_the_lux() -> None:
    options = PictureOptions(lux=50.0, L_A=9.0)
    viewing = options.onto(RelightSpec(level="absolute")).viewing
    assert (viewing.illuminance_lux, viewing.L_A) == (50.0, 9.0)


def test_a_frame_is_made_for_the_display_asked_for(chart: Path, tmp_path: Path) -> None:
    words = ("--space", "Display P3", "--gamut", "reduce", "--mark", "--lux", "200")
    assert call("relight", chart, "--light", "A", *words, "-o", tmp_path / "f.png") == 0
    stored = CoefficientImage.load(chart)
    viewing = onto(space="Display P3", gamut="reduce", mark=True, lux=200.0)
    expected = relight(stored, light("A"), RelightSpec(viewing, backdrop=0.2))
    assert np.array_equal(iio.imread(tmp_path / "f.png"), expected)
    with Image.open(tmp_path / "f.png") as frame:
        assert frame.info["icc_profile"] == icc_profile(SPACES[words[1]])


def test_flags_of_the_scene_can_be_taken_back(chart: Path, tmp_path: Path) -> None:
    words = ("--no-discount", "--no-mark", "--model", "CIECAM02", "-o", tmp_path / "f.png")
    assert call("relight", chart, "--light", "A", *words) == 0
    viewing = replace(onto(discount=False, mark=False), model="CIECAM02")
    expected = relight(CoefficientImage.load(chart), light("A"), viewing)
    assert np.array_equal(iio.imread(tmp_path / "f.png"), expected)
