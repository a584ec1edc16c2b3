"""A transfer function from VTK's: opacity and colour over values become points and materials.

    VTK volume property -> [adapt] -> TransferFunction

Opacity means the same on both sides: 1 − (1 − opacity)^(step / unit distance). A colour becomes a
plausible reflectance that has it under D65. VTK mixes sRGB codes between its points and along the
ray, volspec mixes light: pictures agree in where things are and in the colour of what is opaque,
and differ where layers shine through each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volspec.appearance.curves import sRGB_CURVE
from volspec.basis import Basis, SpectralBasis
from volspec.errors import TransferError
from volspec.spectra import reflectance_from_colour
from volspec.transfer.model import TransferFunction

Array = NDArray[np.float64]

# Between VTK's own points its curves may bend (sharpness, HSV, Lab).
_BETWEEN = 256
# Of the span: nearer values are one.
_SAME = 1e-9
# Of a code, 0 to 1: what a colour may be off between two materials; and of an opacity.
_COLOUR_ERROR, _OPACITY_ERROR = 2 / 255, 1e-6


def transfer_from_vtk(
    settings: Any, unit_scale: float = 1.0, basis: Basis | None = None, name: str = "volume"
) -> TransferFunction:
    """Take over the scalar opacity and the colours of a VTK volume property.

    Parameters
    ----------
    settings : vtkVolumeProperty
        Its first component's curves.
    unit_scale : float
        Millimetres for each unit in which the property counts its opacity unit distance.
    basis : SpectralBasis, optional
        ``general-7`` when left out. A `MaterialBasis` would have to know the materials.
    name : str
        Used in messages.

    Returns
    -------
    TransferFunction
        Materials are called by their colour, ``"#rrggbb"``; another reflectance can be put in
        their place.

    Raises
    ------
    TransferError
        If the property has a 2-D transfer function, or no opacity unit distance above 0.

    Warns
    -----
    VolspecWarning
        If no reflectance has one of the colours.
    """
    if settings.GetTransferFunctionMode() != 0:
        raise TransferError(f"{name}: has a 2-D transfer function; give curves over values")
    thickness = settings.GetScalarOpacityUnitDistance(0)
    if not 0 < thickness < math.inf:
        raise TransferError.refused(
            f"{name}: opacity_unit_distance", thickness, "give a length above 0", "range"
        )
    curve = settings.GetScalarOpacity(0)
    values = _values(curve, _colours(settings))
    opacities = np.array([curve.GetValue(value) for value in values]).clip(0, 1)
    codes = _codes(_colours(settings), values)
    keys = _knots(values, sRGB_CURVE.decode(codes), sRGB_CURVE.encode, _COLOUR_ERROR)
    turns = _knots(values, opacities[:, None], np.asarray, _OPACITY_ERROR)
    words = ["#" + "".join(f"{round(255 * c):02x}" for c in codes[key]) for key in keys]
    points = [
        (float(values[i]), float(opacities[i]), _mix(values[i], values[keys], words))
        for i in sorted({*keys, *turns})
    ]
    return TransferFunction(
        points,
        {word: reflectance_from_colour(word) for word in dict.fromkeys(words)},
        basis or SpectralBasis.load("general-7"),
        thickness * unit_scale,
    )


def _colours(settings: Any) -> Any:
    """Its colours, or greys, by value: a vtkColorTransferFunction or vtkPiecewiseFunction."""
    grey = settings.GetColorChannels(0) == 1
    return settings.GetGrayTransferFunction(0) if grey else settings.GetRGBTransferFunction(0)


def _codes(colours: Any, values: Array) -> Array:
    """(V, 3) sRGB codes, 0 to 1."""
    if hasattr(colours, "GetColor"):
        return np.array([colours.GetColor(value) for value in values]).clip(0, 1)
    return np.array([[colours.GetValue(value)] * 3 for value in values]).clip(0, 1)


def _values(*curves: Any) -> Array:
    """Where to look: the points of the curves, and evenly between the outermost."""
    nodes = []
    for curve in curves:
        node = [0.0] * (6 if hasattr(curve, "GetColor") else 4)
        for i in range(curve.GetSize()):
            curve.GetNodeValue(i, node)
            nodes.append(node[0])
    low, high = min(nodes), max(nodes)
    values = np.unique([*nodes, *np.linspace(low, high, _BETWEEN)])
    return values[np.diff(values, prepend=-np.inf) > _SAME * (high - low)]


def _knots(values: Array, rows: Array, shown: Callable[[Array], Array], error: float) -> list[int]:
    """Which of (V,) values suffice to draw (V, C) rows by straight lines, rising.

    What is off by most becomes the next, until all is within ``error`` of what is ``shown``.
    """
    kept = sorted({0, len(values) - 1})
    wanted = shown(rows)
    while True:
        drawn = [np.interp(values, values[kept], column[kept]) for column in rows.T]
        off = np.abs(shown(np.stack(drawn, axis=1)) - wanted).max(axis=1)
        worst = int(off.argmax())
        if off[worst] <= error:
            return kept
        kept = sorted({*kept, worst})


def _mix(value: float, keys: Array, words: Sequence[str]) -> dict[str, float]:
    """Shares of the two colours around a value."""
    right = int(np.searchsorted(keys, value).clip(0, len(keys) - 1))
    left = max(right - 1, 0)
    share = float(np.interp(value, keys[[left, right]], [0.0, 1.0])) if right else 1.0
    mix = {words[left]: 1.0 - share}
    mix[words[right]] = mix.get(words[right], 0.0) + share
    return {word: part for word, part in mix.items() if part > 0}
