"""Devices by name, buffers in the host's own memory, and one line for what does not work."""

import gc
import mmap
import re
import sys
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pyopencl as cl
import pytest

from tests.support.errors import raises
from tests.support.fixtures import Patch
from tests.support.patience import in_fork
from tests.support.raycasts import cube, even_gold
from volspec import doctor
from volspec._gpu import device_list as devices
from volspec._gpu import memory, opencl, sources
from volspec._gpu.device_list import DeviceInfo, choose_device
from volspec._gpu.opencl import Compute
from volspec._gpu.sources import Source
from volspec.camera import Camera
from volspec.errors import OpenCLError, ShapeError
from volspec.pipeline import Raycaster, raycast

FIRST = "__kernel void f(__global const uchar *x, __global int *y) { y[0] = x[0] + x[%d]; }\n"


@pytest.fixture(scope="module")
def compute() -> Compute:
    return Compute.open()


@pytest.fixture
def two_devices(monkeypatch: Patch) -> None:
    """A GPU and a CPU, as far as names go."""
    size = 8, 2**34, 2**32
    known = [
        DeviceInfo("NVIDIA H200", "NVIDIA CUDA", "OpenCL 3.0", "590.1", False, *size),
        DeviceInfo("pthread-AMD EPYC", devices.POCL, "OpenCL 3.0", "3.1+debian", True, *size),
    ]
    monkeypatch.setattr(devices, "devices", lambda: known)
    monkeypatch.setattr(devices, "_try", lambda index, info: "")


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


def sum_of_ends(compute: Compute, buffer: cl.Buffer, last: int) -> int:
    kernel = compute.kernel(Source(FIRST % last, ("<prelude>", "first.cl")), "f")
    result, answer = compute.output(4), np.empty(1, np.int32)
    kernel(compute.queue, (1,), None, buffer, result)
    compute.download(result, answer)
    return int(answer[0])


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="only Linux reports it")
def test_a_shared_array_is_not_copied_on_a_cpu(compute):
    if not compute.info.is_cpu:
        pytest.skip("only CPUs share")
    # At a page's start: of other arrays Intel's runtime makes a copy.
    values = np.frombuffer(mmap.mmap(-1, 100 << 20), np.uint8)
    values[:] = 3
    values.flags.writeable = False
    sum_of_ends(compute, compute.upload(values[:8]), 7)  # the compiler takes memory once
    before = resident_bytes()
    assert sum_of_ends(compute, compute.upload(values, share=True), values.size - 1) == 6
    assert resident_bytes() - before < 20 << 20
    copy = compute.upload(values)
    assert resident_bytes() - before > 80 << 20 and copy.size == values.size


def test_a_shared_array_lives_as_long_as_its_buffer(compute):
    class Watched(np.ndarray):
        """An array that takes weak references."""

    values = np.arange(9, dtype=np.uint8).view(Watched)
    alive = weakref.ref(values)
    taken = sum(compute._allocated.values())
    buffer = compute.upload(values, share=True)
    assert not compute.info.is_cpu or sum(compute._allocated.values()) == taken
    del values
    gc.collect()
    assert (alive() is not None) == compute.info.is_cpu
    assert sum_of_ends(compute, buffer, 8) == 8
    del buffer
    gc.collect()
    assert alive() is None


def test_kernels_of_one_source_are_built_together(monkeypatch):
    """Also by a program out of pyopencl's cache, which Intel's runtime had ended."""
    built = []
    build = Compute._build

    def counted(compute: Compute, source: Source, options: Any) -> Any:
        built.append(source)
        return build(compute, source, options)

    monkeypatch.setattr(Compute, "_build", counted)
    values = {"one": 1, "two": 2}
    kernel = "__kernel void {}(__global int *out) {{ *out = {}; }}\n".format
    text = "".join(kernel(*pair) for pair in values.items())
    source, found = Source(text, ("<prelude>", "both.cl")), np.empty(1, np.int32)
    for _ in range(2):  # the second context finds the program in the cache
        compute = Compute.open()
        for name in ("one", "two", "one"):
            out = compute.output(4)
            compute.kernel(source, name)(compute.queue, (1,), None, out)
            compute.download(out, found)
            assert found[0] == values[name]
    assert built == [source, source]


def test_the_kernels_used_last_are_cached(monkeypatch):
    monkeypatch.setattr(opencl, "MAX_KERNELS", 3)
    compute = Compute.open()

    def kernel(number: int) -> cl.Kernel:
        return compute.kernel(Source(FIRST % number, ("<prelude>", "first.cl")), "f")

    first = kernel(0)
    for number in range(1, 5):
        kernel(number)
        assert kernel(0) is first  # used again and again
    assert len(compute._kernels) == 3
    # One that was dropped is built again.
    assert sum_of_ends(compute, compute.upload(np.arange(4, dtype=np.uint8)), 1) == 1


def test_what_memory_does_not_suffice_for_or_no_kernel_reads_is_refused(monkeypatch):
    picture = "a picture", "cast a smaller one"
    compute = Compute.open()
    compute.info = DeviceInfo("tiny", "test", "1", "1", False, 1, 3 << 20, 2 << 20)
    compute.require(3 << 20, *picture)
    buffer = compute.output(1 << 20)
    compute.require(2 << 20, *picture)
    with raises(OpenCLError, "size") as caught:
        compute.require(3 << 20, *picture)
    assert re.findall(r"[\d.]+(?= MiB)", str(caught.value)) == ["3.0", "2.0"]
    del buffer
    compute.require(3 << 20, *picture)
    for share in (False, True):
        with raises(ShapeError, "shape"):
            compute.upload(np.zeros((2, 3), np.float32).T, share=share)
    compute.info = DeviceInfo("cpu", "test", "1", "1", True, 1, 9 << 30, 2 << 30)
    monkeypatch.setattr(opencl, "host_free_bytes", lambda: 1 << 30)
    with raises(OpenCLError, "size"):
        compute.require(int(3.2 * 2**30), *picture)
    with raises(OpenCLError, "size"):
        compute.output(3 << 30)


def test_a_container_s_limit_is_the_host_s_memory(tmp_path):
    files = {
        "proc/meminfo": "MemTotal: 8192 kB\nMemFree: 1024 kB\nMemAvailable:    4096 kB\n",
        "sys/fs/cgroup/memory.max": "max\n",
        "sys/fs/cgroup/memory.current": "3000000\n",
        "sys/fs/cgroup/memory.stat": "anon 2000000\ninactive_file 1000000\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    assert memory.host_free_bytes(tmp_path) == 4096 * 1024
    (tmp_path / "sys/fs/cgroup/memory.max").write_text("4000000\n")
    assert memory.host_free_bytes(tmp_path) == 2_000_000
    assert memory.host_free_bytes(tmp_path / "nowhere") == sys.maxsize


UNDECLARED = "error: use of undeclared identifier 'zzzz'"
BROKEN = (
    "#define A 1\n"
    '#line 1 "kernels/broken.cl"\n'
    "__kernel void f(__global int *x) {\n"
    '#line 1 "kernels/include/part.clh"\n'
    "    int y = 2;\n"
    "    int z = %s;\n"
    '#line 3 "kernels/broken.cl"\n'
    "    x[0] = %s;\n"
    "}\n"
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BROKEN % ("zzzz", "y"), f'kernels/include/part.clh:2:13: {UNDECLARED}: "int z = zzzz;"'),
        (BROKEN % ("1", "zzzz"), f'kernels/broken.cl:3:12: {UNDECLARED}: "x[0] = zzzz;"'),
        ("int = 1;\n" + BROKEN % (1, 1), "<prelude>:1:5: error: expected identifier or '(': \"int"),
        ("#error no such lanes\n", '<prelude>:1:2: error: no such lanes: "#error no such lanes"'),
    ],
)
def test_a_kernel_that_does_not_build_quotes_the_line(compute, text, message, monkeypatch):
    monkeypatch.setattr(devices, "_try", lambda index, info: "")
    source = Source(text, ("<prelude>", "kernels/broken.cl", "kernels/include/part.clh"))
    with raises(OpenCLError, "unsupported") as caught:
        compute.kernel(source, "f", ["-w"])
    start = f"kernels/broken.cl does not build on {compute.info.name} with -w: "
    assert str(caught.value).startswith(start) and message in str(caught.value)
    assert "VOLSPEC_DEVICE" in caught.value.remedy
    monkeypatch.setenv("PYOPENCL_BUILD_OPTIONS", "-Dif=x")
    with raises(OpenCLError, "unsupported") as caught:
        compute.kernel(source, "f", ["-w"])
    assert caught.value.remedy == "unset PYOPENCL_BUILD_OPTIONS"


@pytest.mark.parametrize("form", ["error: {}: {}", "{}: error: {}", "{}: fatal error: {}"])
def test_logs_are_read_in_the_forms_of_pocl_and_of_clang(form):
    source = Source(BROKEN % ("1", "foo"), ("<prelude>", "kernels/broken.cl"))
    error = form.format("kernels/broken.cl:3:12", "no 'foo'")
    log = f"output of a driver\nkernels/broken.cl:1:1: warning: hm\n{error}"
    expected = "kernels/broken.cl:3:12: error: no 'foo': \"x[0] = foo;\""
    # NVIDIA's has no file's name, and lines of the whole text.
    nvidia, other = "<kernel>:8:12: error: no 'foo'", "the linker\n  gave up"
    texts = [sources.first_error(text, source) for text in (log, nvidia, other)]
    assert texts == [expected, expected, "the linker gave up"]


@pytest.mark.usefixtures("two_devices")
def test_devices_are_chosen_by_name_platform_number_or_variable(monkeypatch):
    monkeypatch.delenv("VOLSPEC_DEVICE", raising=False)
    names = (None, "h200", "epyc", "cuda", "portable", "1", "3.1+deb")
    assert [choose_device(name) for name in names] == [0, 0, 1, 0, 1, 1, 1]
    monkeypatch.setenv("VOLSPEC_DEVICE", "EPYC")
    assert choose_device() == 1 and choose_device("nvidia") == 0
    monkeypatch.setenv("VOLSPEC_DEVICE", "")
    assert choose_device() == 0


@pytest.mark.usefixtures("needs_opencl", "two_devices")
@pytest.mark.parametrize(
    ("make", "variable", "code", "parts"),
    [
        (lambda: choose_device("radeon"), "", "unknown", ["NVIDIA H200 (NVIDIA CUDA)", "AMD EPYC"]),
        (lambda: choose_device("2"), "", "unknown", []),
        (lambda: choose_device(), "nvidia h20x", "unknown", ["(VOLSPEC_DEVICE)"]),
        (lambda: Compute.open("portable"), "", "unsupported", ["MEMORY", "VOLSPEC_DEVICE"]),
    ],
)
def test_devices_that_are_not_there_or_make_no_context_are_named(
    make, variable, code, parts, monkeypatch
):
    def context(devices: object) -> None:
        raise cl.RuntimeError("Context failed:\n OUT_OF_HOST_MEMORY")

    found = devices.all_devices() * 2  # one for each of the two names
    monkeypatch.setattr(opencl, "all_devices", lambda: found)
    monkeypatch.setattr(cl, "Context", context)
    monkeypatch.setenv("VOLSPEC_DEVICE", variable)
    with raises(OpenCLError, code) as caught:
        make()
    assert [part for part in parts if part not in str(caught.value)] == []


@pytest.mark.usefixtures("needs_opencl")
def test_doctor_shows_the_device_of_the_variable(monkeypatch):
    monkeypatch.setattr(devices, "_try", lambda index, info: "")
    monkeypatch.setenv("VOLSPEC_DEVICE", "0")
    found = doctor.examine()
    assert found.casts_on == 0 and found.healthy
    monkeypatch.setenv("VOLSPEC_DEVICE", "nonsense")
    found = doctor.examine()
    assert found.casts_on is None and not found.healthy
    assert any("'nonsense'" in problem for problem in found.problems)


def test_a_fork_is_told_to_spawn_unless_it_casts_nothing(compute):
    ball, transfer = cube(4), even_gold(0.5)
    caster, camera = Raycaster(ball), Camera.orbit(ball)
    for cast in (
        Compute.open,
        lambda: Raycaster(ball),
        lambda: raycast(ball, transfer, camera, (8, 8), caster=caster),
        lambda: compute.upload(np.zeros(4)),
    ):
        error = in_fork(cast)
        assert (type(error), error.code) == (OpenCLError, "state")
        assert "multiprocessing.get_context('spawn')" in error.remedy
    assert in_fork(lambda: cube(3, 2.0).range) == (2.0, 2.0)
