"""Designs and wizards in the background, and their results in the history.

    state -> [designs] -> Design -> History

Each target is designed twice: a quick preview from the current spectra, then a full design unless
another target follows. The result belongs to the step that set the target, so that undo reverts
both; a wizard's result is a step of its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from volspec.errors import PaletteError, VolspecError, one_line
from volspec.palette import (
    VISIBLE,
    Design,
    Palette,
    design,
    load_palette,
    save_palette,
    suggestions,
)
from volspec.viewer.model import effects, palette_results, palette_table
from volspec.viewer.model.history import History
from volspec.viewer.model.palette_targets import DesignStatus, DesignTargets, stays
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker, Outcome, Tasks
from volspec.viewer.work.notify import Notice
from volspec.wizard import DiscriminatingLight, Redesigned

# Iterations of the quick design: starting from the last result, they come within about ΔE 1. With
# free lights an iteration takes several times as long.
QUICK, QUICK_LIGHTS = 2, 1
# The full design begins after this time without another target.
REST_S = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class DesignJob:
    """Palette to design."""

    palette: Palette
    targets: DesignTargets  # the targets that the palette was made for
    number: int = 0  # of the `DesignService`'s state; results of an earlier one are dropped


@dataclass(frozen=True, slots=True, eq=False)
class DesignDone:
    """Result of one design of a job."""

    job: DesignJob
    ms: float
    design: Design | None  # None if it failed
    is_last: bool  # this was the last design of the job
    error: str  # message if it failed


class DesignWorker(LatestWorker[DesignJob, DesignDone]):
    """Thread for designs, quick and in full; a newer job replaces the full one."""

    _name = "volspec-design"

    def _results(self, job: DesignJob) -> Iterator[DesignDone]:
        criteria = job.palette.criteria
        rounds = QUICK_LIGHTS if any(light.free for light in job.palette.lights) else QUICK
        quick = replace(criteria, rounds=min(rounds, criteria.rounds))
        done = _run(job, replace(job.palette, criteria=quick), is_last=quick == criteria)
        yield done
        # A design cannot be interrupted once it has begun.
        if done.design is not None and not done.is_last and self._wait_idle(REST_S):
            yield _run(job, replace(done.design.palette, criteria=criteria), is_last=True)


def _run(job: DesignJob, palette: Palette, is_last: bool) -> DesignDone:
    started = time.perf_counter()
    designed, error = None, ""
    try:
        designed = design(palette, again=True)
    except MemoryError:
        error = "no memory for the design"
    except VolspecError as refused:
        error = one_line(refused)
    except Exception as failed:  # e.g. a solver that does not converge; the thread goes on
        message = f"the design failed: {one_line(failed)}"
        error = f"{message}; change a target, or design from scratch"
    ms = 1e3 * (time.perf_counter() - started)
    return DesignDone(job, ms, designed, is_last or bool(error), error)


PALETTES = _LOAD, _SAVE = "palette-load", "palette-save"
# Longest wait on closing for a design, which cannot be interrupted.
_PATIENCE_S = 0.1
_DOING = {
    "hide": "Hiding {} under {} …",
    "reveal": "Revealing {} under {} …",
    "keep": "Keeping the colour of {} …",
    "merge": "Merging materials under {1} …",
    effects.DIFFERENCE: "Searching for a light that shows {} …",
}


class DesignService:
    """Designs spectra for targets in the background; ``status`` has messages for the panel.

    Threads call ``wake`` when there is something to take.
    """

    commands = frozenset((*palette_results.WIZARDS, effects.DIFFERENCE))

    def __init__(self, wake: Callable[[], object], notice: Notice) -> None:
        self._worker, self._tasks = DesignWorker(wake), Tasks(wake)
        self._notice = notice
        self.status = DesignStatus()
        self._requested: DesignTargets | None = None
        self._reported: DesignTargets | None = None  # targets that the status is about
        self._advising: DesignTargets | None = None
        self._missed: tuple[Design, DesignTargets] | None = None
        self._opening: object = None  # of the document
        self._number = 0  # of the state's history; results for an earlier one are dropped
        self._wizard = ""  # message about the wizard that is requested or runs
        self._wizard_waits = ""  # its name, until the designs in progress are done
        self._effect = False  # True if it ends in a comparison

    @property
    def busy(self) -> bool:
        """True while a design, a wizard, a search for advice or a file is in progress."""
        return bool(self._wizard_waits) or self._worker.busy or self._tasks.busy

    def follow(self, state: ViewState) -> None:
        """Request a design if the targets have changed."""
        if state.document.opening is not self._opening:
            self._opening = state.document.opening
            if self._wizard_waits:
                self._wizard = self._wizard_waits = ""
            self.forget()
        targets = state.palette.targets
        if targets is not self._reported:
            self._reported = targets
            self._report(complaint="", advice=(), reached=())
        # A wizard's result would not fit other materials.
        if self._wizard or not state.palette.is_pending or targets is self._requested:
            return
        self._requested = targets
        try:
            palette = palette_table.palette_from_state(state)
        except VolspecError as error:
            self._report(complaint=one_line(error), busy="")
            return
        self._worker.request(DesignJob(palette, targets, self._number))
        self._report(busy="Designing …")

    def forget(self) -> None:
        """Drop designs in progress, as the state has been replaced."""
        self._number += 1
        self._requested = None
        self._report(busy=self._wizard)

    def take(self, history: History) -> History:
        """Return the history with the threads' results; unchanged if there are none."""
        for done in self._worker.take():
            history = self._with_design(history, done)
        for outcome in self._tasks.take():
            history = self._with_outcome(history, outcome)
        if self._wizard_waits and not self._worker.busy:
            state, name = history.present, self._wizard_waits
            self._wizard_waits = ""
            self._tasks.start("wizard", lambda: (state, name, _run_wizard(state, name)))
        return history

    def run(self, name: str, state: ViewState, effect: bool = False) -> None:
        """Request a wizard, which begins when designs in progress are done.

        With ``effect``, its result is compared with daylight, and described in words.
        """
        self._effect = effect
        material, light = palette_table.wizard_place(state)
        if state.interface.pick.like in palette_table.column_names(state.lights):
            light = "a new light"
        self._wizard = _DOING[name].format(material, light)
        self._report(busy=self._wizard, complaint="", reached=())
        self._wizard_waits = name

    def file(self, name: str, path: str, state: ViewState) -> None:
        """Read or write a palette's file: one of `PALETTES`."""

        def task() -> tuple[ViewState, str, Palette | str]:
            if name == _LOAD:
                return state, name, load_palette(path)
            save_palette(palette_table.palette_from_state(state), path)
            return state, name, path

        self._tasks.start("palette", task, writes=name == _SAVE)

    def close(self) -> None:
        """End the threads, waiting for files but not for designs."""
        self._worker.close(_PATIENCE_S)
        self._tasks.close()

    def _with_design(self, history: History, done: DesignDone) -> History:
        present, targets = history.present, done.job.targets
        # A job with this number is for the document that `follow` saw last.
        if done.job.number != self._number or present.document.opening is not self._opening:
            return history
        finished = done.is_last and targets is present.palette.targets
        if finished:
            self._report(busy=self._wizard, complaint=done.error)
        if done.design is None:
            return replace(history)
        state = palette_table.with_design(present, done.design, targets)
        worst = max(palette_table.colour_table(state).errors, default=0.0)
        self._notice.trace.note(
            "design", "design", done.ms, whole=done.is_last, worst=round(worst, 3)
        )
        if finished and worst > VISIBLE:
            self._advise(done.design, targets)
        return history.amend(state)

    def _advise(self, designed: Design, targets: DesignTargets) -> None:
        """Search for advice, one search at a time, as each runs many designs."""
        self._missed = designed, targets
        if self._advising is None:
            self._advising = targets
            self._tasks.start("advice", lambda: relevant_advice(suggestions(designed), targets))

    def _take_advice(self, outcome: Outcome, present: DesignTargets) -> None:
        advising, self._advising = self._advising, None
        if advising is present:
            self._report(advice=outcome.result or ())
        elif self._missed is not None and self._missed[1] is present:
            self._advise(*self._missed)

    def _with_outcome(self, history: History, outcome: Outcome) -> History:
        """Return a new history in any case, as the panel has news."""
        present = history.present
        if outcome.kind == "advice":
            self._take_advice(outcome, present.palette.targets)
            return replace(history)
        if outcome.kind == "wizard":
            self._wizard = ""
        self._report(busy=self._wizard, complaint=outcome.error)
        if outcome.error:
            self._notice.show_error(outcome.error)
            return replace(history)
        begun, name, result = outcome.result
        if isinstance(result, str):
            self._notice.show(f"Saved {result}")
        elif begun.document.is_of(present.document):
            try:
                if isinstance(result, Palette):
                    if missing := palette_results.unmatched_reflectances(present, result):
                        names = ", ".join(missing)
                        self._notice.show_warning(f"The scene has no material left for {names}")
                    state = palette_results.with_palette(present, result)
                else:
                    state = self._with_wizard_result(present, begun, name, result)
            except VolspecError as error:
                self._report(complaint=one_line(error))
            else:
                self.forget()
                return history.step(state)
        return replace(history)

    def _with_wizard_result(
        self,
        present: ViewState,
        begun: ViewState,
        name: str,
        result: Redesigned | DiscriminatingLight,
    ) -> ViewState:
        # Spectra are compared by identity.
        if dict(begun.transfer.materials) != dict(present.transfer.materials):
            dropped = f"The wizard “{name}” was discarded, as the materials changed meanwhile"
            self._notice.show_warning(dropped)
            raise PaletteError(dropped, code="state")
        if isinstance(result, DiscriminatingLight):
            state, reached = effects.with_light(present, result), tuple[str, ...]()
        else:
            state = palette_results.with_wizard_result(present, result)
            reached = palette_results.result_lines(result, begun)
        if self._effect and (comparison := effects.outcome(begun, state, name)) is not None:
            reached = effects.sentences(comparison, state.lights)
            state = effects.with_comparison(state, comparison)
        self._reported = state.palette.targets
        self._report(reached=reached, advice=())
        self._notice.trace.note("wizard", name=name, reached=list(reached))
        return state

    def _report(self, **news: Any) -> None:
        self.status = replace(self.status, **news)


def _run_wizard(state: ViewState, name: str) -> Redesigned | DiscriminatingLight:
    if name == effects.DIFFERENCE:
        return effects.find_difference(state)
    return palette_results.run_wizard(state, name)


def relevant_advice(advice: tuple[str, ...], targets: DesignTargets) -> tuple[str, ...]:
    """Return the advice, without lines on cells that should only keep their colour."""
    staying = [f"({', '.join(pair)}):" for pair, cell in targets.cells.items() if stays(cell)]
    return tuple(line for line in advice if not any(line.startswith(pair) for pair in staying))
