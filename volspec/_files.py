"""Files: outputs appear whole or not at all, and readers complain in one line."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from volspec.errors import InputError


@contextmanager
def write_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give a temporary path in the same folder; rename it to ``path`` on success.

    The temporary name keeps the suffix, since writers choose their format by it. Parent
    folders are made. When the body raises, the temporary file is removed and whatever stood
    at ``path`` before is untouched. A link stays one; what it points to is written.

    Raises
    ------
    InputError
        If the path is a folder or a device, or its folder cannot be made or written to.
    """
    target = _output(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.stem}-", suffix=target.suffix
        )
    except OSError as error:
        raise InputError(
            f"{Path(path)}: cannot write there: {error.strerror}; choose another folder"
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes files private; give the result the permissions a plain open() would.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


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
    folder = _output(path).parent
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
