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
def captured_stderr(lines: list[str]) -> Iterator[None]:
    """Collect what C++ readers print to the process's stderr, so that one line is left."""
    with tempfile.TemporaryFile() as sink:
        kept = os.dup(2)
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            sink.seek(0)
            lines.extend(sink.read().decode(errors="replace").splitlines())
