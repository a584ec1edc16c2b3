"""A child process that reads volumes with native libraries, so that no file can end this one.

    load_volume -> Query -> [reader process: ITK, VTK, GDCM, libtiff, blosc] -> Reading

A crash, a hang or a flood of memory there is one line here. Voxels come back in shared memory and
are not copied again. Requests and answers are lines of JSON on the child's stdin and stdout.
"""

from __future__ import annotations

import atexit
import importlib
import json
import mmap
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec import errors
from volspec._child import cause_of, child_command
from volspec.errors import DeviceError, VolspecError, VolumeError, one_line
from volspec.volume.files.query import Query, Reading, Stored

# Silence for so long, and for the time that a slow disk needs, ends a reader.
_PATIENCE_S, _SLOWEST_BYTES_PER_S = 8.0, 8e6
# Its libraries have to be loaded first, perhaps from a network.
_START_S = 60.0
# A child waits so long for the next file.
_IDLE_S = 20.0
# Of what a file holds: what is packed further is unpacked quickly, or is hostile.
_MOST_PACKED = 20
# Files of a folder that are counted for the time to read it.
_MOST_COUNTED = 5000
# Address space beyond what its libraries take: for reading, and per byte of declared voxels (the
# library's own, one conversion, and the shared memory).
_SPARE_BYTES, _TIMES_DECLARED = 200 << 20, 3
_START = (
    "from volspec.volume.load import library_of, read_here; "
    "from volspec.volume.reader_process import serve; serve(read_here, library_of)"
)
# One heap, since each thread's reserves address space; and no threads for algebra.
_ENVIRONMENT = {"MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1"}


def read_in_child(query: Query) -> Reading:
    """Read a volume in a child process.

    Raises
    ------
    VolspecError
        As the reader raises it there; a VolumeError if it crashes, hangs, or takes more memory
        than the file's header accounts for.
    DeviceError
        If no child can be started.
    """
    idle = _idle_processes(os.getpid())
    try:
        process = idle.pop()
        if not process.request(query):  # it has waited too long, and ended
            raise IndexError
    except IndexError:
        try:
            process = _ReaderProcess()
            begun = process.request(query)
        except (OSError, TypeError) as error:  # the latter if the interpreter's path is unknown
            raise _no_process(query, one_line(error)) from error
        if not begun:
            raise _no_process(query, "it ended at once") from None
    answer = process.answer(query)
    if "error" in answer:
        idle.append(process)
        raise getattr(errors, answer["error"])(answer["said"])
    voxels = Stored(**answer["voxels"])
    try:
        values = voxels if answer["is_stored"] else process.take(voxels)
    except OSError as error:
        process.close()
        raise DeviceError(
            f"{query.path}: no memory for its voxels ({one_line(error)}); close programs, or raise "
            "the limit",
            code="size",
        ) from error
    idle.append(process)
    world = answer["world_from_index"]
    return Reading(
        values,
        answer["spacing_mm"],
        None if world is None else np.array(world),
        answer["remarks"],
    )


def _no_process(query: Query, cause: str) -> DeviceError:
    return DeviceError(
        f"{query.path}: no process can be started to read it with ({sys.executable!r}: {cause}); "
        "are memory, open files or processes limited?",
        code="size",
    )


@lru_cache(maxsize=1)
def _idle_processes(owner: int) -> list[_ReaderProcess]:
    """Children that wait for a file; a fork of their owner has none."""
    return []


class _ReaderProcess:
    """The parent's end of a child; for one request at a time."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            child_command(_START),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | _ENVIRONMENT,
        )
        self._late = False
        self._seconds = _PATIENCE_S
        self.declared_bytes = 0
        atexit.register(self.close)

    def close(self) -> None:
        """End the child."""
        atexit.unregister(self.close)
        self._process.kill()
        with suppress(OSError):  # what could not be sent to it
            self._process.communicate()

    def request(self, query: Query) -> bool:
        """Send a request; return False if the child has ended."""
        folder = None
        with suppress(OSError):  # it may have been deleted
            folder = os.getcwd()
        given = {"path": str(query.path), "options": query.options, "folder": folder}
        try:
            self._send(json.dumps(given).encode())
            begun = self._expected(self._receive(_START_S))
        except BaseException:
            self.close()
            raise
        if not begun:
            self.close()
        return begun

    def answer(self, query: Query) -> dict[str, Any]:
        """Wait for the answer to a request.

        Raises
        ------
        VolumeError
            If the child crashes or hangs.
        """
        try:
            while message := self._receive(self._seconds):
                if not self._expected(message):
                    return message
        except BaseException:
            self.close()
            raise
        self.close()
        if self._late:
            fault = f"takes longer than {self._seconds:.0f} s to read"
        else:
            fault = f"ends the library that reads it ({cause_of(self._process.returncode)})"
        raise VolumeError(
            f"{query.path}: {fault}; the file is damaged, copy or export it again", code="damaged"
        )

    def take(self, voxels: Stored) -> NDArray[Any]:
        """Map voxels in shared memory, and let the child forget them."""
        # O_TEMPORARY: Windows deletes the file with the mapping.
        flags = getattr(os, "O_BINARY", 0) | getattr(os, "O_TEMPORARY", 0)
        handle = os.open(voxels.path, os.O_RDWR | flags)
        try:
            memory = mmap.mmap(handle, 0, access=mmap.ACCESS_COPY)
        finally:
            os.close(handle)
            if not voxels.path.startswith("/proc/"):
                with suppress(OSError):
                    os.unlink(voxels.path)
        self._send(b"")
        return np.ndarray(voxels.shape, voxels.dtype, memory)

    def _expected(self, message: dict[str, Any] | None) -> bool:
        """Grant the time for the bytes that a message announces; False if it is of another kind."""
        if message is None or "expects" not in message:
            return False
        self._seconds = _PATIENCE_S + message["expects"] / _SLOWEST_BYTES_PER_S
        self.declared_bytes = message["declares"]
        return True

    def _send(self, line: bytes) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it has ended or is closed: told by its silence
            self._process.stdin.write(line + b"\n")
            self._process.stdin.flush()

    def _receive(self, seconds: float) -> dict[str, Any] | None:
        """The next message; None if the child has ended, or is ended for its silence."""
        assert self._process.stdout is not None
        watch = threading.Timer(seconds, self._expire)
        watch.start()
        try:
            line = self._process.stdout.readline()
            while line and not line.startswith(b"{"):  # printed by somebody's sitecustomize
                line = self._process.stdout.readline()
        except ValueError:  # closed
            return None
        finally:
            watch.cancel()
        return json.loads(line) if line.endswith(b"\n") else None

    def _expire(self) -> None:
        self._late = True
        self._process.kill()


def serve(read: Callable[[Query], Reading], library_of: Callable[[Query], str]) -> None:
    """Answer requests until there is none for a while, or the parent ends.

    Parameters
    ----------
    read : callable
    library_of : callable
        Name of the module that a query's reader imports.
    """
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent's Ctrl+C: it ends this one
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):  # what C++ libraries print
        os.dup2(nowhere, number)

    def send(**message: Any) -> None:
        answers.write(json.dumps(message).encode() + b"\n")
        answers.flush()

    requests: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    with suppress(Empty):
        while line := requests.get(timeout=_IDLE_S):
            given = json.loads(line)
            with suppress(OSError, TypeError):
                os.chdir(given["folder"])
            path = Path(given["path"])
            size = path.stat().st_size if path.is_file() else 0
            folder = _folder_bytes(path)

            def expect(nbytes: int, size: int = size, folder: int = folder) -> None:
                _limit_memory(_SPARE_BYTES + size + _TIMES_DECLARED * nbytes)
                send(expects=folder + min(nbytes, _MOST_PACKED * folder), declares=nbytes)

            query = Query(path, given["options"], expect)
            _limit_memory(None)
            with suppress(ImportError, VolspecError):  # told when it is read
                importlib.import_module(library_of(query))
            expect(0)
            answer, memory = _answer(query, read)
            send(**answer)
            if memory is not None:
                requests.get()  # the parent has mapped it
                os.close(memory)


def _answer(query: Query, read: Callable[[Query], Reading]) -> tuple[dict[str, Any], int | None]:
    """Read a volume: the message for the parent, and the handle of the voxels' memory."""
    try:
        reading = read(query)
        values, memory = reading.values, None
        if not isinstance(values, Stored):
            values, memory = _shared(values)
    except VolspecError as error:
        return {"error": type(error).__name__, "said": str(error)}, None
    except ImportError as error:
        fault = f"the library that reads it cannot be loaded ({one_line(error):.150}); reinstall it"
    except MemoryError:
        fault = "takes more memory to read than its header accounts for; is it damaged?"
    except Exception as error:  # a library's own, of a kind that its reader does not expect
        fault = f"cannot be read ({type(error).__name__}: {one_line(error):.150}); is it damaged?"
    else:
        world = reading.world_from_index
        return {
            "voxels": asdict(values),
            "is_stored": memory is None,
            "spacing_mm": reading.spacing_mm,
            "world_from_index": None if world is None else world.tolist(),
            "remarks": list(reading.remarks),
        }, memory
    return {"error": "VolumeError", "said": f"{query.path}: {fault}"}, None


def _folder_bytes(path: Path) -> int:
    """Bytes that a reader may have to look through: a slice's headers are in files of their own."""
    try:
        files = islice(path.rglob("*") if path.is_dir() else path.parent.iterdir(), _MOST_COUNTED)
        return sum(file.stat().st_size for file in files if file.is_file())
    except OSError:  # told when it is read
        return 0


def _listen(requests: SimpleQueue[bytes]) -> None:
    for line in sys.stdin.buffer:
        requests.put(line)
    os._exit(0)  # the parent has ended, whatever is being read


def _shared(values: NDArray[Any]) -> tuple[Stored, int]:
    """Copy an array into shared memory; where it is, and the handle that keeps it.

    Not ``multiprocessing.shared_memory``: that fills /dev/shm, which containers keep small, and
    leaves names behind if a process is killed.
    """
    if values.dtype.hasobject or not values.size:
        raise ValueError(f"values of type {values.dtype} and shape {values.shape}")
    if hasattr(os, "memfd_create"):
        handle = os.memfd_create("volspec")
        path = f"/proc/{os.getpid()}/fd/{handle}"
    else:
        handle, path = tempfile.mkstemp(prefix="volspec-")
    left = memoryview(np.ascontiguousarray(values)).cast("B")
    while left:  # quicker than through a mapping, whose pages are made one by one
        left = left[os.write(handle, left) :]
    return Stored(path, values.shape, values.dtype.str), handle


def _limit_memory(nbytes: int | None) -> None:
    """Limit the bytes that this process may yet allocate, on systems that can; None: no limit."""
    if sys.platform == "win32":
        return
    import resource

    with suppress(OSError, ValueError):
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        _, most = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (most if nbytes is None else taken + nbytes, most))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
