"""Files: outputs appear whole or not at all, and readers complain in one line."""

from __future__ import annotations

import glob
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from volspec.errors import InputError

# Of a temporary file's name: what tells it from others.
_RANDOM_BYTES = 4


@contextmanager
def write_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path in the same folder; rename it to ``path`` on success.

    What was written is on the disk before it has its name, so that a power cut leaves no half file.
    The temporary name keeps the suffix, since writers choose their format by it. Parent
    folders are made. When the body raises, the temporary file is removed and whatever stood
    at ``path`` before is untouched. A link stays one; what it points to is written. Permissions
    are those that a plain ``open`` gives.

    Raises
    ------
    InputError
        If the path is a folder or a device, its folder cannot be made or written to, or the disk
        is full.
    """
    target = _output(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = _created_beside(target)
    except OSError as error:
        raise InputError(
            f"{Path(path)}: cannot write there: {error.strerror}; choose another folder"
        ) from error
    try:
        yield temporary
        _to_disk(temporary)
        temporary.replace(target)
    except OSError as error:
        # Of another file, or no word of the system's: what the body reads, not what it writes.
        if error.errno is None or error.filename not in (None, str(temporary)):
            raise
        raise InputError(
            f"{Path(path)}: cannot be written: {error.strerror or error}; make room on the disk, "
            "or choose another, and repeat the command"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _created_beside(target: Path) -> Path:
    """A new, empty file in the same folder.

    Made by the kernel's own rules (umask, the folder's ACL): what `tempfile` makes is private, and
    a process can read its umask only by changing it, which files of other threads would get.
    """
    while True:
        name = f".{target.stem}-{token_hex(_RANDOM_BYTES)}{target.suffix}"
        temporary = target.with_name(name)
        try:
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
        except FileExistsError:
            continue
        return temporary


def _to_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDWR)  # Windows flushes only what it may write
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def clear_temporaries(path: Path) -> None:
    """Delete what a killed process has left of an unfinished file."""
    digits = "[0-9a-f]" * (2 * _RANDOM_BYTES)
    pattern = f".{glob.escape(path.stem)}-{digits}{glob.escape(path.suffix)}"
    for left in path.parent.glob(pattern):
        left.unlink(missing_ok=True)


def try_lock(handle: int) -> bool:
    """Lock an open file until it is closed or its program ends; False if another holds it.

    Raises
    ------
    OSError
        If the file system has no locks.
    """
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError):
        return False
    return True


def line_end(path: str | os.PathLike[str]) -> str:
    """How a text file ends its lines, for what is written in its place."""
    return "\r\n" if b"\r\n" in Path(path).read_bytes() else "\n"


@contextmanager
def captured_output(lines: list[str]) -> Iterator[None]:
    """Collect what C++ readers print to the process's stdout and stderr, so that one line is left.

    It redirects the file descriptors of the whole process while the body runs.
    """
    with tempfile.TemporaryFile() as sink:
        kept = [(number, os.dup(number)) for number in (1, 2)]
        try:
            for number, _ in kept:
                os.dup2(sink.fileno(), number)
            yield
        finally:
            for number, copy in kept:
                os.dup2(copy, number)
                os.close(copy)
            sink.seek(0)
            lines.extend(sink.read().decode(errors="replace").splitlines())


def require_writable(path: str | os.PathLike[str]) -> None:
    """Refuse an output that cannot be written, before the work for it is done.

    Raises
    ------
    InputError
        If the path is a folder or a device, or its folder cannot be made or written to.
    """
    _require_room(_output(path).parent, path)


def require_writable_folder(path: str | os.PathLike[str]) -> None:
    """The same for a folder of outputs, which may be there or not.

    Raises
    ------
    InputError
        If it cannot be made or written to.
    """
    _require_room(Path(path), path)


def _require_room(folder: Path, path: str | os.PathLike[str]) -> None:
    try:
        while not folder.exists():
            folder = folder.parent
        writable = folder.is_dir() and os.access(folder, os.W_OK)
    except OSError:
        writable = False
    if not writable:
        raise InputError(f"{Path(path)}: cannot write there; choose another folder")


def _output(path: str | os.PathLike[str]) -> Path:
    """Where an output goes: links followed; neither a folder nor a device."""
    try:
        named = Path(path)
        target = Path(os.path.realpath(named))
        is_folder, is_other = target.is_dir(), target.exists() and not target.is_file()
    except (TypeError, ValueError):
        raise InputError(f"{path!r} is no path; give a file name") from None
    except OSError as error:
        raise InputError(f"{named}: cannot write there: {error.strerror}") from error
    if is_folder:
        raise InputError(f"{named}: is a folder; give a file name")
    if is_other:
        raise InputError(f"{named}: is not a file; give the name of one")
    return target
