"""Atomic file writes, file locks, writable caches, and capture of native libraries' output."""

from __future__ import annotations

import atexit
import errno
import os
import platform
import re
import shutil
import sys
import tempfile
import threading
import time
import warnings
import zlib
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from difflib import get_close_matches
from functools import cache
from itertools import islice
from pathlib import Path
from secrets import token_hex
from typing import IO

from volspec._confine import require_target_inside
from volspec.errors import ImageError, InputError, VolspecWarning, nearest

# An unfinished file is next to its target, with a file that is locked while the writer runs:
# .volspec-MACHINE-BOOT-RANDOM.part.SUFFIX and .lock, with the same name before the suffixes.
_UNFINISHED = re.compile(r"(\.volspec-[0-9a-f]{8}-[0-9a-f]{8}-[0-9a-f]{8})\.(lock|part.*)")
_TRIES = 9
# Most files of a folder that are compared with a misspelt name.
_MAX_COMPARED = 5000
# Without locks, the writer of a file unchanged for this time counts as dead.
_DEAD_S = 86400.0
# Endings that belong together.
_DOUBLE = (".ome.tif", ".ome.tiff", ".ome.zarr", ".zarr.zip", ".volspec.json")
# Folders of the libraries and ours in the user's cache; and the bytes that programs may take.
_CACHES, _MIN_FREE_BYTES = ("pocl", "pyopencl", "pytools", "volspec"), 16 << 20
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")
# Step between corrected modification times.
_STEP_NS = 1_000_000


def is_remote(address: str) -> bool:
    """Return True if an address is a URL, such as of an object store.

    >>> is_remote("https://host/v.zarr?time=2"), is_remote("a://b"), is_remote("C:/v.zarr")
    (True, True, False)
    """
    return re.match(r"[a-z][a-z0-9+.-]+://|[a-z]://", address, re.IGNORECASE) is not None


@contextmanager
def write_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Write a file atomically: yield a temporary path, renamed to ``path`` on success.

    The data are synced to disk before the rename, so that a power cut leaves no partial file.
    The temporary name has the same suffix, since writers choose their format by suffix. Parent
    folders are made. If the body raises, the temporary file is removed and an existing file at
    ``path`` is untouched. Leftovers of killed processes in the same folder are removed as well.
    For a link, its target is written. Permissions are those of a plain ``open``.

    Raises `InputError` if the path is a folder or a device, its folder cannot be made or written
    to, or the disk is full.
    """
    target = _output(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _clear_once(target.parent)
        lock_file, handle = _make_lock(target.parent)
    except OSError as error:
        raise InputError(
            f"{Path(path)}: cannot write there: {error.strerror}; choose another folder",
            code="unwritable",
        ) from error
    temporary = lock_file.with_name(f"{lock_file.stem}.part{target.suffix}")
    try:
        yield temporary
        _to_disk(temporary)
        temporary.replace(target)
    except OSError as error:
        # About another file, or without an errno: raised by a read in the body, not by the write.
        if error.errno is None or error.filename not in (None, str(temporary)):
            raise
        raise InputError(
            f"{Path(path)}: cannot be written: {error.strerror or error}; make room on the disk, "
            "or choose another, and repeat the command",
            code="unwritable",
        ) from error
    finally:
        with suppress(OSError):
            _remove([temporary], lock_file, handle)


@cache
def ensure_writable_caches() -> None:
    """Use temporary folders for caches in this process if the user's cannot be written.

    Those of PoCL, pyopencl and Matplotlib, too: without one, PoCL finds no device or ends the
    process, pyopencl raises an error and Matplotlib prints warnings.
    """
    from platformdirs import user_cache_path, user_config_path  # here: takes time at every start

    with suppress(OSError):
        caches, programs = user_cache_path(), os.environ.get("POCL_CACHE_DIR")
        present = (caches / name for name in _CACHES if os.path.lexists(caches / name))
        variables = dict.fromkeys((caches, *present), "XDG_CACHE_HOME")
        if programs:
            variables[Path(programs)] = "POCL_CACHE_DIR"
        for folder, variable in variables.items():
            if cause := write_fault(folder):
                temporary = tempfile.mkdtemp(prefix="volspec-")
                atexit.register(shutil.rmtree, temporary, ignore_errors=True)
                warnings.warn(
                    f"{folder}: cannot be written ({cause}), so caches are temporary and every "
                    f"start is slow; set {variable} to a folder that can be written",
                    VolspecWarning,
                    stacklevel=2,
                )
                os.environ["XDG_CACHE_HOME"] = temporary
                os.environ.pop("POCL_CACHE_DIR", None)
                break
        if "MPLCONFIGDIR" not in os.environ and write_fault(user_config_path("matplotlib")):
            os.environ["MPLCONFIGDIR"] = str(user_cache_path("matplotlib"))


def write_fault(folder: Path) -> str:
    """Return why a cache cannot be written in a folder, which is made; empty if it can."""
    try:
        make_private(folder)
        with tempfile.TemporaryFile(dir=folder, buffering=0) as probe:
            probe.write(bytes(4096))
        total, _, free = shutil.disk_usage(folder)
    except OSError as error:
        return error.strerror or str(error)
    is_full = total and free < _MIN_FREE_BYTES  # some file systems report none at all
    return f"{free >> 20} MiB are free" if is_full else ""


def make_private(folder: Path) -> None:
    """Make a folder that only its owner can open, and so those above it that are missing."""
    if not folder.parent.exists():
        make_private(folder.parent)
    folder.mkdir(mode=0o700, exist_ok=True)


def clear_unfinished(folder: Path) -> None:
    """Delete unfinished files in a folder whose writers were killed.

    Running writers hold a lock, which the system releases when they end, so their files stay.
    Process ids are useless, as they are reused and may coincide in two containers. If the writer
    was on another machine, or the file system has no locks, a file must be unchanged for a day.
    """
    try:
        with os.scandir(folder) as entries:
            names = {
                match[1]
                for entry in entries
                # Check the name first: a folder may have 100 000 files.
                if (match := _UNFINISHED.fullmatch(entry.name))
                and entry.is_file(follow_symlinks=False)
            }
    except OSError:
        return
    for name in names:
        with suppress(OSError):
            _clear(folder / f"{name}.lock")


# Once per process: an export writes thousands of files into one folder.
_clear_once = cache(clear_unfinished)


def _clear(lock_file: Path) -> None:
    """Delete an unfinished file if its writer is dead and permissions allow."""
    # Recreate a missing lock file, so that the deleter holds a lock; we never create links.
    handle = os.open(lock_file, os.O_CREAT | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0), 0o666)
    locked = lock_file_handle(handle)
    files = list(lock_file.parent.glob(f"{lock_file.stem}.part*"))
    if (locked and _made_here(lock_file)) or (locked is not False and _is_old([lock_file, *files])):
        _remove(files, lock_file, handle)
    else:
        os.close(handle)


def _made_here(lock_file: Path) -> bool:
    """Return True if this machine wrote it: some network folders do not share locks."""
    _, name, boot, _ = lock_file.name.split("-")
    # Either is enough: names differ between containers, boot ids after a restart.
    return name == _machine()[0] or boot == _machine()[1]


@cache
def _machine() -> tuple[str, str]:
    """Return this machine's name and its last boot, hashed to eight digits each."""
    name = platform.node()
    try:
        boot = _BOOT_ID.read_text(encoding="ascii")
    except OSError:
        boot = name
    machine, started = (f"{zlib.crc32(text.encode()):08x}" for text in (name, boot))
    return machine, started


def _is_old(files: list[Path]) -> bool:
    """Return True if files have not changed for a day; far-future dates count as old, too."""
    changed = max(file.stat().st_mtime for file in files)
    return abs(time.time() - changed) > _DEAD_S


def _make_lock(folder: Path) -> tuple[Path, int]:
    """Create and lock the file that shows that its writer is running.

    Its permissions follow the umask and the folder's ACL: files from `tempfile` are private, and a
    process can read its umask only by changing it, which affects other threads.
    """
    tries_left = _TRIES
    while True:
        lock_file = folder / f"{'-'.join(('.volspec', *_machine(), token_hex(4)))}.lock"
        handle = os.open(lock_file, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
        tries_left -= 1
        # Before it was locked, another process may have deleted it as a leftover.
        if (lock_file_handle(handle) is not False and _is_at(handle, lock_file)) or not tries_left:
            return lock_file, handle
        os.close(handle)


def _is_at(handle: int, path: Path) -> bool:
    """Return True if an open file is the one at a path; `_clear` may have made another there."""
    try:
        return os.path.samestat(os.fstat(handle), path.stat())
    except FileNotFoundError:
        return False


def _remove(files: list[Path], lock_file: Path, handle: int) -> None:
    """Delete unfinished files, then their lock, so that later calls can finish after a kill."""
    try:
        for file in files:
            file.unlink(missing_ok=True)
        if sys.platform != "win32":  # while locked, so that no other process can lock it
            lock_file.unlink(missing_ok=True)
    finally:
        os.close(handle)
    lock_file.unlink(missing_ok=True)  # Windows cannot delete an open file


def lock_file_handle(handle: int) -> bool | None:
    """Lock an open file until it is closed or the process ends.

    Returns False if another handle has the lock, None if the file system has no locks.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return False if error.errno in (errno.EAGAIN, errno.EACCES) else None
    return True


@contextmanager
def exclusive_folder(path: Path, writer: str = "another export") -> Iterator[None]:
    """Make a folder and lock it; if another process has the lock, ``writer`` is writing there.

    Raises `InputError` if it is locked, or cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        raise InputError(f"{path}: is a file", "give the name of a folder", code="type") from None
    except OSError as error:
        remedy = "choose another folder"
        if error.errno == errno.ENAMETOOLONG:
            remedy = "give a shorter name"
        raise InputError(
            f"{path}: cannot be created: {error.strerror}", remedy, code="unwritable"
        ) from error
    place, flags = path.resolve(), os.O_RDONLY
    if sys.platform == "win32":  # folders cannot be opened there
        place, flags = place.with_name(f".{place.name}.lock"), os.O_RDWR | os.O_CREAT
    handle = os.open(place, flags)
    try:
        # Another process may have renamed the folder since it was opened.
        if lock_file_handle(handle) is False or not _is_at(handle, place):
            raise InputError(
                f"{path}: {writer} is writing there",
                "wait until it ends, or choose another folder",
                code="state",
            )
        yield
    finally:
        os.close(handle)
        if flags & os.O_CREAT:
            with suppress(OSError):  # another process has opened it
                place.unlink()


def keep_newest(written: Path, pattern: str, count: int) -> None:
    """Delete the oldest files of a ``pattern`` until ``count`` are left, but never ``written``.

    Other files with later dates, from a wrong clock, are dated just before ``written``, which is
    the newest. Names that start with a dot are unfinished files and do not count. Errors are
    ignored; the next call tries again.
    """
    with suppress(OSError):
        now = written.stat().st_mtime_ns
        paths = (path for path in written.parent.glob(pattern) if path != written)
        older = newest_first(path for path in paths if not path.name.startswith("."))
        for rank, path in enumerate(older, start=1):
            if path.stat().st_mtime_ns >= now:
                os.utime(path, ns=(now - rank * _STEP_NS,) * 2)
        for path in older[max(count - 1, 0) :]:
            path.unlink(missing_ok=True)


def newest_first(paths: Iterable[Path]) -> list[Path]:
    """Sort files by the dates of their last change; by name if two are equal."""
    return sorted(paths, key=lambda path: (path.stat().st_mtime_ns, path.name), reverse=True)


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDWR)  # Windows cannot sync a file opened only for reading
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def line_end(path: str | os.PathLike[str]) -> str:
    """Return a text file's line ending."""
    return "\r\n" if b"\r\n" in Path(path).read_bytes() else "\n"


class _Capture:
    """Redirection of the process's stdout and stderr while at least one thread captures them."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._threads = 0
        self._restore: ExitStack
        self._sink: IO[bytes]

    def begin(self) -> int:
        """Redirect the streams, unless already done; return the offset of this thread's part."""
        with self._lock:
            if not self._threads:
                with ExitStack() as stack:
                    self._sink = stack.enter_context(tempfile.TemporaryFile())
                    for number in (1, 2):
                        copy = os.dup(number)
                        stack.callback(os.close, copy)
                        stack.callback(os.dup2, copy, number)
                        os.dup2(self._sink.fileno(), number)
                    self._restore = stack.pop_all()
            self._threads += 1
            return os.fstat(self._sink.fileno()).st_size

    def end(self, start: int) -> list[str]:
        """Restore the streams if no other thread captures; return lines printed since ``start``."""
        with self._lock:
            text = self._since(start)
            self._threads -= 1
            if not self._threads:
                self._restore.close()
            return text.decode(errors="replace").splitlines()

    def _since(self, start: int) -> bytes:
        handle = self._sink.fileno()
        if hasattr(os, "pread"):  # other threads may be writing, and share the file position
            return os.pread(handle, os.fstat(handle).st_size - start, start)
        self._sink.seek(start)
        return self._sink.read()


_capture = cache(_Capture)


@contextmanager
def captured_output(lines: list[str]) -> Iterator[None]:
    """Collect the output of C++ libraries to stdout and stderr into ``lines``.

    The file descriptors of the whole process are redirected while the body runs. Several threads
    may capture at once: each collects everything that any thread prints meanwhile.
    """
    start = _capture().begin()
    try:
        yield
    finally:
        lines.extend(_capture().end(start))


def require_writable(path: str | os.PathLike[str]) -> None:
    """Refuse an output that cannot be written, before it is computed.

    Raises `InputError` if the path is a folder or a device, or its folder cannot be written to.
    """
    _require_room(_output(path).parent, path)


def nearest_file(path: Path, never: tuple[str, ...] = ()) -> str:
    """Return "did you mean …? " for a missing file with a similar one next to it; else ``""``.

    The names must be similar even without their suffixes; ``never`` are suffixes to leave out.
    """

    def stem(name: str) -> str:
        return name.partition(".")[0].casefold()

    try:
        names = [entry.name for entry in islice(path.parent.iterdir(), _MAX_COMPARED)]
    except OSError:
        return ""
    names = [name for name in names if not name.lower().endswith(never)]
    alike = get_close_matches(stem(path.name), {stem(name) for name in names})
    return nearest(path.name, [name for name in names if stem(name) in alike], count=1)


def plain_stem(name: str) -> str:
    """Return a file's name without its ending, or endings that belong together.

    >>> [plain_stem(name) for name in ("head.nii.gz", "a.b.toml", "run.volspec.json")]
    ['head', 'a.b', 'run']
    """
    name = name[:-3] if name.lower().endswith(".gz") else name
    double = next((suffix for suffix in _DOUBLE if name.lower().endswith(suffix)), "")
    return name[: -len(double)] if double else os.path.splitext(name)[0]


def require_suffix(
    path: str | os.PathLike[str], kind: str, *suffixes: str, error: type[InputError] = ImageError
) -> Path:
    """Return a file's path; refuse a wrong suffix. ``kind`` is the kind of file, in the plural."""
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        kinds = " or ".join(suffixes)
        problem = f"{target}: {kind} are {kinds} files"
        raise error(problem, f"use {kinds}", code="unsupported")
    return target


def require_writable_folder(path: str | os.PathLike[str]) -> None:
    """Refuse a folder of outputs that cannot be written to, by an `InputError`."""
    _require_room(Path(path), path)


def _require_room(folder: Path, path: str | os.PathLike[str]) -> None:
    try:
        while not folder.exists():
            folder = folder.parent
        # A trial: permissions of /proc, or of a file system mounted read-only, look writable.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        raise InputError(
            f"{Path(path)}: cannot write there; choose another folder", code="unwritable"
        ) from None


def _output(path: str | os.PathLike[str]) -> Path:
    """Return an output's target, with links followed; refuse folders and devices."""
    try:
        named = Path(path)
        target = Path(os.path.realpath(named))
        is_folder, is_other = target.is_dir(), target.exists() and not target.is_file()
    except (TypeError, ValueError):
        raise InputError(f"{path!r} is not a path; give a file name", code="type") from None
    except OSError as error:
        raise InputError(
            f"{named}: cannot write there: {error.strerror}", code="unwritable"
        ) from error
    require_target_inside(named, target)
    if is_folder:
        raise InputError(f"{named}: is a folder; give a file name", code="unwritable")
    if is_other:
        raise InputError(f"{named}: is not a file; give the name of one", code="unwritable")
    return target
