"""What threads bring to a palette: where it lands, where it does not, and what is said of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from volspec.appearance import Display
from volspec.appearance.spaces import SPACES
from volspec.errors import PaletteError
from volspec.palette import Design, Palette, PaletteSpectrum, design, load_palette
from volspec.relight import LightRig
from volspec.spectra import light, reflectance
from volspec.viewer.model import palette_edits, palette_files, palette_wizards
from volspec.viewer.model.commands import BY_NAME
from volspec.viewer.model.edit import after
from volspec.viewer.model.history import History
from volspec.viewer.model.light_rows import MOST_ROWS
from volspec.viewer.model.materials import with_reflectances
from volspec.viewer.model.palette_table import palette_of
from volspec.viewer.model.palette_targets import Pick
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import dialogs
from volspec.viewer.ui.context import UiContext
from volspec.viewer.ui.dialogs import REQUESTS, FileDialogs
from volspec.viewer.ui.file_commands import FileCommands
from volspec.viewer.work import designs
from volspec.viewer.work.background import Tasks
from volspec.viewer.work.designs import DesignJob, DesignService, DesignWorker
from volspec.viewer.work.notify import Notice, Trace
from volspec.viewer.work.session_store import STATE_VARIABLE

PALETTES = Path(__file__).resolve().parents[2] / "data" / "palettes"


class Bench:
    """A `DesignService` without a window."""

    def __init__(self) -> None:
        self.notice = Notice()
        self.designs = DesignService(lambda: None, self.notice, Trace())

    def until(self, history: History, ended: Callable[[History], bool]) -> History:
        end = time.time() + 20
        while time.time() < end and not ended(history):
            history = self.designs.taken(history)
            time.sleep(0.005)
        assert ended(history)
        return history


def wished(state: ViewState, colour: str = "#8c5a3c") -> ViewState:
    return palette_edits.set_target(state, 5, colour)


def acted(name: str, state: ViewState) -> ViewState:
    change = BY_NAME[name].change
    assert change is not None
    return after(change, state).state


def test_a_solver_that_fails_is_told_and_the_next_wish_designed(
    state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    fails = iter((True,))

    def once(palette: Palette) -> Design:
        if next(fails, False):
            raise np.linalg.LinAlgError("SVD did not converge")
        return design(palette)

    monkeypatch.setattr(designs, "design", once)
    told = threading.Semaphore(0)
    worker = DesignWorker(told.release)
    for colour in ("#8c5a3c", "#906050"):
        asked = wished(state, colour)
        worker.request(DesignJob(palette_of(asked), asked.palette.targets))
        assert told.acquire(timeout=20)
    done = worker.take()
    worker.close()
    assert done[0].whole and "SVD did not converge" in done[0].error
    assert done[1].made is not None


def test_closing_does_not_wait_for_a_design(
    state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, may_end = threading.Event(), threading.Event()

    def long(_: Palette) -> Design:
        begun.set()
        may_end.wait(20)
        raise PaletteError("ended")

    monkeypatch.setattr(designs, "design", long)
    worker, asked = DesignWorker(lambda: None), wished(state)
    worker.request(DesignJob(palette_of(asked), asked.palette.targets))
    assert begun.wait(20)
    started = time.perf_counter()
    worker.close(0.1)
    took = time.perf_counter() - started
    may_end.set()
    # It waits 0.1 s; a slow machine gets as much as is still far from the design's 20 s.
    assert took < 5.0


def test_wishes_that_were_answered_are_designed_again_from_scratch(state: ViewState) -> None:
    bench, asked = Bench(), wished(state)
    bench.designs.follow(asked)
    history = bench.until(History(asked), lambda h: not bench.designs.status.busy)
    anew = acted("palette-anew", history.present)
    assert anew.palette.is_pending
    bench.designs.follow(anew)
    assert bench.designs.status.busy == "Designing …"
    bench.until(History(anew), lambda h: not h.present.palette.is_pending)
    bench.designs.close()


@pytest.mark.parametrize("other", [True, False])
def test_a_wizard_s_result_lands_on_the_materials_it_began_with_alone(
    state: ViewState, monkeypatch: pytest.MonkeyPatch, other: bool
) -> None:
    pick = Pick(place=("gold", "A"))
    begun = replace(state, interface=replace(state.interface, pick=pick))
    result, may_end = palette_wizards.run_wizard(begun, "hide"), threading.Event()
    monkeypatch.setattr(designs, "run_wizard", lambda *_: (may_end.wait(20), result)[1])
    bench = Bench()
    bench.designs.follow(begun)
    bench.designs.do("hide", begun)
    bench.designs.taken(History(begun))
    bench.designs.forget()  # as undo does
    assert bench.designs.status.busy.startswith("Hiding gold")
    silver = with_reflectances(state.transfer, {"gold": reflectance("silver")})
    history = History(replace(begun, transfer=silver) if other else begun)
    may_end.set()
    after = bench.until(history, lambda h: not bench.designs.status.busy)
    assert (after.present is history.present) == other
    assert ("dropped: the materials changed" in bench.designs.status.complaint) == other
    assert ("dropped: the materials changed" in bench.notice.text) == other


def test_a_wizard_waits_for_the_design_under_way_and_lands_on_what_it_brings(
    state: ViewState, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It began at once, and was dropped when the design's last pass changed the materials."""
    pick = Pick(place=("gold", "A"))
    begun = wished(replace(state, interface=replace(state.interface, pick=pick)))
    result, may_end = palette_wizards.run_wizard(begun, "hide"), threading.Event()
    monkeypatch.setattr(designs, "design", lambda palette: (may_end.wait(20), design(palette))[1])
    began_with: list[ViewState] = []
    monkeypatch.setattr(
        designs, "run_wizard", lambda state, _: (began_with.append(state), result)[1]
    )
    bench = Bench()
    bench.designs.follow(begun)
    bench.designs.do("hide", begun)
    history = bench.designs.taken(History(begun))
    assert not began_with and bench.designs.status.busy.startswith("Hiding gold")
    # DesignTargets that come later are designed after it.
    later = wished(history.present, "#906050")
    bench.designs.follow(later)
    may_end.set()
    history = bench.until(history, lambda h: not bench.designs.status.busy)
    assert began_with[0].transfer is not begun.transfer
    assert "dropped" not in bench.notice.text + bench.designs.status.complaint
    assert history.past[-1] is began_with[0] and history.present.transfer is not begun.transfer
    bench.designs.close()


def test_the_scene_s_own_spectra_are_its_lights_too(state: ViewState) -> None:
    drawn = replace(state.lights[1], rig=LightRig((light("D65"),)))
    changed = replace(state, lights=(state.lights[0], drawn, *state.lights[2:]))
    own = acted("palette-own", changed)
    assert own.lights is state.document.lights and own.transfer is state.transfer
    # Which light shines is no spectrum.
    weights = tuple(replace(row, weight=1.0) for row in state.lights)
    assert acted("palette-own", replace(state, lights=weights)).lights is weights


def test_a_palette_s_path_goes_from_the_one_dialog_to_the_design(
    state: ViewState, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr(dialogs, "has_native_dialogs", lambda: False)
    path, bench, asked = str(tmp_path / "mine.toml"), Bench(), wished(state)
    rest = (UiContext(), bench.notice, Trace(), None, None)
    file_commands = FileCommands(Tasks(lambda: None), cast(Any, None), *rest, bench.designs.file)
    history = History(asked)
    for name in ("palette-save", "palette-load"):
        assert name not in bench.designs.asks
        file_commands.do(name, asked)
        monkeypatch.setattr(FileDialogs, "take", lambda _, request=REQUESTS[name]: (request, path))
        file_commands.take(first=False)
        ends = {"palette-save": lambda h: bench.notice.text == f"Saved {path}"}
        history = bench.until(history, ends.get(name, lambda h: len(h.past) == 1))
    assert load_palette(path).cells == history.present.palette.targets.cells


def test_files_asked_for_are_there_when_the_window_has_closed(
    state: ViewState, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def slow(_: object, path: str) -> None:
        time.sleep(0.05)
        Path(path).touch()

    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr("volspec.viewer.ui.file_commands.export_scene", slow)
    monkeypatch.setattr(designs, "save_palette", slow)
    scene, palette, bench = tmp_path / "scene.toml", tmp_path / "palette.toml", Bench()
    rest = (UiContext(), bench.notice, Trace(), None, None)
    file_commands = FileCommands(Tasks(lambda: None), cast(Any, None), *rest, bench.designs.file)
    for name, path in (("export-scene", scene), ("palette-save", palette)):
        answer = REQUESTS[name], str(path)
        monkeypatch.setattr(FileDialogs, "take", lambda _, answer=answer: answer)
        file_commands.do("say", wished(state))
        file_commands.take(first=False)
    file_commands.close(None, faulty=True)
    bench.designs.close()
    assert scene.exists() and palette.exists()


def test_a_display_s_own_space_is_known_to_wizards(state: ViewState) -> None:
    wall = replace(SPACES["Display P3"], name="the wall", white_xy=(0.32, 0.34))
    viewing = replace(state.relight.viewing, display=Display(space=wall))
    scene = palette_wizards.scene_of(
        replace(state, relight=replace(state.relight, viewing=viewing))
    )
    assert scene.relight.viewing.display.colours == wall


def test_a_palette_s_model_that_cannot_adapt_to_pixels_measures_the_picture(
    state: ViewState,
) -> None:
    palette = load_palette(PALETTES / "figure-2.toml")
    palette = replace(palette, viewing=replace(palette.viewing, model="CAT02"))
    eye = replace(state.relight.viewing, model="CAM16", adapting="pixel")
    loaded = palette_files.with_palette(
        replace(state, relight=replace(state.relight, viewing=eye)), palette
    )
    found = loaded.relight.viewing
    assert (found.model, found.adapting) == ("CAT02", "picture")


def test_a_palette_whose_lights_find_no_room_is_refused(state: ViewState) -> None:
    palette = load_palette(PALETTES / "figure-2.toml")
    many = tuple(PaletteSpectrum(f"lamp {n}", light("A")) for n in range(MOST_ROWS))
    crowded = replace(palette, lights=(*palette.lights, *many))
    with pytest.raises(PaletteError, match=f"no room for light .*{MOST_ROWS} lights are the most"):
        palette_files.with_palette(state, crowded)
