"""The thread that casts, coarsely and then whole, what was asked for last.

state -> casting -> [worker] -> CoefficientImage -> pictures
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from volspec.errors import CastCancelled, VolspecError, one_line
from volspec.pipeline import raycast
from volspec.raycast import Camera, CoefficientImage, RaycastSpec
from volspec.relight.packed import PackedLayers
from volspec.transfer import Transfer
from volspec.viewer.model.document import Document
from volspec.viewer.work.latest import LatestWorker


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
