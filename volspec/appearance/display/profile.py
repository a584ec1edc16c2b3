"""ICC display profiles: the colour space of a profile with a matrix and curves.

    FILE.icc -> [profile] -> ColourSpace

References
----------
[1] ICC.1:2022: 7.2 header, 7.3 tag table, 8.3.3 three-component matrix-based profiles, 10.6
    curveType, 10.18 parametricCurveType.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from volspec._confine import require_inside
from volspec.appearance.display.constants import BRADFORD_FROM_XYZ
from volspec.appearance.display.spaces import ColourSpace, Transfer, sRGB_CURVE
from volspec.errors import ViewingError

Array = NDArray[np.float64]

# Curves that differ by less, in codes from 0 to 1, count as equal: half an 8-bit step.
_ALIKE = 0.002
# A sampled curve may start and end this far from 0 and 1.
_ENDS = 0.01
D50_XYZ = np.array([0.9642, 1.0, 0.8249])
"""White of the profile connection space."""
# Fields of a display's matrix profile by their offset in the header: ICC.1:2022, 7.2.5 to 7.2.7.
_HEADER = {
    12: ("device class", b"mntr"),
    16: ("colour space", b"RGB "),
    20: ("connection space", b"XYZ "),
}
# Number of parameters of a parametric curve, by type.
_PARAMETERS = (1, 3, 4, 5, 7)


def is_profile(name: str) -> bool:
    """Return True for the file name of an ICC profile."""
    return name.lower().endswith((".icc", ".icm"))


def D50_from_white(white_XYZ: Array) -> Array:
    """Return (3, 3): XYZ under a white to XYZ under D50, by Bradford; Y = 1 for white."""
    gains = (BRADFORD_FROM_XYZ @ D50_XYZ) / (BRADFORD_FROM_XYZ @ white_XYZ)
    return np.asarray(np.linalg.solve(BRADFORD_FROM_XYZ, gains[:, None] * BRADFORD_FROM_XYZ))


def read_profile(path: str | Path) -> ColourSpace:
    """Read the space of a display's matrix profile, ``.icc`` or ``.icm``, named after the file.

    Sampled curves become the power, or sRGB's curve, that they sample. Raises ViewingError, with
    the file as its field, if the file is not an ICC display profile, or has tables instead of a
    matrix or other kinds of curve.
    """
    field = f"colour space {str(path)!r}"
    try:
        data = _read(Path(path))
    except ViewingError as error:
        raise error.at(field) from None
    return space_from_profile(data, Path(path).stem, field)


def space_from_profile(data: bytes, name: str, field: str) -> ColourSpace:
    """Return the space of a matrix profile's bytes; raises as `read_profile`."""
    try:
        return _colour_space(name, _tags(data))
    except ViewingError as error:
        raise error.at(field if not error.field else f"{field}: {error.field}") from None
    except (struct.error, KeyError, IndexError, ValueError) as error:
        fault = f"has no {error.args[0]}" if isinstance(error, KeyError) else "is damaged"
        raise ViewingError(
            f"the profile {fault}",
            "expected a matrix profile of a display, with rXYZ, gXYZ, bXYZ and their TRC",
            code="damaged",
            field=field,
        ) from None


def _read(path: Path) -> bytes:
    """Read a profile's bytes; `read_profile` adds the file to errors from here on down."""
    require_inside(path, ViewingError)
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ViewingError(
            "no such file; check the path, or name a space, as 'sRGB'", code="not-found"
        ) from None
    except IsADirectoryError:
        raise ViewingError("is a folder; give a display's .icc file", code="not-found") from None
    except OSError as error:
        raise ViewingError(
            f"cannot be read: {error.strerror or error}; check the path and its permissions",
            code="damaged",
        ) from None
    if len(data) < 132 or data[36:40] != b"acsp":
        raise ViewingError("not an ICC profile; give a display's .icc file", code="damaged")
    for start, (name, expected) in _HEADER.items():
        actual = data[start : start + 4]
        if actual != expected:
            raise ViewingError(
                f"the profile's {name} is {actual.decode('latin-1').strip()!r}, not "
                f"{expected.decode().strip()!r}",
                "give a display's matrix profile",
                code="unsupported",
            )
    return data


def _tags(data: bytes) -> dict[str, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    places = (struct.unpack_from(">4sII", data, 132 + 12 * i) for i in range(min(count, 100)))
    return {name.decode("latin-1"): data[start : start + size] for name, start, size in places}


def _colour_space(name: str, tags: dict[str, bytes]) -> ColourSpace:
    columns = np.stack([_read_fixed(tags[f"{c}XYZ"], 3) for c in "rgb"], axis=1)
    if "chad" in tags:
        adapted = _read_fixed(tags["chad"], 9).reshape(3, 3)
    else:  # version 2: Bradford's adaptation from the media's white to D50
        with np.errstate(all="ignore"):  # `ColourSpace` refuses a white of 0
            adapted = D50_from_white(_read_fixed(tags["wtpt"], 3))
    XYZ = np.linalg.solve(adapted, columns)
    red, green, blue, white_xy = (_xy(v) for v in (*XYZ.T, XYZ.sum(axis=1)))
    curves = [_curve(tags[f"{c}TRC"]) for c in "rgb"]
    codes = np.linspace(0.0, 1.0, 64)
    spread = np.ptp([curve.encode(codes) for curve in curves], axis=0).max()
    if spread > 2.0 * _ALIKE:
        raise ViewingError(
            f"its channels' curves differ by {spread:.3f}",
            "expected one curve for all three, as of a calibrated display",
            code="unsupported",
        )
    return ColourSpace(name, (red, green, blue), white_xy, curves[1])


def _xy(XYZ: Array) -> tuple[float, float]:
    with np.errstate(all="ignore"):  # `ColourSpace` refuses NaN
        x, y, _ = (XYZ / XYZ.sum()).tolist()
    return x, y


def _numbers(tag: bytes, start: int, kind: str, count: int) -> Array:
    """Return numbers of a tag; raise ValueError if it is too short."""
    return np.frombuffer(tag, dtype=kind, count=count, offset=start).astype(np.float64)


def _read_fixed(tag: bytes, count: int, start: int = 8) -> Array:
    """Return s15Fixed16Numbers of a tag."""
    return _numbers(tag, start, ">i4", count) / 65536.0


def _curve(tag: bytes) -> Transfer:
    kind = tag[:4]
    if kind == b"para":
        (number,) = struct.unpack_from(">H", tag, 8)
        values = _read_fixed(tag, _PARAMETERS[number], start=12).tolist()
        if number in (1, 2):  # (g, a, b[, c]): black below -b/a, useless for a display
            raise ViewingError(
                f"its curves lift black (parametric type {number})",
                "expected type 0 or 3",
                code="unsupported",
            )
        return Transfer.icc(*values)
    if kind != b"curv":
        raise KeyError("TRC of a known kind")
    (count,) = struct.unpack_from(">I", tag, 8)
    if count == 0:
        return Transfer.gamma(1.0)
    table = _numbers(tag, 12, ">u2", count)
    if count == 1:  # u8Fixed8Number
        return Transfer.gamma(float(table[0]) / 256.0)
    return _fit_curve(table / 65535.0)


def _fit_curve(linear: Array) -> Transfer:
    """Return the curve that a table samples: sRGB's, or the nearest power."""
    if not (linear[0] <= _ENDS and linear[-1] >= 1.0 - _ENDS):
        raise ViewingError(
            f"its curves go from {linear[0]:.3f} to {linear[-1]:.3f}",
            "expected 0 to 1, as in a display's own profile",
            code="unsupported",
        )
    if linear.size == 2:  # only the ends: linear in between
        return Transfer.gamma(1.0)
    codes = np.linspace(0.0, 1.0, linear.size)
    inside = (codes > 0.05) & (codes < 1.0) & (linear > 0.0)
    logs = np.log(codes[inside])
    slope = float(np.log(linear[inside]) @ logs / (logs @ logs)) if inside.any() else 1.0
    power = Transfer.gamma(max(slope, 0.1))
    # Near black a 16-bit table has too few steps to compare.
    compared = codes > 0.02
    fits = [
        (float(np.abs(curve.encode(linear) - codes)[compared].max()), curve)
        for curve in (sRGB_CURVE, power)
    ]
    off, curve = min(fits, key=lambda fit: fit[0])
    if off > 5.0 * _ALIKE:
        raise ViewingError(
            f"its curves are neither sRGB's nor a power (off by {off:.3f})",
            "calibrate the display to one of them",
            code="unsupported",
        )
    return curve
