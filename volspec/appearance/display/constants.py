"""Constants of CIECAM02 and CAM16, and cone matrices, defined once for both NumPy and GLSL.

    [constants] -> models, adaptation | prelude -> shaders/relight.frag

References
----------
[1] CIE 159:2004; Neumann et al. (2004), eq. 18-37. Equation 26 is computed in double
    precision as M_HPE · M_CAT02⁻¹ (its printed entries are wrong, see the errata).
[2] Lam (1985), "Metamerism and colour constancy", PhD thesis, University of Bradford.
[3] CIE 109-1994: Hunt-Pointer-Estévez cones normalised to D65, with five digits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def frozen(rows: object) -> NDArray[np.float64]:
    """Return a read-only array."""
    array = np.array(rows, dtype=np.float64)
    array.flags.writeable = False
    return array


CAT02_FROM_XYZ = frozen(
    [[0.7328, 0.4296, -0.1624], [-0.7036, 1.6975, 0.0061], [0.0030, 0.0136, 0.9834]]
)
CAT16_FROM_XYZ = frozen(
    [
        [0.401288, 0.650173, -0.051461],
        [-0.250268, 1.204414, 0.045854],
        [-0.002079, 0.048952, 0.953127],
    ]
)
HPE_FROM_XYZ = frozen([[0.38971, 0.68898, -0.07868], [-0.22981, 1.18340, 0.04641], [0.0, 0.0, 1.0]])
# The same cones, scaled to 1 for D65's white; the survey prints three or four digits [3].
D65_CONES_FROM_XYZ = frozen(
    [[0.40024, 0.70760, -0.08081], [-0.22630, 1.16532, 0.04570], [0.0, 0.0, 0.91822]]
)
BRADFORD_FROM_XYZ = frozen(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
HPE_FROM_CAT02 = frozen(HPE_FROM_XYZ @ np.linalg.inv(CAT02_FROM_XYZ))

# Response compression (eq. 27-29): 400 f / (27.13 + f) + 0.1, f = (F_L x / 100)^0.42.
RESPONSE_POLE = 400.0
RESPONSE_HALF = 27.13
RESPONSE_POWER = 0.42
RESPONSE_NOISE = 0.1
# The inverse has its pole at 400. A response clamped here is that of 1e5 times any display's white,
# and its inverse stays finite in float32.
RESPONSE_LIMIT = 399.0

# Opponent signals from compressed responses: achromatic p2 - 0.305 (eq. 35), a and b
# (eq. 30-31), and the sum in the denominator of t (eq. 34).
ACHROMATIC = frozen([2.0, 1.0, 1.0 / 20.0])
ACHROMATIC_NOISE = 0.305
OPPONENT_A = frozen([1.0, -12.0 / 11.0, 1.0 / 11.0])
OPPONENT_B = frozen([1.0 / 9.0, 1.0 / 9.0, -2.0 / 9.0])
CHROMA_SUM = frozen([1.0, 1.0, 21.0 / 20.0])
# The contribution of a and b to the achromatic signal, needed to invert t:
# ACHROMATIC = CHROMA_SUM + 11/23 OPPONENT_A + 108/23 OPPONENT_B.
CHROMA_SKEW = frozen([11.0 / 23.0, 108.0 / 23.0])
RESPONSE_FROM_OPPONENT = frozen(np.linalg.inv([ACHROMATIC, OPPONENT_A, OPPONENT_B]))
# eq. 33-34: t = 50000/13 N_c N_cb e_t √(a² + b²) / sum, e_t = (cos(h + 2) + 3.8) / 4.
ECCENTRICITY_SCALE = 50000.0 / 13.0
ECCENTRICITY_PHASE = 2.0
ECCENTRICITY_OFFSET = 3.8
CHROMA_POWER = 0.9
# Real colours have p2 above 0.305, and no denominator comes near this fraction of it; the floor
# keeps imaginary ones from crossing the pole of the chroma's inverse.
CHROMA_FLOOR = 1e-2
# Hue quadrature: red, yellow, green, blue, red again (CIE 159, table 3).
UNIQUE_HUES_DEG = frozen([20.14, 90.0, 164.25, 237.53, 380.14])
UNIQUE_HUES_ECCENTRICITY = frozen([0.8, 0.7, 1.0, 1.2, 0.8])
UNIQUE_HUES_H = frozen([0.0, 100.0, 200.0, 300.0, 400.0])


_IN_SHADERS = (
    *("RESPONSE_POLE", "RESPONSE_HALF", "RESPONSE_POWER", "RESPONSE_LIMIT", "ACHROMATIC"),
    *("ACHROMATIC_NOISE", "OPPONENT_A", "OPPONENT_B", "CHROMA_SKEW", "CHROMA_FLOOR"),
    "RESPONSE_FROM_OPPONENT",
)


def shader_constants() -> dict[str, float | NDArray[np.float64]]:
    """Return the models' constants that ``shaders/include`` reads, by GLSL name."""
    return {name: globals()[name] for name in _IN_SHADERS}
