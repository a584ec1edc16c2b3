"""Designs of the palette: targets met and missed, by the worker, of lamps, of a figure."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.viewer.test_palette import SEEN, designed, wished
from volspec.basis import MaterialBasis
from volspec.palette import Cell, load_palette
from volspec.spectra import light, reflectance
from volspec.transfer import TransferFunction
from volspec.viewer.model import palette_edits, palette_files
from volspec.viewer.model.history import Difference
from volspec.viewer.model.palette_table import column_names, palette_of, table_of, with_design
from volspec.viewer.model.palette_targets import STAY, DesignTargets
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui.palette_cells import cell_lines
from volspec.viewer.ui.palette_panel import summary
from volspec.viewer.work.designs import DesignDone, DesignJob, DesignWorker, advice_of

PALETTES = Path(__file__).resolve().parents[2] / "data" / "palettes"


def answers(*asked: ViewState) -> list[DesignDone]:
    """Return the designs of targets requested at once, up to the last one's."""
    worker = DesignWorker(lambda: None)
    for each in asked:
        worker.request(DesignJob(palette_of(each), each.palette.targets))
    done: list[DesignDone] = []
    end = time.time() + 20
    while time.time() < end and not any(
        each.whole and each.job.targets is asked[-1].palette.targets for each in done
    ):
        done += worker.take()
        time.sleep(0.005)
    worker.close()
    return done


def test_a_wish_that_can_be_met_is_met(state: ViewState) -> None:
    made = designed(wished(state, 5))
    table = table_of(made)
    assert max(table.errors) < SEEN
    assert "All met" in summary(table)
    values = made.transfer.materials["gold"].values
    assert values.min() >= 0.0 and values.max() <= 1.0
    assert made.transfer.materials["copper"] is state.transfer.materials["copper"]


def test_a_wish_that_cannot_be_met_is_flagged(state: ViewState) -> None:
    """No reflectance is saturated blue under tungsten light and saturated red under daylight."""
    asked = wished(wished(state, 5, "#0000ff"), 4, "#ff0000")
    table = table_of(designed(asked))
    assert max(table.errors) > 5 and "2 of 2 missed" in summary(table)
    cell, target = table.cells["gold", "A"], asked.palette.targets.cells["gold", "A"]
    assert "cannot be told apart" in cell_lines(cell, target)


def test_five_colours_that_merge_to_three_and_one_are_designed(state: ViewState) -> None:
    """Figure 2's targets, of a scene with as many materials and no such lights."""
    names = ("a", "b", "c", "d", "e")
    grey = {name: reflectance("ColorChecker/neutral 5 (.70 D)") for name in names}
    transfer = TransferFunction([(0.2, 0.0, "a"), (0.5, 0.2, "b")], grey, MaterialBasis(grey))
    empty = replace(state, transfer=transfer, lights=state.lights[:1])
    palette = load_palette(PALETTES / "figure-2.toml")
    begun = palette_files.with_palette(empty, palette)
    assert column_names(begun.lights) == ("D65", "split 1", "split 2")
    assert begun.palette.is_pending and begun.palette.from_scratch
    found = answers(begun)[-1].made
    assert found is not None
    made = with_design(begun, found, begun.palette.targets)
    table = table_of(made)
    assert not made.palette.is_pending
    assert len(table.errors) == 15 and max(table.errors) < SEEN
    assert len({summary(table), summary(table_of(begun))}) == 2
    assert all(row.rig.lights[0].values.min() >= 0 for row in made.lights)
    assert Difference.between(begun, made).stage == "relight"


def test_a_light_of_real_lamps_is_a_sum_of_them(state: ViewState) -> None:
    asked = palette_edits.toggle_lamp(wished(state, 6), 2, "A")
    asked = palette_edits.toggle_lamp(asked, 2, "D65")
    assert asked.palette.targets.lamps == {"FL2": ("A", "D65")}
    made = designed(asked)
    values = made.lights[2].rig.lights[0].values
    lamps = np.stack([light(name).values for name in ("A", "D65")], axis=1)
    shares, *_ = np.linalg.lstsq(lamps, values, rcond=None)
    # What the solver leaves beside the two lamps is rounding.
    np.testing.assert_allclose(lamps @ shares, values, atol=1e-6 * values.max())
    assert shares.min() > -1e-6


def test_the_latest_wish_wins_and_is_answered_quickly_then_well(state: ViewState) -> None:
    first, last = wished(state, 5), wished(state, 5, "#906050")
    done = answers(first, last)
    assert [each.whole for each in done if each.job.targets is last.palette.targets] == [
        False,
        True,
    ]
    assert not any(each.whole for each in done if each.job.targets is first.palette.targets)
    made = done[-1].made
    assert made is not None
    assert max(table_of(with_design(last, made, last.palette.targets)).errors) < SEEN


def test_what_contradicts_itself_is_refused_in_words(state: ViewState) -> None:
    asked = state
    for index, colour in ((4, "#ff0000"), (5, "#0000ff")):
        asked = wished(asked, index, colour)
        asked = palette_edits.set_target_weight(asked, index, None)
    done = answers(asked)
    assert done[0].made is None and done[0].whole and "gold" in done[0].error


def test_advice_is_about_wishes_alone() -> None:
    targets = DesignTargets({("a", "D65"): Cell(colour=(0, 0, 0), weight=STAY)})
    advice = ("(a, D65): weight 1 …", "(a, A): weight 4 …", "rounds 12 …")
    assert advice_of(advice, targets) == advice[1:]
