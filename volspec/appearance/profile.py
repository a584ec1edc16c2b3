"""A display's own profile: the colour space of an ICC file made of a matrix and curves.

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

from volspec.appearance.adaptation.von_kries import BRADFORD_FROM_XYZ
from volspec.appearance.curves import Transfer, sRGB_CURVE
from volspec.appearance.spaces import ColourSpace
from volspec.errors import ViewingError

Array = NDArray[np.float64]

# Two curves that differ by less, in codes of 0 to 1, are one: half an 8-bit step.
_ALIKE = 0.002
D50_XYZ = np.array([0.9642, 1.0, 0.8249])
"""The profile connection space's white."""
# How many numbers a parametric curve of each type has.
_PARAMETERS = (1, 3, 4, 5, 7)


def D50_from_white(white_XYZ: Array) -> Array:
    """(3, 3): XYZ beside a white to those beside D50, by Bradford's responses; Y = 1 for white."""
    gains = (BRADFORD_FROM_XYZ @ D50_XYZ) / (BRADFORD_FROM_XYZ @ white_XYZ)
    return np.asarray(np.linalg.solve(BRADFORD_FROM_XYZ, gains[:, None] * BRADFORD_FROM_XYZ))


def read_profile(path: str | Path) -> ColourSpace:
    """The space of a matrix profile, as displays have.

    Parameters
    ----------
    path : path
        A ``.icc`` or ``.icm`` file.

    Returns
    -------
    ColourSpace
        Named after the file. Sampled curves become the power, or sRGB's curve, that they are.

    Raises
    ------
    ViewingError
        If it is no such file, has tables instead of a matrix, or curves of another kind.
    """
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise ViewingError(f"colour space {str(path)!r}: {error.strerror or error}") from None
    if len(data) < 132 or data[36:40] != b"acsp":
        raise ViewingError(
            f"colour space {str(path)!r}: no ICC profile; give a display's .icc file"
        )
    try:
        return _space(Path(path), _tags(data))
    except ViewingError:
        raise
    except (struct.error, KeyError, IndexError, ValueError) as error:
        what = f"has no {error.args[0]}" if isinstance(error, KeyError) else "is damaged"
        raise ViewingError(
            f"colour space {str(path)!r}: the profile {what}; expected a matrix profile of a "
            "display, with rXYZ, gXYZ, bXYZ and their TRC"
        ) from None


def _tags(data: bytes) -> dict[str, bytes]:
    (count,) = struct.unpack_from(">I", data, 128)
    places = (struct.unpack_from(">4sII", data, 132 + 12 * i) for i in range(min(count, 100)))
    return {name.decode("latin-1"): data[start : start + size] for name, start, size in places}


def _space(path: Path, tags: dict[str, bytes]) -> ColourSpace:
    columns = np.stack([_fixed(tags[f"{c}XYZ"][8:20]) for c in "rgb"], axis=1)
    if "chad" in tags:
        adapted = _fixed(tags["chad"][8:44]).reshape(3, 3)
    else:  # version 2: the media's white, from which Bradford's adaptation leads to D50
        adapted = D50_from_white(_fixed(tags["wtpt"][8:20]))
    XYZ = np.linalg.solve(adapted, columns)
    red, green, blue, white_xy = (_xy(v) for v in (*XYZ.T, XYZ.sum(axis=1)))
    curves = [_curve(path, tags[f"{c}TRC"]) for c in "rgb"]
    codes = np.linspace(0.0, 1.0, 64)
    spread = np.ptp([curve.encode(codes) for curve in curves], axis=0).max()
    if spread > 2.0 * _ALIKE:
        raise ViewingError(
            f"colour space {str(path)!r}: its channels' curves differ by {spread:.3f}; expected "
            "one for all, as a calibrated display's"
        )
    return ColourSpace(path.stem, (red, green, blue), white_xy, curves[1])


def _xy(XYZ: Array) -> tuple[float, float]:
    x, y, _ = (XYZ / XYZ.sum()).tolist()
    return x, y


def _fixed(data: bytes) -> Array:
    """s15Fixed16Numbers."""
    return np.frombuffer(data, dtype=">i4").astype(np.float64) / 65536.0


def _curve(path: Path, tag: bytes) -> Transfer:
    kind = tag[:4]
    if kind == b"para":
        (number,) = struct.unpack_from(">H", tag, 8)
        values = _fixed(tag[12 : 12 + 4 * _PARAMETERS[number]]).tolist()
        if number in (1, 2):  # (g, a, b[, c]): black below -b/a, of no use to a display
            raise ViewingError(
                f"colour space {str(path)!r}: its curves lift black (parametric type {number}); "
                "expected type 0 or 3"
            )
        return Transfer.icc(*values)
    if kind != b"curv":
        raise KeyError("TRC of a known kind")
    (count,) = struct.unpack_from(">I", tag, 8)
    if count == 0:
        return Transfer.gamma(1.0)
    table = np.frombuffer(tag[12 : 12 + 2 * count], dtype=">u2").astype(np.float64)
    if count == 1:  # u8Fixed8Number
        return Transfer.gamma(float(table[0]) / 256.0)
    return _fitted(path, table / 65535.0)


def _fitted(path: Path, linear: Array) -> Transfer:
    """The curve that a table was made of: sRGB's, or the power nearest to it."""
    codes = np.linspace(0.0, 1.0, linear.size)
    inside = (codes > 0.05) & (linear > 0.0)
    logs = np.log(codes[inside])
    power = Transfer.gamma(max(float(np.log(linear[inside]) @ logs / (logs @ logs)), 0.1))
    # Next to black a table of 16 bits has too few steps to tell.
    told = codes > 0.02
    fits = [(float(np.abs(c.encode(linear) - codes)[told].max()), c) for c in (sRGB_CURVE, power)]
    off, curve = min(fits, key=lambda fit: fit[0])
    if off > 5.0 * _ALIKE:
        raise ViewingError(
            f"colour space {str(path)!r}: its curves are neither sRGB's nor a power (off by "
            f"{off:.3f}); calibrate the display to one of them"
        )
    return curve
