"""OpenCL devices, programs and buffers; knows no stage.

PoCL (pulled in as a wheel) makes every CPU a device, so that "no device" means a broken
installation; the message says how to mend it. Compiled programs are cached by PoCL and the
GPU drivers on disk and here per context.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING, Any

from volspec._gpu.sources import Source
from volspec.errors import OpenCLError, nearest

if TYPE_CHECKING:
    import pyopencl as cl

POCL = "Portable Computing Language"
_REMEDY = "install PoCL with: pip install 'pyopencl[pocl]'; `volspec doctor` shows more"


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """One OpenCL device, as `volspec doctor` lists it."""

    name: str
    platform: str
    version: str
    is_cpu: bool
    compute_units: int
    memory_bytes: int
    max_allocation_bytes: int


def devices() -> list[DeviceInfo]:
    """Every device of every platform, GPUs first; empty where OpenCL is missing."""
    return [_describe(device) for device in _all_devices()]


def _all_devices() -> list[cl.Device]:
    try:
        import pyopencl as cl

        found = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except (ImportError, OSError):
        return []
    except cl.Error:  # the loader's way of saying that no driver is registered
        return []
    return sorted(found, key=lambda device: not device.type & cl.device_type.GPU)


def _describe(device: cl.Device) -> DeviceInfo:
    import pyopencl as cl

    return DeviceInfo(
        name=device.name.strip(),
        platform=device.platform.name.strip(),
        version=device.version.strip(),
        is_cpu=bool(device.type & cl.device_type.CPU),
        compute_units=device.max_compute_units,
        memory_bytes=device.global_mem_size,
        max_allocation_bytes=device.max_mem_alloc_size,
    )


_TRIAL = """
import numpy, pyopencl as cl
platform = next(p for p in cl.get_platforms() if p.name == "Portable Computing Language")
queue = cl.CommandQueue(cl.Context(platform.get_devices()[:1]))
kernel = cl.Program(queue.context, "__kernel void f(__global int *x) { x[0] = 1; }").build().f
kernel(queue, (1,), None, cl.Buffer(queue.context, cl.mem_flags.READ_WRITE, 4))
queue.finish()
"""


@cache
def missing_linker() -> str | None:
    """The remedy where PoCL cannot link the kernels it builds, else None.

    PoCL links each kernel with ``ld`` against libc and libgcc, and ends the whole process when
    that fails; so it is asked before. Where they are not in the usual places, a trial build in
    a process of its own decides.
    """
    usual = (
        shutil.which("ld"),
        glob("/usr/lib*/gcc*/*/*/libgcc.a"),
        glob("/usr/lib*/libc.so") or glob("/usr/lib/*/libc.so"),
    )
    if all(usual):
        return None
    trial = subprocess.run([sys.executable, "-c", _TRIAL], capture_output=True, check=False)
    if trial.returncode == 0:
        return None
    return (
        "PoCL cannot link kernels: it needs ld, libgcc and libc.so; "
        "on Debian or Ubuntu: apt-get install gcc libc6-dev"
    )


def _require_linker(device: cl.Device) -> None:
    if device.platform.name == POCL and (remedy := missing_linker()):
        raise OpenCLError(remedy)


@dataclass(slots=True)
class Compute:
    """A context and a queue on one device, and the kernels built there."""

    context: cl.Context
    queue: cl.CommandQueue
    info: DeviceInfo
    _kernels: dict[tuple[str, str, tuple[str, ...]], cl.Kernel] = field(default_factory=dict)

    @classmethod
    def open(cls, name: str | None = None) -> Compute:
        """Open the first device (GPUs first), or the first whose name contains ``name``.

        Raises
        ------
        OpenCLError
            If there is no device, or none of that name.
        """
        found = _all_devices()
        if not found:
            raise OpenCLError(f"no OpenCL device found; {_REMEDY}")
        if name is not None:
            names = [device.name.strip() for device in found]
            chosen = [d for d, n in zip(found, names, strict=True) if name.lower() in n.lower()]
            if not chosen:
                raise OpenCLError(
                    f"no OpenCL device named {name!r}; {nearest(name, names)}"
                    f"there is: {', '.join(names)}"
                )
            found = chosen
        import pyopencl as cl

        _require_linker(found[0])
        context = cl.Context([found[0]])
        return cls(context, cl.CommandQueue(context), _describe(found[0]))

    def kernel(self, source: Source, name: str, options: Sequence[str] = ()) -> cl.Kernel:
        """Build a program and take a kernel from it, once per source, name and options.

        Raises
        ------
        OpenCLError
            If it does not build; the message carries device, options and the compiler's line.
        """
        import pyopencl as cl

        key = (source.text, name, tuple(options))
        if key not in self._kernels:
            try:
                with warnings.catch_warnings():
                    # Build logs are shown when a build fails, not when it says "ok".
                    warnings.simplefilter("ignore")
                    program = cl.Program(self.context, source.text).build(options=list(options))
            except cl.RuntimeError as error:
                lines = [
                    line.strip() for line in str(error).splitlines() if "error" in line.lower()
                ]
                raise OpenCLError(
                    f"{source.files[1]} does not build on {self.info.name} with "
                    f"{' '.join(options) or 'no options'}: {lines[-1] if lines else error}"
                ) from error
            try:
                self._kernels[key] = cl.Kernel(program, name)
            except cl.LogicError as error:
                # A compiler that died half-way leaves an empty program in PoCL's cache.
                raise OpenCLError(
                    f"{source.files[1]}: the program that {self.info.name} built is empty; "
                    f"delete the cache of compiled programs ({_cache_folder()}) and try again"
                ) from error
        return self._kernels[key]

    def upload(self, array: Any) -> cl.Buffer:
        """A read-only device copy of a contiguous array.

        Raises
        ------
        OpenCLError
            If the device has no room for it.
        """
        import pyopencl as cl

        flags = cl.mem_flags.READ_ONLY | cl.mem_flags.COPY_HOST_PTR
        with self._told(array.nbytes):
            return cl.Buffer(self.context, flags, hostbuf=array)

    def output(self, nbytes: int) -> cl.Buffer:
        """A device buffer that kernels write and the host reads.

        Raises
        ------
        OpenCLError
            If the device has no room for it.
        """
        import pyopencl as cl

        with self._told(nbytes):
            return cl.Buffer(self.context, cl.mem_flags.READ_WRITE, nbytes)

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
                f"{self.info.name} has no room for {nbytes / 2**20:.0f} MiB (its largest buffer is "
                f"{limit / 2**20:.0f} MiB); cast a smaller picture or a down-sampled volume"
            ) from error

    def download(self, buffer: cl.Buffer, into: Any) -> None:
        """Copy a buffer into a contiguous array and wait for it."""
        import pyopencl as cl

        cl.enqueue_copy(self.queue, into, buffer)


def _cache_folder() -> str:
    """Where PoCL keeps compiled programs."""
    default = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")) / "pocl"
    return os.environ.get("POCL_CACHE_DIR", str(default))
