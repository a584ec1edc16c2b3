"""Lights that show something: of a search, and those that come with a volume alone."""

import numpy as np
import pytest

from volspec._gpu.sources import asset
from volspec.appearance.models.lab import delta_E_2000
from volspec.scene import Scene
from volspec.spectra import DEFAULT_GRID, colour_matching_functions, light
from volspec.transfer.presets import PRESETS
from volspec.volume import phantom
from volspec.wizard import show_difference
from volspec.wizard.discriminating_lights import white_from_leds
from volspec.wizard.result import displayed_Lab


def chromaticity(text: str) -> np.ndarray:
    XYZ = colour_matching_functions(DEFAULT_GRID) @ light(text).values
    return XYZ[:2] / XYZ.sum()


def test_mixtures_of_leds_are_as_white_as_daylight():
    texts = white_from_leds(DEFAULT_GRID)
    assert len(texts) > 50
    for text in texts:
        assert np.abs(chromaticity(text) - chromaticity("D65")).max() < 1e-3


@pytest.mark.parametrize("preset", [preset.name for preset in PRESETS if preset.name != "grey"])
def test_a_volume_s_own_lights_show_something_on_every_preset(preset):
    """A, FL2 and HP1 change the colours of most presets by ΔE 2 to 6."""
    scene = Scene.from_volume("ball", preset=preset, volume=phantom.ball(16))
    looks = {row.name: displayed_Lab(scene, row) for row in scene.lights}
    changes = {name: delta_E_2000(looks["D65"], Lab).mean() for name, Lab in looks.items()}
    whites = [name for name in looks if name.startswith("LEDs")]
    for name in whites:
        assert np.abs(chromaticity(str(scene.file.light[list(looks).index(name)].spectrum))
                      - chromaticity("D65")).max() < 2e-3  # fmt: skip
    best = max(changes[name] for name in whites)
    assert best > 8 and best > 2 * changes["A"]


def test_the_difference_of_metamers_is_found():
    scene = Scene.load(asset("data/scenes/engine.toml"))
    found = show_difference(scene, "block", "inserts", under="D65")
    assert found.before < 1 and found.delta_e > 20
    assert light(found.text, scene.basis.grid).values.min() >= 0
