"""The user's cache folder: arrays that are slow to make are made once, and read after that.

What callers get is the same to the last bit, whether it was read or made. A file that is not
there, that another version wrote, that is damaged or cannot be written is no fault.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from volspec._files import clear_unfinished, keep_newest, write_whole
from volspec.errors import InputError

Arrays = dict[str, NDArray[Any]]
# In one folder; of more the oldest go.
_MOST_FILES = 100


def cache_folder() -> Path:
    """Where the files are; it need not exist."""
    return user_cache_path("volspec", appauthor=False)


def kept(name: str, maker: str, make: Callable[[], Mapping[str, NDArray[Any]]]) -> Arrays:
    """Arrays from the cache folder; where they are not there they are made, and kept.

    Parameters
    ----------
    name : str
        The file, as ``FOLDER/NAME``.
    maker : str
        All that the arrays depend on: what another maker wrote is made anew.
    make : callable
        Gives the arrays by name; what it raises is passed on, and nothing is kept.

    Returns
    -------
    {name: array}
        Read-only.
    """
    file = cache_folder() / f"{name}.npz"
    clear_unfinished(file.parent)  # of a run that was killed; this one may only read
    arrays = _read(file, maker)
    if arrays is None:
        arrays = {key: np.array(array) for key, array in make().items()}
        with suppress(OSError, InputError):
            _write(file, maker, arrays)
    for array in arrays.values():
        array.flags.writeable = False
    return arrays


def _read(file: Path, maker: str) -> Arrays | None:
    """What that maker wrote; None where there is no such file, or it is damaged."""
    try:
        data = file.read_bytes()
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            # As it was written nothing is packed; what says so may be larger than any memory.
            packed = sum(member.file_size for member in archive.zip.infolist()) > len(data)
            if packed or archive.zip.testzip() is not None or archive["maker"] != maker:
                return None
            return {str(key): archive[key] for key in archive["keys"]}
    # A damaged file ends in whatever zipfile, its decompressors and NumPy raise.
    except Exception:
        return None


def _write(file: Path, maker: str, arrays: Arrays) -> None:
    members: dict[str, Any] = {"maker": maker, "keys": list(arrays), **arrays}
    with write_whole(file) as temporary:
        np.savez(temporary, **members)
    keep_newest(file, "*.npz", _MOST_FILES)
