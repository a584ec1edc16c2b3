"""Designs and wizards in the background, and their results in the history.

    state -> [designs] -> Design -> History

A target is answered twice: quickly, from the spectra as they are, and well if no other follows.
The result belongs to the step that asked for it: undo takes both back. A wizard's result is a step
of its own.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from volspec.errors import VolspecError, one_line
from volspec.palette import Design, Palette, design, load_palette
from volspec.palette.advice import VISIBLE, suggestions
from volspec.viewer.model import palette_files
from volspec.viewer.model.document import Document
from volspec.viewer.model.history import History
from volspec.viewer.model.palette_table import (
    column_names,
    palette_of,
    table_of,
    with_design,
    wizard_place,
)
from volspec.viewer.model.palette_targets import DesignStatus, DesignTargets, stays
from volspec.viewer.model.palette_wizards import (
    WIZARDS,
    result_lines,
    run_wizard,
    with_wizard_result,
)
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker, Outcome, Tasks
from volspec.viewer.work.notify import Notice, Trace
from volspec.wizard import Redesigned

# Rounds of the quick answer: from where the last one ended, they come within ΔE 1 or so. Where
# lights are open too a round takes several times as long.
QUICK, QUICK_LIGHTS = 2, 1
# A hand that holds still for so long rests.
REST_S = 0.12


@dataclass(frozen=True, slots=True, eq=False)
class DesignJob:
    """A palette to be designed.

    Parameters
    ----------
    palette : Palette
    targets : DesignTargets
        Those that it answers.
    document : object
        The scene it is for.
    number : int
        Of the state's history; a job of an earlier one leads nowhere.
    """

    palette: Palette
    targets: DesignTargets
    document: object = None
    number: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class DesignDone:
    """How a pass of a job ended.

    Parameters
    ----------
    job : DesignJob
    ms : float
    made : Design, optional
        None where it failed.
    whole : bool
        Whether this was the last design of the job.
    error : str
        Why it failed.
    """

    job: DesignJob
    ms: float
    made: Design | None = None
    whole: bool = False
    error: str = ""


class DesignWorker(LatestWorker[DesignJob, DesignDone]):
    """Designs in a thread of its own; a job's later passes are left out when a newer one waits.

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        super().__init__(wake, "volspec-design")

    def _answers(self, job: DesignJob) -> Iterator[DesignDone]:
        criteria = job.palette.criteria
        rounds = QUICK_LIGHTS if any(light.open for light in job.palette.lights) else QUICK
        quick = replace(
            job.palette, criteria=replace(criteria, rounds=min(rounds, criteria.rounds))
        )
        done = _designed(job, quick, whole=quick.criteria == criteria)
        yield done
        # A design cannot be ended once it has begun.
        if done.made is not None and not done.whole and self._rests(REST_S):
            yield _designed(job, replace(done.made.palette, criteria=criteria), whole=True)


def _designed(job: DesignJob, palette: Palette, whole: bool) -> DesignDone:
    started = time.perf_counter()
    made, error = None, ""
    try:
        made = design(palette)
    except MemoryError:
        error = "no memory for the design"
    except VolspecError as refused:
        error = one_line(refused)
    except Exception as failed:  # a solver that does not converge: the thread must outlive it
        said = f"the design failed: {one_line(failed)}"
        error = f"{said}; change a wish, or design from scratch"
    ms = 1e3 * (time.perf_counter() - started)
    return DesignDone(job, ms, made, whole or bool(error), error)


PALETTES = _LOAD, _SAVE = "palette-load", "palette-save"
# At the end, for a design that cannot be ended once it has begun.
_PATIENCE_S = 0.1
_DOING = {
    "hide": "Hiding {} under {} …",
    "reveal": "Revealing {} under {} …",
    "keep": "Keeping the colour of {} …",
    "merge": "Merging materials under {1} …",
}


@dataclass(frozen=True, slots=True, eq=False)
class _Made:
    """A task's result, the state it began with, and what was asked for."""

    begun: ViewState
    name: str
    result: Redesigned | Palette | str


class DesignService:
    """Keeps spectra after targets.

    Parameters
    ----------
    wake : callable
        Called from threads when there is something to take.
    notice, trace
        What came of it is told to them.

    Attributes
    ----------
    news : DesignStatus
        What the threads have to say.
    """

    asks = frozenset(WIZARDS)

    def __init__(self, wake: Callable[[], object], notice: Notice, trace: Trace) -> None:
        self._worker, self._tasks = DesignWorker(wake), Tasks(wake)
        self._notice, self._trace = notice, trace
        self.status = DesignStatus()
        self._requested: DesignTargets | None = None
        self._told: DesignTargets | None = None  # what the news are about
        self._advising: DesignTargets | None = None
        self._missed: tuple[Design, DesignTargets] | None = None
        self._document: Document | None = None
        self._since = 0  # designs asked for before are forgotten
        self._wizard = ""  # what the wizard that is asked for does
        self._wizard_waits = ""  # its name, until the designs under way have landed

    @property
    def busy(self) -> bool:
        """Whether something is being designed, looked for, read or written."""
        return bool(self._wizard_waits) or self._worker.busy or self._tasks.busy

    def follow(self, state: ViewState) -> None:
        """Ask for a design where the targets have changed."""
        if state.document is not self._document:
            self._document = state.document
            if self._wizard_waits:
                self._wizard = self._wizard_waits = ""
            self.forget()
        targets = state.palette.targets
        if targets is not self._told:
            self._told = targets
            self._tell(complaint="", advice=(), reached=())
        if not state.palette.is_pending or targets is self._requested:
            return
        if self._wizard:  # its result would not fit other materials
            return
        self._requested = targets
        try:
            palette = palette_of(state)
        except VolspecError as error:
            self._tell(complaint=one_line(error), busy=self._wizard)
            return
        self._worker.request(DesignJob(palette, targets, state.document, self._since))
        self._tell(busy="Designing …")

    def forget(self) -> None:
        """Let designs under way lead nowhere: the state is another."""
        self._since += 1
        self._requested = None
        self._tell(busy=self._wizard)

    def taken(self, history: History) -> History:
        """The history with what threads have brought; itself where that is nothing."""
        for done in self._worker.take():
            history = self._designed(history, done)
        for outcome in self._tasks.take():
            history = self._finished(history, outcome)
        if self._wizard_waits and not self._worker.busy:
            self._begin(history.present)
        return history

    def do(self, name: str, state: ViewState) -> None:
        """Have done what a wizard is asked for: once designs under way have landed."""
        material, light = wizard_place(state)
        if state.interface.pick.like in column_names(state.lights):
            light = "a new light"
        self._wizard = _DOING[name].format(material, light)
        self._tell(busy=self._wizard, complaint="", reached=())
        self._wizard_waits = name

    def _begin(self, state: ViewState) -> None:
        name, self._wizard_waits = self._wizard_waits, ""
        self._tasks.start("wizard", lambda: _Made(state, name, run_wizard(state, name)))

    def file(self, name: str, path: str, state: ViewState) -> None:
        """Read or write a palette's file: one of `PALETTES`."""

        def task() -> _Made:
            if name == _LOAD:
                return _Made(state, _LOAD, load_palette(path))
            palette_files.save_state_palette(state, path)
            return _Made(state, _SAVE, path)

        self._tasks.start("palette", task, writes=name == _SAVE)

    def close(self) -> None:
        """End the thread after the pass under way, which nobody waits for; files are written."""
        self._worker.close(_PATIENCE_S)
        self._tasks.close()

    def _designed(self, history: History, done: DesignDone) -> History:
        present, targets = history.present, done.job.targets
        if done.job.number != self._since or done.job.document is not present.document:
            return history
        last = targets is present.palette.targets
        if last and done.whole:
            self._tell(busy=self._wizard, complaint=done.error)
        if done.made is None:
            return replace(history)
        state = with_design(present, done.made, targets)
        worst = max(table_of(state).errors, default=0.0)
        self._trace.note("design", "design", done.ms, whole=done.whole, worst=round(worst, 3))
        if last and done.whole and worst > VISIBLE:
            self._advise(done.made, targets)
        return history.amended(state)

    def _advise(self, made: Design, targets: DesignTargets) -> None:
        """Look for what would help, one search at a time: each designs many times."""
        self._missed = made, targets
        if self._advising is not None:
            return
        self._advising = targets
        self._tasks.start("advice", lambda: advice_of(suggestions(made), targets))

    def _advised(self, outcome: Outcome, present: DesignTargets) -> None:
        advising, self._advising = self._advising, None
        if advising is present:
            self._tell(advice=outcome.result or ())
        elif self._missed is not None and self._missed[1] is present:
            self._advise(*self._missed)

    def _finished(self, history: History, outcome: Outcome) -> History:
        present = history.present
        if outcome.kind == "advice":
            self._advised(outcome, present.palette.targets)
            return replace(history)
        if outcome.kind == "wizard":
            self._wizard = ""
        self._tell(busy=self._wizard, complaint=outcome.error)
        if outcome.error:
            self._notice.say(outcome.error)
            self._trace.note("error", message=outcome.error)
            return replace(history)
        made: _Made = outcome.result
        if isinstance(made.result, str):
            self._notice.say(f"Saved {made.result}")
        elif made.begun.document is present.document:
            if isinstance(made.result, Redesigned) and not _same_materials(made.begun, present):
                dropped = f"The wizard “{made.name}” was dropped: the materials changed meanwhile"
                self._tell(complaint=dropped)
                self._notice.say(dropped)
                return replace(history)
            try:
                state = self._with(present, made)
            except VolspecError as error:
                self._tell(complaint=one_line(error))
            else:
                self.forget()
                return history.step(state)
        return replace(history)

    def _with(self, present: ViewState, made: _Made) -> ViewState:
        """The state with a palette that was read, or with what a wizard made."""
        if isinstance(made.result, Palette):
            if missing := palette_files.unmatched_reflectances(present, made.result):
                self._notice.say(f"No material is left for {', '.join(missing)}")
            return palette_files.with_palette(present, made.result)
        assert isinstance(made.result, Redesigned)
        state = with_wizard_result(present, made.result)
        reached = result_lines(made.result, made.begun)
        self._told = state.palette.targets
        self._tell(reached=reached, advice=())
        self._trace.note("wizard", name=made.name, reached=list(reached))
        return state

    def _tell(self, **news: Any) -> None:
        self.status = replace(self.status, **news)


def advice_of(advice: tuple[str, ...], targets: DesignTargets) -> tuple[str, ...]:
    """Advice without that on colours which are only to stay: nobody wished for them."""
    staying = [f"({', '.join(at)}):" for at, cell in targets.cells.items() if stays(cell)]
    return tuple(said for said in advice if not any(said.startswith(at) for at in staying))


def _same_materials(one: ViewState, other: ViewState) -> bool:
    # Spectra are equal where they are the same object.
    return dict(one.transfer.materials) == dict(other.transfer.materials)
