"""OpenCL devices of this machine, and the choice of one that works.

Drivers are the system's, PoCL from its wheel, which makes any CPU a device, and Intel's CPU runtime
from ``volspec[intel]``. The environment variable ``VOLSPEC_DEVICE`` chooses the device for every
run.

A device is chosen only after a trial: a one-line kernel, compiled and run once in a child process.
Drivers list devices that they cannot compile for (PyPI's PoCL 3.0 supports no CPU newer than its
LLVM 14), and some crash the process when they try. The result is cached in the user's cache folder
by device, driver and version; a failure for a day only, as the user may fix its cause.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from glob import glob
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import TYPE_CHECKING

from volspec._cache import cache_rows, cached_rows
from volspec._child import child_command, exit_cause, require_own_process
from volspec._extras import install_command
from volspec._files import ensure_writable_caches, write_fault
from volspec.errors import OpenCLError, nearest, one_line, quote

if TYPE_CHECKING:
    import pyopencl as cl

DEVICE_VARIABLE = "VOLSPEC_DEVICE"
# Options that pyopencl adds to every build.
BUILD_VARIABLE = "PYOPENCL_BUILD_OPTIONS"
_INTEL_WHEEL, _INTEL_LIBRARIES = "intel-opencl-rt", ("libintelocl.so", "intelocl64.dll")
# Where pyopencl's loader looks for drivers.
_VENDOR_VARIABLES, _VENDORS = ("OCL_ICD_VENDORS", "OPENCL_VENDOR_PATH"), "/etc/OpenCL/vendors"


POCL = "Portable Computing Language"
_TIMEOUT_S = 60.0
_FAILURE_CACHED_S = 86400.0
_FILE = "devices.json"
_WRONG_NUMBER = "the kernel ran but wrote a wrong number"
# Prints the error and exits with 1; a driver may crash it at any line.
_TRIAL = f"""
import os, warnings
index, expected, number = int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
warnings.simplefilter("ignore")
os.environ["PYOPENCL_NO_CACHE"] = "1"
import numpy as np
import pyopencl as cl
from volspec._gpu.device_list import all_devices, describe
device = all_devices()[index]
if repr(describe(device).identity) != expected:
    sys.exit("error: the list of devices has changed; try again")
text = "__kernel void f(__global int *x) {{ x[0] = %d; }}" % number
written = np.zeros(1, np.int32)
try:
    context = cl.Context([device])
    queue = cl.CommandQueue(context)
    result = cl.Buffer(context, cl.mem_flags.READ_WRITE, 4)
    cl.Program(context, text).build().f(queue, (1,), None, result)
    cl.enqueue_copy(queue, written, result)
except cl.Error as error:
    log = str(error).partition(">:")[2].partition("(options:")[0].strip() or str(error)
    lines = log.splitlines()
    sys.exit("error: " + next((line for line in lines if "error" in line), lines[0]))
sys.exit("error: {_WRONG_NUMBER}" if written[0] != number else 0)
"""


@dataclass(frozen=True, slots=True)
class DeviceInfo:
    """One OpenCL device, as `volspec doctor` lists it."""

    name: str
    platform: str
    version: str
    driver: str
    is_cpu: bool
    compute_units: int
    # PoCL follows what is free: another at each start of a process.
    memory_bytes: int = field(compare=False)
    max_allocation_bytes: int = field(compare=False)
    vector_width: int = 1  # numbers in a float vector of the device's instructions

    @property
    def identity(self) -> tuple[str, str, str, str]:
        """Name, platform, version and driver, alike in all processes."""
        return self.name, self.platform, self.version, self.driver


def cache_folder() -> Path:
    """Folder of PoCL's cache of compiled programs."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "pocl"
    return Path(os.environ.get("POCL_CACHE_DIR") or default)


def no_device_error() -> OpenCLError:
    """Return the error for a machine without a device: nothing is installed, or PoCL failed."""
    return OpenCLError("no OpenCL device found", _cache_remedy() or remedy([]), code="missing")


def _cache_remedy() -> str:
    """Return what to do if PoCL cannot write compiled programs; empty if it can."""
    if cause := write_fault(cache_folder()):
        return (
            f"PoCL cannot write programs to {cache_folder()} ({cause}), set POCL_CACHE_DIR to a "
            "folder that can be written"
        )
    return ""


def devices() -> list[DeviceInfo]:
    """Return every device of every driver, best first; an empty list if OpenCL is missing."""
    return [describe(device) for device in all_devices()]


def choose_device(name: str | None = None) -> int:
    """Return the index in `devices` of the first working device that the name matches.

    It is part of the name of a device, platform or driver, in any case; a whole number is an index.
    The default is the value of ``VOLSPEC_DEVICE``, else any device. Raises OpenCLError if no device
    matches, or none works; the message lists the devices, or their faults.
    """
    if name is not None and not isinstance(name, str):
        raise OpenCLError.refused(
            "device", name, "give part of a device's name, or its number as text, '0'"
        )
    infos = devices()
    if not infos:
        raise no_device_error()
    pattern, source = name, ""
    if name is None:
        pattern, source = os.environ.get(DEVICE_VARIABLE, "").strip(), f" ({DEVICE_VARIABLE})"
    meant = [i for i, device in enumerate(infos) if not pattern or _is_meant(pattern, i, device)]
    # The whole name of one device may be part of another's.
    meant = [i for i in meant if infos[i].name == pattern] or meant
    if pattern and not meant:
        names = [n for device in infos for n in (device.name, device.platform)]
        listing = ", ".join(f"{i}: {d.name} ({d.platform})" for i, d in enumerate(infos))
        raise OpenCLError(
            f"no OpenCL device is named {quote(pattern)}{source}; known: {listing}",
            f"{nearest(pattern[:99], names)}give part of a name or a number, such as 0"
            + ("" if name else f", or unset {DEVICE_VARIABLE}"),
            code="unknown",
        )
    # If none works, the cache may be out of date.
    for again in (False, True):
        for i in meant:
            if not fault(i, infos, again=again):
                return i
    raise unusable_error(meant, infos)


def _is_meant(pattern: str, index: int, device: DeviceInfo) -> bool:
    if pattern.isdecimal():
        return str(index) == pattern
    return pattern.lower() in f"{device.platform}\n{device.name}\n{device.driver}".lower()


def unusable_error(meant: list[int], infos: list[DeviceInfo]) -> OpenCLError:
    """Return the error for devices that cannot run kernels: the fault of each, and the remedy."""
    faults = "; ".join(
        f"{infos[i].name} ({infos[i].platform}, {infos[i].driver}): {fault(i, infos)}"
        for i in meant
    )
    if len(meant) < len(infos):
        advice = f"choose another device with {DEVICE_VARIABLE}; see volspec doctor"
        return OpenCLError(f"OpenCL: {faults}", advice, code="unsupported")
    advice = f"unset {BUILD_VARIABLE}" if os.environ.get(BUILD_VARIABLE) else ""
    advice = advice or _cache_remedy() or remedy(infos)
    return OpenCLError(f"OpenCL: no device can run a kernel. {faults}", advice, code="unsupported")


def all_devices() -> list[cl.Device]:
    """Return pyopencl's devices: GPUs, then CPUs, the newest driver first.

    The loader's own order is that of the files in its folder. Raises OpenCLError in a process that
    was forked from one that has called this.
    """
    require_own_process("OpenCL", OpenCLError)
    ensure_writable_caches()
    try:
        import pyopencl as cl

        with _intel_registered():
            found = [device for platform in cl.get_platforms() for device in platform.get_devices()]
    except (ImportError, OSError):
        return []
    except cl.Error:  # raised if no driver is registered
        return []

    def preference(device: cl.Device) -> tuple[bool, bool, list[int], str]:
        numbers = [-int(n) for n in re.findall(r"\d+", device.driver_version)]
        is_gpu = bool(device.type & cl.device_type.GPU)
        # PoCL last: any other CPU driver was installed on purpose.
        return not is_gpu, device.platform.name == POCL, numbers, device.driver_version

    return sorted(found, key=preference)


@contextmanager
def _intel_registered() -> Iterator[None]:
    """Let the loader find Intel's CPU runtime if its wheel is installed.

    The wheel registers a path on the machine that built it. The loader reads one folder of drivers,
    at the process's first call only, so a temporary folder will do.
    """
    library = _intel_library()
    vendors = Path(next(filter(None, map(os.environ.get, _VENDOR_VARIABLES)), _VENDORS))
    registered = list(vendors.glob("*.icd"))
    if library is None or vendors.is_file():  # a file means that driver alone
        yield
    elif sys.platform == "win32":  # Khronos' loader adds these to the registry's drivers
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
    """Set an environment variable inside the context."""
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
    libraries = (Path(str(file.locate())) for file in inside if file.name in _INTEL_LIBRARIES)
    return next((path.resolve() for path in libraries), None)


def describe(device: cl.Device) -> DeviceInfo:
    """Return a device's names, versions and sizes."""
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
        vector_width=device.native_vector_width_float,
    )


def fault(index: int, devices: Sequence[DeviceInfo], *, again: bool = False) -> str:
    """Return the reason why a device does not work; empty if it works.

    ``again`` tries the device now, whatever the cache contains.
    """
    key = device_key(index, devices)
    if not again:
        message, at_s = _cached_faults().get(key, ("never tried", 0.0))
        if not message or abs(time.time() - at_s) < _FAILURE_CACHED_S:
            return message
    message = _try(index, devices[index])
    _cache_faults({key: message})
    return message


def try_all(devices: Sequence[DeviceInfo]) -> tuple[str, ...]:
    """Try every device now, all at once, and return each one's `fault`."""
    with ThreadPoolExecutor() as threads:
        faults = tuple(threads.map(_try, range(len(devices)), devices))
    _cache_faults({device_key(index, devices): message for index, message in enumerate(faults)})
    return faults


def device_key(index: int, devices: Sequence[DeviceInfo]) -> str:
    """Return a device's key in the cache; the order distinguishes two drivers of one name."""
    info = devices[index]
    same = devices[:index].count(info)
    words = [*info.identity, str(same)]
    if options := os.environ.get(BUILD_VARIABLE):  # may be what fails
        words.append(options)
    if info.platform == POCL:  # PoCL links each kernel
        words.append("no linker" if _missing_linker() else str(_linker()))
    return " | ".join(words)


def _try(index: int, info: DeviceInfo) -> str:
    number = secrets.randbelow(2**31)  # compiled, not found in a driver's cache
    try:
        done = subprocess.run(
            [*child_command(_TRIAL), str(index), repr(info.identity), str(number)],
            capture_output=True,
            check=False,
            timeout=_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return f"a one-line kernel has not finished after {_TIMEOUT_S:.0f} s"
    except (OSError, TypeError) as error:  # the latter if the interpreter's path is unknown
        return f"no process can be started to try it ({one_line(error)})"
    if done.returncode == 0:
        return ""
    if info.platform == POCL and _missing_linker():
        return "it cannot link kernels: it needs ld, libgcc and libc.so"
    output = (done.stdout + b"\n" + done.stderr).decode(errors="replace")
    match = re.search(r"error: (?:.*error: )?(.*)", output)
    lines = [line for line in output.splitlines() if line.strip()]
    text = match[1] if match else lines[-1] if lines else ""
    if done.returncode < 0 or not text:
        text = f"it crashes the process ({exit_cause(done.returncode)}) {text}".rstrip()
    return one_line(text)[:200]


def _missing_linker() -> bool:
    """Return True if ``ld``, libc or libgcc, with which PoCL links, is not in its usual place."""
    usual = (
        _linker(),
        glob("/usr/lib*/gcc*/*/*/libgcc.a"),
        glob("/usr/lib*/libc.so") or glob("/usr/lib/*/libc.so"),
    )
    return sys.platform == "linux" and not all(usual)


def _linker() -> str | None:
    """Return the path at which a driver finds ``ld``; None without a PATH."""
    return shutil.which("ld", path=os.environ.get("PATH", ""))


def remedy(devices: Sequence[DeviceInfo]) -> str:
    """Return how to get a device that works, the best way first."""
    if any(info.platform == POCL for info in devices) and _missing_linker():
        return "on Debian or Ubuntu: apt-get install gcc libc6-dev"
    ways = ["install your GPU's driver"]
    if sys.platform == "linux":
        ways.append("apt-get install pocl-opencl-icd (or conda install -c conda-forge pocl)")
    elif sys.platform == "darwin":
        ways.append("conda install -c conda-forge pocl")
    ways.append(f"{install_command('intel')} (x86-64, Linux and Windows)")
    return ", or ".join(ways)


def _cached_faults() -> dict[str, tuple[str, float]]:
    """Return fault and time of each trial, by key; damaged rows are left out."""
    faults = {}
    for key, row in cached_rows(_FILE).items():
        with suppress(ValueError, TypeError, OverflowError):
            text, at_s = row
            faults[key] = str(text), float(at_s)
    return faults


def _cache_faults(faults: dict[str, str]) -> None:
    cache_rows(_FILE, {key: (message, time.time()) for key, message in faults.items()})
