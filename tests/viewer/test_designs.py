"""Designs of the palette in background threads, effects of light, results in the history."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.support.fixtures import Patch
from tests.support.patience import PATIENCE_S
from tests.support.viewer import (
    VISIBLE,
    run_command,
    take_until,
    wait_until,
    with_designed,
    with_target,
)
from tests.viewer._states import seen
from volspec._gpu.sources import asset
from volspec.appearance import Display
from volspec.appearance.display.spaces import SPACES
from volspec.basis import MaterialBasis
from volspec.errors import PaletteError
from volspec.palette import Cell, Design, Palette, design, load_palette
from volspec.pipeline import raycast
from volspec.relight import LightRig
from volspec.scene import Scene
from volspec.spectra import light, reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model import effects, lights, palette_edits, palette_results, palette_table
from volspec.viewer.model.document import Document
from volspec.viewer.model.edit import with_interface
from volspec.viewer.model.history import Difference, History
from volspec.viewer.model.light_rows import effective_weights
from volspec.viewer.model.materials import with_reflectances
from volspec.viewer.model.palette_targets import STAY, DesignTargets, Pick
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import dialogs
from volspec.viewer.ui.context import Request, UiContext
from volspec.viewer.ui.file_commands import FileCommands
from volspec.viewer.work import designs
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.probe import material_at
from volspec.viewer.work.session_store import STATE_VARIABLE
from volspec.viewer.work.time_steps import TimeSteps
from volspec.volume import load_volume
from volspec.wizard import DiscriminatingLight

FIGURE_2 = Path(__file__).resolve().parents[2] / "data" / "palettes" / "figure-2.toml"


def job_of(asked: ViewState) -> designs.DesignJob:
    return designs.DesignJob(palette_table.palette_from_state(asked), asked.palette.targets)


def answers(*asked: ViewState) -> list[designs.DesignDone]:
    """Return the designs of targets requested at once, up to the last one's."""
    worker = designs.DesignWorker(lambda: None)
    with worker._changed:  # however slow this thread is
        for each in asked:
            worker.request(job_of(each))
    last = asked[-1].palette.targets
    done = take_until(worker.take, lambda d: any(x.is_last and x.job.targets is last for x in d))
    worker.close()
    return done


def test_a_wish_that_can_be_met_is_met(state):
    made = with_designed(with_target(state, 5))
    assert max(palette_table.colour_table(made).errors) < VISIBLE
    values = made.transfer.materials["gold"].values
    assert values.min() >= 0.0 and values.max() <= 1.0
    assert made.transfer.materials["copper"] is state.transfer.materials["copper"]


def test_a_wish_that_cannot_be_met_is_missed(state):
    """No reflectance is saturated blue under tungsten light and saturated red under daylight."""
    asked = with_target(with_target(state, 5, "#0000ff"), 4, "#ff0000")
    errors = palette_table.colour_table(with_designed(asked)).errors
    assert len(errors) == 2 and max(errors) > 5


@pytest.mark.slow
@pytest.mark.not_quick
def test_five_colours_that_merge_to_three_and_one_are_designed(state):
    """Figure 2's targets, of a scene with as many materials and no such lights."""
    grey = dict.fromkeys("abcde", reflectance("ColorChecker/neutral 5 (.70 D)"))
    transfer = TransferFunction([(0.2, 0.0, "a"), (0.5, 0.2, "b")], grey, MaterialBasis(grey))
    empty = replace(state, transfer=transfer, lights=state.lights[:1])
    begun = palette_results.with_palette(empty, load_palette(FIGURE_2))
    assert palette_table.column_names(begun.lights) == ("D65", "split 1", "split 2")
    assert begun.palette.is_pending and begun.palette.from_scratch
    made = palette_table.with_design(begun, answers(begun)[-1].design, begun.palette.targets)
    table = palette_table.colour_table(made)
    assert not made.palette.is_pending
    assert len(table.errors) == 15 and max(table.errors) < VISIBLE
    assert all(row.rig.lights[0].values.min() >= 0 for row in made.lights)
    assert Difference.between(begun, made).stage == "relight"


def test_a_light_of_real_lamps_is_a_sum_of_them(state):
    asked = palette_edits.toggle_lamp(with_target(state, 6), 2, "A")
    asked = palette_edits.toggle_lamp(asked, 2, "D65")
    assert asked.palette.targets.lamps == {"FL2": ("A", "D65")}
    values = with_designed(asked).lights[2].rig.lights[0].values
    lamps = np.stack([light(name).values for name in ("A", "D65")], axis=1)
    shares, *_ = np.linalg.lstsq(lamps, values, rcond=None)
    # Everything besides the two lamps is rounding.
    np.testing.assert_allclose(lamps @ shares, values, atol=1e-6 * values.max())
    assert shares.min() > -1e-6


def test_the_latest_wish_wins_and_is_answered_quickly_then_well(state):
    first, last = with_target(state, 5), with_target(state, 5, "#906050")
    done = answers(first, last)
    of_first, of_last = (
        [each.is_last for each in done if each.job.targets is asked.palette.targets]
        for asked in (first, last)
    )
    assert not any(of_first) and of_last == [False, True]
    made = palette_table.with_design(last, done[-1].design, last.palette.targets)
    assert max(palette_table.colour_table(made).errors) < VISIBLE


def test_what_contradicts_itself_is_named(state):
    for index, colour in ((4, "#ff0000"), (5, "#0000ff")):
        state = palette_edits.set_target_weight(with_target(state, index, colour), index, None)
    done = answers(state)
    assert done[0].design is None and done[0].is_last and "gold" in done[0].error


def test_advice_is_about_wishes_alone():
    targets = DesignTargets({("a", "D65"): Cell(colour=(0, 0, 0), weight=STAY)})
    advice = ("(a, D65): weight 1 …", "(a, A): weight 4 …", "rounds 12 …")
    assert designs.relevant_advice(advice, targets) == advice[1:]


# A state, an event that lets its wizard end, and the states that the wizard began with.
Hiding = tuple[ViewState, threading.Event, list[ViewState]]


class Bench:
    """A `DesignService` without a window."""

    def __init__(self) -> None:
        self.notice = Notice()
        self.designs = designs.DesignService(lambda: None, self.notice)

    def until(self, history: History, ended: Callable[[History], bool]) -> History:
        def done() -> bool:
            nonlocal history
            history = self.designs.take(history)
            return ended(history)

        wait_until(done)
        return history


def test_designs_outlive_a_failed_solver(state, monkeypatch):
    fails = iter((True,))

    def once(palette: Palette, *, again: bool) -> Design:
        if next(fails, False):
            raise np.linalg.LinAlgError("SVD did not converge")
        return design(palette)

    monkeypatch.setattr(designs, "design", once)
    told = threading.Semaphore(0)
    worker = designs.DesignWorker(told.release)
    for colour in ("#8c5a3c", "#906050"):
        worker.request(job_of(with_target(state, 5, colour)))
        assert told.acquire(timeout=PATIENCE_S)
    done = worker.take()
    worker.close()
    assert done[0].is_last and "SVD" in done[0].error
    assert done[1].design is not None


def test_closing_waits_for_no_design(state, monkeypatch):
    begun, may_end, ended = (threading.Event() for _ in range(3))

    def long(_: Palette, *, again: bool) -> Design:
        begun.set()
        may_end.wait(PATIENCE_S)
        ended.set()
        raise PaletteError("ended")

    monkeypatch.setattr(designs, "design", long)
    worker = designs.DesignWorker(lambda: None)
    worker.request(job_of(with_target(state, 5)))
    assert begun.wait(PATIENCE_S)
    worker.close(0.0)
    assert not ended.is_set()
    may_end.set()


def test_wishes_that_were_answered_are_designed_again_from_scratch(state):
    bench, asked = Bench(), with_target(state, 5)
    bench.designs.follow(asked)
    history = bench.until(History(asked), lambda h: not bench.designs.status.busy)
    anew = run_command(history.present, "palette-restart").state
    assert anew.palette.is_pending
    bench.designs.follow(anew)
    assert bench.designs.status.busy == "Designing …"
    bench.until(History(anew), lambda h: not h.present.palette.is_pending)
    bench.designs.close()


@pytest.fixture
def hiding(state: ViewState, monkeypatch: Patch) -> Hiding:
    """A state in which gold is to be hidden, whose wizard ends when it may."""
    begun = with_interface(state, pick=Pick(place=("gold", "A")))
    result, may_end = palette_results.run_wizard(begun, "hide"), threading.Event()
    began_with: list[ViewState] = []

    def run(state: ViewState, _: str) -> object:
        began_with.append(state)
        assert may_end.wait(PATIENCE_S)
        return result

    monkeypatch.setattr(palette_results, "run_wizard", run)
    return begun, may_end, began_with


@pytest.mark.parametrize("other", [True, False])
def test_a_wizard_result_needs_its_materials(state, hiding, other):
    begun, may_end, _ = hiding
    bench = Bench()
    bench.designs.follow(begun)
    bench.designs.run("hide", begun)
    bench.designs.take(History(begun))
    bench.designs.forget()  # as undo does
    assert bench.designs.status.busy.startswith("Hiding gold")
    silver = with_reflectances(state.transfer, {"gold": reflectance("silver")})
    history = History(replace(begun, transfer=silver) if other else begun)
    may_end.set()
    after = bench.until(history, lambda h: not bench.designs.status.busy)
    assert (after.present is history.present) == other
    assert bool(bench.designs.status.complaint) == bool(bench.notice.text) == other


def test_a_wizard_waits_for_the_running_design(hiding, monkeypatch):
    """The design began at once, and was dropped when the last pass changed the materials."""
    picked, may_end, began_with = hiding
    monkeypatch.setattr(
        designs,
        "design",
        lambda palette, again: (may_end.wait(PATIENCE_S), design(palette, again=again))[1],
    )
    bench, begun = Bench(), with_target(picked, 5)
    bench.designs.follow(begun)
    bench.designs.run("hide", begun)
    history = bench.designs.take(History(begun))
    assert not began_with and bench.designs.status.busy.startswith("Hiding gold")
    # DesignTargets that come later are designed after it.
    bench.designs.follow(with_target(history.present, 5, "#906050"))
    may_end.set()
    history = bench.until(history, lambda h: not bench.designs.status.busy)
    assert began_with[0].transfer is not begun.transfer
    assert "discarded" not in bench.notice.text + bench.designs.status.complaint
    assert history.past[-1] is began_with[0] and history.present.transfer is not begun.transfer
    bench.designs.close()


def test_the_scene_s_own_spectra_are_its_lights_too(state):
    drawn = replace(state.lights[1], rig=LightRig((light("D65"),)))
    changed = replace(state, lights=(state.lights[0], drawn, *state.lights[2:]))
    own = run_command(changed, "palette-own").state
    assert own.lights is state.document.lights and own.transfer is state.transfer
    # Which light shines is no spectrum.
    lit = replace(state, lights=tuple(replace(row, weight=1.0) for row in state.lights))
    assert run_command(lit, "palette-own").state.lights is lit.lights


@pytest.fixture
def files(tmp_path: Path, monkeypatch: Patch) -> tuple[Bench, FileCommands]:
    """Commands on files, with our own dialogs, whose palettes a bench designs."""
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr(dialogs, "has_native_dialogs", lambda: False)
    bench = Bench()
    steps = TimeSteps(lambda: None, bench.notice)
    rest = (UiContext(), bench.notice, None, None, bench.designs.file, steps)
    return bench, FileCommands(Tasks(lambda: None), cast(Any, None), *rest)


def answer(files: FileCommands, patched: Patch, name: str, path: str, state: ViewState) -> None:
    """Run a command whose dialog is answered with a path."""
    files.run(Request(name), state)
    patched.setattr(dialogs.FileDialogs, "take", lambda _: (dialogs.REQUESTS[name], path))
    files.take(first=False)


def test_the_dialog_s_path_goes_to_the_design(state, files, monkeypatch, tmp_path):
    (bench, commands), path = files, str(tmp_path / "mine.toml")
    asked = with_target(state, 5)
    answer(commands, monkeypatch, "palette-save", path, asked)
    history = bench.until(History(asked), lambda _: bench.notice.text == f"Saved {path}")
    answer(commands, monkeypatch, "palette-load", path, asked)
    history = bench.until(history, lambda h: len(h.past) == 1)
    assert load_palette(path).cells == history.present.palette.targets.cells


def test_requested_files_are_there_when_the_window_has_closed(
    state, files, closing, monkeypatch, tmp_path
):
    def late(_: object, path: str) -> None:
        assert closing.wait(PATIENCE_S)
        Path(path).touch()

    bench, commands = files
    monkeypatch.setattr("volspec.viewer.ui.file_commands.export_scene", late)
    monkeypatch.setattr(designs, "save_palette", late)
    for name in ("export-scene", "palette-save"):
        answer(commands, monkeypatch, name, str(tmp_path / name), with_target(state, 5))
    commands.close(None, faulty=True)
    bench.designs.close()
    assert (tmp_path / "export-scene").exists() and (tmp_path / "palette-save").exists()


def test_wizards_and_palettes_know_the_display_and_the_model(state):
    wall = replace(SPACES["Display P3"], name="the wall", white_xy=(0.32, 0.34))
    scene = palette_results.wizard_scene(seen(state, display=Display(space=wall)))
    assert scene.relight.viewing.display.colours == wall
    # A model without pixels measures the picture.
    palette = load_palette(FIGURE_2)
    palette = replace(palette, viewing=replace(palette.viewing, model="CAT02"))
    by_pixel = seen(state, model="CAM16", adapting="pixel")
    found = palette_results.with_palette(by_pixel, palette).relight.viewing
    assert (found.model, found.adapting) == ("CAT02", "picture")


@pytest.fixture(scope="module")
def engine() -> ViewState:
    """The engine's state, whose block and inserts are alike in daylight."""
    scene = Scene.load(asset("data/scenes/engine.toml"))
    volume = load_volume("engine").downsampled(4)
    return ViewState.first(Document.of(scene, volume, None), (160, 120))


@pytest.mark.not_quick
def test_daylight_is_added_where_it_is_missing(engine):
    dark = lights.remove(engine, 0)
    assert effects.daylight_row(dark.lights) is None
    ready = effects.prepare(dark, ("inserts", "block"))
    assert ready.lights[effects.daylight_row(ready.lights)].name == "D65"
    assert ready.interface.pick.place == ("inserts", "D65")
    assert effects.prepare(engine, ("inserts",)).lights is engine.lights
    assert effects.prepare(engine, ("piston",)) is engine


@pytest.mark.not_quick
def test_a_difference_is_found_without_a_new_material(engine):
    ready = effects.prepare(engine, ("inserts", "block"))
    found = effects.find_difference(ready)
    assert isinstance(found, DiscriminatingLight) and found.before < 1 and found.delta_e > 20
    after = effects.with_light(ready, found)
    assert after.transfer.materials == engine.transfer.materials
    told = effects.outcome(ready, after, effects.DIFFERENCE)
    assert told.telling == len(after.lights) - 1
    assert told.before == pytest.approx(told.after, abs=0.1)
    assert told.revealed == pytest.approx(found.delta_e, abs=0.2)
    compared = effects.with_comparison(after, told)
    assert effective_weights(compared.lights)[-1] == 1.0 == effective_weights(compared.other)[0]


@pytest.mark.not_quick
def test_what_is_hidden_in_daylight_is_told_in_words(engine):
    ready = effects.prepare(engine, ("inserts",))
    made = palette_results.run_wizard(ready, "hide")
    told = effects.outcome(ready, palette_results.with_wizard_result(ready, made), "hide")
    assert told.pair == ("inserts", "block")
    assert told.after < 1 and told.revealed > 5
    assert effects.sentences(replace(told, before=12.34, after=0.4), engine.lights)[0] == (
        "In daylight, inserts and block: ΔE 12.3 before (obvious), 0.4 now (invisible)"
    )


@pytest.mark.not_quick
def test_a_service_ends_an_effect_in_a_comparison(engine):
    service = designs.DesignService(lambda: None, Notice(Trace(None)))
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
def test_a_pixel_s_material_is_found_whatever_the_basis(engine):
    volume = load_volume("engine").downsampled(2)
    scene = Scene.load(asset("data/scenes/engine.toml"))
    for transfer in (scene.transfer, effects.with_material_basis(scene.transfer)):
        image = raycast(volume, transfer, scene.camera(volume), size=(64, 64), spec=scene.raycast)
        found = {material_at(image, transfer, (x, y)) for x in range(64) for y in range(64)}
        assert found == {"", "block", "inserts"}
        assert material_at(image, transfer, (0, 0)) == ""


@pytest.mark.slow
def test_a_material_is_hidden_by_two_clicks(window, tmp_path):
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
