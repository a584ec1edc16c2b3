"""Colour-vision deficiencies: what an observer without one of the cones sees, on a display.

    display's linear RGB -> [deficiency] -> linear RGB | shaders/include/display.glsl

A simulation for a trichromat who looks at the display: colours that the deficient observer confuses
become equal, others keep as much of their difference as that observer sees. It acts on the colours
that the display shows, after gamut mapping, so any appearance model can come before it.

Protan and deutan are Machado's model [1]: one linear map of linear sRGB for each severity, from
trichromacy over shifted cones (anomalous trichromacy) to dichromacy. At severity 1 the maps have
rank 2, as a dichromat's must, and are near Brettel's [2]. The model has no tritanopia: its tritan
maps have rank 3, so they keep colours apart that a tritanope confuses. Tritan is Brettel's
therefore: two half-planes, through the white and the monochromatic lights of 485 and 660 nm, onto
which colours move along the direction in which only S cones respond. A tritan severity below 1 is a
mean of that and the colour itself, weighted by the severity: a convention, not a model of cones.

References
----------
[1] Machado, Oliveira & Fernandes (2009), "A physiologically-based model for simulation of color
    vision deficiency", IEEE TVCG 15(6), 1291-1298. doi:10.1109/TVCG.2009.113
[2] Brettel, Viénot & Mollon (1997), "Computerized simulation of color appearance for dichromats",
    JOSA A 14(10), 2647-2655. doi:10.1364/JOSAA.14.002647
[3] Smith & Pokorny (1975), "Spectral sensitivity of the foveal cone photopigments between 400 and
    500 nm", Vision Research 15(2), 161-171.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from volspec.appearance.display.constants import BRADFORD_FROM_XYZ, frozen
from volspec.appearance.display.spaces import SPACES, ColourSpace

Array = NDArray[np.float64]
DeficiencyName = Literal["none", "protan", "deutan", "tritan"]
DEFICIENCIES: tuple[DeficiencyName, ...] = get_args(DeficiencyName)
VISION: Mapping[str, str] = MappingProxyType(
    {name: "normal" if name == "none" else name for name in DEFICIENCIES}
)
"""Names of colour vision for readers, by deficiency."""

# Linear sRGB at severities 0, 0.1, ..., 1 [1, table 1].
# fmt: off
_PROTAN = frozen(np.reshape([
    1, 0, 0, 0, 1, 0, 0, 0, 1,
    0.856167, 0.182038, -0.038205, 0.029342, 0.955115, 0.015544, -0.002880, -0.001563, 1.004443,
    0.734766, 0.334872, -0.069637, 0.051840, 0.919198, 0.028963, -0.004928, -0.004209, 1.009137,
    0.630323, 0.465641, -0.095964, 0.069181, 0.890046, 0.040773, -0.006308, -0.007724, 1.014032,
    0.539009, 0.579343, -0.118352, 0.082546, 0.866121, 0.051332, -0.007136, -0.011959, 1.019095,
    0.458064, 0.679578, -0.137642, 0.092785, 0.846313, 0.060902, -0.007494, -0.016807, 1.024301,
    0.385450, 0.769005, -0.154455, 0.100526, 0.829802, 0.069673, -0.007442, -0.022190, 1.029632,
    0.319627, 0.849633, -0.169261, 0.106241, 0.815969, 0.077790, -0.007025, -0.028051, 1.035076,
    0.259411, 0.923008, -0.182420, 0.110296, 0.804340, 0.085364, -0.006276, -0.034346, 1.040622,
    0.203876, 0.990338, -0.194214, 0.112975, 0.794542, 0.092483, -0.005222, -0.041043, 1.046265,
    0.152286, 1.052583, -0.204868, 0.114503, 0.786281, 0.099216, -0.003882, -0.048116, 1.051998,
], (11, 3, 3)))
_DEUTAN = frozen(np.reshape([
    1, 0, 0, 0, 1, 0, 0, 0, 1,
    0.866435, 0.177704, -0.044139, 0.049567, 0.939063, 0.011370, -0.003453, 0.007233, 0.996220,
    0.760729, 0.319078, -0.079807, 0.090568, 0.889315, 0.020117, -0.006027, 0.013325, 0.992702,
    0.675425, 0.433850, -0.109275, 0.125303, 0.847755, 0.026942, -0.007950, 0.018572, 0.989378,
    0.605511, 0.528560, -0.134071, 0.155318, 0.812366, 0.032316, -0.009376, 0.023176, 0.986200,
    0.547494, 0.607765, -0.155259, 0.181692, 0.781742, 0.036566, -0.010410, 0.027275, 0.983136,
    0.498864, 0.674741, -0.173604, 0.205199, 0.754872, 0.039929, -0.011131, 0.030969, 0.980162,
    0.457771, 0.731899, -0.189670, 0.226409, 0.731012, 0.042579, -0.011595, 0.034333, 0.977261,
    0.422823, 0.781057, -0.203881, 0.245752, 0.709602, 0.044646, -0.011843, 0.037423, 0.974421,
    0.392952, 0.823610, -0.216562, 0.263559, 0.690210, 0.046232, -0.011910, 0.040281, 0.971630,
    0.367322, 0.860646, -0.227968, 0.280085, 0.672501, 0.047413, -0.011820, 0.042940, 0.968881,
], (11, 3, 3)))
# fmt: on
# Cones [3], and XYZ of monochromatic light (CIE 1931) that trichromats and tritanopes see alike.
_CONES_FROM_XYZ = frozen(
    [[0.15514, 0.54312, -0.03286], [-0.15514, 0.45684, 0.03286], [0.0, 0.0, 0.01608]]
)
_XYZ_485_NM = frozen([0.05795, 0.1693, 0.6162])
_XYZ_660_NM = frozen([0.1649, 0.0610, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A deficient observer's colours: a linear map of linear RGB on each side of a plane.

    The maps agree on the plane, so the simulation is continuous; protan and deutan have one map.
    """

    above: Array  # (3, 3): where plane · RGB >= 0
    below: Array  # (3, 3)
    plane: Array  # (3,)

    def apply(self, linear: ArrayLike) -> Array:
        """Return the simulated (..., 3) linear RGB, not clipped."""
        RGB = np.asarray(linear, dtype=np.float64)
        is_above = (RGB @ self.plane >= 0.0)[..., None]
        return np.where(is_above, RGB @ self.above.T, RGB @ self.below.T)

    def matrix(self, linear: ArrayLike) -> Array:
        """Return the (..., 3, 3) map at each colour: the derivative of `apply`."""
        is_above = np.asarray(linear) @ self.plane >= 0.0
        return np.where(is_above[..., None, None], self.above, self.below)


@dataclass(frozen=True, slots=True, eq=False)
class SeveritySteps:
    """Simulations at equal steps of severity, from 0 to 1; linear between them."""

    above: Array  # (steps, 3, 3)
    below: Array  # (steps, 3, 3)
    plane: Array  # (3,)

    def at(self, severity: float) -> Simulation:
        """Return the simulation at a severity from 0 to 1."""
        place = severity * (len(self.above) - 1)
        low = min(int(place), len(self.above) - 2)
        part = place - low
        above, below = (
            (1.0 - part) * maps[low] + part * maps[low + 1] for maps in (self.above, self.below)
        )
        return Simulation(above, below, self.plane)


def severity_steps(space: ColourSpace) -> Mapping[str, SeveritySteps]:
    """Return protan's, deutan's and tritan's simulations in a display's linear RGB.

    The observer is adapted to the display's white, which all simulations leave unchanged.
    """
    sRGB = SPACES["sRGB"]
    gains = (BRADFORD_FROM_XYZ @ sRGB.white_XYZ) / (BRADFORD_FROM_XYZ @ space.white_XYZ)
    adapted: Array = np.linalg.inv(BRADFORD_FROM_XYZ) @ (gains[:, None] * BRADFORD_FROM_XYZ)
    sRGB_from_RGB = sRGB.RGB_from_XYZ @ adapted @ space.XYZ_from_RGB
    steps = {}
    for name, maps in (("protan", _PROTAN), ("deutan", _DEUTAN)):
        converted: Array = np.linalg.inv(sRGB_from_RGB) @ maps @ sRGB_from_RGB
        steps[name] = SeveritySteps(converted, converted, np.zeros(3))
    return MappingProxyType(steps | {"tritan": _tritan(space)})


def _tritan(space: ColourSpace) -> SeveritySteps:
    cones_from_RGB = _CONES_FROM_XYZ @ space.XYZ_from_RGB
    white = cones_from_RGB.sum(axis=1)

    def onto_half_plane(XYZ: Array) -> Array:
        # The plane's normal is orthogonal to white and anchor; S follows from L and M.
        L, M, S = np.cross(white, _CONES_FROM_XYZ @ XYZ)
        projection = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-L / S, -M / S, 0.0]])
        converted: Array = np.linalg.inv(cones_from_RGB) @ projection @ cones_from_RGB
        return converted

    # Redder than white (L/M above the white's): towards 660 nm, else towards 485 nm.
    plane = np.array([white[1], -white[0], 0.0]) @ cones_from_RGB
    above, below = (
        np.stack([np.eye(3), onto_half_plane(XYZ)]) for XYZ in (_XYZ_660_NM, _XYZ_485_NM)
    )
    return SeveritySteps(above, below, plane / np.abs(plane).max())


def simulation(name: str, severity: float, space: ColourSpace) -> Simulation | None:
    """Return the simulation of a deficiency on a display; None if every colour stays as it is.

    >>> deutan = simulation("deutan", 1.0, SPACES["sRGB"])
    >>> deutan.apply([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0]]).round(2).tolist()
    [[0.37, 0.28, -0.01], [1.0, 1.0, 1.0]]
    """
    if name == "none" or severity == 0.0:
        return None
    return severity_steps(space)[name].at(severity)
