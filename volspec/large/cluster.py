"""Cast a level of a pyramid on several machines, with Dask.

    Volume.pyramid -> parts -> [distributed: cast, over, over, …] -> Result

Every task casts a run of parts that follow one another in visibility order, to a partial picture:
channels times alpha, transmittance, depth. `over` is associative [1], so that the pictures are
composited as a tree. Each task reads its own voxels, with those around them; only pictures travel
between machines. A task that is lost with its worker is repeated by Dask.

References
----------
[1] Porter & Duff (1984), "Compositing digital images", SIGGRAPH, 253-259.
"""

from __future__ import annotations

import logging
import signal
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from threading import Lock
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from volspec._extras import require_extra
from volspec.camera import Camera
from volspec.errors import CastCancelled, DeviceError, RaycastError, VolspecError, one_line
from volspec.large.level_caster import LevelCaster, PartPicture, normalise
from volspec.large.parts import Rect, VolumePart, view_of
from volspec.raycast import RaycastSpec, VolumeCaster
from volspec.raycast.launch import Cancel, Progress, Result, Visibility, light_layers
from volspec.transfer import Table
from volspec.volume import Volume
from volspec.volume.levels import Chunk, Level, Pyramid

if TYPE_CHECKING:
    from distributed import Client, Future, WorkerPlugin

# Tasks per thread of the cluster: enough that none waits long for the last, and few enough that
# pictures stay cheap next to casts.
_TASKS_PER_THREAD = 6
# How often a task is repeated if it fails, as by a file system that is away for a moment.
_RETRIES = 2
# Of transmittances, 0 to 1, in float32.
_ROUNDING = 1e-6
# Seconds until a scheduler has to have answered.
_PATIENCE_S = 10.0
# Environment of a worker of one thread: of PoCL, by its versions, and of Zarr.
_ONE_THREAD = dict.fromkeys(
    ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT", "ZARR_THREADING__MAX_WORKERS"), "1"
)


@dataclass(frozen=True, slots=True, eq=False)
class PartialPicture:
    """The picture of a run of parts with nothing in front, within a rectangle.

    ``coefficients`` (H, W, L·M) and ``depth`` (H, W) are premultiplied by opacity;
    ``transmittance`` is (H, W); ``first`` (H, W) as of a `Result`, in smallest spacings.
    """

    rect: Rect
    coefficients: NDArray[np.float32]
    alpha: NDArray[np.float32]
    depth: NDArray[np.float32]
    first: NDArray[np.float32]
    transmittance: NDArray[np.float32]
    gaps: dict[Chunk, str]

    @classmethod
    def of(
        cls, picture: PartPicture, parts: Sequence[VolumePart], gaps: dict[Chunk, str]
    ) -> PartialPicture:
        """Return the rectangle of a picture that its parts cover."""
        rect = _rect_of(parts)
        view = view_of(rect)
        return cls(
            rect,
            np.ascontiguousarray(picture.coefficients[view]),
            np.ascontiguousarray(picture.alpha[view]),
            np.ascontiguousarray(picture.depth[view]),
            np.ascontiguousarray(picture.first[view]),
            np.ascontiguousarray(picture.transmittance[view]),
            gaps,
        )

    def on(self, rect: Rect) -> PartialPicture:
        """Return the picture on a larger rectangle."""
        x0, y0, x1, y1 = rect
        view = (
            slice(self.rect[1] - y0, self.rect[3] - y0),
            slice(self.rect[0] - x0, self.rect[2] - x0),
        )

        def placed(values: NDArray[np.float32], empty: float) -> NDArray[np.float32]:
            canvas = np.full((y1 - y0, x1 - x0, *values.shape[2:]), empty, np.float32)
            canvas[view] = values
            return canvas

        return PartialPicture(
            rect,
            placed(self.coefficients, 0.0),
            placed(self.alpha, 0.0),
            placed(self.depth, 0.0),
            placed(self.first, np.inf),
            placed(self.transmittance, 1.0),
            self.gaps,
        )

    def over(self, back: PartialPicture) -> PartialPicture:
        """Return this picture composited over one behind it."""
        pairs = zip(self.rect, back.rect, (min, min, max, max), strict=True)
        x0, y0, x1, y1 = (pick(a, b) for a, b, pick in pairs)
        front, back = self.on((x0, y0, x1, y1)), back.on((x0, y0, x1, y1))
        transmittance = front.transmittance
        return PartialPicture(
            front.rect,
            front.coefficients + transmittance[..., None] * back.coefficients,
            front.alpha + transmittance * back.alpha,
            front.depth + transmittance * back.depth,
            np.minimum(front.first, back.first),
            transmittance * back.transmittance,
            front.gaps | back.gaps,
        )


def _rect_of(parts: Sequence[VolumePart]) -> Rect:
    corners = np.array([part.rect for part in parts])
    return *corners[:, :2].min(axis=0).tolist(), *corners[:, 2:].max(axis=0).tolist()


def over(front: PartialPicture, back: PartialPicture) -> PartialPicture:
    """Composite two neighbouring partial pictures."""
    return front.over(back)


@dataclass(frozen=True, slots=True)
class VolumeSource:
    """The level that tasks read; equal for all casts of a `ClusterCaster`.

    It has the ranges of that level alone, and no voxels.
    """

    key: str
    version: str
    number: int
    pyramid: Pyramid = field(compare=False)

    @classmethod
    def of(cls, pyramid: Pyramid, number: int) -> VolumeSource:
        """Return a level of a pyramid."""
        import volspec

        *finer, coarsest = pyramid.levels
        levels = [replace(level, ranges=None) for level in finer]
        levels[number] = finer[number]
        # The coarsest level is not cast by tasks.
        nothing = np.zeros((2, 2, 2), pyramid.dtype)
        last = Level(nothing, (0, 1, 2), (0, 0, 0), coarsest.world_from_index, (2, 2, 2))
        slim = replace(pyramid, levels=(*levels, last), sample=None)
        return cls(uuid4().hex, volspec.__version__, number, slim)


@dataclass(frozen=True, slots=True, eq=False)
class ClusterJob:
    """The arguments that all tasks of a cast share."""

    source: VolumeSource
    table: Table
    camera: Camera
    size: tuple[int, int]
    spec: RaycastSpec


@lru_cache(maxsize=1)
def _caster(source: VolumeSource) -> LevelCaster:
    """Return the caster of a level in this process; the last is cached, with what it read."""
    import volspec

    if source.version != volspec.__version__:
        raise RaycastError(
            f"a worker has volspec {volspec.__version__}, this program {source.version}",
            "install the same version on all machines",
            code="conflict",
        )
    pyramid = source.pyramid
    last = pyramid.levels[-1]
    volume = Volume(
        last.array, world_from_index=last.world_from_index, name=pyramid.name, pyramid=pyramid
    )
    # A worker has one core.
    return LevelCaster(VolumeCaster(volume), source.number, reads_ahead=False)


def cast_parts(
    job: ClusterJob,
    parts: Sequence[VolumePart],
    sigma: NDArray[np.float32] | None,
    before: NDArray[np.float32] | None = None,
) -> PartialPicture:
    """Cast a run of parts in a worker.

    ``sigma`` is the extinction of the light volume, ``before`` (H, W) the transmittance of what is
    in front of them; 1 if left out.
    """
    caster = _caster(job.source)
    pyramid = caster.volume.pyramid
    assert pyramid is not None
    pyramid.retry()
    with caster.base.locked():
        if sigma is not None:
            caster.lights.set_extinction(sigma, job.table, job.spec)
        arguments = job.table, job.camera, job.size, job.spec
        picture = PartPicture.of(caster, *arguments, None, None)
        if before is not None:
            picture.transmittance[...] = 0.0
            picture.transmittance[view_of(_rect_of(parts))] = before
        for loaded in caster.stream(job.table, job.spec, parts, picture.sees):
            if loaded is not None:
                picture.add(loaded, None)
    return PartialPicture.of(picture, parts, dict(pyramid.gaps))


def first_hits(
    job: ClusterJob, parts: Sequence[VolumePart], before: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return `PartialPicture.first` of parts behind others, which leave a transmittance (H, W)."""
    return cast_parts(job, parts, None, before).first


def through_of(picture: PartialPicture) -> NDArray[np.float32]:
    """Return the transmittance of a partial picture."""
    return picture.transmittance


def extinction_of(job: ClusterJob, parts: Sequence[VolumePart]) -> NDArray[np.float32]:
    """Return the extinction that some parts add to the light volume, in a worker."""
    caster = _caster(job.source)
    with caster.base.locked():
        boxes = caster.boxes_of(job.table, parts)
        return caster.lights.extinction(job.table, job.spec, boxes)


def add_taus(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Add two extinctions."""
    return one + other


class ClusterCaster(LevelCaster):
    """Casts a level of a volume's pyramid on the workers of a `Cluster`, as `LevelCaster` does.

    Meshes and rooms are refused. Raises RaycastError if a worker has another version of volspec, or
    fails; DeviceError if there is none.
    """

    def __init__(self, base: VolumeCaster, number: int, client: Client) -> None:
        super().__init__(base, number)
        self._client = client
        self._source = VolumeSource.of(self._pyramid, number)

    @property
    def device(self) -> str:
        """Number of workers, and where they are."""
        count = len(self._client.nthreads())
        return f"{count} Dask workers at {self._client.scheduler.address}"

    def _cast_parts(
        self,
        table: Table,
        camera: Camera,
        size: tuple[int, int],
        spec: RaycastSpec,
        parts: Sequence[VolumePart],
        progress: Progress | None,
        cancel: Cancel | None,
        span_mm: NDArray[np.float32] | None,
        clear: Visibility | None,
    ) -> Result:
        wrong = None
        if span_mm is not None or clear is not None:
            wrong = "with surfaces behind it", "the meshes and the room"
        elif spec.mode != "composite":
            wrong = f"with mode {spec.mode!r}", "the mode"
        if wrong is not None:
            raise RaycastError(
                f"raycast: {self.volume.name} is cast on a cluster, {wrong[0]}",
                f"leave out {wrong[1]}, or the cluster",
                code="unsupported",
            )
        self.reserve(parts)  # refused as on one machine
        if not parts:
            return super()._cast_parts(
                table, camera, size, spec, parts, progress, cancel, span_mm, clear
            )
        # A task, so that Dask makes it again if the worker that holds it is lost.
        job = self._submit(_itself, ClusterJob(self._source, table, camera, size, spec))
        tasks, sigma = self._tasks(), None
        if light_layers(spec, self.volume, camera):
            boxes = runs(self.light_parts(table), tasks)
            sigma = self._tree(add_taus, [self._submit(extinction_of, job, run) for run in boxes])
        batches = runs(parts, tasks)
        leaves = [self._submit(cast_parts, job, run, sigma) for run in batches]
        root = self._tree(over, leaves)
        assert root is not None
        self._wait(leaves, root, progress, cancel)
        picture: PartialPicture = root.result()
        self._pyramid.gaps.update(picture.gaps)
        width, height = size
        frame = picture.on((0, 0, width, height))
        unit = min(self.volume.spacing_mm)
        groups = tuple(group.without_shadows() for group in spec.groups)
        dark = ClusterJob(self._source, table, camera, size, replace(spec, groups=groups))
        self._gather_first(frame.first, dark, batches, leaves, cancel)
        return normalise(frame.coefficients, frame.alpha, frame.depth, frame.first, unit, spec.half)

    def _gather_first(
        self,
        first: NDArray[np.float32],
        job: ClusterJob,
        batches: Sequence[Sequence[VolumePart]],
        leaves: Sequence[Future],
        cancel: Cancel | None,
    ) -> None:
        """Find the first hits that need opacity of several tasks, which are later in their own."""
        passed = np.ones(first.shape, np.float32)
        enough, job_there = job.spec.first_opacity, None
        futures = [self._submit(through_of, leaf) for leaf in leaves]
        again = []
        for parts, future in zip(batches, futures, strict=True):
            self._wait([future], future, None, cancel)
            view = view_of(_rect_of(parts))
            before = passed[view].copy()
            passed[view] *= future.result()
            reached = (before < 1.0) & (1.0 - before < enough + _ROUNDING)
            reached &= 1.0 - passed[view] > enough - _ROUNDING
            if reached.any():
                job_there = job_there or self._submit(_itself, job)
                remaining = np.where(reached, before, np.float32(0.0))
                again.append((view, self._submit(first_hits, job_there, parts, remaining)))
        for view, future in again:
            self._wait([future], future, None, cancel)
            np.minimum(first[view], future.result(), out=first[view])

    def _submit(self, function: Any, *arguments: Any) -> Future:
        return self._client.submit(function, *arguments, pure=False, retries=_RETRIES)

    def _tasks(self) -> int:
        threads = sum(self._client.nthreads().values())
        if threads == 0:
            raise DeviceError(
                f"the cluster at {self._client.scheduler.address} has no workers; start some",
                code="unsupported",
            )
        return threads * _TASKS_PER_THREAD

    def _tree(self, function: Any, futures: Sequence[Future]) -> Future | None:
        """Combine neighbours pairwise until one is left."""
        level = list(futures)
        while len(level) > 1:
            pairs = [
                self._submit(function, *level[k : k + 2]) if k + 1 < len(level) else level[k]
                for k in range(0, len(level), 2)
            ]
            level = pairs
        return level[0] if level else None

    def _wait(
        self,
        leaves: Sequence[Future],
        root: Future,
        progress: Progress | None,
        cancel: Cancel | None,
    ) -> None:
        """Wait for the last picture; raise the first error of a task."""
        from distributed import TimeoutError as NotYet
        from distributed import wait

        while not root.done():
            if cancel is not None and cancel():
                self._client.cancel([*leaves, root])
                raise CastCancelled("raycast: cancelled", code="state")
            # Else Dask takes the client that was made last in this process.
            with self._client.as_current(), suppress(NotYet):
                wait([root], timeout=0.1)
            if progress is not None:
                progress(sum(leaf.done() for leaf in leaves) / (len(leaves) + 1))
        if root.status != "finished":
            failed = next((leaf for leaf in leaves if leaf.status == "error"), root)
            error = failed.exception()
            if isinstance(error, VolspecError):
                raise error
            remedy = "see the log of the workers"
            if self._client.cluster is not None:  # on this machine, without logs
                remedy = "give fewer workers or less --memory, or leave out --device"
            raise RaycastError(
                f"raycast: a worker failed ({one_line(error)[:400]})", remedy, code="state"
            ) from error
        if progress is not None:
            progress(1.0)


def _itself(job: ClusterJob) -> ClusterJob:
    """Return the job."""
    return job


def runs(parts: Sequence[VolumePart], count: int) -> list[tuple[VolumePart, ...]]:
    """Divide parts into runs of about as much work each."""
    if not parts:
        return []
    work = np.array([part.work for part in parts])
    middles = np.cumsum(work) - 0.5 * work
    number = (middles * count / work.sum()).astype(int)
    return [
        tuple(part for part, n in zip(parts, number, strict=True) if n == k)
        for k in np.unique(number)
    ]


def is_cluster(device: object) -> bool:
    """Return True if a device's name is a cluster's address.

    >>> is_cluster("tcp://node1:8786"), is_cluster("local:2"), is_cluster("cpu")
    (True, True, False)
    """
    return isinstance(device, str) and ("://" in device or device.partition(":")[0] == "local")


class Cluster:
    """A Dask cluster, connected to or started at the first cast.

    Parameters
    ----------
    address : str
        ``tcp://HOST:8786`` of a scheduler, ``local`` for a worker per core of this machine, or
        ``local:N`` for N of them.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._client: Client | None = None
        self._connecting = Lock()  # frames of an export are cast in several threads
        self._end: Callable[[], object] = lambda: None
        kind, _, number = address.partition(":")
        if kind == "local" and number and not (number.isdecimal() and int(number) > 0):
            raise DeviceError(
                f"device {address}: {number} is no number of workers; give local or local:N",
                code="syntax",
                given=address,
            )
        require_extra("cluster", f"device {address}")

    @property
    def client(self) -> Client:
        """The connection. Raises DeviceError if no scheduler answers."""
        with self._connecting:
            if self._client is None:
                self._client = self._connect()
            return self._client

    def close(self) -> None:
        """End the connection, and the workers that were started for it."""
        if self._client is not None:
            self._client.close()
            self._end()
            self._client = None

    def caster(self, base: VolumeCaster, number: int) -> ClusterCaster:
        """Return a caster of a level. Raises DeviceError if no scheduler answers."""
        return ClusterCaster(base, number, self.client)

    def _connect(self) -> Client:
        from distributed import Client, LocalCluster

        kind, _, number = self._address.partition(":")
        if kind != "local":
            try:
                return Client(self._address, timeout=_PATIENCE_S)
            except (OSError, ValueError) as error:
                raise DeviceError(
                    f"device {self._address}: no Dask scheduler answers "
                    f"({one_line(error)[:120]}); start it, or give local:N",
                    code="unsupported",
                    given=self._address,
                ) from error
        import dask

        # A worker is one thread, and so is its OpenCL device.
        with dask.config.set({"distributed.nanny.pre-spawn-environ": _ONE_THREAD}):
            cluster = LocalCluster(
                n_workers=int(number) if number else None,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            )
        self._end = weakref.finalize(self, cluster.close)
        client = Client(cluster)
        client.register_plugin(_quiet_worker())
        return client


def _quiet_worker() -> WorkerPlugin:
    """Return a plugin by which Ctrl-C ends workers of this machine by their cluster, not itself."""
    from distributed import WorkerPlugin

    class QuietWorker(WorkerPlugin):
        def setup(self, worker: object) -> None:
            signal.signal(signal.SIGINT, signal.SIG_IGN)

    return QuietWorker()
