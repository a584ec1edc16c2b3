"""OpenCL devices of this machine, and the choice of one that works.

Drivers are those of the system, PoCL from its wheel, which makes any CPU a device, and Intel's CPU
runtime from ``volspec[intel]``. A device is taken if it has compiled and run a kernel
(`volspec._gpu.trials`). The environment variable ``VOLSPEC_DEVICE`` chooses one for every run.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import TYPE_CHECKING

from volspec._gpu import trials
from volspec._gpu.trials import POCL, DeviceInfo
from volspec.errors import OpenCLError, nearest, quoted

if TYPE_CHECKING:
    import pyopencl as cl

DEVICE_VARIABLE = "VOLSPEC_DEVICE"
_INTEL_WHEEL, _INTEL_LIBRARIES = "intel-opencl-rt", ("libintelocl.so", "intelocl64.dll")
# Folders of drivers, as pyopencl's loader looks for them.
_VENDOR_VARIABLES, _VENDORS = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"), "/etc/OpenCL/vendors"


def cache_folder() -> Path:
    """Folder in which PoCL keeps compiled programs."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pocl"
    return Path(os.environ.get("POCL_CACHE_DIR") or default)


def no_device() -> str:
    """Message for a machine without any device: nothing is installed, or PoCL gives up."""
    folder = cache_folder()
    there = next((path for path in (folder, *folder.parents) if path.exists()), folder)
    if not (there.is_dir() and os.access(there, os.W_OK)):
        return (
            f"no OpenCL device found; PoCL cannot keep compiled programs in {folder}, set "
            "POCL_CACHE_DIR to a folder that can be written"
        )
    return f"no OpenCL device found; {trials.remedy([])}"


def devices() -> list[DeviceInfo]:
    """Every device of every driver, in the order of preference; empty if OpenCL is missing."""
    return [describe(device) for device in all_devices()]


def chosen_device(name: str | None = None) -> int:
    """Index in `devices` of the first device that works, of those that a name means.

    Parameters
    ----------
    name : str, optional
        Part of a device's, its platform's or its driver's name, in any case. A whole number is an
        index. Default: what ``VOLSPEC_DEVICE`` holds, else any device.

    Raises
    ------
    OpenCLError
        If it is no text, there is no device, none of that name, or none of them works; the message
        lists those there are, or the fault.
    """
    if name is not None and not isinstance(name, str):
        raise OpenCLError.refused(
            "device", name, "give part of a device's name, or its number as text, '0'"
        )
    found = devices()
    if not found:
        raise OpenCLError(no_device())
    wanted, source = name, ""
    if name is None:
        wanted, source = os.environ.get(DEVICE_VARIABLE, "").strip(), f" ({DEVICE_VARIABLE})"
    meant = [i for i, device in enumerate(found) if not wanted or _is_meant(wanted, i, device)]
    # Part of one device's name may be another's whole name.
    meant = [i for i in meant if found[i].name == wanted] or meant
    if wanted and not meant:
        known = [n for device in found for n in (device.name, device.platform)]
        there = ", ".join(f"{i}: {d.name} ({d.platform})" for i, d in enumerate(found))
        raise OpenCLError(
            f"no OpenCL device named {quoted(wanted)}{source}; {nearest(wanted[:99], known)}there "
            f"is {there}",
            code="unknown",
        )
    # Where none works, the cache may hold what is not so any more.
    for again in (False, True):
        for i in meant:
            if not trials.fault(i, found, again=again):
                return i
    raise OpenCLError(unusable(meant, found))


def _is_meant(wanted: str, index: int, device: DeviceInfo) -> bool:
    if wanted.isdecimal():
        return str(index) == wanted
    return wanted.lower() in f"{device.platform}\n{device.name}\n{device.driver}".lower()


def unusable(meant: list[int], found: list[DeviceInfo]) -> str:
    """Message for devices that cannot run kernels: each with its fault, and the remedy."""
    faults = "; ".join(
        f"{found[i].name} ({found[i].platform}, {found[i].driver}): {trials.fault(i, found)}"
        for i in meant
    )
    if len(meant) < len(found):
        return f"OpenCL: {faults}. Choose another device with {DEVICE_VARIABLE}; see volspec doctor"
    return f"OpenCL: no device can run a kernel. {faults}. Remedy: {trials.remedy(found)}"


def all_devices() -> list[cl.Device]:
    """Devices as pyopencl has them: GPUs, then CPUs, the newest driver first.

    The loader's own order is that of the files in a folder.
    """
    try:
        import pyopencl as cl

        with _intel_registered():
            found = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except (ImportError, OSError):
        return []
    except cl.Error:  # the loader's way of saying that no driver is registered
        return []

    def preference(device: cl.Device) -> tuple[bool, bool, list[int], str]:
        numbers = [-int(n) for n in re.findall(r"\d+", device.driver_version)]
        is_gpu = bool(device.type & cl.device_type.GPU)
        # PoCL last: another driver of the CPU is there because somebody wanted it.
        return not is_gpu, device.platform.name == POCL, numbers, device.driver_version

    return sorted(found, key=preference)


@contextmanager
def _intel_registered() -> Iterator[None]:
    """Let the loader see Intel's CPU runtime if its wheel is installed, without a variable set.

    The wheel registers a path of the machine that built it. The loader reads one folder of drivers,
    at the process's first call, so that the folder need not stay.
    """
    library = _intel_library()
    vendors = Path(next(filter(None, map(os.environ.get, _VENDOR_VARIABLES)), _VENDORS))
    registered = list(vendors.glob("*.icd"))
    if library is None or vendors.is_file():  # a file means that driver alone
        yield
    elif sys.platform == "win32":  # Khronos' loader adds these to the registry's
        with _variable("OCL_ICD_FILENAMES", str(library)):
            yield
    elif any(library.name in icd.read_text(errors="replace") for icd in registered):
        yield
    else:
        with tempfile.TemporaryDirectory() as folder, _variable(_VENDOR_VARIABLES[0], folder):
            for icd in registered:
                shutil.copy(icd, folder)
            Path(folder, "volspec-intel.icd").write_text(f"{library}\n")
            yield


@contextmanager
def _variable(name: str, value: str) -> Iterator[None]:
    """Set an environment variable for a while."""
    before = os.environ.get(name)
    os.environ[name] = value
    try:
        yield
    finally:
        if before is None:
            del os.environ[name]
        else:
            os.environ[name] = before


@cache
def _intel_library() -> Path | None:
    """CPU runtime of the wheel ``intel-opencl-rt``; None if it is not installed."""
    try:
        inside = files(_INTEL_WHEEL) or []
    except PackageNotFoundError:
        return None
    found = (Path(str(file.locate())) for file in inside if file.name in _INTEL_LIBRARIES)
    return next((path.resolve() for path in found), None)


def describe(device: cl.Device) -> DeviceInfo:
    """A device's names, versions and sizes."""
    import pyopencl as cl

    return DeviceInfo(
        name=device.name.strip(),
        platform=device.platform.name.strip(),
        version=device.version.strip(),
        driver=device.driver_version.strip(),
        is_cpu=bool(device.type & cl.device_type.CPU),
        compute_units=device.max_compute_units,
        memory_bytes=device.global_mem_size,
        max_allocation_bytes=device.max_mem_alloc_size,
    )
