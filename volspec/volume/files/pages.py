"""Pages of TIFF files, and PNG pictures, as arrays; damage told in one line.

    tiff, stack -> [pages] -> (Y, X) or (Y, X, S) arrays

tifffile knows the dialects of microscopes. Without imagecodecs, a large package, it leaves LZW and
JPEG alone: such pages are read by Pillow, which knows neither dialects nor all types.
"""

from __future__ import annotations

import logging
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec._files import captured_output
from volspec.errors import VolumeError, one_line

_DAMAGE = (
    *(ValueError, OSError, RuntimeError, LookupError, TypeError, AttributeError, ArithmeticError),
    *(EOFError, SyntaxError, MemoryError, struct.error, zlib.error),
)


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turn what readers of pictures raise and log into one line.

    Raises
    ------
    VolumeError
        If the body raises, or tifffile logs an error: it goes on with what it could read.
    """
    said: list[str] = []
    log, handler = logging.getLogger("tifffile"), logging.Handler(logging.ERROR)
    handler.emit = lambda record: said.append(record.getMessage())  # type: ignore[method-assign]
    log.addHandler(handler)
    heard, log.propagate = log.propagate, False
    try:
        yield
    except _DAMAGE as error:
        if isinstance(error, VolumeError) and not said:
            raise
        raise VolumeError(_damaged(path, [*said, str(error)])) from error
    finally:
        log.removeHandler(handler)
        log.propagate = heard
    if said:
        raise VolumeError(_damaged(path, said))


def _damaged(path: Path, said: list[str]) -> str:
    return (
        f"{path}: cannot be read ({one_line(said[0])[:120]}); is it complete and of the type its "
        "name says?"
    )


def page_values(page: Any) -> NDArray[Any]:
    """The pixels of a tifffile ``TiffPage``, decoded by whom that can."""
    try:
        return np.asarray(page.asarray())
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
    from PIL import Image

    # libtiff prints its complaints, and Pillow raises them.
    with captured_output([]), Image.open(page.parent.filehandle.path) as image:
        image.seek(page.index)
        return np.array(image)


def png_values(path: Path) -> NDArray[Any]:
    """The pixels of a PNG file; where it has a palette, their numbers in it."""
    from PIL import Image

    with Image.open(path) as image:
        return np.array(image)
