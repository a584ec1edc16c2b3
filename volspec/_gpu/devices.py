"""Which OpenCL devices there are, and which one is meant.

PoCL (pulled in as a wheel) makes every CPU a device, so that "no device" means a broken
installation; the message says how to mend it. Where several devices are, the environment variable
``VOLSPEC_DEVICE`` chooses one for every run.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING

from volspec.errors import OpenCLError, nearest, quoted

if TYPE_CHECKING:
    import pyopencl as cl

POCL = "Portable Computing Language"
DEVICE_VARIABLE = "VOLSPEC_DEVICE"


def cache_folder() -> Path:
    """Where PoCL keeps compiled programs."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pocl"
    return Path(os.environ.get("POCL_CACHE_DIR") or default)


def _remedy() -> str:
    """Why there may be no device: PoCL is missing, or gives up where it cannot keep programs."""
    folder = cache_folder()
    there = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    if not (there.is_dir() and os.access(there, os.W_OK)):
        return (
            f"PoCL cannot keep compiled programs in {folder}; set POCL_CACHE_DIR to a folder that "
            "can be written"
        )
    return "install PoCL with: pip install 'pyopencl[pocl]'; `volspec doctor` shows more"


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
    return [describe(device) for device in all_devices()]


def chosen_device(name: str | None = None) -> int:
    """Which of `devices` a name means.

    Parameters
    ----------
    name : str, optional
        Part of a device's or its platform's name, in any case; the first that matches is
        taken. A whole number is an index. Default: what ``VOLSPEC_DEVICE`` holds, else the
        first GPU, else the first CPU.

    Raises
    ------
    OpenCLError
        If it is no text, there is no device, or none of that name; the message lists those
        there are.
    """
    if name is not None and not isinstance(name, str):
        raise OpenCLError(
            f"device is {quoted(name)}; give part of a device's name, or its number as text, '0'"
        )
    found = devices()
    if not found:
        raise OpenCLError(f"no OpenCL device found; {_remedy()}")
    wanted, source = name, ""
    if name is None:
        wanted, source = os.environ.get(DEVICE_VARIABLE), f" ({DEVICE_VARIABLE})"
    if not wanted:
        return 0
    for i, device in enumerate(found):
        text = f"{device.platform}\n{device.name}".lower()
        if str(i) == wanted if wanted.isdecimal() else wanted.lower() in text:
            return i
    known = [n for device in found for n in (device.name, device.platform)]
    there = ", ".join(f"{i}: {device.name} ({device.platform})" for i, device in enumerate(found))
    raise OpenCLError(
        f"no OpenCL device named {wanted!r}{source}; {nearest(wanted, known)}there is {there}"
    )


def all_devices() -> list[cl.Device]:
    try:
        import pyopencl as cl

        found = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except (ImportError, OSError):
        return []
    except cl.Error:  # the loader's way of saying that no driver is registered
        return []
    return sorted(found, key=lambda device: not device.type & cl.device_type.GPU)


def describe(device: cl.Device) -> DeviceInfo:
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


def require_linker(device: cl.Device) -> None:
    if device.platform.name == POCL and (remedy := missing_linker()):
        raise OpenCLError(remedy)
