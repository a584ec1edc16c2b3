"""Volumes are read in a child process: any fault of the child is a one-line error here."""

import gzip
import os
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import psutil
import pytest
import pyvista
import SimpleITK

from tests.support.errors import raises, warns
from tests.support.fixtures import Patch
from tests.support.patience import PATIENCE_S
from tests.support.volumes import META, NRRD, VALUES, nifti, write_nrrd
from volspec.errors import DeviceError, VolumeError
from volspec.volume import load_volume, reader_process
from volspec.volume.files.query import Query, Reading, Stored
from volspec.volume.load import read_here


def child_with(tmp_path: Path, body: str, monkeypatch: Patch) -> Path:
    """A file whose reader, in the child, runs a piece of code."""
    start = (
        "import os, sys, time; sys.path[:] = __import__('json').loads(sys.argv[1]); "
        "from volspec.volume.reader_process import serve\n"
        f"def read(query):\n    {body}\n"
        "serve(read, lambda query: 'numpy')"
    )
    monkeypatch.setattr(reader_process, "_START", start)
    monkeypatch.setattr(reader_process, "_idle_processes", lambda owner: [])
    return write_nrrd(tmp_path / "v.nrrd")


SIGNAL = "os.kill(os.getpid(), __import__('signal').{})".format
PERMISSION = "raise PermissionError(13, 'Permission denied', 'b.dcm')"


@pytest.mark.parametrize(
    ("body", "code", "word"),
    [
        (SIGNAL("SIGSEGV"), "damaged", "SIGSEGV"),
        (SIGNAL("SIGABRT"), "damaged", "SIGABRT"),
        (PERMISSION, "invalid", "b.dcm"),
        ("raise KeyError('a\\nb')", "damaged", "v.nrrd"),
        # A small file that declares much gets no more time.
        ("time.sleep(600)", "damaged", "v.nrrd"),
        ("query.declare(1 << 40); time.sleep(600)", "damaged", "v.nrrd"),
        pytest.param(
            *("query.declare(48); bytearray(1 << 30)", "size", "v.nrrd"),
            marks=pytest.mark.skipif(sys.platform != "linux", reason="only Linux limits memory"),
        ),
    ],
    ids=["segment", "abort", "permission", "error", "hang", "long hang", "memory"],
)
def test_a_fault_of_the_reader_is_one_line(tmp_path, body, code, word, monkeypatch):
    monkeypatch.setattr(reader_process, "_TIMEOUT_S", 0.5 if "sleep" in body else PATIENCE_S)
    path = child_with(tmp_path, body, monkeypatch)
    with raises(VolumeError, code) as caught:
        load_volume(path)
    assert word in str(caught.value)


def test_many_threads_read_at_once_and_leave_the_output_alone(tmp_path):
    """Libraries' messages are caught in the child: this process's output is never redirected."""
    head = NRRD.replace("raw", "gzip").encode()
    for k in range(4):
        (tmp_path / f"{k}.nrrd").write_bytes(head + gzip.compress((VALUES + k).tobytes()))
    (tmp_path / "bad.nrrd").write_bytes(head + b"damaged" * 20)
    output = os.fstat(1), os.fstat(2)

    def read(k: int) -> None:
        for _ in range(4):
            assert np.array_equal(load_volume(tmp_path / f"{k}.nrrd").values, VALUES + k)
            with raises(VolumeError, "damaged"):
                load_volume(tmp_path / "bad.nrrd")
            assert (os.fstat(1), os.fstat(2)) == output, "redirected"

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(read, range(4)))


def python(*words: Any, **how: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, **how)


def test_a_script_without_a_main_guard_reads_volumes_and_leaves_no_process(tmp_path):
    (tmp_path / "v.nii").write_bytes(nifti(VALUES, np.eye(4)))
    (tmp_path / "script.py").write_text(
        "import volspec as vs\n"
        "print(vs.load_volume('v.nii').shape_xyz)\n"
        "from volspec.volume import reader_process\n"
        "import os\n"
        "print(reader_process._idle_processes(os.getpid())[0]._process.pid)\n"
    )
    # A file of the folder is not imported in place of a library.
    (tmp_path / "nibabel.py").write_text("raise RuntimeError('hijacked')\n")
    done = python("-P", "-W", "error", "script.py", cwd=tmp_path)
    shape, pid = done.stdout.split("\n")[:2]
    assert (shape, done.stderr) == ("(4, 3, 2)", "") and not psutil.pid_exists(int(pid))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_fork_has_a_reader_of_its_own(tmp_path):
    path = write_nrrd(tmp_path / "v.nrrd")
    code = (
        "import os, sys, volspec as vs\n"
        "from volspec.volume.reader_process import _idle_processes\n"
        "vs.load_volume(sys.argv[1])\n"
        "child = os.fork()\n"
        "vs.load_volume(sys.argv[1])\n"
        "if child == 0: os._exit(0)\n"
        "assert os.waitpid(child, 0)[1] == 0\n"
        "vs.load_volume(sys.argv[1]); print('ok')\n"
    )
    done = python("-c", code, path)
    assert done.stdout == "ok\n", done.stderr


@pytest.mark.parametrize("order", ["little", "big"])
@pytest.mark.parametrize("kind", ["uint8", "int8", "uint16", "int32", "float32", "float64"])
@pytest.mark.parametrize("suffix", [".nrrd", ".mha", ".nii"])
def test_bytes_read_directly_are_itk_s(tmp_path, suffix, kind, order):
    values = (VALUES // 7).astype(kind)
    path = tmp_path / f"v{suffix}"
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), str(path))
    if order == "big":
        content = path.read_bytes()
        head = content[: -values.nbytes].replace(b"endian: little", b"endian: big")
        head = head.replace(b"ByteOrderMSB = False", b"ByteOrderMSB = True")
        big = head + values.astype(values.dtype.newbyteorder(">")).tobytes()
        code = struct.unpack_from("<h", content, 70)[0]
        path.write_bytes(nifti(values, np.eye(4), code, ">") if suffix == ".nii" else big)
    reading = read_here(Query.of(str(path)))
    assert isinstance(reading.values, Stored)
    expected = SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(str(path)))
    assert np.array_equal(reading.values.read(), expected) and np.array_equal(expected, values)


@pytest.mark.parametrize("name", ["v.npy", "v.nrrd", "v.mha", "v.nii", "v.nii.gz", "v.vti"])
def test_nan_is_replaced_alike_in_every_format(tmp_path, name):
    """ITK's NIfTI reader sets them to 0."""
    values = np.linspace(5, 28, 24, dtype=np.float32).reshape(2, 3, 4)
    values[1, 2, 3], values[0, 1, 1], values[0, 0, 0] = np.nan, np.inf, -np.inf
    path = tmp_path / name
    if name == "v.npy":
        np.save(path, values)
    elif name == "v.vti":
        grid = pyvista.ImageData(dimensions=(4, 3, 2))
        grid.point_data["values"] = values.ravel()
        grid.save(path)
    else:
        SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), str(path))
    with warns("3", "24"):
        volume = load_volume(path)
    assert volume.range == (6, 27) and volume.missing < -1000
    missing = np.argwhere(volume.values == volume.missing).tolist()
    assert missing == [[0, 0, 0], [0, 1, 1], [1, 2, 3]]


def test_metaimage_s_slices_by_a_pattern_are_read(tmp_path):
    for k in (1, 2):
        (tmp_path / f"s{k:02d}.raw").write_bytes(VALUES[k - 1].tobytes())
    (tmp_path / "v.mhd").write_text(f"{META}ElementDataFile = s%02d.raw 1 2 1\n")
    assert np.array_equal(load_volume(tmp_path / "v.mhd").values, VALUES)


def test_a_reading_keeps_its_voxels_in_memory_of_its_own(tmp_path):
    """Voxels outlive the child that read them, and the file."""
    path = write_nrrd(tmp_path / "v.nrrd", packed=True)
    reading = reader_process.read_in_child(Query.of(str(path)))
    assert isinstance(reading, Reading) and isinstance(reading.values, np.ndarray)
    for process in reader_process._idle_processes(os.getpid()):
        process.close()
    path.unlink()
    reading.values[0, 0, 0] += 1
    assert np.array_equal(reading.values.ravel()[1:], VALUES.ravel()[1:])
    assert np.array_equal(load_volume(write_nrrd(path)).values, VALUES)


def test_a_child_starts_whatever_the_parent_s_surroundings(tmp_path):
    """Paths that are no text, and a site that prints; a nameless interpreter is one line."""
    write_nrrd(tmp_path / "v.nrrd")
    (tmp_path / "site").mkdir()
    (tmp_path / "site/sitecustomize.py").write_text("print('welcome', flush=True)\n")
    code = (
        "import sys, pathlib, volspec as vs\n"
        "from volspec.errors import DeviceError\n"
        "sys.path.insert(0, pathlib.Path('/tmp'))\n"
        "print(vs.load_volume('v.nrrd').shape_xyz)\n"
        "from volspec.volume import reader_process\n"
        "reader_process._idle_processes(__import__('os').getpid()).clear()\n"
        "sys.executable = ''\n"
        "try: vs.load_volume('v.nrrd')\n"
        "except DeviceError as error: print(error.code)\n"
    )
    path = os.environ | {"PYTHONPATH": str(tmp_path / "site")}
    done = python("-c", code, cwd=tmp_path, env=path)
    assert done.stdout.splitlines() == ["welcome", "(4, 3, 2)", "size"], done.stderr


def test_voxels_that_cannot_be_mapped_leave_no_child(tmp_path, monkeypatch):
    path = write_nrrd(tmp_path / "v.nrrd", packed=True)
    load_volume(path)
    idle = reader_process._idle_processes(os.getpid())
    child = idle[-1]._process
    refuse = Mock(side_effect=OSError(12, "Cannot allocate memory"))
    monkeypatch.setattr(reader_process._ReaderProcess, "take", refuse)
    with raises(DeviceError, "size"):
        load_volume(path)
    assert child.poll() is not None and child not in [each._process for each in idle]


def half_of_a_metaimage(folder: Path) -> Path:
    """MetaIO takes what zlib could unpack, and leaves zeros."""
    path = folder / "v.mha"
    values = np.random.default_rng(0).integers(0, 99, (20, 30, 40)).astype(np.int16)
    SimpleITK.WriteImage(SimpleITK.GetImageFromArray(values), str(path), True)
    assert np.array_equal(load_volume(path).values, values)
    whole = path.read_bytes()
    start = whole.index(b"LOCAL\n") + 6
    half = start + (len(whole) - start) // 2
    path.write_bytes(whole[:half] + bytes(len(whole) - half))
    return path


def sizes_beyond_memory(folder: Path) -> Path:
    """They are refused before anything is allocated."""
    header = NRRD.replace("4 3 2", "99999 99999 999").replace("raw", "gzip")
    (folder / "v.nrrd").write_bytes(header.encode() + gzip.compress(VALUES.tobytes()))
    return folder / "v.nrrd"


def pipe(folder: Path) -> Path:
    if not hasattr(os, "mkfifo"):
        pytest.skip("this system has no named pipes")
    os.mkfifo(folder / "pipe.nrrd")
    return folder / "pipe.nrrd"


def no_utf_8(folder: Path) -> Path:
    """VTK opens no other names; what is read here has any."""
    nrrd, vti = (folder / os.fsdecode(b"bad\xff" + suffix) for suffix in (b".nrrd", b".vti"))
    vti.write_bytes(b"<VTKFile")
    assert load_volume(write_nrrd(nrrd)).shape_xyz == (4, 3, 2)
    return vti


@pytest.mark.parametrize(
    ("make", "code"),
    [
        (half_of_a_metaimage, "damaged"),
        (sizes_beyond_memory, "size"),
        (pipe, "type"),
        (no_utf_8, "unsupported"),
    ],
)
def test_what_readers_would_make_up_or_hang_on_is_refused(tmp_path, make, code):
    path = make(tmp_path)
    with raises(VolumeError, code):
        load_volume(path)
