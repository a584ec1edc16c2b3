"""OpenEXR files as a header and named arrays.

    _files -> [_exr] -> spectra, raycast, export

Parts of a multi-part file are merged; its header is the first part's.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec._confine import require_inside
from volspec._files import captured_output, nearest_file, write_whole
from volspec.errors import InputError

Channels = dict[str, NDArray[Any]]
"""Channels, (H, W), by name."""

_WORD = 4  # bytes of the largest pixel type
# Greatest compression ratio of ZIP; and size in bytes that is allowed for any file.
_MAX_RATIO, _ALWAYS_ALLOWED = 1032, 1 << 27


def read_exr(
    path: str | os.PathLike[str],
    error: type[InputError],
    *,
    missing: str = "no such file",
    again: str = "export it again",
) -> tuple[dict[str, Any], Channels]:
    """Read the header and every channel, (H, W) float32, float16 or uint32, of an OpenEXR file.

    Raises ``error`` if the file is missing, unreadable or damaged; ``missing`` is the message for
    a missing file, ``again`` the remedy for a damaged one.
    """
    name, channels = os.fspath(path), Channels()
    _require_file(name, error, missing)
    output: list[str] = []
    with _one_line_errors(name, error, again), captured_output(output):
        with _open(name, header_only=True) as file:
            _require_held(name, [part.header for part in file.parts], error, again)
        with _open(name) as file:
            header = _known_attributes(file.header())
            for part in range(len(file.parts)):
                for key, channel in file.channels(part).items():
                    if key in channels:
                        raise error(
                            f"{name}: two parts hold a channel {key!r}; export one part",
                            code="duplicate",
                        )
                    channels[key] = np.array(channel.pixels)
    if any("error" in line.lower() or "EXR_ERR" in line for line in output):
        raise error(f"{name}: damaged ({output[-1].strip()}); {again}", code="damaged")
    return header, channels


def read_header(path: str | os.PathLike[str], error: type[InputError]) -> dict[str, Any]:
    """Read the header of an OpenEXR file, or of its first part; raises as `read_exr`."""
    name = os.fspath(path)
    _require_file(name, error, "no such file")
    with (
        _one_line_errors(name, error, "export it again"),
        captured_output([]),
        _open(name, header_only=True) as file,
    ):
        return _known_attributes(file.header())


def _open(name: str, **options: bool) -> Any:
    import OpenEXR

    return OpenEXR.File(name, **{"separate_channels": True, **options})


def _known_attributes(header: Mapping[str, Any]) -> dict[str, Any]:
    """Return the attributes whose types OpenEXR supports; others cannot even be printed."""
    import OpenEXR

    opaque = getattr(OpenEXR, "OpaqueAttribute", ())  # older versions omit such attributes
    return {k: v for k, v in header.items() if not isinstance(v, opaque)}


def _require_held(
    name: str, headers: Sequence[Mapping[str, Any]], error: type[InputError], again: str
) -> None:
    """Refuse sizes that a file of this length cannot hold, before memory is allocated."""
    limit, size = _MAX_RATIO * Path(name).stat().st_size, 0
    for header in headers:
        low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
        width, height = (int(side) for side in high - low + 1)
        size += width * height * _WORD * len(header["channels"])
        if max(size, width, height) > max(limit, _ALWAYS_ALLOWED):
            raise error(
                f"{name}: its header has {width}×{height} pixels of {len(header['channels'])} "
                f"channels, which {Path(name).stat().st_size} bytes cannot hold; {again}",
                code="damaged",
            )


def _require_file(name: str, error: type[InputError], missing: str) -> None:
    """Refuse missing files, folders and the like, which OpenEXR would report as truncated."""
    require_inside(name, error)
    try:
        Path(name).open("rb").close()
    except FileNotFoundError:
        if guess := nearest_file(Path(name)):
            missing = f"no such file; {guess}check the path"
        raise error(f"{name}: {missing}", code="not-found") from None
    except IsADirectoryError:
        raise error(f"{name}: is a folder; give an .exr file", code="type") from None
    except OSError as fault:
        raise error(f"{name}: cannot be read: {fault.strerror}", code="damaged") from None
    except ValueError:  # a NUL character
        raise error(f"{name!r} is not a path; give an .exr file", code="syntax") from None


@contextmanager
def _one_line_errors(name: str, error: type[InputError], again: str) -> Iterator[None]:
    """Turn OpenEXR's exceptions into one-line errors."""
    try:
        yield
    except error:
        raise
    except MemoryError as fault:
        raise error(
            f"{name}: too large for this machine's memory; {again}, smaller", code="size"
        ) from fault
    # A damaged file may raise anything: C++ exceptions, and errors from its names and numbers.
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
    """Write an OpenEXR file of scan lines, losslessly compressed, atomically.

    The header must not have type and compression, which are set here. Float16 channels are
    written as such, all others as float32. Raises ``error`` if the file cannot be written, and a
    plain `InputError` if the folder is the cause.
    """
    pixels = {key: _to_float(np.asarray(image)) for key, image in channels.items()}
    _write(path, header, "scanlineimage", "ZIP_COMPRESSION", pixels, error)


def write_deep_exr(
    path: str | os.PathLike[str],
    header: Mapping[str, Any],
    counts: NDArray[np.int64],
    channels: Mapping[str, NDArray[Any]],
    error: type[InputError],
) -> None:
    """Write an OpenEXR file of deep scan lines, as `write_exr`.

    ``counts`` (H, W) are the samples of each pixel; a channel holds those of all pixels, (N,) in
    the order of the pixels.
    """
    covered = np.flatnonzero(counts)
    ends = np.cumsum(counts.ravel()[covered]).tolist()
    places = [*zip(covered.tolist(), [0, *ends[:-1]], ends, strict=True)] if ends else []
    pixels = {}
    for key, samples in channels.items():
        flat, values = np.empty(counts.size, object), _to_float(samples)
        flat[0] = values[:0]  # the type of a channel without samples
        for pixel, start, end in places:
            flat[pixel] = values[start:end]
        pixels[key] = flat.reshape(counts.shape)
    _write(path, header, "deepscanline", "ZIPS_COMPRESSION", pixels, error)


def _write(
    path: str | os.PathLike[str],
    header: Mapping[str, Any],
    kind: str,
    compression: str,
    pixels: Channels,
    error: type[InputError],
) -> None:
    import OpenEXR

    layout = {"type": getattr(OpenEXR, kind), "compression": getattr(OpenEXR, compression)}
    with write_whole(path) as temporary:
        try:
            with captured_output([]):
                OpenEXR.File({**header, **layout}, pixels).write(os.fspath(temporary))
        except (RuntimeError, OSError, ValueError) as fault:
            if (full := os.strerror(errno.ENOSPC)) in str(fault):
                raise OSError(errno.ENOSPC, full) from fault  # as of other writers
            raise error(
                f"{os.fspath(path)}: cannot be written: {fault}", code="unwritable"
            ) from fault


def chromaticities(
    primaries_xy: Sequence[tuple[float, float]], white_xy: tuple[float, float]
) -> tuple[float, ...]:
    """Return OpenEXR's header attribute ``chromaticities``: R, G, B and white."""
    return tuple(float(v) for xy in (*primaries_xy, white_xy) for v in xy)


def to_half(pixels: ArrayLike) -> NDArray[np.float16]:
    """Convert to half floats, clipped to the largest finite value; NaN becomes 0."""
    largest = float(np.finfo(np.float16).max)
    return np.clip(np.nan_to_num(pixels, nan=0.0), -largest, largest).astype(np.float16)


def _to_float(image: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(image, np.float16 if image.dtype == np.float16 else np.float32)
