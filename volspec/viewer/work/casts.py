"""Casts in a background thread, coarsely first and then whole, of the newest state.

state -> [casts] -> CoefficientImage -> pictures

A device's own threads give way to the window's, where both want the same cores.
"""

from __future__ import annotations

import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

from volspec.errors import CastCancelled, OpenCLError, VolspecError, VolspecWarning, one_line
from volspec.pipeline import Raycaster, raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.relight.packed import PackedLayers
from volspec.transfer import Transfer
from volspec.viewer.model.document import Document
from volspec.viewer.model.state import ViewState
from volspec.viewer.work.background import LatestWorker
from volspec.volume import Volume

T = TypeVar("T")

# Of 19: a cast gets a tenth of a core that the window wants, too.
_NICE = 10


def make_caster(volume: Volume, device: str | None) -> tuple[Raycaster | None, str]:
    """Make what casts a volume; or None, and why this machine cannot.

    Raises
    ------
    OpenCLError
        If the device that is named cannot.
    """
    try:
        return call_at_low_priority(lambda: Raycaster(volume, device=device)), ""
    except OpenCLError as error:
        if device is not None:
            raise
        warnings.warn(one_line(error), VolspecWarning, stacklevel=2)
        return None, one_line(error)


def call_at_low_priority(make: Callable[[], T]) -> T:
    """What a function makes, whose own threads, which outlive it, give way.

    Linux gives a thread the priority of the one that starts it; elsewhere nothing changes.

    >>> call_at_low_priority(lambda: 6 * 7)
    42
    """
    with ThreadPoolExecutor(1, "volspec-yielding", initializer=_lower_priority) as pool:
        return pool.submit(make).result()


def _lower_priority() -> None:
    if sys.platform == "linux":
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICE)


@dataclass(frozen=True, slots=True, eq=False)
class CastJob:
    """A picture to be cast.

    Parameters
    ----------
    document, transfer, camera, shading
        What `volspec.raycast` takes.
    size : (width, height)
        Of the whole picture.
    divisors : tuple of int
        What its sides are divided by, pass after pass.
    """

    document: Document
    transfer: Transfer
    camera: Camera
    shading: RaycastSpec
    size: tuple[int, int]
    divisors: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class CastDone:
    """How a pass of a job ended: with an image, an error's message, or neither where cancelled."""

    job: CastJob
    divisor: int
    ms: float
    image: CoefficientImage | None = None
    error: str = ""
    packed: PackedLayers | None = None


class CastWorker(LatestWorker[CastJob, CastDone]):
    """Casts in a thread of its own.

    A job's later passes end when a newer job arrives. Its first, if coarse, is let through: were
    it ended too, a mouse that moves quicker than it would never show anything.

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        super().__init__(wake, "volspec-cast")

    def _answers(self, job: CastJob) -> Iterator[CastDone]:
        for number, divisor in enumerate(job.divisors):
            done = self._cast(job, divisor, spared=number == 0 and divisor > 1)
            yield done
            if done.image is None:
                break

    def _cast(self, job: CastJob, divisor: int, spared: bool) -> CastDone:
        width, height = (-(-side // divisor) for side in job.size)
        started = time.perf_counter()

        def done(
            image: CoefficientImage | None = None,
            error: str = "",
            packed: PackedLayers | None = None,
        ) -> CastDone:
            ms = 1e3 * (time.perf_counter() - started)
            return CastDone(job, divisor, ms, image, error, packed)

        if job.document.fault:
            return done(error=job.document.fault)
        try:
            image = raycast(
                *(job.document.volume, job.transfer, job.camera, (width, height), job.shading),
                cancel=(lambda: self._closed) if spared else self._superseded,
                caster=job.document.caster,
            )
            # Here and not where it is drawn: it takes the window's thread 20 to 40 ms.
            packed = PackedLayers.of(image)
        except CastCancelled:
            return done()
        except MemoryError:
            return done(error="no memory for the picture; make the window smaller")
        except VolspecError as error:
            return done(error=one_line(error))
        except Exception as error:  # a device that is lost, say: the thread must outlive it
            said = f"the cast failed: {one_line(error)}"
            return done(error=f"{said}; open the file again, or see volspec doctor")
        return done(image, packed=packed)


# Few sizes, as each has textures of its own on the GPU.
DIVISORS = (1, 2, 3, 4, 6, 8)
# Of a coarse cast: above the first it gets coarser, and finer where that would stay below the
# second. Between them lies what drawing beside it takes, and what no size makes quicker.
SLOW_MS, QUICK_MS = 75.0, 45.0
# A whole cast that takes longer gets a step in between.
STEP_MS = 900.0
# A hand that holds still for so long rests.
REST_S = 0.15


@dataclass(frozen=True, slots=True)
class Pace:
    """How coarse a moving picture is, by what casts took.

    Parameters
    ----------
    divisor : int
        One of `DIVISORS`.
    whole_ms : float
        What a whole picture takes; 0 where that is not known.

    Examples
    --------
    >>> Pace().after(4, 100.0).divisor, Pace().after(4, 4.0).divisor
    (6, 2)
    """

    divisor: int = 4
    whole_ms: float = 0.0

    def after(self, divisor: int, ms: float) -> Pace:
        """What a cast teaches."""
        if divisor == 1:
            paced = replace(self, whole_ms=ms)
            return paced if self.divisor > 1 or ms <= SLOW_MS else replace(paced, divisor=2)
        if divisor != self.divisor:
            return self
        at = DIVISORS.index(divisor)
        if ms > SLOW_MS:
            return replace(self, divisor=DIVISORS[min(at + 1, len(DIVISORS) - 1)])
        finer = [each for each in DIVISORS[:at] if ms * (divisor / each) ** 2 < QUICK_MS]
        return replace(self, divisor=finer[0]) if finer else self

    @property
    def to_whole(self) -> tuple[int, ...]:
        """The passes from a coarse picture to the whole."""
        return (2, 1) if self.divisor > 2 and self.whole_ms > STEP_MS else (1,)


class CastScheduler:
    """Turns changes of state into casts.

    Parameters
    ----------
    wake : callable
        Called when a cast has ended.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._worker = CastWorker(wake)
        self._pace = Pace()
        self._first = True  # whose time is the kernel's being built
        self._wanted: ViewState | None = None
        self._changed_at = 0.0
        self._whole_wanted = False

    @property
    def busy(self) -> bool:
        """Whether a cast is under way, or will be without any further change."""
        return self._whole_wanted or self._worker.busy

    def change(self, state: ViewState, now: float, held: bool) -> None:
        """Cast a state: coarsely now, and whole when it rests.

        Parameters
        ----------
        state : ViewState
        now : float
            Seconds.
        held : bool
            Whether more changes are likely, as a mouse button is down.
        """
        if self._wanted is None or state.document is not self._wanted.document:
            self._pace, self._first = Pace(), True
        self._wanted, self._changed_at = state, now
        divisor = self._pace.divisor
        self._whole_wanted = held and divisor > 1
        passes = (divisor,) if held or divisor == 1 else (divisor, *self._pace.to_whole)
        self._request(state, passes)

    def tick(self, now: float, held: bool) -> None:
        """Go on to the whole picture where nothing moves any more."""
        rests = not held or now - self._changed_at >= REST_S
        if self._whole_wanted and rests and self._wanted is not None:
            self._whole_wanted = False
            self._request(self._wanted, self._pace.to_whole)

    def take(self) -> list[CastDone]:
        """Casts that have ended, in order; their times are learned from."""
        taken = self._worker.take()
        for done in taken:
            wanted = self._wanted
            if done.image is None or wanted is None or done.job.document is not wanted.document:
                continue
            if not self._first:
                self._pace = self._pace.after(done.divisor, done.ms)
            self._first = False
        return taken

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    def _request(self, state: ViewState, divisors: tuple[int, ...]) -> None:
        camera = state.view.camera(state.document.volume)
        self._worker.request(
            CastJob(state.document, state.transfer, camera, state.shading, state.size, divisors)
        )
