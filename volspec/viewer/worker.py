"""The thread that casts: the latest request wins, the window never waits.

state -> casting -> [worker] -> CoefficientImage -> pictures
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from volspec.errors import CastCancelled, VolspecError
from volspec.pipeline import raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.transfer import Transfer
from volspec.viewer.document import Document


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


class CastWorker:
    """Casts in a thread of its own.

    A job's later passes end when a newer job arrives. Its first, if coarse, is let through: were
    it ended too, a mouse that moves quicker than it would never show anything.

    Parameters
    ----------
    wake : callable
        Called from the thread when there is something to take.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self._wake = wake
        self._next: CastJob | None = None
        self._closed = False
        self._busy = False
        self._changed = threading.Condition()
        self._done: deque[CastDone] = deque()
        self._thread = threading.Thread(target=self._run, name="volspec-cast", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a cast is under way or waits."""
        with self._changed:
            return self._busy or self._next is not None

    def request(self, job: CastJob) -> None:
        """Cast this next, instead of what waits."""
        with self._changed:
            self._next = job
            self._changed.notify()

    def take(self) -> list[CastDone]:
        """What has ended since the last call, in order."""
        taken = []
        while self._done:
            taken.append(self._done.popleft())
        return taken

    def close(self) -> None:
        """End the cast under way, and the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

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
            for number, divisor in enumerate(job.divisors):
                done = self._cast(job, divisor, spared=number == 0 and divisor > 1)
                self._done.append(done)
                self._wake()
                if done.image is None:
                    break

    def _superseded(self) -> bool:
        return self._closed or self._next is not None

    def _cast(self, job: CastJob, divisor: int, spared: bool) -> CastDone:
        width, height = (-(-side // divisor) for side in job.size)
        started = time.perf_counter()

        def done(image: CoefficientImage | None = None, error: str = "") -> CastDone:
            return CastDone(job, divisor, 1e3 * (time.perf_counter() - started), image, error)

        try:
            image = raycast(
                *(job.document.volume, job.transfer, job.camera, (width, height), job.shading),
                cancel=(lambda: self._closed) if spared else self._superseded,
                caster=job.document.caster,
            )
        except CastCancelled:
            return done()
        except MemoryError:
            return done(error="no memory for the picture; make the window smaller")
        except VolspecError as error:
            return done(error=" ".join(str(error).split()))
        except Exception as error:  # a device that is lost, say: the thread must outlive it
            said = " ".join(str(error).split()) or type(error).__name__
            return done(
                error=f"the cast failed: {said}; open the file again, or see volspec doctor"
            )
        return done(image)
