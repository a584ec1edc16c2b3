"""Pictures cast into a Relighter without the host, where OpenCL and OpenGL share memory.

No CPU device shares with OpenGL, so the whole flow is tested with the few calls of the driver
replaced (`Driver`). The last test is the real thing, for a machine that offers it:

    VOLSPEC_DEVICE=… python -m pytest -rs tests/gpu/test_sharing.py -k hardware
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import moderngl
import numpy as np
import pyopencl as cl
import pytest

import volspec as vs
from tests.raycast.test_into import BALL, GROUPS, cast, frame, third
from tests.support.errors import raises
from tests.support.fixtures import Patch, slow
from volspec import doctor
from volspec._gpu import device_list as devices
from volspec._gpu import sharing
from volspec._gpu.device_list import all_devices, choose_device
from volspec._gpu.opencl import Compute
from volspec.errors import CastCancelled, OpenCLError
from volspec.raycast.launch.row_batches import RowBatches


def device() -> cl.Device:
    return all_devices()[choose_device()]


def refusal(context: Any) -> str:
    with raises(OpenCLError, "unsupported") as caught:
        vs.Raycaster(BALL, context=context)
    return str(caught.value)


def test_what_cannot_share_is_refused_without_its_driver(context, monkeypatch):
    """PoCL 3.0 makes a shared context, and ends the process at the first buffer."""
    chosen = device()  # tried on this system
    monkeypatch.setattr(cl, "have_gl", lambda: False)
    assert sharing.BUILD in refusal(context)
    monkeypatch.setattr(cl, "have_gl", lambda: True)
    if sharing.EXTENSION not in chosen.extensions.split():
        parts = sharing.EXTENSION, chosen.name.strip(), sharing.DEVICE_VARIABLE
        assert [part for part in parts if part not in refusal(context)] == []
    for system in ("darwin", "win32"):
        monkeypatch.setattr(sys, "platform", system)
        assert system in (sharing.refusal(chosen) or "")


@dataclass
class Driver:
    """A fake of a driver that shares: OpenCL's copy of a buffer, which OpenGL gets back.

    The content goes back when OpenCL has finished after the release, no sooner; ``calls`` holds
    the requests, in order.
    """

    calls: list[str] = field(default_factory=list)
    buffers: dict[int, Any] = field(default_factory=dict)
    pending: list[Any] = field(default_factory=list)
    refuses: str = ""

    def buffer(self, context: cl.Context, flags: int, bufobj: int) -> cl.Buffer:
        assert flags == cl.mem_flags.WRITE_ONLY
        if self.refuses == "buffer":
            raise cl.LogicError("clCreateFromGLBuffer failed: INVALID_GL_OBJECT")
        values = np.full(self.buffers[bufobj].size // 4, np.nan, np.float32)
        flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
        shared = Copy(context, flags, hostbuf=values)
        shared.name = bufobj
        return shared

    def acquire(self, queue: cl.CommandQueue, mem_objects: list[Copy]) -> None:
        assert self.calls[-1] == "glFinish"
        self.calls.append("acquire")

    def release(self, queue: cl.CommandQueue, mem_objects: list[Copy]) -> None:
        self.calls.append("release")
        for shared in mem_objects:
            values = np.empty(shared.size // 4, np.float32)
            cl.enqueue_copy(queue, values, shared)
            self.pending.append((self.buffers[shared.name], values))

    def finished(self) -> None:
        if self.pending:
            self.calls.append("clFinish")
        while self.pending:
            buffer, values = self.pending.pop()
            buffer.write(values.tobytes())


class Copy(cl.Buffer):
    """A buffer with the OpenGL name of its original."""

    name: int


@pytest.fixture
def driver(context: Any, monkeypatch: Patch) -> Driver:
    made = Driver()
    if not (device().type & cl.device_type.CPU):
        pytest.skip("PoCL plays the driver here")

    class Queue(cl.CommandQueue):
        def finish(self) -> None:
            super().finish()
            made.finished()

    def watched(name: str, call: str, kind: type) -> None:
        original = getattr(kind, name)

        def wrapper(self: Any, *arguments: Any, **settings: Any) -> Any:
            made.calls.append(call)
            result = original(self, *arguments, **settings)
            if call == "glGenBuffers":
                made.buffers[result.glo] = result
            return result

        monkeypatch.setattr(kind, name, wrapper)

    watched("finish", "glFinish", moderngl.Context)
    watched("buffer", "glGenBuffers", moderngl.Context)
    watched("write", "glTexSubImage3D", moderngl.TextureArray)
    watched("_launch", "band", RowBatches)
    monkeypatch.setattr(cl, "CommandQueue", Queue)
    monkeypatch.setattr(cl, "GLBuffer", made.buffer, raising=False)
    monkeypatch.setattr(cl, "enqueue_acquire_gl_objects", made.acquire, raising=False)
    monkeypatch.setattr(cl, "enqueue_release_gl_objects", made.release, raising=False)
    monkeypatch.setattr(sharing, "refusal", lambda device: None)
    monkeypatch.setattr(sharing, "_properties", lambda device, here: [])
    return made


@contextmanager
def sharing_pair(context: Any, **spec: Any) -> Iterator[tuple[vs.Raycaster, vs.Relighter]]:
    """A caster and a relighter of one context, which shows a first picture."""
    caster = vs.Raycaster(BALL, context=context)
    with vs.Relighter(cast(0, spec=spec), "gl", context=context) as relighter:
        yield caster, relighter


@pytest.mark.parametrize(
    "spec", [{}, {"half": True}, slow({"groups": GROUPS})], ids=["float", "half", "groups"]
)
def test_the_frame_of_a_shared_picture_is_that_of_the_host_s_bit_by_bit(driver, context, spec):
    with sharing_pair(context, **spec) as (caster, relighter):
        for azimuth in (60, 120):
            driver.calls.clear()
            image = cast(azimuth, spec=spec, caster=caster, into=relighter)
            calls = [call for call in driver.calls if call != "glGenBuffers"]
            bands = calls.count("band")
            assert bands > 3
            taken = ["glFinish", "acquire", *["band"] * bands, "release"]
            assert calls == [*taken, "clFinish", "glTexSubImage3D"]
            truth = cast(azimuth, spec=spec)
            assert np.array_equal(image.coefficients, truth.coefficients)
            with vs.Relighter(truth, "gl") as host:
                assert np.array_equal(frame(relighter, truth.groups), frame(host, truth.groups))


@pytest.mark.parametrize(
    ("error", "how", "refuses", "calls"),
    [
        (CastCancelled, {"cancel": third}, "", ["release", "clFinish"]),
        (ZeroDivisionError, {"progress": lambda: lambda _: 1 / 0}, "", ["release", "clFinish"]),
        (OpenCLError, {}, "buffer", ["glFinish"]),
    ],
    ids=["cancelled", "failed", "refused"],
)
def test_a_shared_cast_that_ends_early_leaves_the_picture_shown(
    driver, context, error, how, refuses, calls
):
    """OpenGL has the buffer back, and nothing of it was shown."""
    with sharing_pair(context) as (caster, relighter):
        before = frame(relighter)
        driver.calls.clear()
        driver.refuses = refuses
        with pytest.raises(error) as caught:
            cast(60, caster=caster, into=relighter, **{name: of() for name, of in how.items()})
        assert [call for call in driver.calls if call != "glGenBuffers"][-len(calls) :] == calls
        assert refuses == "" or "INVALID_GL_OBJECT" in str(caught.value)
        assert np.array_equal(frame(relighter), before)
        driver.refuses = ""
        cast(60, caster=caster, into=relighter)
        assert not np.array_equal(frame(relighter), before)


def test_a_sharing_caster_casts_as_any_other_to_the_host(driver, context):
    image = cast(60, caster=vs.Raycaster(BALL, context=context))
    assert np.array_equal(image.coefficients, cast(60).coefficients)
    assert "acquire" not in driver.calls


def test_a_relighter_of_another_context_and_a_driver_that_makes_none_are_refused(
    driver, context, monkeypatch
):
    caster = vs.Raycaster(BALL, context=context)
    for backend, contexts in (("gl", 2), ("numpy", 1)):
        with vs.Relighter(cast(0), backend) as relighter:
            before = frame(relighter)
            with raises(OpenCLError) as caught:
                cast(60, caster=caster, into=relighter)
            assert str(caught.value).count("0x") == contexts
            assert np.array_equal(frame(relighter), before)

    def make(devices: Any, properties: Any) -> None:
        raise cl.LogicError("Context failed:\n INVALID_GL_SHAREGROUP_REFERENCE_KHR")

    monkeypatch.setattr(cl, "Context", make)
    assert "SHAREGROUP" in refusal(context)
    monkeypatch.setattr(sharing, "current", lambda: None)
    assert "SHAREGROUP" not in refusal(context)


def test_the_current_context_is_known_by_its_handle(context):
    here = sharing.current()
    assert here and here.handle and here.display and here.display_property.startswith("EGL")
    assert f"{here.handle:#x}" in sharing.context_name(context, here)


@pytest.mark.usefixtures("needs_opencl")
def test_doctor_reports_why_memory_is_not_shared(context, monkeypatch):
    monkeypatch.setattr(devices, "_try", lambda index, info: "")
    for message in ("moon", None):
        monkeypatch.setattr(
            "volspec._gpu.sharing_fault", lambda device, gl, message=message: message
        )
        found = doctor.examine()
        assert found.no_sharing == message and found.healthy


def test_a_device_shares_on_this_hardware(context):
    """Frames equal those through the host, before and after a cancelled cast."""
    if message := sharing.sharing_fault(device(), context):
        pytest.skip(message)
    assert Compute.open(gl=context).sharing
    for spec in ({}, {"groups": GROUPS}, {"half": True}):
        with sharing_pair(context, **spec) as (caster, relighter):
            image = cast(60, spec=spec, caster=caster, into=relighter)
            with pytest.raises(CastCancelled):
                cast(120, spec=spec, caster=caster, into=relighter, cancel=third())
            with vs.Relighter(image, "gl", context=context) as host:
                assert np.array_equal(frame(relighter, image.groups), frame(host, image.groups))
