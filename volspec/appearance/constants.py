"""Every number of CIECAM02 and sRGB, typed once: NumPy and GLSL both read them here.

    [appearance] -> prelude -> shaders/relight.frag

References
----------
[1] CIE 159:2004; Neumann et al. (2004), eq. 18-37. Equation 26 is computed in double
    precision as M_HPE · M_CAT02⁻¹ (its printed entries are wrong, see the errata).
[2] IEC 61966-2-1:1999 (sRGB). The matrix follows from the primaries in double precision, so
    that the display's white is exactly (1, 1, 1).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def _frozen(rows: object) -> NDArray[np.float64]:
    array = np.array(rows, dtype=np.float64)
    array.flags.writeable = False
    return array


CAT02_FROM_XYZ = _frozen(
    [[0.7328, 0.4296, -0.1624], [-0.7036, 1.6975, 0.0061], [0.0030, 0.0136, 0.9834]]
)
CAT16_FROM_XYZ = _frozen(
    [
        [0.401288, 0.650173, -0.051461],
        [-0.250268, 1.204414, 0.045854],
        [-0.002079, 0.048952, 0.953127],
    ]
)
HPE_FROM_XYZ = _frozen(
    [[0.38971, 0.68898, -0.07868], [-0.22981, 1.18340, 0.04641], [0.0, 0.0, 1.0]]
)
HPE_FROM_CAT02 = _frozen(HPE_FROM_XYZ @ np.linalg.inv(CAT02_FROM_XYZ))

# Response compression (eq. 27-29): 400 f / (27.13 + f) + 0.1, f = (F_L x / 100)^0.42.
RESPONSE_POLE = 400.0
RESPONSE_HALF = 27.13
RESPONSE_POWER = 0.42
RESPONSE_NOISE = 0.1
# The inverse has its pole at 400; a response clamped here stands for 1e5 times any display's
# white, and its inverse stays finite in float32.
RESPONSE_LIMIT = 399.0

# Opponent signals from compressed responses: achromatic p2 - 0.305 (eq. 35), a and b
# (eq. 30-31), and the sum under the fraction of t (eq. 34).
ACHROMATIC = _frozen([2.0, 1.0, 1.0 / 20.0])
ACHROMATIC_NOISE = 0.305
OPPONENT_A = _frozen([1.0, -12.0 / 11.0, 1.0 / 11.0])
OPPONENT_B = _frozen([1.0 / 9.0, 1.0 / 9.0, -2.0 / 9.0])
CHROMA_SUM = _frozen([1.0, 1.0, 21.0 / 20.0])
# What a and b add to that sum to make the achromatic signal; the inverse of t needs it:
# ACHROMATIC = CHROMA_SUM + 11/23 OPPONENT_A + 108/23 OPPONENT_B.
CHROMA_SKEW = _frozen([11.0 / 23.0, 108.0 / 23.0])
RESPONSE_FROM_OPPONENT = _frozen(np.linalg.inv([ACHROMATIC, OPPONENT_A, OPPONENT_B]))
# eq. 33-34: t = 50000/13 N_c N_cb e_t √(a² + b²) / sum, e_t = (cos(h + 2) + 3.8) / 4.
ECCENTRICITY_SCALE = 50000.0 / 13.0
ECCENTRICITY_PHASE = 2.0
ECCENTRICITY_OFFSET = 3.8
CHROMA_POWER = 0.9
# Where real colours live p2 is above 0.305 and no denominator comes near this share of it; the
# floor keeps imaginary ones from crossing the pole of the chroma's inverse.
CHROMA_FLOOR = 1e-2
# Hue quadrature: red, yellow, green, blue, red again (CIE 159, table 3).
UNIQUE_HUES_DEG = _frozen([20.14, 90.0, 164.25, 237.53, 380.14])
UNIQUE_HUES_ECCENTRICITY = _frozen([0.8, 0.7, 1.0, 1.2, 0.8])
UNIQUE_HUES_H = _frozen([0.0, 100.0, 200.0, 300.0, 400.0])

sRGB_PRIMARIES_XY = _frozen([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
sRGB_WHITE_XY = _frozen([0.3127, 0.3290])


def _XYZ_from_xy(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([xy[0] / xy[1], 1.0, (1.0 - xy[0] - xy[1]) / xy[1]])


def _XYZ_from_RGB() -> NDArray[np.float64]:
    """sRGB's matrix, Y = 1 for the white: columns scaled until (1, 1, 1) is the white."""
    columns = np.stack([_XYZ_from_xy(xy) for xy in sRGB_PRIMARIES_XY], axis=1)
    return columns * np.linalg.solve(columns, _XYZ_from_xy(sRGB_WHITE_XY))


# XYZ here have Y = 100 for the display's white, linear sRGB is 0 to 1.
XYZ_FROM_sRGB = _frozen(100.0 * _XYZ_from_RGB())
sRGB_FROM_XYZ = _frozen(np.linalg.inv(XYZ_FROM_sRGB))
DISPLAY_WHITE_XYZ = _frozen(100.0 * _XYZ_from_xy(sRGB_WHITE_XY))

# sRGB's transfer function: 12.92 x below the toe, 1.055 x^(1/2.4) - 0.055 above.
OETF_TOE = 0.0031308
OETF_SLOPE = 12.92
OETF_GAIN = 1.055
OETF_POWER = 1.0 / 2.4


def shader_constants() -> dict[str, float | NDArray[np.float64]]:
    """The numbers ``shaders/include`` reads, for `volspec._gpu.prelude.prelude`.

    Returns
    -------
    dict
        Name in GLSL -> scalar, vector or (3, 3) matrix.
    """
    return {
        "RESPONSE_POLE": RESPONSE_POLE,
        "RESPONSE_HALF": RESPONSE_HALF,
        "RESPONSE_POWER": RESPONSE_POWER,
        "RESPONSE_LIMIT": RESPONSE_LIMIT,
        "ACHROMATIC": ACHROMATIC,
        "ACHROMATIC_NOISE": ACHROMATIC_NOISE,
        "OPPONENT_A": OPPONENT_A,
        "OPPONENT_B": OPPONENT_B,
        "CHROMA_SKEW": CHROMA_SKEW,
        "CHROMA_FLOOR": CHROMA_FLOOR,
        "RESPONSE_FROM_OPPONENT": RESPONSE_FROM_OPPONENT,
        "RGB_FROM_XYZ": sRGB_FROM_XYZ,
        "OETF_TOE": OETF_TOE,
        "OETF_SLOPE": OETF_SLOPE,
        "OETF_GAIN": OETF_GAIN,
        "OETF_POWER": OETF_POWER,
    }
