"""Effects of light on materials: hidden in daylight, alike, different; the picture's menu."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.support.viewer import take_until
from tests.support.window import Robot
from volspec._gpu.sources import asset
from volspec.pipeline import raycast
from volspec.scene import Scene
from volspec.viewer.model import effects, lights, palette_results
from volspec.viewer.model.document import Document
from volspec.viewer.model.history import History
from volspec.viewer.model.light_rows import effective_weights
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.designs import DesignService
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.probe import material_at
from volspec.volume import load_volume
from volspec.wizard import TellingLight


@pytest.fixture(scope="module")
def engine() -> ViewState:
    """The engine's state, whose block and inserts are alike in daylight."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume = load_volume("engine").downsampled(4)
    return ViewState.first(Document.of(scene, volume, None), (160, 120))


@pytest.mark.not_quick
def test_daylight_is_added_where_it_is_missing(engine: ViewState) -> None:
    dark = lights.remove(engine, 0)
    assert effects.daylight_row(dark.lights) is None
    ready = effects.prepare(dark, ("inserts", "block"))
    assert ready.lights[effects.daylight_row(ready.lights)].name == "D65"
    assert ready.interface.pick.place == ("inserts", "D65")
    assert effects.prepare(engine, ("inserts",)).lights is engine.lights
    assert effects.prepare(engine, ("piston",)) is engine


@pytest.mark.not_quick
def test_a_difference_is_found_without_a_new_material(engine: ViewState) -> None:
    ready = effects.prepare(engine, ("inserts", "block"))
    found = effects.find_difference(ready)
    assert isinstance(found, TellingLight) and found.before < 1 and found.delta_e > 20
    after = effects.with_light(ready, found)
    assert after.transfer.materials == engine.transfer.materials
    told = effects.outcome(ready, after, effects.DIFFERENCE)
    assert told.telling == len(after.lights) - 1
    assert told.before == pytest.approx(told.after, abs=0.1)
    assert told.shown == pytest.approx(found.delta_e, abs=0.2)
    compared = effects.with_comparison(after, told)
    assert effective_weights(compared.lights)[-1] == 1.0 == effective_weights(compared.other)[0]


@pytest.mark.not_quick
def test_what_is_hidden_in_daylight_is_told_in_words(engine: ViewState) -> None:
    ready = effects.prepare(engine, ("inserts",))
    made = palette_results.run_wizard(ready, "hide")
    told = effects.outcome(ready, palette_results.with_wizard_result(ready, made), "hide")
    assert told.pair == ("inserts", "block")
    assert told.after < 1 and told.shown > 5
    assert effects.sentences(replace(told, before=12.34, after=0.4), engine.lights)[0] == (
        "In daylight, inserts and block: ΔE 12.3 before (obvious), 0.4 now (invisible)"
    )


@pytest.mark.not_quick
def test_a_service_ends_an_effect_in_a_comparison(engine: ViewState) -> None:
    service = DesignService(lambda: None, Notice(Trace(None)))
    ready = effects.prepare(engine, ("inserts", "block"))
    service.follow(ready)
    service.run(effects.DIFFERENCE, ready, effect=True)
    histories = [History(ready)]

    def take() -> list[History]:
        histories.append(service.take(histories[-1]))
        return [histories[-1]]

    take_until(take, lambda _: not service.busy)
    assert len(histories[-1].present.lights) == len(engine.lights) + 1
    assert len(service.status.reached) == 2
    assert histories[-1].undo().present.lights is ready.lights
    service.close()


@pytest.mark.not_quick
def test_a_pixel_s_material_is_found_whatever_the_basis(engine: ViewState) -> None:
    volume = load_volume("engine").downsampled(2)
    scene = Scene.load(asset("data/scenes/engine.toml"))
    for transfer in (scene.transfer, effects.with_material_basis(scene.transfer)):
        image = raycast(volume, transfer, scene.camera(volume), size=(64, 64), spec=scene.raycast)
        found = {material_at(image, transfer, (x, y)) for x in range(64) for y in range(64)}
        assert found == {"", "block", "inserts"}
        assert material_at(image, transfer, (0, 0)) == ""


@pytest.mark.slow
def test_a_material_is_hidden_by_two_clicks(window: Robot, tmp_path: Path) -> None:
    values = np.zeros((24, 24, 24), np.float32)
    values[4:20, 4:20, 4:20], values[8:16, 8:16, 8:16] = 0.5, 1.0
    np.save(tmp_path / "box.npy", values)
    window.open(tmp_path / "box.npy")
    x, y = window.middle("picture")
    window.do("mousemove", x, y, "sleep", "0.1", "click", "3")
    before = window.rest()
    window.click("picture hide")
    hidden = window.event("wizard", before)
    assert hidden["name"] == "hide" and "now (invisible)" in hidden["reached"][0]
    # Undone in one step; a right drag still zooms, without a menu.
    before = window.keys("ctrl+z")
    window.drag([(x, y), (x, y + 9), (x, y + 40)], button=3)
    window.rest()
    assert window.since(before, "cast")
    window.click("effect hide")
    before = window.rest()
    window.click("effect hide soft")
    window.event("wizard", before)
