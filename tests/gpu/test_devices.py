"""Devices are tried before they are used: those that cannot run a kernel are passed over."""

import io
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from tests.support.errors import raises
from tests.support.fixtures import Patch
from volspec import _cache, doctor
from volspec._gpu import device_list as devices
from volspec._gpu import opencl
from volspec._gpu.device_list import POCL, DeviceInfo, choose_device, device_key
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source
from volspec.errors import OpenCLError

NO_TARGET = "unknown target CPU 'generic'"
INTEL, NEW, OLD = (
    DeviceInfo(name, platform, "OpenCL 3.0", driver, True, 8, 2**34, 2**32)
    for name, platform, driver in [
        ("AMD EPYC", "Intel(R) OpenCL", "2026.22"),
        ("pthread-skylake-AMD EPYC", POCL, "3.1+debian"),
        ("pthread-AMD EPYC", POCL, "3.0-rc2"),
    ]
)


@pytest.fixture
def put_devices(monkeypatch: Patch, tmp_path: Path) -> Callable[..., list[str]]:
    """Put devices in place of the machine's, some at fault; list drivers as they are tried."""
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    monkeypatch.delenv("VOLSPEC_DEVICE", raising=False)

    def put(*known: DeviceInfo, faults: dict[str, str]) -> list[str]:
        tries: list[str] = []

        def ask(index: int, info: DeviceInfo) -> str:
            tries.append(info.driver)
            return faults.get(info.driver, "")

        monkeypatch.setattr(devices, "devices", lambda: list(known))
        monkeypatch.setattr(opencl, "devices", lambda: list(known))
        monkeypatch.setattr(devices, "_try", ask)
        return tries

    return put


def test_the_first_device_that_works_is_chosen_and_tried_once(put_devices):
    tries = put_devices(OLD, NEW, INTEL, faults={"3.0-rc2": NO_TARGET})
    assert [choose_device() for _ in range(3)] == [1, 1, 1]
    assert tries == ["3.0-rc2", "3.1+debian"]
    # Another start, and the list of devices has changed meanwhile.
    tries = put_devices(INTEL, OLD, NEW, faults={"3.0-rc2": NO_TARGET})
    assert choose_device() == 0 and tries == ["2026.22"]
    tries = put_devices(OLD, NEW, faults={"3.0-rc2": NO_TARGET})
    assert choose_device() == 1 and tries == []


@pytest.mark.usefixtures("needs_opencl")
def test_a_device_is_the_same_with_other_memory():
    """PoCL 5 states another size at each start of a process."""
    first = devices.devices()[0]
    later = replace(first, memory_bytes=first.memory_bytes + 4096)
    assert later == first and devices._try(0, later) == ""


@pytest.mark.skipif(sys.platform != "linux", reason="the remedies are Linux's")
@pytest.mark.parametrize(
    ("known", "how", "remedy"),
    [
        ((NEW, OLD), {"name": "1"}, "VOLSPEC_DEVICE"),
        ((OLD,), {}, "pocl-opencl-icd.*conda-forge.*volspec.intel"),
        ((OLD,), {"no_linker": True}, "libc6-dev"),
        ((OLD,), {"flags": "-Dfloat=half"}, f"^unset {devices.BUILD_VARIABLE}$"),
        ((OLD,), {"programs": __file__}, "set POCL_CACHE_DIR"),
    ],
    ids=["by name", "none works", "no linker", "flags", "no cache"],
)
def test_if_none_that_is_meant_works_the_error_has_each_fault_and_the_remedy(
    put_devices, monkeypatch, tmp_path, known, how, remedy
):
    monkeypatch.setenv("POCL_CACHE_DIR", how.get("programs", str(tmp_path)))
    monkeypatch.setattr(devices, "_missing_linker", lambda: how.get("no_linker", False))
    monkeypatch.setenv(devices.BUILD_VARIABLE, how.get("flags", ""))
    tries = put_devices(*known, faults={OLD.driver: NO_TARGET})
    for _ in range(2):
        with raises(OpenCLError, "unsupported") as caught:
            choose_device(how.get("name"))
    for part in (OLD.name, OLD.platform, OLD.driver, NO_TARGET):
        assert part in caught.value.problem
    assert re.search(remedy, caught.value.remedy)
    # If nothing works the cache is ignored: the missing part may have been installed.
    assert len(tries) >= 3
    monkeypatch.setattr(devices, "_try", lambda index, info: "")
    assert choose_device("portable") == 0


def test_a_failure_is_cached_for_a_day(put_devices, monkeypatch):
    tries = put_devices(OLD, NEW, faults={"3.0-rc2": NO_TARGET})
    for clock_s, times in ((1e6, 1), (1e6 + 3600, 1), (1e6 + 9e4, 2), (1e6 - 9e4, 3)):
        monkeypatch.setattr(time, "time", lambda clock_s=clock_s: clock_s)
        choose_device()
        assert tries.count("3.0-rc2") == times, clock_s
    assert tries.count("3.1+debian") == 1


@pytest.mark.parametrize(
    "content", ["", "[", "[]", '{"a": 1}', '{"a": ["x"]}', "[" * 99999, "\udc80"]
)
def test_a_damaged_cache_is_ignored(put_devices, tmp_path, content):
    tries = put_devices(NEW, faults={})
    choose_device()
    (tmp_path / "devices.json").write_bytes(content.encode(errors="surrogateescape"))
    assert choose_device() == 0 and len(tries) == 2
    rows = json.loads((tmp_path / "devices.json").read_text())
    assert rows[device_key(0, [NEW])][0] == ""
    assert choose_device() == 0 and len(tries) == 2


def test_another_linker_and_other_build_options_repeat_the_trial(
    put_devices, monkeypatch, tmp_path
):
    """PoCL ends the process if it cannot link: an old answer must not hide that.

    A trial's compiler prints into a pipe, the later build's onto the terminal.
    """
    tries = put_devices(NEW, faults={})
    choose_device()
    (tmp_path / "ld").write_text("#!/bin/sh\nexit 1\n")
    (tmp_path / "ld").chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    choose_device()
    monkeypatch.delenv("PATH")
    choose_device()
    monkeypatch.setenv(devices.BUILD_VARIABLE, "-Dfloat=half")
    choose_device()
    assert len(tries) == 4


def test_drivers_of_one_name_are_distinguished(put_devices, monkeypatch):
    put_devices(NEW, NEW, faults={})
    monkeypatch.setattr(devices, "_try", lambda index, info: NO_TARGET if index == 0 else "")
    assert choose_device() == 1


@pytest.mark.slow
def test_a_failing_compile_repeats_the_trial(monkeypatch, tmp_path):
    """The cache says that the device works, which is no longer so."""
    compute = Compute.open()
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    source = Source("__kernel void f() { broken }", ("<prelude>", "kernels/f.cl"))
    for answer, part in (("", source.files[1]), (NO_TARGET, NO_TARGET)):
        monkeypatch.setattr(devices, "_try", lambda index, info, answer=answer: answer)
        with raises(OpenCLError, "unsupported") as caught:
            compute.kernel(source, "f")
        assert part in str(caught.value)


def test_a_real_trial_compiles_runs_and_is_not_repeated(monkeypatch, tmp_path):
    monkeypatch.setattr(_cache, "cache_folder", lambda: tmp_path)
    found, index = devices.devices(), choose_device()
    for _ in range(2):
        assert devices.fault(index, found) == "" and (tmp_path / "devices.json").exists()
        monkeypatch.setattr(devices, "_try", None)


@pytest.mark.slow
def test_a_driver_that_cannot_compile_is_named_by_the_doctor(tmp_path):
    """PoCL fails on this flag as on a CPU that it does not know: when it builds."""
    if not all(device.platform == POCL for device in devices.devices()):
        pytest.skip("a device here is none of PoCL, and would work")
    environment = os.environ | dict.fromkeys(("XDG_CACHE_HOME", "OCL_ICD_VENDORS"), str(tmp_path))
    environment["POCL_EXTRA_BUILD_FLAGS"] = "-no-such-flag"
    environment.pop("VOLSPEC_DEVICE", None)
    command = [sys.executable, "-m", "volspec", "doctor"]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode != 0 and "-no-such-flag" in " ".join(done.stdout.split())


@pytest.mark.usefixtures("needs_opencl")
def test_doctor_lists_devices_that_fail_next_to_the_one_that_works(put_devices):
    tries = put_devices(INTEL, NEW, OLD, faults={"3.0-rc2": NO_TARGET})
    found = doctor.examine()
    assert found.casts_on == 0 and found.healthy and found.faults == ("", "", NO_TARGET)
    assert sorted(tries) == ["2026.22", "3.0-rc2", "3.1+debian"]
    console = Console(record=True, width=120, file=io.StringIO())
    found.print(console)
    assert NO_TARGET in " ".join(console.export_text().split())
    doctor.examine()
    assert len(tries) == 6, "the doctor tries again, whatever is cached"


@pytest.mark.parametrize("system", ["linux", "win32"])
def test_intel_s_wheel_is_registered_while_the_loader_looks(system, monkeypatch, tmp_path):
    """Fake the wheel: the variables' values, and that nothing stays."""
    library, vendors = tmp_path / "libintelocl.so", tmp_path / "vendors"
    vendors.mkdir()
    (vendors / "gpu.icd").write_text("libgpu.so\n")
    monkeypatch.setattr(devices, "_intel_library", lambda: library)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.setenv("OPENCL_VENDOR_PATH", str(vendors))
    monkeypatch.delenv("OCL_ICD_VENDORS", raising=False)
    before = dict(os.environ)
    with devices._intel_registered():
        if system == "win32":
            assert os.environ["OCL_ICD_FILENAMES"] == str(library)
        else:
            folder = Path(os.environ["OCL_ICD_VENDORS"])
            lines = sorted(path.read_text().strip() for path in folder.glob("*.icd"))
            assert lines == [str(library), "libgpu.so"]
    assert dict(os.environ) == before
    # Somebody who names one driver means that alone; one who has registered it needs no help.
    (vendors / "intel.icd").write_text("/opt/libintelocl.so\n")
    monkeypatch.setattr(sys, "platform", "linux")
    for place in (vendors, vendors / "gpu.icd"):
        monkeypatch.setenv("OPENCL_VENDOR_PATH", str(place))
        with devices._intel_registered():
            assert "OCL_ICD_VENDORS" not in os.environ
