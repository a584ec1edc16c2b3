"""An ICC profile for a display's colour space: matrix and parametric curve.

    ColourSpace -> [icc] -> the iCCP chunk of a PNG

References
----------
[1] ICC.1:2022, profile version 4: 7.2 header, 8.3 display profiles, 9.2 tags, 10.18
    parametricCurveType; annex E, Bradford adaptation to the connection space's D50.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import ArrayLike

from volspec.appearance.profile import D50_XYZ, D50_from_white
from volspec.appearance.spaces import ColourSpace


def _fixed(values: ArrayLike) -> bytes:
    """s15Fixed16Numbers."""
    whole = np.rint(np.asarray(values, dtype=np.float64).ravel() * 65536.0)
    return whole.astype(">i4").tobytes()


def _text(text: str) -> bytes:
    """multiLocalizedUnicodeType with one record, in English."""
    encoded = text.encode("utf-16-be")
    return b"mluc" + struct.pack(">IIIHHII", 0, 1, 12, 0x656E, 0x5553, len(encoded), 28) + encoded


def _curve(space: ColourSpace) -> bytes:
    t = space.transfer
    if t.toe == 0.0:
        return b"para" + struct.pack(">IHH", 0, 0, 0) + _fixed([1.0 / t.power])
    numbers = [1.0 / t.power, 1.0 / t.gain, (t.gain - 1.0) / t.gain, 1.0 / t.slope, t.slope * t.toe]
    return b"para" + struct.pack(">IHH", 0, 3, 0) + _fixed(numbers)


def icc_profile(space: ColourSpace) -> bytes:
    """A version 4 display profile of a space.

    Parameters
    ----------
    space : ColourSpace

    Returns
    -------
    bytes
        To be written as it is, to a ``.icc`` file or into a picture.

    Examples
    --------
    >>> from volspec.appearance.spaces import SPACES
    >>> icc_profile(SPACES["Display P3"])[36:40]
    b'acsp'
    """
    matrix = space.XYZ_from_RGB / 100.0
    adapted = D50_from_white(matrix.sum(axis=1))
    red, green, blue = (b"XYZ \0\0\0\0" + _fixed(column) for column in (adapted @ matrix).T)
    curve = _curve(space)
    tags = {
        b"desc": _text(space.name),
        b"cprt": _text("No copyright, use freely"),
        b"wtpt": b"XYZ \0\0\0\0" + _fixed(D50_XYZ),
        b"chad": b"sf32\0\0\0\0" + _fixed(adapted),
        b"rXYZ": red,
        b"gXYZ": green,
        b"bXYZ": blue,
        **dict.fromkeys((b"rTRC", b"gTRC", b"bTRC"), curve),
    }
    start = 128 + 4 + 12 * len(tags)
    table, data = struct.pack(">I", len(tags)), b""
    places: dict[bytes, int] = {}  # channels of one curve share it
    for name, value in tags.items():
        if value not in places:
            places[value] = start + len(data)
            data += value + bytes(-len(value) % 4)
        table += name + struct.pack(">II", places[value], len(value))
    header = struct.pack(
        ">II4s4s4s4s12s4s28s12s48s",
        *(start + len(data), 0, b"\x04\x40\0\0", b"mntr", b"RGB ", b"XYZ "),
        # A fixed date: the same space gives the same bytes.
        *(struct.pack(">6H", 2026, 1, 1, 0, 0, 0), b"acsp", bytes(28), _fixed(D50_XYZ), bytes(48)),
    )
    return header + table + data
