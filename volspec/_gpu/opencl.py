"""OpenCL devices, programs and buffers, independent of the stages.

Compiled programs are cached on disk by PoCL and the GPU drivers, and here per context.
`volspec._gpu.device_list` chooses the device.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from numpy.typing import NDArray

from volspec._child import require_own_process
from volspec._gpu.device_list import (
    BUILD_VARIABLE,
    DEVICE_VARIABLE,
    DeviceInfo,
    all_devices,
    cache_folder,
    choose_device,
    describe,
    devices,
    fault,
    unusable_error,
)
from volspec._gpu.memory import host_free_bytes
from volspec._gpu.sharing import Sharing
from volspec._gpu.sources import Source, first_error
from volspec.errors import OpenCLError, ShapeError, one_line

if TYPE_CHECKING:
    import pyopencl as cl


# Number of last-used kernels that a context caches. PoCL uses 2 to 3 MB for each, and a day's work
# with varied settings builds many; a cast needs at most 5, and rebuilding one takes 0.1 s.
MAX_KERNELS = 16
Key = tuple[str, str, tuple[str, ...]]
# Products and sums may be fused, zeros lose their sign; infinities and NaN keep their meaning.
OPTIONS = ("-cl-std=CL1.2", "-cl-mad-enable", "-cl-no-signed-zeros", "-w")


@dataclass(slots=True)
class Compute:
    """OpenCL context on one device: a queue for launches, one for transfers, a cache of kernels."""

    context: cl.Context
    queue: cl.CommandQueue
    transfers: cl.CommandQueue
    info: DeviceInfo
    index: int  # of `devices`
    sharing: Sharing | None = None
    # The most recently used comes last. Intel's runtime does not keep a kernel's program alive.
    _kernels: dict[Key, tuple[cl.Kernel, cl.Program]] = field(default_factory=dict)
    # Size in bytes of each live buffer.
    _allocated: WeakKeyDictionary[cl.Buffer, int] = field(default_factory=WeakKeyDictionary)

    @classmethod
    def open(cls, name: str | None = None, gl: Any = None) -> Compute:
        """Open the device with a name (`choose_device`), sharing the moderngl.Context ``gl``.

        Raises OpenCLError if no device matches, or its driver refuses a context or cannot share it.
        """
        index = choose_device(name)
        device = all_devices()[index]
        import pyopencl as cl

        sharing = None
        try:
            if gl is None:
                context = cl.Context([device])
            else:
                context, sharing = Sharing.open(device, gl)
            queue, transfers = cl.CommandQueue(context), cl.CommandQueue(context)
        except cl.Error as error:
            raise OpenCLError(
                f"{device.name.strip()}: its driver creates no context ({one_line(error)})",
                f"choose another device with {DEVICE_VARIABLE}, `volspec doctor` lists them",
                code="unsupported",
            ) from error
        return cls(context, queue, transfers, describe(device), index, sharing)

    def require_own_process(self) -> None:
        """Raise OpenCLError in a process that was forked after the device was opened."""
        require_own_process("OpenCL", OpenCLError)

    def kernel(self, source: Source, name: str, options: Sequence[str] = OPTIONS) -> cl.Kernel:
        """Return a program's kernel, cached (the last `MAX_KERNELS`) or built now.

        Raises OpenCLError, with the compiler's first error and its line, if the build fails.
        """
        self.require_own_process()
        key = (source.text, name, tuple(options))
        entry = self._kernels.pop(key, None)
        if entry is None:
            program = self._cached_program(source.text, key[2]) or self._build(source, options)
            entry = self._kernel_of(program, source, name), program
        self._kernels[key] = entry
        if len(self._kernels) > MAX_KERNELS:
            del self._kernels[next(iter(self._kernels))]
        return entry[0]

    def _cached_program(self, text: str, options: tuple[str, ...]) -> cl.Program | None:
        """Return the program of another kernel that is cached; None if there is none."""
        for (cached_text, _, built), (_, program) in self._kernels.items():
            if (cached_text, built) == (text, options):
                return program
        return None

    def _build(self, source: Source, options: Sequence[str]) -> cl.Program:
        import pyopencl as cl

        try:
            with warnings.catch_warnings():
                # Build logs are shown if the build fails.
                warnings.simplefilter("ignore")
                # A binary in pyopencl's cache may be for another CPU of the same name (Intel's
                # runtime): pyopencl then builds again, but reads this variable without a default.
                os.environ.setdefault("PYOPENCL_CACHE_FAILURE_FATAL", "")
                return cl.Program(self.context, source.text).build(options=list(options))
        except cl.RuntimeError as error:
            self._check_device()
            extra = os.environ.get(BUILD_VARIABLE, "").split()
            raise OpenCLError(
                f"{source.files[1]} does not build on {self.info.name} with "
                f"{' '.join((*options, *extra)) or 'no options'}: "
                f"{first_error(str(error), source)}",
                f"unset {BUILD_VARIABLE}"
                if extra
                else "update the device's driver, or choose another device with "
                f"{DEVICE_VARIABLE}; `volspec doctor` lists them",
                code="unsupported",
            ) from error

    def _kernel_of(self, program: cl.Program, source: Source, name: str) -> cl.Kernel:
        import pyopencl as cl

        try:
            return cl.Kernel(program, name)
        except cl.LogicError as error:
            # A compiler that died half-way leaves an empty program in PoCL's cache.
            raise OpenCLError(
                f"{source.files[1]}: the program that {self.info.name} built is empty",
                f"delete the cache of compiled programs ({cache_folder()}) and try again",
                code="damaged",
            ) from error

    def _check_device(self) -> None:
        """Repeat the device's trial, whose cached result may be old, and raise its error."""
        infos = devices()
        if self.info in infos and fault(index := infos.index(self.info), infos, again=True):
            raise unusable_error([index], infos)

    def upload(self, array: NDArray[Any], *, share: bool = False) -> cl.Buffer:
        """Make a buffer for kernels to read, with a C-contiguous array's values.

        On a CPU, ``share`` uses the array's own memory instead of a copy: the buffer keeps it
        alive; do not write to it meanwhile. Raises OpenCLError if the device has no room for it.
        """
        import pyopencl as cl

        if not array.flags.c_contiguous:
            raise ShapeError(
                f"{self.info.name}: an array of shape {array.shape} is not C-contiguous",
                "pass numpy.ascontiguousarray(array)",
                code="shape",
            )
        shared = share and self.info.is_cpu
        source = cl.mem_flags.USE_HOST_PTR if shared else cl.mem_flags.COPY_HOST_PTR
        return self._buffer(
            cl.mem_flags.READ_ONLY | source, array.nbytes, array, counted=not shared
        )

    def output(
        self, nbytes: int, into: NDArray[Any] | None = None, *, filled: bool = False
    ) -> cl.Buffer:
        """Make a buffer for kernels to write and the host to read.

        ``into`` is the C-contiguous destination of `download`; on a CPU kernels then write there.
        If ``filled``, its values are those of the buffer at first. Raises OpenCLError if the
        device has no room for it.
        """
        import pyopencl as cl

        if into is not None and self.info.is_cpu:
            flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
            return self._buffer(flags, nbytes, into, counted=False)
        if filled:
            return self._buffer(cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR, nbytes, into)
        return self._buffer(cl.mem_flags.READ_WRITE, nbytes)

    def require(self, nbytes: int, field: str, remedy: str) -> None:
        """Raise OpenCLError unless there is enough memory for what is about to be allocated.

        ``field`` is the subject of the message: ``"engine.nrrd at 4096x4096"``. On a CPU the host's
        free memory counts as well.
        """
        free = max(self.info.memory_bytes - sum(self._allocated.values()), 0)
        if self.info.is_cpu:
            free = min(free, host_free_bytes())
        if nbytes > free:
            raise OpenCLError(
                f"{self.info.name}: {field} needs {_size(nbytes)}, {_size(free)} are free",
                remedy,
                code="size",
            )

    def _buffer(
        self, flags: int, nbytes: int, array: NDArray[Any] | None = None, *, counted: bool = True
    ) -> cl.Buffer:
        import pyopencl as cl

        self.require_own_process()
        limit = self.info.max_allocation_bytes
        try:
            if nbytes > limit:
                raise cl.MemoryError("more than the device's largest buffer")
            size = 0 if array is not None else nbytes
            buffer = _buffer_type()(self.context, flags, size, hostbuf=array)
        except cl.Error as error:
            raise OpenCLError(
                f"{self.info.name} has no room for {_size(nbytes)} (its largest buffer is "
                f"{_size(limit)})",
                "cast a smaller picture or a downsampled volume",
                code="size",
            ) from error
        if counted:
            self._allocated[buffer] = nbytes
        return buffer

    def download(
        self, buffer: cl.Buffer, into: NDArray[Any], after: cl.Event | None = None
    ) -> None:
        """Copy a buffer made by `output` into a contiguous array, and wait for the copy.

        ``after`` is the launch that fills it; later launches continue. Default: all launches.
        """
        import pyopencl as cl

        self.require_own_process()
        if after is None:
            self.queue.finish()
        events = after and [after]
        if buffer.hostbuf is not None:  # kernels write into the array itself
            view, _ = cl.enqueue_map_buffer(
                self.transfers,
                buffer,
                cl.map_flags.READ,
                0,
                into.shape,
                into.dtype,
                wait_for=events,
            )
            view.base.release(self.transfers)
            return
        cl.enqueue_copy(self.transfers, into, buffer, wait_for=events)


@cache
def _buffer_type() -> type[cl.Buffer]:
    """Return a buffer class that supports weak references, unlike pyopencl's own."""
    import pyopencl as cl

    class CountedBuffer(cl.Buffer):
        pass

    return CountedBuffer


def _size(nbytes: int) -> str:
    return f"{nbytes / 2**30:.1f} GiB" if nbytes >= 2**30 else f"{nbytes / 2**20:.1f} MiB"
