"""OpenEXR files as a header and named arrays, for every kind of image there is.

    _files -> [_exr] -> spectra, raycast, export

The parts of a file with several are taken together; its header is the first one's.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._files import captured_output, write_whole
from volspec.errors import InputError

Channels = dict[str, NDArray[Any]]
"""(H, W) by name."""

_WORD = 4  # bytes of the largest kind of pixel
# What ZIP can make of a byte; and bytes that are given to any file, however it is packed.
_MOST_RATIO, _ALWAYS_HELD = 1032, 1 << 27


def read_exr(
    path: str | os.PathLike[str],
    error: type[InputError],
    *,
    missing: str = "no such file",
    again: str = "export it again",
) -> tuple[dict[str, Any], Channels]:
    """The header and every channel of an OpenEXR file.

    Parameters
    ----------
    path : path
    error : type
        What to raise.
    missing, again : str
        What to say where there is no such file, and where it is damaged.

    Returns
    -------
    header : {str: value}
    channels : {str: (H, W) array}
        As stored: float32, float16 or uint32.

    Raises
    ------
    InputError
        Of the given class, if the file is missing, unreadable or damaged.
    """
    name, channels = os.fspath(path), Channels()
    _require_file(name, error, missing)
    said: list[str] = []
    with _refused(name, error, again), captured_output(said):
        with _opened(name, header_only=True) as file:
            _require_held(name, [part.header for part in file.parts], error, again)
        with _opened(name) as file:
            header = _known(file.header())
            for part in range(len(file.parts)):
                for key, channel in file.channels(part).items():
                    if key in channels:
                        raise error(f"{name}: two parts hold a channel {key!r}; export one part")
                    channels[key] = np.array(channel.pixels)
    if any("error" in line.lower() or "EXR_ERR" in line for line in said):
        raise error(f"{name}: damaged ({said[-1].strip()}); {again}", code="damaged")
    return header, channels


def read_header(path: str | os.PathLike[str], error: type[InputError]) -> dict[str, Any]:
    """The header of an OpenEXR file, of the first part where it has several.

    Raises
    ------
    InputError
        As `read_exr`.
    """
    name = os.fspath(path)
    _require_file(name, error, "no such file")
    again = "export it again"
    with _refused(name, error, again), captured_output([]), _opened(name, header_only=True) as file:
        return _known(file.header())


def _opened(name: str, **how: bool) -> Any:
    import OpenEXR

    return OpenEXR.File(name, **{"separate_channels": True, **how})


def _known(header: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes of kinds that OpenEXR knows: others may not even be printed."""
    import OpenEXR

    opaque = getattr(OpenEXR, "OpaqueAttribute", ())  # older ones leave them out
    return {k: v for k, v in header.items() if not isinstance(v, opaque)}


def _require_held(
    name: str, headers: Sequence[Mapping[str, Any]], error: type[InputError], again: str
) -> None:
    """Refuse sizes that a file of this length cannot hold, before room is made for them."""
    most, held = _MOST_RATIO * Path(name).stat().st_size, 0
    for header in headers:
        low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
        width, height = (int(side) for side in high - low + 1)
        held += width * height * _WORD * len(header["channels"])
        if max(held, width, height) > max(most, _ALWAYS_HELD):
            raise error(
                f"{name}: says that it is {width}×{height} pixels of {len(header['channels'])} "
                f"channels, which {Path(name).stat().st_size} bytes cannot hold; {again}"
            )


def _require_file(name: str, error: type[InputError], missing: str) -> None:
    """Refuse what OpenEXR, whatever it is, would call truncated."""
    try:
        Path(name).open("rb").close()
    except FileNotFoundError:
        raise error(f"{name}: {missing}") from None
    except IsADirectoryError:
        raise error(f"{name}: is a folder; give an .exr file") from None
    except OSError as fault:
        raise error(f"{name}: cannot be read: {fault.strerror}", code="damaged") from None
    except ValueError:  # a NUL character
        raise error(f"{name!r} is no path; give an .exr file") from None


@contextmanager
def _refused(name: str, error: type[InputError], again: str) -> Iterator[None]:
    """Put what OpenEXR raises into one line."""
    try:
        yield
    except error:
        raise
    except MemoryError as fault:
        raise error(
            f"{name}: too large for this machine's memory; {again}, smaller", code="size"
        ) from fault
    # A damaged file ends in whatever C++ throws and in what its names and numbers break here.
    except Exception as fault:
        raise error(
            f"{name}: not a readable OpenEXR file, or truncated; {again}", code="damaged"
        ) from fault


def write_exr(
    path: str | os.PathLike[str],
    header: Mapping[str, Any],
    channels: Mapping[str, ArrayLike],
    error: type[InputError],
) -> None:
    """Write an OpenEXR file of scan lines, losslessly compressed, whole or not at all.

    Parameters
    ----------
    path : path
    header : {str: value}
        Beside the type and the compression, which are set here.
    channels : {str: (H, W) array}
        float16 stays so; everything else is written as float32.
    error : type
        What to raise.

    Raises
    ------
    InputError
        Of the given class, if the file cannot be written; its own where the folder is at fault.
    """
    import OpenEXR

    layout = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    pixels = {key: _stored(np.asarray(image)) for key, image in channels.items()}
    with write_whole(path) as temporary:
        try:
            with captured_output([]):
                OpenEXR.File({**header, **layout}, pixels).write(os.fspath(temporary))
        except (RuntimeError, OSError, ValueError) as fault:
            raise error(
                f"{os.fspath(path)}: cannot be written: {fault}", code="unwritable"
            ) from fault


def chromaticities(
    primaries_xy: Sequence[tuple[float, float]], white_xy: tuple[float, float]
) -> tuple[float, ...]:
    """OpenEXR's header attribute of that name: what R, G, B and their white are."""
    return tuple(float(v) for xy in (*primaries_xy, white_xy) for v in xy)


def halves(pixels: ArrayLike) -> NDArray[np.float16]:
    """As half floats; what is too large becomes the largest, NaN 0."""
    largest = float(np.finfo(np.float16).max)
    return np.clip(np.nan_to_num(pixels, nan=0.0), -largest, largest).astype(np.float16)


def _stored(image: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(image, np.float16 if image.dtype == np.float16 else np.float32)
