"""Other systems, mostly faked: opening OpenGL, locking files, installing."""

import fcntl
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import moderngl
import numpy as np
import pytest
from packaging.requirements import Requirement

from tests.support.errors import raises, refuses, warns
from tests.support.images import image
from volspec._files import exclusive_folder, write_whole
from volspec._gpu import opengl
from volspec.basis import SpectralBasis
from volspec.errors import InputError, OpenGLError
from volspec.image import CoefficientImage
from volspec.relight import Relighter
from volspec.spectra import light

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


@pytest.mark.parametrize(
    ("system", "display", "ways", "remedy"),
    [
        ("linux", None, ["egl"], "libegl1"),
        ("linux", ":0", ["egl", None], "libegl1"),
        ("darwin", None, [None], "Mac"),
        ("win32", None, [None], "Windows"),
    ],
)
def test_each_system_s_own_ways_to_a_headless_context_are_tried_before_its_remedy_is_named(
    monkeypatch, system, display, ways, remedy
):
    tried = []

    def create(require: int, **settings: Any) -> None:
        tried.append(settings.get("backend"))  # None: the default of glcontext
        raise Exception(f"way {len(tried)} is closed")

    monkeypatch.setattr(moderngl, "create_standalone_context", create)
    monkeypatch.setattr(sys, "platform", system)
    monkeypatch.delenv("DISPLAY", raising=False)
    if display:
        monkeypatch.setenv("DISPLAY", display)
    with raises(OpenGLError, "unsupported") as caught:
        opengl.headless_context()
    assert tried == ways and "closed" in caught.value.problem and remedy in caught.value.remedy


GLX = """
import sys
from volspec._gpu import opengl
from volspec.image import CoefficientImage
from volspec.relight import Relighter
from volspec.spectra import light
opengl._EGL["libegl"] = "libnone.so.1"
with Relighter(CoefficientImage.load(sys.argv[1]), "gl") as relighter:
    frame = relighter.frame(light("A"))
print(opengl.egl_handle(), frame[4, 4].tolist())
"""


def grey_image() -> CoefficientImage:
    """8 x 8 opaque pixels of one reflectance."""
    return image(np.full((8, 8, 7), 0.25), SpectralBasis.load("general-7"))


def test_a_display_draws_for_linux_without_egl(tmp_path):
    if shutil.which("Xvfb") is None:
        pytest.skip("no display can be made: apt-get install xvfb")
    grey = grey_image()
    grey.save(tmp_path / "grey.exr")
    words = ("Xvfb", "-displayfd", "1", "-screen", "0", "64x64x24", "-nolisten", "tcp")
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL, "text": True}
    with subprocess.Popen(words, **pipes) as server:
        try:
            drawn = subprocess.run(
                [sys.executable, "-c", GLX, tmp_path / "grey.exr"],
                env={**os.environ, "DISPLAY": f":{server.stdout.readline().strip()}"},
                capture_output=True,
                text=True,
            )
        finally:
            server.terminate()
    assert drawn.returncode == 0, drawn.stderr
    with Relighter(grey, "numpy") as relighter:
        expected = relighter.frame(light("A"))[4, 4].tolist()
    assert drawn.stdout.strip() == f"0 {expected}"


def test_without_moderngl_relighting_uses_numpy_and_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "moderngl", None)
    monkeypatch.setattr(opengl, "_idle_contexts", list)  # none left by another test
    with warns("moderngl", "pip"):
        Relighter(grey_image()).close()
    refuses(opengl.window_context, "missing ", OpenGLError)


def test_on_windows_too_one_export_keeps_others_out(monkeypatch, tmp_path):
    def locking(handle: int, mode: int, size: int) -> None:
        assert not Path(f"/proc/self/fd/{handle}").readlink().is_dir(), "Windows opens no folders"
        try:
            fcntl.flock(handle, mode)
        except BlockingIOError as error:
            raise PermissionError(error.errno, error.strerror) from None

    nowait = fcntl.LOCK_EX | fcntl.LOCK_NB
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=nowait))
    monkeypatch.setattr(sys, "platform", "win32")
    folder = tmp_path / "frames"
    for _ in range(2):
        with exclusive_folder(folder):
            with raises(InputError, "state"), exclusive_folder(folder):
                pass
            folder.rmdir()
        assert list(tmp_path.iterdir()) == []


def test_a_file_flushed_to_the_disk_is_open_for_writing(monkeypatch, tmp_path):
    """Windows flushes no other."""
    kept = []
    monkeypatch.setattr(os, "fsync", lambda handle: kept.append(fcntl.fcntl(handle, fcntl.F_GETFL)))
    with write_whole(tmp_path / "a.txt") as temporary:
        temporary.write_text("whole")
    assert [flags & os.O_ACCMODE for flags in kept] == [os.O_RDWR]


@pytest.mark.parametrize(
    ("system", "machine", "expected"),
    [
        ("linux", "x86_64", {"pocl-binary-distribution", "moderngl", "intel-opencl-rt", "embreex"}),
        ("linux", "aarch64", set()),
        ("darwin", "arm64", {"moderngl", "embreex"}),
        ("win32", "AMD64", {"moderngl", "intel-opencl-rt", "embreex"}),
        ("win32", "ARM64", {"moderngl"}),
    ],
)
def test_what_has_no_wheel_on_a_machine_is_not_asked_for_there(system, machine, expected):
    """`make trust` asks the package index (tools/installs.py)."""
    here = {"sys_platform": system, "platform_machine": machine}
    extras = PROJECT["optional-dependencies"]
    listed = [*PROJECT["dependencies"], *extras["intel"], *extras["rooms"]]
    conditional = [each for each in map(Requirement, listed) if each.marker]
    asked = {each.name for each in conditional if each.marker.evaluate(here)}
    assert asked - {"intel-cmplr-lib-rt"} == expected
