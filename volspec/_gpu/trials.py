"""Try OpenCL devices: a one-line kernel, compiled and run once in a child process.

Drivers list devices for which they cannot compile (PoCL 3.0 of PyPI knows no CPU younger than its
LLVM 14), and some end the process when they try. The answer is cached in the user's cache folder by
device, driver and version; a failure for a day, since what was missing may have been installed.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import astuple, dataclass
from glob import glob
from pathlib import Path

from volspec import _cache
from volspec._child import child_command, exit_cause
from volspec._files import write_whole
from volspec.errors import InputError, one_line

POCL = "Portable Computing Language"
_LONGEST_S = 60.0
_FAILURE_IS_KEPT_S = 86400.0
_MOST_CACHED, _LARGEST_CACHE = 50, 1 << 20
_NUMBER = "the number that the kernel writes is not there"
# Prints its complaint and exits with 1; a driver may end it at any line.
_TRIAL = f"""
import os, warnings
index, expected, number = int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
warnings.simplefilter("ignore")
os.environ["PYOPENCL_NO_CACHE"] = "1"
import numpy as np
import pyopencl as cl
from volspec._gpu.devices import all_devices, describe
device = all_devices()[index]
if repr(describe(device)) != expected:
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
sys.exit("error: {_NUMBER}" if written[0] != number else 0)
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
    memory_bytes: int
    max_allocation_bytes: int


def fault(index: int, devices: Sequence[DeviceInfo], *, again: bool = False) -> str:
    """Return why a device does not work; empty if it does.

    Parameters
    ----------
    index : int
    devices : sequence of DeviceInfo
        All of them, in the order of `volspec._gpu.devices.all_devices`.
    again : bool
        Try the device now, whatever the cache says.
    """
    key = _key(index, devices)
    if not again:
        found, at_s = _read().get(key, ("never tried", 0.0))
        if not found or abs(time.time() - at_s) < _FAILURE_IS_KEPT_S:
            return found
    found = _try(index, devices[index])
    _keep({key: found})
    return found


def try_all(devices: Sequence[DeviceInfo]) -> tuple[str, ...]:
    """Try every device now, all at once; each one's fault, as `fault`."""
    with ThreadPoolExecutor() as threads:
        found = tuple(threads.map(_try, range(len(devices)), devices))
    _keep({_key(index, devices): each for index, each in enumerate(found)})
    return found


def _key(index: int, devices: Sequence[DeviceInfo]) -> str:
    """A device's name in the cache: two drivers of one name are told apart by their order."""
    info = devices[index]
    twins = devices[:index].count(info)
    words = [*map(str, astuple(info)[:4]), str(twins)]
    if info.platform == POCL:  # it links each kernel
        words.append("no linker" if _missing_linker() else str(_linker()))
    return " | ".join(words)


def _try(index: int, info: DeviceInfo) -> str:
    number = secrets.randbelow(2**31)  # compiled, not found in a driver's cache
    try:
        done = subprocess.run(
            [*child_command(_TRIAL), str(index), repr(info), str(number)],
            capture_output=True,
            check=False,
            timeout=_LONGEST_S,
        )
    except subprocess.TimeoutExpired:
        return f"a one-line kernel is not done after {_LONGEST_S:.0f} s"
    except (OSError, TypeError) as error:  # the latter if the interpreter's path is unknown
        return f"no process can be started to try it ({one_line(error)})"
    if done.returncode == 0:
        return ""
    if info.platform == POCL and _missing_linker():
        return "it cannot link kernels: it needs ld, libgcc and libc.so"
    said = (done.stdout + b"\n" + done.stderr).decode(errors="replace")
    complaint = re.search(r"error: (?:.*error: )?(.*)", said)
    lines = [line for line in said.splitlines() if line.strip()]
    text = complaint[1] if complaint else lines[-1] if lines else ""
    if done.returncode < 0 or not text:
        text = f"it ends the process ({exit_cause(done.returncode)}) {text}".rstrip()
    return one_line(text)[:200]


def _missing_linker() -> bool:
    """PoCL links with ``ld`` against libc and libgcc; True if one is not in the usual places."""
    usual = (
        _linker(),
        glob("/usr/lib*/gcc*/*/*/libgcc.a"),
        glob("/usr/lib*/libc.so") or glob("/usr/lib/*/libc.so"),
    )
    return sys.platform == "linux" and not all(usual)


def _linker() -> str | None:
    """Path of ``ld`` as a driver finds it: without a PATH nowhere."""
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
    ways.append("pip install 'volspec[intel]' (x86-64, Linux and Windows)")
    return ", or ".join(ways)


def _file() -> Path:
    return _cache.cache_folder() / "devices.json"


def _read() -> dict[str, tuple[str, float]]:
    """Fault and time of each trial, by key; of a damaged file none."""
    try:
        if not _file().is_file() or _file().stat().st_size > _LARGEST_CACHE:
            return {}
        rows = json.loads(_file().read_text(encoding="utf-8"))
        return {str(key): (str(found), float(at)) for key, (found, at) in rows.items()}
    except (OSError, ValueError, TypeError, AttributeError, RecursionError, OverflowError):
        return {}


def _keep(faults: dict[str, str]) -> None:
    rows = {key: row for key, row in _read().items() if key not in faults}
    rows |= {key: (found, time.time()) for key, found in faults.items()}
    newest = dict(list(rows.items())[-_MOST_CACHED:])
    with suppress(OSError, InputError), write_whole(_file()) as temporary:
        temporary.write_text(json.dumps(newest, indent=1), encoding="utf-8")
