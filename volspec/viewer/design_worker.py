"""The thread that designs: the latest wish wins, the window never waits.

state -> designing -> [design_worker] -> Design -> state

A wish is answered twice: quickly, from the spectra as they are, and well when no other follows.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from volspec.errors import VolspecError
from volspec.palette import Design, Palette, design
from volspec.viewer.design import Wishes

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
    wishes : Wishes
        Those that it answers.
    document : object
        The scene it is for.
    number : int
        Of the state's history; a job of an earlier one leads nowhere.
    """

    palette: Palette
    wishes: Wishes
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


class DesignWorker:
    """Designs in a thread of its own; a job's later passes are left out when a newer one waits.

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._next: DesignJob | None = None
        self._closed = self._busy = False
        self._changed = threading.Condition()
        self._done: deque[DesignDone] = deque()
        self._thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Whether a design is under way or waits."""
        with self._changed:
            return self._busy or self._next is not None

    def request(self, job: DesignJob) -> None:
        """Design this next, instead of what waits."""
        with self._changed:
            self._next = job
            self._changed.notify()
        if self._thread is None:  # most sessions design nothing
            self._thread = threading.Thread(target=self._run, name="volspec-design", daemon=True)
            self._thread.start()

    def take(self) -> list[DesignDone]:
        """What has ended since the last call, in order."""
        taken = []
        while self._done:
            taken.append(self._done.popleft())
        return taken

    def close(self) -> None:
        """End the thread after the pass under way, which nobody waits for."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(0.1)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                while self._next is None and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return
                job, self._next, self._busy = self._next, None, True
            assert job is not None
            self._answer(job)

    def _answer(self, job: DesignJob) -> None:
        criteria = job.palette.criteria
        rounds = QUICK_LIGHTS if any(light.open for light in job.palette.lights) else QUICK
        quick = replace(
            job.palette, criteria=replace(criteria, rounds=min(rounds, criteria.rounds))
        )
        made = self._pass(job, quick, whole=quick.criteria == criteria)
        if made is not None and quick.criteria != criteria and self._rests():
            self._pass(job, replace(made.palette, criteria=criteria), whole=True)

    def _rests(self) -> bool:
        """Whether no other wish comes for a while: a design cannot be ended once it has begun."""
        with self._changed:
            newer = self._changed.wait_for(lambda: self._closed or self._next is not None, REST_S)
        return not newer

    def _pass(self, job: DesignJob, palette: Palette, whole: bool) -> Design | None:
        started = time.perf_counter()
        made, error = None, ""
        try:
            made = design(palette)
        except (VolspecError, MemoryError) as refused:
            error = " ".join(str(refused).split()) or "no memory for the design"
        except Exception as failed:  # a solver that does not converge: the thread must outlive it
            said = " ".join(str(failed).split()) or type(failed).__name__
            error = f"the design failed: {said}; change a wish, or design from scratch"
        ms = 1e3 * (time.perf_counter() - started)
        self._tell(DesignDone(job, ms, made, whole or bool(error), error))
        return made

    def _tell(self, done: DesignDone) -> None:
        self._done.append(done)
        self._wake()
