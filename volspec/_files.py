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
    at ``path`` before is untouched.

    Raises
    ------
    InputError
        If the folder cannot be made or written to.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(
            dir=target.parent, prefix=f".{target.stem}-", suffix=target.suffix
        )
    except OSError as error:
        raise InputError(
            f"{target}: cannot write there: {error.strerror}; choose another folder with -o"
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
    except IsADirectoryError as error:
        raise InputError(f"{target}: is a folder; give a file name") from error
    finally:
        temporary.unlink(missing_ok=True)


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
        If the path is a folder, or its folder cannot be made or written to.
    """
    if Path(path).is_dir():
        raise InputError(f"{Path(path)}: is a folder; give a file name")
    folder = Path(path).absolute().parent
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir() or not os.access(folder, os.W_OK):
        raise InputError(f"{Path(path)}: cannot write there; choose another folder with -o")
