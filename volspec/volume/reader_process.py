"""Child process that reads volumes with native libraries, so that no file can crash the parent.

    load_volume -> Query -> [reader process: ITK, VTK, GDCM, libtiff, blosc] -> Reading

A crash, a hang or excessive memory use in the child becomes a one-line error. Voxels come back in
shared memory and are not copied again. Requests and answers are lines of JSON on the child's stdin
and stdout.
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
from dataclasses import asdict, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec import errors
from volspec._child import child_command, exit_cause
from volspec._confine import confine, confined_folder, require_inside
from volspec.errors import DeviceError, VolspecError, VolumeError, one_line
from volspec.volume.channels import Channel
from volspec.volume.files.query import Choice, ChoicesListed, Query, Reading, Stored, path_of
from volspec.volume.labels import Label
from volspec.volume.metadata import Metadata

# Timeout without a message; the time that a slow disk needs is added.
_TIMEOUT_S, _SLOWEST_BYTES_PER_S = 8.0, 8e6
# Timeout of the first message: libraries have to be loaded, perhaps over a network.
_START_S = 60.0
# A child ends after this time without a request.
_IDLE_S = 20.0
# Greatest compression ratio that extends the timeout; higher ones unpack fast or are hostile.
_MAX_PACKED = 20
# Most files of a folder that are counted for the timeout.
_MAX_COUNTED = 5000
# Address space in addition to the libraries': for reading, and per byte of declared voxels (the
# library's copy, one conversion, and the shared memory).
_SPARE_BYTES, _TIMES_DECLARED = 200 << 20, 3
_START = (
    "from volspec.volume.load import read_here, reader_library; "
    "from volspec.volume.reader_process import serve; serve(read_here, reader_library)"
)
# One heap, since each thread's heap reserves address space; no threads for linear algebra.
_ENVIRONMENT = {"MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1"}


def read_in_child(query: Query) -> Reading:
    """Read a volume in a child process.

    Raises the reader's own error; VolumeError if the child crashes, hangs, or takes more memory
    than the file's header accounts for; DeviceError if no child process can be started.
    """
    process, answer = _ask(query)
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
    _idle_processes(os.getpid()).append(process)
    world = answer["world_from_index"]
    return Reading(
        values,
        answer["spacing_mm"],
        None if world is None else np.array(world),
        answer["notes"],
        None if answer["labels"] is None else _labels(answer["labels"]),
        None if answer["channel"] is None else _channel(answer["channel"]),
        Metadata(**answer["metadata"] | {"assumed": tuple(answer["metadata"]["assumed"])}),
    )


def _labels(rows: list[tuple[int, str, list[float] | None]]) -> dict[int, Label]:
    return {n: Label(name, None if c is None else (c[0], c[1], c[2])) for n, name, c in rows}


def _channel(values: dict[str, Any]) -> Channel:
    for key in ("colour", "limits"):
        values[key] = values[key] and tuple(values[key])
    return Channel(**values)


def choices_in_child(query: Query) -> tuple[Choice, ...]:
    """List the choices of a volume's address in a child process; errors as `read_in_child`."""
    process, answer = _ask(replace(query, choices=[]))
    _idle_processes(os.getpid()).append(process)
    return tuple(
        Choice(entry["key"], tuple(entry["values"]), tuple(entry["names"]), entry["chosen"])
        for entry in answer["choices"]
    )


def _ask(query: Query) -> tuple[_ReaderProcess, dict[str, Any]]:
    """Return a child process and its answer to a request; raise the reader's error."""
    idle = _idle_processes(os.getpid())
    try:
        process = idle.pop()
        if not process.request(query):  # it was idle for too long and ended
            raise IndexError
    except IndexError:
        try:
            process = _ReaderProcess()
            begun = process.request(query)
        except (OSError, TypeError) as error:  # TypeError: the interpreter's path is unknown
            raise _no_process(query, one_line(error)) from error
        if not begun:
            raise _no_process(query, "it ended at once") from None
    answer = process.answer(query)
    if "error" in answer:
        idle.append(process)
        raise getattr(errors, answer["error"])(**answer["fields"])
    return process, answer


def _no_process(query: Query, cause: str) -> DeviceError:
    return DeviceError(
        f"{query.path}: no process can be started to read it ({sys.executable!r}: {cause}); "
        "are memory, open files or processes limited?",
        code="size",
    )


@lru_cache(maxsize=1)
def _idle_processes(owner: int) -> list[_ReaderProcess]:
    """Return the idle children of a process; a fork of the process has none."""
    return []


class _ReaderProcess:
    """Parent's end of a child process; serves one request at a time."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            child_command(_START),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | _ENVIRONMENT,
        )
        self._timed_out = False
        self._seconds = _TIMEOUT_S
        self.declared_bytes = 0
        atexit.register(self.close)

    def close(self) -> None:
        """End the child."""
        atexit.unregister(self.close)
        self._process.kill()
        with suppress(OSError):  # unsent bytes
            self._process.communicate()

    def request(self, query: Query) -> bool:
        """Send a request; return False if the child has ended."""
        folder = None
        with suppress(OSError):  # it may have been deleted
            folder = os.getcwd()
        request: dict[str, Any] = {
            "path": str(query.path),
            "options": query.options,
            "memory_bytes": query.memory_bytes,
            "folder": folder,
            "confined": confined_folder(),
            "choices": None if query.choices is None else [],
        }
        try:
            self._send(json.dumps(request).encode())
            begun = self._expected(self._receive(_START_S))
        except BaseException:
            self.close()
            raise
        if not begun:
            self.close()
        return begun

    def answer(self, query: Query) -> dict[str, Any]:
        """Wait for the answer to a request."""
        try:
            while message := self._receive(self._seconds):
                if not self._expected(message):
                    return message
        except BaseException:
            self.close()
            raise
        self.close()
        if self._timed_out:
            fault = f"takes longer than {self._seconds:.0f} s to read"
        else:
            fault = f"crashes the library that reads it ({exit_cause(self._process.returncode)})"
        raise VolumeError(
            f"{query.path}: {fault}; the file is damaged, copy or export it again", code="damaged"
        )

    def take(self, voxels: Stored) -> NDArray[Any]:
        """Map voxels in shared memory, and let the child release them."""
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
        """Extend the timeout for the bytes a message announces; False for other messages."""
        if message is None or "expects" not in message:
            return False
        self._seconds = _TIMEOUT_S + message["expects"] / _SLOWEST_BYTES_PER_S
        self.declared_bytes = message["declares"]
        return True

    def _send(self, line: bytes) -> None:
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # the child has ended: no answer will come
            self._process.stdin.write(line + b"\n")
            self._process.stdin.flush()

    def _receive(self, seconds: float) -> dict[str, Any] | None:
        """Return the next message; None if the child has ended, or was killed at the timeout."""
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
        self._timed_out = True
        self._process.kill()


def serve(read: Callable[[Query], Reading], reader_library: Callable[[Query], str]) -> None:
    """Answer requests until there are none for a while, or the parent ends.

    ``reader_library`` returns the name of the module that a query's reader imports.
    """
    with suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl+C ends the parent, which ends this one
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for number in (1, 2):  # discard the output of C++ libraries
        os.dup2(nowhere, number)

    def send(**message: Any) -> None:
        answers.write(json.dumps(message, default=str).encode() + b"\n")
        answers.flush()

    sys.addaudithook(_refuse_outside)
    requests: SimpleQueue[bytes] = SimpleQueue()
    threading.Thread(target=_listen, args=(requests,), daemon=True).start()
    with suppress(Empty):
        while line := requests.get(timeout=_IDLE_S):
            request = json.loads(line)
            with suppress(OSError, TypeError):
                os.chdir(request["folder"])
            confine(request["confined"])
            path = path_of(request["path"])
            size = path.stat().st_size if path.is_file() else 0
            folder = _folder_bytes(path)

            def expect(nbytes: int, size: int = size, folder: int = folder) -> None:
                _limit_memory(_SPARE_BYTES + size + _TIMES_DECLARED * nbytes)
                send(expects=folder + min(nbytes, _MAX_PACKED * folder), declares=nbytes)

            limit = request["memory_bytes"]
            query = Query(path, request["options"], expect, request["choices"], memory_bytes=limit)
            _limit_memory(None)
            with suppress(ImportError, VolspecError):  # reported when it is read
                importlib.import_module(reader_library(query))
            expect(0)
            answer, memory = _answer(query, read)
            send(**answer)
            if memory is not None:
                requests.get()  # the parent has mapped it
                os.close(memory)


# Files that the interpreter and libraries open for themselves.
_FOLDERS = filter(None, (*sys.path, sys.prefix, sys.base_prefix, "/proc", "/sys"))
_OWN = (os.devnull, *(f"{folder}/" for folder in _FOLDERS))


def _refuse_outside(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse files outside of the process's folder, of a library that opens more than one."""
    if event == "open" and isinstance(arguments[0], str) and not arguments[0].startswith(_OWN):
        require_inside(arguments[0], VolumeError)


def _answer(query: Query, read: Callable[[Query], Reading]) -> tuple[dict[str, Any], int | None]:
    """Read a volume; return the message for the parent and the handle of the voxels' memory.

    A query for choices is answered with these alone.
    """
    try:
        reading = read(query)
        values, memory = reading.values, None
        if not isinstance(values, Stored):
            values, memory = _share_array(values)
    except ChoicesListed:
        return {"choices": [asdict(choice) for choice in query.choices or ()]}, None
    except VolspecError as error:
        names = ("problem", "remedy", "code", "field", "given")
        fields = {name: getattr(error, name) for name in names}
        return {"error": type(error).__name__, "fields": fields}, None
    except ImportError as error:
        code = "unsupported"
        fault = f"the library that reads it cannot be loaded ({one_line(error):.150}); reinstall it"
    except MemoryError:
        code = "size"
        fault = "takes more memory to read than its header accounts for; is it damaged?"
    except PermissionError as error:
        code = "invalid"
        other = error.filename not in (None, str(query.path))
        place = error.filename if other else "it"
        fault = f"no permission to read {place}; change its permissions (chmod u+r), or copy it"
    except Exception as error:  # a library's error that its reader does not expect
        code = "damaged"
        fault = f"cannot be read ({type(error).__name__}: {one_line(error):.150}); is it damaged?"
    else:
        world = reading.world_from_index
        return {
            "voxels": asdict(values),
            "is_stored": memory is None,
            "spacing_mm": reading.spacing_mm,
            "world_from_index": None if world is None else world.tolist(),
            "notes": list(reading.notes),
            "channel": None if reading.channel is None else asdict(reading.channel),
            "metadata": asdict(reading.metadata),
            "labels": reading.labels
            and [(number, label.name, label.colour) for number, label in reading.labels.items()],
        }, memory
    fields = {"problem": f"{query.path}: {fault}", "code": code}
    return {"error": "VolumeError", "fields": fields}, None


def _folder_bytes(path: Path) -> int:
    """Return the bytes that a reader may have to search: each slice has its own file."""
    try:
        files = islice(path.rglob("*") if path.is_dir() else path.parent.iterdir(), _MAX_COUNTED)
        return sum(file.stat().st_size for file in files if file.is_file())
    except OSError:  # reported when it is read
        return 0


def _listen(requests: SimpleQueue[bytes]) -> None:
    for line in sys.stdin.buffer:
        requests.put(line)
    os._exit(0)  # the parent has ended; stop any reading


def _share_array(values: NDArray[Any]) -> tuple[Stored, int]:
    """Copy an array into shared memory; return its location and the handle that owns it.

    ``multiprocessing.shared_memory`` is not used: it fills /dev/shm, which is small in containers,
    and leaves names behind if a process is killed.
    """
    if values.dtype.hasobject or not values.size:
        raise ValueError(f"values of type {values.dtype} and shape {values.shape}")
    if hasattr(os, "memfd_create"):
        handle = os.memfd_create("volspec")
        path = f"/proc/{os.getpid()}/fd/{handle}"
    else:
        handle, path = tempfile.mkstemp(prefix="volspec-")
    left = memoryview(np.ascontiguousarray(values)).cast("B")
    while left:  # faster than a mapping, whose pages are made one by one
        left = left[os.write(handle, left) :]
    return Stored(path, values.shape, values.dtype.str), handle


def _limit_memory(nbytes: int | None) -> None:
    """Limit the bytes that this process may still allocate, if the system can; None: no limit."""
    if sys.platform == "win32":
        return
    import resource

    with suppress(OSError, ValueError):
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (hard if nbytes is None else taken + nbytes, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
