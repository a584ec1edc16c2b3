"""OpenCL devices, programs and buffers; knows no stage.

Compiled programs are cached by PoCL and the GPU drivers on disk, and here per context. Which device
is taken: `volspec._gpu.devices`.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from numpy.typing import NDArray

from volspec._gpu.build_log import complaint
from volspec._gpu.devices import (
    DEVICE_VARIABLE,
    all_devices,
    cache_folder,
    chosen_device,
    describe,
    devices,
    unusable,
)
from volspec._gpu.memory import host_free_bytes
from volspec._gpu.sharing import Sharing
from volspec._gpu.sources import Source
from volspec._gpu.trials import DeviceInfo, fault
from volspec.errors import OpenCLError, ShapeError, one_line

if TYPE_CHECKING:
    import pyopencl as cl


# Kernels that a context keeps, the last used. PoCL takes 2 to 3 MB for each, and settings have more
# variants than a day's work ends at; a cast needs at most 5, and one built again takes 0.1 s.
MOST_KERNELS = 16
# Sums may be fused, zeros lose their sign; infinities and NaN keep their meaning.
OPTIONS = ("-cl-std=CL1.2", "-cl-mad-enable", "-cl-no-signed-zeros", "-w")


@dataclass(slots=True)
class Compute:
    """A context on one device, a queue for launches and one for transfers; the kernels built."""

    context: cl.Context
    queue: cl.CommandQueue
    transfers: cl.CommandQueue
    info: DeviceInfo
    sharing: Sharing | None = None
    # The last used comes last.
    _kernels: dict[tuple[str, str, tuple[str, ...]], cl.Kernel] = field(default_factory=dict)
    # Bytes of each buffer that still lives.
    _held: WeakKeyDictionary[cl.Buffer, int] = field(default_factory=WeakKeyDictionary)

    @classmethod
    def open(cls, name: str | None = None, gl: Any = None) -> Compute:
        """Open the device that a name means (`chosen_device`).

        Parameters
        ----------
        name : str, optional
        gl : moderngl.Context, optional
            Whose buffers kernels shall be able to write (`Sharing`).

        Raises
        ------
        OpenCLError
            If there is no device, none of that name, its driver refuses a context, or it does
            not share with ``gl``.
        """
        index = chosen_device(name)
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
                f"{device.name.strip()}: its driver makes no context ({one_line(error)}); choose "
                f"another device with {DEVICE_VARIABLE}, `volspec doctor` lists them"
            ) from error
        return cls(context, queue, transfers, describe(device), sharing)

    def kernel(self, source: Source, name: str, options: Sequence[str] = OPTIONS) -> cl.Kernel:
        """Return a program's kernel, one of the last `MOST_KERNELS` or built now.

        Raises
        ------
        OpenCLError
            If it does not build; the message carries device, options, the compiler's first
            complaint and the line of the source it is about.
        """
        key = (source.text, name, tuple(options))
        kernel = self._kernels.pop(key, None) or self._built(source, name, options)
        self._kernels[key] = kernel
        if len(self._kernels) > MOST_KERNELS:
            del self._kernels[next(iter(self._kernels))]
        return kernel

    def _built(self, source: Source, name: str, options: Sequence[str]) -> cl.Kernel:
        import pyopencl as cl

        try:
            with warnings.catch_warnings():
                # Build logs are shown when a build fails, not when it says "ok".
                warnings.simplefilter("ignore")
                # A binary in pyopencl's cache may be of another CPU of the same name (Intel's
                # runtime): pyopencl then builds again, but reads this without a default.
                os.environ.setdefault("PYOPENCL_CACHE_FAILURE_FATAL", "")
                program = cl.Program(self.context, source.text).build(options=list(options))
        except cl.RuntimeError as error:
            self._try_again()
            raise OpenCLError(
                f"{source.files[1]} does not build on {self.info.name} with "
                f"{' '.join(options) or 'no options'}: {complaint(str(error), source)}"
            ) from error
        try:
            return cl.Kernel(program, name)
        except cl.LogicError as error:
            # A compiler that died half-way leaves an empty program in PoCL's cache.
            raise OpenCLError(
                f"{source.files[1]}: the program that {self.info.name} built is empty; "
                f"delete the cache of compiled programs ({cache_folder()}) and try again"
            ) from error

    def _try_again(self) -> None:
        """Ask whether the device still works: its trial may be long ago.

        Raises
        ------
        OpenCLError
            If it fails at a one-line kernel, too; the next run takes another device.
        """
        found = devices()
        if self.info in found and fault(index := found.index(self.info), found, again=True):
            raise OpenCLError(unusable([index], found))

    def upload(self, array: NDArray[Any], *, share: bool = False) -> cl.Buffer:
        """A buffer that kernels read, with an array's values.

        Parameters
        ----------
        array : C-contiguous array
        share : bool
            On a CPU take the array's own memory instead of a copy. The buffer keeps the array
            alive; do not write to it meanwhile.

        Raises
        ------
        ShapeError
            If the array is not C-contiguous: kernels would read it in another order.
        OpenCLError
            If the device has no room for it.
        """
        import pyopencl as cl

        if not array.flags.c_contiguous:
            raise ShapeError(
                f"{self.info.name}: an array of shape {array.shape} is not C-contiguous; "
                "pass numpy.ascontiguousarray(array)"
            )
        shared = share and self.info.is_cpu
        source = cl.mem_flags.USE_HOST_PTR if shared else cl.mem_flags.COPY_HOST_PTR
        return self._buffer(
            cl.mem_flags.READ_ONLY | source, array.nbytes, array, counted=not shared
        )

    def output(self, nbytes: int, into: NDArray[Any] | None = None) -> cl.Buffer:
        """A device buffer that kernels write and the host reads.

        Parameters
        ----------
        nbytes : int
        into : C-contiguous array, optional
            What `download` will fill. On a CPU kernels then write there.

        Raises
        ------
        OpenCLError
            If the device has no room for it.
        """
        import pyopencl as cl

        if into is not None and self.info.is_cpu:
            flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
            return self._buffer(flags, nbytes, into, counted=False)
        return self._buffer(cl.mem_flags.READ_WRITE, nbytes)

    def require(self, nbytes: int, what: str, remedy: str) -> None:
        """Refuse what memory does not suffice for, before any of it is taken.

        Parameters
        ----------
        nbytes : int
            All that is about to be allocated.
        what : str
            What needs it, as the message's subject: ``"engine.nrrd at 4096x4096"``.
        remedy : str
            What the user can do.

        Raises
        ------
        OpenCLError
            If the device's memory, less what is allocated here, is smaller; on a CPU also if
            the host's is.
        """
        free = max(self.info.memory_bytes - sum(self._held.values()), 0)
        if self.info.is_cpu:
            free = min(free, host_free_bytes())
        if nbytes > free:
            raise OpenCLError(
                f"{self.info.name}: {what} needs {_size(nbytes)}, {_size(free)} are free; {remedy}"
            )

    def _buffer(
        self,
        flags: int,
        nbytes: int,
        array: NDArray[Any] | None = None,
        *,
        counted: bool = True,
    ) -> cl.Buffer:
        with self._told(nbytes):
            size = 0 if array is not None else nbytes
            buffer = _buffer_type()(self.context, flags, size, hostbuf=array)
        if counted:
            self._held[buffer] = nbytes
        return buffer

    @contextmanager
    def _told(self, nbytes: int) -> Iterator[None]:
        """Say in one line that memory does not suffice."""
        import pyopencl as cl

        limit = self.info.max_allocation_bytes
        try:
            if nbytes > limit:
                raise cl.MemoryError("more than the device's largest buffer")
            yield
        except cl.Error as error:
            raise OpenCLError(
                f"{self.info.name} has no room for {_size(nbytes)} (its largest buffer is "
                f"{_size(limit)}); cast a smaller picture or a down-sampled volume"
            ) from error

    def download(
        self, buffer: cl.Buffer, into: NDArray[Any], after: cl.Event | None = None
    ) -> None:
        """Have a buffer's content in a contiguous array, and wait for it.

        Parameters
        ----------
        buffer : cl.Buffer
            From `output`.
        into : C-contiguous array
        after : cl.Event, optional
            The launch that fills it: those queued since then go on meanwhile. All launches when
            left out.
        """
        import pyopencl as cl

        if after is None:
            self.queue.finish()
        events = after and [after]
        if buffer.hostbuf is not None:  # kernels write into the array itself
            view, _ = cl.enqueue_map_buffer(
                *(self.transfers, buffer, cl.map_flags.READ, 0, into.shape, into.dtype),
                wait_for=events,
            )
            view.base.release(self.transfers)
            return
        cl.enqueue_copy(self.transfers, into, buffer, wait_for=events)


@cache
def _buffer_type() -> type[cl.Buffer]:
    """A buffer that can be counted while it lives: pyopencl's own takes no weak references."""
    import pyopencl as cl

    class CountedBuffer(cl.Buffer):
        pass

    return CountedBuffer


def _size(nbytes: int) -> str:
    return f"{nbytes / 2**30:.1f} GiB" if nbytes >= 2**30 else f"{nbytes / 2**20:.1f} MiB"
