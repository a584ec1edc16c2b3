"""The thread that designs what was wished for last.

state -> service -> [worker] -> Design -> state

A wish is answered twice: quickly, from the spectra as they are, and well when no other follows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from volspec.errors import VolspecError, one_line
from volspec.palette import Design, Palette, design
from volspec.viewer.model.palette.wishes import Wishes
from volspec.viewer.work.latest import LatestWorker

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
