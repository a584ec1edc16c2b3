"""Cache of arrays, and of small facts by key, in the user's cache folder.

Cached arrays equal computed ones to the last bit. If a file is missing, damaged, from another
version or not writable, the arrays are computed without an error.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from volspec._files import clear_unfinished, keep_newest, make_private, write_whole
from volspec.errors import InputError

Arrays = dict[str, NDArray[Any]]
# Most files in a folder; beyond that, the oldest are deleted.
_MAX_FILES = 100
_MAX_ROWS, _MAX_BYTES = 50, 1 << 20


def cache_folder() -> Path:
    """Return the cache folder, which need not exist."""
    return user_cache_path("volspec", appauthor=False)


def cached_arrays(name: str, maker: str, make: Callable[[], Mapping[str, NDArray[Any]]]) -> Arrays:
    """Read ``FOLDER/NAME`` of the cache as {name: read-only array}, or make and cache it.

    ``maker`` is the version of everything that the arrays depend on; a file with another one is
    replaced. Exceptions of ``make`` propagate, and nothing is cached.
    """
    file = cache_folder() / f"{name}.npz"
    clear_unfinished(file.parent)  # of killed runs; this run may only read
    arrays = _read(file, maker)
    if arrays is None:
        arrays = {key: np.array(array) for key, array in make().items()}
        with suppress(OSError, InputError):
            _write(file, maker, arrays)
    for array in arrays.values():
        array.flags.writeable = False
    return arrays


def cached_rows(name: str) -> dict[str, Any]:
    """Return the facts of a file of the cache by key; nothing if it is missing or damaged."""
    file = cache_folder() / name
    try:
        if not file.is_file() or file.stat().st_size > _MAX_BYTES:
            return {}
        return dict(json.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError, RecursionError):
        return {}


def cache_rows(name: str, rows: Mapping[str, Any]) -> None:
    """Add facts to a file of the cache, as JSON; of more than `_MAX_ROWS`, the oldest go."""
    kept = {key: row for key, row in cached_rows(name).items() if key not in rows}
    newest = dict([*kept.items(), *rows.items()][-_MAX_ROWS:])
    with suppress(OSError, InputError):
        make_private(cache_folder())
        with write_whole(cache_folder() / name) as temporary:
            temporary.write_text(json.dumps(newest, indent=1), encoding="utf-8")


def _read(file: Path, maker: str) -> Arrays | None:
    """Return a maker's arrays; None if there is no such file, or it is damaged."""
    try:
        data = file.read_bytes()
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            # Members are written uncompressed; a compressed one may be larger than any memory.
            packed = sum(member.file_size for member in archive.zip.infolist()) > len(data)
            if packed or archive.zip.testzip() is not None or archive["maker"] != maker:
                return None
            return {str(key): archive[key] for key in archive["keys"]}
    # zipfile, its decompressors and NumPy raise anything on a damaged file.
    except Exception:
        return None


def _write(file: Path, maker: str, arrays: Arrays) -> None:
    make_private(file.parent)
    members: dict[str, Any] = {"maker": maker, "keys": list(arrays), **arrays}
    with write_whole(file) as temporary:
        np.savez(temporary, **members)
    keep_newest(file, "*.npz", _MAX_FILES)
