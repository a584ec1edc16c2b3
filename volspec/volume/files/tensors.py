"""Voxels of Zarr arrays through TensorStore, which reads and decodes many chunks at once.

    zarr.Array -> [tensors] -> Tensor

zarr itself opens groups and reads their metadata; it takes ten times as long for small chunks.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._child import require_own_process
from volspec._extras import require_extra
from volspec.errors import DeviceError, one_line

# Beginnings of its errors if a store does not answer, or only with errors of its own.
_NO_ANSWER = ("UNAVAILABLE", "ABORTED", "DEADLINE_EXCEEDED")
# Of stores elsewhere that TensorStore reads, as fsspec names them.
_PROTOCOLS = ("http", "https", "s3", "gs", "gcs")
# Its errors: a code, places, the cause, and further facts in brackets.
_CODE, _FACTS = re.compile(r"^[A-Z_]+: "), re.compile(r" \[\w+='.*", re.DOTALL)
_PLACE = re.compile(r"(?:Error|Failed) \w+ing\b.*?(?:\"[^\"]*\"|\w+://\S+?): ", re.DOTALL)
_NUMBER = re.compile(r"\[os_error_code='(\d+)'\]")
# What is said of causes, by a part of them.
_SAID = {
    "Digest mismatch": "its checksum is not that of what was written",
    "byte range": "the server ignores requests for a part of a file (HTTP ranges)",
}
Index = tuple[int | slice, ...] | EllipsisType


def import_zarr(path: Path) -> Any:
    """Return the zarr library.

    Raises DeviceError if it, or TensorStore, is not installed, or this process is a fork of one
    that reads by them, which TensorStore would end.
    """
    require_own_process("TensorStore", DeviceError)
    require_extra("zarr", str(path))
    import zarr

    import_module("tensorstore")  # used by each `Tensor`
    return zarr


class Tensor:
    """Array of a Zarr store; slices of it are read and written as those of a NumPy array.

    ``chunks`` are the items along each axis that are read together, ``shards`` those of a file, if
    it holds several chunks; ``root`` is its folder.
    """

    def __init__(self, spec: dict[str, Any], root: Path | None) -> None:
        import tensorstore

        self._spec, self.root = spec, root
        self._array = tensorstore.open(spec, context=_context(), open=True).result()
        layout = self._array.chunk_layout
        self.shape = tuple(self._array.shape)
        self.chunks, file = layout.read_chunk.shape or (), layout.write_chunk.shape or ()
        self.shards = None if file == self.chunks else file
        self.dtype = np.dtype(self._array.dtype.numpy_dtype)

    def __reduce__(self) -> tuple[type[Tensor], tuple[Any, ...]]:
        return type(self), (self._spec, self.root)

    def __getitem__(self, index: Index) -> NDArray[Any]:
        [values] = self.read_each([index])
        if isinstance(values, Exception):
            raise values
        return values

    def __setitem__(self, index: Index, values: NDArray[Any]) -> None:
        error = self._array[index].write(values).exception()
        if error is not None:
            raise _plain_error(error)

    def read_each(self, indices: Sequence[Index]) -> Iterator[NDArray[Any] | Exception]:
        """Yield slices that are read side by side, or the error of one that cannot be read.

        It is a ConnectionError if the store does not answer, after some attempts.
        """
        import tensorstore

        require_own_process("TensorStore", DeviceError)
        # In one batch, the index of a file is read once, and what is near in it at once.
        with tensorstore.Batch() as batch:
            reading = [self._array[index].read(batch=batch) for index in indices]
        for future in reading:
            error = future.exception()
            yield future.result() if error is None else _plain_error(error)


def _plain_error(error: BaseException) -> OSError:
    """Return an error of TensorStore as an OSError: its cause, without places and codes.

    >>> _plain_error(ValueError('DATA_LOSS: Error reading local file "/v/0": Blosc error: -1'))
    OSError('Blosc error: -1')
    >>> _plain_error(ValueError('NOT_FOUND: chunk {0} in local file "/v/0" is missing'))
    FileNotFoundError('it is missing')
    """
    text = str(error)
    if number := _NUMBER.search(text):
        return OSError(int(number[1]), os.strerror(int(number[1])))
    if text.startswith("NOT_FOUND"):
        return FileNotFoundError("it is missing")
    cause = one_line(_PLACE.sub("", _FACTS.sub("", _CODE.sub("", text))))
    if text.startswith(_NO_ANSWER):
        return ConnectionError(cause)
    return OSError(next((text for part, text in _SAID.items() if part in cause), cause))


def fast_array(array: Any, *, complete: bool = False) -> Any:
    """Return an array of the zarr library as a `Tensor`, or as it is if TensorStore cannot read it.

    It cannot read stores in memory, nor some rare codecs. If ``complete``, chunks of the fill value
    are written as others, and one that is missing is an error.
    """
    import zarr

    store, path, root = array.store_path.store, array.store_path.path, None
    kvstore: dict[str, Any] | str
    if isinstance(store, zarr.storage.LocalStore):
        root = Path(store.root) / path
        kvstore = {"driver": "file", "path": f"{root.absolute()}/"}
    elif isinstance(store, zarr.storage.ZipStore):
        base = {"driver": "file", "path": str(Path(store.path).absolute())}
        kvstore = {"driver": "zip", "base": base, "path": f"{path}/"}
    elif isinstance(store, zarr.storage.FsspecStore) and store.fs.protocol[0] in _PROTOCOLS:
        kvstore = f"{store.fs.unstrip_protocol(store.path)}/{path}/"
    else:
        return array
    spec = {
        "driver": "zarr3" if array.metadata.zarr_format == 3 else "zarr",
        "kvstore": kvstore,
        # Metadata are read once; no chunk is cached.
        "recheck_cached_metadata": "open",
        "recheck_cached_data": False,
        "store_data_equal_to_fill_value": complete,
        "fill_missing_data_reads": not complete,
    }
    try:
        return Tensor(spec, root)
    except ValueError:
        return array


@cache
def _context() -> Any:
    """Return the context of all arrays: as many threads as zarr may use, and few retries."""
    import tensorstore
    import zarr

    threads = zarr.config.get("threading.max_workers")
    kinds = "data_copy_concurrency", "file_io_concurrency"
    limits = dict.fromkeys(kinds, {"limit": threads} if threads else {})
    retries = {"max_retries": 3, "initial_delay": "200ms", "max_delay": "2s"}
    stores = (f"{store}_request_retries" for store in ("http", "s3", "gcs"))
    return tensorstore.Context({**limits, **dict.fromkeys(stores, retries)})
